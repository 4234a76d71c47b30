# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a controller is: from what a robot measures, the joint reference of the next period.

The same object runs in `stepping.sampling`, which reads a simulation, and in a node, which reads
messages. It never sees the truth: angles, rates and torques are those of the joints, and what
else a robot may measure is there for controllers that ask for it.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Protocol, runtime_checkable

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene

# Angles and rates (m, n-1, 2) at m times, as of `gaits.blending.Blend.reference`.
Reference = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Measured:
    """
    What a robot of n links measures.

    Attributes
    ----------
    joint_angle, joint_velocity, joint_torque : ndarray, shape (axes,)
        In the order of `Robot.axis_names` [rad], [rad/s], [N m].
    position, orientation : ndarray, shape (n, 3) and (n, 4), or None
        Centers of the links [m, frame I] and Euler parameters of their frames B, scalar first, as
        motion capture sees them; None unless the controller asks for them.
    contact_wrench : ndarray, shape (n, 6), or None
        Force [N] of all contacts of each link, and torque about its center [N m], in the frame of
        the link as messages have it; None unless the controller asks for them.
    imu : ndarray, shape (n, 10), or None
        Readings of an inertial unit in each link, as `stepping.exact_sensors.imu_readings` returns
        them; None unless the controller asks for them.

    """

    joint_angle: Array
    joint_velocity: Array
    joint_torque: Array
    position: Array | None = None
    orientation: Array | None = None
    contact_wrench: Array | None = None
    imu: Array | None = None


@runtime_checkable
class Controller(Protocol):
    """
    A controller, with a state of its own.

    One that has `sees_contacts` or `sees_imus`, true, is given those measurements, too.

    Attributes
    ----------
    period : float
        Time from one call to the next [s].
    sees_poses : bool
        Whether it needs motion capture.

    """

    period: float
    sees_poses: bool

    def start(self, scene: Scene) -> None:
        """Begin anew at time 0 with the robot and the gait of a scene."""
        ...

    def control(self, measured: Measured, time: float) -> Reference:
        """
        Return the joint reference from now on.

        Parameters
        ----------
        measured : Measured
        time : float
            Since the start [s].

        Returns
        -------
        callable
            ``reference(times)`` returns angles and rates of shape (m, n-1, 2), (yaw, pitch) of
            every joint [rad], [rad/s], at times of shape (m,) within the period that begins now.

        """
        ...


def sees(controller: Controller, what: str) -> bool:
    """Return whether a controller asks for 'poses', 'contacts' or 'imus'."""
    return bool(getattr(controller, f'sees_{what}', False))


def going_on(begin: float, angle: Array, rate: Array) -> Reference:
    """Return the reference that goes on from angles (n-1, 2) at a time with their rates."""

    def reference(times: Array) -> tuple[Array, Array]:
        rates = np.empty((len(times), *rate.shape))
        rates[...] = rate
        return angle + (times - begin)[:, None, None] * rate, rates

    return reference


def check_values(values: dict[str, float], allowed: Callable[[float], bool], what: str) -> None:
    """Refuse numbers that are not finite or not allowed; `what` says which numbers are."""
    for name, value in values.items():
        if not (math.isfinite(value) and allowed(value)):
            raise ParameterError(f'{name} must be {what} and finite, got {value}')
