# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Studies: what varies, what is measured, the table, and that every run comes out the same."""

from dataclasses import fields
import itertools
import json
import math
from pathlib import Path
import re

import numpy as np
import pytest

from snake_sim_ros import ParameterError, Report, Scene, Simulation, study
from snake_sim_ros.commands.main import main
from snake_sim_ros.recording.recorded_runs import read_npz
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, samples_of, with_settings
from snake_sim_ros.stepping.methods import with_usual_steps
from snake_sim_ros.stepping.sampling import Keep
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.trajectory import OF_CONTACTS, OF_SAMPLES, Trajectory
from snake_sim_ros.studies import runs, workers
from snake_sim_ros.studies.metrics import metric_of, MetricError, METRICS, USUAL_METRICS
from snake_sim_ros.studies.study import load_study, study_from, STUDY_KEYS, StudySettings
from snake_sim_ros.studies.table import Journal, journal_of
from snake_sim_ros.studies.variations import Listed, Normal, Range, Variations

polars = pytest.importorskip('polars')
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'studies.md').read_text(encoding='utf-8')
EXAMPLE = ROOT / 'examples' / 'friction_and_amplitude.yaml'
SHORT = {'duration': 0.5}
ON_A_PATH = {**SHORT, 'follow.center': [0.0, -1.5]}
FRICTION = {'friction.transversal': [0.3, 0.4, 0.5]}


def values(frame, without=('seconds',)):
    """Return a table without what differs from run to run."""
    return frame.drop(list(without))


# ---- what varies --------------------------------------------------------------------------------


def rows(variations):
    return [variations.row(k) for k in range(len(variations))]


def test_a_grid_has_every_combination_and_a_list_has_its_rows():
    of = {'a': Listed((1, 2)), 'b': Range(low=0.0, high=1.0, count=3)}
    assert rows(Variations(of)) == [{'a': a, 'b': b} for a in (1, 2) for b in (0.0, 0.5, 1.0)]
    of = {'a': Listed((1, 2, 3)), 'b': Range(low=1.0, high=100.0, count=3, scale='log')}
    found = rows(Variations(of, 'list'))
    assert [row['a'] for row in found] == [1, 2, 3]
    assert [row['b'] for row in found] == pytest.approx([1.0, 10.0, 100.0], rel=1e-15)


@pytest.mark.parametrize('sampling', ['random', 'sobol', 'latin_hypercube'])
def test_drawn_values_have_their_distributions(sampling):
    of = {
        'uniform': Range(low=2.0, high=4.0),
        'log': Range(low=1e-2, high=1e2, scale='log'),
        'normal': Normal(mean=5.0, deviation=2.0),
        'word': Listed(('newton', 'bdf2')),
    }
    found = rows(Variations(of, sampling, 1024, 3))
    drawn = {name: np.array([row[name] for row in found]) for name in of}
    assert (drawn['uniform'] >= 2.0).all() and (drawn['uniform'] <= 4.0).all()
    # The mean of 1024 independent draws is off by less than 4 deviations / sqrt(1024), all but
    # once in 10^4 times; the designs are closer.
    assert drawn['uniform'].mean() == pytest.approx(3.0, abs=4 * 2 / math.sqrt(12 * 1024))
    assert np.log10(drawn['log']).mean() == pytest.approx(0.0, abs=4 * 4 / math.sqrt(12 * 1024))
    assert drawn['normal'].mean() == pytest.approx(5.0, abs=4 * 2 / math.sqrt(1024))
    assert drawn['normal'].std() == pytest.approx(2.0, rel=0.15)
    assert (drawn['word'] == 'bdf2').mean() == pytest.approx(0.5, abs=4 * 0.5 / math.sqrt(1024))
    if sampling == 'latin_hypercube':  # one value in each of 1024 equal parts
        assert len(set(np.floor((drawn['uniform'] - 2.0) / 2.0 * 1024))) == 1024


def test_values_belong_to_seed_and_row():
    of = {'a': Range(low=0.0, high=1.0), 'b': Normal(mean=0.0, deviation=1.0)}
    for sampling in ('random', 'sobol'):
        few, many = (rows(Variations(of, sampling, count, 7)) for count in (5, 50))
        assert many[:5] == few
        assert rows(Variations(of, sampling, 5, 8)) != few
    # Another value that varies leaves those before it.
    (one,) = rows(Variations({'a': of['a']}, 'random', 1, 7))
    assert rows(Variations(of, 'random', 1, 7))[0]['a'] == one['a']


