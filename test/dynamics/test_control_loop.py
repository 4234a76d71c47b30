# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The control loop of a real robot on every method: samples, delays, encoders and torques."""

from dataclasses import replace

from hinges import AXES, DT, EVERY, floating, hinge, of_joint
import numpy as np
import pytest

from snake_sim_ros import ParameterError, Robot, Simulation
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.controlled import command_effort, commanded_effort
from snake_sim_ros.stepping.methods import make_stepper, METHODS
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.stepping.state import initial_state


def angles(scene, axis, references, rate=0.0, period=0):
    """
    Return the joint angles after every step, for references that move at a rate [rad/s].

    Forces jump once a period, in steps, if any.
    """
    stepper, state = make_stepper(scene), hinge(scene, axis, 0.0)
    history, found = stepper.empty_history(), []
    for k, reference in enumerate(references):
        if period and k % period == 0 and history.memory:
            history.memory.forces_jump()
        commanded = np.zeros((2, 1, 1, 2))
        commanded[:, 0, 0, AXES[axis]] = reference, rate
        state, history, report = stepper.advance(state, history, *commanded)
        assert not report.failure and not report.unconverged
        found.append(of_joint(state, axis)[0])
    return np.array(found)


def sampled_hinge(scene, stiffness, references, period, resolution=0.0):
    """
    Return the angles of a hinge whose spring is read once a period; the torque is constant since.

    Each link turns about its own center: the relative acceleration is 2 torque/Theta.
    """
    angle, rate, found = 0.0, 0.0, []
    for k, reference in enumerate(references):
        if k % period == 0:
            read = resolution * np.floor(angle / resolution + 0.5) if resolution else angle
            acceleration = 2 * stiffness * (reference - read) / scene.robot.inertia_transversal
        angle += DT * rate + DT**2 / 2 * acceleration
        rate += DT * acceleration
        found.append(angle)
    return np.array(found)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
@pytest.mark.parametrize('resolution', [0.0, 2e-3])
def test_a_sampled_spring_is_a_recursion(method, axis, resolution):
    stiffness, references = 0.05, np.full(40, 0.02)
    scene = floating(
        method, control_rate=200.0, encoder_resolution=resolution,
        **{f'{axis}_stiffness': stiffness},
    )  # fmt: skip
    expected = sampled_hinge(scene, stiffness, references, 5, resolution)
    found = angles(scene, axis, references)
    # The links turn by up to 0.04, whose square is lost in the closed form.
    assert np.abs(found - expected).max() < (1e-4 + 0.04**2) * np.abs(expected).max()


PERIOD, GAIN = 2e-3, 2.0  # s, N m/rad
LOOPS = {
    'undamped': (0.0, {}),
    'late': (0.0, {'command_delay': 4 * PERIOD}),
    'damped': (5e-3, {'reference_rate': 1 / PERIOD, 'command_delay': PERIOD}),
}


def told(time):
    """Return references [rad]. The hinge follows them so closely that it is linear up to 1e-6."""
    return 1e-3 * np.sin(40.0 * time + 0.5)


def held_hinge(inertia, damping, torques):
    """
    Return the angle of a hinge whose torques change once a period, from rest; the exact map.

    Each link turns about its own center, as in `sampled_hinge`. `torques` is a function of the
    period and the angle at its start.
    """
    angle = rate = 0.0
    slowing = 2 * damping / inertia
    decay = np.exp(-slowing * PERIOD)
    for k in range(20):
        push = 2 * torques(k, angle) / inertia
        if slowing == 0.0:
            angle, rate = angle + PERIOD * (rate + PERIOD / 2 * push), rate + PERIOD * push
        else:
            final = push / slowing
            angle += PERIOD * final + (rate - final) * (1.0 - decay) / slowing
            rate = final + (rate - final) * decay
    return angle


