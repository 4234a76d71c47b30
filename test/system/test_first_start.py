# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A node whose physics is not compiled yet is there, tells of the compiler, and can be ended.

The process that compiles for it finds that another one compiles the same, which is the test: it
has the code already, and hands it over when the node has done what it does meanwhile.
"""

from contextlib import suppress
import fcntl
import os
from pathlib import Path
import re
import shutil
import signal
from types import SimpleNamespace

from graph import Graph
from offline import nanoseconds
import pytest
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_srvs.srv import SetBool, Trigger
from test_readme import blocks, README
from test_tour import run, section

from snake_sim_ros.dynamics.code_cache import FOLDER
from snake_sim_ros.nodes.sim_node import look_at_compiler, REPORT_PERIOD, SimNode
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import initial_coordinates, joint_angles

RATE = 'publish_rate:=50.0'  # a quarter of the messages
PLANAR, SPATIAL = 'planar', 'spatial'
WAITING = re.compile(
    r'compiling, \d+ s so far: simulated time waits for the spatial level, since \w+'
)


@pytest.fixture
def start(tmp_path, monkeypatch):
    """
    Return a function that starts a sim where the loops of some levels are not compiled.

    They are compiled once its method `hand_over` is called with the level.
    """
    graphs, held = [], {}

    def make(*missing, parameters=()):
        folder = tmp_path / 'snake_sim_ros' / FOLDER.name
        # Other tests may be writing code there: a finished file gets the name of its function.
        ignored = shutil.ignore_patterns('tmp*', '*.lock')
        shutil.copytree(FOLDER, folder, ignore=ignored, copy_function=os.symlink)
        for level in missing:
            loops = (folder / 'snake_sim_ros.stepping').glob('steps.advance-*.code')
            is_planar = level == PLANAR  # the names of the types of a loop are in its code
            found = [path for path in loops if (b'PlanarModel' in path.read_bytes()) == is_planar]
            assert found
            held[level] = [hold(path) for path in found]
        monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
        monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
        graphs.append(Graph(is_forked=False))
        sim = SimClient(graphs[-1], *parameters)
        sim.hand_over = hand_over
        return sim

    def hand_over(level):
        for path, code, lock in held.pop(level):
            path.symlink_to(code)
            lock.close()

    yield make
    for graph in graphs:
        graph.close()
    for level in tuple(held):
        hand_over(level)


def hold(path):
    """Take a link to a file of code away, as if this process compiled it."""
    lock = path.with_suffix('.lock').open('wb')
    fcntl.flock(lock, fcntl.LOCK_EX)
    code = os.readlink(path)
    path.unlink()
    return path, code, lock


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


def test_a_node_that_ends_ends_its_compiler(start):
    sim = start(PLANAR)
    sim.graph.until(lambda: children_of(sim.process), 'a process that compiles')
    stops(sim.process, signal.SIGINT)


def test_a_robot_moves_until_it_needs_the_level_that_is_compiled(start):
    sim = start(SPATIAL, parameters=[RATE])
    sim.graph.until(lambda: sim.joint_states and sim.now > 0.1, 'a robot that moves in the plane')
    sim.publish(JointState(name=['joint_5_pitch'], position=[0.2]))
    sim.graph.until(lambda: is_told(sim), 'what it waits for')
    stops(sim.process, signal.SIGTERM)
    assert not sim.process.count('[ERROR]')


def stops(process, number):
    """Check that a node and what compiles for it end at a signal."""
    numbers = children_of(process)
    assert numbers
    assert process.stop(number) == 0
    assert not any(map(is_alive, numbers))
    assert 'Traceback' not in process.output


def is_told(sim):
    """Return whether the last diagnostics, if any, say for what simulated time waits."""
    return any(WAITING.match(item.status[0].message) for item in sim.diagnostics[-1:])


def test_a_wait_is_told_at_once_and_then_every_few_seconds():
    lines, compiler = [], SimpleNamespace(error=None, loaded=0, is_done=False, seconds=0.0)
    node = SimpleNamespace(
        get_logger=lambda: SimpleNamespace(info=lines.append),
        inbox=SimpleNamespace(is_open=True), compiling='',
    )  # fmt: skip
    told = 0.0
    for k in range(1000):
        compiler.seconds = 0.1 * k
        node.compiling = 'waits' if 60.0 <= compiler.seconds else ''
        told = look_at_compiler(node, compiler, told)
        if lines and lines[-1] == 'waits':
            lines[-1] = compiler.seconds
    assert lines == pytest.approx([60.0 + REPORT_PERIOD * k for k in range(8)], abs=0.1 * 8)


LINES = [
    line
    for block in blocks('sh', [section(README, '## Ten minutes with ROS 2')])
    for line in block.splitlines()
    if line.startswith('ros2 ')
]


def check_a_node_without_physics(sim):
    """Check what a node says and does while it compiles, and that it then takes a command."""
    graph = sim.graph
    # The command comes too early, and is taken when there is physics.
    graph.until(lambda: sim.commands.get_subscription_count(), 'a reader of joint_command')
    start_angles = joint_angles(initial_coordinates(load_scene('lateral_undulation')))
    # A change so small does not need the spatial level.
    sim.send({'joint_5_yaw': start_angles[4, 0] - 0.02})
    waiting = sim.values()
    graph.until(lambda: sim.joint_states, 'the posture that it holds')
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
    assert parameter.values[0].double_value == 50.0
    assert all(answer.success for answer in paused)
    assert nanoseconds(held) == 0
    assert list(held.position) == pytest.approx(start_angles.ravel().tolist(), abs=1e-15)
    assert not any(held.velocity)
    sim.hand_over(PLANAR)
    graph.until(lambda: sim.process.count('physics ready'), 'the planar level')
    assert sim.process.count('compiling the physics') == 1
    graph.until(
        lambda: sim.joint_states[-1].position[8] < start_angles[4, 0] - 0.005,
        'the effect of the command',
    )


def test_the_readme_in_its_order_where_no_level_is_compiled(start):
    first, echo, command, gait, *others = LINES
    assert first == 'ros2 run snake_sim_ros sim' and 'joint_5_yaw' in command
    sim = start(PLANAR, SPATIAL, parameters=[RATE])
    graph, process, nice = sim.graph, sim.process, set()

    def waits():
        """Look at the priorities of the compiler; return whether simulated time waits."""
        for child in children_of(process):
            with suppress(ProcessLookupError):
                nice.add(os.getpriority(os.PRIO_PROCESS, child))
        return is_told(sim)

    check_a_node_without_physics(sim)
    assert process.count('s: planar level; spatial level is still being compiled')
    assert 'position:' in run(graph, echo)
    assert not is_told(sim)
    run(graph, command)
    graph.until(waits, 'what it waits for')
    # Those who compile have the priority of the node, which may wait for them.
    assert nice == {os.getpriority(os.PRIO_PROCESS, process.popen.pid)}
    graph.drain(sim.joint_states)
    stood = sim.now
    sim.hand_over(SPATIAL)
    graph.until(lambda: sim.now > stood, 'the spatial level')
    process.wait_for('compiled planar, spatial level')
    assert re.search(rf'\[sim\]: {WAITING.pattern}', process.output)
    graph.until(lambda: abs(sim.joint_states[-1].position[8] - 0.5) < 0.05, 'the joint')
    sim.publish(JointState(name=['joint_5_pitch'], position=[0.2]))
    graph.until(
        lambda: abs(sim.joint_states[-1].position[9] - 0.2) < 0.05, 'a link that is lifted'
    )
    graph.start('gait', gait.split()[-1], RATE).wait_for('the gait begins')
    for line in others:
        assert run(graph, line)
    assert 'Traceback' not in process.output and not process.count('[ERROR]')
