# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The regularized robot as an ordinary differential equation in minimal coordinates, compiled.

The coordinates are those of the middle link and the joint angles, so that no joint can come apart.
The work for the rate of change is linear in the number of links. A sweep outward from the middle
link finds positions, velocities, and the accelerations of the links for zero accelerations of the
middle link and the joints. The articulated-body sweep [1] then finds these from the remaining
wrenches.

.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer 2008, ch. 7.
"""

from typing import Any, NamedTuple

from snake_sim_benchmarks.comparison.baselines.penalty import penalty_forces, PenaltyLaw
from snake_sim_ros.contact.delassus import fill_wrenches
from snake_sim_ros.contact.detection import find_contacts, Found, penetration, Pose
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.dynamics.articulated_body import Chain, factor_chain, reset_chain, solve_chain
from snake_sim_ros.dynamics.balance import link_inertia, smooth_momentum
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.kinematics import (
    chain_geometry,
    end_velocities,
    half_rotation,
    link_frames,
    turned_about_x,
    turned_about_y,
)
from snake_sim_ros.dynamics.spatial_vectors import row_of
from snake_sim_ros.scene.chain import JointPlaces
from snake_sim_ros.scene.gait import of_joint, soft_start, wave
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.model import Model, Workspace

# Of one time and one joint; the package has them for arrays of these.
fade_at: Any = compiled(soft_start)
wave_at: Any = compiled(wave)
of_joint_at: Any = compiled(of_joint)

# y is [center (3) and Euler parameters (4) of the middle link, joint angles (n-1, 2), its velocity
# (3, in I) and angular velocity (3, in B), joint rates (n-1, 2), work of the joints and of the
# contacts]; see `integrators.SmoothRobot` for units.
ANGLES = 7
Numbers = tuple[float, ...]  # a twist or Euler parameters, in registers


class LinkVelocities(NamedTuple):
    """Velocities of all links, and intermediate accelerations."""

    u: Array  # (n, 6) as in `state.State`
    rest: Array  # (n, 6) see `balance`


@inlined
def rates_begin(n: int) -> int:
    """Return the index in y of the first velocity; the works are its last two entries."""
    return ANGLES + 2 * (n - 1)


@inlined
def place_links(places: JointPlaces, y: Array, work: Workspace) -> None:
    """Fill the coordinates, frames, centers from O and joint axes of all links in `work`."""
    q, n = work.q_mid, len(work.R)
    root = n // 2
    for k in range(7):
        q[root, k] = y[k]
    p = y[3], y[4], y[5], y[6]
    for j in range(root, n - 1):
        p = turned_about_x(turned_about_y(p, 0.5 * y[ANGLES + 2 * j]), 0.5 * y[ANGLES + 2 * j + 1])
        q[j + 1, 3], q[j + 1, 4], q[j + 1, 5], q[j + 1, 6] = p
    p = y[3], y[4], y[5], y[6]
    for j in range(root - 1, -1, -1):
        p = turned_about_y(
            turned_about_x(p, -0.5 * y[ANGLES + 2 * j + 1]), -0.5 * y[ANGLES + 2 * j]
        )
        q[j, 3], q[j, 4], q[j, 5], q[j, 6] = p
    link_frames(q[:, 3:], work.R)
    chain_geometry(places, work.R, work.frames, work.center, work.chain.axis)
    for i in range(n):
        for k in range(3):
            q[i, k] = y[k] + work.center[i, k]


@inlined
def add_moved_axis(twist: Numbers, axis: Numbers, rate: float, acceleration: Array) -> None:
    """Add the acceleration of a joint axis that moves with a link, for its rate [rad/s]."""
    wx, wy, wz, vx, vy, vz = twist
    ax, ay, az, bx, by, bz = axis
    acceleration[0] += rate * (wy * az - wz * ay)
    acceleration[1] += rate * (wz * ax - wx * az)
    acceleration[2] += rate * (wx * ay - wy * ax)
    acceleration[3] += rate * (wy * bz - wz * by + vy * az - vz * ay)
    acceleration[4] += rate * (wz * bx - wx * bz + vz * ax - vx * az)
    acceleration[5] += rate * (wx * by - wy * bx + vx * ay - vy * ax)


@inlined
def move_joint(j: int, inner: int, outer: int, rates: Array, chain: Chain) -> None:
    """Fill twist and acceleration (chain.correction) of the link beyond joint j."""
    axis, twist, acceleration = chain.axis, chain.twist, chain.correction
    for k in range(6):
        moved = axis[j, 0, k] * rates[2 * j] + axis[j, 1, k] * rates[2 * j + 1]
        twist[outer, k] = twist[inner, k] + moved
        acceleration[outer, k] = acceleration[inner, k]
    for k in range(2):  # yaw turns about an axis of link j, pitch about one of link j+1
        add_moved_axis(
            row_of(twist, j + k), row_of(axis[j], k), rates[2 * j + k], acceleration[outer]
        )


@inlined
def move_links(y: Array, work: Workspace, u_links: Array) -> None:
    """
    Fill twists and velocities of all links, and the accelerations of their twists.

    The accelerations are those for zero accelerations of the middle link and the joints.
    """
    chain, n, R = work.chain, len(work.R), work.R
    root = n // 2
    u = y[rates_begin(n) :]
    for k in range(3):
        chain.twist[root, k] = R[root, k, 0] * u[3] + R[root, k, 1] * u[4] + R[root, k, 2] * u[5]
        chain.twist[root, 3 + k] = u[k]
        chain.correction[root, k] = chain.correction[root, 3 + k] = 0.0
    for j in range(root, n - 1):
        move_joint(j, j, j + 1, u[6:], chain)
    for j in range(root - 1, -1, -1):
        move_joint(j, j + 1, j, u[6:], chain)
    end_velocities(chain.twist, R, work.center, u_links)


@inlined
def balance(model: Model, work: Workspace, motion: LinkVelocities) -> None:
    """
    Fill the wrenches of gravity and inertia, in place of momenta, for zero joint accelerations.

    A twist belongs to the body point that passes a fixed O, so that the center of a link has the
    acceleration ``a_O + alpha x r + omega x v``. The wrench of inertia is the momentum of
    velocities that equal the negative accelerations.
    """
    twist, u, rest = work.chain.twist, motion.u, motion.rest
    end_velocities(work.chain.correction, work.R, work.center, rest)
    for i in range(len(u)):
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        rest[i, 0] = -rest[i, 0] - (wy * u[i, 2] - wz * u[i, 1])
        rest[i, 1] = -rest[i, 1] - (wz * u[i, 0] - wx * u[i, 2])
        rest[i, 2] = -rest[i, 2] - (wx * u[i, 1] - wy * u[i, 0])
        for k in range(3, 6):
            rest[i, k] = -rest[i, k]
    smooth_momentum(model.robot, 1.0, (rest, u), work.R, work.center, work.chain.momentum)
    link_inertia(model.robot, work.R, work.center, work.chain.bare)


@inlined
def joint_torques(model: Model, waves: Any, t: float, y: Array, torque: Array) -> float:
    """Fill the torques of the joint controllers [N m]; return their power [W]."""
    begin, power = rates_begin(len(torque) + 1) + 6, 0.0
    fade = fade_at(t, waves[1])
    for j in range(len(torque)):
        for k in range(2):
            amplitude, (omega, phase_lag, phase, offset) = waves[0][k]
            along = of_joint_at(amplitude[j], j * phase_lag)
            angle, rate = wave_at((omega, phase, offset), fade, t, along)
            joint_rate = y[begin + 2 * j + k]
            torque[j, k] = model.robot.stiffness[j, k] * (angle - y[ANGLES + 2 * j + k])
            torque[j, k] += model.robot.damping[j, k] * (rate - joint_rate)
            power += torque[j, k] * joint_rate
    return power


@inlined
def carried_acceleration(twist: Numbers) -> Numbers:
    """Return omega x v of the link whose center is O, and zero angular acceleration."""
    wx, wy, wz, vx, vy, vz = twist
    return wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx, 0.0, 0.0, 0.0


@inlined
def rate_of_change(
    model: Model,
    law: PenaltyLaw,
    waves: Any,
    work: Workspace,
    motion: LinkVelocities,
    t: float,
    y: Array,
    y_dot: Array,
) -> None:
    """
    Fill the time derivative of y; a comment at ANGLES describes its layout.

    Parameters
    ----------
    model : stepping.model.Model
    law : penalty.PenaltyLaw
    waves : tuple
        Amplitudes (n-1,) and other numbers of the yaw wave and of the pitch wave, and the time of
        the soft start [s].
    work : stepping.model.Workspace
        Its middle coordinates are filled with those of y.
    motion : Motion
        Its velocities are filled with those of y.
    t : float
        Time [s].
    y, y_dot : ndarray, shape (15 + 4 (n-1),)

    """
    chain, contacts, n = work.chain, work.contacts, len(work.R)
    root, begin = n // 2, rates_begin(n)
    place_links(model.robot.places, y, work)
    move_links(y, work, motion.u)
    balance(model, work, motion)
    y_dot[-2] = joint_torques(model, waves, t, y, chain.torque)
    pose = Pose(model.robot, work.q_mid, work.R, work.center)
    found = Found(work.closed, work.contacts, work.takes_part, chain.frame)
    closed = work.closed[: find_contacts(model.obstacles, 0.0, pose, found)]
    contact_velocities(closed, contacts, chain.frame, chain.twist)
    penalty_forces(law, model.laws, closed, contacts, model.robot.mass)
    y_dot[-1] = 0.0
    for a in closed:
        for k in range(3):
            y_dot[-1] += contacts.solution.impulse[a, k] * contacts.solution.gamma[a, k]
    carried = carried_acceleration(row_of(chain.twist, root))
    reset_chain(chain)
    factor_chain(chain)
    fill_wrenches(closed, contacts, chain)
    solve_chain(chain, chain.torque)
    for k in range(3):
        y_dot[k] = y[begin + k]
    p, omega = (y[3], y[4], y[5], y[6]), (y[begin + 3], y[begin + 4], y[begin + 5])
    turned = half_rotation(p, omega, 0.5)
    for k in range(4):
        y_dot[3 + k] = turned[k] - p[k]
    for k in range(2 * (n - 1)):
        y_dot[ANGLES + k] = y[begin + 6 + k]
        y_dot[begin + 6 + k] = chain.rate[k // 2, k % 2]
    end_velocities(chain.twist, work.R, work.center, motion.rest)
    for k in range(6):
        y_dot[begin + k] = motion.rest[root, k] + carried[k]


@compiled
def rates_of_change(
    model: Model,
    law: PenaltyLaw,
    waves: Any,
    work: Workspace,
    motion: LinkVelocities,
    t: float,
    y: Array,
    y_dot: Array,
) -> None:
    """Fill the time derivative of every row of y, shape (m, 15 + 4 (n-1))."""
    for k in range(len(y)):
        rate_of_change(model, law, waves, work, motion, t, y[k], y_dot[k])


@compiled
def configuration(model: Model, work: Workspace, motion: LinkVelocities, y: Array) -> float:
    """Fill work.q_mid and motion.u of all links from y; return the largest penetration [m]."""
    place_links(model.robot.places, y, work)
    move_links(y, work, motion.u)
    return penetration(model.obstacles, model.robot, work.q_mid)
