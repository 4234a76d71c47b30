# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The attacks on nodes, `snake-sim fuzz --parts messages states`, for a second."""

import math
import sys

from graph import next_domain
import pytest

from snake_sim_ros.nodes.tools.attacked_node import on_own_domain
from snake_sim_ros.reliability.messages import _growth
from snake_sim_ros.reliability.messages import flooded
from snake_sim_ros.reliability.messages import STARTED
from snake_sim_ros.reliability.messages import started
from snake_sim_ros.reliability.messages import SUBJECTS
from snake_sim_ros.reliability.states import sequences


@pytest.fixture
def attacked(request):
    """A subject of the attack, and its process."""
    (subject,) = (each for each in SUBJECTS if each.words == request.param)
    with on_own_domain(next_domain()):
        process = started(subject)
        try:
            assert process.wait_until_said(STARTED[subject.node], 60.0), list(process.lines)
            yield subject, process
        finally:
            assert process.end() == 0


@pytest.mark.parametrize('attacked', ['gait on /clock'], indirect=True)
def test_gait_stands_a_hostile_clock(attacked):
    subject, process = attacked
    assert '/clock' in [topic.name for topic in subject.topics]
    row = flooded(subject, process, '', 1, 1.0, 0)
    assert row.tried > 1000 and not row.violations, row
    assert 'time goes back and forth' in '\n'.join(process.lines)


@pytest.mark.parametrize('attacked', ['sim'], indirect=True)
def test_sim_stands_floods_and_sequences(attacked, monkeypatch):
    subject, process = attacked
    row = flooded(subject, process, '', 1, 1.0, 0)
    assert row.tried > 1000 and not row.violations, row
    assert 'commands obeyed within' in row.figures and 'under a flood within' in row.figures
    row = sequences(process, 0.0, 1)
    assert row.tried > 10 and not row.violations, row
    # Without hypothesis, one sentence says so.
    monkeypatch.setitem(sys.modules, 'hypothesis', None)
    row = sequences(process, 0.0, 1)
    assert row.tried == 0 and 'hypothesis is not installed' in row.figures


def test_memory_of_halves_is_compared():
    assert _growth([9.0, 5.0, 8.0, 7.0, 9.0, 6.0]) == 1.0
    assert math.isnan(_growth([1.0]))