@pytest.mark.parametrize(('method', 'axis'), EVERY)
@pytest.mark.parametrize('name', LOOPS)
def test_a_sampled_controller_is_of_second_order(method, axis, name):
    damping, loop = LOOPS[name]
    gains = {f'{axis}_stiffness': GAIN, f'{axis}_damping': damping}
    scene = floating(method, control_rate=1 / PERIOD, **gains, **loop)
    delay, errors = loop.get('command_delay', 0.0), []
    exact = held_hinge(
        scene.robot.inertia_transversal, damping,
        lambda k, angle: GAIN * (told(max(0.0, k * PERIOD - delay)) - angle),
    )  # fmt: skip
    for share in (2, 4, 8):
        dt = PERIOD / share
        references = np.zeros((2, 20 * share, 1, 2))
        time = (np.arange(20 * share) + 0.5) * dt
        references[0, :, 0, AXES[axis]] = told(time)
        references[1, :, 0, AXES[axis]] = 40e-3 * np.cos(40.0 * time + 0.5)
        stepper = make_stepper(replace(scene, dt=dt))
        state, _, _ = stepper.advance(
            hinge(scene, axis, 0.0), stepper.empty_history(), *references
        )
        errors.append(of_joint(state, axis)[0] - exact)
    orders = np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))
    assert np.abs(orders - 2.0).max() <= 0.3
    assert abs(errors[-1]) < 1e-4 * abs(exact)


@pytest.mark.parametrize('method', METHODS)
def test_held_efforts_are_constant_forces(method):
    scene = floating(method, effort_commands=True)
    simulation, zeros = Simulation(scene), np.zeros((2, 1, 2))
    simulation.state = hinge(scene, 'yaw', 0.0)
    exact = held_hinge(scene.robot.inertia_transversal, 0.0, lambda k, _: told(k * PERIOD))
    for k in range(20):
        command_effort(simulation, np.array([[told(k * PERIOD), 0.0]]))
        simulation.advance(zeros, zeros)
    # The links come nearer to each other by angle^2, as in test_joint_laws.
    assert of_joint(simulation.state, 'yaw')[0] == pytest.approx(exact, rel=2 * exact**2 + 1e-9)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
@pytest.mark.parametrize('rates', [{'control_rate': 200.0}, {'reference_rate': 200.0}])
def test_a_moving_reference_is_read_at_the_time_of_the_reading(method, axis, rates):
    # References are told for the middle of a step, (k + 1/2) dt; a reading is at its start, k dt.
    # A spring that is read then, or whose reference is held since then, does what it does with
    # references that stand still from reading to reading.
    stiffness, speed, k = 0.05, 1.0, np.arange(40)
    scene = floating(method, **{f'{axis}_stiffness': stiffness}, **rates)
    found = angles(scene, axis, speed * (k + 0.5) * DT, speed)
    standing = angles(scene, axis, speed * (k - k % 5) * DT)
    # References are rounded to 1e-17; forty steps add that up with a dozen of their own.
    assert np.abs(found - standing).max() < 1e-12
    assert np.abs(found).max() > 5e-4


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_delay_shifts_the_motion(method, axis):
    scene = floating(method, **{f'{axis}_stiffness': 0.5, f'{axis}_damping': 0.01})
    references = np.concatenate([[0.0], np.sin(0.3 * np.arange(30)) * 0.05])
    prompt = angles(scene, axis, references)
    late = angles(
        replace(scene, robot=replace(scene.robot, command_delay=7 * DT)), axis, references
    )
    assert np.abs(late[:7]).max() < 1e-12
    # Before the first command counts the robot is at rest; then it does the same, up to rounding.
    assert np.abs(late[7:] - prompt[:-7]).max() < 1e-10