BAD = [
    ({}, 'a study must have scene'),
    ({'scene': 'sidewinding'}, 'a study must have vary'),
    ([1], r'a study must be a mapping of names to values, got \[1\]'),
    ({'scene': 'sidewindin', 'vary': FRICTION}, "did you mean 'sidewinding'?"),
    ({'scene': 3, 'vary': FRICTION}, 'scene must be a file or a name such as sidewinding, got 3'),
    ({'vari': 1, 'scene': 'step'}, "unknown key 'vari'; did you mean 'vary'?"),
    ({'vary': 3}, 'vary must be a mapping of names to values, got 3'),
    ({'vary': {}}, 'vary must name a value of the scene'),
    ({'vary': {'friction.transversl': [1]}}, "did you mean 'friction.transversal'?"),
    ({'vary': {3: [1]}}, 'vary: unknown name 3'),
    ({'vary': {'friction': [1]}}, "vary: unknown name 'friction'"),
    ({'vary': {'duration_deg': [1]}}, 'vary: duration_deg: duration is not an angle'),
    ({'vary': {'friction.rolling': 0.1}}, 'must be like .*, got 0.1; what does not vary'),
    ({'vary': {'friction.rolling': []}}, 'friction.rolling must have values, got an empty list'),
    ({'vary': {'friction.rolling': [0.1, math.nan]}}, 'friction.rolling must be finite, got nan'),
    ({'vary': {'friction.rolling': [math.inf]}}, 'friction.rolling must be finite, got inf'),
    ({'vary': {'friction.rolling': [None]}}, 'must have numbers or texts, got None'),
    ({'vary': {'friction.rolling': {'low': 0}}}, 'vary: friction.rolling has no high'),
    ({'vary': {'friction.rolling': {'mean': 0}}}, 'vary: friction.rolling has no deviation'),
    (
        {'vary': {'friction.rolling': {'low': 0, 'hihg': 1}}},
        "vary: friction.rolling: unknown key 'hihg'; did you mean 'high'?",
    ),
    (
        {'vary': {'friction.rolling': {'low': 0, 'high': math.nan, 'count': 2}}},
        'friction.rolling: high must be finite, got nan',
    ),
    (
        {'vary': {'friction.rolling': {'low': 1, 'high': 0, 'count': 2}}},
        'high must be above low, 1, got 0',
    ),
    (
        {'vary': {'friction.rolling': {'low': 0, 'high': 1, 'count': 2, 'scale': 'log'}}},
        'low must be above 0 for the scale log, got 0',
    ),
    ({'vary': {'friction.rolling': {'low': 0, 'high': 1}}}, 'needs a count of values'),
    ({'vary': {'friction.rolling': {'mean': 0, 'deviation': 1}}}, 'needs sampling random, sobol'),
    (
        {'vary': {'friction.rolling': [1, 2], 'dt': [0.1]}, 'sampling': 'list'},
        'a list needs values of one length, got 2, 1 values',
    ),
    (
        {'vary': {'gait.yaw.phase': [1], 'gait.yaw.phase_deg': [1]}},
        'vary: gait.yaw.phase is given twice',
    ),
    ({'set': {'friction.transversal': 1}}, 'friction.transversal must be in set or in vary'),
    ({'set': {'duration': -1}}, 'set: duration must be above 0 s, got -1 s'),
    ({'set': {'durations': 1}}, "set: unknown name 'durations'; did you mean 'duration'?"),
    ({'sampling': 'soboll'}, 'sampling must be one of grid, list'),
    ({'sampling': 'random'}, 'samples must be given for sampling random'),
    ({'samples': 3}, 'samples is for random, sobol, latin_hypercube; a grid has the rows'),
    ({'sampling': 'random', 'samples': -1}, 'samples must be at least 0, got -1'),
    ({'sampling': 'random', 'samples': 2.5}, 'samples must be a whole number, got 2.5'),
    ({'rate': 0}, 'rate must be above 0 Hz, got 0 Hz'),
    ({'rate': math.nan}, 'rate must be finite, got nan Hz'),
    ({'keep': 'all'}, 'keep must be one of metrics, trajectories'),
    ({'metrics': []}, r'metrics must be a list such as .*, got \[\]'),
    ({'metrics': 'speed'}, "metrics must be a list such as .*, got 'speed'"),
    ({'metrics': ['spede']}, "metrics: unknown name 'spede'; did you mean 'speed'?"),
    ({'metrics': ['speed', 'speed']}, 'metrics: speed is given twice'),
    (
        {'metrics': [{'steady': {'of': 'peak_torque', 'begn': 1}}]},
        "metrics: steady: unknown key 'begn'; did you mean 'begin'?",
    ),
    ({'metrics': [{'steady': {'begin': 1}}]}, 'metrics: steady has no metric; it must be like'),
    ({'metrics': [{'speed': {'of': 'speed'}}]}, 'metrics: speed needs a name of its own'),
    ({'metrics': [{}]}, 'metrics: a window must be like {steady_torque'),
    (
        {'metrics': [{'steady': {'of': 'speed', 'begin': 2, 'end': 1}}]},
        'end must be after begin, 2 s, got 1 s',
    ),
    (
        {'metrics': [{'steady': {'of': 'speed', 'begin': 2, 'cycles': 1}}]},
        'a window has begin or cycles, got begin 2 s and cycles 1',
    ),
    (
        {'metrics': [{'steady': {'of': 'speed', 'quantile': 0.9}}]},
        'quantile is for peak_torque, angle_error and cross_track_peak, got quantile 0.9 of speed',
    ),
    ({'metrics': [3]}, 'metrics must be names or functions, got 3'),
    ({'metrics': ['no_such_module:f']}, 'module no_such_module cannot be imported'),
    ({'metrics': ['math:hypo']}, "module math has no function 'hypo'; did you mean 'hypot'?"),
]


