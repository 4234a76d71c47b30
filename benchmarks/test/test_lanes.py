# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What robots in the lanes of a register would gain."""

import numpy as np
import pytest

from snake_sim_benchmarks import lanes


def test_sweeps_of_several_robots_have_the_bits_of_one(monkeypatch):
    monkeypatch.setattr(lanes, 'TURNS', 1)
    monkeypatch.setattr(lanes, 'REPEATED', 1)
    assert min(lanes.gains()) > 0.0  # it compares results itself


def test_robots_wait_for_the_slowest_of_their_group():
    counts = np.array([[1, 2], [3, 2], [5, 4], [1, 4]])
    # Groups of two take 3 and 2, and 5 and 4 in place of 2 and 2, and 3 and 4 in the mean.
    assert lanes.kept_share(counts, 2) == pytest.approx((2 + 2 + 3 + 4) / (3 + 2 + 5 + 4))


def test_robots_alike_gain_all_of_both_parts():
    # Half of a step gains 2, the rest 4. Robots with 3, 1, 1 and 1 iterations take 3, not 1.5.
    alike, unlike = np.ones((2, 4, 3)), np.ones((2, 4, 3))
    unlike[0, 0] = 3.0
    gain = lanes.gain_at_most(alike, of_sweeps=2.0, of_rest=4.0)
    assert gain == pytest.approx(1 / (0.5 / 2 + 0.5 / 4))
    less = lanes.gain_at_most(unlike, of_sweeps=2.0, of_rest=4.0)
    assert less == pytest.approx(1 / (0.5 / (2 * 0.5) + 0.5 / 4))