@pytest.mark.parametrize('method', METHODS)
def test_a_reference_is_held_for_a_period(method):
    scene = floating(method, yaw_stiffness=0.5, yaw_damping=0.01)
    references = 0.05 * np.sin(0.3 * np.arange(30))
    held = replace(scene, robot=replace(scene.robot, reference_rate=200.0))
    every_fifth = references[5 * (np.arange(30) // 5)]
    found = angles(held, 'yaw', references)
    assert np.abs(found - angles(scene, 'yaw', every_fifth, period=5)).max() < 1e-12


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_commanded_torque_accelerates(method, axis):
    effort, steps = 1e-2, 10
    scene = floating(method, effort_commands=True)
    stepper, zeros = make_stepper(scene), np.zeros((steps, 1, 2))
    history = stepper.empty_history()
    history.control.effort[0, AXES[axis]] = effort
    state, _, report = stepper.advance(hinge(scene, axis, 0.0), history, zeros, zeros)
    acceleration = 2 * effort / scene.robot.inertia_transversal
    angle, rate = of_joint(state, axis)
    assert rate == pytest.approx(acceleration * steps * DT, rel=2 * angle**2 + 1e-9)
    assert report.joint_torque[0, AXES[axis]] == pytest.approx(effort, rel=1e-12)


@pytest.mark.parametrize('method', METHODS)
def test_a_commanded_torque_is_limited(method):
    scene = floating(method, effort_commands=True, yaw_torque_limit=2e-3)
    stepper, zeros = make_stepper(scene), np.zeros((3, 1, 2))
    history = stepper.empty_history()
    history.control.effort[0, 0] = 1.0
    _, _, report = stepper.advance(hinge(scene, 'yaw', 0.0), history, zeros, zeros)
    assert report.joint_torque[0, 0] == pytest.approx(2e-3, rel=1e-12)


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_calls_of_any_length_are_the_same_bits(method):
    settings = {'robot.reference_rate': 50.0, 'robot.command_delay': 0.03, 'method': method}
    scene = with_settings(load_scene('sidewinding'), settings | {'dt': 1 / 200, 'duration': 0.5})
    assert not simulate(scene, rate=100).report.failure
    angle = np.zeros((100, 10, 2))
    angle[:, :, 0] = np.linspace(0.0, 0.3, 100)[:, None]
    ends = []
    for length in (100, 7, 1):
        stepper = make_stepper(scene)
        state, history = initial_state(scene), stepper.empty_history()
        for start in range(0, 100, length):
            part = angle[start : start + length]
            state, history, _ = stepper.advance(state, history, part, np.zeros(part.shape))
        ends.append(state)
    for end in ends[1:]:
        assert (end.q == ends[0].q).all() and (end.u == ends[0].u).all()


def test_no_more_than_the_scene_needs_is_kept():
    history = make_stepper(load_scene('lateral_undulation')).empty_history()
    assert sum(part.size for part in history.control) == 3  # counters


@pytest.mark.parametrize(
    ('settings', 'said'),
    [
        ({'robot.control_rate': 300.0}, 'dt must divide the control period'),
        ({'robot.reference_rate': 300.0}, 'dt must divide the reference period'),
        ({'robot.command_delay': 1.3e-4}, 'dt must divide the robot.command_delay'),
        ({'robot.control_rate': -1.0}, 'control_rate must be at least 0 Hz'),
        ({'robot.control_rate': float('nan')}, 'control_rate must be finite'),
        ({'robot.encoder_resolution': 2.0}, 'encoder_resolution must be at most 1 rad'),
        ({'robot.command_delay': 11.0}, 'command_delay must be at most 10 s'),
    ],
)
def test_what_does_not_fit_is_one_sentence(settings, said):
    with pytest.raises(ParameterError, match=said):
        make_stepper(with_settings(load_scene('sidewinding'), settings))


def test_a_loop_is_at_the_spatial_level():
    scene = with_settings(load_scene('lateral_undulation'), {'robot.reference_rate': 1000.0})
    assert set(simulate(replace(scene, duration=0.05)).level) == {'spatial'}
    with pytest.raises(ParameterError, match='control loop'):
        make_stepper(replace(scene, level='planar'))


def test_defaults_are_none():
    robot = Robot()
    assert robot.control_rate == robot.reference_rate == robot.command_delay == 0.0
    assert robot.encoder_resolution == 0.0
    assert not robot.effort_commands


def test_efforts_of_a_simulation_act_until_the_next_ones():
    scene = replace(floating('newton', effort_commands=True))
    simulation, zeros = Simulation(scene), np.zeros((1, 1, 2))
    simulation.state = hinge(scene, 'yaw', 0.0)
    acceleration = 2 * 1e-2 / scene.robot.inertia_transversal
    for k in range(10):  # single steps go on in place from the third one
        command_effort(simulation, np.array([[1e-2 if k < 5 else 0.0, 0.0]]))
        assert commanded_effort(simulation)[0, 0] == (1e-2 if k < 5 else 0.0)
        simulation.advance(zeros, zeros)
    assert of_joint(simulation.state, 'yaw')[1] == pytest.approx(5 * DT * acceleration, rel=1e-6)
    simulation.reset()
    assert not commanded_effort(simulation).any()


@pytest.mark.parametrize(
    ('effort', 'said'),
    [
        (np.zeros((2, 2)), r'shape \(1, 2\), got \(2, 2\)'),
        (np.array([[np.nan, 0.0]]), r'finite, got nan at \[0, 0\]'),
    ],
)
def test_efforts_that_are_not_usable_are_refused(effort, said):
    simulation = Simulation(floating('newton', effort_commands=True))
    with pytest.raises(ParameterError, match=said):
        command_effort(simulation, effort)
    with pytest.raises(ParameterError, match='effort_commands'):
        command_effort(Simulation(floating('newton')), np.zeros((1, 2)))