@pytest.mark.parametrize(('given', 'sentence'), BAD)
def test_what_is_not_usable_is_refused_in_one_sentence(given, sentence):
    whole = isinstance(given, list) or 'scene' in given or not given
    mapping = given if whole else {'scene': 'lateral_undulation', 'vary': FRICTION, **given}
    with pytest.raises(ParameterError, match=sentence) as caught:
        study_from(mapping)
    assert '\n' not in str(caught.value)


def test_files_that_are_not_usable_are_named(tmp_path):
    path = tmp_path / 'my.yaml'
    with pytest.raises(ParameterError, match=r'no file .*my\.yaml'):
        load_study(path)
    for text, sentence in (
        ('scene: [', 'my.yaml: not readable as YAML'),
        ('scene: sidewinding\nscene: step', "key 'scene' is written twice"),
        ('scene: sidewinding\nvary: {dt: []}', 'my.yaml: vary: dt must have values'),
    ):
        path.write_text(text)
        with pytest.raises(ParameterError, match=sentence):
            load_study(path)


# ---- what is measured ---------------------------------------------------------------------------


def moving(velocity, spin=0.0, robot=None):
    """Return 2 s of a robot of 2 links that slides straight on, without any dynamics."""
    scene = with_settings(Scene(), {'robot.link_count': 2} | (robot or {}))
    time = np.linspace(0.0, 2.0, 21)
    position = np.zeros((21, 2, 3))
    position[:, 1, 0] = 0.122  # link 1 is ahead, the robot looks against e_x
    position[:, :, :2] += time[:, None, None] * np.asarray(velocity)
    position[:, :, 2] = 0.0525
    u = np.zeros((21, 2, 6))
    u[:, :, :2] = velocity
    u[:, 1, 4] = spin  # e_y of B is e_z of I
    reference, _ = gait.reference(scene.gait, time, 1)
    force = np.tile([[1.0, 0.0, 2.0], [1.0, 0.0, 6.0]], (21, 1))
    return Trajectory(
        scene=scene,
        time=time,
        position=position,
        orientation=np.full((21, 2, 4), 0.5),
        joint_angle=scene.robot.by_axis(reference).copy(),
        joint_velocity=np.zeros((21, 2)),
        joint_torque=np.zeros((21, 2)),
        contact_sample=np.repeat(np.arange(21), 2),
        contact_number=np.tile([0, 1], 21),
        contact_point=np.zeros((42, 3)),
        contact_force=force,
        level=np.full(21, 'planar'),
        report=Report(),
        seconds=0.0,
        interrupted=False,
        velocity=u,
    )


def measured(name, trajectory):
    return METRICS[name](trajectory)


def test_metrics_of_a_straight_motion():
    trajectory = moving((-0.3, -0.4))
    expected = {
        'distance': 1.0, 'speed': 0.5, 'forward': 0.6, 'sideways': 0.8,
        'direction': math.atan2(0.8, 0.6), 'energy': 0.0, 'peak_torque': 0.0, 'slip': 0.5,
    }  # fmt: skip
    for name, value in expected.items():
        assert measured(name, trajectory) == pytest.approx(value, abs=1e-14), name
    assert measured('cost_of_transport', moving((0.0, 0.0))) == math.inf


def test_metrics_of_a_path_beside_the_way():
    # 1 m in 2 s toward -x, 0.1 m to the left of the path; four cycles of 0.25 m each.
    wave = {'gait.yaw.amplitude': 0.1, 'gait.yaw.angular_frequency': 4 * math.pi}
    values = {'follow.points': [[5.0, 0.1], [-9.0, 0.1]], **wave}
    expected = {
        'cross_track': 0.1, 'cross_track_peak': 0.1, 'cross_track_mean': 0.1, 'covered': 1.0,
    }  # fmt: skip
    for speed, jams in ((0.5, 0), (4.9, 0), (5.1, 4)):
        trajectory = moving((-0.5, 0.0), robot={**values, 'follow.speed': speed})
        for name, value in {**expected, 'jams': jams}.items():
            assert measured(name, trajectory) == pytest.approx(value, abs=1e-13), (speed, name)
    still = moving((-0.5, 0.0), robot={**values, 'gait.yaw.angular_frequency': 0.0})
    with pytest.raises(MetricError, match='the gait has no cycle'):
        measured('jams', still)


def test_the_center_of_mass_counts():
    trajectory = moving((0.0, 0.0), robot={'robot.link_mass': [1.0, 3.0]})
    trajectory.position[-1, 1, 1] += 0.4
    assert measured('distance', trajectory) == pytest.approx(0.3, abs=1e-15)


