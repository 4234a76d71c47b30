# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fit of friction and gains to recordings that are made, and what it says of its certainty."""

from dataclasses import replace
import json
import math
from pathlib import Path
import re
import runpy
import shlex
from types import SimpleNamespace

from modular import modular_robot
import numpy as np
import pytest
from random_states import random_parameters
from recorded_messages import gait_commands, state_messages, write_messages

from snake_sim_ros import Friction, Gait, ParameterError, Robot, Scene, Simulation, Wave
from snake_sim_ros.commands.main import main
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import flat_fields
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import chain_coordinates, joint_angles, joint_rates
from snake_sim_ros.scene.rotations import about, product, rotation_matrices
from snake_sim_ros.stepping.methods import what_is_not_planar
from snake_sim_ros.stepping.simulation import simulate
from snake_sim_ros.studies.fit import Fit, fit, OFFSETS, scene_at, SETUP, Unknown, unknowns_of
from snake_sim_ros.studies.judgement import (
    judge,
    lines,
    summary,
    what_is_not_determined,
    what_is_suggested,
    write_scene,
)
from snake_sim_ros.studies.recorded_motion import Command, read_recording, Recording
from snake_sim_ros.studies.replay import (
    ALIGNED,
    aligned,
    as_measured,
    coordinates_at,
    LOST,
    Measured,
    motion_of,
    Replay,
    ReplaySettings,
    Residual,
    Setup,
    start_effect,
    start_state,
    with_fit_steps,
    with_noise,
    with_offsets,
)

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'fit.md').read_text(encoding='utf-8')
SETTINGS = ReplaySettings(segment=1.0, burn_in=1.0)
DURATION, RATE = 4.2, 100.0  # s, Hz
SHORT = {'robot.link_count': 7}  # a robot that takes less time
BOTH = ['friction.longitudinal', 'friction.transversal']
ALL = [*BOTH, 'robot.yaw_stiffness']
ONE = BOTH[:1]  # where what else is found matters, in half of the time


def case_a(settings=None):
    """Return a scene of a few links in lateral undulation."""
    return with_settings(load_scene('lateral_undulation'), SHORT | (settings or {}))


def whole_steps(scene):
    """Return a scene with the steps of a fit, undivided, which takes less time."""
    return with_fit_steps(scene, ['accuracy'])


def recording_of(scene, duration=DURATION):
    """Return what is measured of a run of a scene, without noise."""
    trajectory = simulate(replace(whole_steps(scene), duration=duration), rate=RATE)
    time, position, p = trajectory.time, trajectory.position, trajectory.orientation
    angle = joint_angles(np.concatenate([position, p], axis=-1), scene.robot)
    commands = tuple(Command(*item) for item in gait_commands(scene, time))
    return Recording(
        scene, True, commands, time, angle, time, np.arange(position.shape[1]), position, p
    )


def bag_of(recording, path):
    """Return the path of the bag of a recording."""
    commands = gait_commands(recording.scene, recording.joint_time)
    return write_messages(path, [*commands, *state_messages(recording)], recording.scene)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('recordings')


@pytest.fixture(scope='module')
def recording(folder):
    """Return what was recorded of case A, without noise."""
    return read_recording(bag_of(recording_of(case_a()), folder / 'run.mcap'))


def replay_of(recording, seed=None, **start):
    """Return the replay of a recording with noise."""
    if seed is not None:
        recording = with_noise(recording, SETTINGS.noise_position, SETTINGS.noise_angle, seed)
    scene = with_settings(whole_steps(recording.scene), start)
    return Replay(recording, scene, SETTINGS, 'interpolated')


@pytest.fixture(scope='module')
def found(recording):
    """Return the fit of three values to a noisy recording, from far off."""
    start = {'friction.longitudinal': 0.2, 'robot.yaw_stiffness': 60.0}
    replay = replay_of(recording, seed=1, **start)
    return fit(replay, unknowns_of(replay.scene, ALL))


# ---- the fit ------------------------------------------------------------------------------------


def test_it_finds_the_truth_within_its_intervals(recording, found):
    truth = np.array([flat_fields(recording.scene)[name][0] for name in ALL])
    judgement = judge(found)
    # Four standard deviations are exceeded in 6 of 100 000 recordings; this one has a fixed seed.
    off = np.log(np.array(found.values) / truth)
    assert (np.abs(off) < 4 * judgement.deviation).all()
    # The ratio of the coefficients is determined much better than each.
    assert abs(off[1] - off[0]) < 0.2 * judgement.deviation.max()
    assert judgement.failures == ()
    for name, size in judgement.size.items():
        assert size == pytest.approx(1.0, abs=0.03), name
    # Both intervals are as wide as each other up to the uncertainty of few segments.
    widths = [np.ptp(np.log(part), axis=1) for part in (judgement.interval, judgement.bootstrap)]
    assert (widths[1] < 6 * widths[0]).all() and (widths[1] > 0.1 * widths[0]).all()
    assert judgement.correlation == pytest.approx(judgement.correlation.T)
    assert np.diag(judgement.correlation) == pytest.approx(np.ones(3))


