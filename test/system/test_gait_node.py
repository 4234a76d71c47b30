# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The gait node with a plain subscriber, with a clock of the test, and with the sim node."""

from dataclasses import replace
from itertools import pairwise
import math
import signal

from geometry_msgs.msg import Twist, Vector3
from hand_clock import HandClock
import numpy as np
from offline import NAMES, nanoseconds, Offline, PERIOD, positions
import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros import Robot
from snake_sim_ros.gaits.blending import Blend, largest_values
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene

SCENES = ('lateral_undulation', 'sidewinding')
BLEND_TIME = 0.5  # s
STRIDE = 0.546  # m, the default


@pytest.fixture(scope='module')
def started(make_graph):
    """All nodes of this module, started together, in domains of their own."""
    lone = {scene: make_graph() for scene in SCENES}
    for scene, graph in lone.items():
        graph.start('gait', f'scene:={scene}')
    clocked, live = make_graph(), make_graph()
    clocked.start('gait', 'use_sim_time:=true')
    live.start('gait', 'use_sim_time:=true')
    tuned, forms = make_graph(), make_graph()
    tuned.start('gait', 'use_sim_time:=true', f'blend_time:={BLEND_TIME}')
    for form in ('multi_array', 'trajectory'):
        forms.start('gait', f'command_type:={form}')
    return lone, clocked, live, SimClient(live, 'start_paused:=true'), tuned, forms


class Follower(HandClock):
    """A gait node with a clock of the test, and the commands that it should publish."""

    def __init__(self, graph):
        super().__init__(graph)
        self.gait = load_scene('lateral_undulation').gait
        self.begin_again()

    def begin_again(self):
        """Restart the gait and find the time at which it begins."""
        self.graph.until(lambda: self.tick() or self.messages, 'the first command')
        self.graph.drain(self.messages)
        assert self.graph.call(Trigger, 'gait/restart').success
        del self.messages[:]
        self.begin = nanoseconds(self.step())
        assert beginning(self.messages, load_scene('lateral_undulation')) == self.begin
        self.blend = Blend.of(self.gait, 10, BLEND_TIME)
        self.seen = 0

    def wait(self, ticks):
        """Let time pass until all its commands have arrived."""
        for _ in range(ticks):
            self.step()

    def seconds(self, message):
        return 1e-9 * (nanoseconds(message) - self.begin)

    def error(self, blend, message):
        """Return the difference of a command from that of a blend [rad], [rad/s]."""
        pairs = zip(
            blend.reference(self.seconds(message)),
            (message.position, message.velocity),
            strict=True,
        )
        return max(np.abs(value.ravel() - told).max() for value, told in pairs)

    def expect(self, target, ticks=20):
        """Let time pass; assert that the commands begin to blend into a gait, at a tick."""
        self.wait(ticks)
        new = self.messages[self.seen :]
        old = next((k for k, m in enumerate(new) if self.error(self.blend, m) > 1e-9), len(new))
        begins = {self.seconds(message) for message in new[max(old - 1, 0) : old + 1]}
        if target == self.blend.gait:
            assert old == len(new)
        else:
            assert old < len(new), 'no command differs'
            # The first command may be one that did not arrive.
            first, last = min(begins), max(begins)
            blends = [
                self.blend.changed(first + 1e-9 * PERIOD * k, target)
                for k in range(round((last - first) * 200) + 1)
            ]
            self.blend = min(blends, key=lambda blend: self.error(blend, new[old]))
            assert max(self.error(self.blend, m) for m in new[old:]) < 1e-9
        self.seen = len(self.messages) - 1

    def set(self, **values):
        """Set parameters at once, with __ for a dot; return the result."""
        request = SetParametersAtomically.Request()
        for name, value in values.items():
            item = Parameter(name.replace('__', '.'), value=value)
            request.parameters.append(item.to_parameter_msg())
        return self.graph.call(
            SetParametersAtomically, 'gait/set_parameters_atomically', request
        ).result

    def get(self, *names):
        request = GetParameters.Request(names=names)
        response = self.graph.call(GetParameters, 'gait/get_parameters', request)
        return [item.double_value for item in response.values]

    def twist(self, speed, turning):
        linear, angular = Vector3(x=speed), Vector3(z=turning)
        self.send(self.twists, Twist(linear=linear, angular=angular))

    def steered(self, speed, turning):
        return Steering(speed, turning).gait(self.gait, Robot(), Stride(STRIDE))[0]


@pytest.fixture(scope='module')
def follower(started):
    return Follower(started[4])


def assert_reference(messages, scene, begin):
    for message in messages:
        # The same formula at the same nanoseconds.
        time = 1e-9 * (nanoseconds(message) - begin)
        angle, rate = gait.reference(scene.gait, time, 10)
        assert list(message.name) == NAMES
        assert np.abs(np.array(message.position) - angle.ravel()).max() < 1e-9
        assert np.abs(np.array(message.velocity) - rate.ravel()).max() < 1e-9


