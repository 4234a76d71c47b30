# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limited torque, dry friction and stops of the joints: closed forms on every method."""

from dataclasses import fields, replace
import json
from pathlib import Path
import re

from hinges import AXES, balls, DT, EVERY, floating, hinge, INERTIA, of_joint
import numpy as np
from processes import python
import pytest

from snake_sim_ros import Gait, ParameterError, Robot, Scene, Solver, State, Wave
from snake_sim_ros.commands.main import main
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles, joint_rates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import make_stepper, METHODS, what_is_not_planar
from snake_sim_ros.stepping.simulation import simulate

ROOT = Path(__file__).resolve().parents[2]
# The rate of a joint that is held is rounded in sweeps over links, or in dense matrices.
HELD = 1e-10  # rad/s


def steps(
    stepper: Stepper, state: State, count: int, angle: float = 0.0, axis: str = 'yaw'
) -> tuple[State, object]:
    """Return the state and the report after some steps with a constant reference."""
    references = np.zeros((count, 1, 2))
    references[:, 0, AXES[axis]] = angle
    zeros = np.zeros((count, 1, 2))
    state, _, report = stepper.advance(state, stepper.empty_history(), references, zeros)
    assert report.unconverged == 0 and not report.failure
    return state, report


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_limited_torque_turns_a_joint_with_constant_acceleration(method, axis):
    # Each link turns about its own center: the relative acceleration is 2 L/Theta.
    limit, time = 1e-2, 0.01
    scene = floating(method, **{f'{axis}_stiffness': 40.0, f'{axis}_torque_limit': limit})
    state, report = steps(make_stepper(scene), hinge(scene, axis, 0.0), 10, 0.3, axis)
    angle, rate = of_joint(state, axis)
    acceleration = 2 * limit / scene.robot.inertia_transversal
    # The links come nearer to each other by angle^2: their centers move along the robot.
    assert rate == pytest.approx(acceleration * time, rel=2 * angle**2 + 1e-9)
    assert angle == pytest.approx(acceleration * time**2 / 2, rel=2e-3)
    assert report.joint_torque[0, AXES[axis]] == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_dry_friction_holds_a_joint_at_rest(method, axis):
    # The controller pulls with 40 * 0.002 = 0.08 N m, and friction takes up to 0.1 N m.
    scene = floating(method, **{f'{axis}_stiffness': 40.0, 'joint_friction': 0.1})
    start = hinge(scene, axis, 0.0)
    state, report = steps(make_stepper(scene), start, 20, 0.002, axis)
    assert report.joint_torque[0, AXES[axis]] == pytest.approx(0.08, rel=1e-6)
    angle, rate = of_joint(state, axis)
    assert abs(rate) < HELD and abs(angle) < 20 * DT * HELD
    state, _ = steps(make_stepper(scene), start, 20, 0.01, axis)  # 0.4 N m move it
    assert of_joint(state, axis)[0] > 1e-4


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_dry_friction_stops_a_hinge_in_finite_time(method, axis):
    # The rate falls by 2 F/Theta a second, to 0.
    friction, rate = 0.01, 0.2
    scene = floating(method, joint_friction=friction)
    slowing = 2 * friction / scene.robot.inertia_transversal
    moving, _ = steps(make_stepper(scene), hinge(scene, axis, rate), 5)
    assert of_joint(moving, axis)[1] == pytest.approx(rate - slowing * 5 * DT, rel=1e-5)
    rest, _ = steps(make_stepper(scene), hinge(scene, axis, rate), 20)
    angle, left = of_joint(rest, axis)
    assert abs(left) < HELD
    # The step in which it stops is the only one that is not exact.
    assert angle == pytest.approx(rate**2 / (2 * slowing), abs=slowing * DT**2)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_viscous_friction_lets_a_rate_decay(method, axis):
    # The rate decays with the time constant Theta/(2 V); methods are of first order at least.
    viscous, rate, time = 1e-3, 0.2, 0.01
    scene = replace(floating(method, joint_viscous_friction=viscous), dt=DT / 10)
    state, _ = steps(make_stepper(scene), hinge(scene, axis, rate), 100)
    decay = 2 * viscous / scene.robot.inertia_transversal
    expected = rate * np.exp(-decay * time)
    assert of_joint(state, axis)[1] == pytest.approx(expected, rel=decay * DT / 10)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_joint_turns_at_its_largest_rate_at_most(method, axis):
    # The spring would turn the joint at 33 rad/s within a step.
    scene = floating(method, rate_stop=True, joint_rate_limit=0.5, **{f'{axis}_stiffness': 40.0})
    stepper, rates = make_stepper(scene), []
    for count in (5, 50):
        state, _ = steps(stepper, hinge(scene, axis, 0.0), count, 0.4, axis)
        rates.append(of_joint(state, axis)[1])
    # The links come nearer to each other, and their centers move along the robot.
    assert rates == pytest.approx([0.5, 0.5], rel=2e-2)
    # It is no stop of the angle: nothing lands, and the joint goes back as fast.
    back, _ = steps(stepper, state, 50, -0.4, axis)
    assert of_joint(back, axis)[1] == pytest.approx(-0.5, rel=2e-2)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
