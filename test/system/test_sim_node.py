# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The sim node over ROS: time, states, commands, services."""

from pathlib import Path
import re
import signal
import time
from types import SimpleNamespace

from geometry_msgs.msg import PoseStamped
import numpy as np
from offline import (
    bits,
    held_then_commanded,
    largest_difference,
    NAMES,
    nanoseconds,
    Offline,
    PERIOD,
    positions,
    wire_axes,
)
from programs import next_domain, node_command, Process
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sim_client import connected, SimClient
from std_srvs.srv import Trigger

from snake_sim_ros import Report
from snake_sim_ros.nodes import executors
from snake_sim_ros.nodes.compiling import NotCompiledError
from snake_sim_ros.nodes.diagnostics import LoadMeter, reason
from snake_sim_ros.nodes.sim_node import SimNode
from snake_sim_ros.nodes.state_publishers import TransformMessages
from snake_sim_ros.scene.parameters import load_scene

# Messages carry doubles unchanged; values that go through matrices are rounded a few times.
ROUNDING = 1e-14
WARN_PERIOD = 1.0  # s between two warnings of the second sim in lock-step, else 5 s
# Yaw 0.4 rad curls the robot to the left, with every joint well within 45 degrees.
CURL = {name: 0.4 if name.endswith('yaw') else 0.0 for name in NAMES}


@pytest.fixture(scope='module')
def scene():
    return load_scene('lateral_undulation')


@pytest.fixture(scope='module')
def sims(make_graph):
    """One running sim and two in lock-step, started together."""
    often = {f'{module}.WARN_PERIOD': WARN_PERIOD for module in ('executors', 'diagnostics')}
    return connected(
        SimClient(make_graph()),
        SimClient(make_graph(), 'start_paused:=true'),
        SimClient(make_graph(), 'start_paused:=true', constants=often),
    )


@pytest.fixture(scope='module')
def curled(sims):
    """The running sim, at rest again after one command at some time."""
    sim = sims[0]
    sim.send(CURL)

    def is_done():
        last = sim.joint_states[-1]
        there = np.abs(np.array(last.position) - list(CURL.values())).max() < 0.2
        return there and np.abs(last.velocity).max() < 1e-3

    sim.graph.until(is_done, 'the robot at rest after a command')
    return sim


@pytest.fixture(scope='module')
def lockstep(sims):
    """Messages of two lock-step runs with the same commands at the same times."""
    return [[run_in_lockstep(sim) for sim in sims[1:]], sims[1:]]


# In lock-step: (period before which it is sent, joint angles [rad], joint rates [rad/s]).
SCRIPT = [
    (5, CURL, {}),
    (10, {'joint_3_yaw': -0.2, 'joint_7_yaw': 0.1}, {}),
    (15, {'joint_5_yaw': 0.3, 'joint_5_pitch': 0.0}, {'joint_5_yaw': 1.0}),
    (32, {'joint_10_yaw': -0.3}, {'joint_10_yaw': -9.0}),
]
PERIODS = 50


def run_in_lockstep(sim):
    commands = {period: command for period, *command in SCRIPT}
    messages = []
    for period in range(PERIODS):
        if period in commands:
            sim.send(*commands[period])
        messages.append(sim.step())
    return messages


@pytest.fixture(scope='module')
def script_offline(scene):
    commands = {period: command for period, *command in SCRIPT}
    twin, samples = Offline(scene), []
    for period in range(PERIODS):
        if period in commands:
            twin.command(*commands[period])
        samples.append(twin.advance())
    return samples


def test_clock_advances_by_20_steps_a_message(lockstep):
    for messages in lockstep[0]:
        ticks = [nanoseconds(clock) for *_, clock in messages]
        # 20 steps of 1/4000 s
        assert ticks == [PERIOD * (k + 1) for k in range(PERIODS)]


def test_clock_of_a_running_sim_stays_on_the_grid(curled):
    ticks = np.array([nanoseconds(clock) for clock in curled.clock])
    assert not (ticks % PERIOD).any()
    # The clock keeps one message: a slow reader may miss some, but none comes twice or late.
    assert (np.diff(ticks) >= PERIOD).all()
    assert np.median(np.diff(ticks)) == PERIOD


def test_states_have_the_stamps_of_the_clock(lockstep, curled):
    for messages in lockstep[0]:
        assert all(len({nanoseconds(message) for message in state}) == 1 for state in messages)
    states = {nanoseconds(message) for message in curled.joint_states}
    first = max(nanoseconds(messages[0]) for messages in curled.states)
    ticks = {nanoseconds(clock) for clock in curled.clock}
    assert {tick for tick in ticks if tick >= first} <= states


