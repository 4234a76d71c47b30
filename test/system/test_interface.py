# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands, parameters and topics of a sim node, as other programs use them."""

import signal
import time

from builtin_interfaces.msg import Time
import numpy as np
from offline import bits, HORIZON, NAMES, nanoseconds
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParametersAtomically
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from sim_client import connected, SimClient, with_twin
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import MarkerArray

from snake_sim_ros.nodes.received_commands import joint_trajectory, position_commands
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.robot_description import robot_description

RATE = 'publish_rate:=50.0'  # few messages of the robot that runs
SCENE = load_scene('lateral_undulation')
LIMIT = SCENE.robot.joint_limit
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SENSOR_DATA = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture(scope='module')
def started(make_graph):
    """A sim in lock-step, and one that runs as the robot aiko."""
    flooded = make_graph(takes_all=False)
    return connected(
        SimClient(make_graph(), 'start_paused:=true', 'command_timeout:=0.2'),
        SimClient(flooded, '-r __ns:=/aiko', RATE, 'publish_clock:=false', namespace='aiko'),
    )


@pytest.fixture
def lockstep(started):
    """The sim in lock-step at its start, and its offline twin at the same time."""
    return with_twin(started[0], SCENE)


@pytest.fixture(scope='module')
def aiko(started):
    return started[1]


@pytest.fixture(scope='module')
def publish(started):
    """Return a function that publishes to a topic of the lock-step sim, acknowledged."""
    node, publishers = started[0].graph.node, {}

    def send(topic, message):
        if topic not in publishers:
            publisher = node.create_publisher(type(message), topic, QoSProfile(depth=1))
            started[0].graph.until(publisher.get_subscription_count, f'a reader of {topic}')
            publishers[topic] = publisher
        publishers[topic].publish(message)
        assert publishers[topic].wait_for_all_acked(Duration(seconds=10))

    return send


def trajectory(names, *points):
    message = JointTrajectory(joint_names=names)
    for seconds, positions, *velocities in points:
        point = JointTrajectoryPoint(positions=positions)
        point.velocities = velocities[0] if velocities else []
        point.time_from_start = Duration(seconds=seconds).to_msg()
        message.points.append(point)
    return message


def take(twin, function, message, *more):
    robot, now = twin.simulation.scene.robot, twin.simulation.time
    twin.reference = function(message, twin.reference, robot, now, *more).reference


def assert_same_steps(sim, twin, periods):
    for _ in range(periods):
        joint_states, *_ = sim.step()
        sample = twin.advance()
        expected = (sample.angle, sample.rate, sample.torque)
        assert bits(joint_states) == b''.join(part.tobytes() for part in expected)
    return joint_states


# ---- commands -----------------------------------------------------------------------------------


def test_trajectory_moves_joints_as_offline_and_is_replaced(lockstep, publish):
    sim, twin = lockstep
    first = trajectory(
        ['joint_2_yaw', 'joint_9_yaw'],
        (0.1, [-0.2, -0.1], [1.0, 0.0]),
        (0.2, [-0.1, -0.3], [0.0, 0.0]),
    )
    second = trajectory(['joint_9_yaw'], (0.12, [0.2]))
    publish('joint_trajectory', first)
    take(twin, joint_trajectory, first, HORIZON)
    assert_same_steps(sim, twin, 16)
    publish('joint_trajectory', second)
    take(twin, joint_trajectory, second, HORIZON)
    assert_same_steps(sim, twin, 24)
    assert twin.reference.settled(twin.simulation.time).angle[[1, 8], 0] == pytest.approx(
        [-0.1, 0.2]
    )


def test_position_commands_are_taken_as_offline(lockstep, publish):
    sim, twin = lockstep
    message = Float64MultiArray(data=np.linspace(-0.3, 0.3, 20) * np.tile([1, 0], 10))
    publish('position_commands', message)
    take(twin, position_commands, message)
    assert_same_steps(sim, twin, 5)
    rejected = int(sim.values()['rejected_commands'])
    publish('position_commands', Float64MultiArray(data=[0.0] * 3))
    sim.process.wait_for('position_commands must have 20 numbers')
    sim.wait_for_value('rejected_commands', str(rejected + 1))
    assert_same_steps(sim, twin, 5)


def test_reset_while_a_trajectory_runs_is_clean(lockstep, publish):
    sim, twin = lockstep
    publish('joint_trajectory', trajectory(NAMES[:2], (1.0, [0.5, 0.5])))
    before = sim.now
    for _ in range(4):
        sim.step()
    response = sim.reset()
    assert response.success
    # Time went on, all else is as at the start; nothing of the trajectory is left.
    assert sim.now == pytest.approx(before + 4 / 200, abs=1e-9)
    twin.simulation.step_count += 4 * 20
    twin.reference.stamp[:] = sim.now
    assert_same_steps(sim, twin, 5)


