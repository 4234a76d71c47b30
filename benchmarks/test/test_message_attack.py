# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The attacks on nodes, `./run fuzz --parts messages states`, for a second."""

import math
import sys
import time
from types import SimpleNamespace

from graph import next_domain
import pytest
from sensor_msgs.msg import JointState

from snake_sim_benchmarks.reliability.attack_checks import SimCheck
from snake_sim_benchmarks.reliability.attacked_node import on_own_domain
from snake_sim_benchmarks.reliability.hostile_messages import NAMES
from snake_sim_benchmarks.reliability.messages import _growth, flooded, STARTED, started, SUBJECTS
from snake_sim_benchmarks.reliability.states import sequences
from snake_sim_ros.nodes.messages import stamp_from


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
            assert process.end() == 0, list(process.lines)[-20:]


@pytest.mark.parametrize('attacked', ['gait on /clock'], indirect=True)
def test_gait_stands_a_hostile_clock(attacked):
    subject, process = attacked
    assert '/clock' in [topic.name for topic in subject.topics]
    for seed in range(5):  # on a busy machine the node may see few of the times
        row = flooded(subject, process, '', 1, 1.0, seed)
        assert row.tried > 1000 and not row.violations, row
        if process.wait_until_said('time goes back and forth', 1.0):
            return
    pytest.fail('\n'.join(process.lines))


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


@pytest.fixture
def check():
    """Return a check of `sim` without a node."""
    publisher = SimpleNamespace(publish=lambda message: None)
    node = SimpleNamespace(
        create_subscription=lambda *args: None, create_publisher=lambda *args: publisher
    )
    return SimCheck(SimpleNamespace(node=node, until=lambda condition, seconds: True))


def states(check, stamp, published, angle=0.0, torque=0.0):
    """Have a check receive the joint states of a time, all joints alike."""
    position, velocity, effort = ([value] * len(NAMES) for value in (angle, 0.0, torque))
    message = JointState(name=NAMES, position=position, velocity=velocity, effort=effort)
    message.header.stamp = stamp_from(round(1e9 * stamp))
    check._on_states(message, {'source_timestamp': round(1e9 * published)})


def test_a_joint_under_load_obeys_when_it_is_led_elsewhere(check):
    # The robot presses on a joint that was led to 0.2 rad, by 14.4 N m.
    states(check, 1.0, 0.0, angle=0.56, torque=-14.4)
    command, obeys = check._turn()
    assert command.position[8] == pytest.approx(0.2 - 0.3)
    # Less load: another angle and torque, but nothing obeyed.
    states(check, 1.005, 0.0, angle=0.35, torque=-6.0)
    assert not obeys()
    states(check, 1.010, 0.0, angle=0.56, torque=-20.0)
    assert obeys()


def test_states_published_before_a_command_do_not_count_when_they_are_read_after_it(check):
    states(check, 1.0, 0.0)
    before = time.time()
    check._send(JointState())
    states(check, 1.2, before)
    states(check, 1.205, time.time() + 1.0)
    assert check._begin == pytest.approx(1.2)


def test_memory_of_halves_is_compared():
    assert _growth([9.0, 5.0, 8.0, 7.0, 9.0, 6.0]) == 1.0
    assert math.isnan(_growth([1.0]))
