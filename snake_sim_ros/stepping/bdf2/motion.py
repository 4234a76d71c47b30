# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Motions in joint coordinates, by which joints are closed exactly, and the memory of method `bdf2`.

The coordinates are the center of mass, so that momentum moves it exactly, the Euler parameters of
the middle link, and the joint angles. Velocities are those of all links, since momentum is theirs.
The memory is what a step leaves to the next one: the motions at its start and its end.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.detection import penetration
from snake_sim_ros.contact.problem import ContactHistory, make_contact_history
from snake_sim_ros.dynamics.balance import joint_rates
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.joint_drift import joint_violation_rate
from snake_sim_ros.dynamics.kinematics import (
    chain_coordinates,
    chain_geometry,
    copy_rows,
    end_velocities,
    half_rotation,
    joint_coordinates,
    joint_frames,
    link_frames,
    mean_of_links,
    rates_in_inertial_frame,
    twists,
)
from snake_sim_ros.scene.chain import JointPlaces
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.bdf2.formula import ANEW, coefficients, SMOOTH, UNKNOWN
from snake_sim_ros.stepping.model import Model, Workspace

CONSISTENT_SPEED = 1e-9  # largest speed of joint gaps at which velocities fit the joints [m/s]


class Motion(NamedTuple):
    """A state in joint coordinates, and the velocities of all links that belong to it."""

    pose: Array  # (7,) center of mass [m, frame I], and Euler parameters of the middle link
    angle: Array  # (n-1, 2) joint angles (yaw, pitch) [rad]
    rate: Array  # (n-1, 2) their rates [rad/s]
    u: Array  # (n, 6) velocities of the links [m/s, frame I], [rad/s, frame B]


def make_motion(n: int) -> Motion:
    """Return arrays for a state of n links."""
    return Motion(np.zeros(7), np.zeros((n - 1, 2)), np.zeros((n - 1, 2)), np.zeros((n, 6)))


@inlined
def keep(motion: Motion, to: Motion) -> None:
    """Copy a state."""
    for k in range(7):
        to.pose[k] = motion.pose[k]
    copy_rows(motion.angle, to.angle, 2)
    copy_rows(motion.rate, to.rate, 2)
    copy_rows(motion.u, to.u, 6)


@inlined
def formula(
    mass: Array, dt: float, memory: 'Bdf2Memory', own: 'Bdf2Arrays'
) -> tuple[float, float]:
    """
    Fill own.hat and the velocities of own.star from the states before the step.

    Returns
    -------
    h, h_q : float
        Times for which forces act on the velocity, and the velocity on the coordinates [s].

    """
    end, start, hat, star = memory.end, memory.start, own.hat, own.star
    w, c, h, half = coefficients(dt, memory)
    for i in range(len(end.u)):
        for k in range(6):
            change = end.u[i, k] - start.u[i, k]
            hat.u[i, k] = end.u[i, k] + c * change
            star.u[i, k] = end.u[i, k] + w * change
    for j in range(len(end.angle)):
        for k in range(2):
            angle, rate = end.angle[j, k], end.rate[j, k]
            hat.angle[j, k] = angle + c * (angle - start.angle[j, k]) + half * rate
            star.rate[j, k] = rate + w * (rate - start.rate[j, k])
    for k in range(7):
        hat.pose[k] = end.pose[k] + c * (end.pose[k] - start.pose[k])
    if half > 0.0:
        advance_pose(half, mass, end.pose, end.u, hat.pose)
    return h, h - half


@inlined
def advance_pose(h: float, mass: Array, at: Array, u: Array, pose: Array) -> None:
    """
    Add ``h F u`` to a pose, with the turn of the middle link taken at the pose `at`.

    A pose, shape (7,), is that of `chain_coordinates`.
    """
    v = mean_of_links(mass, u)
    for k in range(3):
        pose[k] += h * v[k]
    root = len(u) // 2
    p = at[3], at[4], at[5], at[6]
    e = half_rotation(p, (u[root, 3], u[root, 4], u[root, 5]), h / 2)
    for k in range(4):
        pose[3 + k] += e[k] - p[k]


