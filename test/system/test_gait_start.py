# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where and when the gait starts: at the joints of the robot, by the clock of the robot."""

from itertools import pairwise
import math
import re
import signal
import time

from geometry_msgs.msg import Twist, TwistStamped, Vector3
from hand_clock import HandClock
import numpy as np
from offline import NAMES, nanoseconds, PERIOD
import pytest
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_srvs.srv import Trigger

from snake_sim_ros import Scene
from snake_sim_ros.gaits.blending import Blend
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.nodes.executors import WARN_PERIOD
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.scene.parameters import load_scene

BLEND_TIME = 0.5  # s
STRIDE = 0.546  # m, the default
BLENDED = 120  # periods after which a gait has blended, and some more
PERSISTENT = 0.5  # s for which stamps must be far away, else 2 s
SAME = 0.01  # rad, by which a command may differ from the measured angle
LIMITS = Scene().robot
POSTURE = np.random.default_rng(3).uniform(-0.7, 0.7, (10, 2))
HAND = ('use_sim_time:=true', f'blend_time:={BLEND_TIME}')


@pytest.fixture(scope='module')
def started(make_graph):
    """All nodes of this module, started together, in domains of their own."""
    names = ('measured', 'soft', 'now', 'wall', 'real', 'stamped', 'live')
    graphs = {name: make_graph() for name in names}
    graphs['measured'].start('gait', *HAND)
    graphs['soft'].start('gait', *HAND, 'scene:=sidewinding')
    graphs['now'].start('gait', *HAND, 'start_from:=now')
    soon = {'gait_inputs.PERSISTENT': PERSISTENT}
    graphs['wall'].start('gait', constants=soon)
    graphs['real'].start('gait', 'use_sim_time:=true', constants=soon)
    graphs['stamped'].start('gait', *HAND, 'use_stamped_vel:=true', 'cmd_vel_timeout:=0.5')
    graphs['live'].start('gait', 'use_sim_time:=true')
    graphs['sim'] = SimClient(graphs['live'], 'start_paused:=true')
    return graphs


class Robot:
    """A robot that says where its joints are, before every time of a clock of the test."""

    def __init__(self, graph, angle):
        self.clock, self.angle = HandClock(graph), angle
        self.heard = None  # number of commands before a restart
        quality = QoSProfile(depth=1)
        self.publisher = graph.node.create_publisher(JointState, 'joint_states', quality)
        graph.until(self.publisher.get_subscription_count, 'a reader of joint_states')

    def say(self):
        """Publish the joints of the next time."""
        told = JointState(name=NAMES, position=self.angle.ravel().tolist())
        told.header.stamp = stamp_from(self.clock.now + PERIOD)
        self.clock.send(self.publisher, told)

    def tick(self):
        """Publish the joints of the next time, and the time."""
        self.say()
        self.clock.tick()

    def restart(self):
        """Restart the gait; its first command may come at once, at the present time."""
        self.clock.graph.drain(self.clock.messages)
        self.heard = len(self.clock.messages)
        assert self.clock.graph.call(Trigger, 'gait/restart').success

    def until_begun(self):
        """Let time pass until the gait begins; return its commands until it has blended."""
        messages = self.clock.messages
        heard = len(messages) if self.heard is None else self.heard
        self.heard = None

        def begins():
            self.tick()
            self.clock.graph.spin(0.02)  # else the next command may replace the first one
            return messages[heard:]

        self.clock.graph.until(begins, 'the beginning')
        for _ in range(BLENDED):
            self.say()
            self.clock.step()
        return messages[heard:]


def assert_commands(messages, blend):
    """Assert that commands are those of a blend, to the bit, from their first one on."""
    begin = nanoseconds(messages[0])
    for message in messages:
        angle, rate = blend.reference(1e-9 * (nanoseconds(message) - begin))
        assert np.array(message.position).tobytes() == angle.tobytes()
        assert np.array(message.velocity).tobytes() == rate.tobytes()


@pytest.fixture(scope='module')
def robot(started):
    """A robot whose gait node goes through several tests."""
    return Robot(started['measured'], POSTURE)


