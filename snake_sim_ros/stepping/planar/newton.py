"""
Newton's method on the friction laws of a robot that lies flat; loads follow.

With the loads given, friction is a convex problem: its laws, linear about a trial (`linear_laws`),
join the inertia of the links, and one sweep over the chain solves them. The loads follow from the
friction, and friction from the loads: both are iterated for together, the loads one step behind.
That converges where friction shifts loads by less than itself, as it does under long robots; a
short or nearly straight one may tip or roll first, and its step then does not converge.
`contacts.natural_map` judges the result as that of any other solver.
"""

import math

from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import HEADING
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import LAW
from snake_sim_ros.contact.contacts import LINK
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.contacts import POINT
from snake_sim_ros.contact.contacts import sliding_disc
from snake_sim_ros.contact.delassus import solve_condensed
from snake_sim_ros.contact.linear_laws import ANCHOR
from snake_sim_ros.contact.linear_laws import DISC
from snake_sim_ros.contact.linear_laws import disc_law
from snake_sim_ros.contact.linear_laws import FORCE
from snake_sim_ros.contact.linear_laws import HELD
from snake_sim_ros.contact.linear_laws import ITERATE
from snake_sim_ros.contact.linear_laws import linearize_disc
from snake_sim_ros.contact.linear_laws import normal_law
from snake_sim_ros.contact.linear_laws import NOTED
from snake_sim_ros.contact.linear_laws import SLIDING
from snake_sim_ros.contact.linear_laws import STEP
from snake_sim_ros.contact.linear_laws import TRIAL
from snake_sim_ros.contact.newton import anchor_disc
from snake_sim_ros.contact.newton import follow
from snake_sim_ros.contact.newton import line_search
from snake_sim_ros.contact.newton import misfit
from snake_sim_ros.contact.newton import move
from snake_sim_ros.contact.newton import next_share
from snake_sim_ros.contact.newton import PLAIN_ROUNDS
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.hinge_chain import factor_hinges
from snake_sim_ros.dynamics.hinge_chain import solve_hinges
from snake_sim_ros.stepping.planar.equilibrium import condense
from snake_sim_ros.stepping.planar.equilibrium import contact_velocities
from snake_sim_ros.stepping.planar.equilibrium import end_twists
from snake_sim_ros.stepping.planar.equilibrium import factor_bare
from snake_sim_ros.stepping.planar.equilibrium import find_loads
from snake_sim_ros.stepping.planar.moreau import begin_step
from snake_sim_ros.stepping.planar.moreau import end_step
from snake_sim_ros.stepping.planar.pegs import peg_velocities

# Where history keeps the change of the change of a load: in the plane nothing rolls.
BEND = 3
COUPLED_STEPS = 4  # iterations before the radii are held
MANY_STEPS = 20  # while the residual falls
HELD_STEPS = 30
STUCK = 0.1  # share of the tolerance at which a contact is still while radii are sought


@inlined
def predict(contact, table, history):
    """Fill radii, TRIAL and ANCHOR from the last step: what changed goes on to change."""
    for a in contact:
        P_N = history[0, a, 0]
        table[a, DISC] = max(0.0, P_N + history[2, a, 0] + history[2, a, BEND])
        for k in range(3):
            table[a, ANCHOR + k] = history[0, a, k]
        x, y = history[1, a, 1], history[1, a, 2]
        next_x, next_y = x + history[2, a, 1], y + history[2, a, 2]
        ahead = x * next_x + y * next_y > 0.0
        x, y = (next_x, next_y) if ahead else (x, y)
        known = P_N > 0.0
        table[a, TRIAL] = 0.0 if known else table[a, GAMMA]
        table[a, TRIAL + 1] = x if known else table[a, GAMMA + 1]
        table[a, TRIAL + 2] = y if known else table[a, GAMMA + 2]