def test_it_finds_the_exact_truth_without_noise(recording):
    replay = replay_of(recording, **{'friction.longitudinal': 0.15})
    exact = fit(replay, unknowns_of(replay.scene, BOTH), threads=1)
    # Integration by steps of 0.01 s and references between commands are all that is off.
    assert exact.values == pytest.approx([0.1, 0.5], rel=1e-3)
    judgement = judge(exact)
    assert judgement.failures == ()
    assert max(judgement.size.values()) < 0.01


def test_it_finds_viscous_friction_beside_that_of_coulomb():
    names = ['friction.viscous_longitudinal', 'friction.viscous_transversal']
    truth = dict(zip(names, [0.3, 1.0], strict=True))
    recording = recording_of(case_a(truth))
    replay = replay_of(recording, **dict(zip(names, [0.6, 0.6], strict=True)))
    exact = fit(replay, unknowns_of(replay.scene, names))
    # As above; viscous friction is a tenth of all friction here.
    assert exact.values == pytest.approx([*truth.values()], rel=1e-2)
    assert judge(exact).failures == ()


def test_it_finds_how_friction_falls_with_speed():
    truth = {'friction.kinetic_ratio': 0.6, 'friction.stribeck_speed': 0.02}
    recording = recording_of(case_a(truth))
    replay = replay_of(recording, **{**truth, 'friction.kinetic_ratio': 0.9})
    exact = fit(replay, unknowns_of(replay.scene, ['friction.kinetic_ratio']))
    assert exact.values == pytest.approx([0.6], rel=1e-2)
    assert judge(exact).failures == ()


@pytest.mark.parametrize('start', [0.0, 0.01])
def test_a_delay_of_commands_need_not_be_a_multiple_of_the_step(tmp_path, start):
    scene = case_a({'robot.command_delay': 0.03})
    recording = recording_of(with_settings(scene, {'dt': 0.01}))
    replay = replay_of(recording, **{'robot.command_delay': start})
    exact = fit(replay, unknowns_of(replay.scene, [*BOTH, 'robot.command_delay']))
    assert exact.values == pytest.approx([0.1, 0.5, 0.03], rel=1e-3)
    write_scene(exact, scene, Path('bag'), tmp_path / 'found.yaml')
    found = load_scene(str(tmp_path / 'found.yaml')).robot.command_delay
    assert found == pytest.approx(0.03, abs=1e-9)


def test_clocks_that_are_ahead_are_found(recording):
    def ahead(poses):
        joint_time, pose_time = recording.joint_time - 0.021, recording.pose_time + poses
        return replay_of(replace(recording, joint_time=joint_time, pose_time=pose_time))

    # Friction is off by more than half where the clocks are taken for one, and the fit says so.
    wrong = fit(ahead(0.053), unknowns_of(recording.scene, BOTH))
    assert abs(wrong.values[0] / 0.1 - 1.0) > 0.5 and judge(wrong).failures
    replay = with_offsets(ahead(0.153), {'joints', 'poses'})
    found = fit(replay, unknowns_of(replay.scene, [*BOTH, *OFFSETS], replay.setup))
    assert found.values == pytest.approx([0.1, 0.5, -0.021, 0.153], rel=1e-3)
    assert found.setup[:2] == pytest.approx((-0.021, 0.153), rel=1e-3)
    assert judge(found).failures == ()


def measured_with(recording, setup):
    """Return a recording of the first link alone, with another setup."""
    q = np.concatenate([recording.position, recording.orientation], axis=-1)[:, :1]
    q = as_measured(q, setup)
    return replace(
        recording, links=recording.links[:1], position=q[..., :3], orientation=q[..., 3:],
        pose_time=recording.pose_time + setup.poses,
    )  # fmt: skip


