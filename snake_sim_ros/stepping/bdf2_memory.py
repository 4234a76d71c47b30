"""What method `bdf2` keeps of the last step, and the arrays that its steps fill."""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_drift import joint_violation_rate
from snake_sim_ros.dynamics.kinematics import link_frames
from snake_sim_ros.dynamics.kinematics import rates_in_inertial_frame
from snake_sim_ros.scene.parameters import Array

# Phases: nothing is known of the motion; it starts smoothly here; the state before is known, too.
UNKNOWN, ANEW, SMOOTH = 0.0, 1.0, 2.0
CONSISTENT_SPEED = 1e-9  # largest speed of joint gaps at which velocities fit the joints [m/s]


class Bdf2Memory(NamedTuple):
    """What the method keeps of the last step."""

    q_before: Array  # (n, 7) coordinates at its start
    u_before: Array  # (n, 6) velocities at its start
    q: Array  # (n, 7) coordinates at its end
    u: Array  # (n, 6) velocities at its end
    rate: Array  # (n-1, 2) rates of the joint references [rad/s]
    span: Array  # (1,) time for which its impulses acted [s], 0 before the first step
    phase: Array  # (1,) UNKNOWN, ANEW or SMOOTH

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        return float(self.span[0])


class Bdf2Arrays(NamedTuple):
    """Arrays that a step fills besides `model.Workspace`; compiled functions take it as `own`."""

    q_hat: Array  # (n, 7) see `bdf2`
    u_hat: Array  # (n, 6)
    u_star: Array  # (n, 6) predicted velocities, then those that move the coordinates
    q_start: Array  # (n, 7) coordinates at the start of the step
    u_start: Array  # (n, 6)
    end_angle: Array  # (n-1, 2) joint references at the end of a part of the step [rad]
    end_rate: Array  # (n-1, 2) [rad/s]


def make_memory(n: int) -> Bdf2Memory:
    """Return the memory before the first step, for n links."""
    q, u, joints = np.zeros((n, 7)), np.zeros((n, 6)), np.zeros((n - 1, 2))
    return Bdf2Memory(q, u, q.copy(), u.copy(), joints, np.zeros(1), np.zeros(1))


def make_arrays(n: int) -> Bdf2Arrays:
    """Return the arrays for n links."""
    q, u, joints = np.zeros((n, 7)), np.zeros((n, 6)), np.zeros((n - 1, 2))
    return Bdf2Arrays(q, u, u.copy(), q.copy(), u.copy(), joints, joints.copy())


@inlined
def keep(q, u, q_to, u_to):
    """Copy q (n, 7) and u (n, 6) to q_to and u_to."""
    for i in range(len(q)):
        for k in range(7):
            q_to[i, k] = q[i, k]
        for k in range(6):
            u_to[i, k] = u[i, k]


@compiled
def recognize(model, work, q, u, memory):
    """Set the phase of the memory if q (n, 7) and u (n, 6) are not the end of the last step."""
    same = memory.phase[0] != UNKNOWN
    for i in range(len(q)):
        for k in range(7):
            same = same and memory.q[i, k] == q[i, k]
        for k in range(6):
            same = same and memory.u[i, k] == u[i, k]
    if same:
        return
    link_frames(q[:, 3:], work.R)
    rates_in_inertial_frame(work.R, u, work.omega)
    agrees = joint_violation_rate(model.half_length, work.R, u, work.omega) <= CONSISTENT_SPEED
    memory.phase[0] = ANEW if agrees else UNKNOWN