def test_position_beyond_the_limit_is_clamped_and_said_once(lockstep):
    sim, twin = lockstep
    sim.send({'joint_4_yaw': -0.9})
    twin.command({'joint_4_yaw': -LIMIT})
    assert_same_steps(sim, twin, 2)
    said = 'position of joint_4_yaw is clamped to the joint limit, +-0.7854 rad; got -0.9 rad'
    sim.send({'joint_4_yaw': -0.9})
    sim.process.wait_for(said)
    sim.wait_for_value('clamped_commands', '2')
    assert sim.process.count(said) == 1


def test_stream_of_commands_that_stops_is_reported(lockstep):
    sim, _ = lockstep
    for k in range(3):  # 50 ms apart, and 0.2 s is the timeout
        sim.send({'joint_1_yaw': 0.01 * k}, {'joint_1_yaw': 0.2})
        for _ in range(10):
            sim.step()
    said = 'no joint_command for 0.2 s; the last one is held'
    for _ in range(29):
        sim.step()
    assert not sim.process.count(said)
    for _ in range(3):
        joint_states = sim.step()[0]
    sim.process.wait_for(said)
    # What was refused in the last 10 s may stand before it.
    sim.wait_for_value('state', 'paused')
    silence = 'no joint_command any more; the last one is held'
    assert sim.diagnostics[-1].status[0].message.endswith(silence)
    assert sim.diagnostics[-1].status[0].level == b'\x01'
    # The joints hold the angle to which the last command was extrapolated, without a rate.
    assert abs(joint_states.velocity[0]) < 1e-2
    sim.send({'joint_1_yaw': 0.0})
    sim.step()
    sim.values()
    assert 'any more' not in sim.diagnostics[-1].status[0].message
    assert sim.process.count(said) == 1


def test_one_command_is_not_a_stream_and_a_reset_ends_one(lockstep):
    sim, _ = lockstep
    before = sim.process.count('no joint_command for')
    sim.send({'joint_1_yaw': 0.1})
    for _ in range(60):
        sim.step()
    for _ in range(3):
        sim.send({'joint_1_yaw': 0.2})
        sim.step()
    sim.reset()
    for _ in range(60):
        sim.step()
    assert sim.process.count('no joint_command for') == before


def test_diagnostics_tell_what_was_refused(lockstep):
    sim, _ = lockstep
    sim.send({'joint_1_jaw': 0.1})
    sim.step()
    said = (
        "joint_command: unknown joint 'joint_1_jaw'; did you mean joint_1_yaw?; "
        'the last good command is held'
    )
    sim.graph.until(
        lambda: any(
            (item.status[0].message, item.status[0].level) == (said, b'\x01')
            for item in sim.diagnostics
        ),
        'the refusal in /diagnostics',
        10,
    )


def test_stamps_mean_now_where_the_clock_is_of_another_node(aiko):
    graph, before = aiko.graph, aiko.process.count('is late')
    aiko.send({'joint_2_yaw': 0.3})
    graph.until(lambda: abs(aiko.joint_states[-1].position[2] - 0.3) < 0.1, 'the first command')
    aiko.send({'joint_2_yaw': -0.3}, stamp=Time(nanosec=1))
    graph.until(lambda: abs(aiko.joint_states[-1].position[2] + 0.3) < 0.1, 'the other command')
    assert aiko.process.count('is late') == before


def looks_again(sim, publish):
    """Publish until the node has looked at the graph again: it does with its diagnostics."""
    told = len(sim.diagnostics)
    sim.graph.until(lambda: publish() or len(sim.diagnostics) > told + 1, 'diagnostics')


def test_other_publishers_are_told_once_with_their_names(aiko):
    graph = aiko.graph
    topic = '/aiko/joint_command'
    other_publisher = graph.node.create_publisher(JointState, topic, QoSProfile(depth=1))
    graph.until(other_publisher.get_subscription_count, 'the sim')
    client = graph.node.get_fully_qualified_name()
    said = f'{topic} has 2 publishers, {client}, {client}: the last message counts'

    def publish():
        for angle, publisher in ((0.1, aiko.commands), (-0.1, other_publisher)):
            publisher.publish(JointState(name=['joint_1_yaw'], position=[angle]))
        graph.spin(0.02)

    graph.until(lambda: publish() or aiko.process.count(said), said, 20)
    looks_again(aiko, publish)
    graph.node.destroy_publisher(other_publisher)
    assert aiko.process.count(said) == 1
    assert aiko.process.count('publishers') == 1


