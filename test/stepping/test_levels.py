# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Model levels: that they agree, which one is chosen, and what goes over from one to the other."""

from dataclasses import replace
import json

from flat_states import flat_modules, in_plane, lying_flat
import numpy as np
import pytest
from scenes import G, kinetic_energy, references, same_bits, slope

from snake_sim_ros import (
    Friction,
    Gait,
    ParameterError,
    Report,
    Robot,
    Scene,
    Simulation,
    State,
    Wave,
)
from snake_sim_ros.commands.main import main
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.dynamics.kinematics import FLAT_GAP, FLAT_TILT, STILL_SPEED
from snake_sim_ros.gaits.joint_reference import start_posture
from snake_sim_ros.recording.recorded_runs import write_npz
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import center_of_mass, gaps, joint_angles
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.contact_forces import last_span
from snake_sim_ros.stepping.methods import empty_history, make_stepper
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.stepping.state import initial_state

pytestmark = pytest.mark.long

CASE_A = load_scene('lateral_undulation')
CASE_B = load_scene('lateral_undulation_isotropic')
DT = 1 / 1000
# A planar step that does not converge, as with `paper`, goes to space.
each_method = pytest.mark.parametrize('method', ['newton', 'bdf2'])


# ---- both levels are the same robot -------------------------------------------------------------


@pytest.mark.parametrize('scene', [CASE_A, CASE_B], ids=['A', 'B'])
def test_levels_agree(scene):
    # They cannot be equal: the selection rule lets the robot of space sink by some microns, its
    # joints let it roll by some 1e-4 rad, which takes as long as they swing, and friction and
    # torques follow the loads. 7.4e-5 and 3.9e-4 of the way were measured, 1e-3 is promised.
    every, parts = round(0.1 / scene.dt), {}
    for level in ('planar', 'spatial'):
        stepper = make_stepper(replace(scene, level=level))
        state, history, samples = initial_state(scene), stepper.empty_history(), []
        angle, rate = references(scene, round(scene.duration / scene.dt))
        for k in range(0, len(angle), every):
            part = slice(k, k + every)
            state, history, report = stepper.advance(state, history, angle[part], rate[part])
            assert report.status is Status.CONVERGED
            assert (report.level, report.steps) == (level, every)
            energy = kinetic_energy(scene.robot, state.u)
            samples.append((state.q, report.joint_torque, energy))
        parts[level] = [np.array(values) for values in zip(*samples, strict=True)]
    (q, torque, energy), (other_q, other_torque, other_energy) = parts.values()
    way = np.diff(center_of_mass(scene.robot, other_q), axis=0)
    length = np.linalg.norm(way, axis=1).sum()
    assert np.abs(q - other_q)[..., :2].max() <= 1e-3 * length
    # The robot of space sank by less than the rule allows a load of half a link.
    assert np.abs(q - other_q)[..., 2].max() <= 1e-5
    # In N m; yaw torques are up to 0.9, pitch torques up to 0.02.
    assert np.abs(torque - other_torque)[..., 0].max() <= 3e-3
    assert np.abs(torque - other_torque)[..., 1].max() <= 5e-3
    # m v dv for velocities that are as far apart as friction is, 1 % here and there.
    assert np.abs(energy - other_energy).max() <= 1e-2 * other_energy.max()


MODULES = Scene(
    robot=flat_modules(np.random.default_rng(2), 10),
    friction=Friction(longitudinal=0.05, transversal=0.3),
    gait=Gait(yaw=Wave(amplitude=0.6, angular_frequency=2.0, phase_lag=-0.9), soft_start=0.0),
    dt=DT,
)


@each_method
def test_links_given_one_by_one_have_the_loads_of_space(method):
    # The selection rule takes loads that fit velocities of delta = 1e-4 of what they cause: at
    # first loads are as far apart. Then contacts of space sink, each as its load says, and links
    # that yaw about axes which are tilted by that lift: in 0.1 s by up to 3e-8 m.
    scene = replace(MODULES, method=method, dt=DT if method == 'newton' else 5 * DT)
    steps, more = round(0.5 / scene.dt), round(0.1 / scene.dt)
    angle, rate = references(scene, steps + more)
    stepper = make_stepper(scene)
    start = initial_state(scene), empty_history(scene)
    state, history, report = stepper.advance(*start, angle[:steps], rate[:steps])
    assert report.planar_steps == report.steps == steps
    ends = {}
    for level in ('planar', 'spatial'):
        other = make_stepper(replace(scene, level=level))
        own = getattr(history.memory, level)
        ends[level] = [
            other.advance(state, history._replace(memory=own), angle[part], rate[part])
            for part in (slice(steps, steps + 1), slice(steps, None))
        ]
    (one, last), (other_one, other_last) = ends.values()
    load, other_load = (
        each[1].impulse[:, 0] / (last_span(replace(scene, level=level), each[1]))
        for level, each in (('planar', one), ('spatial', other_one))
    )
    assert np.abs(load - other_load).max() < 2e-3 * load.max()
    assert np.abs(one[0].q - other_one[0].q)[:, :3].max() < 1e-6
    assert np.abs(last[0].q - other_last[0].q)[:, :3].max() < 1e-4
    assert np.abs(last[0].q - other_last[0].q)[:, 2].max() < 1e-7