def test_energy_torque_and_angle_error():
    trajectory = moving((-0.5, 0.0))
    # tau = 3 t and -2, phi' = 1 and 4: the power is 3 t + 8, and its integral over 2 s is 22.
    trajectory.joint_torque[:, :2] = np.column_stack([3 * trajectory.time, np.full(21, -2.0)])
    trajectory.joint_velocity[:, :2] = 1.0, 4.0
    trajectory.joint_angle[7, 1] -= 0.01
    assert measured('energy', trajectory) == pytest.approx(22.0, rel=1e-14)
    weight = 2 * 7.5 / 11 * 9.81
    assert measured('cost_of_transport', trajectory) == pytest.approx(22 / weight, rel=1e-14)
    assert measured('peak_torque', trajectory) == 6.0
    assert measured('angle_error', trajectory) == pytest.approx(0.01, rel=1e-12)


def test_slip_is_weighted_with_loads():
    # The front sphere of link 1 slides at 0.5 m/s under 2 N; that of link 2 under 6 N turns about
    # its center, 0.0393 m behind it, at 1 rad/s besides.
    trajectory = moving((-0.5, 0.0), spin=1.0)
    expected = (2.0 * 0.5 + 6.0 * math.hypot(0.5, 0.0393)) / 8.0
    assert measured('slip', trajectory) == pytest.approx(expected, rel=1e-14)
    trajectory.contact_number[:] = 44  # a contact with something else than the floor
    assert measured('slip', trajectory) == 0.0


def test_slip_is_that_on_the_floor_whatever_pegs_carry():
    # In every other sample a peg pushes link 1, and link 2 is on the floor alone: 0 and 1 are the
    # front spheres on the floor, 4 is link 1 at the first peg.
    trajectory = moving((-0.5, 0.0), spin=1.0)
    trajectory.contact_number[::4] = 4
    trajectory.contact_force[::4] = 90.0, 0.0, 50.0
    loads = np.array([2.0 * 10, 6.0 * 21])  # link 1 in 10 of 21 samples
    expected = loads @ [0.5, math.hypot(0.5, 0.0393)] / loads.sum()
    assert measured('slip', trajectory) == pytest.approx(expected, rel=1e-14)


def test_cost_of_transport_is_of_the_whole_weight_on_a_slope():
    # 1 J over 1 m; g = |(3, 0, -4)| m/s^2, of which only 4 are across the floor.
    trajectory = moving((-0.5, 0.0), robot={'gravity': [3.0, 0.0, -4.0]})
    trajectory.joint_torque[:, 0], trajectory.joint_velocity[:, 0] = 0.25, -2.0
    weight = 2 * 7.5 / 11 * 5.0
    assert measured('cost_of_transport', trajectory) == pytest.approx(1 / weight, rel=1e-14)


def test_metrics_are_those_of_the_same_run_alone():
    scene = with_settings(load_scene('lateral_undulation'), {'friction.transversal': 0.3})
    scene, names = with_settings(scene, ON_A_PATH), list(METRICS)
    vary = {'friction.transversal': [0.3]}
    frame = study('lateral_undulation', vary, names, set=ON_A_PATH, rate=40)
    scene = with_usual_steps(scene, (), 1 / 40)
    keep = Keep(contacts=True, joints=True)
    alone = sample(Simulation(scene), *samples_of(scene, 40.0), keep=keep)
    for name in names:
        assert frame[name][0] == measured(name, alone), name


def test_peaks_and_integrals_are_those_of_the_steps():
    fine = {'duration': 0.5, 'dt': 0.0025}
    names = ['energy', 'peak_torque', 'angle_error', 'slip']
    vary = {'friction.transversal': [0.3]}
    coarse, full = (
        study('lateral_undulation', vary, names, set=fine, rate=rate).row(0, named=True)
        for rate in (20, 400)
    )
    for name in names[:3]:
        assert coarse[name] == full[name], name
    assert coarse['slip'] != full['slip']


def test_joints_of_every_step_leave_the_run_alone():
    scene = with_settings(load_scene('lateral_undulation'), {'duration': 3.0, 'dt': 0.0025})
    keep = Keep(contacts=True, impulses=True)
    plain = sample(Simulation(scene), 20, 60, keep=keep)
    full = sample(Simulation(scene), 20, 60, keep=keep._replace(joints=True))
    for name in (*OF_SAMPLES, *OF_CONTACTS):
        assert np.array_equal(getattr(plain, name), getattr(full, name)), name
    assert not plain.joint_steps.size and full.joint_steps.shape[1] == 1201
    names = 'joint_angle', 'joint_velocity', 'joint_torque'
    for name, rows in zip(names, full.joint_steps, strict=True):
        assert np.array_equal(rows[::20], getattr(full, name)), name


def windowed(**given):
    return metric_of({'part': given})