def test_other_publishers_on_two_topics_are_told(aiko):
    graph = aiko.graph
    other = Node('other', context=graph.context)
    other_publisher = other.create_publisher(Float64MultiArray, '/aiko/position_commands', 1)
    graph.until(other_publisher.get_subscription_count, 'the sim')
    said = (
        '/aiko/joint_command and /aiko/position_commands have 2 publishers, '
        f'{graph.node.get_fully_qualified_name()}, /other: the last message counts'
    )

    def publish():
        aiko.send({'joint_1_yaw': 0.1})
        other_publisher.publish(Float64MultiArray(data=[0.0] * 20))
        graph.spin(0.02)

    graph.until(lambda: publish() or aiko.process.count(said), said, 20)
    looks_again(aiko, publish)
    other.destroy_node()
    assert aiko.process.count(said) == 1, aiko.process.output


def test_flood_of_commands_does_not_starve_physics(aiko):
    graph = aiko.graph
    graph.until(lambda: len(aiko.joint_states) > 10, 'a running sim')
    begin, end = aiko.now, time.monotonic() + 1.0
    messages = 0
    while time.monotonic() < end:
        for _ in range(50):
            aiko.commands.publish(JointState(name=['joint_9_jaw'], position=[0.1]))
        messages += 50
        graph.spin(0.002)
    graph.until(lambda: aiko.now > begin + 0.7, 'physics that goes on', 20)
    assert messages > 1000
    assert 1 <= aiko.process.count("unknown joint 'joint_9_jaw'") <= 5


@pytest.mark.parametrize('factor', [0.0, 1000.0])  # as fast as possible, and always late
def test_flood_of_commands_does_not_starve_services(aiko, factor):
    graph = aiko.graph
    assert set_parameters(aiko, real_time_factor=factor).successful
    reset = graph.node.create_client(Trigger, '/aiko/sim/reset')
    graph.until(reset.service_is_ready, 'the service')
    begin, answer = time.monotonic(), None
    while answer is None or not answer.done():
        aiko.send({'joint_9_yaw': 0.1})
        graph.executor.spin_once(timeout_sec=0)
        if answer is None and time.monotonic() - begin > 0.5:
            answer = reset.call_async(Trigger.Request())
        assert time.monotonic() - begin < 4.5, 'no answer in 4 s'
    count = len(aiko.joint_states)
    graph.until(lambda: len(aiko.joint_states) > count + 20, 'physics that goes on')
    assert set_parameters(aiko, real_time_factor=1.0).successful


# ---- parameters ---------------------------------------------------------------------------------


def set_parameters(sim, **values):
    """Set parameters at once, with __ for a dot; return the result."""
    parameters = [
        Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
    assert all(isinstance(item, ParameterMessage) for item in parameters)
    request = SetParametersAtomically.Request(parameters=parameters)
    return sim.graph.call(
        SetParametersAtomically, sim.service('set_parameters_atomically'), request
    ).result


def test_friction_and_gains_change_while_running_as_offline(lockstep):
    sim, twin = lockstep
    sim.send({'joint_5_yaw': 0.6})
    twin.command({'joint_5_yaw': 0.6})
    assert_same_steps(sim, twin, 5)
    changes = {'friction__transversal': 0.05, 'robot__yaw_stiffness': [30.0] * 10}
    result = set_parameters(sim, **changes)
    assert result.successful, result.reason
    named = {name.replace('__', '.'): value for name, value in changes.items()}
    twin.simulation.change(with_settings(twin.simulation.scene, named))
    assert_same_steps(sim, twin, 10)
    names = ['friction.transversal', 'robot.yaw_stiffness']
    values = sim.graph.call(
        GetParameters, 'sim/get_parameters', GetParameters.Request(names=names)
    ).values
    assert values[0].double_value == 0.05
    assert list(values[1].double_array_value) == [30.0] * 10
    assert set_parameters(sim, friction__transversal=0.5, robot__yaw_stiffness=40.0).successful
    twin.simulation.change(SCENE)
    assert_same_steps(sim, twin, 5)


def test_whole_numbers_stay_floating_point_parameters(lockstep):
    sim, _ = lockstep
    assert set_parameters(sim, friction__transversal=1, gravity=[0, 0, -9]).successful
    request = GetParameters.Request(names=['friction.transversal', 'gravity'])
    values = sim.graph.call(GetParameters, 'sim/get_parameters', request).values
    assert values[0].double_value == 1.0
    assert list(values[1].double_array_value) == [0.0, 0.0, -9.0]
    assert set_parameters(sim, friction__transversal=0.5, gravity=[0.0, 0.0, -9.81]).successful


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'friction__longitudinal': -0.1}, 'friction.longitudinal'),
        (
            {'friction__longitudinal': float('nan')},
            'friction.longitudinal',
        ),
        ({'friction__longitudinal': 'ice'}, "friction.longitudinal must be a number, got 'ice'"),
        (
            {'robot__yaw_damping': [0.1, 0.2]},
            'one for each of the 10 joints',
        ),
        ({'friction__rolling': 0.1, 'friction__transversal': -1.0}, 'friction.transversal'),
        ({'friction__longitudinal': 1e300}, 'friction.longitudinal'),
        ({'level': 'planar'}, 'read-only'),
        ({'robot__link_count': 5}, 'read-only'),
        ({'real_time_factor': -1.0}, 'real_time_factor'),
    ],
)
def test_values_that_are_not_usable_are_refused_with_a_reason(lockstep, changes, reason):
    sim, twin = lockstep
    result = set_parameters(sim, **changes)
    assert not result.successful
    assert reason in result.reason
    assert_same_steps(sim, twin, 1)