@pytest.mark.parametrize('dt', [1 / 1000, 1 / 4000])
def test_methods_have_one_path(dt):
    # Of first and second order; the larger step of `bdf2` is as accurate. In space the robot has
    # fewer freedoms than contacts, and contacts that sink change the loads. With `newton` they
    # sink by up to 2.5/16 dt^2, see `left_gap`, and 12 dt is measured, 5 dt at 1/1000 s.
    ends = {}
    for level in ('planar', 'spatial'):
        for method, step in (('newton', dt), ('bdf2', 4 * dt)):
            scene = replace(MODULES, method=method, dt=step, level=level)
            angle, rate = references(scene, round(2.0 / step))
            end, _, report = make_stepper(scene).advance(
                initial_state(scene), empty_history(scene), angle, rate
            )
            assert report.status is Status.CONVERGED
            ends[level, method] = end.q
    path = ends['planar', 'newton']
    way = np.linalg.norm((center_of_mass(scene.robot, path) - start_center(scene))[:2])
    for case, q in ends.items():
        most = 12.0 if case == ('spatial', 'newton') else 2.0
        assert np.abs(q - path)[:, :2].max() < most * dt * way, case


def start_center(scene):
    """Return the center of mass at the start of a scene [m]."""
    return center_of_mass(scene.robot, initial_state(scene).q)


def test_links_given_one_by_one_lie_flat_once_they_are_planar():
    # A pitch joint lifts modules for 20 ms. They come back to the plane when they have lain still;
    # what tilts and heights change then is what `levels` allows, and x and y do not jump.
    scene = replace(MODULES, settling_time=0.05)
    axis = int(np.flatnonzero(scene.robot.chain.places.present[:, 1])[0])
    angle, rate = references(scene, 400)
    angle[50:70, axis, 1] = 0.01
    steps = level_by_level(scene, initial_state(scene), empty_history(scene), angle, rate)
    levels = [report.level for _, _, report in steps]
    back = levels.index('planar', 50)
    assert levels[:50] == ['planar'] * 50
    assert levels[50:back] == ['spatial'] * (back - 50)
    assert steps[50][2].left == f'{scene.robot.axis_names[axis]} is commanded to 0.01 rad'
    (before, _, _), (after, _, _) = steps[back - 1], steps[back]
    assert np.abs(after.q - before.q)[:, 2].max() <= FLAT_GAP
    way = scene.dt / 2 * np.abs(before.u + after.u)[:, :2]
    assert np.abs(after.q - before.q)[:, :2].max() <= way.max() + 1e-6
    assert np.abs(gaps(scene.robot, after.q)).max() < 1e-15
    assert np.abs(rotation_matrices(after.q[:, 3:])[:, 2, [0, 2]]).max() < 1e-15
    assert np.abs(joint_gaps(scene.robot, after.q)).max() < 1e-12  # as those of space


# ---- which one is chosen ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'level'),
    [
        ('lateral_undulation', 'planar'),
        ('lateral_undulation_isotropic', 'planar'),
        ('slender_undulation', 'planar'),
        ('sidewinding', 'spatial'),
        ('sinus_lifting', 'spatial'),
        ('reu_sidewinding', 'spatial'),
    ],
)
def test_auto_takes_the_smallest_level(name, level, tmp_path):
    scene = replace(load_scene(name), duration=0.05)
    assert scene.level == 'auto'
    trajectory = simulate(scene)
    report = trajectory.report
    assert (report.level, trajectory.level.tolist()) == (level, [level] * 6)
    assert report.planar_steps == (report.steps if level == 'planar' else 0)
    assert bool(report.left) == (level == 'spatial')
    write_npz(trajectory, tmp_path / 'run.npz')
    with np.load(tmp_path / 'run.npz') as data:
        assert data['level'].tolist() == [level] * 6


