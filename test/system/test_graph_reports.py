# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a sim node says of the graph around it and of the commands it gets, to real publishers."""

import math
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
from forks import Forked
import numpy as np
from offline import HORIZON
import pytest
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from sim_client import connected, SimClient, with_twin
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from snake_sim_ros import Robot
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.received_commands import joint_trajectory
from snake_sim_ros.scene.parameters import load_scene

RATE = 'publish_rate:=50.0'  # few messages of the robots that run
REMEMBERED = 1.0  # s for which the running sim has a refusal in its diagnostics, else 10 s
NAMES = list(Robot().axis_names)
SCENE = load_scene('lateral_undulation')


def talk(name):
    """Publish a command for joint 1, once told to, until this process is killed."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])  # in all threads
    rclpy.init()
    node = Node(name)
    signal.sigwait([signal.SIGUSR1])
    publisher = node.create_publisher(JointState, 'joint_command', 1)
    while True:
        publisher.publish(JointState(name=['joint_1_yaw'], position=[0.0]))
        if publisher.get_subscription_count():
            print('heard', flush=True)
        time.sleep(0.02)


@pytest.fixture(scope='module')
def sims(make_graph):
    """A sim that runs, and one in lock-step."""
    constants = {'executors.REMEMBERED': REMEMBERED}
    return connected(
        SimClient(make_graph(), RATE, constants=constants),
        SimClient(make_graph(), 'start_paused:=true'),
    )


@pytest.fixture(scope='module')
def running(sims):
    return sims[0]


@pytest.fixture(scope='module')
def published(running):
    """
    Return a function: the diagnostics so far, each with the wall time of its publication [ns].

    That of the executor of the graph would not be told.
    """
    graph, found = running.graph, []
    node = Node('listener', context=graph.context)
    node.create_subscription(
        DiagnosticArray,
        '/diagnostics',
        lambda message, info: found.append((info['source_timestamp'], message)),
        1000,
    )
    executor = SingleThreadedExecutor(context=graph.context)
    executor.add_node(node)

    def serve():
        count = -1
        while len(found) > count:
            count = len(found)
            executor.spin_once(timeout_sec=0)
        return found

    graph.until(serve, 'diagnostics')
    yield serve
    executor.shutdown()
    node.destroy_node()


@pytest.fixture(scope='module')
def refused(running, published):
    """Have the running sim refuse a command, which is told for a while; return the reason."""
    publish(running, trajectory((1.0, [math.nan])))
    said = (
        'joint_trajectory: position of joint_1_yaw must be finite, got nan; '
        'the last good command is held'
    )
    running.graph.until(
        lambda: any(said in item.status[0].message for item in running.diagnostics), said
    )
    return said


@pytest.fixture
def talkers(running):
    """Return three processes that are in the graph, and publish joint_command at a signal."""
    names = ['first', 'second', 'third']
    processes = [Forked(talk, name, domain=running.graph.domain) for name in names]
    node = running.graph.node
    running.graph.until(lambda: {*names} <= {*node.get_node_names()}, 'their names')
    yield processes
    for process in processes:
        process.kill()


def begin(process):
    """Let one of these publish."""
    process.popen.send_signal(signal.SIGUSR1)
    process.wait_for('heard')


def listed(sim):
    """Return the names of all publishers of joint_command in the graph."""
    infos = sim.graph.node.get_publishers_info_by_topic('/joint_command')
    return sorted(info.node_name for info in infos)


def wait_for_looks(sim, count):
    """Wait for some diagnostics: after each the node looks at the graph."""
    begin = len(sim.diagnostics)
    sim.graph.until(lambda: len(sim.diagnostics) >= begin + count, f'{count} diagnostics')


def trajectory(*points, names=NAMES[:1], stamp=0.0):
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = stamp_from(round(1e9 * stamp))
    for seconds, positions in points:
        point = JointTrajectoryPoint(positions=positions)
        point.time_from_start = Duration(seconds=seconds).to_msg()
        message.points.append(point)
    return message


def publish(sim, message):
    node = sim.graph.node
    publisher = node.create_publisher(JointTrajectory, 'joint_trajectory', QoSProfile(depth=1))
    sim.graph.until(publisher.get_subscription_count, 'a reader of joint_trajectory')
    publisher.publish(message)
    assert publisher.wait_for_all_acked(Duration(seconds=10))
    node.destroy_publisher(publisher)


def waves(count):
    """Return a slow trajectory of all joints with many points."""
    angles = 0.3 * np.sin(np.arange(1, count + 1)[:, None] * 1e-3 + np.arange(20))
    start = 0.3 * np.sin(np.arange(20))
    return trajectory(
        (2.0, start.tolist()),
        *((2.0 + 0.01 * (k + 1), row.tolist()) for k, row in enumerate(angles)),
        names=NAMES,
    )


# The tests of the running sim need this order: the first one wants no other publishers.


def test_publishers_that_were_killed_are_not_rivals(running, refused, talkers):
    running.graph.node.destroy_publisher(running.commands)
    first, second, third = talkers
    begin(first)
    running.graph.until(lambda: listed(running) == ['first'], 'it in the graph')
    wait_for_looks(running, 2)
    first.kill()  # The graph still has it, for 20 s.
    begin(second)
    running.graph.until(lambda: listed(running) == ['first', 'second'], 'both in the graph')
    wait_for_looks(running, 4)
    assert not running.process.count('publishers'), running.process.output
    # A third one lives, and is named with all that the graph has.
    begin(third)
    said = '/joint_command has 3 publishers, /first, /second, /third: the last message counts'
    running.graph.until(lambda: running.process.count(said), said)
    wait_for_looks(running, 2)
    # Its first message may come before the graph has it: then the two others are named before.
    assert running.process.count(said) == 1 >= running.process.count(' 2 publishers')


def test_two_clocks_are_told(make_graph):
    sims = [SimClient(make_graph(), '-r __ns:=/one', RATE, namespace='one')]
    sims[0].wait_until_connected()
    other = sims[0].graph.start('sim', '-r __ns:=/two', RATE)
    said = '/clock has 2 publishers, /one/sim, /two/sim: start all sims but one with publish_clock'
    for process in (sims[0].process, other):
        sims[0].graph.until(lambda process=process: process.count(said), said)
    for process in (sims[0].process, other):
        sims[0].graph.end(process)


def test_refusal_is_in_the_diagnostics_for_some_time(running, refused, published):
    running.graph.until(
        lambda: refused not in published()[-1][1].status[0].message, 'the end of the refusal'
    )
    found = published()
    told = [refused in message.status[0].message for _, message in found]
    first, end = told.index(True), told.index(False, told.index(True))
    levels = {message.status[0].level for _, message in found[first:end]}
    assert levels == {b'\x01'}
    # It was refused after the message before the first one, on a host however slow.
    times = [1e-9 * time for time, _ in found]
    assert times[end - 1] - times[first] < REMEMBERED < times[end] - times[first - 1]
    assert running.process.count(refused) == 1


def test_trajectory_that_would_hold_up_a_period_is_refused_unread(running):
    angle = running.joint_states[-1].position[0]
    publish(running, waves(10_000))
    said = 'joint_trajectory: a message of 1840576 bytes takes too long to read; at most 100000'
    running.graph.until(lambda: running.process.count(said), said)
    assert running.joint_states[-1].position[0] == pytest.approx(angle, abs=0.01)


def test_stamp_of_the_wall_clock_means_now(running):
    publish(running, trajectory((0.5, [0.4]), stamp=1.8e9))
    running.graph.until(
        lambda: abs(running.joint_states[-1].position[0] - 0.4) < 0.05, 'the end of the motion', 10
    )


@pytest.mark.parametrize('node', ['sim', 'gait', 'follow', 'viewer'])
def test_parameter_that_there_is_not_is_named(running, make_graph, node):
    graph = running.graph if node == 'sim' else make_graph()
    if node == 'viewer':
        pytest.importorskip('viser')
    if node != 'sim':
        graph.start(node, *(['port:=0'] if node == 'viewer' else []))
    items = [Parameter(name, value=1.0).to_parameter_msg() for name in ('no_such', 'scenes')]
    request = SetParameters.Request(parameters=items)
    results = graph.call(SetParameters, f'{node}/set_parameters', request).results
    assert not any(result.successful for result in results)
    assert results[0].reason.startswith("unknown parameter 'no_such'; ")
    assert results[1].reason == "unknown parameter 'scenes'; did you mean 'scene'?"


# ---- in lock-step -------------------------------------------------------------------------------


@pytest.fixture
def lockstep(sims):
    return with_twin(sims[1], SCENE)


def test_command_that_jumps_is_told_and_a_stream_is_not(lockstep):
    sim, twin = lockstep
    start = float(twin.reference.angle[4, 0])
    for k in range(20):  # 8 rad/s
        sim.send({'joint_5_yaw': start - 0.04 * k})
        sim.step()
    assert not sim.process.count('jumps'), sim.process.output
    reached = start - 0.04 * 19
    for angle in (reached + 0.5, reached):
        sim.send({'joint_5_yaw': angle})
        sim.step()
    said = (
        f'joint_command: joint_5_yaw jumps from {reached:.4g} rad to {reached + 0.5:.4g} rad; '
        f'100 rad/s would be needed, at most 10 rad/s; it is led there at that rate'
    )
    sim.process.wait_for(said)
    assert sim.process.count('jumps') == 1, sim.process.output


def test_large_trajectory_is_taken_before_the_next_step(lockstep):
    sim, twin = lockstep
    message = waves(450)
    publish(sim, message)
    robot, now = twin.simulation.scene.robot, twin.simulation.time
    twin.reference = joint_trajectory(message, twin.reference, robot, now, HORIZON).reference
    for _ in range(5):
        joint_states, *_ = sim.step()
        sample = twin.advance()
        assert joint_states.position.tobytes() == sample.angle.tobytes()
    # A command that comes right after a large one counts, as the last one.
    publish(sim, waves(450))
    sim.send({'joint_9_yaw': 0.3})
    for _ in range(100):
        joint_states, *_ = sim.step()
    assert joint_states.position[16] == pytest.approx(0.3, abs=0.05)