def beginning(messages, scene):
    """Return the stamp of the newest message that is the beginning of the gait, or None."""
    angle, rate = (value.ravel() for value in gait.reference(scene.gait, 0.0, 10))
    for message in reversed(messages):
        same = np.abs(np.array(message.position) - angle).max() < 1e-12
        if same and np.abs(np.array(message.velocity) - rate).max() < 1e-12:
            return nanoseconds(message)
    return None


@pytest.mark.parametrize('name', SCENES)
def test_gait_begins_when_someone_listens_and_again_after_restart(started, name):
    graph, scene = started[0][name], load_scene(name)
    (process,) = graph.processes
    response = graph.call(Trigger, 'gait/restart')
    assert (response.success, response.message) == (True, 'the gait begins again')
    graph.spin(0.3)
    assert not process.count('the gait begins'), process.output
    messages = graph.record(JointState, 'joint_command')
    graph.until(lambda: len(messages) > 20, 'commands')
    process.wait_for('the gait begins')
    assert process.count('the gait begins') == 1

    heard = len(messages)
    assert graph.call(Trigger, 'gait/restart').success
    graph.until(lambda: beginning(messages[heard:], scene) is not None, 'the beginning')
    begin = beginning(messages[heard:], scene)
    graph.until(lambda: len(messages) > heard + 100, 'half a second of commands')
    after = [message for message in messages if nanoseconds(message) >= begin]
    assert_reference(after, scene, begin)
    stamps = [nanoseconds(message) for message in messages]
    assert stamps == sorted(set(stamps))
    number = signal.SIGINT if scene.gait.soft_start else signal.SIGTERM
    assert process.stop(number) == 0, process.output


def test_gait_follows_a_clock_of_others_and_pauses_with_it(started):
    clock = HandClock(started[1])
    graph, process, messages = clock.graph, clock.process, clock.messages
    graph.until(lambda: clock.tick() or messages, 'the first command')
    process.wait_for('the gait begins')
    assert process.count('nobody publishes joint_states: the gait starts without') == 1
    graph.drain(messages)
    assert graph.call(Trigger, 'gait/restart').success
    scene, heard = load_scene('lateral_undulation'), len(messages)
    # 200 commands a second by default, and none in between.
    begin = nanoseconds(clock.step())
    for _ in range(50):
        clock.now += PERIOD // 2
        clock.tell()
        clock.now -= PERIOD // 2
        clock.step()
    after = messages[heard:]
    assert [nanoseconds(m) for m in after] == [begin + k * PERIOD for k in range(51)]
    assert_reference(after, scene, begin)

    graph.drain(messages)
    count = len(messages)
    graph.spin(0.3)
    assert len(messages) == count
    # A clock that begins anew begins the gait anew; so does one that goes back a little.
    for back in (8_000_000_000, 5 * PERIOD):
        latest, heard = clock.now, len(messages)
        clock.now -= back
        graph.until(lambda heard=heard: clock.tick() or messages[heard:], 'the beginning')
        begin = nanoseconds(messages[heard])
        assert begin < latest
        for _ in range(20):
            clock.step()
        assert_reference(messages[heard:], scene, begin)
    process.wait_for(f'since time went back from {1e-9 * latest:.4f} s')
    assert process.count('time went back') == 2
    assert process.stop(signal.SIGTERM) == 0, process.output


def test_sim_and_gait_get_as_far_as_the_offline_run(started):
    _, _, graph, live, *_ = started
    commands = live.step_to_gait()
    begin, periods, path = nanoseconds(commands[0]), 300, []
    while nanoseconds(live.joint_states[-1]) < begin + periods * PERIOD:
        # In lock-step, the robot waits for the command of the time that it has reached.
        now = nanoseconds(live.joint_states[-1])
        graph.until(lambda now=now: nanoseconds(commands[-1]) >= now, 'the command of now')
        path.append(positions(live.step()[1])[5])
    moved = np.linalg.norm((path[-1] - path[0])[:2])

    scene = load_scene('lateral_undulation')
    twin, path = Offline(scene), []
    for _ in range(periods):
        times = twin.simulation.midpoints(20)
        twin.simulation.advance(*gait.reference(scene.gait, times, 10))
        path.append(twin.sample().position[5])
    distance = np.linalg.norm((path[-1] - path[0])[:2])
    assert distance > 0.1
    # A command is extrapolated by its rate over a period T, two if it arrives late: the reference
    # is off by up to 2 (omega T)^2 = 1e-4 of the amplitude, and so is the way, within ten times.
    assert moved == pytest.approx(distance, rel=1e-3)
    assert int(live.values()['rejected_commands']) == 0
    assert all(nanoseconds(message) % PERIOD == 0 for message in commands)