def test_the_command_tells_the_level(capsys):
    for name, level, planar_steps in (
        ('lateral_undulation', 'planar', 20),
        ('sidewinding', 'spatial', 0),
    ):
        run = ['run', name, '--duration', '0.005', '--rate', '200', '--accuracy', '0']
        assert main(run) == 0
        summary = json.loads(capsys.readouterr().out.splitlines()[-1])
        assert (summary['level'], summary['planar_steps']) == (level, planar_steps)


# ---- from one to the other ----------------------------------------------------------------------


def sliding(scene, steps=100):
    """Return state and history of a robot under way in the plane."""
    state, history, report = make_stepper(scene).advance(
        initial_state(scene), empty_history(scene), *references(scene, steps)
    )
    assert report.planar_steps == report.steps == steps
    return state, history


def level_by_level(scene, state, history, angle, rate):
    """Return what every step leaves, one stepper doing them one by one."""
    stepper, steps = make_stepper(scene), []
    for part in zip(angle[:, None], rate[:, None], strict=True):
        state, history, report = stepper.advance(state, history, *part)
        steps.append((state, history, report))
    return steps


def burst(scene, start, steps, told, size):
    """Return references of a gait whose first pitch joint is commanded for a few steps."""
    angle, rate = references(scene, steps, start)
    for first, last in told:
        angle[first:last, 0, 1] = size
    return angle, rate


@each_method
def test_a_pitch_reference_takes_the_step_to_space(method):
    # Pose, velocities and impulses are what the spatial step takes: it is the same to the bit.
    scene = replace(CASE_A, method=method, dt=DT)
    state, history = sliding(scene)
    angle, rate = burst(scene, 100, 4, [(2, 4)], 0.02)
    before = make_stepper(scene).advance(state, history, angle[:2], rate[:2])
    assert before[2].level == 'planar'
    after = make_stepper(scene).advance(state, history, angle, rate)
    assert (after[2].level, after[2].planar_steps, after[2].steps) == ('spatial', 2, 4)
    assert after[2].left == 'joint_1_pitch is commanded to 0.02 rad'
    spatial = make_stepper(replace(scene, level='spatial'))
    contacts = before[1]._replace(settling=np.zeros(1), memory=spatial.empty_history().memory)
    end, _, _ = spatial.advance(before[0], contacts, angle[2:], rate[2:])
    assert (after[0].q == end.q).all() and (after[0].u == end.u).all()


def test_references_up_to_rounding_are_none():
    scene = replace(CASE_A, dt=DT)
    state, history = sliding(scene, 10)
    for size, level in ((9e-10, 'planar'), (1.1e-9, 'spatial')):
        angle, rate = references(scene, 1, 10)
        for told in (angle, rate):
            told[0, 3, 1] = size
            assert make_stepper(scene).advance(state, history, angle, rate)[2].level == level
            told[0, 3, 1] = 0.0


def flat_and_still(scene, state):
    """Return whether a robot lies flat and still, by the numbers that `levels` documents."""
    R = rotation_matrices(state.q[:, 3:])
    omega = np.einsum('ijk,ik->ij', R, state.u[:, 3:])
    speed = max(np.abs(state.u[:, 2]).max(), 0.0525 * np.abs(omega[:, :2]).max())
    return (
        np.abs(gaps(scene.robot, state.q)).max() <= FLAT_GAP
        and np.abs(R[:, 2, 0]).max() <= FLAT_TILT
        and speed <= STILL_SPEED
    )