@pytest.mark.parametrize('way', [1.0, -1.0])
def test_a_stop_ends_the_motion_of_a_joint_without_bounce(method, axis, way):
    # Both links turn against each other, so that nothing is left of their motion.
    limit, rate = 0.02, 2.0
    scene = floating(method, joint_stop=True)
    scene = replace(scene, robot=replace(scene.robot, joint_limit=limit))
    state, _ = steps(make_stepper(scene), hinge(scene, axis, way * rate), 40)
    angle, left = of_joint(state, axis)
    beyond = 1e-12 if method == 'bdf2' else rate * DT
    assert limit - 1e-12 <= abs(angle) <= limit + beyond
    assert abs(left) < HELD
    # What the links have come nearer to each other by is momentum along them, and none in all.
    assert np.abs(state.u[:, :3].sum(axis=0)).max() < 1e-12
    assert np.abs(state.u).max() < limit


@pytest.mark.parametrize(('method', 'axis'), EVERY)
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_stops_are_where_the_limits_of_the_axis_are(method, axis, sign):
    # As above; an axis that points down or to the right turns the other way in the model. The last
    # range does not have 0 in it: the joint starts at 0.1 rad.
    rate = 2.0
    for lower, upper, start in ((-0.02, 0.05, 0.0), (-0.05, 0.02, 0.0), (0.07, 0.2, 0.1)):
        limits = {'lower': lower, 'upper': upper}
        scene = balls(method, axis, sign=sign, limits=limits, joint_stop=True)
        stepper, robot = make_stepper(scene), scene.robot
        for way, stop in ((1.0, upper), (-1.0, lower)):
            state = hinge(scene, axis, sign * way * rate)
            bend = np.zeros((1, 2))
            bend[0, AXES[axis]] = sign * start
            state.q[:, 3:] = chain_coordinates(robot, bend)[:, 3:]
            state, _ = steps(stepper, state, 60, sign * start, axis)
            (angle,), (left,) = (
                robot.by_axis(each)
                for each in (joint_angles(state.q, robot), joint_rates(state.q, state.u, robot))
            )
            beyond = 1e-12 if method == 'bdf2' else rate * DT
            assert -1e-12 <= way * (angle - stop) <= beyond
            assert abs(left) < HELD