def test_numbers_change_while_the_gait_runs(follower):
    yaw = replace(follower.gait.yaw, amplitude=0.3, angular_frequency=3.0)
    follower.gait = replace(follower.gait, yaw=yaw)
    assert follower.set(gait__yaw__amplitude=0.3, gait__yaw__angular_frequency=3.0).successful
    follower.expect(follower.gait)
    # In the middle of that blend: another gait, with one number of its own.
    scene = load_scene('sinus_lifting')
    follower.gait = replace(scene.gait, yaw=replace(scene.gait.yaw, offset=0.1))
    assert follower.set(scene='sinus_lifting', gait__yaw__offset=0.1).successful
    follower.expect(follower.gait)
    names = [f'gait.{name}' for name in ('yaw.amplitude', 'yaw.offset', 'pitch.amplitude')]
    assert follower.get(*names) == [scene.gait.yaw.amplitude, 0.1, scene.gait.pitch.amplitude]
    # No step is longer than the fastest joint allows; the rest is checked against the formula.
    heard = [(nanoseconds(m), np.array(m.position)) for m in follower.messages]
    for (t, angle), (later, next_angle) in pairwise(heard):
        assert np.abs(next_angle - angle).max() <= 10.0 * 1e-9 * (later - t) + 1e-9


def test_changes_that_joints_cannot_follow_are_refused_whole(follower):
    names = ('gait.yaw.amplitude', 'gait.yaw.offset')
    before = follower.get(*names)
    for values, reason in (
        ({'gait__yaw__angular_frequency': 100.0}, 'out of range'),
        ({'gait__pitch__phase': math.nan}, 'out of range'),
        ({'gait__yaw__offset': 0.5}, 'amplitude plus offset of gait.yaw must be within the joint'),
        ({'gait__yaw__phase': 'left'}, "phase must be a number, got 'left'"),
        (
            {'scene': 'sinus_liftin'},
            "no file sinus_liftin; did you mean 'sinus_lifting'? the scenes that come",
        ),
        ({'blend_time': 2.0}, 'read-only'),
    ):
        result = follower.set(gait__yaw__amplitude=0.4, **values)
        assert not result.successful
        assert reason in result.reason
    assert follower.get(*names) == before
    follower.expect(follower.gait)


def test_every_number_has_a_range_and_a_description(follower):
    largest = largest_values(Robot(), 'yaw')
    names = [f'gait.{axis}.{name}' for axis in ('yaw', 'pitch') for name in largest]
    names += ['gait.soft_start', 'stride', 'blend_time', 'publish_rate', 'cmd_vel_timeout']
    request = DescribeParameters.Request(names=names)
    response = follower.graph.call(DescribeParameters, 'gait/describe_parameters', request)
    for item in response.descriptors:
        assert item.description
        (span,) = item.floating_point_range
        if item.name.count('.') == 2:
            bound = largest[item.name.rpartition('.')[2]]
            assert (span.from_value, span.to_value) == (-bound, bound)


def test_cmd_vel_steers_and_stops(follower):
    process = follower.process
    follower.twist(0.1, 0.05)
    follower.expect(follower.steered(0.1, 0.05))
    follower.twist(math.nan, 0.0)
    process.wait_for('cmd_vel: linear.x must be finite, got nan; the last good cmd_vel holds')
    follower.twist(-0.2, -0.3)
    follower.expect(follower.steered(-0.2, -0.3))
    follower.twist(0.0, 0.0)
    follower.expect(follower.steered(0.0, 0.0), ticks=110)
    still = follower.messages[-1]
    assert not np.any(still.position)
    assert not np.any(still.velocity)
    follower.twist(0.0, 0.4)
    process.wait_for('cmd_vel: angular.z 0.4 rad/s needs a linear.x that is not 0')
    follower.expect(follower.blend.gait)
    follower.twist(5.0, 0.0)
    process.wait_for('cmd_vel: linear.x 5 m/s is more than')
    assert follower.set(cmd_vel_timeout=0.25).successful
    follower.expect(follower.steered(5.0, 0.0))
    follower.wait(160)
    process.wait_for('no cmd_vel for 0.25 s: the gait stops')
    assert not np.any(follower.messages[-1].position)
    for text in ('no cmd_vel', 'must be finite', 'needs a linear.x'):
        assert process.count(text) == 1


def assert_wave(positions):
    """Assert that positions are those of case A at some time."""
    wave = load_scene('lateral_undulation').gait.yaw
    yaw, pitch = np.reshape(positions, (10, 2)).T / wave.amplitude
    # sin(p + lag) = sin p cos lag + cos p sin lag for the second joint
    cosine = (yaw[1] - yaw[0] * math.cos(wave.phase_lag)) / math.sin(wave.phase_lag)
    phase = math.atan2(yaw[0], cosine)
    assert np.abs(yaw - np.sin(phase + wave.phase_lag * np.arange(10))).max() < 1e-9
    assert not np.any(pitch)


def test_commands_in_other_forms(started):
    graph = started[5]
    arrays = graph.record(Float64MultiArray, 'position_commands')
    trajectories = graph.record(JointTrajectory, 'joint_trajectory')
    graph.until(lambda: len(arrays) > 5 and len(trajectories) > 5, 'commands of both forms')
    for message in arrays:
        assert_wave(message.data)
    for message in trajectories:
        (point,) = message.points
        assert message.joint_names == NAMES
        assert nanoseconds(message) == 0
        assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, PERIOD)
        assert not (point.velocities or point.accelerations)
        assert_wave(point.positions)
