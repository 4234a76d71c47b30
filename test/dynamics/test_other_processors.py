# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What only x86_64 processors have is not used on others, and is said to be missing there."""

import platform

import pytest

from snake_sim_ros.dynamics import code_cache, compilation
from snake_sim_ros.dynamics.compilation import compiled


@pytest.fixture
def elsewhere(monkeypatch):
    monkeypatch.setattr(code_cache, 'FOLDER', None)  # for code that is wrong here
    monkeypatch.setattr(compilation, 'COUNTS_CYCLES', False)
    monkeypatch.setattr(platform, 'machine', lambda: 'aarch64')


def counter():
    return compilation._time_stamp()


@pytest.mark.skipif(not compilation.COMPILES, reason='nothing is compiled')
def test_cycles_are_not_counted_on_other_processors(elsewhere):
    assert compiled(counter)() == 0


@pytest.mark.skipif(not compilation.COUNTS_CYCLES, reason='not an x86_64 processor')
def test_cycles_are_counted_here():
    count = compiled(counter)
    assert 0 < count() < count()