@pytest.mark.parametrize('method', METHODS)
def test_each_axis_of_a_joint_has_limits_of_its_own(method):
    # Both axes are led to 1 rad: they go at their own rates, 0.5 and 0.25 rad/s, to the stops.
    limits = {'lower': -0.1, 'upper': (0.02, 0.03), 'rate': (0.5, 0.25)}
    stiff = {
        'yaw_stiffness': 40.0,
        'pitch_stiffness': 40.0,
        'yaw_damping': 0.1,
        'pitch_damping': 0.1,
    }
    scene = balls(method, 'yaw', 'pitch', limits=limits, joint_stop=True, rate_stop=True, **stiff)
    stepper, ends = make_stepper(scene), []
    state, history = hinge(scene, 'yaw', 0.0), stepper.empty_history()
    for _ in range(2):
        count = 30 if not ends else 120
        state, history, _ = stepper.advance(
            state, history, np.ones((count, 1, 2)), np.zeros((count, 1, 2))
        )
        ends.append(joint_angles(state.q, scene.robot)[0])
    # Within the step in which the motion begins, and that of the stop.
    assert ends[0] == pytest.approx([0.5 * 30 * DT, 0.25 * 30 * DT], abs=0.5 * DT)
    beyond = 1e-9 if method == 'bdf2' else 0.5 * DT
    assert ends[1] == pytest.approx([0.02, 0.03], abs=beyond)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_joint_turns_beyond_a_right_angle(method, axis):
    # A spring K without a damper takes it from 0 to 149 degrees and back, twice:
    # angle = A (1 - cos(w t)), w^2 = 2 K/INERTIA. The phase of the mean controller is off by
    # (w h)^2/12 of w t, that of two steps backward by (w h)^2/3. Angles of a step are those of
    # half tangents, off by (rate h)^2/12.
    K, A, count = 2.0, 1.3, 200
    scene = balls(method, axis, **{f'{axis}_stiffness': K})
    w, t, stepper = np.sqrt(2 * K / INERTIA), DT * np.arange(1, count + 1), make_stepper(scene)
    reference = np.zeros((1, 1, 2))
    reference[0, 0, AXES[axis]] = A
    state, history, path = hinge(scene, axis, 0.0), stepper.empty_history(), []
    for _ in range(count):
        state, history, report = stepper.advance(state, history, reference, np.zeros((1, 1, 2)))
        path.append(of_joint(state, axis))
        # A joint of one axis keeps it, as far as it turns.
        assert max(report.joint_gap_max, report.joint_twist_max) < 1e-14
    angle, rate = np.array(path).T
    late = (w * DT) ** 2 / (3 if method == 'bdf2' else 12)
    late += (A * w * DT) ** 2 / 12
    assert np.degrees(angle.max()) == pytest.approx(149, abs=0.1)
    assert np.abs(angle - A * (1 - np.cos(w * t))).max() < A * w * t[-1] * late
    # Its energy is that of the spring; two steps backward take (w h)^4/2 of it in each step.
    energy = (INERTIA / 4 * rate**2 + K / 2 * (angle - A) ** 2) / (K / 2 * A**2)
    lost = count * (w * DT) ** 4 / 2 if method == 'bdf2' else 0.0
    assert np.abs(energy - 1).max() < 1.1 * lost + (A * w * DT) ** 2 / 12


@pytest.mark.parametrize(('method', 'order'), [('newton', 1), ('bdf2', 3)])
@pytest.mark.parametrize('goal', [(2.6, -2.6), (np.pi / 2, np.pi / 2), (-2.9, 1.6)])
def test_both_axes_of_a_joint_turn_beyond_a_right_angle(method, order, goal):
    # The axes stay at right angles, so that no posture is singular. They are led there in 0.3 s.
    # What moment of momentum the balls have then is an error of the step, of its order.
    gains = {f'{axis}_stiffness': 2.0 for axis in AXES} | {
        f'{axis}_damping': 0.05 for axis in AXES
    }
    scene, moments = balls(method, 'yaw', 'pitch', **gains), []
    for dt in (DT, DT / 2):
        count = round(0.6 / dt)
        t = dt * (np.arange(count) + 0.5)[:, None, None]
        stepper, start = make_stepper(replace(scene, dt=dt)), hinge(scene, 'yaw', 0.0)
        angle, rate = np.minimum(t / 0.3, 1.0) * goal, (t < 0.3) / 0.3 * goal
        state, _, report = stepper.advance(start, stepper.empty_history(), angle, rate)
        assert not report.unconverged and not report.failure
        # What is beside the reference falls with exp(-D/INERTIA t), by e^-15.
        assert joint_angles(state.q, scene.robot)[0] == pytest.approx(goal, abs=1e-6)
        spin = np.einsum('nij,nj->i', rotation_matrices(state.q[:, 3:]), state.u[:, 3:])
        moments.append(float(np.linalg.norm(spin)))
    assert np.log2(moments[0] / moments[1]) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_joint_stays_at_its_stop_while_the_robot_turns(method, axis):
    # The controllers press one axis of both joints on, and the other axes swing. The drift of
    # single steps would add up to 2.2 mrad in 150 ms.
    limit, fastest, other = 0.5, 5.0, 'pitch' if axis == 'yaw' else 'yaw'
    stops = {'joint_stop': True, 'rate_stop': True, 'joint_rate_limit': fastest}
    scene = floating(method, **stops, **{f'{axis}_stiffness': 40.0, f'{other}_stiffness': 0.2})
    scene = replace(scene, robot=replace(scene.robot, link_count=3), dt=DT / 2)
    bend, sides = np.zeros((2, 2)), np.array([1.0, -1.0])
    bend[:, AXES[axis]], bend[:, AXES[other]] = limit * sides, -0.6
    q = chain_coordinates(scene.robot, bend)
    q[:, 2] += 1.0
    turn = np.array([15.0, 15.0, -15.0])
    u = np.hstack([np.cross(turn, q[:, :3]), turn @ rotation_matrices(q[:, 3:])])
    stepper, angle, angles = make_stepper(scene), np.zeros((20, 2, 2)), []
    angle[:, :, AXES[axis]] = (limit + 0.1) * sides
    state, history = State(q, u), stepper.empty_history()
    for _ in range(15):
        state, history, _ = stepper.advance(state, history, angle, np.zeros(angle.shape))
        angles.append(sides * joint_angles(state.q)[:, AXES[axis]])
    # A stop that is met in a step acts from its middle.
    beyond = 1e-12 if method == 'bdf2' else fastest * scene.dt / 2
    assert limit - beyond < np.min(angles) and np.max(angles) <= limit + beyond


