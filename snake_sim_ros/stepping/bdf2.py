"""
Second order in time: two-step differences in place of the paper's midpoint.

Deviation: the step of the paper takes its geometry at the middle, but friction, joint rates and
constraints at the velocity of the end: it is of first order. Here all are taken at the end. With
``q_hat = (4 q_n - q_(n-1))/3``, the same for u, and h = 2/3 dt (BDF2 [1]_),

    M u_E = M u_hat + h(q*, u*) h + W(q*) P,    q_E = q_hat + h F(q*) u_E,

where the star is the end as it is predicted, ``u* = 2 u_n - u_(n-1)``. The contact laws stay as
they are; they hold for u_E and are solved by Newton's method through the chain.

Deviation: a contact with a gap takes part when it may close in the step, with the law
``gamma_N + (g - h gamma_N*)/h + compliance P_N >= 0``: the step ends with the gap closed, neither
open nor inside the floor. That is where an inelastic impact in the step takes the configuration,
up to dt^2: the impulse moves it as far as the gap asks, whenever in the step it acts. What sticks
as it lands is taken to stick for all of the step: off by dt times the jump across. The velocity
afterwards is that of the impact law, ``gamma_N >= 0``: the contacts that closed are solved once
more without their gaps.

The formula never differentiates across an event, a jump of the velocity whatever caused it. A
contact that lands, however softly, is one; so is a normal impulse beyond what forces make in a
step (an impact without collision), and a state that is not the one the step before left (a push,
another scene). The step after an event starts anew, in PARTS equal parts, the first with

    u_hat = u_n, h = dt for velocities;    q_hat = q_n + dt/2 F(q_n) u_n, h = dt/2 for coordinates,

which is exact for constant forces, and for others off by dt^2 once an event. If the joints do not
agree with the velocities of a given state, the first part is itself the impact that makes them
agree: backward Euler, ``q_hat = q_n`` and h = dt for both, and the next part starts anew.

.. [1] E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, ch. V.
"""

import math

from snake_sim_ros.contact.contacts import contact_velocities
from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import GAP
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import LAST
from snake_sim_ros.contact.contacts import selected
from snake_sim_ros.contact.contacts import SHIFT
from snake_sim_ros.contact.contacts import START
from snake_sim_ros.contact.detection import contacts_of
from snake_sim_ros.contact.newton import solve_contacts
from snake_sim_ros.contact.projections import IMPACT
from snake_sim_ros.dynamics.balance import applied_torque
from snake_sim_ros.dynamics.balance import axis_loads
from snake_sim_ros.dynamics.balance import link_inertia
from snake_sim_ros.dynamics.balance import smooth_momentum
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.joint_control import implicit_pd_law
from snake_sim_ros.dynamics.kinematics import chain_geometry
from snake_sim_ros.dynamics.kinematics import end_velocities
from snake_sim_ros.dynamics.kinematics import half_rotation
from snake_sim_ros.dynamics.kinematics import joint_coordinates
from snake_sim_ros.dynamics.kinematics import joint_speed
from snake_sim_ros.dynamics.kinematics import link_frames
from snake_sim_ros.dynamics.kinematics import rates_in_inertial_frame
from snake_sim_ros.dynamics.kinematics import twists
from snake_sim_ros.stepping.moreau import finish
from snake_sim_ros.stepping.moreau import turns_are_small
from snake_sim_ros.stepping.report import CONTACTS
from snake_sim_ros.stepping.report import FALLBACKS
from snake_sim_ros.stepping.report import note_outcome
from snake_sim_ros.stepping.report import UNCONVERGED

PARTS = 2  # of a step that starts anew
REACH = 0.3  # a gap takes part if this speed could close it in the step [m/s]
# By its law a contact that carries load has no gap; what gap it has is the error of integration,
# of third order in dt. Up to RESTS it stays on velocity level, so that the error is not made a
# velocity; beyond, it is open, and may land.
RESTS = 1e-4  # [m]
# Selection: what is small beside an error of first order is not small here. Loads of a flat robot
# follow the heights of its links through the stiff joints, so these must not sink.
PRESS = 3e-8  # see contact_laws.PRESS [m/s]
AGREE = 1e-9  # speed up to which the joints agree with given velocities [m/s]