def test_a_window_is_a_part_of_the_run():
    trajectory = moving((-0.5, 0.0))
    time = trajectory.time
    trajectory.joint_torque[:, 0] = np.where(time < 0.25, 9.0, time)
    trajectory.joint_velocity[:, 0] = 2.0
    assert windowed(of='peak_torque')(trajectory) == 9.0
    assert windowed(of='peak_torque', begin=0.5)(trajectory) == 2.0
    assert windowed(of='peak_torque', begin=0.5, end=1.5)(trajectory) == 1.5
    assert windowed(of='energy', begin=1.0, end=2.0)(trajectory) == pytest.approx(3.0)
    assert windowed(of='distance', begin=1.0, end=1.5)(trajectory) == pytest.approx(0.25)
    assert windowed(of='speed', begin=1.0, end=1.5)(trajectory) == pytest.approx(0.5)
    assert windowed(of='slip', begin=1.0, end=1.5)(trajectory) == pytest.approx(0.5)
    assert windowed(of='angle_error', begin=1.0)(trajectory) == 0.0
    # The largest torques of the 21 samples are 9, 9, 9, 2.0, 1.9: at most 2.0 in 18/21 of them.
    assert windowed(of='peak_torque', quantile=18 / 21)(trajectory) == 2.0
    assert windowed(of='peak_torque', quantile=17 / 21)(trajectory) == pytest.approx(1.9)
    with pytest.raises(MetricError, match='metric part: the window from 1 s to 3 s is not within'):
        windowed(of='speed', begin=1.0, end=3.0)(trajectory)
    with pytest.raises(MetricError, match='shorter than a sample: raise rate'):
        windowed(of='speed', begin=1.01, end=1.02)(trajectory)


def test_a_window_of_whole_cycles_ends_with_the_run():
    wave = {'gait.yaw.amplitude': 0.5, 'gait.yaw.angular_frequency': 2 * math.pi / 0.5}
    trajectory = moving((-0.5, 0.0), robot=wave)
    trajectory.joint_torque[:, 0] = np.where(trajectory.time < 0.95, 9.0, 1.0)
    assert windowed(of='peak_torque', cycles=2)(trajectory) == 1.0
    assert windowed(of='peak_torque', cycles=3)(trajectory) == 9.0
    assert windowed(of='speed', cycles=3)(trajectory) == pytest.approx(0.5)
    with pytest.raises(MetricError, match=r'the window from -0\.5 s to 2 s is not within'):
        windowed(of='speed', cycles=5)(trajectory)
    uneven = wave | {'gait.pitch.amplitude': 0.1, 'gait.pitch.angular_frequency': 9.0}
    for robot in ({}, uneven):
        with pytest.raises(MetricError, match='the gait has no cycle: name begin and end'):
            windowed(of='speed', cycles=1)(moving((-0.5, 0.0), robot=robot))


def test_windows_are_columns_that_a_kept_trajectory_gives(tmp_path, monkeypatch):
    steady = {'steady': {'of': 'peak_torque', 'begin': 0.25}}
    keep = {'set': SHORT, 'out': tmp_path / 'a.parquet', 'trajectories': tmp_path / 'runs'}
    expected = study('lateral_undulation', FRICTION, ['peak_torque', steady], set=SHORT)
    assert (expected['steady'] <= expected['peak_torque']).all()
    study('lateral_undulation', FRICTION, ['speed'], **keep)
    monkeypatch.setattr(runs, 'Simulation', None)  # no run is done again
    frame = study('lateral_undulation', FRICTION, ['peak_torque', steady], **keep)
    names = ['peak_torque', 'steady']
    assert frame.select(names).equals(expected.select(names))


# ---- the table ----------------------------------------------------------------------------------


def test_failed_runs_are_rows():
    def picky(trajectory):
        if trajectory.scene.friction.transversal > 0.45:
            raise ZeroDivisionError('too slippery to say')
        return np.float64(trajectory.time[-1])

    def wordy(trajectory):
        return 'far'

    vary = {'friction.transversal': [0.4, 0.5, -1.0], 'gait.yaw.amplitude_deg': [30, 50]}
    frame = study('lateral_undulation', vary, ['speed', picky], set=SHORT)
    beyond = 'amplitude plus offset of gait.yaw must be within the joint limit, +-0.7854 rad, got '
    assert frame['status'].to_list() == ['converged', 'refused', 'failed', *['refused'] * 3]
    assert frame['picky'].to_list() == [0.5, *[None] * 5]
    assert frame['speed'][2] > 0.0  # it has its number, whatever another metric does
    assert frame['failure'][1].startswith(beyond)
    assert frame['failure'][2] == 'metric picky raised ZeroDivisionError: too slippery to say'
    assert frame['failure'][4] == 'friction.transversal must be at least 0, got -1'
    frame = study('lateral_undulation', FRICTION, [wordy], set=SHORT)
    assert set(frame['failure']) == {"metric wordy must return a number, got 'far'"}
    # A step that diverges: stiff explicit control with large steps.
    wild = {**SHORT, 'method': 'newton', 'pd_scheme': 'start', 'robot.yaw_stiffness': 1e5}
    frame = study('lateral_undulation', {'dt': [0.01]}, ['speed'], set=wild, rate=10)
    assert frame['status'].to_list() == ['diverged'] and frame['speed'][0] is None
    assert 'would turn by' in frame['failure'][0]


