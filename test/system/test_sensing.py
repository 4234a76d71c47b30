# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sensors, pushes and poses of a sim node, as other programs use them."""

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
from offline import bits, nanoseconds, PERIOD, wire_axes
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu
from sim_client import connected, SimClient, with_twin

from snake_sim_ros.recording.sensors import recorded_sensors, Sensors
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.simulation import simulate

# A robot that is told nothing slides down a slope.
SLOPE = {'gait.yaw.amplitude': 0.0, 'gravity': [3.0, 1.0, -9.0], 'duration': 0.2}
# A robot that is told nothing lies on a floor that holds it.
STRAIGHT = {
    'gait.yaw.amplitude': 0.0,
    'friction.longitudinal': 0.5,
    'friction.transversal': 0.5,
}
NOISE = {
    'sensor_seed': 5,
    'sensor_rate': 100.0,
    'imu_angular_velocity_noise': 0.01,
    'imu_acceleration_noise': 0.1,
    'imu_acceleration_bias': [0.1, 0.2, 0.3],
    'contact_force_noise': 0.05,
    'joint_position_noise': 0.001,
    'joint_velocity_noise': 0.01,
}
LINKS = {'imu_links': ['link_6', 'link_1'], 'contact_force_links': 'all'}
STATES = 41  # from 0 to 0.2 s
NEAR = 1e-12


def as_parameters(values):
    texts = {name: str(value).replace(' ', '') for name, value in values.items()}
    return [f'{name}:={text}' for name, text in texts.items()]


class Sensing(SimClient):
    """A sim in lock-step with readers of its sensors, and what pushes and puts the robot."""

    def __init__(self, graph, values):
        self.imus = {k: graph.record(Imu, f'imu/link_{k}') for k in (1, 6)}
        self.wrenches = [
            graph.record(WrenchStamped, f'contact_forces/link_{k + 1}') for k in range(11)
        ]
        self.push = graph.node.create_publisher(WrenchStamped, 'sim/push', QoSProfile(depth=10))
        self.pose = graph.node.create_publisher(PoseStamped, 'sim/set_pose', QoSProfile(depth=1))
        super().__init__(graph, 'start_paused:=true', *as_parameters({**LINKS, **values}))

    def wait_until_connected(self):
        super().wait_until_connected()
        for publisher in (self.push, self.pose):
            self.graph.until(publisher.get_subscription_count, 'a reader')

    def tell(self, publisher, message):
        """Publish a message and wait until the middleware of the node has it."""
        publisher.publish(message)
        assert publisher.wait_for_all_acked(Duration(seconds=10))

    def push_with(self, frame, force=(0.0, 0.0, 0.0), torque=(0.0, 0.0, 0.0)):
        message = WrenchStamped()
        message.header.frame_id = frame
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
        message.wrench.torque.x, message.wrench.torque.y, message.wrench.torque.z = torque
        self.tell(self.push, message)

    def put(self, position, orientation=(0.0, 0.0, 0.0, 1.0), frame='world'):
        message = PoseStamped()
        message.header.frame_id, pose = frame, message.pose
        pose.position.x, pose.position.y, pose.position.z = position
        turned = pose.orientation
        turned.x, turned.y, turned.z, turned.w = orientation
        self.tell(self.pose, message)

    def refused(self, said):
        """Return whether the diagnostics have a sentence, the log one, and the node is there."""
        self.graph.until(
            lambda: any(
                said in item.status[0].message and item.status[0].level == DiagnosticStatus.WARN
                for item in self.diagnostics
            ),
            f'{said!r} in /diagnostics',
            10,
        )
        self.process.wait_for(said.partition(': ')[0])  # one in 5 s of each topic
        return self.reset().success

    def velocity(self):
        """Return the sum of m v of the links from two link_poses [N s]: as the robot moves on."""
        first, last = self.link_poses[-2:]
        moved = [
            (b.position.x - a.position.x, b.position.y - a.position.y, b.position.z - a.position.z)
            for a, b in zip(first.poses, last.poses, strict=True)
        ]
        seconds = 1e-9 * (nanoseconds(last) - nanoseconds(first))
        return 7.5 / 11 * np.sum(moved, axis=0) / seconds


@pytest.fixture(scope='module')
def started(make_graph):
    return connected(
        Sensing(make_graph(), {**SLOPE, **NOISE}),
        Sensing(make_graph(), {'gravity': [0.0, 0.0, 0.0], 'push_duration': 0.0125}),
        Sensing(make_graph(), {'frame_prefix': 'aiko/'}),
        Sensing(make_graph(), {**STRAIGHT, 'push_duration': 0.5}),
    )


@pytest.fixture
def held(started):
    """A straight robot on a floor that holds it."""
    return started[3]


@pytest.fixture
def noisy(started):
    return started[0]


@pytest.fixture
def free(started):
    """A robot without gravity, in the air and at rest."""
    sim = started[1]
    sim.reset()
    sim.put((0.0, 0.0, 1.0))
    sim.graph.drain(sim.joint_states)
    return sim