@pytest.mark.parametrize(
    ('setup', 'suggested'),
    [
        (Setup(x=0.03, y=0.01), 'marker.x marker.y marker.z'),
        (Setup(roll=0.02, pitch=-0.03), 'frame.roll frame.pitch'),
        (Setup(poses=0.04), 'time_offset.poses'),
    ],
)
def test_what_the_setup_explains_is_suggested_and_found(recording, setup, suggested, monkeypatch):
    suspects = [('time_offset.joints',), tuple(suggested.split())]  # not all, which takes longer
    monkeypatch.setattr('snake_sim_ros.studies.judgement.SUSPECTS', suspects)
    replay = replay_of(measured_with(recording, setup), seed=1)
    wrong = fit(replay, unknowns_of(replay.scene, ONE))
    assert judge(wrong).failures
    best = what_is_suggested(wrong)[0]
    first = re.match(r'--free (.*) removes (.*) % of what is left over, with ', best)
    assert first and first[1] == suggested and float(first[2]) > 85.0
    about = {
        name: float(value)
        for name, value in re.findall(r'(\S+) at (\S+) (?:m|s|rad)', best[first.end() :])
    }
    assert list(about) == suggested.split()
    free = [name for name, (field, _, _) in SETUP.items() if getattr(setup, field) != 0.0]
    if setup.poses:
        replay = with_offsets(replay, {'poses'})
    found = fit(replay, unknowns_of(replay.scene, [*ONE, *free], replay.setup))
    judgement = judge(found)
    assert judgement.failures == ()
    # Four standard deviations, as above.
    true = [0.1, *(value for value in setup if value != 0.0)]
    off = [unknown.coordinate(value) for unknown, value in zip(found.unknowns, true, strict=True)]
    assert (np.abs(found.x - off) < 4 * judgement.deviation).all()
    # What is suggested has that deviation, too, and is rounded to two digits.
    for name in free:
        k = [*ONE, *free].index(name)
        rounding = 0.5 * 10 ** (math.floor(math.log10(abs(about[name]))) - 1)
        assert abs(about[name] - true[k]) < 4 * judgement.deviation[k] + rounding, name


@pytest.mark.parametrize('seed', [1, 2])
def test_what_a_recording_does_not_determine_stays(recording, seed):
    # A marker above the center of the one link that is measured moves its path as a whole, which
    # is moved to where it fits best: nothing but rounding and errors of steps ask for a place.
    replay = replay_of(measured_with(recording, Setup()), seed=seed)
    found = fit(replay, unknowns_of(replay.scene, [*BOTH, 'marker.z'], replay.setup))
    # A tenth of how far it may go; it was 0.5 m, all of that.
    assert abs(found.values[2]) < 0.05
    assert found.values[:2] == pytest.approx([0.1, 0.5], rel=0.05)


@pytest.mark.parametrize(
    ('truth', 'suggested'),
    [
        ({'robot.joint_friction': 0.2}, 'robot.joint_friction at 0.2 N m'),
        ({'robot.command_delay': 0.02, 'dt': 0.01}, 'robot.command_delay at 0.02 s'),
    ],
)
def test_what_a_scene_lacks_is_suggested(truth, suggested, monkeypatch):
    if 'robot.command_delay' in truth:  # all of them are tried with the other one
        suspects = [('time_offset.joints',), ('robot.command_delay',)]
        monkeypatch.setattr('snake_sim_ros.studies.judgement.SUSPECTS', suspects)
    recording = recording_of(case_a(truth), 3.2)
    replay = replay_of(recording, seed=1, **dict.fromkeys(truth.keys() - {'dt'}, 0.0))
    wrong = fit(replay, unknowns_of(replay.scene, ONE))
    assert judge(wrong).failures
    best = what_is_suggested(wrong)[0]
    assert re.match(rf'--free {suggested.split()[0]} removes (9[5-9]|100) % of what is', best)
    assert best.endswith(suggested)


def test_one_offset_may_be_that_of_both_streams(recording):
    later = replace(
        recording, joint_time=recording.joint_time + 0.04, pose_time=recording.pose_time + 0.04
    )
    replay = with_offsets(replay_of(later), {'joints', 'poses'})
    found = fit(replay, unknowns_of(replay.scene, ['='.join(OFFSETS)], replay.setup))
    assert found.values == pytest.approx([0.04], rel=1e-3)
    with pytest.raises(ParameterError, match='is a number of the scene'):
        unknowns_of(replay.scene, [f'{OFFSETS[0]}=friction.rolling'])


def test_a_robot_with_friction_in_its_joints_starts_flat():
    scene = case_a({'robot.joint_friction': 0.2})
    recording = recording_of(scene)
    replay = replay_of(recording, **{'robot.joint_friction': 0.1})
    assert replay.is_flat and what_is_not_planar(replay.scene)  # it lies flat, and is in space
    exact = fit(replay, unknowns_of(replay.scene, ['robot.joint_friction']))
    assert exact.values == pytest.approx([0.2], rel=1e-3)


def test_a_segment_whose_contacts_are_not_solved_is_lost(recording):
    replay = replay_of(recording, **{'solver.iteration_limit': 1})
    assert all((item.flat() == LOST).all() for item in replay.residuals(replay.scene))


