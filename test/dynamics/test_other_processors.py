# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What only x86_64 processors have is not used on others, and is said to be missing there."""

import math
import platform

import numba
import pytest

from snake_sim_ros.comparison import timing
from snake_sim_ros.dynamics import compilation


@pytest.fixture
def elsewhere(monkeypatch):
    monkeypatch.setattr(compilation, 'COUNTS_CYCLES', False)
    monkeypatch.setattr(timing, 'COUNTS_CYCLES', False)
    monkeypatch.setattr(platform, 'machine', lambda: 'aarch64')


def counter():
    return compilation._time_stamp()


@pytest.mark.skipif(not compilation.COMPILES, reason='nothing is compiled')
def test_cycles_are_not_counted_on_other_processors(elsewhere):
    assert numba.njit(counter)() == 0


@pytest.mark.skipif(not compilation.COUNTS_CYCLES, reason='not an x86_64 processor')
def test_cycles_are_counted_here():
    count = numba.njit(counter)
    assert 0 < count() < count()


def test_times_of_steps_are_left_out_with_a_sentence(elsewhere):
    assert math.isnan(timing.tick_length(1.0, 0))
    assert timing.note_on_step_times().endswith('this is aarch64')


def test_times_of_steps_need_no_sentence_here():
    assert bool(timing.note_on_step_times()) != compilation.COUNTS_CYCLES
    assert timing.tick_length(1e-6, 1000) == 1e-3