def horizontal_momentum(robot, state):
    """Return the linear momentum in the plane [N s]."""
    return robot.per_link('link_mass') @ state.u[:, :2]


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_there_and_back_again(method):
    # A joint lifts the robot for 20 ms, without friction: nothing outside changes its momentum in
    # the plane. It goes to space in the step of the command, and comes back when it has lain flat
    # and still for the settling time, not a step earlier or later.
    scene = replace(
        CASE_A, method=method, dt=DT, friction=Friction(longitudinal=0.0, transversal=0.0)
    )
    robot = scene.robot
    start = in_plane(robot, initial_state(scene).q, np.array([0.2, 0.1]), np.zeros(11))
    angle, rate = burst(scene, 0, 400, [(50, 70)], 0.01)
    steps = level_by_level(scene, start, empty_history(scene), angle, rate)
    levels = [report.level for _, _, report in steps]
    assert all(report.status is Status.CONVERGED for _, _, report in steps)
    assert levels[:50] == ['planar'] * 50
    back = levels.index('planar', 50)
    settled = round(scene.settling_time / scene.dt)
    flat = [flat_and_still(scene, state) for state, _, _ in steps[:back]]
    flat[:70] = [False] * 70  # it is told to lift
    assert all(flat[-settled:])
    assert not flat[-settled - 1]
    assert levels[50:back] == ['spatial'] * (back - 50)
    assert levels[back:] == ['planar'] * (400 - back)
    momentum = [horizontal_momentum(robot, state) for state, _, _ in steps]
    # Every step rounds as much as 22 contact velocities of 1 m/s through the chain, 1e5 EPS.
    assert np.abs(np.array(momentum) - momentum[0]).max() < 1e-9
    for k in (50, back):  # and in the step of the change by no more than any other
        assert np.abs(momentum[k] - momentum[k - 1]).max() < 1e-12
    for k in range(1, 400):  # no link jumps: a step is the mean of two velocities, and O(dt^2)
        (one, _, _), (other, _, _) = steps[k - 1], steps[k]
        way = scene.dt / 2 * (one.u + other.u)[:, :3]
        assert np.abs(other.q - one.q)[:, :3].max() <= np.abs(way).max() + 1e-5


@each_method
def test_every_step_of_a_call_with_both_levels_has_a_time_stamp(method):
    scene = replace(CASE_A, method=method, dt=DT)
    stepper = make_stepper(scene)
    angle, rate = burst(scene, 0, 400, [(50, 70)], 0.01)
    _, _, report = stepper.advance(initial_state(scene), stepper.empty_history(), angle, rate)
    assert 200 < report.planar_steps < report.steps == 400
    assert len(stepper.cycles) == 401
    assert (np.diff(stepper.cycles) > 0).all()


def elastic_energy(scene, state, angle):
    """Return the energy of links and joints, kinetic, of gravity and of the held joints [J]."""
    robot = scene.robot
    bent = joint_angles(state.q) - angle
    height = robot.per_link('link_mass') @ state.q[:, 2] * G
    springs = np.sum(robot.per_joint('stiffness') * bent**2) / 2
    return kinetic_energy(robot, state.u) + height + springs


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize('lift', [0.02, -0.02])
def test_a_vertical_push_goes_to_space_and_energy_does_not_rise(lift, method):
    # Joints hold their angles, so that they and contacts take energy only. The center of mass is
    # held: where joints that a push opens are closed from link 1 on, that would raise all others.
    scene = replace(CASE_A, method=method, dt=DT, drift_correction='center_of_mass')
    simulation = Simulation(scene)
    hold = start_posture(scene).angle
    angle = np.tile(hold, (300, 1, 1))
    none = np.zeros(angle.shape)
    simulation.advance(angle[:20], none[:20])
    assert simulation.last.level == 'planar'
    simulation.push(0, (0.0, 0.0, lift))
    energies, levels = [elastic_energy(scene, simulation.state, hold)], []
    for k in range(300):
        report = simulation.advance(angle[k : k + 1], none[k : k + 1])
        assert report.status is Status.CONVERGED
        energies.append(elastic_energy(scene, simulation.state, hold))
        levels.append(report.level)
    assert levels[0] == 'spatial'
    back = levels.index('planar')
    assert back >= round(scene.settling_time / scene.dt)
    assert levels == ['spatial'] * back + ['planar'] * (300 - back)
    # Springs and gravity act at the middle of a step: second order of what moves, 1e-4 of it.
    rise = np.diff(energies)
    assert rise.max() <= 1e-4 * energies[0], rise.max()
    # What moves vertically is lost when it is left out: 10 mm/s at most, and less where it lies.
    lost = scene.robot.per_link('link_mass').sum() * STILL_SPEED**2 / 2
    assert -lost <= rise[back] <= 1e-9


def test_a_horizontal_push_stays_in_the_plane():
    simulation = Simulation(replace(CASE_A, dt=DT))
    angle = np.tile(start_posture(CASE_A).angle, (100, 1, 1))
    simulation.advance(angle, np.zeros(angle.shape))
    before = simulation.state.u.copy()
    simulation.push(
        5, (0.02, 0.01, 0.0)
    )  # a harder one makes the robot roll by more than 2e-4 rad
    simulation.advance(angle, np.zeros(angle.shape))
    assert simulation.report.planar_steps == simulation.report.steps == 200
    assert np.abs(before).max() < 1e-6 < np.abs(simulation.state.q - initial_state(CASE_A).q).max()