@pytest.mark.parametrize(('method', 'axis'), EVERY)
def test_a_stop_does_not_hold_a_joint_back(method, axis):
    scene = floating(method, joint_stop=True, **{f'{axis}_stiffness': 1.0, f'{axis}_damping': 0.1})
    limit = 0.02
    scene = replace(scene, robot=replace(scene.robot, joint_limit=limit))
    stepper = make_stepper(scene)
    there, _ = steps(stepper, hinge(scene, axis, 0.0), 400, 0.3, axis)
    assert of_joint(there, axis)[0] == pytest.approx(limit, abs=1e-3)
    back, _ = steps(stepper, there, 600, 0.0, axis)
    assert abs(of_joint(back, axis)[0]) < 2e-3


def lying(method: str, limit: float) -> Scene:
    """Return three links on the floor whose first pitch joint has to lift a link."""
    robot = Robot(link_count=3, pitch_torque_limit=limit)
    return Scene(robot=robot, method=method, dt=DT, level='spatial', solver=Solver(tolerance=1e-9))


@pytest.mark.parametrize('method', METHODS)
def test_a_joint_lifts_a_link_only_with_enough_torque(method):
    # Half of the link beyond the joint: m g L/2 = 0.408 N m.
    needed = lying(method, 1.0).robot.link_mass * 9.81 * 0.061
    angle = np.zeros((100, 2, 2))
    angle[:, 0, 1] = -0.1  # link 2 up against link 1, both by their outer ends
    for limit, lifts in ((0.9 * needed, False), (2.0 * needed, True)):
        scene = lying(method, limit)
        stepper = make_stepper(scene)
        q = chain_coordinates(scene.robot, np.zeros((2, 2)))
        q[:, 2] = scene.robot.contact_radius
        state, _, report = stepper.advance(
            State(q, np.zeros((3, 6))), stepper.empty_history(), angle, np.zeros(angle.shape)
        )
        # Projections need more than their limit of iterations in steps in which contacts open.
        assert report.unconverged <= 3
        assert np.abs(report.joint_torque[:, 1]).max() <= limit * (1 + 1e-9)
        raised = -joint_angles(state.q)[0, 1]
        assert raised > 0.01 if lifts else abs(raised) < 1e-5