@merged
def remember(contact, table, history):
    """Fill history with impulses, velocities and their changes, 0 if open."""
    for a in contact:
        table[a, NOTED] = 1.0
        P_N = table[a, IMPULSE]
        before = history[0, a, 0] > 0.0
        change = P_N - history[0, a, 0] if before else 0.0
        history[2, a, BEND] = change - history[2, a, 0] if before else 0.0
        history[2, a, 0] = change
        history[0, a, 0] = P_N
        for k in range(1, 3):
            gamma = table[a, GAMMA + k]
            history[2, a, k] = gamma - history[1, a, k] if before else 0.0
            history[1, a, k] = gamma
            history[0, a, k] = table[a, IMPULSE + k]
    for a in range(len(table) if len(table) > len(contact) else 0):
        if table[a, NOTED] == 0.0 and history[0, a, 0] > 0.0:
            history[:3, a] = 0.0
        table[a, NOTED] = 0.0


@inlined
def sliding_law(disc, table, a, again):
    """
    Fill the law of sliding at contact a, linear about TRIAL, with the radius held.

    Returns
    -------
    P_x, P_y : float
        At no velocity or, `again`, at TRIAL [N s].
    S_xx, S_xy, S_yy : float
        What a velocity takes off it [kg].

    """
    x, y = table[a, TRIAL + 1], table[a, TRIAL + 2]
    P_x, P_y, S_xx, S_xy, S_yy, _, _ = disc_law(
        disc, table[a, ANCHOR + 1], table[a, ANCHOR + 2], x, y, table[a, DISC]
    )
    table[a, FORCE + 1], table[a, FORCE + 2] = P_x, P_y
    table[a, SLIDING + 2], table[a, SLIDING + 3], table[a, SLIDING + 4] = S_xx, S_xy, S_yy
    if not again:
        P_x, P_y = P_x + S_xx * x + S_xy * y, P_y + S_xy * x + S_yy * y
    return P_x, P_y, S_xx, S_xy, S_yy


@merged
def add_laws(model, work, again):
    """
    Fill wrenches and inertias of the links with their loads and the laws linear about TRIAL.

    `again` means for the change from the last twists, not for the twists themselves: what rounding
    left of the balance is then part of the load.
    """
    disc, table, chain, n = model.laws.sliding, work.table, work.chain, len(work.heading)
    for i in range(n):
        offset = model.offset[i]
        P_x, P_y, S_xx, S_xy, S_yy = sliding_law(disc, table, i, again)
        Q_x, Q_y, T_xx, T_xy, T_yy = sliding_law(disc, table, n + i, again)
        # Along and across the link, at its center, and turning.
        along, across, moment = P_x + Q_x, P_y + Q_y, offset * (P_y - Q_y)
        S_aa, S_ac, S_cc = S_xx + T_xx, S_xy + T_xy, S_yy + T_yy
        S_aw, S_cw = offset * (S_xy - T_xy), offset * (S_yy - T_yy)
        S_ww = offset * offset * S_cc
        # In axes of I, and about O.
        c, s = work.heading[i, 0], work.heading[i, 1]
        x, y = work.center[i, 0], work.center[i, 1]
        px, py = c * along - s * across, s * along + c * across
        xx = c * c * S_aa - 2.0 * c * s * S_ac + s * s * S_cc
        xy = c * s * (S_aa - S_cc) + (c * c - s * s) * S_ac
        yy = s * s * S_aa + 2.0 * c * s * S_ac + c * c * S_cc
        xw, yw = c * S_aw - s * S_cw, s * S_aw + c * S_cw
        A, bare = chain.inertia[i], work.bare[i]
        a_x, a_y = xw - y * xx + x * xy, yw - y * xy + x * yy
        A[0] = bare[0] + S_ww + (x * yw - y * xw) + (x * a_y - y * a_x)
        A[1], A[2] = bare[1] + a_x, bare[2] + a_y
        A[3], A[4], A[5] = bare[3] + xx, bare[4] + xy, bare[5] + yy
        w0 = work.momentum[i, 0] + moment + x * py - y * px
        w1, w2 = work.momentum[i, 1] + px, work.momentum[i, 2] + py
        if again:
            v0, v1, v2 = work.twist[i, 0], work.twist[i, 1], work.twist[i, 2]
            w0 -= bare[0] * v0 + bare[1] * v1 + bare[2] * v2
            w1 -= bare[1] * v0 + bare[3] * v1 + bare[4] * v2
            w2 -= bare[2] * v0 + bare[4] * v1 + bare[5] * v2
        chain.wrench[i, 0], chain.wrench[i, 1], chain.wrench[i, 2] = w0, w1, w2


