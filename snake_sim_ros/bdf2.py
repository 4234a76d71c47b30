"""
Second order between contact events: two-step differences in place of the paper's midpoint.

Deviation: the step of the paper takes its geometry at the middle, but friction, joint rates and
constraints at the velocity of the end: it is of first order. Here all are taken at the end. With
``q_hat = (4 q_n - q_(n-1))/3``, the same for u, and h = 2/3 dt (BDF2 [1]_),

    M u_E = M u_hat + h(q*, u*) h + W(q*) P,    q_E = q_hat + h F(q*) u_E,

where the star is the end as it is predicted, ``u* = 2 u_n - u_(n-1)``. The contact laws stay as
they are; they hold for u_E and are solved by Newton's method through the chain.

Deviation: a contact with a gap takes part when it may close in the step, with the law
``gamma_N + max(g - h gamma_N*, 0)/h + compliance P_N >= 0``: it lands with the gap closed, neither
late nor inside the floor.

A landing is an event: velocities jump, and differences over two steps mean nothing. The step is
then taken again as SUB_STEPS steps of backward Euler (the same equations with ``q_hat = q_n``,
h = dt/SUB_STEPS), and so is the first step, and the one after a landing.

.. [1] E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, ch. V.
"""

import math

from snake_sim_ros.compilation import compiled
from snake_sim_ros.compilation import cycle_counter
from snake_sim_ros.compilation import merged
from snake_sim_ros.contacts import contact_velocities
from snake_sim_ros.contacts import GAMMA
from snake_sim_ros.contacts import GAP
from snake_sim_ros.contacts import IMPULSE
from snake_sim_ros.contacts import selected
from snake_sim_ros.contacts import SHIFT
from snake_sim_ros.contacts import START
from snake_sim_ros.joint_control import implicit_pd_law
from snake_sim_ros.kinematics import chain_geometry
from snake_sim_ros.kinematics import end_velocities
from snake_sim_ros.kinematics import half_rotation
from snake_sim_ros.kinematics import joint_coordinates
from snake_sim_ros.kinematics import link_frames
from snake_sim_ros.kinematics import rates_in_inertial_frame
from snake_sim_ros.kinematics import twists
from snake_sim_ros.newton import solve_contacts
from snake_sim_ros.obstacles import contacts_of
from snake_sim_ros.report import CONTACTS
from snake_sim_ros.report import FALLBACKS
from snake_sim_ros.report import note_outcome
from snake_sim_ros.report import UNCONVERGED
from snake_sim_ros.spatial import applied_torque
from snake_sim_ros.spatial import axis_loads
from snake_sim_ros.spatial import finish
from snake_sim_ros.spatial import link_inertia
from snake_sim_ros.spatial import smooth_momentum
from snake_sim_ros.spatial import turns_are_small

SUB_STEPS = 4
REACH = 0.3  # a gap takes part if this speed could close it in the step [m/s]
RESTS = 1e-4  # gap at which a contact that carried load stays on velocity level [m]
# Selection: what is small beside an error of first order is not small here. Loads of a flat robot
# follow the heights of its links through the stiff joints, so these must not sink.
PRESS = 3e-8  # see contact_laws.PRESS [m/s]
LANDING = 1e-2  # approach velocity from which a landing is an event [m/s]

# What the method keeps in history from PREVIOUS on, for n links: q (7n), u (6n), and then
SMOOTH, SPAN = 0, 1  # whether q and u count, and the time that the last impulses acted for
RATE = 2  # rates of the joint references (2(n-1))


@merged
def begin(model, work, h, q, u, history, angle, rate, twice):
    """
    Predict the end of the step and fill all that the contact solver needs.

    With `twice`, q_hat and u_hat are those of two steps, else those of backward Euler.

    Returns
    -------
    count : int
        Contacts that take part.
    laws : Laws
        Contact laws of this step.

    """
    n = len(q)
    star, hat, u_star, u_hat = work.q_mid, work.q_hat, work.u_star, work.u_hat
    previous = history[3:].reshape(history[3:].size)
    for i in range(n):
        for k in range(7):
            earlier = previous[7 * i + k]
            hat[i, k] = (4.0 * q[i, k] - earlier) / 3.0 if twice else q[i, k]
            star[i, k] = 2.0 * q[i, k] - earlier if twice else q[i, k]
        for k in range(6):
            earlier = previous[7 * n + 6 * i + k]
            u_hat[i, k] = (4.0 * u[i, k] - earlier) / 3.0 if twice else u[i, k]
            u_star[i, k] = 2.0 * u[i, k] - earlier if twice else u[i, k]
        advance_link(h, star, hat, u_star, star, i)
    link_frames(star[:, 3:], work.R)
    rates_in_inertial_frame(work.R, u_star, work.omega)
    chain_geometry(model.half_length, work.R, work.center, work.chain.axis)
    joint_coordinates(work.R, work.omega, work.coordinate[1])
    for j in range(n - 1):
        for k in range(2):
            torque, damping = implicit_pd_law(
                h, work.coordinate[1, j, k, 0], work.coordinate[1, j, k, 1],
                (angle[j, k], rate[j, k]), model.stiffness[j, k], model.damping[j, k],
            )  # fmt: skip
            work.torque[j, k], work.damping[j, k] = torque * h, damping * h
    axis_loads(work.chain.axis, work.torque, work.damping, work.chain.torque, work.chain.damping)
    link_inertia(model, work.R, work.center, work.chain.bare)
    smooth_momentum(model, h, u_hat, u_star, work.R, work.center, work.chain.momentum)

    twists(u_star, work.omega, work.center, work.chain.twist)
    reach = max(model.activation_tolerance, REACH * h)
    count = contacts_of(model.obstacles, reach, model, work, star)
    contact, table = work.contact[:count], work.table
    contact_velocities(contact, table, work.chain.frame, work.chain.twist)
    for a in contact:
        table[a, START] = table[a, GAMMA]
        gap = table[a, GAP] - h * table[a, START]
        rests = history[0, a, 0] > 0.0 and table[a, GAP] <= RESTS
        if not rests and gap > model.activation_tolerance:
            table[a, SHIFT] = gap / h
        table[a, GAMMA] += table[a, SHIFT]
    return count, selected(
        model.laws, contact, table, model.mass, history[0], PRESS, -h * model.gravity[2]
    )


