# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of the paper: drawn, labeled, and their numbers obey what holds for any run."""

from dataclasses import replace
from pathlib import Path
import re

from matplotlib.figure import Figure
from matplotlib.text import Text
import numpy as np
from PIL import Image
import pytest

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.energy import work_of_steps
from snake_sim_benchmarks.paper import experiments, figures, tables as paper_tables
from snake_sim_benchmarks.paper.experiments import case_scene, mean_velocity, record
from snake_sim_ros import ParameterError, Scene, Simulation
from snake_sim_ros.scene.posture import initial_coordinates

DOCS = Path(__file__).resolve().parents[2] / 'docs'
PAGE = (DOCS / 'paper.md').read_text(encoding='utf-8')
NAMES = (
    *('fig6_path', 'fig7_isotropic', 'fig8_soft_start', 'fig9_sidewinding', 'joint_torques'),
    *('tracking_error', 'contact_pattern', 'normal_forces', 'energy_balance'),
)
TABLES = ('paths', 'checks', 'choices', 'inertia', 'sign')
UNITS = r'\[(m|mm|N|N m|deg|s|J|mJ|mm/s)\]'


@pytest.fixture(scope='module')
def cases():
    return record(case_scene('A', 0.5)), record(case_scene('C', 0.5))


@pytest.fixture(scope='module')
def pictures(cases):
    undulation, sidewinding = cases
    found = figures.all_figures(undulation, experiments.isotropic_paths(0.1), sidewinding)
    assert tuple(found) == NAMES
    return found


def words(figure):
    return [text.get_text() for text in figure.findobj(Text)]


# ---- pictures -----------------------------------------------------------------------------------


@pytest.mark.parametrize('name', NAMES)
def test_figure_shows_something_and_says_what_is_assumed(pictures, name, tmp_path):
    figure = pictures[name]
    said = ' '.join(words(figure))
    assert 'assumed: ' in said and 'rolling friction 0' in said
    assert re.search(UNITS, said)
    for axes in figure.axes:
        assert axes.lines or axes.collections or axes.images
    file = tmp_path / 'figure.png'
    figures.save_small(figure, file)
    with Image.open(file) as image:
        assert image.format == 'PNG' and image.width == figures.WIDTH * figures.DPI
        assert len(image.getcolors()) > 10


def test_unknown_friction_and_waves_are_assumed(pictures):
    # model_spec 8.2: friction of B and C, gait of B and C, start of B, soft start.
    for name in NAMES[2:]:
        (said,) = [text for text in words(pictures[name]) if 'assumed: ' in text]
        assert 'isotropic friction 0.2' in said and 'soft start s = 3x²' in said
        assert 'A = 10 deg, omega = 80 deg/s, delta = -50 deg, delta_0 = 90 deg' in said
    (said,) = [text for text in words(pictures['fig7_isotropic']) if 'assumed: ' in text]
    assert 'gait, curved start and 15 s as in case A' in said


def test_paths_are_to_scale(pictures):
    above = [pictures['fig6_path'].axes[0], pictures['fig7_isotropic'].axes[0]]
    above += pictures['fig8_soft_start'].axes[:7] + pictures['fig9_sidewinding'].axes[:1]
    assert [axes.get_aspect() for axes in above] == [1.0] * 10


def test_outlines_are_as_wide_as_links():
    scene = Scene()
    q, axis = initial_coordinates(scene), np.tile([0.6, 0.8, 0.0], (11, 1))
    corners = figures.outlines(scene.robot, q[:, :3], axis)
    assert corners.mean(axis=1) == pytest.approx(q[:, :2])
    width = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    assert width == pytest.approx(np.full(11, 2 * 0.0525))


def test_a_figure_needs_some_time(tmp_path, capsys):
    assert main(['figures', '--out', str(tmp_path), '--duration', '0']) == 2
    assert 'duration must be above 0 s, got 0 s' in capsys.readouterr().err


def test_all_is_written(tmp_path, monkeypatch, capsys):
    # Pictures are tested above.
    monkeypatch.setattr(figures, 'all_figures', lambda *_: {'one': Figure(figsize=(9.0, 1.0))})
    assert main(['figures', '--out', str(tmp_path / 'new'), '--duration', '0.1']) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert [file.name for file in files] == ['one.png', *(f'{name}.md' for name in TABLES)]
    assert all(file.stat().st_size > 100 for file in files)
    with pytest.raises(ParameterError, match='duration'):
        figures.draw_figures(tmp_path, duration=0.123)


# ---- numbers ------------------------------------------------------------------------------------


def test_normal_forces_carry_the_weight(cases):
    # Their impulse is that of the weight and the upward momentum at the end, which is not more
    # than twice what it was on average over any sampling period.
    for case in cases:
        mass, span = case.scene.robot.per_link('link_mass'), case.trajectory.time[-1]
        momentum = np.diff(case.trajectory.position[..., 2], axis=0) @ mass * experiments.RATE
        total = case.normal_force.sum(axis=1).mean()
        most = 2.0 * np.abs(momentum).max() / span
        assert total == pytest.approx(73.575, abs=most + 1e-6)
        assert most < 0.02 * 73.575
    assert paper_tables.weight(cases[0].scene) == pytest.approx(73.575)


def test_work_accounts_for_the_energy(cases):
    # What a step leaves over is of the order of dt, and far below the work.
    for case in cases:
        done = np.abs(np.diff(case.joint_work)).sum()
        assert np.abs(case.left_over).max() < 1e-3 * done
        assert case.energy[0] == case.joint_work[0] == case.contact_work[0] == 0.0
        assert (np.diff(case.contact_work) < 1e-12).all()  # contacts take energy


