# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The attack on nodes, `snake-sim fuzz --parts messages`, for a second."""

from graph import next_domain
import pytest

from snake_sim_ros.nodes.tools.attacked_node import node
from snake_sim_ros.nodes.tools.attacked_node import on_own_domain
from snake_sim_ros.reliability.messages import flooded
from snake_sim_ros.reliability.messages import STARTED
from snake_sim_ros.reliability.messages import SUBJECTS


@pytest.fixture
def attacked(request):
    """A subject of the attack, and its process."""
    (subject,) = (each for each in SUBJECTS if each.words == request.param)
    with on_own_domain(next_domain()):
        process = node(subject.node, *subject.parameters)
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