def test_any_value_of_a_scene_varies():
    vary = {
        'method': ['newton', 'bdf2'], 'gravity': [[0.0, 0.0, -9.81], [1.0, 0.0, -9.7]],
        'robot.link_count': [3], 'self_contact': [False],
    }  # fmt: skip
    frame = study('lateral_undulation', vary, ['distance'], set={'duration': 0.1, 'dt': 0.001})
    assert frame['status'].to_list() == ['converged'] * 4
    assert frame['method'].to_list() == ['newton', 'newton', 'bdf2', 'bdf2']
    assert json.loads(frame['gravity'][1]) == [1.0, 0.0, -9.7]
    assert frame['robot.link_count'].dtype == polars.Int64
    assert len(set(frame['distance'])) == 4


@pytest.mark.parametrize('name', ['table.parquet', 'table.csv'])
def test_rows_that_are_done_are_not_run_again(tmp_path, name):
    out, seen = tmp_path / name, []

    def observe(results, is_new):
        seen.extend((result['row'], is_new) for result in results)

    def again(friction, metrics=('speed', 'slip')):
        seen.clear()
        vary = {'friction.transversal': friction}
        frame = study('lateral_undulation', vary, metrics, set=SHORT, out=out, observe=observe)
        return frame, {row for row, is_new in seen if is_new}

    first, ran = again([0.3, 0.4, -1.0])
    assert ran == {0, 1, 2}
    same, ran = again([0.3, 0.4, -1.0])
    assert ran == {2}  # what was refused is looked at again
    assert same.drop('seconds').equals(first.drop('seconds'))
    more, ran = again([0.4, 0.35, 0.3])
    assert ran == {1}
    assert more['speed'][2] == first['speed'][0]
    _, ran = again([0.4, 0.35], ['speed'])
    assert not ran
    _, ran = again([0.4, 0.35], ['speed', 'energy'])  # which is not in the table
    assert ran == {0, 1}
    _, ran = again([0.4], [own_metric])
    assert ran == {0}
    assert not again([0.4], [own_metric])[1]
    # What was not asked for has stayed: rows and metrics of all the tables before.
    last, ran = again([0.3, 0.4, 0.35], ['slip', own_metric, 'speed'])
    assert ran == {0, 2}  # of which the own metric is not known
    assert last['slip'][1] == first['slip'][1]
    assert not again([0.3, 0.4, 0.35], ['slip', 'speed'])[1]


def own_metric(trajectory):
    return trajectory.time[-1]


def test_a_journal_is_whole_whatever_was_cut_off(tmp_path):
    path = tmp_path / 'table.parquet.journal'
    journal = Journal(path)
    with pytest.raises(ParameterError, match='is being written by another study'):
        Journal(path)
    a, b, d = (
        {'key': key, 'status': 'converged', 'failure': '', 'unconverged': 0, 'seconds': 1.0,
         'metrics': {'x': x}} for key, x in (('a', math.inf), ('b', 0.1 + 0.2), ('d', 0.5))
    )  # fmt: skip
    journal.add([a, b])
    journal.close()
    path.write_bytes(path.read_bytes() + b'{"key": "c", "x"')
    journal = Journal(path)
    assert journal.runs() == [a, b]
    journal.add([d])
    assert journal.runs() == [a, b, d]
    journal.close()


def test_a_table_whose_runs_are_lost_is_not_written_over(tmp_path):
    out = tmp_path / 'table.parquet'
    study('lateral_undulation', FRICTION, ['speed'], set=SHORT, out=out)
    content = out.read_bytes()
    journal_of(out).unlink()
    with pytest.raises(ParameterError, match=r'there is no table\.parquet\.journal beside it'):
        study('lateral_undulation', FRICTION, ['speed'], set=SHORT, out=out)
    assert out.read_bytes() == content and not journal_of(out).exists()


