# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node whose physics is not compiled yet is there, tells of the compiler, and can be ended."""

import os
from pathlib import Path
import re
import shutil
import time
from types import SimpleNamespace

from graph import START_TIMEOUT
import numpy as np
from offline import nanoseconds
import pytest
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_srvs.srv import SetBool, Trigger
from test_readme import blocks, README
from test_tour import run, section

from snake_sim_ros import Scene
from snake_sim_ros.dynamics.code_cache import FOLDER
from snake_sim_ros.nodes.compiling import Compiler
from snake_sim_ros.nodes.sim_node import look_at_compiler, REPORT_PERIOD, SimNode
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import initial_coordinates, joint_angles

pytestmark = pytest.mark.long

WHOLE_CACHE = 300.0  # s for a level to be compiled on a busy machine
PLANAR, SPATIAL = 'stepping.planar/moreau.advance_in_plane', 'stepping/moreau.advance_moreau-'


@pytest.fixture
def start(make_graph, tmp_path, monkeypatch):
    """Return a function that starts a sim where the loop of a level is not compiled."""

    def make(*missing):
        folder = tmp_path / 'snake_sim_ros' / FOLDER.name
        # Other tests may be writing code there: numba renames a finished file from .tmp.
        shutil.copytree(FOLDER, folder, ignore=shutil.ignore_patterns('*.tmp.*'))
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


def test_the_compiler_of_a_node_that_runs_has_its_priority(start):
    sim = start(PLANAR, SPATIAL)
    sim.process.wait_for('physics ready', START_TIMEOUT)
    graph = sim.graph
    graph.until(lambda: children_of(sim.process), 'a process that compiles the other level')
    for _ in range(10):  # It may have to start first.
        nice = {os.getpriority(os.PRIO_PROCESS, child) for child in children_of(sim.process)}
        assert nice <= {os.getpriority(os.PRIO_PROCESS, sim.process.popen.pid)}
        graph.spin(0.1)


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


def test_the_rest_of_the_time_is_in_proportion(monkeypatch):
    compiler = Compiler(Scene(), lambda level: None, ('planar', 'spatial'))
    monkeypatch.setattr(Compiler, 'seconds', 30.0)
    compiler.needed = 1
    assert str(compiler) == 'compiling, 30 s so far'
    compiler.functions = compiler.most[0] // 2
    assert str(compiler).startswith('compiling, 30 s so far, about 30 s left')
    # The spatial level takes half as long again, of which nothing is done.
    compiler.loaded, compiler._before, compiler.needed = 1, compiler.functions, 2
    assert str(compiler) == 'compiling, 30 s so far, about 45 s left'
    assert compiler.outlook == 'planar level; spatial level in about 45 s'
    compiler.functions += compiler.most[1]
    assert str(compiler) == 'compiling, 30 s so far, about 0 s left'


LINES = [
    line
    for block in blocks('sh', [section(README, '## Ten minutes with ROS 2')])
    for line in block.splitlines()
    if line.startswith('ros2 ')
]


def test_the_readme_in_its_order_where_no_level_is_compiled(start):
    first, echo, command, gait, *others = LINES
    assert first == 'ros2 run snake_sim_ros sim' and 'joint_5_yaw' in command
    sim = start(PLANAR, SPATIAL)
    graph, process = sim.graph, sim.process
    graph.until(lambda: process.count('physics ready'), 'the planar level', WHOLE_CACHE)
    ready = time.monotonic()
    said = re.search(
        r'physics ready after \S+ s: planar level; spatial level in about (\d+) s', process.output
    )
    assert said, process.output
    assert 'position:' in run(graph, echo)
    run(graph, command)
    graph.until(lambda: 'waits' in sim.diagnostics[-1].status[0].message, 'what it waits for')
    waiting = r'compiling, \d+ s so far.*: simulated time waits for the spatial level, since \w+'
    assert re.match(waiting, sim.diagnostics[-1].status[0].message)
    graph.drain(sim.joint_states)
    stood = sim.now
    graph.until(lambda: sim.now > stood, 'the spatial level', WHOLE_CACHE)
    assert 1 / 3 < (time.monotonic() - ready) / float(said[1]) < 3.0
    told = re.findall(rf'\[(\S+)\] \[sim\]: {waiting}', process.output)
    assert told and (np.diff([float(seconds) for seconds in told]) > REPORT_PERIOD - 0.5).all()
    graph.until(lambda: abs(sim.joint_states[-1].position[8] - 0.5) < 0.05, 'the joint')
    graph.start('gait', gait.split()[-1]).wait_for('the gait begins')
    for line in others:
        assert run(graph, line)
    assert 'Traceback' not in process.output
