# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How far joints may be from a trajectory, as a goal of follow_joint_trajectory demands."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.scene.checked_records import quoted
from snake_sim_ros.scene.parameters import Array


class Tracked(NamedTuple):
    """Where the joints of a trajectory are told to be and where they are, all of shape (k,)."""

    told_angle: Array  # [rad]
    told_rate: Array  # [rad/s]
    angle: Array  # [rad]
    rate: Array  # [rad/s]


@dataclass(frozen=True)
class Tolerance:
    """
    Largest distances of some joints from what they are told.

    Attributes
    ----------
    names : sequence of str
        Of the joints.
    angle, rate : ndarray, shape (k,)
        [rad], [rad/s]; infinite where there is none.

    """

    names: Sequence[str]
    angle: Array
    rate: Array

    def violation(self, tracked: Tracked) -> str:
        """Return a sentence on the first joint that is too far off, empty if none is."""
        for what, unit, most, off in (
            ('angle', 'rad', self.angle, tracked.angle - tracked.told_angle),
            ('rate', 'rad/s', self.rate, tracked.rate - tracked.told_rate),
        ):
            (beyond,) = np.nonzero(~(np.abs(off) <= most))
            if len(beyond):
                k = beyond[0]
                return (
                    f'the {what} of {self.names[k]} is off by {off[k]:.3g} {unit}, '
                    f'more than {most[k]:g} {unit}'
                )
        return ''


def tolerance_from(field: str, told: Sequence[Any], names: Sequence[str]) -> Tolerance:
    """
    Return the tolerances of a goal.

    Parameters
    ----------
    field : str
        Name of the field of the goal, for messages.
    told : sequence of control_msgs/JointTolerance
        Values that are 0 or negative demand nothing. Accelerations are not measured.
    names : sequence of str
        Joints of the trajectory.

    Raises
    ------
    RejectedCommand
        If a joint is not one of the trajectory, or a value is not finite.

    """
    found = Tolerance(names, *np.full((2, len(names)), math.inf))
    for item in told:
        if item.name not in names:
            raise RejectedCommand(
                'tolerance',
                f'{field} names joint {quoted(item.name)}, which is not one of the trajectory',
            )
        for what, value, most in (
            ('position', item.position, found.angle),
            ('velocity', item.velocity, found.rate),
        ):
            if not math.isfinite(value):
                raise RejectedCommand(
                    'tolerance', f'{field}: {what} of {item.name} must be finite, got {value}'
                )
            if value > 0.0:
                most[names.index(item.name)] = value
    return found
