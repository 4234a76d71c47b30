# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The commands topic, param and service, in processes of their own, against live nodes.

All processes but one are forked, see `forks`.
"""

import ctypes
import re
import signal
import sys
import time

from forks import command, Forked, run_command
from geometry_msgs.msg import Twist
from programs import Process, ROOT
import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
import yaml

from snake_sim_ros.nodes.graph import QUIET

COMMANDS = [sys.executable, '-m', 'snake_sim_ros.commands']
TWIST = 'geometry_msgs/msg/Twist'
SET_BOOL = 'std_srvs/srv/SetBool'


@pytest.fixture(scope='module')
def graph(make_graph):
    """Return a live robot."""
    graph = make_graph()
    graph.start('sim', 'publish_rate:=20.0')
    graph.start('gait', 'use_sim_time:=true', 'publish_rate:=20.0')
    clock = graph.record(Clock, '/clock')
    graph.until(lambda: clock, 'the clock')
    return graph


@pytest.fixture
def run_all(graph):
    """Return a function that runs commands beside each other: the lines of each."""

    def run_all(*commands, status=0):
        processes = [command(words, graph.domain) for words in commands]
        return [lines_of(graph, process, status) for process in processes]

    return run_all


@pytest.fixture
def run(run_all):
    """Return a function that runs a command to its end: its lines."""

    def run(*words, status=0):
        return run_all(words, status=status)[0]

    return run


def lines_of(graph, process, status=0):
    """Return the lines of a command once it has ended."""
    graph.until(lambda: process.popen.poll() is not None, process.name)
    assert process.wait() == status, process.output
    assert 'Traceback' not in process.output
    return process.lines


def started(graph, *words):
    """Start a command as a user does."""
    return Process([*COMMANDS, *words], graph.domain)


def run_in_background(*words):
    """Run a command that a script has started with &: it ignores SIGINT at first."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return run_command(*words)


# ---- what there is ------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def listed(graph):
    """Return the lines of all commands that list something: each looks around for some seconds."""
    commands = (
        'topic list -t', 'service list', 'service list --show-types', 'param list',
        'param list sim', 'param list /sim',
    )  # fmt: skip
    processes = {words: command(words.split(), graph.domain) for words in commands}
    return {words: lines_of(graph, process) for words, process in processes.items()}


def test_lists(listed):
    topics, services, every = list(listed.values())[:3]
    assert '/joint_states [sensor_msgs/msg/JointState]' in topics
    assert '/cmd_vel [geometry_msgs/msg/Twist]' in topics
    assert {'/sim/reset', '/gait/restart', '/sim/get_parameters'} <= {*services}
    assert f'/sim/pause [{SET_BOOL}]' in every
    assert not any('/_' in line for line in (*topics, *services))


def test_parameters_of_all_nodes(listed):
    lines, *own = list(listed.values())[3:]
    assert '/gait:' in lines and lines.index('/gait:') < lines.index('/sim:')
    of_sim = lines[lines.index('/sim:') + 1 :]
    assert '  friction.transversal' in of_sim and of_sim == sorted(of_sim)
    assert own == [of_sim, of_sim]


# ---- topics -------------------------------------------------------------------------------------


def test_echo(run_all):
    echo = ('topic', 'echo', '--once')
    lines, clock, robot = run_all(
        (*echo, '/joint_states'),
        (*echo, 'clock', 'rosgraph_msgs/Clock'),
        # Published before: only a reader with the profile of the publisher gets it.
        (*echo, '/robot_description'),
    )
    assert lines[:3] == ['header:', '  stamp:', '    sec: ' + lines[2].split()[-1]]
    assert lines[-1] == '---'
    message = yaml.safe_load('\n'.join(lines[:-1]))
    assert list(message) == ['header', 'name', 'position', 'velocity', 'effort']
    assert message['name'][:2] == ['joint_1_yaw', 'joint_1_pitch']
    assert len(message['position']) == 20
    assert [line.split()[0] for line in clock] == ['clock:', 'sec:', 'nanosec:', '---']
    assert yaml.safe_load('\n'.join(robot[:-1]))['data'].endswith('</robot>')


