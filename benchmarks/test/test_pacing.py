# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The measurement of pacing, as a user starts it: what it prints, and bounds that always hold."""

import json
import sys

from graph import next_domain, Process
import pytest

from snake_sim_benchmarks import __main__ as cli
from snake_sim_ros import Scene, Simulation


def test_measurement():
    Simulation(Scene()).compile()  # into the cache on disk, so that no node has to
    command = [sys.executable, '-m', 'snake_sim_benchmarks', 'pacing', '--duration', '0.3']
    process = Process([*command, '--rates', '200'], next_domain())
    assert process.wait(60) == 0, process.output
    result = json.loads(process.lines[-1])
    assert [(load['real_time_factor'], load['listeners']) for load in result['loads']] == [
        (1.0, 'nobody'),
        (1.0, 'all default topics'),
        (1.0, 'markers as well'),
        (0.0, 'nobody'),
        (0.0, 'all default topics'),
    ]
    for load in result['loads']:
        assert load['publish_rate'] == 200.0
        assert load['processor'] * 1e6 == pytest.approx(
            load['us_per_period'] * 200.0 * load['reached']
        )
    *paced, _, _ = result['loads']
    assert all(0.5 < load['reached'] < 1.5 for load in paced)  # however busy the machine is
    assert all(load['reached'] > 1.0 for load in result['loads'][3:])
    for spread in (*result['jitter_ms'].values(), *result['effect'].values()):
        assert 0.0 <= spread['p50'] <= spread['p99'] <= spread['max']
    assert result['effect']['periods']['p50'] < 2.5
    assert sum('us a period' in line for line in process.lines) == 5


def test_unusable_arguments(capsys):
    for arguments, sentence in (
        (('--duration', '0'), '--duration must be above 0 s, got 0 s'),
        (('--rates', '300'), 'dt must divide the publish period'),
    ):
        assert cli.main(['pacing', *arguments]) == 2
        printed = capsys.readouterr()
        assert printed.err.count('\n') == 1 and not printed.out
        assert printed.err.startswith(f'run: {sentence}')