@compiled
def advance_link(h, frame, hat, u, q, i):
    """Fill q of link i with ``hat + h F(frame) u``, Euler parameters of length 1."""
    p = frame[i, 3], frame[i, 4], frame[i, 5], frame[i, 6]
    e = half_rotation(p, (u[i, 3], u[i, 4], u[i, 5]), h / 2)
    for k in range(3):
        q[i, k] = hat[i, k] + h * u[i, k]
    e0, e1 = hat[i, 3] + e[0] - p[0], hat[i, 4] + e[1] - p[1]
    e2, e3 = hat[i, 5] + e[2] - p[2], hat[i, 6] + e[3] - p[3]
    s = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    q[i, 3], q[i, 4], q[i, 5], q[i, 6] = s * e0, s * e1, s * e2, s * e3


@merged
def one_step(model, work, h, q, u, history, angle, rate, twice, report):
    """
    Take one implicit step, with the reference at its end.

    Returns
    -------
    int
        1 if a contact landed, 0 if none, -1 if the step diverged; then q and u are as before.

    """
    previous = history[3:].reshape(history[3:].size)
    scale = h / previous[13 * len(q) + SPAN]
    for a in range(history.shape[1]):
        for j in range(5):
            history[0, a, j] *= scale
        history[2, a, 0] *= scale
    previous[13 * len(q) + SPAN] = h

    count, laws = begin(model, work, h, q, u, history, angle, rate, twice)
    contact, table = work.contact[:count], work.table
    outcome = solve_contacts(model, laws, contact, table, work.chain, None, history)
    landed = 0
    for a in contact:
        if table[a, IMPULSE] > 0.0 and table[a, START] < -LANDING:
            landed = 1
    if not turns_are_small(h, work.chain.twist, report):
        return -1
    note_outcome(outcome, report)
    report[CONTACTS] = count
    applied_torque(work.R, work.chain.twist, work.torque, work.damping, work.applied)
    end_velocities(work.chain.twist, work.R, work.center, u)
    for i in range(len(q)):
        advance_link(h, work.q_mid, work.q_hat, u, q, i)
    return landed


@merged
def step(model, work, q, u, history, angle, rate, report):
    """Advance q, u and history by one step; return whether it did not diverge."""
    n = len(q)
    previous = history[3:].reshape(history[3:].size)
    known = previous[13 * n + SPAN] > 0.0
    if not known:
        previous[13 * n + SPAN] = model.dt
    copy(q, u, history, work.q_start, work.u_start, work.history)
    parts = 1 if previous[13 * n + SMOOTH] > 0.0 else SUB_STEPS
    unconverged, fallbacks = report[UNCONVERGED], report[FALLBACKS]
    part = landed = 0
    while part < parts:
        part += 1
        twice = parts == 1
        late = model.dt * (part / parts - 0.5)  # the reference is that of the middle of the step
        for j in range(len(angle)):
            for axis in range(2):
                change = rate[j, axis] - previous[13 * n + RATE + 2 * j + axis]
                acceleration = change / model.dt if known else 0.0
                work.end_rate[j, axis] = rate[j, axis] + late * acceleration
                mean = rate[j, axis] + 0.5 * late * acceleration
                work.end_angle[j, axis] = angle[j, axis] + late * mean
        h = 2.0 / 3.0 * model.dt if twice else model.dt / parts
        outcome = one_step(
            model, work, h, q, u, history, work.end_angle, work.end_rate, twice, report
        )
        landed = max(landed, outcome)
        if outcome < 0 or (outcome > 0 and twice):
            copy(work.q_start, work.u_start, work.history, q, u, history)
            if outcome < 0:
                history[:] = 0.0
                return False
            part, parts = 0, SUB_STEPS
    for i in range(n):
        for k in range(7):
            previous[7 * i + k] = work.q_start[i, k]
        for k in range(6):
            previous[7 * n + 6 * i + k] = work.u_start[i, k]
    for j in range(len(angle)):
        for axis in range(2):
            previous[13 * n + RATE + 2 * j + axis] = rate[j, axis]
    previous[13 * n + SMOOTH] = 1.0 - landed
    scale = model.dt / previous[13 * n + SPAN]
    for j in range(len(work.applied)):
        work.applied[j, 0] *= scale
        work.applied[j, 1] *= scale
    report[UNCONVERGED] = min(report[UNCONVERGED], unconverged + 1)  # steps, not parts of them
    report[FALLBACKS] = min(report[FALLBACKS], fallbacks + 1)
    return finish(model, work.chain.twist, q, u, history, report)


@compiled
def copy(q, u, history, q_to, u_to, history_to):
    """Fill q_to, u_to and history_to."""
    for i in range(len(q)):
        for k in range(7):
            q_to[i, k] = q[i, k]
        for k in range(6):
            u_to[i, k] = u[i, k]
    for slab in range(len(history)):
        for a in range(history.shape[1]):
            for j in range(5):
                history_to[slab, a, j] = history[slab, a, j]


@compiled
def advance(model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `spatial.SpatialStepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        if not step(model, work, q, u, history, angle[k], rate[k], report):
            break
    cycles[len(angle)] = cycle_counter()
