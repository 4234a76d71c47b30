# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where the robot of the node `sim` is put, and how it moves there as a whole.

Pose and twist are those of ``base_link``, as ``odom`` has its pose, in the world. A twist is given
to all links as to a rigid body, on top of what their joints add.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from snake_sim_ros.nodes.messages import ODOM, WORLD
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.scene.posture import own_poses, pose_of_middle
from snake_sim_ros.scene.rotations import CONJUGATE, FLAT, product, rotation_matrices
from snake_sim_ros.stepping.controlled import place
from snake_sim_ros.stepping.levels import what_does_not_lie
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import State

TURN = np.array([0.0, 0.0, 0.0, 1.0])  # half a turn about z, from the middle link to the base
FASTEST, FASTEST_TURN = 100.0, 50.0  # m/s, rad/s of a link beyond which nothing moves it
FARTHEST = 1e4  # m from the origin where a robot may be put
UNIT_ERROR = 1e-3  # by which the norm of a quaternion may be off 1


class UnusablePose(ParameterError):
    """A pose is none, or too far away."""


class Placing:
    """
    Puts a robot elsewhere, and gives it a twist.

    Parameters
    ----------
    simulation : Simulation
    moved : callable
        Called when the state has changed.

    """

    def __init__(self, simulation: Simulation, moved: Callable[[], Any]) -> None:
        self._simulation, self._moved = simulation, moved

    def put(self, frame: str, *, pose: Any = None, twist: Any = None) -> None:
        """
        Set the pose of ``base_link``, its twist, or both; what is not given stays as it is.

        Parameters
        ----------
        frame : str
            Name of the frame of both; they are those of the world.
        pose : Pose, optional
            Of geometry_msgs.
        twist : Twist, optional
            Of geometry_msgs.

        Raises
        ------
        ParameterError
            If one of them is not usable; nothing has changed then.

        """
        check_frame(frame)
        if pose is None and twist is None:
            return
        simulation, robot = self._simulation, self._simulation.scene.robot
        before = simulation.state, simulation.history
        if twist is None:
            velocity, spin = base_twist(robot, simulation.state)
        else:
            velocity, spin = (
                numbers_of(getattr(twist, part), 'xyz', f'{part} velocity')
                for part in ('linear', 'angular')
            )
        try:
            if pose is not None:
                self._place(pose)
            self._move(before[0], velocity, spin)
        except ParameterError:
            simulation.state, simulation.history = before
            raise
        self._moved()

    def rest_at(self, frame: str, pose: Any) -> None:
        """Put the robot at rest where ``base_link`` has a pose, see `put`."""
        check_frame(frame)
        self._place(pose)
        self._moved()

    def _place(self, pose: Any) -> None:
        """Put the robot at rest where ``base_link`` has a pose."""
        try:
            r = numbers_of(pose.position, 'xyz', 'position')
            if np.abs(r).max() > FARTHEST:
                where = ', '.join(f'{x:g}' for x in r)
                raise ParameterError(f'position must be within {FARTHEST:g} m, got ({where}) m')
            x, y, z, w = numbers_of(pose.orientation, 'xyzw', 'orientation')
            norm = float(np.linalg.norm((x, y, z, w)))
            if not abs(norm - 1.0) <= UNIT_ERROR:
                raise ParameterError(
                    f'orientation must be a unit quaternion, got a norm of {norm:.4g}'
                )
        except ParameterError as error:
            raise UnusablePose(str(error)) from None
        p, robot = np.array([w, x, y, z]) / norm, self._simulation.scene.robot
        if robot.links:
            middle = pose_of_middle(robot, self._simulation.state.q, r, p)
            place(self._simulation, *middle)
        else:
            place(self._simulation, r, product(product(p, -TURN), FLAT))

    def _move(self, before: State, velocity: Array, spin: Array) -> None:
        """Give ``base_link`` a twist; against it the links move as in a state before."""
        simulation = self._simulation
        scene = simulation.scene
        if simulation.report.failure:
            raise ParameterError('the simulation has diverged: reset it first')
        turn = product(simulation.state.q[0, 3:], before.q[0, 3:] * CONJUGATE)
        u = before.u.copy()
        u[:, :3] = u[:, :3] @ rotation_matrices(turn).T
        state = with_base_twist(scene.robot, State(simulation.state.q, u), velocity, spin)
        speed, turning = (float(np.abs(part).max()) for part in np.split(state.u, 2, axis=1))
        if not (speed <= FASTEST and turning <= FASTEST_TURN):
            raise ParameterError(f'a link would move {too_fast(speed, turning)}')
        if scene.level == 'planar' and (why := what_does_not_lie(scene, state)):
            raise ParameterError(f'level is planar, but then {why}')
        simulation.state = state
        simulation.history = simulation.stepper.empty_history()


def check_frame(frame: str) -> None:
    """Raise an error if a frame is not that of the world."""
    if frame.rpartition('/')[2] not in ('', WORLD, ODOM):
        raise ParameterError(f'the frame must be {WORLD} or {ODOM}, got {quoted(frame)}')


def base_pose(robot: Robot, state: State) -> tuple[Array, Array]:
    """Return place [m] and orientation x y z w of ``base_link`` in the world."""
    positions, orientations = own_poses(robot, state.q)
    quaternion = orientations[robot.base_link, [1, 2, 3, 0]]
    return positions[robot.base_link], quaternion if robot.links else base_of_link(quaternion)


def base_twist(robot: Robot, state: State, link: int | None = None) -> tuple[Array, Array]:
    """Return velocity [m/s] and spin [rad/s] of ``base_link``, or of a link, in the world."""
    link = robot.base_link if link is None else link
    q, u = state.q[link], state.u[link]
    positions, _ = own_poses(robot, state.q)
    spin = rotation_matrices(q[3:]) @ u[3:]
    return u[:3] + np.cross(spin, positions[link] - q[:3]), spin


def with_base_twist(robot: Robot, state: State, velocity: Array, spin: Array) -> State:
    """Return a state in which ``base_link`` has a twist in the world, and joints their rates."""
    positions, _ = own_poses(robot, state.q)
    before = base_twist(robot, state)
    change, turning = velocity - before[0], spin - before[1]
    u = state.u.copy()
    u[:, :3] += change + np.cross(turning, state.q[:, :3] - positions[robot.base_link])
    u[:, 3:] += np.einsum('nji,j->ni', rotation_matrices(state.q[:, 3:]), turning)
    return State(state.q, u)


def base_of_link(quaternion: Array) -> Array:
    """Return the orientation x y z w of ``base_link`` from that of the middle link."""
    x, y, z, w = quaternion
    return np.roll(product(np.array([w, x, y, z]), TURN), -1)


def numbers_of(message: Any, names: str, what: str) -> Array:
    """Return fields of a message as numbers; raise an error if one is not finite."""
    found = np.array([getattr(message, name) for name in names])
    if not np.isfinite(found).all():
        raise ParameterError(f'{what} must be finite, got ({", ".join(f"{x:g}" for x in found)})')
    return found


def too_fast(speed: float, spin: float) -> str:
    """Return a clause on a speed [m/s] and a spin [rad/s] with which nothing is pushed."""
    return (
        f'at {speed:.4g} m/s and turn at {spin:.4g} rad/s; at most {FASTEST:g} m/s and '
        f'{FASTEST_TURN:g} rad/s'
    )
