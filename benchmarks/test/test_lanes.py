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