@pytest.mark.parametrize('method', METHODS)
def test_a_step_takes_no_more_iterations_than_its_limit(method):
    laws = {'joint_friction': 0.05, 'pitch_torque_limit': 0.5, 'joint_stop': True}
    robot = Robot(link_count=3, joint_limit=0.05, **laws)
    solver = Solver(iteration_limit=2)
    scene = Scene(robot=robot, method=method, dt=DT, level='spatial', solver=solver)
    q, u = chain_coordinates(robot, np.zeros((2, 2))), np.zeros((3, 6))
    q[:, 2], u[:, 5] = robot.contact_radius, 1.0
    angle = np.tile([[0.0, -0.2], [0.3, 0.0]], (20, 1, 1))
    stepper = make_stepper(scene)
    start = State(q, u), stepper.empty_history()
    *_, report = stepper.advance(*start, angle, np.zeros(angle.shape))
    # Steps of bdf2 are solved in parts, and again with contacts that approach and for an impact.
    most = 8 if method == 'bdf2' else 2
    assert report.iterations <= most * report.steps
    assert report.iterations_max <= most


@pytest.mark.parametrize('method', METHODS)
def test_a_limit_gives_no_energy(method):
    # A controller with a limit is a spring whose energy grows linearly beyond it, and a damper.
    stiffness, limit = 20.0, 0.05
    scene = floating(method, yaw_stiffness=stiffness, pitch_stiffness=stiffness,
                     yaw_torque_limit=limit, pitch_torque_limit=limit)  # fmt: skip
    scene = replace(scene, pd_scheme='end')
    stepper, state = make_stepper(scene), hinge(scene, 'yaw', 3.0)
    history, zeros = stepper.empty_history(), np.zeros((1, 1, 2))
    robot, energies = scene.robot, []
    inertia = np.array([robot.inertia_transversal, robot.inertia_transversal, robot.inertia_axial])
    for _ in range(60):
        state, history, _ = stepper.advance(state, history, zeros, zeros)
        kinetic = robot.link_mass * (state.u[:, :3] ** 2).sum() / 2
        kinetic += (inertia * state.u[:, 3:] ** 2).sum() / 2
        bend, most = np.abs(joint_angles(state.q)), limit / stiffness
        inside = np.minimum(bend, most)
        stored = (stiffness * inside**2 / 2 + limit * (bend - inside)).sum()
        energies.append(kinetic + stored)
    # The links turn by 3 mrad in a step, and the geometry is known to the square of that. The
    # formula of two steps does not bound the energy of a single step.
    allowed = 2e-2 if method == 'bdf2' else (3.0 * DT) ** 2
    assert np.diff(energies).max() <= allowed * energies[0]
    assert energies[-1] <= energies[0] * (1 + allowed)


@pytest.mark.parametrize('method', METHODS)
def test_levels_agree_with_a_limit_and_with_stops(method):
    limited = {'robot.yaw_torque_limit': 0.6, 'robot.joint_viscous_friction': 0.01}
    stopped = {'robot.joint_stop': True, 'robot.joint_limit': 0.53}
    for settings in (limited, stopped):
        ends = []
        for level in ('planar', 'spatial'):
            scene = with_settings(
                load_scene('lateral_undulation'),
                settings | {'method': method, 'level': level, 'duration': 0.3, 'dt': 1e-3},
            )
            trajectory = simulate(scene)
            ends.append(trajectory.position[-1, 5, :2])
            assert not trajectory.report.failure
            if 'robot.joint_stop' not in settings:
                assert np.abs(trajectory.joint_torque[:, ::2]).max() <= 0.6 + 1e-9
            else:
                assert np.abs(trajectory.joint_angle).max() <= 0.53 + 2e-3
        way = np.linalg.norm(ends[1] - trajectory.position[0, 5, :2])
        assert np.linalg.norm(ends[0] - ends[1]) < 5e-3 * way


def test_a_pitch_limit_that_cannot_hold_the_robot_flat_takes_it_to_space():
    scene = with_settings(
        load_scene('lateral_undulation'),
        {'robot.pitch_torque_limit': 0.01, 'duration': 0.5, 'method': 'newton', 'dt': 1e-3},
    )
    trajectory = simulate(scene)
    assert 'spatial' in trajectory.level and not trajectory.report.failure
    assert np.abs(trajectory.joint_torque[:, 1::2]).max() <= 0.01 * (1 + 1e-9)
    assert 'torque than its limit' in simulate(replace(scene, level='planar')).report.failure