def test_joint_states_without_use_are_one_warning(robot):
    robot.angle = np.where(POSTURE == POSTURE[3, 1], math.nan, POSTURE)
    process, graph = robot.clock.process, robot.clock.graph
    messages = robot.until_begun()
    robot.publisher.publish(JointState(name=['wheel'], position=[0.0]))
    assert_commands(messages, Blend.of(load_scene('lateral_undulation').gait, 10, BLEND_TIME))
    assert graph.call(Trigger, 'gait/restart').success
    (line,) = (line for line in process.lines if '[WARN]' in line)
    assert line.endswith(
        'joint_states must have angles within +-3.1416 rad, got nan for joint_4_pitch; without '
        'usable ones the gait starts without knowing where the joints are'
    )
    # It starts from those that come later.
    robot.angle = POSTURE
    graph.until(
        lambda: robot.tick() or process.count('from the measured angles'), 'a measured start'
    )


def test_commands_begin_at_the_measured_angles(robot):
    gait, process = load_scene('lateral_undulation').gait, robot.clock.process
    robot.angle, begin = POSTURE, len(process.lines)
    robot.restart()
    messages = robot.until_begun()
    assert_commands(messages, Blend.of(gait, 10, BLEND_TIME, POSTURE))
    assert np.array_equal(messages[0].position, POSTURE.ravel())
    assert not np.any(messages[0].velocity)
    for earlier, later in pairwise(messages):
        turned = np.abs(np.subtract(later.position, earlier.position)).max()
        assert turned < 1e-9 * PERIOD * LIMITS.joint_rate_limit
    robot.restart()
    assert_commands(robot.until_begun(), Blend.of(gait, 10, BLEND_TIME, POSTURE))
    # When time goes back, the angles of that time count; those beyond the limit are at the limit.
    robot.angle = np.where(POSTURE > 0.5, 0.8, -POSTURE)
    held = np.clip(robot.angle, -LIMITS.joint_limit, LIMITS.joint_limit)
    robot.clock.now = 1_000_000_000
    assert_commands(robot.until_begun(), Blend.of(gait, 10, BLEND_TIME, held))
    # Where the robot is put back into the posture of the gait, nothing blends.
    robot.angle, _ = Blend.of(gait, 10, BLEND_TIME).reference(0.0)
    assert_commands(robot.until_begun(), Blend.of(gait, 10, BLEND_TIME))
    told = process.lines[begin:]
    for text, count in (
        *(('the gait begins', 4), ('[INFO]', 4), ('[WARN]', 0)),
        *(('time went back', 1), ('the robot was put back', 1)),
    ):
        assert sum(text in line for line in told) == count, process.output


@pytest.mark.parametrize('name', ['soft', 'now'])
def test_commands_are_those_of_the_gait(started, name):
    scene = 'lateral_undulation' if name == 'now' else 'sidewinding'
    robot = Robot(started[name], POSTURE if name == 'now' else np.zeros((10, 2)))
    assert_commands(robot.until_begun(), Blend.of(load_scene(scene).gait, 10, BLEND_TIME))


def test_two_robots_are_one_warning(robot):
    process, graph = robot.clock.process, robot.clock.graph
    robot.angle = POSTURE
    robot.restart()
    robot.until_begun()
    begin = len(process.lines)

    def both():
        robot.angle = -robot.angle
        robot.tick()
        return process.count('is there more than one publisher of joint_states?')

    graph.until(both, 'the warning')
    heard = len(robot.clock.messages)
    for _ in range(100):
        both()
        graph.spin(0.002)
    (line,) = (line for line in process.lines[begin:] if '[WARN]' in line)
    assert 'joint_states jump back and forth' in line
    assert len(process.lines) - begin < 10, process.output
    assert len(robot.clock.messages) < heard + 10, 'it should wait'


