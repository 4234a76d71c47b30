# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Published results: their formulas, and how a line judges."""

from collections import Counter
import math

import numpy as np
import pytest

from snake_sim_benchmarks import large_steps, published
from snake_sim_benchmarks.published import k_delta, Line


def test_k_delta_of_three_links():
    # A D^+ = [[1, 2], [-2, -1]]/3: 4/3 sin delta.
    lags = np.linspace(0.0, math.pi, 7)
    assert k_delta(lags, 3) == pytest.approx(4 / 3 * np.sin(lags), abs=1e-14)


def test_a_line_says_what_differs():
    good, bad = Line('speed [m/s]', 2.0, 2.1, 0.1), Line('speed [m/s]', 2.0, 2.3, 0.1)
    assert good.passed and not bad.passed
    assert str(bad) == ('FAIL  speed [m/s]: published 2, measured 2.3 (+15.0 %, 10 % allowed)')


def test_distances_are_those_of_a_decay():
    x = np.linspace(0.0, -9.0, 9001)
    assert published._distance(x, 0.5 * np.exp(x)) == pytest.approx(math.log(7.0), abs=2e-3)
    # A long lookahead makes the heading follow at once: de/dx = -tan(arctan(e/Delta)).
    assert published._cascade(200.0, 1.5) == pytest.approx(1.5 * math.log(7.0), rel=0.03)


def test_published_results_are_measured(monkeypatch):
    monkeypatch.setattr(published, 'undulation', lambda: iter([Line('a', 1.0, 1.0, 0.1)]))
    monkeypatch.setattr(published, 'cones', lambda: iter(()))
    ends = iter([Counter({'traversed': 10}), Counter({'turned over': 9, 'stuck': 1})])
    monkeypatch.setattr(published, 'trials', lambda share, count: (next(ends), 0))
    found = list(published.lines())
    assert len(found) == 6
    assert all(line.passed for line in found)


def test_a_trial_ends_in_one_of_three_ways():
    # From where a robot of 1.4 m begins, 2 s do not take it to the step; at rest it stays there.
    kind, moved = large_steps.trial(0.33, 0, {'duration': 2.0, 'dt': 1 / 200})
    assert kind == 'stuck'
    assert moved.position[-1, 0, 0] < moved.position[0, 0, 0] - 0.05
    overturned = {'duration': 0.1, 'start.tilt': math.pi}
    assert large_steps.trial(0.33, 0, overturned)[0] == 'turned over'