def test_files_that_are_no_tables_are_left_alone(tmp_path):
    for name, content, sentence in (
        ('a.parquet', b'broken', 'is not the table of a study'),
        ('a.csv', b'x,y\n1,2\n', 'is not the table of a study'),
        ('a.txt', b'', '--out must end in .parquet or .csv'),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(ParameterError, match=sentence):
            study('lateral_undulation', FRICTION, ['speed'], set=SHORT, out=path)
        assert path.read_bytes() == content


def test_trajectories_are_kept(tmp_path):
    out, folder = tmp_path / 'a.parquet', tmp_path / 'runs'
    keep = {'set': SHORT, 'out': out, 'trajectories': folder}
    frame = study('lateral_undulation', FRICTION, ['distance'], **keep)
    for name, friction, way in frame.select('trajectory', *FRICTION, 'distance').iter_rows():
        trajectory = read_npz(folder / name)
        assert trajectory.scene.friction.transversal == friction
        assert measured('distance', trajectory) == way
    (folder / frame['trajectory'][1]).unlink()
    again = study('lateral_undulation', FRICTION, ['distance'], **keep)
    assert values(again).equals(values(frame))
    assert len(list(folder.iterdir())) == 3


def test_other_metrics_take_kept_trajectories(tmp_path, monkeypatch):
    def broken(trajectory):
        raise ValueError('no')

    keep = {'set': ON_A_PATH, 'out': tmp_path / 'a.parquet', 'trajectories': tmp_path / 'runs'}
    first = study('lateral_undulation', FRICTION, ['slip', broken], **keep)
    assert set(first['status']) == {'failed'}
    full = [name for name in METRICS if name != 'slip']
    expected = study('lateral_undulation', FRICTION, full, set=ON_A_PATH)
    monkeypatch.setattr(runs, 'Simulation', None)  # no run is done again
    # Where only what failed is missing, it is tried with the trajectory.
    again = study('lateral_undulation', FRICTION, ['slip', broken], **keep)
    assert values(again).equals(values(first))
    frame = study('lateral_undulation', FRICTION, [*METRICS, own_metric], **keep)
    assert frame['slip'].equals(first['slip'])
    assert set(frame['status']) == {'converged'} and set(frame['own_metric']) == {0.5}
    assert frame.select(full).equals(expected.select(full))
    # Without what has failed the others are known.
    frame = study('lateral_undulation', FRICTION, ['slip'], **keep)
    assert set(frame['status']) == {'converged'} and set(frame['failure']) == {''}


def test_a_metric_that_fails_does_not_hide_steps_that_did_not_converge():
    def broken(trajectory):
        raise ValueError('no')

    # An iteration a step is not enough for any contact.
    given = {**SHORT, 'method': 'newton', 'dt': 0.01, 'solver.iteration_limit': 1}
    frame = study('lateral_undulation', FRICTION, ['speed', broken], set=given)
    assert set(frame['status']) == {'max_iterations'} and frame['unconverged'].min() > 0
    assert set(frame['failure']) == {'metric broken raised ValueError: no'}


def test_a_run_that_takes_too_long_is_a_row(tmp_path):
    keep = {'set': SHORT, 'out': tmp_path / 'a.parquet', 'trajectories': tmp_path / 'runs'}
    new = []

    def again(limit):
        new.clear()
        return study(
            'lateral_undulation', FRICTION, ['speed'], time_limit=limit, **keep,
            observe=lambda results, is_new: new.extend(results if is_new else ()),
        )  # fmt: skip

    frame = again(1e-9)
    assert set(frame['status']) == {'out_of_time'} and frame['speed'].null_count() == 3
    assert set(frame['failure']) == {'0 s of 0.5 s were simulated within the time_limit, 1e-09 s'}
    assert again(1e-10).equals(frame) and not new
    assert set(again(100.0)['status']) == {'converged'} and len(new) == 3
    assert set(again(1e-9)['status']) == {'converged'} and not new


# ---- workers ------------------------------------------------------------------------------------


def test_bits_are_the_same_for_any_number_of_workers():
    # Rows of both levels, with and without contacts, some of them refused.
    vary = {
        'gait.yaw.amplitude_deg': {'low': 20, 'high': 50},
        'gait.pitch.amplitude_deg': [0, 5],
        'friction.transversal': {'low': 0.05, 'high': 1.0, 'scale': 'log'},
    }
    metrics = ['speed', 'direction', 'slip', 'cost_of_transport', 'angle_error']
    given = {'set': SHORT, 'sampling': 'random', 'samples': 24, 'seed': 5}

    def table(workers_):
        return study('lateral_undulation', vary, metrics, workers=workers_, **given)

    one = table(workers.threads(1))
    assert set(one['status']) == {'converged', 'refused'}
    for others in (workers.threads(2), workers.threads(5), workers.processes(2)):
        assert values(table(others)).equals(values(one))


# ---- the command --------------------------------------------------------------------------------


def test_the_command_ends_with_a_line_of_json(tmp_path, monkeypatch, capsys):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'turns.py').write_text(
        'def samples(trajectory):\n    return len(trajectory.time)\n'
    )
    (tmp_path / 'my.yaml').write_text(
        'scene: lateral_undulation\n'
        'set: {duration: 0.5}\n'
        'vary: {friction.transversal: [0.3, 0.4], gait.yaw.amplitude_deg: [30, 60]}\n'
        'metrics: [speed, "turns:samples"]\n'
    )
    assert main(['study', 'my.yaml', '--plot', 'my.png', '--threads', '2']) == 0
    output = capsys.readouterr()
    summary = json.loads(output.out.splitlines()[-1])
    assert (summary['rows'], summary['done'], summary['found']) == (4, 4, 0)
    assert (summary['converged'], summary['refused'], summary['out']) == (2, 2, 'my.parquet')
    assert 'runs/s' in output.err and 'beyond' not in output.err
    assert 'the first failure: amplitude plus offset of gait.yaw must be within' in output.err
    frame = polars.read_parquet('my.parquet')
    assert frame['turns:samples'].to_list() == [11.0, None, 11.0, None]
    assert (tmp_path / 'my.png').read_bytes().startswith(b'\x89PNG')
    assert main(['study', 'my.yaml', '--plot', 'my.svg']) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])['found'] == 2


