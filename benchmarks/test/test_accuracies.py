# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The part `accuracy` of the bench: the error of runs that were asked for an accuracy."""

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.comparison import bench, cycles
from snake_sim_benchmarks.comparison.bench_rows import rows_of
from snake_sim_benchmarks.comparison.csv_tables import read_table


def test_the_bench_measures_what_was_asked_for(monkeypatch, tmp_path):
    monkeypatch.setattr(bench, 'QUICK_REFERENCE_STEPS', (1 / 1000, 1 / 2000))
    path = tmp_path / 'bench.csv'
    short = ['--set', 'gait.yaw.angular_frequency=6.0']
    options = ['--quick', '--parts', 'accuracy', '--out', str(path), *short]
    assert main(['bench', 'lateral_undulation', *options]) == 0
    rows = rows_of(read_table(path))
    assert [row.tolerance for row in rows] == list(cycles.ASKED)
    for row in rows:
        assert (row.method, row.trials, row.status) == ('bdf2', 2, 'converged')
        assert row.rms_low <= row.error_rms <= row.rms_high < row.tolerance + row.reference_error
    assert main(['chart', str(path), '--out', str(tmp_path)]) == 0
    head, _, *lines = (tmp_path / 'accuracy.md').read_text().splitlines()
    assert head.startswith('| case | accuracy | RMS error |')
    asked = [line.split(' | ')[1] for line in lines]
    assert asked == ['1e-02', '1e-03', '1e-04']