# What the method keeps in history from PREVIOUS on, for n links: q (7n) and u (6n) of the start of
# the last step, q and u of its end, and then
PHASE, SPAN = 0, 1  # what is known of the motion; the time that the last impulses acted for
RATE = 2  # rates of the joint references (2(n-1))
UNKNOWN, ANEW, SMOOTH = 0.0, 1.0, 2.0  # phases: nothing; it starts here; q and u before it count


@merged
def formula(phase, dt, q, u, earlier, work):
    """
    Fill q_hat, u_hat and u_star of a step from what is known of the motion before it.

    Parameters
    ----------
    phase : float
        UNKNOWN (backward Euler), ANEW or SMOOTH.
    earlier : ndarray
        q (7n) and u (6n) of the step before, in a row.

    Returns
    -------
    h, h_q : float
        Time over which forces act on the velocity, and the velocity on coordinates [s].

    """
    n = len(q)
    hat, u_hat, u_star = work.q_hat, work.u_hat, work.u_star
    smooth = phase == SMOOTH
    for i in range(n):
        for k in range(7):
            hat[i, k] = (4.0 * q[i, k] - earlier[7 * i + k]) / 3.0 if smooth else q[i, k]
        for k in range(6):
            before = earlier[7 * n + 6 * i + k]
            u_hat[i, k] = (4.0 * u[i, k] - before) / 3.0 if smooth else u[i, k]
            u_star[i, k] = 2.0 * u[i, k] - before if smooth else u[i, k]
    if smooth:
        return 2.0 / 3.0 * dt, 2.0 / 3.0 * dt
    if phase == UNKNOWN:
        return dt, dt
    for i in range(n):
        p = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
        e0, e1, e2, e3 = half_rotation(p, (u[i, 3], u[i, 4], u[i, 5]), dt / 4)
        hat[i, 3], hat[i, 4], hat[i, 5], hat[i, 6] = e0, e1, e2, e3
        for k in range(3):
            hat[i, k] += dt / 2 * u[i, k]
    return dt, dt / 2


@merged
def predicted_frames(h_q, q, earlier, smooth, work):
    """Fill q_mid with the predicted end of the step, and what follows from it."""
    star, n = work.q_mid, len(q)
    for i in range(n):
        for k in range(7):
            star[i, k] = 2.0 * q[i, k] - earlier[7 * i + k] if smooth else q[i, k]
        advance_link(h_q, star, work.q_hat, work.u_star, star, i)
    link_frames(star[:, 3:], work.R)
    rates_in_inertial_frame(work.R, work.u_star, work.omega)


@merged
def begin(model, work, h, h_q, late, history, angle, rate):
    """
    Fill all that the contact solver needs, for the predicted end of the step.

    Coordinates have moved for `late` [s] before h_q begins.

    Returns
    -------
    count : int
        Contacts that take part.
    laws : Laws
        Contact laws of this step.

    """
    chain_geometry(model.half_length, work.R, work.center, work.chain.axis)
    joint_coordinates(work.R, work.omega, work.coordinate[1])
    for j in range(len(angle)):
        for k in range(2):
            torque, damping = implicit_pd_law(
                h_q, work.coordinate[1, j, k, 0], work.coordinate[1, j, k, 1],
                (angle[j, k], rate[j, k]), model.stiffness[j, k], model.damping[j, k],
            )  # fmt: skip
            work.torque[j, k], work.damping[j, k] = torque * h, damping * h
    axis_loads(work.chain.axis, work.torque, work.damping, work.chain.torque, work.chain.damping)
    link_inertia(model, work.R, work.center, work.chain.bare)
    smooth_momentum(model, h, work.u_hat, work.u_star, work.R, work.center, work.chain.momentum)

    twists(work.u_star, work.omega, work.center, work.chain.twist)
    reach = max(model.activation_tolerance, REACH * h_q)
    count = contacts_of(model.obstacles, reach, model, work, work.q_mid)
    contact, table = work.contact[:count], work.table
    contact_velocities(contact, table, work.chain.frame, work.chain.twist)
    for a in contact:
        table[a, START], table[a, LAST] = table[a, GAMMA], history[0, a, 0]
        gap = table[a, GAP] - h_q * table[a, START]
        rests = history[0, a, 0] > 0.0 and table[a, GAP] <= RESTS
        if gap > model.activation_tolerance and not rests:
            table[a, SHIFT] = gap / h_q
        elif gap < 0.0 and not rests:  # what the motion before put inside comes out
            table[a, SHIFT] = max(gap, late * min(0.0, table[a, START])) / h_q
        table[a, GAMMA] += table[a, SHIFT]
    return count, selected(
        model.laws, contact, table, model.mass, history[0], PRESS, model.dt,
        -h * model.gravity[2],
    )  # fmt: skip


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


