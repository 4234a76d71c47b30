# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs: what is kept of them, in which files, and what is said of files of others."""

import csv
from dataclasses import fields, replace
from io import BytesIO
from zipfile import ZipFile

import numpy as np
import pytest

from snake_sim_ros import ParameterError
from snake_sim_ros.recording.recorded_runs import ARRAYS, read_npz, write_csv, write_npz
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.stepping.simulation import simulate


@pytest.fixture(scope='module')
def trajectory():
    return simulate(replace(load_scene('lateral_undulation'), duration=0.1))


@pytest.fixture(scope='module')
def saved(trajectory, tmp_path_factory):
    path = tmp_path_factory.mktemp('runs') / 'run.npz'
    write_npz(trajectory, path)
    return path


def test_contacts_carry_the_weight_and_rub_within_the_cone(trajectory):
    scene, m = trajectory.scene, len(trajectory.time)
    weight = 9.81 * scene.robot.per_link('link_mass').sum()
    assert not len(trajectory.contacts(0)[0])  # no step has been
    for k in range(1, m):
        point, force = trajectory.contacts(k)
        # Flat and without vertical motion: the loads of 22 spheres at z = 0, equal to the weight
        # to the tolerance of the equilibrium.
        assert len(point) == 22
        assert np.abs(point[:, 2]).max() < 1e-6
        assert force[:, 2].sum() == pytest.approx(weight, rel=1e-6)
        slip = np.hypot(force[:, 0], force[:, 1]) / force[:, 2]
        assert slip.max() <= scene.friction.transversal * (1 + 1e-9)
    assert (trajectory.contact_number.reshape(m - 1, 22) == np.arange(22)).all()


def test_what_is_loaded_is_what_was_saved(trajectory, saved):
    loaded = read_npz(saved)
    for name in ARRAYS:
        assert np.array_equal(getattr(loaded, name), getattr(trajectory, name)), name
    for item in fields(trajectory.report):
        ours, theirs = (getattr(each.report, item.name) for each in (trajectory, loaded))
        assert np.array_equal(ours, theirs), item.name
    assert (loaded.scene, loaded.seconds, loaded.interrupted) == (
        trajectory.scene,
        trajectory.seconds,
        trajectory.interrupted,
    )


