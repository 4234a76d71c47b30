# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `param dump` prints starts a node with the same parameters."""

from array import array

from forks import command
from graph import START_TIMEOUT
import pytest
from rclpy.node import Node

from snake_sim_ros import ParameterError
from snake_sim_ros.nodes import follow_node, gait_node, sim_node, viewer_node
from snake_sim_ros.nodes.graph import parameter_file
from snake_sim_ros.nodes.node_parameters import settle
from snake_sim_ros.nodes.node_process import made
from snake_sim_ros.nodes.sim_parameters import as_it_runs
from snake_sim_ros.scene.files import files_of_package

OF_SIM = {'kind': sim_node.Settings, 'complete': as_it_runs}
NODES = {
    'sim': OF_SIM,
    'gait': {'kind': gait_node.Settings, 'of_scene': gait_node.OF_SCENE},
    'follow': {
        'kind': follow_node.Settings,
        'of_scene': ('follow.',),
        'changeable': follow_node.GAINS,
    },
    'viewer': {'kind': viewer_node.Settings, 'of_scene': ()},
}


def started(name, *arguments):
    """Return a node that only has the parameters of one of ours, with the values they give."""
    node = Node(
        name,
        cli_args=['--ros-args', *arguments],
        automatically_declare_parameters_from_overrides=True,
    )
    try:
        return settle(node, **NODES[name]), node.get_parameters_by_prefix('')
    finally:
        node.destroy_node()


def dumped(name, parameters, folder):
    """Return the file of a node's parameters."""
    values = {key: item.value for key, item in parameters.items()}
    plain = {key: list(each) if isinstance(each, array) else each for key, each in values.items()}
    path = folder / 'dump.yaml'
    path.write_text(parameter_file(name, plain))
    return path


CASES = (
    *(('sim', scene) for scene in files_of_package(robots=False)),
    *(('sim', 'sidewinding', '-p', item) for item in (
        'accuracy:=0.001', 'robot.yaw_torque_limit:=3.0', 'friction.backward:=0.3',
        'start.yaw:=[0.1, 0.2, 0.1, 0.2, 0.1, 0.2, 0.1, 0.2, 0.1, 0.2]', 'imu_links:=[1, 11]',
    )),
    ('gait', 'sidewinding'),
    ('follow', 'sidewinding', '-p', 'follow.center:=[0.0, -1.5]'),
    ('viewer', 'sidewinding'),
)  # fmt: skip


@pytest.mark.usefixtures('middleware')
@pytest.mark.parametrize(('name', 'scene', 'others'), [(*case[:2], case[2:]) for case in CASES])
def test_a_dump_starts_a_node_with_the_same_parameters(name, scene, others, tmp_path):
    settled, parameters = started(name, '-p', f'scene:={scene}', *others)
    path = dumped(name, parameters, tmp_path)
    again, same = started(name, '--params-file', str(path))
    assert again == settled
    assert {key: item.value for key, item in same.items()} == {
        key: item.value for key, item in parameters.items()
    }


@pytest.mark.usefixtures('middleware')
def test_null_is_none_only_where_a_value_may_be_missing():
    (_, scene), _ = started('sim', '-p', 'robot.yaw_torque_limit:="null"')
    assert scene.robot.yaw_torque_limit is None
    (settings, _), _ = started('sim', '-p', 'frame_prefix:="null"')
    assert settings.frame_prefix == 'null'
    with pytest.raises(ParameterError, match=r'robot\.link_mass must be a number, got None'):
        made(lambda: started('sim', '-p', 'robot.link_mass:="null"'))


def test_the_dump_of_a_live_node_starts_another_one(make_graph, tmp_path):
    graph = make_graph()
    sim = graph.start('sim', 'scene:=lateral_undulation')
    sim.wait_for('physics ready', START_TIMEOUT)
    dump = command(['param', 'dump', '/sim'], graph.domain)
    assert dump.wait() == 0, dump.output
    assert sim.stop() == 0
    path = tmp_path / 'dump.yaml'
    path.write_text(dump.output)
    again = make_graph().start('sim', f'--params-file {path}')
    again.wait_for('physics ready', START_TIMEOUT)