def test_values_follow_those_that_vary():
    across, along = 'friction.transversal', 'friction.longitudinal'
    vary = {across: [0.2, 0.4], 'method': ['newton', 'bdf2']}
    frame = study('lateral_undulation', vary, set=SHORT, follow={along: f'0.25 * {across}'})
    assert frame[along].to_list() == [0.05, 0.05, 0.1, 0.1]
    alone = study(
        'lateral_undulation', {across: [0.4]}, set=SHORT | {along: 0.1, 'method': 'bdf2'}
    )
    assert frame['energy'][3] == alone['energy'][0]
    for follow, sentence in (
        ({along: 'method'}, f'follow: {along} depends on method, whose values must be numbers'),
        ({along: 'frictio'}, 'frictio'),
        ({across: f'2 * {across}'}, f'follow: {across} must not be in set or in vary as well'),
    ):
        with pytest.raises(ParameterError, match=re.escape(sentence)):
            study('lateral_undulation', vary, set=SHORT, follow=follow)


def test_three_values_are_maps_for_each_of_the_third(tmp_path, monkeypatch):
    chart = pytest.importorskip('snake_sim_ros.studies.chart')
    drawn = []
    monkeypatch.setattr(chart, 'write_figure', lambda figure, *_, **__: drawn.append(figure))
    names = ['friction.transversal', 'duration', 'method']
    places = list(itertools.product([0.1, 1.0, 10.0], [1.0, 2.0], ['bdf2', 'newton']))
    frame = polars.DataFrame(places, schema=names, orient='row').with_columns(
        speed=np.arange(12.0), slip=np.full(12, np.nan)
    )
    metrics = [METRICS['speed'], METRICS['slip']]
    chart.draw_study(frame, names, {names[0]: 'log'}, metrics, tmp_path / 'my.png')
    panels = drawn[0].axes[::2]  # each with a bar of colors
    titles = ['speed [m/s], method = bdf2', 'speed [m/s], method = newton']
    assert [axes.get_title() for axes in panels][:2] == titles and len(panels) == 4
    assert all((axes.get_xscale(), axes.get_yscale()) == ('log', 'linear') for axes in panels)
    assert [axes.collections[0].get_clim() for axes in panels[:2]] == [(0.0, 11.0)] * 2
    assert panels[1].collections[0].get_array().ravel().tolist() == [1, 5, 9, 3, 7, 11]


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['none.yaml'], 'no file none.yaml'),
        (['my.yaml', '--threads', '0'], '--threads must be at least 1, got 0'),
        (['my.yaml', '--out', 'a.txt'], '--out must end in .parquet or .csv, got a.txt'),
        (['my.yaml', '--out', 'no/a.csv'], '--out: no folder '),
        (['my.yaml', '--plot', 'a.txt'], '--plot must end in .png, .svg or .pdf, got a.txt'),
        (
            ['my.yaml', '--plot', 'a.png'],
            '--plot draws one or two values that vary, for each of at',
        ),
    ],
)
def test_arguments_are_refused_in_one_sentence(tmp_path, monkeypatch, capsys, arguments, sentence):
    pytest.importorskip('matplotlib')
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'my.yaml').write_text(
        'scene: sidewinding\n'
        'vary: {dt: [0.1], duration: [1], method: [newton], friction.rolling: [0]}\n'
    )
    assert main(['study', *arguments]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1 and sentence in errors[0]


# ---- docs/studies.md ----------------------------------------------------------------------------


def test_the_page_has_every_metric_with_its_unit_and_every_key():
    table = dict(re.findall(r'^\| `(\w+)` \|\s*([^|]*?)\s*\|', PAGE, re.MULTILINE))
    assert {name: metric.unit for name, metric in METRICS.items()}.items() <= table.items()
    defaults = study_from({'scene': 'step', 'vary': FRICTION}).settings
    for item in fields(StudySettings):
        shown = table[item.name].strip('`')
        assert shown == str(getattr(defaults, item.name)) or item.name == 'samples', item.name
    assert set(STUDY_KEYS) <= table.keys()
    assert table['metrics'].split(', ') == list(USUAL_METRICS)


def test_programs_and_studies_of_the_page_run(tmp_path):
    for program in re.findall(r'^```python\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL):
        namespace = {'__name__': 'example'}
        exec(compile(program, 'docs/studies.md', 'exec'), namespace)
        assert set(namespace['table']['status']) == {'converged'}
    (text,) = re.findall(r'^```yaml\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL)
    (tmp_path / 'page.yaml').write_text(text)
    assert load_study(tmp_path / 'page.yaml') == load_study(EXAMPLE)