def test_echo_hears_all_who_publish(graph):
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    both = [graph.node.create_publisher(String, '/words', qos) for qos in (best_effort, latched)]
    process = command(['topic', 'echo', '/words', 'std_msgs/msg/String'], graph.domain)

    def heard():
        for publisher, word in zip(both, ('one', 'two'), strict=True):
            publisher.publish(String(data=word))
        return process.count('data: one') and process.count('data: two')

    graph.until(heard, 'both')
    assert process.stop(signal.SIGINT) == 130


def test_hz(graph):
    process = command(['topic', 'hz', '/joint_states'], graph.domain)
    process.wait_for('std dev', 60)
    assert process.stop(signal.SIGINT) == 130
    line, details = process.lines[:2]
    assert re.fullmatch(r'average rate: \d+\.\d{3}', line)
    assert re.fullmatch(
        r'\tmin: \d\.\d{3}s max: \d\.\d{3}s std dev: \d\.\d{5}s window: \d+', details
    )
    assert 'Traceback' not in process.output


def test_pub(run, graph):
    twists = graph.record(Twist, '/cmd_vel')
    values = '{linear: {x: 1, y: 1e-2}, angular: {z: 0.1}}'
    lines = run('topic', 'pub', '-1', '/cmd_vel', TWIST, values, '-w', '2')
    graph.until(lambda: twists, 'the message')
    assert (twists[0].linear.x, twists[0].linear.y, twists[0].angular.z) == (1.0, 0.01, 0.1)
    assert 'publisher: beginning loop' in lines and lines[-2].startswith('publishing #1: geometry')
    process = command(['topic', 'pub', '-r', '20', '/cmd_vel', TWIST], graph.domain)
    graph.until(lambda: len(twists) > 5, 'some more')
    assert process.stop(signal.SIGINT) == 130
    assert twists[-1] == Twist()
    graph.drain(twists)
    begin = len(twists)
    run('topic', 'pub', '-t', '3', '-r', '50', '-w', '2', '/cmd_vel', TWIST)
    graph.until(lambda: len(twists) == begin + 3, 'three')


# ---- parameters and services --------------------------------------------------------------------


def test_parameters_are_read_and_written(run, run_all):
    name = ('/sim', 'friction.transversal')
    assert run('param', 'set', *name, '0.25') == ['Set parameter successful']
    number, truth, scene, described, dumped = run_all(
        ('param', 'get', *name),
        ('param', 'get', 'sim', 'publish_clock'),
        ('param', 'set', 'gait', 'scene', 'sidewinding'),
        ('param', 'describe', *name, 'scene'),
        ('param', 'dump', '/sim'),
    )
    assert (number, truth) == (['Double value is: 0.25'], ['Boolean value is: True'])
    assert scene == ['Set parameter successful']
    assert described[:2] == ['Parameter name: friction.transversal', '  Type: double']
    assert described[2].startswith('  Description: ') and '    Min value: 0.0' in described
    assert described[-2:] == ['  Constraints:', '    Read only: true']
    tree = yaml.safe_load('\n'.join(dumped))
    assert tree['/sim']['ros__parameters']['friction']['transversal'] == 0.25
    (refusal,), (unknown,) = run_all(
        ('param', 'set', *name, '--', '-1.0'), ('param', 'describe', '/sim', 'nothing'), status=1
    )
    assert refusal.startswith('Setting parameter failed: ') and 'friction.transversal' in refusal
    assert 'Parameter not set: /sim has no parameter nothing' in unknown


def test_a_line_of_the_page_blends_gaits(run):
    page = (ROOT / 'docs/controllers.md').read_text(encoding='utf-8')
    (line,) = re.findall('^ros2 (param set /gait scene .+)$', page, re.MULTILINE)
    words = line.split()
    assert run(*words) == ['Set parameter successful']
    assert run('param', 'get', *words[2:4]) == [f'String value is: {words[4]}']