def test_a_segment_that_is_lost_in_divided_steps_is_simulated_in_whole_ones(
    recording, monkeypatch
):
    scene = with_fit_steps(recording.scene)
    assert scene.accuracy > 0.0
    replay = replay_of(recording, accuracy=scene.accuracy)
    divided, whole = (replay.residuals(with_settings(scene, {'accuracy': accuracy}))
                      for accuracy in (scene.accuracy, 0.0))  # fmt: skip
    motion = Replay._motion

    def lost(self, scene, stepper, segment, commanded):
        is_lost = stepper.scene.accuracy > 0.0 and segment is replay.segments[1]
        return None if is_lost else motion(self, scene, stepper, segment, commanded)

    monkeypatch.setattr(Replay, '_motion', lost)
    for k, item in enumerate(replay.residuals(scene)):
        expected, other = (whole, divided) if k == 1 else (divided, whole)
        assert (item.flat() == expected[k].flat()).all()
        assert (item.flat() != other[k].flat()).any()


def test_the_start_of_a_search_is_simulated_once(recording):
    replay = replay_of(recording, seed=3, **{'friction.longitudinal': 0.2})
    unknowns = unknowns_of(replay.scene, BOTH[:1])
    _, residuals = start_effect(replay)
    once = fit(replay, unknowns, known=residuals)
    again = fit(replay, unknowns)
    assert once.evaluations == again.evaluations - 1
    assert once.values == pytest.approx(again.values, rel=1e-9)
    # Residuals of another scene than the first one are not taken.
    friction = unknowns_of(replay.scene, ['friction.longitudinal=friction.transversal'])
    assert fit(replay, friction, known=residuals).values == fit(replay, friction).values


def test_threads_and_repetitions_give_the_same_bits(recording):
    values = []
    for threads in (1, 2):
        replay = replay_of(recording, seed=3)
        values.append(fit(replay, unknowns_of(replay.scene, BOTH[:1]), threads=threads).values)
    assert values[0] == values[1]


@pytest.mark.parametrize('noise', [0.0, 1e-10])
@pytest.mark.parametrize('share', [0.0, 0.7])  # no effect, or that of another value
def test_what_is_not_determined_has_no_interval(found, share, noise):
    random = np.random.default_rng(4)
    jacobians = [J.copy() for J in found.jacobians]
    for J in jacobians:
        J[:, 2] = share * J[:, 1] + noise * np.abs(J[:, 1]).max() * random.normal(size=len(J))
    lost = replace(found, jacobians=jacobians)
    judgement, whole = judge(lost), judge(found)
    unknown = [2] if share == 0.0 else [1, 2]
    assert (np.isinf(judgement.deviation) == np.isin(range(3), unknown)).all()
    for k in unknown:
        assert summary(lost, judgement)['values'][ALL[k]]['interval'] is None
        assert any(
            line.startswith(f'{ALL[k]}: ') and line.endswith(', not determined')
            for line in lines(lost, judgement)
        )
    assert judgement.deviation[0] <= whole.deviation[0] * (1 + 1e-9)
    assert 'does not determine' in what_is_not_determined(lost, judgement)[-1]
    json.dumps(summary(lost, judgement), allow_nan=False)


def test_what_hardly_matters_is_said(found):
    sentences = what_is_not_determined(found, judge(found))
    assert sentences[-1].startswith(
        'a common change of friction.longitudinal, friction.transversal and robot.yaw_stiffness '
        'hardly matters: 10 % change the motion by'
    )
    assert judge(found).singular[0] > 50 * judge(found).singular[-1]


def test_friction_hardly_matters_in_case_b():
    scene = with_settings(load_scene('lateral_undulation_isotropic'), SHORT)
    recording = recording_of(scene)
    replay = replay_of(recording, seed=2)
    names = ['friction.longitudinal=friction.transversal', 'robot.yaw_damping']
    result = fit(replay, unknowns_of(replay.scene, names))
    damping, friction = sorted(what_is_not_determined(result, judge(result)), reverse=True)
    assert damping.startswith('the recording does not determine robot.yaw_damping: its standard')
    assert friction.startswith(f'{names[0]} hardly matters: 10 % change the motion by')


def test_a_wrong_model_fails_the_test_of_residuals(recording):
    # Halfway the floor changes: both coefficients by a fifth, their ratio stays.
    scene = whole_steps(recording.scene)
    simulation, q = Simulation(scene), []
    steps = round(1.0 / RATE / scene.dt)
    for moment in recording.joint_time:
        if moment > DURATION / 2 and simulation.scene is scene:
            simulation.change(with_settings(scene, dict(zip(BOTH, (0.08, 0.4), strict=True))))
        q.append(simulation.state.q)
        times = simulation.midpoints(steps)
        simulation.advance(*gait.reference(scene.gait, times, scene.robot.link_count - 1))
    q = np.array(q)
    changed = replace(recording, joint_angle=joint_angles(q), position=q[..., :3],
                      orientation=q[..., 3:])  # fmt: skip
    replay = replay_of(changed, seed=1)
    judgement = judge(fit(replay, unknowns_of(replay.scene, BOTH)))
    assert any('parts of the recording ask for different values' in x for x in judgement.failures)


