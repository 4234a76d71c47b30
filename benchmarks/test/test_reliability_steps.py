# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Very long runs, made short: what they watch, and that they notice what is wrong."""

from itertools import chain, count, repeat

import numpy as np
from processes import python
import pytest

from snake_sim_benchmarks.comparison.csv_tables import plain, read_table, TableWriter
from snake_sim_benchmarks.reliability import longest, steps
from snake_sim_benchmarks.reliability.trials import COLUMNS, draw_trials, Trial
from snake_sim_ros import Simulation
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.scene.parameters import load_scene, with_settings

A = with_settings(load_scene('lateral_undulation'), {'level': 'spatial'})


def test_subjects_are_those_that_are_promised():
    found = steps.subjects(0)
    names = {name.partition(',')[0] for name in found}
    assert names == {
        *('lateral_undulation', 'sidewinding', 'obstacle_aided', 'thrown', 'hyper_redundant'),
        *('stairs', 'rough', 'gap', 'pole_climb', 'pipe_climb', 'pegboard'),
    }
    assert {each.scene.method for each in found.values()} == {'newton', 'bdf2'}
    assert {each.most_steps for each in found.values()} == {10**6, 25 * 10**5, 10**8}


def test_a_soak_goes_on_and_repeats_its_end():
    row = steps.soaked('A', steps.Subject(A, 1e-3, 1e-3), 0.4)
    assert row.violations == 0, row.first
    assert row.tried > 4000
    assert row.memory < 5.0
    assert row.figures.startswith('unconverged 0, ') and row.figures.endswith('rerun equal')


FREED = """
import numpy as np
from snake_sim_benchmarks.reliability.steps import memory_in_use

memory_in_use()
before = memory_in_use()
arrays = [np.ones(12000) for _ in range(500)]  # below the size that goes back at once
print(memory_in_use() - before)
arrays[:-1] = []  # the last one holds the end of the heap
print(memory_in_use() - before)
"""


def test_memory_that_was_freed_is_not_in_use(tmp_path):
    # In a process of its own: what other tests left may be given back in between.
    used, left = map(int, python('-c', FREED, folder=tmp_path).split())
    assert used > 4e7
    assert left < 5e6


def test_a_soak_begins_again_from_throws_that_differ():
    scene = with_settings(A, {'duration': 0.05})
    starts = []

    def start(number):
        simulation = steps.thrown(scene, 0, number)
        starts.append(simulation.state)
        return simulation

    row = steps.soaked('thrown', steps.Subject(scene, 1.0, 1.0, most_steps=600, start=start), 60.0)
    assert row.violations == 0, row.first
    assert row.tried == 800  # with the round of the second that is repeated
    assert len({state.u.tobytes() for state in starts}) == 4  # three rounds, and one second more
    assert starts[0].q[:, 2].min() > 0.1


def test_robots_in_worlds_start_turned_about_the_axis_of_a_pipe():
    scene = load_scene('pipe_climb')
    one, other = (steps.turned(scene, 0, number).state.q[:, :3] for number in (0, 1))
    assert np.abs(one - other).max() > 1e-3
    for q in (one, other):
        here = Simulation(scene).state.q
        assert np.hypot(*q[:, :2].T) == pytest.approx(np.hypot(*here[:, :2].T))


def test_a_soak_notices_what_is_wrong(monkeypatch):
    # Memory that grows by 10 MB with every look, another end, and bounds that nothing keeps.
    memory = (10**7 * k for k in count())
    monkeypatch.setattr(steps, 'resident_memory', lambda: next(memory))
    read = checkpoint.read

    def changed(path):
        simulation = read(path)
        simulation.push(3, (1e-9, 0.0, 0.0))
        return simulation

    monkeypatch.setattr(steps.checkpoint, 'read', changed)
    monkeypatch.setattr(steps, '_time_growth', lambda portions: 0.5)
    monkeypatch.setattr(steps, 'JUDGED_SECONDS', 0.0)
    row = steps.soaked('A', steps.Subject(A, 0.0, 0.0), 0.4)
    assert row.violations == 5
    for text in ('other bits', 'memory grew by', 'grew by 50.0 %', 'penetration', 'joint gap'):
        assert text in row.first


@pytest.mark.parametrize(('before', 'after', 'growth'), [(2.0, 2.0, 0.0), (2.0, 3.0, 0.5)])
def test_time_per_step_is_compared_with_the_same_second(before, after, growth):
    # The machine becomes twice as slow on its way, which the second shows as well.
    portions = [
        steps.Portion(k, list(repeat(value * machine, 9)), [machine], 0.0, 0.0, 0)
        for k, value, machine in ((1, before, 1.0), (2, before, 1.5), (3, after, 2.0))
    ]
    assert steps._time_growth(portions) == pytest.approx(growth)


def test_the_longest_step_is_looked_for_again(monkeypatch):
    times = iter([np.full(4000, 1e-6), np.full(4000, 3e-6), *repeat(np.full(4000, 2e-6), 5)])
    slow = np.full(4000, 1e-6)
    slow[7] = 0.02  # once, as if something else had run
    later = chain([slow], times)
    monkeypatch.setattr(longest, 'step_times', lambda *arguments: next(later))
    monkeypatch.setattr(longest, 'MOST_STEPS', 8000)
    row = longest.longest_step('A', A, 60.0)
    assert row.tried == 8000
    assert row.longest == pytest.approx(2e-6)
    assert row.figures.endswith('0 steps longer than 5 ms')


def test_tables_of_trials_are_drawn(tmp_path):
    row = Trial('steps', 'A', 'steps', 12345, 0, 1.0, memory=0.25, figures='unconverged 0')
    path = tmp_path / 'some.csv'
    TableWriter(path, 'soak', COLUMNS).append([plain(row)])
    (page,) = draw_trials(read_table(path), tmp_path)
    assert page.name == 'soak.md'
    assert page.read_text(encoding='utf-8').splitlines()[-1] == (
        '| steps | A | 12,345 steps | 0 |  | 0.2 MB | unconverged 0 |'
    )