def test_dry_friction_of_pitch_joints_is_not_planar():
    scene = with_settings(load_scene('lateral_undulation'), {'robot.joint_friction': 0.1})
    assert 'joint_friction' in what_is_not_planar(scene)
    assert set(simulate(replace(scene, duration=0.05)).level) == {'spatial'}


@pytest.mark.parametrize(
    ('name', 'value', 'said'),
    [
        ('yaw_torque_limit', -1.0, 'at least 0'),
        ('pitch_torque_limit', np.nan, 'finite'),
        ('yaw_torque_limit', (1.0, 2.0), '10 joints'),
        ('joint_friction', np.inf, 'finite'),
        ('joint_friction', 'much', 'number'),
        ('joint_viscous_friction', -0.1, 'at least 0'),
        ('joint_stop', 3, 'true or false'),
    ],
)
def test_a_value_that_is_not_usable_is_one_sentence(name, value, said):
    with pytest.raises(ParameterError, match=said) as caught:
        Robot(**{name: value})
    assert name in str(caught.value)


def test_every_joint_may_have_its_own_limit():
    robot = Robot(link_count=3, yaw_torque_limit=(1.0, 2.0), joint_friction=(0.1, 0.0))
    assert robot.per_joint('torque_limit').tolist() == [[1.0, np.inf], [2.0, np.inf]]
    assert robot.per_joint('friction').tolist() == [[0.1, 0.1], [0.0, 0.0]]


def test_random_loads_satisfy_the_laws_on_a_moving_robot():
    # T20 for the joints: every sample of sidewinding is on the graph of its axes.
    settings = {
        'robot.yaw_torque_limit': 1.0, 'robot.pitch_torque_limit': 5.0,
        'duration': 3.0, 'dt': 1 / 500,
    }  # fmt: skip
    for method in ('newton', 'bdf2'):
        scene = with_settings(load_scene('sidewinding'), settings | {'method': method})
        trajectory = simulate(scene)
        assert trajectory.report.unconverged == 0
        most = scene.robot.by_joint(np.abs(trajectory.joint_torque)).max(axis=(0, 1))
        assert most[0] == pytest.approx(1.0, rel=1e-9) and most[1] == pytest.approx(5.0, rel=1e-9)


def test_a_gait_beyond_the_stop_ends_at_the_stop():
    gait = Gait(yaw=Wave(amplitude=0.7, angular_frequency=4.0, phase_lag=-0.9), soft_start=1.0)
    robot = Robot(joint_stop=True, joint_limit=0.4)
    for method, beyond in (('newton', 2e-2), ('bdf2', 1e-9)):
        scene = Scene(robot=robot, gait=gait, method=method, dt=1 / 500, duration=3.0)
        trajectory = simulate(scene)
        assert not trajectory.report.failure
        assert 0.399 < np.abs(trajectory.joint_angle).max() <= 0.4 + beyond


# ---- docs/servos.md -----------------------------------------------------------------------------


def test_programs_and_keys_of_the_page():
    text = (ROOT / 'docs' / 'servos.md').read_text(encoding='utf-8')
    for program in re.findall(r'```python\n(.*?)```', text, re.DOTALL):
        exec(compile(program, 'docs/servos.md', 'exec'), {})
    keys = set(re.findall(r'`(\w+)`', ' '.join(re.findall(r'^\| (`.*?) \|', text, re.MULTILINE))))
    assert keys <= {item.name for item in fields(Robot)} and len(keys) == 11


def test_commands_of_the_page(capsys):
    text = (ROOT / 'docs' / 'servos.md').read_text(encoding='utf-8')
    commands = re.findall(r'^\./run (run .*)$', text, re.MULTILINE)
    assert len(commands) == 4
    for command in commands:
        short = re.sub(r'--duration \d+', '--duration 0.1', command)
        assert main(short.split()) == 0
        assert json.loads(capsys.readouterr().out.splitlines()[-1])['unconverged_steps'] == 0


def test_the_example_draws_its_picture(tmp_path):
    picture = tmp_path / 'limits.png'
    example = str(ROOT / 'examples' / 'torque_limits.py')
    python(example, '--duration', '0.1', '--out', str(picture), folder=tmp_path)
    assert picture.read_bytes().startswith(b'\x89PNG')