def test_another_gravity_goes_to_space_and_back():
    scene = replace(CASE_A, dt=DT)
    simulation = Simulation(scene)
    simulation.advance(*references(scene, 50))
    state, impulses = simulation.state, simulation.history.impulse.copy()
    simulation.change(replace(scene, gravity=slope(0.02)))
    assert simulation.state is state
    assert (simulation.history.impulse == impulses).all()
    report = simulation.advance(*references(scene, 50, 50))
    assert (report.level, report.planar_steps, report.steps) == ('spatial', 0, 50)
    assert report.penetration_max <= FLAT_GAP
    simulation.change(scene)
    before = simulation.state
    # It lies flat and still: nothing has to settle.
    report = simulation.advance(*references(scene, 50, 100))
    assert (report.level, report.planar_steps) == ('planar', 50)
    assert np.abs(simulation.state.q - before.q)[:, 2].max() == 0.0  # heights stay as they are


@pytest.mark.parametrize('chunk', [1, 7, 60])
@each_method
def test_calls_of_any_length_are_the_same_bits(method, chunk):
    settings = {'method': method, 'dt': DT, 'settling_time': 0.03}
    scene = with_settings(CASE_A, {**settings, 'solver.iteration_limit': 50})
    steps = 240
    angle, rate = burst(scene, 0, steps, [(40, 43), (130, 131)], 0.003)
    start = initial_state(scene), empty_history(scene)
    whole = make_stepper(scene).advance(*start, angle, rate)
    stepper, (state, history), total = make_stepper(scene), start, Report()
    for k in range(0, steps, chunk):
        part = slice(k, k + chunk)
        state, history, report = stepper.advance(state, history, angle[part], rate[part])
        total += report
    assert (state.q == whole[0].q).all() and (state.u == whole[0].u).all()
    assert same_bits(history, whole[1])
    assert total.planar_steps == whole[2].planar_steps
    assert 50 < total.planar_steps < 230
    assert (total.joint_torque == whole[2].joint_torque).all()
    assert (total.level, total.left) == (whole[2].level, whole[2].left)


@each_method
def test_what_a_call_could_not_use_is_forgotten(method):
    # A stepper asked for no steps from a robot that is about to be pressed down, and then to go on
    # in the plane: as one that was not asked.
    scene = replace(CASE_A, method=method, dt=DT)
    state, history = sliding(scene, 20)
    angle, rate = references(scene, 1, 20)
    pressed = State(state.q, state.u + np.array([0, 0, -5e-4, 0, 0, 0]))
    stepper = make_stepper(scene)
    stepper.advance(state, history, angle, rate)
    for steps in (0, 1):
        stepper.advance(pressed, history, angle[:steps], rate[:steps])
    end, memory, _ = stepper.advance(state, history, angle, rate)
    other, expected, _ = make_stepper(scene).advance(state, history, angle, rate)
    assert (end.q == other.q).all() and (end.u == other.u).all()
    assert same_bits(memory, expected)


def test_vertical_momentum_is_taken_up_by_the_contacts():
    # 0.9 mm/s down: within what counts as still. The contacts of the first step stop all of it,
    # besides the weight; by half of it upwards they carry less.
    scene = replace(CASE_A, dt=DT, level='planar')
    mass = scene.robot.per_link('link_mass').sum()
    state = initial_state(scene)
    for speed in (-9e-4, 5e-4, 0.0):
        state.u[:, 2] = speed
        end, history, report = make_stepper(scene).advance(
            state, empty_history(scene), *references(scene, 1)
        )
        assert report.status is Status.CONVERGED
        assert not end.u[:, 2].any()
        taken = mass * (G * scene.dt - speed)
        assert history.impulse[:, 0].sum() == pytest.approx(taken, rel=1e-9)