def test_a_wrong_statement_of_noise_is_found(found):
    noisy = replace(found, residuals=[
        item._replace(poses=2.0 * item.poses) for item in found.residuals
    ])  # fmt: skip
    (first, second, *_) = judge(noisy).failures
    assert re.match('positions are off by (1.9|2)', first)
    assert second.startswith('orientations are off by')


def test_a_global_stage_finds_the_way_from_far_off(recording):
    pytest.importorskip('cma')
    replay = replay_of(recording, seed=1, **{'friction.transversal': 1.5, 'level': 'planar'})
    unknowns = unknowns_of(replay.scene, ['friction.transversal'])
    result = fit(replay, unknowns, globally=12, seed=4)
    assert result.values == pytest.approx([0.5], rel=0.05)


def test_a_value_at_its_bound_is_said(recording):
    replay = replay_of(recording, **{'friction.rolling': 0.0})
    scene = replay.scene
    (unknown,) = unknowns_of(scene, ['robot.yaw_damping'])
    narrow = replace(unknown, start=0.5, low=0.4, high=0.6)
    assert fit(replay, (narrow,)).at_bound == ('robot.yaw_damping',)


# ---- its parts ----------------------------------------------------------------------------------


def test_states_between_are_cubic_in_time():
    # x = t^3 and a turn about z by a constant rate: the first is met exactly, the second up to the
    # fourth derivative of cos(t/2) over 384, h^4/(16 * 384).
    h, times = 0.1, np.array([0.0, 0.03, 0.1, 0.17])
    q, u = np.zeros((3, 1, 7)), np.zeros((3, 1, 6))
    for k in range(3):
        q[k, 0, 0], u[k, 0, 0] = (k * h) ** 3, 3 * (k * h) ** 2
        q[k, 0, 3:], u[k, 0, 5] = (-1) ** k * about(2, k * h), 1.0
    found = coordinates_at(motion_of(q, u, h), times)
    assert found[:, 0, 0] == pytest.approx(times**3, abs=1e-15)
    turns = np.array([about(2, t) for t in times])
    assert np.abs((found[:, 0, 3:] * turns).sum(axis=1)) == pytest.approx(1.0, abs=1e-10)
    off = found[:, 0, 3:] * np.sign((found[:, 0, 3:] * turns).sum(axis=1))[:, None] - turns
    assert np.abs(off).max() < h**4 / (16 * 384)


def test_alignment_removes_a_motion_of_the_whole_path(recording):
    segment = replay_of(recording).segments[0]
    q = np.concatenate([segment.position, segment.orientation], axis=-1)
    turn = about(2, 0.3)
    q[..., :3] = q[..., :3] @ rotation_matrices(turn).T + [0.2, -0.1, 0.05]
    q[..., 3:] = product(np.broadcast_to(turn, (*q.shape[:2], 4)), q[..., 3:])
    assert np.abs(aligned(segment, q, 1e-3, 8.7e-3)).max() < 1e-9


@pytest.mark.parametrize('is_flat', [True, False])
def test_a_chain_that_was_measured_spinning_starts_with_its_spin(is_flat):
    # Link 1 turns about the vertical at omega, each yaw joint turns at its rate besides: link i
    # turns at omega plus the rates before it. In space the whole robot rolls about e_x, too.
    robot = Robot(link_count=4)
    omega = np.array([0.0 if is_flat else 0.4, 0.0, 0.7])  # rad/s, in I
    angle, rate = np.zeros((2, 3, 2))
    angle[:, 0], rate[:, 0] = [0.3, -0.5, 0.2], [0.9, -0.4, 0.6]
    q = chain_coordinates(robot, angle)
    p, v = q[:1, 3:], np.array([0.2, -0.1, 0.0])
    turning = product(np.array([0.0, *omega]), p[0]) / 2  # p' = (0, omega) p/2
    measured = Measured(
        angle=np.array([angle, rate]), links=np.array([0]),
        position=np.array([q[:1, :3], v[None]]), orientation=np.array([p, turning[None]]),
    )  # fmt: skip
    state = start_state(Scene(robot=robot), measured, is_flat=is_flat)
    R = rotation_matrices(state.q[:, 3:])
    yaw_axes = R[:-1, :, 1] * rate[:, :1]
    expected = omega + np.vstack([np.zeros(3), np.cumsum(yaw_axes, axis=0)])
    # Central differences over 1 ms: h^2/6 omega^3, with up to 3 rad/s.
    assert np.abs(np.einsum('nij,nj->ni', R, state.u[:, 3:]) - expected).max() < 27 * 1e-6 / 6
    assert np.abs(state.u[0, :3] - v).max() < 1e-12
    assert np.abs(joint_rates(state.q, state.u) - rate).max() < 27 * 1e-6 / 6