@inlined
def reach_end(h_q: float, mass: Array, pose: Array, hat: Motion, motion: Motion) -> None:
    """
    Fill pose and angles of a motion with ``hat + h F u``, by its rates and its middle link.

    `pose`, shape (7,), is where the turn of the middle link is taken.
    """
    for k in range(7):
        motion.pose[k] = hat.pose[k]
    advance_pose(h_q, mass, pose, motion.u, motion.pose)
    e0, e1, e2, e3 = motion.pose[3], motion.pose[4], motion.pose[5], motion.pose[6]
    s = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    for k in range(3, 7):
        motion.pose[k] *= s
    for j in range(len(motion.angle)):
        for k in range(2):
            motion.angle[j, k] = hat.angle[j, k] + h_q * motion.rate[j, k]


@inlined
def predict_end(
    model: Model, h_q: float, memory: 'Bdf2Memory', own: 'Bdf2Arrays', work: Workspace
) -> None:
    """Fill own.star, and the geometry of the chain and its twists at the predicted end."""
    star, chain = own.star, work.chain
    reach_end(h_q, model.robot.mass, memory.end.pose, own.hat, star)
    places, frames = model.robot.places, work.frames
    chain_coordinates(places, model.robot.mass, star.pose, star.angle, work.q_mid)
    link_frames(work.q_mid[:, 3:], work.R)
    joint_frames(places, work.R, frames)
    chain_geometry(places, work.R, frames, work.center, chain.axis)
    if memory.phase[0] == UNKNOWN:  # the rates of the joints do not tell the velocities of links
        rates_in_inertial_frame(work.R, star.u, work.omega)
        twists(star.u, work.omega, work.center, chain.twist)
    else:
        consistent_twists(star, work.R, chain.axis, chain.twist)


@inlined
def consistent_twists(motion: Motion, R: Array, axis: Array, twist: Array) -> None:
    """Fill the twists of links from that of the middle one and from the rates of the joints."""
    n = len(twist)
    root, u, rate = n // 2, motion.u, motion.rate
    for k in range(3):
        twist[root, k] = 0.0
        for j in range(3):
            twist[root, k] += R[root, k, j] * u[root, 3 + j]
        twist[root, 3 + k] = u[root, k]
    for i in range(root + 1, n):
        for k in range(6):
            turn = rate[i - 1, 0] * axis[i - 1, 0, k]
            twist[i, k] = twist[i - 1, k] + turn + rate[i - 1, 1] * axis[i - 1, 1, k]
    for i in range(root - 1, -1, -1):
        for k in range(6):
            turn = rate[i, 0] * axis[i, 0, k]
            twist[i, k] = twist[i + 1, k] + turn + rate[i, 1] * axis[i, 1, k]


@inlined
def keep_velocities(places: JointPlaces, work: Workspace, motion: Motion) -> None:
    """Fill the velocities of a motion with the solution of the chain."""
    R, twist = work.R, work.chain.twist
    end_velocities(twist, R, work.center, motion.u)
    joint_rates(places, work.frames, twist, motion.rate)


@inlined
def add_velocities(motion: Motion, to: Motion) -> None:
    """Add the velocities of a motion to those of another."""
    for j in range(len(to.rate)):
        for k in range(2):
            to.rate[j, k] += motion.rate[j, k]
    for i in range(len(to.u)):
        for k in range(6):
            to.u[i, k] += motion.u[i, k]


