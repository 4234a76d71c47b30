# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What method `bdf2` keeps of the last step, and the arrays that its steps fill."""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.penetration import penetration
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.joint_drift import joint_violation_rate
from snake_sim_ros.dynamics.kinematics import (
    joint_coordinates,
    link_frames,
    mean_of_links,
    rates_in_inertial_frame,
)
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.joint_motion import make_motion, Motion
from snake_sim_ros.stepping.parts import ANEW, SMOOTH, UNKNOWN

CONSISTENT_SPEED = 1e-9  # largest speed of joint gaps at which velocities fit the joints [m/s]


class Bdf2Memory(NamedTuple):
    """What the method keeps of the last step."""

    end: Motion  # state at its end
    start: Motion  # state at its start
    q: Array  # (n, 7) coordinates at its end
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
    q: Array  # (n, 7) coordinates at the end
    end_angle: Array  # (n-1, 2) joint references at the end [rad]
    end_rate: Array  # (n-1, 2) [rad/s]
    kept: Array  # (3, contacts, 5) history before a part of the step
    q_start: Array  # (n, 7) state at the start of the step of the scene
    u_start: Array  # (n, 6)


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
        np.zeros((n, 7)), joints, joints.copy(), np.zeros((3, contacts, 5)),
        np.zeros((n, 7)), np.zeros((n, 6)),
    )  # fmt: skip


@inlined
def keep_state(q, u, q_to, u_to):
    """Copy q (n, 7) and u (n, 6) to q_to and u_to."""
    for i in range(len(q)):
        for k in range(7):
            q_to[i, k] = q[i, k]
        for k in range(6):
            u_to[i, k] = u[i, k]


@compiled
def recognize(model, work, q, u, memory):
    """
    Take q (n, 7) and u (n, 6) as the state to go on from, if it is not the end of the last step.

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
    rates_in_inertial_frame(work.R, u, work.omega)
    agrees = joint_violation_rate(model.half_length, work.R, u, work.omega) <= CONSISTENT_SPEED
    memory.phase[0], memory.ticks[0] = ANEW if agrees else UNKNOWN, 0.0
    memory.depth[0] = penetration(model.obstacles, model.contact_offset, model.contact_radius, q)
    joint_coordinates(work.R, work.omega, work.coordinate[1])
    end.pose[0], end.pose[1], end.pose[2] = mean_of_links(model.mass, q)
    for k in range(3, 7):
        end.pose[k] = q[n // 2, k]
    for j in range(n - 1):
        for k in range(2):
            end.angle[j, k] = work.coordinate[1, j, k, 0]
            end.rate[j, k] = work.coordinate[1, j, k, 1]
    keep_state(q, u, memory.q, end.u)