@inlined
def events(model, h, contact, table):
    """
    Return what the impulses of a step say of its velocities.

    Returns
    -------
    jumps : bool
        Whether a contact landed that carried no load before, or an impulse is no force.
    lands : bool
        Whether velocities close gaps in the step: they are not those after the impact.
    closed : int
        Contacts that are closed, not all that could close.

    """
    weight = largest = 0.0
    for m in model.mass:
        weight -= m * h * model.gravity[2]
    for a in contact:
        largest = max(largest, table[a, LAST])
    jumps, lands, closed = False, False, 0
    for a in contact:
        P_N = table[a, IMPULSE]
        closed += P_N > 0.0 or table[a, SHIFT] <= 0.0
        if P_N > 0.0:
            lands = lands or table[a, SHIFT] != 0.0
            meets = table[a, LAST] <= 0.0 and table[a, START] < 0.0
            jumps = jumps or meets or P_N > IMPACT * max(weight, largest)
    return jumps or lands, lands, closed


@inlined
def closed_now(h_q, tolerance, contact, table):
    """Keep the contacts that are closed after a step in front, at no gap; return their number."""
    count = 0
    for a in contact:
        gap = table[a, GAP] + h_q * (table[a, GAMMA] - table[a, SHIFT] - table[a, START])
        if table[a, IMPULSE] > 0.0 or table[a, SHIFT] == 0.0 or gap <= tolerance:
            table[a, SHIFT] = 0.0
            contact[count] = a
            count += 1
    return count


@merged
def solve(model, work, laws, contact, h, h_q, history, report):
    """
    Solve the contacts and, if they land, once more without their gaps.

    The velocity that moves coordinates is then in work.u_star, the one after the impact in the
    twists of the chain.

    Returns
    -------
    small : bool
        Whether no link turns further than is resolved.
    jumps, closed
        See `events`.

    """
    table, chain = work.table, work.chain
    jumps, lands, closed, solved = False, True, 0, 0
    while lands:
        note_outcome(solve_contacts(model, laws, contact, table, chain, None, history), report)
        if not turns_are_small(model.dt, chain.twist, report):
            return False, jumps, closed
        lands = False
        solved += 1
        if solved == 1:
            end_velocities(chain.twist, work.R, work.center, work.u_star)
            jumps, lands, closed = events(model, h, contact, table)
            if lands:
                contact = contact[: closed_now(h_q, model.activation_tolerance, contact, table)]
    return True, jumps, closed


@inlined
def end_references(dt, part, angle, rate, earlier, known, end_angle, end_rate):
    """
    Fill the references at the end of part `part` of PARTS, from those of the middle of the step.

    They go on with the acceleration that they had since the step before, if that is known.
    """
    late = dt * (part / PARTS - 0.5)
    for j in range(len(angle)):
        for axis in range(2):
            acceleration = (rate[j, axis] - earlier[2 * j + axis]) / dt if known else 0.0
            end_rate[j, axis] = rate[j, axis] + late * acceleration
            mean = rate[j, axis] + 0.5 * late * acceleration
            end_angle[j, axis] = angle[j, axis] + late * mean