def test_every_parameter_is_described(aiko):
    names = ['friction.transversal', 'real_time_factor', 'robot.link_count', 'level', 'scene']
    request = DescribeParameters.Request(names=names)
    service = aiko.service('describe_parameters')
    described = aiko.graph.call(DescribeParameters, service, request).descriptors
    assert all(item.description for item in described)
    assert [item.read_only for item in described] == [False, False, True, True, True]
    assert described[1].floating_point_range[0].to_value == 1000.0
    links = described[2].integer_range[0]
    assert (links.from_value, links.to_value) == (1, 200)
    assert 'auto, planar, spatial' in described[3].additional_constraints


def test_a_real_time_factor_counts_at_once(aiko):
    graph = aiko.graph
    assert set_parameters(aiko, real_time_factor=1e-4).successful  # a period is 200 s long
    graph.drain(aiko.joint_states)
    count = len(aiko.joint_states)
    graph.spin(0.2)  # ten periods at the pace from before
    assert len(aiko.joint_states) <= count + 1
    # Nothing else waits for the end of the period.
    told = len(aiko.diagnostics)
    assert aiko.pause(True).success
    graph.until(lambda: len(aiko.diagnostics) > told + 1, 'diagnostics', 10)
    assert set_parameters(aiko, real_time_factor=1.0).successful
    assert aiko.pause(False).success
    graph.until(lambda: len(aiko.joint_states) > count + 5, 'states')


# ---- what is published --------------------------------------------------------------------------


def test_late_joiners_get_the_description(aiko):
    late = []
    aiko.graph.node.create_subscription(String, '/aiko/robot_description', late.append, LATCHED)
    aiko.graph.until(lambda: late, 'robot_description')
    assert late[0].data == robot_description(SCENE.robot)


def test_names_of_a_robot_among_others(aiko):
    odom, poses = aiko.odom[-1], aiko.link_poses[-1]
    assert (odom.header.frame_id, odom.child_frame_id) == ('aiko/odom', 'aiko/base_link')
    assert poses.header.frame_id == 'world'
    aiko.values()
    assert aiko.diagnostics[-1].status[0].name == 'aiko/sim: physics'
    names = {name for name, _ in aiko.graph.node.get_topic_names_and_types()}
    relative = {'joint_states', 'link_poses', 'odom', 'joint_command', 'robot_description'}
    assert {f'/aiko/{name}' for name in relative} <= names
    assert not {f'/{name}' for name in relative} & names
    assert not aiko.clock


def test_markers_are_published_only_while_somebody_looks(aiko):
    graph, markers = aiko.graph, []
    looking = graph.node.create_subscription(MarkerArray, '/aiko/markers', markers.append, 10)
    begin = time.monotonic()
    graph.until(lambda: len(markers) > 5, 'markers')
    assert len(markers) <= 30 * (time.monotonic() - begin) + 1
    points, forces = markers[-1].markers[:2]
    assert points.header.frame_id == 'world'
    assert len(forces.points) == 2 * len(points.points)
    # All contacts of a robot that lies on the floor.
    assert max(abs(point.z) for point in points.points) < 1e-5
    graph.node.destroy_subscription(looking)


def test_states_reach_readers_of_both_kinds(aiko):
    heard = []
    topic = '/aiko/joint_states'
    aiko.graph.node.create_subscription(JointState, topic, heard.append, SENSOR_DATA)
    count = len(aiko.joint_states)
    aiko.graph.until(lambda: len(heard) > 5 and len(aiko.joint_states) > count + 5, 'states')
    assert all(len(message.effort) == 20 for message in heard)


def test_time_goes_on_over_resets(aiko):
    stamps = [nanoseconds(message) for message in aiko.joint_states]
    assert aiko.reset().success
    aiko.graph.until(lambda: len(aiko.joint_states) > len(stamps) + 5, 'states')
    stamps = [nanoseconds(message) for message in aiko.joint_states]
    assert stamps == sorted(stamps)


def test_nodes_end_within_two_seconds(started):
    for sim, number in zip(started, (signal.SIGTERM, signal.SIGINT), strict=True):
        begin = time.monotonic()
        assert sim.process.stop(number) == 0, sim.process.output
        assert time.monotonic() - begin < 2.0
        assert 'Traceback' not in sim.process.output
