# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a gait takes from joint_states: angles that are usable, and robots that were put back."""

from dataclasses import replace
import math

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from snake_sim_ros import Robot
from snake_sim_ros.nodes.gait_inputs import measured, put_back, SAME
from snake_sim_ros.nodes.messages import stamp_from

NAMES = list(Robot().axis_names)
ANGLES = np.linspace(-0.7, 0.7, 20)
RATE_LIMIT = 10.0  # rad/s
PERIOD = 5_000_000  # ns


def message(names=NAMES, angles=ANGLES, rates=(), stamp=3_000_000_000):
    told = JointState(name=list(names), position=[float(angle) for angle in angles])
    told.velocity = [float(rate) for rate in rates]
    told.header.stamp = stamp_from(stamp)
    return told


def test_joints_are_taken_by_name():
    order = np.random.default_rng(0).permutation(20)
    names = ['left_wheel', *(NAMES[k] for k in order)]
    numbers = measured(message(names, [7.0, *ANGLES[order]], [1.0, *-ANGLES[order]]), NAMES)
    assert (numbers.angle == ANGLES).all()
    assert (numbers.rate == -ANGLES).all()
    assert numbers.stamp == 3_000_000_000
    assert not measured(message(), NAMES).rate.any()


def with_angle(value):
    return [*ANGLES[:4], value, *ANGLES[5:]]


@pytest.mark.parametrize(
    ('told', 'sentence'),
    [
        (message(NAMES[1:], ANGLES[1:]), 'joint_1_yaw is missing; got 19 names, joint_1_pitch to'),
        (
            message(['a', 'b'], [0.0, 0.0]),
            'must name all joints of the gait, joint_1_yaw and 19 more are missing; got 2 names, '
            'a to b',
        ),
        (message([], []), 'joint_1_yaw and 19 more are missing; got no names'),
        (message(NAMES, ANGLES[1:]), 'one position a name, got 19 positions for 20 names'),
        (
            message(NAMES, with_angle(math.nan)),
            'must have angles within +-3.1416 rad, got nan for joint_3_yaw',
        ),
        (message(NAMES, with_angle(-math.inf)), 'got -inf for joint_3_yaw'),
        (message(NAMES, with_angle(45.0)), 'got 45 for joint_3_yaw'),
    ],
)
def test_unusable_angles_are_refused_with_a_reason(told, sentence):
    with pytest.raises(ValueError) as refused:
        measured(told, NAMES)
    assert sentence in str(refused.value)


@pytest.mark.parametrize('rates', [(), np.full(20, 0.5), np.full(20, math.nan)])
def test_a_robot_that_moves_was_not_put_back(rates):
    before = measured(message(rates=rates), NAMES)
    for periods in (1, 7):
        # Every joint as fast as the limit allows.
        turned = message(
            angles=ANGLES + RATE_LIMIT * 0.005 * periods,
            rates=rates,
            stamp=3_000_000_000 + periods * PERIOD,
        )
        assert not put_back(before, measured(turned, NAMES), RATE_LIMIT)


def test_a_joint_may_be_as_fast_as_it_says():
    before = measured(message(rates=np.full(20, 24.0)), NAMES)
    after = message(angles=ANGLES + 24.0 * 0.005, stamp=3_000_000_000 + PERIOD)
    assert not put_back(before, measured(after, NAMES), RATE_LIMIT)
    slow = replace(before, rate=np.zeros(20))
    assert put_back(slow, measured(after, NAMES), RATE_LIMIT)


def test_other_angles_at_the_same_time_or_before_are_those_of_a_robot_put_back():
    before = measured(message(), NAMES)
    for stamp in (3_000_000_000, 5_000_000):
        elsewhere = measured(message(angles=with_angle(0.4), stamp=stamp), NAMES)
        assert put_back(before, elsewhere, RATE_LIMIT)
        near = measured(message(angles=ANGLES + 0.9 * SAME, stamp=stamp), NAMES)
        assert not put_back(before, near, RATE_LIMIT)
    unstamped = measured(message(angles=with_angle(0.4), stamp=0), NAMES)
    assert not put_back(before, unstamped, RATE_LIMIT)