def fit_of_one_value(residuals, jacobians):
    """Return a fit that found one value; 8k residuals a segment are of k poses and two angles."""
    unknown = Unknown(('friction.rolling',), 0.5, -math.inf, math.inf, '1', False)
    kept = [
        Residual(r[: len(r) // 4 * 3].reshape(-1, 1, 6), r[len(r) // 4 * 3 :].reshape(-1, 1, 2))
        for r in residuals
    ]
    columns = [J[:, None] for J in jacobians]
    return Fit(None, (unknown,), np.array([0.5]), kept, columns, (), 0)


def test_freedom_is_what_values_and_alignments_leave():
    # Place (3 numbers) and heading of each of three paths, and one value, of 3 * 40 numbers less
    # one that was not measured. Residuals of 3 with derivatives that see none of them: the
    # deviation is 1/sqrt(J^T J) times the root of the mean square per degree of freedom.
    r = np.full((3, 40), 3.0)
    r[2, 7] = np.nan
    J = np.tile([1.0, -1.0], 20)
    jacobians = [J, J, np.delete(J, 7)]
    found = fit_of_one_value(r, jacobians)
    assert found.freedom == 119 - 3 * 4 - 1
    deviation = math.sqrt(119 * 9.0 / 106) / math.sqrt(119)
    assert judge(found).deviation == pytest.approx([deviation], rel=1e-12)


def test_alignment_takes_away_as_many_numbers_as_it_is_said_to():
    # Of small errors of three poses, 18 numbers, it leaves those at right angles to motions of the
    # whole path: an orthogonal projection, whose trace is the number of what is left.
    rng, h = np.random.default_rng(5), 1e-5
    position, p = rng.uniform(-1.0, 1.0, (3, 1, 3)), random_parameters(rng, 3)[:, None]
    measured = SimpleNamespace(position=position, orientation=p)

    def left(errors):
        turns = np.concatenate([np.ones((3, 1, 1)), errors[..., 3:] / 2], axis=-1)
        q = np.concatenate([position - errors[..., :3], product(turns, p)], axis=-1)
        return aligned(measured, q, 1.0, 1.0).ravel()

    units = np.eye(18).reshape(18, 3, 1, 6) * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]
    P = np.column_stack([(left(h * e) - left(-h * e)) / (2 * h) for e in units])
    # Central differences of a smooth function of numbers around 1, and its rounding.
    assert np.abs(P @ P - P).max() < 1e-9
    assert np.trace(P) == pytest.approx(18 - ALIGNED, abs=1e-9)


def test_the_bootstrap_of_two_segments_is_known_by_hand():
    # Two segments with one curvature A and the scores g and -g: draws are both, or one of them
    # twice with probability 1/4 each, so that the quantiles of the steps are -+g/A. As the mean of
    # two numbers, whose distribution is Student's with one degree of freedom, Cauchy's, they are
    # wider by tan(0.475 pi)/1.96 and sqrt(2/1).
    J, g = np.array([2.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.5]), 0.3
    residuals = np.outer([g + 0.1, 0.1 - g], J / (J @ J))  # of which the mean, 0.1, says nothing
    judgement = judge(fit_of_one_value(residuals, [J, J]))
    wider = math.tan(0.475 * math.pi) / 1.959963984540054 * math.sqrt(2.0)
    reach = wider * g / (J @ J)
    assert judgement.bootstrap == pytest.approx(np.array([[0.5 - reach, 0.5 + reach]]), rel=1e-9)


@pytest.mark.parametrize(
    ('free', 'sentence'),
    [
        (['friction.forward_'], "unknown name 'friction.forward_'"),
        (['friction.longitudnal'], "did you mean 'friction.longitudinal'?"),
        (
            ['dt'],
            '--free dt: a fit finds only numbers of the robot and of friction; choose from: ',
        ),
        (['gait.yaw.amplitude'], 'a fit finds only numbers of the robot and of friction'),
        (['robot.link_count'], 'a fit finds only numbers of the robot and of friction'),
        (['robot.joint_limit'], 'a fit finds only numbers of the robot and of friction'),
        (['method'], "--free method: a fit finds numbers, this is 'newton'"),
        (['robot.yaw_torque_limit'], 'has no value in the scene; --set one to start from'),
        (['gravity'], 'a fit finds one number, this is a list of 3'),
        (['friction.transversal', 'friction.transversal'], 'is given twice'),
        (['friction.transversal=friction.transversal'], 'is given twice'),
        ([], '--free must name at least one value'),
    ],
)
def test_names_that_cannot_be_free(free, sentence):
    with pytest.raises(ParameterError, match=re.escape(sentence)):
        unknowns_of(Scene(), free)


def test_unknowns_keep_to_their_limits():
    scene = with_settings(Scene(), {'friction.rolling': 0.0, 'robot.yaw_stiffness': 40.0})
    stiffness, rolling = unknowns_of(scene, ['robot.yaw_stiffness', 'friction.rolling'])
    assert stiffness.is_positive and not rolling.is_positive
    low, high = stiffness.bounds
    assert low < math.log(40.0) < high
    assert rolling.bounds == (0.0, 1e6)
    assert rolling.value(-1.0) == 0.0
    both = unknowns_of(scene, ['friction.longitudinal=friction.transversal'])
    changed = scene_at(scene, both, np.log([0.3]))
    assert changed.friction.longitudinal == pytest.approx(0.3)
    assert changed.friction.transversal == changed.friction.longitudinal


# ---- the command --------------------------------------------------------------------------------


def test_commands_of_the_page_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r'^```sh\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.replace('\\\n', ' ').splitlines()]
    ran = [line for line in lines if '--duration' in line or 'run.mcap' in line]
    assert len(ran) >= 3
    for line in ran:
        words = shlex.split(line)
        assert words[0] == './run', line
        shorter = ['--duration', '4.2', '--set', 'robot.link_count=7'] if '--bag' in words else []
        if words[1] == 'fit':
            shorter = ['--segment', '1', '--burn-in', '1']
        if '--check' in words:
            shorter += ['--check', '2']
        assert main([*words[1:], *shorter]) == 0, line
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result['explained'] and result['values']['friction.transversal']['value'] > 0.0


def test_all_that_is_wrong_in_a_laboratory_is_found_by_one_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    section = PAGE.split('## A recording of a laboratory')[1].split('\n## ')[0]
    (block,) = re.findall(r'^```sh\n(.*?)^```', section, re.MULTILINE | re.DOTALL)
    run, script, one = (shlex.split(line) for line in block.replace('\\\n', ' ').splitlines())
    assert main([*run[1:], '--duration', '7.2']) == 0  # not 12, which takes longer, as all steps
    assert script[:2] == ['./run', 'python']
    monkeypatch.setattr('sys.argv', script[2:])
    runpy.run_path(script[2], run_name='__main__')
    assert main([*one[1:], '--burn-in', '1', '--set', 'accuracy=0']) == 0  # that are divided
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    made = dict(item.split('=') for item in run if '=' in item)
    truth = {name: float(value) for name, value in made.items()} | {
        'time_offset.poses': 0.04, 'marker.x': 0.03, 'frame.roll': 0.02, 'frame.pitch': -0.03
    }  # fmt: skip
    assert told['values'].keys() == truth.keys()
    for name, value in truth.items():
        found, (low, high) = told['values'][name]['value'], told['values'][name]['interval']
        # Nothing is near it at the start, and it is within twice the interval at the end.
        assert abs(told['values'][name]['start'] - value) > 2 * (high - low), name
        assert found - 2 * (found - low) < value < found + 2 * (high - found), name
        assert high - low < 0.25 * abs(value), name
    assert (tmp_path / 'fitted.yaml').is_file()


def test_the_command_writes_a_scene_and_a_picture(recording, folder, tmp_path, capsys):
    pytest.importorskip('matplotlib')
    out, plot = tmp_path / 'fitted.yaml', tmp_path / 'fit.png'
    options = ['--free', *BOTH, '--set', 'friction.longitudinal=0.2', '--segment', '1']
    files = ['--out', str(out), '--plot', str(plot)]
    assert main(['fit', str(folder / 'run.mcap'), *options, '--burn-in', '1', *files]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    value = result['values']['friction.longitudinal']
    assert value['value'] == pytest.approx(0.1, rel=1e-3)
    assert value['start'] == 0.2
    low, high = value['interval']
    assert low < value['value'] < high
    scene = load_scene(out)
    assert scene.friction.longitudinal == value['value']
    assert scene.gait == recording.scene.gait and scene.dt == recording.scene.dt
    assert out.read_text().startswith(
        '# Found by snake-sim fit in run.mcap: friction.longitudinal'
    )
    assert plot.stat().st_size > 10_000


@pytest.mark.parametrize(('name', 'remembers'), [('lateral_undulation', 0), ('sidewinding', 1)])
def test_a_start_that_is_not_forgotten_is_said_first(
    name, remembers, tmp_path, capsys, monkeypatch
):
    def refuse(*_, **__):
        raise ParameterError('nothing is fitted')  # a robot in space takes long

    monkeypatch.setattr('snake_sim_ros.studies.fit.fit', refuse)
    bag = bag_of(recording_of(load_scene(name), 2.7), tmp_path / 'run.mcap')
    options = ['--free', 'robot.yaw_damping', '--segment', '0.5', '--burn-in', '1']
    assert main(['fit', str(bag), *options]) == 2
    printed = capsys.readouterr()
    assert printed.out.startswith('the recording tells little') == bool(remembers)
    assert printed.err.endswith('nothing is fitted\n')


def test_intervals_and_scenes_that_do_not_hold_are_withheld(
    recording, tmp_path, capsys, monkeypatch
):
    suspects = 'snake_sim_ros.studies.judgement.SUSPECTS'
    monkeypatch.setattr(suspects, [('time_offset.poses',)])
    bag, out = tmp_path / 'late.mcap', tmp_path / 'fitted.yaml'
    late = replace(recording, pose_time=recording.pose_time + 0.03)
    options = ['fit', str(bag_of(late, bag)), '--free', *ONE, '--out', str(out)]
    options += ['--segment', '1', '--burn-in', '1']
    assert main(options) == 1
    text = capsys.readouterr().out
    value = json.loads(text.splitlines()[-1])['values'][BOTH[0]]
    assert value['interval'] is value['bootstrap'] is value['deviation'] is None
    assert 'within' not in text and f'{out} is not written; --force writes it' in text
    assert '--free time_offset.poses removes 100 % of what is left over' in text
    assert not out.exists()
    # What is suggested stays the same.
    monkeypatch.setattr(suspects, ())
    assert main([*options, '--force']) == 1
    text = capsys.readouterr().out
    low, high = json.loads(text.splitlines()[-1])['values'][BOTH[0]]['interval']
    assert low < high and ', 95 % within ' in text
    assert load_scene(str(out)).friction.longitudinal > 0.0


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--free', 'dt', '--segment', '1'], '--free dt'),
        (['--free', *BOTH, '--noise-position', '0'], 'noise_position must be above 0 m, got 0 m'),
        (['--free', *BOTH, '--segment', '60'], 'must have at least 122.1'),
        (['--free', *BOTH, '--threads', '0'], '--threads must be at least 1, got 0'),
        (['--free', *BOTH, '--global', '-1'], '--global must be at least 0, got -1'),
        (
            ['--free', *BOTH, '--out', 'fitted.txt'],
            '--out must end in .yaml or .yml, got fitted.txt',
        ),
        (['--free', *BOTH, '--out', 'nowhere/f.yaml'], '--out: no folder'),
        (['--free', *BOTH, '--plot', 'fit.txt'], '--plot must end in .png'),
        (['--free', *BOTH, '--scene', 'nowhere'], 'nowhere'),
        (
            ['--free', *BOTH, '--set', 'robot.link_count=5'],
            'robot.link_count must be the 7 of the bag, got 5',
        ),
    ],
)
@pytest.mark.usefixtures('recording')
def test_arguments_are_refused_in_one_sentence(folder, arguments, sentence, capsys):
    pytest.importorskip('matplotlib')
    assert main(['fit', str(folder / 'run.mcap'), *arguments]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len([line for line in errors if line.startswith('snake-sim: ')]) == 1
    assert sentence in errors[-1]


def test_the_page_names_every_option(capsys):
    with pytest.raises(SystemExit):
        main(['fit', '--help'])
    options = set(re.findall(r'--[a-z][a-z-]+', capsys.readouterr().out)) - {'--help'}
    assert options <= set(re.findall(r'`(--[a-z-]+)', PAGE))


def test_a_robot_of_single_axes_is_fitted(tmp_path):
    wave = Wave(amplitude=0.5, angular_frequency=2.0, phase_lag=-0.6)
    scene = Scene(
        robot=modular_robot(6), gait=Gait(yaw=wave, soft_start=1.0),
        friction=Friction(longitudinal=0.1, transversal=0.5),
    )  # fmt: skip
    recording = read_recording(bag_of(recording_of(scene, 3.2), tmp_path / 'run.mcap'))
    assert recording.scene.robot == scene.robot
    # Yaw of joints 1, 3 and 5, pitch of 2 and 4; the others are not measured.
    assert np.isfinite(recording.joint_angle).all(axis=0).tolist() == [
        [True, False], [False, True], [True, False], [False, True], [True, False],
    ]  # fmt: skip
    replay = replay_of(recording, **{'friction.longitudinal': 0.15})
    exact = fit(replay, unknowns_of(replay.scene, ['friction.longitudinal']), threads=1)
    assert exact.values == pytest.approx([0.1], rel=1e-2)