def write(saved, path, **changes):
    with np.load(saved) as file:
        data = {**{name: file[name] for name in file.files}, **changes}
    np.savez(path, **{name: value for name, value in data.items() if value is not None})


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'format': 3}, r'is a run in format 3, of another version .*; this one reads format 2'),
        ({'format': None}, r'is a run in format 1, of another version'),
        ({'position': None}, 'is not a recorded run: it has no scene or no position'),
        ({'time': None}, "is not a whole run: 'time'"),
        ({'report': '{"stepz": 1, "joint_torque": []}'}, 'is not a whole run: .*stepz'),
        ({'scene': 'frictoin: {}'}, "is not a whole run: scene: unknown key 'frictoin'"),
    ],
)
def test_files_of_others(saved, tmp_path, changes, sentence):
    path = tmp_path / 'other.npz'
    write(saved, path, **changes)
    with pytest.raises(ParameterError, match=sentence) as error:
        read_npz(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize(
    ('name', 'change', 'sentence'),
    [
        ('time', lambda a: a[1:], r'position must have shape \(10, 11, 3\) of floats'),
        ('time', lambda a: a[::-1], 'time must be finite and never go back'),
        ('time', lambda a: a * np.nan, 'time must be finite and never go back'),
        ('time', lambda a: a[:, None], r'time must have shape \(11,\) of floats, got \(11, 1\)'),
        ('position', lambda a: a[:, :-1], r'position must have shape \(11, 11, 3\) of floats'),
        ('position', lambda a: a.astype(int), 'position must have .* of floats, got .* of int64'),
        ('orientation', lambda a: a[..., :3], r'orientation must have shape \(11, 11, 4\)'),
        ('joint_angle', lambda a: a[0], r'joint_angle must have .* got \(20,\) of float64'),
        ('joint_velocity', lambda a: a.astype(str), 'joint_velocity must have .* of floats'),
        ('joint_torque', lambda a: a[:, ::2], 'joint_torque must have shape'),
        ('contact_sample', lambda a: a + 1, 'contact_sample must be 0 to 10, got 2 to 11'),
        ('contact_sample', lambda a: a[::-1], 'contact_sample must be in the order of the sam'),
        ('contact_sample', lambda a: a[1:], r'contact_number must have shape \(219,\) of integ'),
        ('contact_number', lambda a: a + 1, 'contact_number must be -1 to 21, got 1 to 22'),
        ('contact_number', lambda a: a - 2, 'contact_number must be -1 to 21, got -2 to 19'),
        ('contact_number', lambda a: 1.0 * a, 'contact_number must have .* of integers'),
        ('contact_force', lambda a: a[1:], r'contact_force must have shape \(220, 3\) of floats'),
        ('contact_point', lambda a: a[:, :2], 'contact_point must have shape'),
        ('level', lambda a: a[1:], r'level must have shape \(11,\) of text'),
        ('level', lambda a: np.char.add(a, '\n'), 'level must be printable text'),
        ('format', lambda a: np.array([2, 2]), 'is a run in format 0, of another version'),
    ],
)
def test_arrays_that_are_not_of_one_run(saved, trajectory, tmp_path, name, change, sentence):
    path = tmp_path / 'odd.npz'
    write(saved, path, **{name: change(np.asarray(getattr(trajectory, name, 2)))})
    with pytest.raises(ParameterError, match=sentence) as error:
        read_npz(path)
    assert str(error.value).startswith(f'{path} is ')
    assert '\n' not in str(error.value)


def test_a_run_without_samples(saved, trajectory, tmp_path):
    path = tmp_path / 'none.npz'
    write(saved, path, **{name: getattr(trajectory, name)[:0] for name in ARRAYS})
    with pytest.raises(ParameterError, match='time must have a sample, got none'):
        read_npz(path)


@pytest.mark.parametrize(
    ('report', 'sentence'),
    [
        ('[]', 'is not a whole run: '),
        ('[' * 100000, 'is not a whole run: '),
        ('{"steps": "many", "joint_torque": []}', "steps of the report must be int, got 'many'"),
        ('{"joint_torque": [[1], [1, 2]]}', 'is not a whole run: '),
    ],
)
def test_reports_that_are_none(saved, tmp_path, report, sentence):
    path = tmp_path / 'odd.npz'
    write(saved, path, report=report)
    with pytest.raises(ParameterError, match=sentence) as error:
        read_npz(path)
    assert str(error.value).startswith(str(path))


def load(path, content):
    """Return whether a file of this content is a run; if not, one sentence says so."""
    path.write_bytes(content)
    try:
        trajectory = read_npz(path)
    except ParameterError as error:
        assert str(error).startswith(f'{path} is ')
        assert '\n' not in str(error)
        return False
    trajectory.check()
    return True


@pytest.mark.filterwarnings('ignore')  # of NumPy, on headers that it can read nevertheless
def test_damaged_files_are_refused_with_a_sentence(saved, trajectory, tmp_path):
    # Some bytes of a file, then some bytes of the arrays in a file that is whole: their headers,
    # names of types and texts. What is left is a run, of other numbers.
    rng, path, content = np.random.default_rng(3), tmp_path / 'odd.npz', saved.read_bytes()
    for _ in range(100):
        damaged = bytearray(content)
        for place in rng.integers(len(content), size=rng.choice([1, 2, 20])):
            damaged[place] = rng.integers(256)
        load(path, bytes(damaged))
    with ZipFile(saved) as file:
        members = {name: file.read(name) for name in file.namelist()}
    refused = 0
    for _ in range(200):
        damaged = {name: bytearray(member) for name, member in members.items()}
        member = damaged[rng.choice(list(damaged))]
        for place in rng.integers(min(len(member), rng.choice([80, 200])), size=2):
            member[place] = rng.integers(256)
        buffer = BytesIO()
        with ZipFile(buffer, 'w') as file:
            for name, member in damaged.items():
                file.writestr(name, bytes(member))
        refused += not load(path, buffer.getvalue())
    assert refused > 100
    assert load(path, content)


def test_a_folder_is_no_run(tmp_path):
    with pytest.raises(ParameterError, match='cannot be read: Is a directory'):
        read_npz(tmp_path)


@pytest.mark.parametrize('keep', [0, 7, 1000, -30])
def test_files_that_are_not_whole(saved, tmp_path, keep):
    path = tmp_path / 'half.npz'
    path.write_bytes(saved.read_bytes()[:keep])
    with pytest.raises(ParameterError, match='is not a whole npz file'):
        read_npz(path)
    path.write_text('no run')
    with pytest.raises(ParameterError, match='is not a whole npz file'):
        read_npz(path)


def test_no_file(tmp_path):
    with pytest.raises(ParameterError, match=r'no file .*none\.npz'):
        read_npz(tmp_path / 'none.npz')


def test_csv_has_a_row_for_each_sample(trajectory, tmp_path):
    path = tmp_path / 'run.csv'
    write_csv(trajectory, path)
    with path.open(encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(trajectory.time) == 11
    # time, 7 numbers a link, 3 a joint axis, 3 of the force, level
    assert len(rows[0]) == 1 + 7 * 11 + 3 * 20 + 3 + 1
    last = rows[-1]
    assert float(last['time [s]']) == trajectory.time[-1]
    assert float(last['link_6 x [m]']) == trajectory.position[-1, 5, 0]
    assert float(last['link_11 e3']) == trajectory.orientation[-1, 10, 3]
    assert float(last['joint_10_pitch angle [rad]']) == trajectory.joint_angle[-1, 19]
    assert float(last['joint_1_yaw torque [N m]']) == trajectory.joint_torque[-1, 0]
    assert float(last['contact force z [N]']) == pytest.approx(73.575, rel=1e-6)
    assert last['level'] == 'planar'
