# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node whose physics is not compiled yet is there, tells of the compiler, and can be ended."""

from pathlib import Path
import shutil

from offline import nanoseconds
import pytest
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_srvs.srv import SetBool
from std_srvs.srv import Trigger

from snake_sim_ros.dynamics.code_cache import FOLDER
from snake_sim_ros.nodes.sim_node import SimNode
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.posture import joint_angles

PLANAR, SPATIAL = 'stepping.planar/moreau.advance', 'stepping/moreau.advance-'


@pytest.fixture
def start(make_graph, tmp_path, monkeypatch):
    """Return a function that starts a sim where the loop of a level is not compiled."""

    def make(*missing):
        folder = tmp_path / 'snake_sim_ros' / FOLDER.name
        shutil.copytree(FOLDER, folder)
        for name in missing:
            room, name = name.split('/')
            found = list((folder / f'snake_sim_ros.{room}').glob(f'{name}*'))
            assert found
            for path in found:
                path.unlink()
        monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
        monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
        return SimClient(make_graph())

    return make


def children_of(process):
    """Return the numbers of the processes that compile for a node."""
    number = process.popen.pid
    tasks = Path(f'/proc/{number}/task').iterdir()
    return [int(pid) for task in tasks for pid in (task / 'children').read_text().split()]


def is_alive(number):
    """Return whether there is a process, which has not ended."""
    try:
        return Path(f'/proc/{number}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


def test_a_node_is_there_while_its_physics_is_compiled(start):
    sim = start(PLANAR)
    graph = sim.graph
    # The command comes too early, and is taken when there is physics.
    graph.until(lambda: sim.commands.get_subscription_count(), 'a reader of joint_command')
    sim.send({'joint_5_yaw': 0.3})
    waiting = sim.values()
    report, held = sim.diagnostics[-1].status[0], sim.joint_states[-1]
    refused = [sim.reset(), graph.call(Trigger, sim.service('step'))]
    request = GetParameters.Request(names=['publish_rate'])
    parameter = graph.call(GetParameters, sim.service('get_parameters'), request)
    paused = [graph.call(SetBool, sim.service('pause'), SetBool.Request(data=data))
              for data in (True, False)]  # fmt: skip
    assert not sim.process.count('physics ready'), 'the compiler was faster than the test'
    for answer in refused:
        assert not answer.success and answer.message.startswith('compiling, ')
    assert report.message.startswith('compiling, ') and report.level == b'\x01'
    assert waiting['steps'] == '0'
    assert 0 <= int(waiting['functions_compiled']) <= int(waiting['functions']) > 50
    assert parameter.values[0].double_value == 200.0
    assert all(answer.success for answer in paused)
    start_angles = joint_angles(initial_coordinates(load_scene('lateral_undulation')))
    assert nanoseconds(held) == 0
    assert list(held.position) == pytest.approx(start_angles.ravel().tolist(), abs=1e-15)
    assert not any(held.velocity)
    graph.until(
        lambda: abs(sim.joint_states[-1].position[8] - 0.3) < 0.05, 'the effect of the command'
    )
    assert sim.process.count('compiling the physics') == 1
    assert sim.process.stop() == 0


def test_a_service_is_there_when_it_can_answer(middleware, monkeypatch):
    early = []

    def load(node, level):
        early.extend(service.srv_name for service in node.services)

    monkeypatch.setattr(SimNode, '_load', load)
    node = SimNode()
    names = {service.srv_name for service in node.services}
    node.destroy_node()
    assert {'~/reset', '~/step', '~/pause', 'sim/get_parameters'} <= names
    assert not [name for name in early if not name.endswith('get_type_description')]


@pytest.mark.parametrize('signal', [2, 15])
def test_a_node_that_ends_ends_its_compiler(start, signal):
    sim = start(PLANAR)
    sim.graph.until(lambda: children_of(sim.process), 'a process that compiles')
    numbers = children_of(sim.process)
    assert sim.process.stop(signal) == 0
    assert not any(map(is_alive, numbers))
    assert 'Traceback' not in sim.process.output


def test_a_robot_waits_for_the_level_that_it_needs(start):
    sim = start(SPATIAL)
    sim.graph.until(lambda: sim.joint_states and sim.now > 0.1, 'a robot that moves in the plane')
    sim.publish(JointState(name=['joint_5_pitch'], position=[0.2]))
    sim.graph.until(
        lambda: abs(sim.joint_states[-1].position[9] - 0.2) < 0.05, 'a link that is lifted'
    )
    sim.graph.until(lambda: sim.process.count('compiled spatial level'), 'the end of the compiler')
    assert not sim.process.count('[ERROR]')
