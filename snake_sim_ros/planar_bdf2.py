"""
Second order in the plane: the step of `bdf2` for planar coordinates.

All contacts stay closed, so that nothing lands: only the first step, which has no step before it,
is taken as SUB_STEPS steps of backward Euler.
"""

import math

from snake_sim_ros.bdf2 import SUB_STEPS
from snake_sim_ros.compilation import compiled
from snake_sim_ros.compilation import cycle_counter
from snake_sim_ros.compilation import inlined
from snake_sim_ros.compilation import merged
from snake_sim_ros.joint_control import implicit_pd_law
from snake_sim_ros.planar import end_velocities
from snake_sim_ros.planar import fill_momentum
from snake_sim_ros.planar import held_point
from snake_sim_ros.planar import is_planar
from snake_sim_ros.planar import move
from snake_sim_ros.planar import place_links
from snake_sim_ros.planar_newton import BEND
from snake_sim_ros.planar_newton import solve_contacts
from snake_sim_ros.report import CONTACTS
from snake_sim_ros.report import FALLBACKS
from snake_sim_ros.report import note_outcome
from snake_sim_ros.report import STEPS
from snake_sim_ros.report import UNCONVERGED

# What the method keeps in history, from PREVIOUS on and behind the 6n + 2 numbers of
# `planar_stepper`, for n links: q (n+2), u (3n), rates of the yaw references (n-1), and then the
# time that the last impulses acted for, 0 if nothing is known.


@merged
def begin(model, work, h, q, u, previous, angle, rate, late, twice):
    """
    Predict the end of a part of the step and fill all that the contact solver needs.

    With `twice`, hat values are those of two steps, else those of backward Euler. The reference is
    that of the middle of the step, and the part ends `late` [s] after it.
    """
    n = len(u)
    for i in range(n + 2):
        work.q_hat[i] = (4.0 * q[i] - previous[i]) / 3.0 if twice else q[i]
    for i in range(n):
        for k in range(3):
            earlier = previous[n + 2 + 3 * i + k]
            work.u_hat[i, k] = (4.0 * u[i, k] - earlier) / 3.0 if twice else u[i, k]
            work.u_star[i, k] = 2.0 * u[i, k] - earlier if twice else u[i, k]
        theta = work.q_hat[2 + i] + h * work.u_star[i, 2]
        work.heading[i, 0], work.heading[i, 1] = math.cos(theta), math.sin(theta)
    place_links(model, work, model.fall * (h / model.dt))
    known = previous[5 * n + 1] > 0.0
    for j in range(n - 1):
        turn = work.u_star[j + 1, 2] - work.u_star[j, 2]
        bend = work.q_hat[3 + j] - work.q_hat[2 + j] + h * turn
        change = rate[j, 0] - previous[4 * n + 2 + j]
        acceleration = change / model.dt if known else 0.0
        end_angle = angle[j, 0] + late * (rate[j, 0] + 0.5 * late * acceleration)
        torque, damping = implicit_pd_law(
            h, bend, turn, (end_angle, rate[j, 0] + late * acceleration),
            model.stiffness[j], model.damping[j],
        )  # fmt: skip
        work.torque[j], work.chain.damping[j] = torque * h, damping * h
    fill_momentum(model, work, work.u_hat, work.u_star)


@merged
def one_step(model, work, h, q, u, history, previous, angle, rate, late, twice, report):
    """Take one implicit step; return whether it was done."""
    n = len(u)
    span = previous[5 * n + 1]
    scale = h / span if span > 0.0 else h / model.dt
    for a in work.contact:
        for j in range(3):
            history[0, a, j] *= scale
        history[2, a, 0] *= scale
        history[2, a, BEND] *= scale
    begin(model, work, h, q, u, previous, angle, rate, late, twice)
    outcome = solve_contacts(model, work, work.contact, None, history)
    if not is_planar(model, work, history, outcome, report):
        return False
    x, y = held_point(model, q)
    hat_x, hat_y = q[0] + x, q[1] + y
    if twice:
        x, y = held_point(model, previous)
        hat_x = (4.0 * hat_x - (previous[0] + x)) / 3.0
        hat_y = (4.0 * hat_y - (previous[1] + y)) / 3.0
    for i in range(n + 2):
        q[i] = work.q_hat[i]
    q[0], q[1] = hat_x, hat_y
    end_velocities(model, work, u)
    move(model, h, q, u)
    x, y = held_point(model, q)
    q[0] -= x
    q[1] -= y
    note_outcome(outcome, report)
    return True


@merged
def step(model, work, q, u, history, angle, rate, report):
    """Advance q, u and history by one step; return whether it was done."""
    n, dt = len(u), model.dt
    previous = history[3:].reshape(history[3:].size)[6 * n + 2 :]
    keep(q, u, work.q_start, work.u_start)
    parts = 1 if previous[5 * n + 1] > 0.0 else SUB_STEPS
    h = 2.0 / 3.0 * dt if parts == 1 else dt / parts
    unconverged, fallbacks = report[UNCONVERGED], report[FALLBACKS]
    for part in range(parts):
        late = dt * ((part + 1) / parts - 0.5)
        twice = parts == 1
        if not one_step(model, work, h, q, u, history, previous, angle, rate, late, twice, report):
            keep(work.q_start, work.u_start, q, u)
            return False
        if part + 1 < parts:
            previous[5 * n + 1] = h
    for i in range(n + 2):
        previous[i] = work.q_start[i]
    for i in range(n):
        for k in range(3):
            previous[n + 2 + 3 * i + k] = work.u_start[i, k]
    for j in range(n - 1):
        previous[4 * n + 2 + j] = rate[j, 0]
        work.applied[j, 0] *= dt / h
        work.applied[j, 1] *= dt / h
    previous[5 * n + 1] = h
    report[UNCONVERGED] = min(report[UNCONVERGED], unconverged + 1)  # steps, not parts of them
    report[FALLBACKS] = min(report[FALLBACKS], fallbacks + 1)
    report[STEPS] += 1
    report[CONTACTS] = 2 * n
    return True


@inlined
def keep(q, u, q_to, u_to):
    """Fill q_to and u_to."""
    for i in range(len(q)):
        q_to[i] = q[i]
    for i in range(len(u)):
        for k in range(3):
            u_to[i, k] = u[i, k]


@compiled
def advance(model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `planar_stepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        if not step(model, work, q, u, history, angle[k], rate[k], report):
            break
    cycles[len(angle)] = cycle_counter()