def test_two_clocks_are_one_warning(started):
    clock = HandClock(started['now'])
    process, graph, messages = clock.process, clock.graph, clock.messages
    graph.until(lambda: clock.tick() or messages, 'the first command')
    lines, begin = len(process.lines), time.monotonic()
    ahead = 100_000_000_000

    def both():
        clock.tick()
        clock.now += ahead
        clock.tell()
        clock.now -= ahead
        return process.count('is there more than one publisher of /clock?')

    graph.until(both, 'the warning')
    for _ in range(100):
        both()
        graph.spin(0.002)
    graph.drain(messages)
    count = len(messages)
    both()
    graph.drain(messages)
    assert len(messages) == count, 'it should wait'
    warnings = [line for line in process.lines[lines:] if '[WARN]' in line]
    assert all('time goes back and forth' in line for line in warnings), process.output
    assert len(warnings) <= 1 + (time.monotonic() - begin) / WARN_PERIOD, process.output
    assert len(process.lines) - lines < 10, process.output
    graph.until(lambda: clock.tick() or messages[count:], 'commands by the clock that is left')


def test_a_clock_that_is_not_that_of_the_robot_is_one_warning(started):
    cases = [('wall', 'true', 12.0), ('real', 'false', time.time())]
    graphs = [started[name] for name, *_ in cases]
    processes = [process for graph in graphs for process in graph.processes]
    told = []
    for graph, (_, _, seconds) in zip(graphs, cases, strict=True):
        publisher = graph.node.create_publisher(JointState, 'joint_states', QoSProfile(depth=1))
        message = JointState(name=NAMES, position=[0.0] * 20)
        message.header.stamp = stamp_from(round(1e9 * seconds))
        told.append((graph, publisher, message))

    def tell():
        for graph, publisher, message in told:
            publisher.publish(message)
            graph.spin(0.01)

    graphs[0].until(
        lambda: tell() or all(process.count('use_sim_time') for process in processes),
        'warnings of both clocks',
    )
    for _ in range(20):
        tell()
    for process, (_, value, seconds) in zip(processes, cases, strict=True):
        assert process.count('[WARN]') == 1, process.output
        (line,) = (line for line in process.lines if '[WARN]' in line)
        assert f'joint_states are stamped {seconds:.1f} s, but the clock of this' in line
        assert f'set use_sim_time to {value}' in line


def stamped(speed, nanoseconds_):
    message = TwistStamped(twist=Twist(linear=Vector3(x=speed)))
    message.header.stamp = stamp_from(nanoseconds_)
    return message


def test_a_stamped_cmd_vel_counts_from_its_stamp(started):
    clock, gait = (
        HandClock(started['stamped'], TwistStamped),
        load_scene('lateral_undulation').gait,
    )
    process, graph = clock.process, clock.graph
    graph.until(lambda: clock.tick() or clock.messages, 'the first command')

    begin, full = nanoseconds(clock.messages[0]), Blend.of(gait, 10, BLEND_TIME)

    def follows(blend):
        message = clock.step()
        angle, _ = blend.reference(1e-9 * (nanoseconds(message) - begin))
        return np.array_equal(message.position, angle.ravel())

    # It is older than it would hold.
    clock.send(clock.twists, stamped(0.1, clock.now - 600_000_000))
    assert follows(full)
    process.wait_for(' s ago by the clock of this node, more than cmd_vel_timeout, 0.5 s; it')
    # The next tick of the clock may come before it.
    assert process.count(', 0.6 s ago') + process.count(', 0.605 s ago') == 1
    assert process.count('cmd_vel is late: stamped') == 1
    # A stamp of 0 means now, and so does one in the future.
    for speed, stamp in ((0.1, 0), (0.15, clock.now + 10**18)):
        clock.send(clock.twists, stamped(speed, stamp))
        target = Steering(speed, 0.0).gait(gait, LIMITS, Stride(STRIDE))[0]
        full = full.changed(1e-9 * (clock.now + PERIOD - begin), target)
        assert all(follows(full) for _ in range(90))
    # It holds for half a second after its stamp.
    clock.send(clock.twists, stamped(0.2, clock.now - 300_000_000))
    target = Steering(0.2, 0.0).gait(gait, LIMITS, Stride(STRIDE))[0]
    full = full.changed(1e-9 * (clock.now + PERIOD - begin), target)
    assert all(follows(full) for _ in range(40))
    assert not follows(full)
    process.wait_for('no cmd_vel for 0.5 s: the gait stops')


