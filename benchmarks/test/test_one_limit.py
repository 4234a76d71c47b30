# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Methods and settings have one limit in random scenes, and what is judged of it has its name."""

from dataclasses import replace
import math

import numpy as np
import pytest

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.comparison import limits
from snake_sim_benchmarks.comparison.csv_tables import read_table, records_of
from snake_sim_ros import Simulation
from snake_sim_ros.scene.parameters import with_settings

# Scenes of `./run limits` whose limit is known: flat with and without pitch, pegs, folds.
KNOWN = (0, 5, 15, 32)


@pytest.mark.parametrize('seed', KNOWN)
def test_methods_and_settings_have_one_limit(seed):
    paths = limits.Paths(limits.limit_scene(seed))
    found = paths.distance(paths.of('newton', 64_000), paths.of('bdf2', 8_000))
    # Both are off by the share of their step; `newton`, of first order, by its distance from half.
    assert found < limits.LIMIT
    for setting in ({'solver.activation_tolerance': 1e-5}, {'solver.normal_compliance': 1e-3}):
        settings = {'method': 'bdf2', 'dt': 1 / 8_000, **setting}
        assert paths.distance(paths.run(settings)[0], paths.of('bdf2', 8_000)) < limits.LIMIT
    for accuracy in (1e-2, 1e-3):
        assert paths.distance(paths.run({}, accuracy)[0], paths.of('bdf2', 8_000)) < accuracy


def test_a_seed_is_a_scene_and_kinds_take_turns():
    scenes = [limits.limit_scene(seed) for seed in range(8)]
    assert scenes == [limits.limit_scene(seed) for seed in range(8)]
    assert len({scene.gait for scene in scenes}) == 8
    for kind, *pair in zip(limits.KINDS, scenes[:4], scenes[4:], strict=True):
        for scene in pair:
            assert bool(scene.pegs.x) == (kind == 'pegs')
            assert bool(scene.ground.heights) == (kind == 'cells')
            assert scene.self_contact == (kind == 'folds')
            assert 2 <= scene.robot.link_count <= 15


def row(**values):
    """Return the row of a scene with one limit, with some other values."""
    numbers = dict.fromkeys(limits.COLUMNS[5:-1], 1e-6) | {'jump': math.nan, 'refined': math.nan}
    return limits.Row(**({'seed': 0, 'kind': 'flat', 'links': 3, 'path': 0.1, 'unconverged': 0}
                         | numbers | values))  # fmt: skip


def test_verdicts():
    assert limits.verdict(row()) == 'one limit'
    assert limits.verdict(row(settings=1e-3, small_push=1e-4, jump=0.0)) == 'sensitive'
    assert limits.verdict(row(apart_128=1e-3, jump=2e-3)) == 'jumps'
    # A jump explains what is left only if it is about as large.
    assert limits.verdict(row(apart_128=1e-1, jump=2e-3)) == 'open'
    assert limits.verdict(row(bdf2_8=1e-3, jump=0.0)) == 'open'
    assert limits.verdict(row(apart_128=1e-3, settings=1e-3, refined=5e-5)) == 'one limit'
    assert limits.verdict(row(message='diverged')) == 'not run'


def test_steps_are_halved_until_there_is_one_limit(monkeypatch):
    # Paths are off by 1.5e-4 at 1/256000 s (`newton`) and 1/32000 s (`bdf2`), and by half of it
    # with half the step.
    class OffByTheStep(limits.Paths):
        def run(self, settings, accuracy=0.0):
            error = settings['dt'] * {'newton': 256_000, 'bdf2': 32_000}[settings['method']]
            path = np.zeros((3, 3))
            path[1, 0] = error * 1.5e-4 * self.scene.robot.per_link('link_length').mean()
            return path, 0

    paths = OffByTheStep(limits.limit_scene(0))
    assert 0.0 < limits.refined(paths) < limits.LIMIT
    assert max(rate for _, rate in paths._known) == 512_000
    monkeypatch.setattr(limits, 'LIMIT', 0.0)
    limits.refined(paths)
    assert max(rate for _, rate in paths._known) == limits.FINEST


def test_accuracies_are_judged_where_the_limit_is_known():
    rows = [row(accuracy_3=2e-3), row(accuracy_3=5e-4), row(accuracy_3=1.0, bdf2_8=1e-3)]
    np.testing.assert_allclose(limits.accuracy_errors(rows, 1e-3), [2.0, 0.5])


def test_the_command_continues_its_file(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(limits, 'measured', lambda seed: replace(row(), seed=seed))
    path = tmp_path / 'limits.csv'
    for count in (2, 3):
        assert main(['limits', '--scenes', str(count), '--out', str(path)]) == 0
    found = records_of(read_table(path), 'limits', limits.Row)
    assert [each.seed for each in found] == [0, 1, 2]
    assert main(['chart', str(path), '--out', str(tmp_path)]) == 0
    text = (tmp_path / 'limits.md').read_text()
    assert '| one limit | 3 | 0 | 0 | 0 | 3 |' in text and text in capsys.readouterr().out
    assert main(['limits', '--scenes', '0', '--out', str(path)]) == 2


def test_a_link_that_lands_while_links_touch_is_solved_for():
    # A contact with the floor joins the solution after a contact of two links. `bdf2` once took
    # that contact for one with the floor, and the robot was thrown apart at 0.52 s.
    scene = with_settings(
        limits.limit_scene(63),
        {**limits.EXACT, 'method': 'bdf2', 'dt': 1 / 16_000, 'duration': 0.54},
    )
    simulation = Simulation(scene)
    report = simulation.advance(*simulation.gait_reference(round(0.54 * 16_000)))
    assert not report.failure
    assert report.penetration_max < 1e-6