def test_samples_are_sums_and_means_of_all_steps(cases):
    case, simulation = cases[1], Simulation(cases[1].scene)
    q, u, impulse, torque = [simulation.state.q], [simulation.state.u], [], []
    for _ in range(400):
        report = simulation.advance(*simulation.gait_reference(1))
        q.append(simulation.state.q)
        u.append(simulation.state.u)
        impulse.append(simulation.history.impulse[:, :3].copy())
        torque.append(report.joint_torque)
    q, u, impulse, torque = map(np.array, (q, u, impulse, torque))
    contacts, joints = work_of_steps(case.scene, q, u, impulse, torque)
    assert np.array_equal(case.trajectory.position[10], q[400, :, :3])
    assert case.contact_work[10] == pytest.approx(contacts.sum(), rel=1e-12)
    assert case.joint_work[10] == pytest.approx(joints.sum(), rel=1e-12)
    assert case.torque[9] == pytest.approx(torque[360:].mean(axis=0), rel=1e-12)
    force = impulse[360:, :, 0].mean(axis=0) / case.scene.dt
    assert case.normal_force[9] == pytest.approx(force, rel=1e-12)


def test_tracking_error_is_what_the_joint_law_says(cases):
    # torque = K_p error + K_d d(error)/dt; between two samples h apart the mean of the error
    # differs from that of its ends by up to h^2/12 of its second derivative, here by differences.
    for case in cases:
        kp, kd = (case.scene.robot.per_joint(name) for name in ('stiffness', 'damping'))
        error = case.tracking_error
        h = 1.0 / experiments.RATE
        expected = kp * 0.5 * (error[1:] + error[:-1]) + kd * np.diff(error, axis=0) / h
        off = np.abs(case.torque - expected).max(axis=1)[5:-5]
        bend = (kp * np.abs(np.diff(error, n=2, axis=0))).max(axis=(1, 2))
        around = np.array([bend[max(k - 2, 0) : k + 3].max() for k in range(len(case.torque))])
        assert (off <= around[5:-5].reshape(-1, 1) / 2 + 1e-3).all()


def test_spheres_are_in_order_along_the_body(cases):
    case = cases[1]
    ordered = case.force_along_body
    n = case.scene.robot.link_count
    # The front sphere of link i is the one toward link n, so next to the rear one of link i + 1.
    assert np.array_equal(ordered[:, 0::2], case.normal_force[:, n:])
    assert np.array_equal(ordered[:, 1::2], case.normal_force[:, :n])


def test_mean_velocity_of_a_steady_path_with_a_wave():
    scene = case_scene('A', 15.0)  # one period is 4.5 s
    time = np.arange(301) / 20.0
    wave = 0.05 * np.sin(2 * np.pi * time / 4.5)
    path = np.column_stack([-0.12 * time + wave, 0.01 * time + wave, 0 * time])
    path[:60] += 1.0  # the first period does not count
    # Interpolation between samples: (1/20 s)^2/8 of a second derivative of 0.1 m/s^2, over 9 s.
    assert mean_velocity(scene, path, 20.0) == pytest.approx([-0.12, 0.01], abs=1e-5)
    assert mean_velocity(scene, path[200:260], 20.0) == pytest.approx(
        (path[259] - path[200])[:2] / 2.95
    )


def test_variations_change_one_sign():
    A, C = case_scene('A', 1.0), case_scene('C', 1.0)
    for scene, other, wave, name in (
        (A, experiments.mirrored(A), 'yaw', 'amplitude'),
        (A, experiments.reversed_wave(A), 'yaw', 'phase_lag'),
        (C, experiments.other_side(C), 'pitch', 'phase'),
    ):
        value = getattr(getattr(other.gait, wave), name)
        assert value == -getattr(getattr(scene.gait, wave), name) != 0.0
        back = replace(getattr(other.gait, wave), **{name: -value})
        assert replace(other, gait=replace(other.gait, **{wave: back})) == scene


def test_printed_sign_doubles_the_rate_of_joint_gaps_in_every_step():
    # W_J^T u_E = (1 - sign) W_J^T u_A: 0 as derived, 2 W_J^T u_A as scanned, times 1 + O(dt)
    # because W_J turns with the robot, a hundredth of a radian in ten steps.
    scene = case_scene('A', 1.0)
    right = paper_tables.joint_gap_rates(scene, 1.0, 30)
    scanned = paper_tables.joint_gap_rates(scene, -1.0, 30)
    assert max(right) < 1e-15
    assert scanned[0] < 1e-15  # at rest there is nothing to double
    growth = np.divide(scanned[20:], scanned[19:-1])
    assert growth == pytest.approx(np.full(10, 2.0), rel=0.02)


# ---- the page -----------------------------------------------------------------------------------


def test_page_embeds_every_figure_and_table():
    assert sorted(re.findall(r'!\[[^\]]+\]\(paper/(\w+)\.png\)', PAGE)) == sorted(NAMES)
    files = {file.name for file in (DOCS / 'paper').iterdir()}
    assert files == {*(f'{name}.png' for name in NAMES), *(f'{name}.md' for name in TABLES)}
    for name in TABLES:
        assert (DOCS / 'paper' / f'{name}.md').read_text(encoding='utf-8') in PAGE, name
    assert all((DOCS / 'paper' / f'{name}.png').stat().st_size < 90_000 for name in NAMES)