def test_call(graph, run):
    for data, message in ((True, 'paused'), (False, 'running')):
        values = f'{{data: {str(data).lower()}}}'
        words = ['service', 'call', '/sim/pause', SET_BOOL, values]
        process = started(graph, *words) if data else command(words, graph.domain)
        lines = lines_of(graph, process)
        request, _, head, response = [line for line in lines if 'waiting' not in line][:4]
        assert request == f'requester: making request: std_srvs.srv.SetBool_Request(data={data})'
        assert head == 'response:'
        name = 'std_srvs.srv.SetBool_Response'
        assert response == f"{name}(success=True, message='{message}')"
    assert 'success=True' in run('service', 'call', 'sim/reset', 'std_srvs/Trigger')[-2]


# ---- what cannot be done ------------------------------------------------------------------------


CANNOT_BE_DONE = [
    ('topic echo /nothing', 'nobody publishes /nothing or listens to it, so its type is unknown'),
    ('topic echo //', 'Invalid topic name: '),
    (f'topic pub -1 /cmd_vel {TWIST} {{', 'not readable as YAML: '),
    (
        f'topic pub -1 /odom {TWIST}',
        'for subscribers: expected 1 of type geometry_msgs/msg/Twist',
    ),
    ('param get /nobody x', 'Node not found: /nobody; the nodes that run: /client'),
    ('param get /sim x', 'Parameter not set: /sim has no parameter x'),
    ('param set /sim level {a:1,b}', 'a parameter must be true, false, a text, a list or a'),
    ('service call /sim/puase std_srvs/srv/Trigger', 'there is no service /sim/puase of type std'),
    ('service call /sim/pause std_srvs/srv/Trigger', 'there is no service /sim/pause of type std'),
]


def test_what_cannot_be_done_is_one_sentence(run_all):
    outputs = run_all(
        *((*words.split(), '--spin-time', '2') for words, _ in CANNOT_BE_DONE), status=1
    )
    for (*rest, last), (_, sentence) in zip(outputs, CANNOT_BE_DONE, strict=True):
        assert sentence in last
        assert all(line.lower().startswith('waiting') for line in rest)


def test_echo_hears_who_publishes_later(graph):
    words = ['topic', 'echo', '--once', '/later', 'std_msgs/msg/String', '--spin-time', '0.1']
    process = command(words, graph.domain)
    names = graph.node.get_node_names
    graph.until(lambda: f'_snake_sim_{process.popen.pid}' in names(), 'the command')
    time.sleep(0.1 + 1.5 * QUIET)  # it has waited for somebody who publishes already
    publisher = graph.node.create_publisher(String, '/later', 10)

    def heard():
        publisher.publish(String(data='at last'))
        return process.count('at last')

    graph.until(heard, 'the message')
    assert process.wait() == 0


def test_signals_end_what_a_script_started(graph):
    kinds = [
        (words, number)
        for words in ('topic echo /clock', 'topic pub -r 5 /words std_msgs/msg/String')
        for number in (signal.SIGINT, signal.SIGTERM)
    ]
    processes = [
        Forked(run_in_background, *words.split(), domain=graph.domain) for words, _ in kinds
    ]
    for process, (words, number) in zip(processes, kinds, strict=True):
        process.wait_for('---' if 'echo' in words else 'publishing', 60)
        assert process.stop(number) == 130
        assert 'Traceback' not in process.output


# The last ones: processes that do not leave the graph delay how others find each other.


def hang_with_the_lock_of_the_interpreter(*_):
    while True:
        ctypes.PyDLL(None).sleep(60)


def run_hanging(*words):
    """Run a command whose node cannot be destroyed."""
    Node.destroy_node = hang_with_the_lock_of_the_interpreter
    return run_command(*words)


def test_a_command_whose_middleware_hangs_ends_with_its_own_status(graph):
    words = ('topic', 'pub', '-1', '-w', '0', '/x', TWIST)
    started = []
    for values, status, said in (('{}', 0, 'publishing #1'), ('{', 1, 'not readable')):
        process = Forked(run_hanging, *words, values, domain=graph.domain)
        process.wait_for(said)
        started.append((process, status, time.monotonic()))
    for process, status, begin in started:
        assert process.wait() == status, process.output
        assert 1.0 < time.monotonic() - begin < 3.0 and 'Traceback' not in process.output
