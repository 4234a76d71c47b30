# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Drake on the same scene: what it gets, and what it does not get; see test_drake_runs.py."""

import sys

import numpy as np
import pytest

from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_benchmarks.comparison.drake_runs import cenic_course, CenicSettings
from snake_sim_benchmarks.comparison.ensembles import spread_rows, Trial
from snake_sim_benchmarks.comparison.entrants import entrants
from snake_sim_ros import Friction, ParameterError, Pegs, Scene
from snake_sim_ros.scene.parameters import load_scene

SETTINGS = CenicSettings(1e-3)


@pytest.fixture
def absent(monkeypatch):
    monkeypatch.setitem(sys.modules, 'pydrake', None)
    monkeypatch.setitem(sys.modules, 'pydrake.all', None)


def test_without_drake_one_sentence_says_how_to_get_it(absent):
    with pytest.raises(ParameterError, match='Drake is not installed: pip install drake'):
        cenic_course(load_scene('sidewinding'), settings=SETTINGS)


@pytest.mark.parametrize(
    ('settings', 'sentence'),
    [
        ({'pegs': Pegs(x=(9.0,), y=(9.0,))}, 'flat floor'),
        ({'friction': Friction(rolling=0.1)}, 'without rolling friction'),
        ({'friction': Friction(longitudinal=0.1, transversal=0.5)}, 'must be isotropic'),
    ],
)
def test_what_drake_does_not_get_is_refused(absent, settings, sentence):
    with pytest.raises(ParameterError, match=sentence):
        cenic_course(Scene(**settings), settings=SETTINGS)


def test_rows_stay_empty_where_drake_is_absent(absent):
    scene = load_scene('sidewinding')
    found = entrants('sidewinding', ['drake'], quick=False)
    assert len({each.setting for each in found}) == len(found) == 7
    entered = [
        (each, Row(part='ensemble', case='C', method='drake', setting=each.setting, dt=0.1))
        for each in found
    ]
    for row in spread_rows(entered, [Trial(scene, lambda course: 0.0, 0.0)]):
        assert row.status == 'refused' and 'Drake is not installed' in row.message
        assert np.isnan(row.error_rms) and np.isnan(row.seconds_per_second)


def test_drake_takes_part_where_friction_is_isotropic():
    assert not entrants('lateral_undulation', ['drake'], quick=False)
    assert not entrants('sinus_lifting', ['drake'], quick=False)
    assert entrants('lateral_undulation_isotropic', ['drake'], quick=False)