def test_lockstep_has_the_bits_of_the_offline_run(lockstep, script_offline):
    for messages in lockstep[0]:
        for (joint_states, link_poses, *_), sample in zip(messages, script_offline, strict=True):
            expected = (sample.angle, sample.rate, sample.torque)
            assert bits(joint_states) == b''.join(part.tobytes() for part in expected)
            assert (positions(link_poses) == sample.position).all()
            assert largest_difference(joint_states, link_poses, sample) < ROUNDING


def test_two_lockstep_runs_have_the_same_bits(lockstep):
    first, second = lockstep[0]
    for a, b in zip(first, second, strict=True):
        assert bits(a[0]) == bits(b[0])
        assert a[1] == b[1]
        assert a[2] == b[2]


def test_running_sim_follows_the_offline_run(curled, scene):
    samples = held_then_commanded(scene, CURL, curled.joint_states)
    poses = {nanoseconds(message): message for message in curled.link_poses}
    compared = [m for m in curled.joint_states if nanoseconds(m) in poses]
    assert len(compared) > 200
    for message in compared:
        stamp = nanoseconds(message)
        # The same input on the same machine gives the same state, whatever the wall clock did.
        assert largest_difference(message, poses[stamp], samples[stamp // PERIOD]) < 1e-9


def test_joints_follow_a_constant_command(curled, scene):
    robot, friction = scene.robot, scene.friction
    last = curled.joint_states[-1]
    target = np.array(list(CURL.values()))
    angle, rate, effort = (np.array(v) for v in (last.position, last.velocity, last.effort))
    assert list(last.name) == NAMES
    assert np.isfinite(effort).all()
    assert np.abs(rate).max() < 1e-2
    # At rest friction holds a joint off its reference. Of the two parts of the robot the shorter
    # has up to 5 links; each pushes with at most mu m g at (k - 1/2) L from the joint, its spheres
    # at most L_GS further: the error is at most that torque over K_hp.
    arms = (np.arange(1, 6) - 0.5) * robot.link_length + robot.contact_offset
    torque = friction.transversal * robot.link_mass * 9.81 * arms.sum()
    bound = torque / robot.yaw_stiffness
    assert np.abs(angle[::2] - target[::2]).max() < bound
    # The law itself, K (reference - angle) - D rate, read at the middle of the last step: half a
    # step before the end, where angle and rate may differ by rates of 1e-2 rad/s.
    at_rest = robot.yaw_stiffness * (target - angle)[::2] - effort[::2]
    assert np.abs(at_rest).max() < robot.yaw_damping * 2e-2 + robot.yaw_stiffness * 2e-2 * scene.dt
    # The joint did move: joint 3 began at 30 sin(-100) degrees = -0.516 rad.
    assert np.ptp([m.position[4] for m in curled.joint_states]) > 0.516 + 0.4 - bound
    assert max(np.abs(m.velocity).max() for m in curled.joint_states) > 1.0


def test_links_lie_on_the_ground(curled, scene):
    robot = scene.robot
    for message in curled.link_poses[::20]:
        assert message.header.frame_id == 'world'
        assert len(message.poses) == 11
        for pose in message.poses:
            o, axes = pose.orientation, wire_axes(pose.orientation)
            assert abs(o.w**2 + o.x**2 + o.y**2 + o.z**2 - 1) < 1e-12
            assert o.w >= 0
            lowest = pose.position.z - abs(axes[2, 0]) * robot.contact_offset
            assert -1e-5 <= lowest - robot.contact_radius < 1e-3
            # Flat: the z axis of the link points up, x and y are level.
            assert axes[:, 2] == pytest.approx([0, 0, 1], abs=1e-2)
        steps = np.diff(positions(message), axis=0)
        ahead = [wire_axes(pose.orientation)[:, 0] for pose in message.poses[:-1]]
        # x points along the link toward the next one, up to half the joint angle: cos > 0.7.
        assert (np.einsum('ij,ij->i', steps, ahead) > 0.7 * robot.link_length).all()


def test_odom_is_the_middle_link_with_its_twist_in_its_frame(lockstep, script_offline):
    for (_, link_poses, odom, _), sample in zip(lockstep[0][0], script_offline, strict=True):
        assert odom.header.frame_id == 'odom'
        assert odom.child_frame_id == 'base_link'
        assert odom.pose.pose.position == link_poses.poses[5].position
        axes, velocity = sample.axes[5] * [-1, -1, 1], sample.velocity[5]
        assert wire_axes(odom.pose.pose.orientation) == pytest.approx(axes, abs=ROUNDING)
        v, w = odom.twist.twist.linear, odom.twist.twist.angular
        # Up to 20 rad/s in a jerk, through rotation matrices with their rounding.
        assert [v.x, v.y, v.z] == pytest.approx(axes.T @ velocity[:3], abs=20 * ROUNDING)
        assert [w.x, w.y, w.z] == pytest.approx(axes.T @ velocity[3:], abs=20 * ROUNDING)
    assert max(abs(state[2].twist.twist.angular.z) for state in lockstep[0][0]) > 0.5


def test_one_step_while_paused_and_none_while_running(lockstep, curled):
    sim = lockstep[1][0]
    counts = [len(messages) for messages in sim.states]
    sim.graph.spin(0.1)
    assert [len(messages) for messages in sim.states] == counts
    refused = curled.graph.call(Trigger, 'sim/step')
    assert not refused.success
    assert refused.message == 'not paused: call ~/pause with true first'


def test_pause_stops_time_and_resumes_without_a_jump(curled):
    response = curled.pause(True)
    assert (response.success, response.message) == (True, 'paused')
    curled.graph.drain(curled.clock)  # which is published last
    counts = [len(messages) for messages in curled.states]
    last = nanoseconds(curled.joint_states[-1])
    curled.graph.spin(0.1)
    assert [len(messages) for messages in curled.states] == counts
    response = curled.pause(False)
    assert (response.success, response.message) == (True, 'running')
    curled.graph.until(lambda: len(curled.joint_states) > counts[0] + 5, 'states after the pause')
    resumed = [nanoseconds(message) for message in curled.joint_states[counts[0] :]]
    assert resumed[0] == last + PERIOD
    assert nanoseconds(curled.clock[-1]) < last + 1_000_000_000


def test_reset_restores_the_start_and_time_goes_on(curled, scene):
    before = nanoseconds(curled.joint_states[-1])
    response = curled.reset()
    assert response.success
    assert response.message.startswith('robot is at the start of the scene at t = ')
    start = Offline(scene).sample()

    def is_start(message):
        there = np.abs(np.array(message.position) - start.angle).max() <= 1e-12
        return there and nanoseconds(message) >= before

    curled.graph.until(
        lambda: any(is_start(m) for m in curled.joint_states[-400:]), 'the start posture'
    )
    message = next(m for m in curled.joint_states[-400:] if is_start(m))
    assert not any(message.velocity)
    stamps = [nanoseconds(message) for message in curled.joint_states]
    ticks = [nanoseconds(clock) for clock in curled.clock]
    assert stamps == sorted(stamps)
    assert ticks == sorted(ticks)
    # From there on the reference of the start is held: the joints hardly move.
    curled.advance_to(curled.now + 0.3)
    assert np.abs(np.array(curled.joint_states[-1].position) - start.angle).max() < 0.05


def test_diagnostics_tell_how_the_run_is_doing(sims):
    values = sims[0].values()
    assert values['level'] == 'planar'
    assert int(values['planar_steps']) == int(values['steps'])
    assert values['method'] == 'newton'
    assert int(values['steps']) > 0
    assert float(values['real_time_factor']) > 0.5
    # A tenth of a millimetre a second, and less than the radius of a hair under the floor.
    assert float(values['residual_max']) < 1e-4
    assert float(values['penetration_max']) < 1e-5
    assert int(values['unconverged_steps']) == 0
    assert int(values['rejected_commands']) == 0


@pytest.mark.parametrize(('index', 'number'), [(0, signal.SIGTERM), (1, signal.SIGINT)])
def test_nodes_end_well_on_signals(sims, index, number):
    # One sim is running and one is paused.
    process = sims[index].process
    assert process.stop(number) == 0, process.output
    assert 'Traceback' not in process.output


def set_factor(sim, factor):
    """Set the real-time factor of a node."""
    item = Parameter('real_time_factor', value=factor).to_parameter_msg()
    request = SetParameters.Request(parameters=[item])
    (result,) = sim.graph.call(SetParameters, 'sim/set_parameters', request).results
    assert result.successful, result.reason


def test_steps_that_outlast_their_period_are_told(sims):
    sim = sims[2]
    sim.reset()  # ends the stream of commands, so that its end is no warning
    begin, before = len(sim.process.lines), sim.process.count('longer than')
    set_factor(sim, 1000.0)  # periods of 5 us
    assert sim.pause(False).success
    sim.process.wait_for('longer than their publish period of 0.005 ms')
    what = (
        r'20 steps took \S+ ms, longer than their publish period of 0.005 ms: \S+ ms of it '
        r'the one at t = \S+ s; '
        r'(a step takes \S+ us of processor time, and 0.25 us would keep time'
        r'|other work had the processor for \S+ ms)'  # on a busy machine
    )
    sim.graph.until(lambda: sim.diagnostics and int(sim.values()['late_periods']) > 100, 'counts')
    took, when = re.fullmatch(r'(\S+) ms at t = (\S+) s', sim.values()['longest_step']).groups()
    assert float(took) > 0.0 and float(when) >= 0.0
    sim.graph.until(lambda: sim.now >= float(when), 'the time of that step')
    # The next warning is due a while after the first one; a part of this time it rests.
    assert sim.pause(True).success
    sim.graph.spin(0.4 * WARN_PERIOD)
    assert sim.pause(False).success
    slips = 'cannot keep up with real-time factor 1000, time slips: '
    sim.process.wait_for(slips)
    warnings = [line for line in sim.process.lines[begin:] if '[WARN]' in line]
    found = [re.fullmatch(r'\[WARN\] \[(\S+)\] \[sim\]: (.*)', line) for line in warnings]
    assert np.diff([float(match[1]) for match in found]).min() > 0.98 * WARN_PERIOD
    # On a busy machine it may have been late in lock-step just before.
    assert re.fullmatch((f'({slips})?' if before else '') + what, found[0][2])
    # There, other programs take the time as well, and after a pause no time has slipped yet.
    what = f'({slips})?({what}|messages or other programs take the time)'
    assert [match[2] for match in found[1:] if not re.fullmatch(what, match[2])] == []
    assert any(match[2].startswith(slips) for match in found[1:])


def test_node_as_fast_as_it_can_ends_well_on_sigterm(sims):
    sim = sims[2]
    set_factor(sim, 0.0)
    # The signal comes in the middle of a period.
    assert sim.process.stop(signal.SIGTERM) == 0, sim.process.output
    assert 'Traceback' not in sim.process.output


def test_what_is_told_how_often_and_for_how_long(monkeypatch):
    """Nodes of other tests have other values, see `loaded_physics` and `forks.node`."""
    meter, now, told = LoadMeter(), [0.0], []
    meter.restart(10.0)
    assert not meter.complete(10.99) and meter.complete(11.0)
    monkeypatch.setattr(executors, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    node = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=told.append))
    refusals = executors.Refusals(executors.ThrottledWarnings(node))
    counts = []
    for now[0] in (0.0, 4.9, 5.0):  # a warning of a kind every five seconds
        refusals.add('kind', 'why')
        counts.append(len(told))
    assert counts == [1, 1, 2]
    now[0] = 14.9
    assert refusals.remarks() == ['why']
    now[0] = 15.0
    assert not refusals.remarks()


def test_reasons_of_slow_steps():
    easy = Report(steps=20, iterations=20, iterations_max=1)
    hard = Report(steps=20, iterations=5019, iterations_max=5000, unconverged=1)
    assert reason(easy, 9e-3, 2e-3, 5e-3) == 'other work had the processor for 7 ms'
    assert reason(hard, 9e-3, 2e-3, 5e-3) == 'other work had the processor for 7 ms'
    assert reason(hard, 9e-3, 8e-3, 5e-3) == 'iterations 5000 at most, steps unconverged 1'
    assert reason(easy, 9e-3, 8e-3, 5e-3) == (
        'a step takes 400 us of processor time, and 250 us would keep time'
    )


@pytest.mark.usefixtures('terminal')
def test_steps_that_a_budget_cuts_are_told_and_counted(make_graph):
    # No step reaches this tolerance.
    never = 'level:=spatial', 'solver.residual_tolerance:=1.0e-300'
    sim = SimClient(make_graph(), 'iteration_budget:=100', 'real_time_factor:=0.1', *never)
    sim.wait_until_connected()
    told = 's were cut, since they share 100 iterations: residual '
    sim.process.wait_for(told)
    assert re.search(rf'[1-9]\d* of the 20 steps before t = \S+ {told}\S+ m/s', sim.process.output)
    sim.graph.until(lambda: sim.diagnostics and int(sim.values()['cut_steps']) > 20, 'counts')
    assert int(sim.values()['cut_steps']) <= int(sim.values()['unconverged_steps'])
    # Its terminal closes.
    assert sim.process.stop(signal.SIGHUP) == 0, sim.process.output
    assert 'Traceback' not in sim.process.output


def test_contacts_beyond_those_of_a_link_are_told_once_and_counted(make_graph, tmp_path):
    # A ball that seven upright poles around it nearly touch, of which six have a contact.
    angle, reach = 2.0 * np.pi * np.arange(7) / 7, 0.06 + 1e-9
    poles = ''.join(
        f'    - {{start: [{x}, {y}, 0.01], end: [{x}, {y}, 1.0], radius: 0.01}}\n'
        for x, y in zip(reach * np.cos(angle), reach * np.sin(angle), strict=True)
    )
    ball = 'robot: {link_count: 1, contact_radius: 0.05, contact_offset: 0.0}\n'
    (tmp_path / 'cage.yaml').write_text(f'{ball}world:\n  poles:\n{poles}', encoding='utf-8')
    sim = SimClient(make_graph(), f'scene:={tmp_path / "cage.yaml"}')
    told = 'links touch the world in more places than the 6 contacts of a sphere'
    sim.process.wait_for(told)
    assert int(sim.values()['overflows']) > 0
    assert sim.process.count(told) == 1


@pytest.mark.skipif(TransformMessages.available, reason='it says nothing before it is ready')
def test_node_ends_well_on_sigterm_while_it_starts():
    process = Process(node_command('sim'), next_domain())
    process.wait_for('tf2_msgs')  # what it says first, while it is being made
    assert process.stop(signal.SIGTERM) == 0, process.output
    assert 'Traceback' not in process.output


@pytest.mark.usefixtures('middleware')
def test_log_says_why_the_level_changes(monkeypatch):
    node, told = SimNode(), []
    monkeypatch.setattr(node.get_logger(), 'debug', told.append)
    node.begin(0.0)
    assert node.advance()
    node.set_parameters([Parameter('friction.rolling', value=0.1)])
    assert node.advance()
    node.destroy_node()
    assert told == [
        'level planar from t = 0.005 s on: the robot lies flat',
        'level spatial from t = 0.01 s on: friction.rolling is 0.1, and in the plane nothing '
        'rolls',
    ]


@pytest.mark.usefixtures('middleware')
def test_robots_keep_the_same_time_whatever_stops_one_of_them(monkeypatch):
    node = SimNode()
    pose = PoseStamped()
    pose.pose.position.z = 0.0525
    node.spawn_robot('two', '/two', pose)
    first, two = node.robots.values()

    def counts():
        return [robot.simulation.step_count for robot in node.robots.values()]

    def refuse(most):
        raise NotCompiledError

    # The first has its steps while the compiler makes those of the other; it does not repeat them.
    node.compiler = SimpleNamespace(levels=['planar', 'spatial'], needed=0, awaited='')
    with monkeypatch.context() as patch:
        patch.setattr(two, 'advance', refuse)
        assert not node.advance() and not node.advance()
        assert counts() == [20, 0] and node.compiler.needed == 2
    assert node.advance()
    assert counts() == [20, 20]
    # One that diverges halts all, between two periods; a reset begins at the next one.
    two.simulation.step_count += 7
    two.simulation.report.failure = 'too far'
    assert node.failure == 'too far' and node.halted
    node.step(3)
    assert counts() == [20, 27]
    node.reset()
    assert counts() == [40, 40] and not node.failure
    assert first.simulation.state.q[5, :2] != pytest.approx(two.simulation.state.q[5, :2])
    assert two.simulation.state.q[5, :2] == pytest.approx([0.0, 0.0], abs=1e-12)
    node.delete_robot('two')
    node.destroy_node()


@pytest.fixture
def terminal():
    """Have processes heed SIGHUP, which nohup may have this test ignore."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures('terminal')
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_node_ends_well_while_it_imports(number):
    process = Process(node_command('sim'), next_domain())
    status, deadline = Path(f'/proc/{process.popen.pid}/status'), time.monotonic() + 10
    heeded = 1 << (signal.SIGTERM - 1) | 1 << (number - 1)  # Python itself heeds SIGINT earlier
    while int(re.search(r'SigCgt:\s*(\w+)', status.read_text())[1], 16) & heeded != heeded:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    assert process.stop(number) == 0
    assert not process.output