# ---- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('settings', 'clause'),
    [
        ({'gravity': (0.1, 0.0, -9.81)}, 'gravity (0.1, 0, -9.81) m/s^2 is not straight down'),
        ({'gravity': (0.0, 0.0, 0.0)}, 'gravity (0, 0, 0) m/s^2 is not straight down'),
        ({'friction.rolling': 0.01}, 'friction.rolling is 0.01, and in the plane nothing rolls'),
        (
            {'robot.link_count': 2, 'robot.contact_radius': (0.05, 0.06)},
            'robot.contact_radius differs from link to link, 0.05 to 0.06 m, so that the robot '
            'does not lie flat',
        ),
        (
            {'solver.normal_compliance': 0.0},
            'solver.normal_compliance is 0, and loads in the plane follow the selection rule',
        ),
        (
            {'drift_correction': 'none'},
            'drift_correction is none, and in the plane joints do not drift',
        ),
        ({'self_contact': True}, 'self_contact is true, and in the plane links do not touch'),
    ],
)
def test_scenes_that_are_not_planar_are_refused(settings, clause):
    scene = with_settings(CASE_A, {**settings, 'level': 'planar'})
    with pytest.raises(ParameterError) as caught:
        make_stepper(scene)
    assert str(caught.value) == f'level planar: {clause}; choose level spatial or auto'
    # Auto takes them as they are; a simulation that cannot change goes on.
    assert make_stepper(replace(scene, level='auto')).level == 'spatial'
    if scene.robot.link_count == CASE_A.robot.link_count:
        simulation = Simulation(CASE_A)
        stepper = simulation.stepper
        with pytest.raises(ParameterError):
            simulation.change(scene)
        assert simulation.stepper is stepper and simulation.scene is CASE_A


def test_levels_have_names():
    with pytest.raises(ParameterError) as caught:
        Scene(level='flat')
    assert str(caught.value) == "level must be one of auto, planar, spatial; got 'flat'"
    with pytest.raises(ParameterError, match=r'settling_time must be above 0 s, got 0 s'):
        Scene(settling_time=0.0)


def rolled(q, angle):
    """Return coordinates with every link turned about its own axis."""
    q = q.copy()
    q[:, 3:] = product(q[:, 3:], about(2, angle))
    return q


def raised(q, height):
    """Return coordinates that much higher."""
    return q + np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 0.0])


ROBOT = Robot(link_count=3)
FLAT_Q = lying_flat(ROBOT, np.array([0.3, -0.2]))
REST = np.zeros((3, 6))
FALLING = REST.copy()
FALLING[1, 2] = -2e-3


@each_method
@pytest.mark.parametrize(
    ('q', 'u', 'told', 'clause'),
    [
        (raised(FLAT_Q, 0.01), REST, 0.0, 'link 1 has a gap of 0.01 m to the floor'),
        (raised(FLAT_Q, -2e-4), REST, 0.0, 'link 1 has a gap of -0.0002 m to the floor'),
        (rolled(FLAT_Q, 0.01), REST, 0.0, 'link 1 is rolled by 0.01 rad'),
        (FLAT_Q, FALLING, 0.0, 'link 2 moves vertically at 0.002 m/s'),
        (FLAT_Q, REST, 0.1, 'joint_2_pitch is commanded to 0.1 rad'),
    ],
    ids=['in the air', 'in the floor', 'rolled', 'falling', 'told'],
)
def test_states_that_are_not_planar_end_the_call(q, u, told, clause, method):
    scene = Scene(robot=ROBOT, level='planar', method=method)
    state, history = State(q, u), empty_history(scene)
    angle = np.tile(joint_angles(FLAT_Q), (3, 1, 1))
    angle[1:, 1, 1] = told  # the first step is good
    end, memory, report = make_stepper(scene).advance(state, history, angle, np.zeros(angle.shape))
    said = report.failure.replace('rolled by -', 'rolled by ')
    assert said == f'level planar: {clause}; choose level spatial or auto'
    assert report.status is Status.DIVERGED
    assert (report.level, report.steps) == ('planar', 1 if told else 0)
    if told:
        assert memory.impulse.any() and memory.memory.q.any()
        assert np.isfinite(end.q).all() and np.abs(end.q - q).max() < 1e-3
    else:
        assert (end.q == q).all() and (end.u == u).all() and same_bits(memory, history)
    # Auto goes on with it.
    automatic = make_stepper(replace(scene, level='auto'))
    history = automatic.empty_history()
    _, _, report = automatic.advance(state, history, angle, np.zeros(angle.shape))
    assert (report.failure, report.steps, report.level) == ('', 3, 'spatial')
    assert report.left.replace('rolled by -', 'rolled by ') == clause


def test_a_simulation_says_when_the_plane_was_left():
    simulation = Simulation(replace(CASE_A, level='planar'))
    simulation.advance(*references(CASE_A, 4))
    state = simulation.state
    simulation.push(3, (0.0, 0.0, 0.1))
    report = simulation.advance(*references(CASE_A, 4, 4))
    assert report.failure.startswith('t = 0.001 s: level planar: link 4 moves vertically at 0.147')
    assert (simulation.state.q == state.q).all()
    assert simulation.step_count == 4