@pytest.fixture
def robot(started):
    sim = started[2]
    sim.reset()
    sim.graph.drain(sim.joint_states)
    return sim


def vectors(messages, get):
    return np.array([[get(item).x, get(item).y, get(item).z] for item in messages])


# ---- sensors ------------------------------------------------------------------------------------


def test_sensors_have_the_bits_of_a_recorded_run(noisy):
    lists = [noisy.joint_states, *noisy.imus.values(), *noisy.wrenches]
    runs = []
    for _ in range(2):  # the reset begins the noise anew
        noisy.graph.drain(noisy.joint_states)
        for messages in lists:
            messages.clear()
        noisy.reset()
        for _ in range(STATES - 1):
            noisy.step()
        noisy.graph.until(lambda: all(len(item) >= 21 for item in lists), 'all messages', 10)
        runs.append([list(messages) for messages in lists])
    scene = with_settings(load_scene('lateral_undulation'), SLOPE)
    found = recorded_sensors(simulate(scene, rate=200.0), Sensors(**LINKS, **NOISE))
    for joint_states, head, middle, *wrenches in runs:
        start = nanoseconds(joint_states[0])
        assert [nanoseconds(item) - start for item in head] == [2 * PERIOD * k for k in range(21)]
        for name in ('position', 'velocity'):
            key = 'angle' if name == 'position' else name
            heard = [getattr(item, name) for item in joint_states]
            assert (np.array(heard) == found[f'measured_joint_{key}']).all()
        for k, messages in enumerate((head, middle)):
            acceleration = vectors(messages, lambda item: item.linear_acceleration)
            assert (acceleration == found['imu_linear_acceleration'][:, k]).all()
            omega = vectors(messages, lambda item: item.angular_velocity)
            assert (omega == found['imu_angular_velocity'][:, k]).all()
            turned = [(q.x, q.y, q.z, q.w) for q in (item.orientation for item in messages)]
            assert (np.array(turned) == found['imu_orientation'][:, k]).all()
        for k, messages in enumerate(wrenches):
            force = vectors(messages, lambda item: item.wrench.force)
            torque = vectors(messages, lambda item: item.wrench.torque)
            assert (np.hstack([force, torque]) == found['contact_wrench'][:, k]).all()


def test_messages_say_frames_and_covariances(noisy, robot):
    noisy.graph.until(lambda: noisy.imus[6] and noisy.wrenches[0], 'messages')
    imu = noisy.imus[6][-1]
    assert imu.header.frame_id == 'link_6'
    assert list(imu.angular_velocity_covariance) == np.ravel(0.01**2 * np.eye(3)).tolist()
    assert list(imu.linear_acceleration_covariance) == np.ravel(0.1**2 * np.eye(3)).tolist()
    assert not any(imu.orientation_covariance)
    assert noisy.wrenches[3][-1].header.frame_id == 'link_4'
    robot.step()
    robot.graph.until(lambda: robot.imus[6] and robot.wrenches[0], 'messages')
    imu = robot.imus[6][-1]
    assert imu.header.frame_id == 'aiko/link_6'
    assert robot.wrenches[0][-1].header.frame_id == 'aiko/link_1'
    assert not any(imu.linear_acceleration_covariance)


def test_at_rest_sensors_say_what_carries_the_robot(robot):
    for _ in range(3):
        robot.step()
    robot.graph.drain(robot.wrenches[10])
    imu = robot.imus[6][-1]
    expected = wire_axes(imu.orientation).T @ [0.0, 0.0, 9.81]
    # 1e-6 m/s of the contact laws over a period.
    assert vectors([imu], lambda item: item.linear_acceleration)[0] == pytest.approx(
        expected, abs=2e-4
    )
    weight = sum(messages[-1].wrench.force.z for messages in robot.wrenches)
    assert weight == pytest.approx(7.5 * 9.81, abs=7.5 * 1e-6 * 4000)


# ---- pushes -------------------------------------------------------------------------------------


def test_a_push_gives_a_free_robot_its_momentum(free):
    # In the frame of link 6, as in the world where it lies along it: see its orientation.
    free.step()
    axes = wire_axes(free.link_poses[-1].poses[5].orientation)
    free.push_with('link_6', (2.0, 0.0, 0.0))
    for _ in range(5):
        free.step()
    # 0.0125 s of 2 N are two periods and a half; the rest conserves momentum.
    assert free.velocity() == pytest.approx(0.0125 * axes @ [2.0, 0.0, 0.0], abs=1e-5)
    free.push_with('world', (0.0, 0.0, 3.0))
    free.push_with('link_2', (0.0, 0.0, 0.0), (0.1, 0.2, 0.3))
    for _ in range(5):
        free.step()
    expected = 0.0125 * (axes @ [2.0, 0.0, 0.0] + np.array([0.0, 0.0, 3.0]))
    assert free.velocity() == pytest.approx(expected, abs=1e-3)