class Bdf2Memory(NamedTuple):
    """What the method keeps of the last step."""

    end: Motion  # state at its end
    start: Motion  # state at its start
    q: Array  # (n, 7) coordinates at its end [m, frame I], [1]
    reference_rate: Array  # (n-1, 2) rates of the joint references [rad/s]
    dt: Array  # (1,) its length [s]
    span: Array  # (1,) time for which its impulses acted [s], 0 before the first step
    phase: Array  # (1,) UNKNOWN, ANEW or SMOOTH
    ticks: Array  # (1,) length of the next step, in parts of a step of the scene
    depth: Array  # (1,) penetration at its end [m]

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        return float(self.span[0])

    def forces_jump(self) -> None:
        """Let the next step start anew, because held torques change."""
        if self.phase[0] == SMOOTH:
            self.phase[0] = ANEW


class Bdf2Arrays(NamedTuple):
    """Arrays that a step fills besides `model.Workspace`; compiled functions take it as `own`."""

    hat: Motion  # what the formula combines of the states before; its rate is not used
    star: Motion  # predicted end
    end: Motion  # end of the step
    moving: Motion  # its rate, and u of the middle link, move the coordinates to the end
    closing: Motion  # its velocities close gaps
    q: Array  # (n, 7) coordinates at the end [m, frame I], [1]
    end_angle: Array  # (n-1, 2) joint references at the end [rad]
    end_rate: Array  # (n-1, 2) [rad/s]
    kept: ContactHistory  # before a part of the step
    q_start: Array  # (n, 7) coordinates at the start of the step of the scene [m, frame I], [1]
    u_start: Array  # (n, 6) and its velocities [m/s, frame I], [rad/s, frame B]


def make_memory(n: int) -> Bdf2Memory:
    """Return the memory before the first step, for n links."""
    return Bdf2Memory(
        make_motion(n), make_motion(n), np.zeros((n, 7)), np.zeros((n - 1, 2)),
        np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1),
    )  # fmt: skip


def make_arrays(n: int, contacts: int) -> Bdf2Arrays:
    """Return the arrays for n links and a number of contacts."""
    joints = np.zeros((n - 1, 2))
    return Bdf2Arrays(
        make_motion(n), make_motion(n), make_motion(n), make_motion(n), make_motion(n),
        np.zeros((n, 7)), joints, joints.copy(), make_contact_history(contacts),
        np.zeros((n, 7)), np.zeros((n, 6)),
    )  # fmt: skip


@inlined
def keep_state(q: Array, u: Array, q_to: Array, u_to: Array) -> None:
    """Copy q (n, 7) and u (n, 6) to q_to and u_to."""
    copy_rows(q, q_to, 7)
    copy_rows(u, u_to, 6)


@compiled
def recognize(model: Model, work: Workspace, q: Array, u: Array, memory: Bdf2Memory) -> None:
    """
    Take q (n, 7) and u (n, 6) as the state to continue from, unless the last step ended in it.

    The phase is then UNKNOWN if the velocities do not fit the joints, else ANEW.
    """
    same, end, n = memory.phase[0] != UNKNOWN, memory.end, len(q)
    for i in range(n):
        for k in range(7):
            same = same and memory.q[i, k] == q[i, k]
        for k in range(6):
            same = same and end.u[i, k] == u[i, k]
    if same:
        return
    link_frames(q[:, 3:], work.R)
    places, frames = model.robot.places, work.frames
    joint_frames(places, work.R, frames)
    rates_in_inertial_frame(work.R, u, work.omega)
    agrees = joint_violation_rate(places, work.R, frames, u, work.omega) <= CONSISTENT_SPEED
    memory.phase[0], memory.ticks[0] = ANEW if agrees else UNKNOWN, 0.0
    memory.depth[0] = penetration(model.obstacles, model.robot, q)
    joint_coordinates(frames, work.omega, work.coordinate[1])
    end.pose[0], end.pose[1], end.pose[2] = mean_of_links(model.robot.mass, q)
    for k in range(3, 7):
        end.pose[k] = q[n // 2, k]
    for j in range(n - 1):
        for k in range(2):
            end.angle[j, k] = places.present[j, k] * work.coordinate[1, j, k, 0]
            end.rate[j, k] = places.present[j, k] * work.coordinate[1, j, k, 1]
    keep_state(q, u, memory.q, end.u)