@merged
def add_peg_laws(model, work, contact, again):
    """Add the laws of contacts with pegs, as `add_laws` does."""
    laws, table, chain = model.laws, work.table, work.chain
    for a in contact:
        P_N, S_N = normal_law(laws, 0.0, table[a, ANCHOR], table[a, TRIAL])
        table[a, FORCE], table[a, LAW + 1] = P_N, S_N
        table[a, LAW] = P_N + S_N * table[a, TRIAL]
        linearize_disc(sliding_disc(laws, laws.other, a), table, a, table[a, DISC], 0.0)
        normal = table[a, FORCE] if again else table[a, LAW]
        along = table[a, FORCE + 1] if again else table[a, SLIDING]
        S_T = table[a, SLIDING + 2]
        t_x, t_y = table[a, HEADING], table[a, HEADING + 1]
        x, y = table[a, POINT], table[a, POINT + 1]
        n_x, n_y = t_y, -t_x
        px, py = normal * n_x + along * t_x, normal * n_y + along * t_y
        xx, yy = S_N * n_x * n_x + S_T * t_x * t_x, S_N * n_y * n_y + S_T * t_y * t_y
        xy = S_N * n_x * n_y + S_T * t_x * t_y
        a_x, a_y = x * xy - y * xx, x * yy - y * xy
        i = int(table[a, LINK])
        A, w = chain.inertia[i], chain.wrench[i]
        A[0] += x * a_y - y * a_x
        A[1] += a_x
        A[2] += a_y
        A[3] += xx
        A[4] += xy
        A[5] += yy
        w[0] += x * py - y * px
        w[1] += px
        w[2] += py


@inlined
def linear_step(model, work, contact, delassus, again):
    """
    Fill GAMMA, IMPULSE and the twists with the solution for the laws linear about TRIAL.

    Without a Delassus operator (None) the chain is solved with the laws, else G without the chain.
    """
    table, chain, n = work.table, work.chain, len(work.heading)
    if delassus is not None:
        for a in contact:
            linearize_disc(model.laws.sliding, table, a, table[a, DISC], 0.0)
            table[a, LAW], table[a, LAW + 1] = table[a, IMPULSE], 0.0
        solve_condensed(contact, 3, table, LAW, delassus)
        return
    pegs = contact[2 * n :]
    add_laws(model, work, again)
    add_peg_laws(model, work, pegs, again)
    factor_hinges(chain)
    for j in range(n - 1):
        left = chain.damping[j] * (work.twist[j + 1, 0] - work.twist[j, 0])
        chain.load[j] = work.torque[j] - left if again else work.torque[j]
    solve_hinges(chain, chain.load)
    for i in range(n):
        for k in range(3):
            v = chain.twist[i, k]
            work.twist[i, k] = work.twist[i, k] + v if again else v
    contact_velocities(model, work)
    peg_velocities(pegs, work)
    for a in pegs:
        slower = table[a, TRIAL] - table[a, GAMMA]
        table[a, IMPULSE] = table[a, FORCE] + table[a, LAW + 1] * slower
    for a in contact:
        d_x = table[a, GAMMA + 1] - table[a, TRIAL + 1]
        d_y = table[a, GAMMA + 2] - table[a, TRIAL + 2]
        S_xx, S_xy, S_yy = table[a, SLIDING + 2], table[a, SLIDING + 3], table[a, SLIDING + 4]
        table[a, IMPULSE + 1] = table[a, FORCE + 1] - S_xx * d_x - S_xy * d_y
        table[a, IMPULSE + 2] = table[a, FORCE + 2] - S_xy * d_x - S_yy * d_y


