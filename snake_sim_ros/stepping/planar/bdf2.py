"""
The method of `stepping.bdf2` in planar coordinates.

All contacts with the floor stay closed and their loads follow from equilibrium, so that nothing
lands and no impulse is sudden. The only event is a state that is not the end of the step before.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.joint_control import implicit_pd_law
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.bdf2 import PARTS
from snake_sim_ros.stepping.bdf2_memory import ANEW
from snake_sim_ros.stepping.bdf2_memory import CONSISTENT_SPEED
from snake_sim_ros.stepping.bdf2_memory import SMOOTH
from snake_sim_ros.stepping.bdf2_memory import UNKNOWN
from snake_sim_ros.stepping.planar.equilibrium import fill_momentum
from snake_sim_ros.stepping.planar.equilibrium import place_links_in_plane
from snake_sim_ros.stepping.planar.moreau import end_planar_velocities
from snake_sim_ros.stepping.planar.moreau import held_point
from snake_sim_ros.stepping.planar.moreau import is_planar
from snake_sim_ros.stepping.planar.moreau import move_in_plane
from snake_sim_ros.stepping.planar.newton import PlanarNewton
from snake_sim_ros.stepping.planar.newton import SECOND_CHANGE
from snake_sim_ros.stepping.planar.newton import solve_planar_contacts
from snake_sim_ros.stepping.state import without_memory
from snake_sim_ros.stepping.steps import note_outcome


class PlanarBdf2Memory(NamedTuple):
    """What the method keeps of the last step, besides `model.PlanarMemory`."""

    q_before: Array  # (n+2,) coordinates at its start
    u_before: Array  # (n, 3) velocities at its start
    rate: Array  # (n-1,) rates of the yaw references [rad/s]
    span: Array  # (1,) time for which its impulses acted [s], 0 before the first step
    phase: Array  # (1,) as in `bdf2_memory.PlanarBdf2Memory`

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        return float(self.span[0])


class PlanarBdf2Arrays(NamedTuple):
    """Arrays that a step fills besides `model.PlanarWorkspace`, as `Bdf2Arrays`."""

    q_hat: Array  # (n+2,)
    u_hat: Array  # (n, 3)
    u_star: Array  # (n, 3)
    q_start: Array  # (n+2,) coordinates at the start of the step
    u_start: Array  # (n, 3)


def make_planar_bdf2_memory(n: int) -> PlanarBdf2Memory:
    """Return the memory before the first step, for n links."""
    return PlanarBdf2Memory(
        np.zeros(n + 2), np.zeros((n, 3)), np.zeros(n - 1), np.zeros(1), np.zeros(1)
    )


def make_planar_arrays(n: int) -> PlanarBdf2Arrays:
    """Return the arrays for n links."""
    q, u = np.zeros((2, n + 2)), np.zeros((3, n, 3))
    return PlanarBdf2Arrays(q[0], u[0], u[1], q[1], u[2])


@merged
def planar_formula(model, dt, phase, q, u, memory, own):
    """
    Fill q_hat, u_hat and u_star as `bdf2.formula`; q_hat begins with the point that is held.

    Returns
    -------
    h, h_q : float
        As from `bdf2.formula`.

    """
    n, hat = len(u), own.q_hat
    smooth = phase == SMOOTH
    for i in range(n):
        for k in range(3):
            before = memory.u_before[i, k]
            own.u_hat[i, k] = (4.0 * u[i, k] - before) / 3.0 if smooth else u[i, k]
            own.u_star[i, k] = 2.0 * u[i, k] - before if smooth else u[i, k]
    for i in range(n + 2):
        hat[i] = q[i]
    held = held_point(model, q)
    if smooth:
        earlier = memory.q_before
        for i in range(n):
            hat[2 + i] = (4.0 * q[2 + i] - earlier[2 + i]) / 3.0
        before_x, before_y = held_point(model, earlier)
        hat[0] = (4.0 * (q[0] + held[0]) - (earlier[0] + before_x)) / 3.0
        hat[1] = (4.0 * (q[1] + held[1]) - (earlier[1] + before_y)) / 3.0
        return 2.0 / 3.0 * dt, 2.0 / 3.0 * dt
    hat[0] += held[0]
    hat[1] += held[1]
    if phase == UNKNOWN:
        return dt, dt
    move_in_plane(model, dt / 2, hat, u)
    return dt, dt / 2


@merged
def begin_planar_part(model, own, work, h, h_q, late, known, angle, rate, memory):
    """
    Fill the workspace for the contact solver.

    The joint references are those at the middle of the step; the part ends `late` [s] after it.
    """
    hat, u_star = own.q_hat, own.u_star
    for i in range(len(u_star)):
        theta = hat[2 + i] + h_q * u_star[i, 2]
        work.heading[i, 0], work.heading[i, 1] = math.cos(theta), math.sin(theta)
    place_links_in_plane(model, work, model.fall * (h / model.dt))
    for j in range(len(angle)):
        turn = u_star[j + 1, 2] - u_star[j, 2]
        bend = hat[3 + j] - hat[2 + j] + h_q * turn
        acceleration = (rate[j, 0] - memory.rate[j]) / model.dt if known else 0.0
        end_angle = angle[j, 0] + late * (rate[j, 0] + 0.5 * late * acceleration)
        torque, damping = implicit_pd_law(
            h_q, bend, turn, (end_angle, rate[j, 0] + late * acceleration),
            model.stiffness[j], model.damping[j],
        )  # fmt: skip
        work.torque[j], work.chain.damping[j] = torque * h, damping * h
    fill_momentum(model, work, own.u_hat, u_star)


@merged
def starts_anew(model, work, q, u):
    """Return whether the velocities of a given state satisfy the joints and the floor."""
    for i in range(len(u)):
        for k in range(3):
            if work.impact[i, k] != 0.0:
                return False
    fastest = 0.0
    for j in range(len(u) - 1):
        c, s = math.cos(q[2 + j]), math.sin(q[2 + j])
        next_c, next_s = math.cos(q[3 + j]), math.sin(q[3 + j])
        inner, outer = model.half_length[j] * u[j, 2], model.half_length[j + 1] * u[j + 1, 2]
        apart_x = u[j + 1, 0] - u[j, 0] + inner * s + outer * next_s
        apart_y = u[j + 1, 1] - u[j, 1] - inner * c - outer * next_c
        fastest = max(fastest, abs(apart_x), abs(apart_y))
    return fastest <= CONSISTENT_SPEED


@merged
def planar_part(own, model, work, dt, late, known, steps, k):
    """Advance q, u and history by dt, a step or a part of it; return whether it was taken."""
    q, u, report, history = steps.q, steps.u, steps.report[0], steps.history
    n, memory = len(u), history.memory.scheme
    span, phase = memory.span[0], memory.phase[0]
    h, h_q = planar_formula(model, dt, phase, q, u, memory, own)
    scale = h / (span if span > 0.0 else model.dt)
    for a in work.closed:
        for j in range(3):
            history.impulse[a, j] *= scale
        history.change[a, 0] *= scale
        history.change[a, SECOND_CHANGE] *= scale
    begin_planar_part(model, own, work, h, h_q, late, known, steps.angle[k], steps.rate[k], memory)
    outcome = solve_planar_contacts(
        PlanarNewton(None), model, work, work.closed, without_memory(history)
    )
    memory.span[0] = h
    if not is_planar(model, work, steps, outcome):
        return False
    keep_planar(q, u, memory.q_before, memory.u_before)
    for i in range(n + 2):
        q[i] = own.q_hat[i]
    end_planar_velocities(model, work, u)
    move_in_plane(model, h_q, q, u)
    held_x, held_y = held_point(model, q)
    q[0] -= held_x
    q[1] -= held_y
    for j in range(n - 1):
        work.applied[j, 0] *= model.dt / h
        work.applied[j, 1] *= model.dt / h
    memory.phase[0] = ANEW if phase == UNKNOWN else SMOOTH
    note_outcome(outcome, report)
    return True


@merged
def planar_step(own, model, work, steps, k):
    """Take step k; return whether it was taken."""
    q, u, report, memory = steps.q, steps.u, steps.report[0], steps.history.memory.scheme
    n = len(u)
    known, phase = memory.span[0] > 0.0, memory.phase[0]
    if phase == UNKNOWN and starts_anew(model, work, q, u):
        phase = memory.phase[0] = ANEW
    parts = 1 if phase == SMOOTH else PARTS
    unconverged, fallbacks = report.unconverged, report.fallbacks
    keep_planar(q, u, own.q_start, own.u_start)
    for part in range(parts):
        late, dt = model.dt * ((part + 1) / parts - 0.5), model.dt / parts
        if not planar_part(own, model, work, dt, late, known, steps, k):
            keep_planar(own.q_start, own.u_start, q, u)
            return False
    if phase != SMOOTH:
        keep_planar(own.q_start, own.u_start, memory.q_before, memory.u_before)
    for j in range(n - 1):
        memory.rate[j] = steps.rate[k, j, 0]
    memory.phase[0] = ANEW if phase == UNKNOWN else SMOOTH
    report.unconverged = min(report.unconverged, unconverged + 1)  # steps, not parts of them
    report.fallbacks = min(report.fallbacks, fallbacks + 1)
    report.steps += 1
    report.contacts = 2 * n
    return True


@inlined
def keep_planar(q, u, q_to, u_to):
    """Copy q (n+2,) and u (n, 3) to q_to and u_to."""
    for i in range(len(q)):
        q_to[i] = q[i]
    for i in range(len(u)):
        for k in range(3):
            u_to[i, k] = u[i, k]


@compiled
def advance_bdf2_in_plane(own, model, work, steps):
    """Take the steps up to the first that is not planar; see `stepper.PlanarStepper`."""
    for k in range(len(steps.angle)):
        steps.cycles[k] = cycle_counter()
        if not planar_step(own, model, work, steps, k):
            break
    steps.cycles[len(steps.angle)] = cycle_counter()
