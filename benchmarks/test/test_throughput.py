# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The part `throughput` of the bench: many robots on some threads."""

from dataclasses import replace

import numpy as np
import pytest

from snake_sim_benchmarks.comparison import throughput as part
from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_benchmarks.comparison.bench_tables import throughput_table
from snake_sim_benchmarks.comparison.ensembles import family
from snake_sim_benchmarks.comparison.mujoco_model import MujocoSettings
from snake_sim_benchmarks.comparison.mujoco_runs import Rollouts
from snake_sim_benchmarks.comparison.paths import ConvergedPaths
from snake_sim_ros.scene.parameters import load_scene

CASE = 'lateral_undulation'
SCENE = replace(load_scene(CASE), duration=0.5)


@pytest.mark.parametrize('method', ['bdf2', 'mujoco'])
def test_a_setting_has_a_row_for_each_number_of_threads(method):
    if method == 'mujoco':
        pytest.importorskip('mujoco')
    entries = part.throughput({CASE: SCENE}, ConvergedPaths((1 / 1000, 1 / 2000)), quick=True)
    entry = next(entry for entry in entries if entry.keys[0].method == method)
    rows = entry.run()
    assert [row.setting.rpartition(', ')[2] for row in rows] == ['1 thread', '2 threads']
    assert {row.trials for row in rows} == {part.QUICK_ROBOTS}
    assert {row.status for row in rows} == {'converged'}
    for row in rows:
        assert row.seconds_per_second == row.seconds / (row.trials * SCENE.duration)
        assert 0.0 < row.error_path < 1.0


def test_robots_of_mujoco_are_the_same_on_any_number_of_threads():
    pytest.importorskip('mujoco')
    settings = MujocoSettings(contact='A 3 %')
    scenes = [replace(scene, dt=1 / 20) for scene in family(SCENE, 5)]
    ends = []
    for threads in (1, 2):
        robots = Rollouts(scenes, settings, threads)
        robots()
        robots.close()
        ends.append(robots.states.copy())
    assert np.array_equal(*ends)
    assert len(np.unique(ends[0][:, -1, 1])) == len(scenes)  # each is another one


def test_the_table_has_the_fastest_robots_up_to_an_error():
    def row(method, dt, cost, error):
        rows = [
            Row(part='throughput', case=CASE, method=method, setting=f'x, {threads}', dt=dt,
                error_path=error, seconds_per_second=cost / factor, trials=7)
            for threads, factor in (('1 thread', 1), ('2 threads', 1.5))
        ]  # fmt: skip
        return rows

    rows = [*row('bdf2', 0.05, 1e-4, 0.02), *row('newton', 1e-3, 1e-2, 0.0004),
            *row('mujoco', 0.05, 2e-4, 0.03)]  # fmt: skip
    lines = throughput_table(rows).splitlines()[2:]
    assert lines[0].endswith(
        '| 5 % | `bdf2`, x, 1/20 s | 10000 | 15000 | 2 % | 7 '
        '| `mujoco`, x, 1/20 s | 5000 | 7500 | 3 % | 7 |'
    )
    assert lines[1].endswith(
        '| 1 % | `newton`, x, 1/1000 s | 100 | 150 | 0.04 % | 7 | none |  |  |  |  |'
    )
    assert len(lines) == 3