@merged
def one_part(model, work, dt, q, u, history, report):
    """
    Advance q, u and history by dt, a step or a part of it, with work.end_angle and work.end_rate.

    Returns
    -------
    int
        1 if there was an event, 0 if not, -1 if the part diverged; then q and u are as before.

    """
    n = len(q)
    memory = history[3:].reshape(history[3:].size)
    notes = memory[26 * n :]
    phase = notes[PHASE]
    h, h_q = formula(phase, dt, q, u, memory, work)
    predicted_frames(h_q, q, memory, phase == SMOOTH, work)
    scale = h / (notes[SPAN] if notes[SPAN] > 0.0 else model.dt)
    for a in range(history.shape[1]):
        for j in range(5):
            history[0, a, j] *= scale
        history[2, a, 0] *= scale

    count, laws = begin(model, work, h, h_q, dt - h_q, history, work.end_angle, work.end_rate)
    small, jumps, closed = solve(model, work, laws, work.contact[:count], h, h_q, history, report)
    if not small:
        return -1
    report[CONTACTS] = closed
    applied_torque(work.R, work.chain.twist, work.torque, work.damping, work.applied)
    for j in range(n - 1):
        for axis in range(2):
            work.applied[j, axis] *= model.dt / h
    if jumps:
        for a in range(history.shape[1]):
            for j in range(5):
                history[2, a, j] = 0.0

    for i in range(n):
        for k in range(7):
            memory[7 * i + k] = q[i, k]
        for k in range(6):
            memory[7 * n + 6 * i + k] = u[i, k]
        advance_link(h_q, work.q_mid, work.q_hat, work.u_star, q, i)
    end_velocities(work.chain.twist, work.R, work.center, u)
    notes[SPAN] = h
    notes[PHASE] = ANEW if jumps or phase == UNKNOWN else SMOOTH
    return 1 if jumps else 0


@merged
def step(model, work, q, u, history, angle, rate, report):
    """Advance q, u and history by one step; return whether to go on."""
    n = len(q)
    memory = history[3:].reshape(history[3:].size)
    notes = memory[26 * n :]
    known, smooth = notes[SPAN] > 0.0, notes[PHASE] == SMOOTH
    parts, event = 1 if smooth else PARTS, notes[PHASE] == UNKNOWN
    unconverged, fallbacks = report[UNCONVERGED], report[FALLBACKS]
    keep(q, u, work.q_start, work.u_start)
    for part in range(PARTS - parts, PARTS):
        end_references(
            model.dt, part + 1, angle, rate, notes[RATE:], known,
            work.end_angle, work.end_rate,
        )  # fmt: skip
        outcome = one_part(model, work, model.dt / parts, q, u, history, report)
        if outcome < 0:
            keep(work.q_start, work.u_start, q, u)
            history[:] = 0.0
            return False
        event = event or outcome > 0
    for j in range(n - 1):
        for axis in range(2):
            notes[RATE + 2 * j + axis] = rate[j, axis]
    if not smooth:
        for i in range(n):
            for k in range(7):
                memory[7 * i + k] = work.q_start[i, k]
            for k in range(6):
                memory[7 * n + 6 * i + k] = work.u_start[i, k]
    notes[PHASE] = ANEW if event else SMOOTH
    report[UNCONVERGED] = min(report[UNCONVERGED], unconverged + 1)  # steps, not parts of them
    report[FALLBACKS] = min(report[FALLBACKS], fallbacks + 1)
    return finish(model, work.chain.twist, q, u, history, report)


@inlined
def keep(q, u, q_to, u_to):
    """Fill q_to and u_to."""
    for i in range(len(q)):
        for k in range(7):
            q_to[i, k] = q[i, k]
        for k in range(6):
            u_to[i, k] = u[i, k]


@compiled
def recognize(model, work, q, u, history):
    """Note in history whether this state is the end of the last step, or one to start from."""
    n = len(q)
    memory = history[3:].reshape(history[3:].size)
    notes = memory[26 * n :]
    same = notes[PHASE] != UNKNOWN
    for i in range(n):
        for k in range(7):
            same = same and memory[13 * n + 7 * i + k] == q[i, k]
        for k in range(6):
            same = same and memory[20 * n + 6 * i + k] == u[i, k]
    if same:
        return
    link_frames(q[:, 3:], work.R)
    rates_in_inertial_frame(work.R, u, work.omega)
    agrees = joint_speed(model.half_length, work.R, u, work.omega) <= AGREE
    notes[PHASE] = ANEW if agrees else UNKNOWN


@compiled
def remember(q, u, history):
    """Keep the end of a step in history."""
    n = len(q)
    memory = history[3:].reshape(history[3:].size)
    for i in range(n):
        for k in range(7):
            memory[13 * n + 7 * i + k] = q[i, k]
        for k in range(6):
            memory[20 * n + 6 * i + k] = u[i, k]


@compiled
def advance(model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `spatial.SpatialStepper`."""
    recognize(model, work, q, u, history)
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        if not step(model, work, q, u, history, angle[k], rate[k], report):
            break
    remember(q, u, history)
    cycles[len(angle)] = cycle_counter()