@merged
def coupled_steps(model, work, contact, delassus, limit):
    """Iterate with the loads of the last iterate; return iterations and the residual."""
    laws, table = model.laws, work.table
    residual, iterations, steps = math.inf, 0, COUPLED_STEPS
    while iterations < min(steps, limit):
        before = residual
        linear_step(model, work, contact, delassus, iterations > 0)
        find_loads(model, work)
        residual, _ = natural_map(laws, contact, table, model.residual_tolerance)
        iterations += 1
        if residual <= model.residual_tolerance or not math.isfinite(residual):
            break
        if residual < 0.5 * before and steps < MANY_STEPS:
            steps += 1
        for a in contact:
            table[a, DISC] = max(0.0, table[a, IMPULSE])
        move(contact, table, 1.0)
        anchor_what_moves(laws, contact, table, STUCK * model.residual_tolerance)
    return iterations, residual


@compiled
def held_steps(model, work, contact, delassus, tolerance, again, limit):
    """Solve the convex problem with the radii and anchors held; return iterations."""
    laws, table = model.laws, work.table
    for a in contact:  # no part of the line search
        table[a, IMPULSE] = table[a, ITERATE] = table[a, ANCHOR]
    iterations = 0
    while iterations < min(HELD_STEPS, limit):
        linear_step(model, work, contact, delassus, again or iterations > 0)
        iterations += 1
        fraction = line_search(laws, contact, table) if again or iterations > 1 else 1.0
        if fraction == 0.0:
            fraction = 1.0
        for i in range(len(work.twist)):
            for k in range(3):
                work.twist[i, k] -= (1.0 - fraction) * work.chain.twist[i, k]
        move(contact, table, fraction)
        if fraction == 1.0 and misfit(laws, contact, table, 1.0)[1] <= tolerance:
            break
    return iterations


@inlined
def anchor_what_moves(laws, contact, table, still):
    """
    Fill ANCHOR as `anchor_at_iterate`, but not the friction of contacts that are still [m/s].

    How stuck contacts share a load is not unique: rounding, which leaves them a velocity, would
    shift it a little in every round, and the loads with it.
    """
    for a in contact:
        P_N = max(0.0, table[a, ITERATE])
        table[a, ANCHOR] = P_N
        x, y = table[a, GAMMA + 1], table[a, GAMMA + 2]
        if x * x + y * y > still * still:
            anchor_disc(sliding_disc(laws, laws.other, a), table, a, P_N)


@inlined
def solve_contacts(model, work, contact, delassus, history):
    """
    Solve the contacts of a step; return what `moreau.end_step` takes.

    Without a Delassus operator (None) the chain is solved with the laws, else G without the chain.
    """
    laws, table, limit = model.laws, work.table, model.iteration_limit
    predict(contact, table, history)
    if delassus is not None:
        factor_bare(work)
        condense(model, work, delassus)
    iterations, residual = coupled_steps(model, work, contact, delassus, limit)
    rounds, share, before = 0, 1.0, 0.0
    while residual > model.residual_tolerance and iterations < limit:
        if rounds == 0:
            predict(contact, table, history)
            for a in contact:
                table[a, HELD], table[a, STEP] = table[a, DISC], 0.0
        for a in contact:
            table[a, DISC] = table[a, HELD]
        inner = (1e2 if rounds < PLAIN_ROUNDS else 0.1) * model.residual_tolerance
        iterations += held_steps(
            model, work, contact, delassus, inner, rounds > 0, limit - iterations
        )
        find_loads(model, work)
        residual, _ = natural_map(laws, contact, table, model.residual_tolerance)
        move(contact, table, 1.0)
        anchor_what_moves(laws, contact, table, STUCK * model.residual_tolerance)
        along, size = follow(contact, table)
        share, before = next_share(share, along, before, rounds), size
        for a in contact:
            table[a, HELD] = max(0.0, table[a, HELD] + share * table[a, STEP])
        rounds += 1
    if delassus is not None:
        end_twists(model, work)
        find_loads(model, work)
    remember(contact, table, history)
    return iterations, residual <= model.residual_tolerance, residual, residual, rounds > 0


@compiled
def advance(delassus, model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `planar_stepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count = begin_step(model, work, q, u, angle[k], rate[k])
        contact = work.contact[:count]
        outcome = solve_contacts(model, work, contact, delassus, history)
        if not end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()