# ---- a simulated robot --------------------------------------------------------------------------


def lock_step(sim, commands, periods):
    """Let a robot follow the commands for some periods; return its joint_states."""
    states = []
    for _ in range(periods):
        now = nanoseconds(sim.joint_states[-1])
        sim.graph.until(
            lambda now=now: commands and nanoseconds(commands[-1]) >= now, 'the command of now'
        )
        states.append(sim.step()[0])
    return states


def until_commanded(sim, commands):
    """Let time pass until a gait commands the robot; return its joint_states."""
    states, heard = [], len(commands)
    while len(commands) == heard:
        states.append(sim.step()[0])
        sim.graph.spin(0.01)
    return states


def assert_no_jump(states, before):
    """Assert that no joint turned faster, or against more torque, than it had to before."""
    for earlier, later in pairwise(states):
        turned = np.abs(np.subtract(later.position, earlier.position)).max()
        assert turned < 1e-9 * PERIOD * LIMITS.joint_rate_limit / 2
    effort = max(np.abs(state.effort).max() for state in before)
    assert max(np.abs(state.effort).max() for state in states) < 3 * effort


def test_no_joint_jumps_when_the_gait_dies_starts_again_or_the_robot_is_put_back(started):
    sim, graph = started['sim'], started['live']
    gait = graph.processes[0]
    commands = graph.record(JointState, 'joint_command')
    sim.wait_until_connected()
    graph.until(lambda: graph.node.count_publishers('joint_command') > 1, 'the gait node')
    until_commanded(sim, commands)
    running = lock_step(sim, commands, 100)

    assert graph.call(Trigger, 'gait/restart').success
    assert_no_jump(lock_step(sim, commands, 60), running)

    gait.popen.send_signal(signal.SIGKILL)
    gait.popen.wait()
    graph.processes.remove(gait)
    graph.drain(commands)
    states = [sim.step()[0] for _ in range(20)]
    gait = graph.start('gait', 'use_sim_time:=true')
    states += until_commanded(sim, commands)
    assert np.abs(np.subtract(commands[-1].position, states[-1].position)).max() < SAME
    assert_no_jump([*states, *lock_step(sim, commands, 100)], running)
    assert gait.count('from the measured angles') == 1

    # Back at its start, it is commanded as at the first start, to the bit.
    graph.drain(commands)
    heard = len(commands)
    assert sim.reset().success
    states = lock_step(sim, commands, 40)
    assert_no_jump(states, running)
    assert gait.count('since the robot was put back') == 1
    scene = load_scene('lateral_undulation')
    assert_commands(commands[heard:], Blend.of(scene.gait, 10, 1.0))


def test_a_command_that_was_under_way_at_a_reset_is_void(started):
    # A gait publishes at every tick, and cannot take back the last one.
    sim, graph = started['sim'], started['live']
    sim.wait_until_connected()
    for process in graph.processes[:]:
        if process is not sim.process:
            process.stop()
            graph.processes.remove(process)
    assert sim.reset().success
    assert sim.pause(False).success
    sim.advance_to(sim.now + 0.3)
    answer = sim.reset()
    (seconds,) = re.findall(r't = (\S+) s', answer.message)
    late = stamp_from(round(1e9 * float(seconds)))
    start = sim.joint_states[-1].position[8]
    sim.send({'joint_5_yaw': start + 0.3}, stamp=late)
    begin = sim.now
    sim.advance_to(begin + 0.3)
    assert abs(sim.joint_states[-1].position[8] - start) < 0.02
    sim.send({'joint_5_yaw': start + 0.3})
    sim.graph.until(
        lambda: abs(sim.joint_states[-1].position[8] - start - 0.3) < 0.05, 'the next command'
    )