def test_a_pushed_robot_moves_as_offline(robot):
    scene = load_scene('lateral_undulation')
    sim, twin = with_twin(robot, scene)
    request = SetParametersAtomically.Request(
        parameters=[
            Parameter('push_link', value='link_2').to_parameter_msg(),
            Parameter('push_duration', value=0.052).to_parameter_msg(),
        ]
    )
    answer = sim.graph.call(SetParametersAtomically, 'sim/set_parameters_atomically', request)
    assert answer.result.successful, answer.result.reason
    sim.push_with('world', (3.0, 8.0, 0.0), (0.0, 0.0, 0.1))
    twin.simulation.pushes.begin(1, (3.0, 8.0, 0.0), (0.0, 0.0, 0.1), duration=0.052)
    for _ in range(20):
        joint_states, *_ = sim.step()
        sample = twin.advance()
        expected = (sample.angle, sample.rate, sample.torque)
        assert bits(joint_states) == b''.join(part.tobytes() for part in expected)
    assert np.abs(sample.angle).max() > 1e-3


def test_friction_holds_a_push(held):
    # 30 N on link 6, along a straight robot that mu = 0.5 holds against 36.8 N, for 0.5 s.
    held.step()
    before = held.link_poses[-1]
    held.push_with('world', (30.0, 0.0, 0.0))
    for _ in range(110):
        held.step()
    moved = [
        (b.position.x - a.position.x, b.position.y - a.position.y)
        for a, b in zip(before.poses, held.link_poses[-1].poses, strict=True)
    ]
    # Contacts that stick move with the residual, of 1e-9 m/s.
    assert np.abs(moved).max() <= 0.55 * 1e-9
    held.push_with('world', (40.0, 0.0, 0.0))
    for _ in range(40):
        held.step()
    # For 0.2 s with (F - mu m g)/m.
    assert held.velocity()[0] == pytest.approx((40.0 - 0.5 * 7.5 * 9.81) * 0.2, rel=0.02)


def test_a_reset_ends_a_push(free):
    free.push_with('world', (0.0, 0.0, 3.0))
    free.reset()
    free.put((0.0, 0.0, 1.0))
    free.graph.drain(free.joint_states)
    for _ in range(3):
        free.step()
    assert np.abs(free.velocity()).max() < 1e-9


@pytest.mark.parametrize(
    ('frame', 'force', 'said'),
    [
        ('world', (float('nan'), 0.0, 0.0), 'push: force must be finite, got (nan, 0, 0)'),
        ('link_12', (1.0, 0.0, 0.0), "push: header.frame_id: no link 'link_12'; the links are"),
        ('base_link', (1.0, 0.0, 0.0), 'push: the frame base_link is not that of a link; link_6'),
    ],
)
def test_pushes_that_are_not_usable_are_refused(robot, frame, force, said):
    robot.push_with(frame, force)
    assert robot.refused(said)


# ---- poses --------------------------------------------------------------------------------------


def test_the_pose_of_odom_is_where_the_robot_is_put(robot):
    robot.step()
    odom, poses = robot.odom[-1].pose.pose, robot.link_poses[-1]
    height = odom.position.z
    half = np.sqrt(0.5)
    robot.put((1.0, -2.0, height), (0.0, 0.0, half, half), 'aiko/odom')
    robot.graph.until(lambda: robot.odom[-1].pose.pose.position.x == 1.0, 'the robot there', 10)
    there = robot.odom[-1]
    assert (there.pose.pose.position.y, there.pose.pose.position.z) == (-2.0, height)
    turned = there.pose.pose.orientation
    assert (turned.x, turned.y, turned.z, turned.w) == pytest.approx((0, 0, half, half), abs=NEAR)
    # Links are where they were, as seen from the base.
    robot.graph.until(lambda: robot.link_poses[-1] is not poses, 'poses')
    before, after = (
        np.array([(p.position.x, p.position.y, p.position.z) for p in message.poses])
        for message in (poses, robot.link_poses[-1])
    )
    base = odom.position.x, odom.position.y, odom.position.z
    seen = (before - base) @ wire_axes(odom.orientation)
    assert (after - [1.0, -2.0, height]) @ wire_axes(turned) == pytest.approx(seen, abs=NEAR)
    # It stays at rest, and goes on.
    robot.graph.drain(robot.joint_states)
    robot.step()
    assert robot.odom[-1].pose.pose.position.x == pytest.approx(1.0, abs=1e-6)
    assert np.abs(robot.joint_states[-1].velocity).max() < 1e-3


FLAT, DOUBLE = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 2.0)


@pytest.mark.parametrize(
    ('height', 'orientation', 'frame', 'said'),
    [
        (0.02, FLAT, 'world', 'link 1 would be 0.0325 m inside the floor'),
        (float('inf'), FLAT, 'world', 'position must be finite'),
        (1.0, DOUBLE, 'world', 'orientation must be a unit quaternion, got a norm of 2'),
        (1.0, FLAT, 'map', "the frame must be world or odom, got 'map'"),
    ],
)
def test_poses_that_are_not_usable_are_refused(robot, height, orientation, frame, said):
    robot.put((0.0, 0.0, height), orientation, frame)
    assert robot.refused(f'set_pose: {said}')
