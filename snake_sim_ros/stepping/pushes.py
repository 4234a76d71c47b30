# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pushes that last: forces and torques from outside, as impulses on the whole chain of links.

An impulse changes the velocities of all links at once, so that joints stay closed; after that of
`Simulation.push` the next step closes them. Contacts answer in the next step. A force is an
impulse at the start of each period, which is of first order in the period.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from snake_sim_ros.dynamics.force_directions import joint_directions
from snake_sim_ros.dynamics.force_directions import mass_matrix
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Robot
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.state import State

NOTHING = (0.0, 0.0, 0.0)


def pushed(robot: Robot, state: State, link: int, impulse: Array, moment: Array) -> State:
    """
    Return the state after an impulse on a link, at once and without contacts.

    Parameters
    ----------
    robot : Robot
    state : State
    link : int
        Index of the link, from 0.
    impulse, moment : ndarray, shape (3,)
        At the center of the link [N s], and about it [N m s], frame I.

    """
    R = rotation_matrices(state.q[:, 3:])
    inverse_mass, P = 1.0 / np.diag(mass_matrix(robot)), np.zeros(state.u.shape)
    P[link, :3], P[link, 3:] = impulse, moment @ R[link]
    change = inverse_mass * P.ravel()
    if robot.link_count > 1:
        W_J = joint_directions(robot, R)
        delassus = W_J.T @ (inverse_mass[:, None] * W_J)
        change -= inverse_mass * (W_J @ np.linalg.solve(delassus, W_J.T @ change))
    return State(state.q, state.u + change.reshape(state.u.shape))


def _checked(name: str, unit: str, vector: Sequence[float] | Array) -> Array:
    """Return three finite numbers; raise an error if they are something else."""
    found = np.asarray(vector, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ParameterError(f'{name} must be 3 finite numbers in {unit}, got {vector}')
    return found


@dataclass
class Push:
    """
    A force [N] and a torque [N m] at the center of a link, for some time [s].

    Attributes
    ----------
    link : int
        Index of the link, from 0.
    force, torque : ndarray, shape (3,)
        In axes of I, or of frame B of the link, with which they then turn.
    left : float
        Time for which they still act [s].
    turns : bool
        Whether their axes are those of the link.

    """

    link: int
    force: Array
    torque: Array
    left: float
    turns: bool = False

    def impulses(self, q: Array, period: float) -> tuple[Array, Array]:
        """Return impulse and moment in the next period [s], in axes of I; let it pass."""
        time = min(period, self.left)
        self.left -= time
        axes = rotation_matrices(q[self.link, 3:]) if self.turns else np.eye(3)
        return time * axes @ self.force, time * axes @ self.torque


class Pushes:
    """
    The pushes on a robot that last; one on a link takes the place of that before.

    Before the steps of each period: ``simulation.state = pushes.act(simulation.state, period)``.

    Parameters
    ----------
    robot : Robot

    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._active: dict[int, Push] = {}

    def begin(
        self,
        link: int,
        force: Sequence[float] | Array,
        torque: Sequence[float] | Array = NOTHING,
        *,
        duration: float,
        turns: bool = False,
    ) -> None:
        """
        Begin to push a link with the next period.

        Parameters
        ----------
        link : int
            Index of the link, from 0.
        force, torque : sequence of float, shape (3,)
            At the center of the link [N], [N m].
        duration : float
            [s]
        turns : bool, optional
            Whether force and torque are in frame B of the link, and turn with it. Default: I.

        Raises
        ------
        ParameterError
            If there is no such link, or a number is not usable.

        """
        if not 0.0 < duration < math.inf:
            raise ParameterError(f'duration must be above 0 s and finite, got {duration:g} s')
        if not 0 <= link < self._robot.link_count:
            raise ParameterError(f'link must be 0 to {self._robot.link_count - 1}, got {link}')
        self._active[link] = Push(
            link=link,
            force=_checked('force', 'N', force),
            torque=_checked('torque', 'N m', torque),
            left=duration,
            turns=turns,
        )

    def clear(self) -> None:
        """End all pushes."""
        self._active.clear()

    def act(self, state: State, period: float) -> State:
        """Return a state with the impulses of all pushes in the period that begins with it [s]."""
        pushes = list(self._active.values())
        for push in pushes:
            impulses = push.impulses(state.q, period)
            state = pushed(self._robot, state, push.link, *impulses)
            if push.left <= 1e-9 * period:  # as rounding leaves it
                del self._active[push.link]
        return state

    def __bool__(self) -> bool:
        """Return whether something pushes."""
        return bool(self._active)
