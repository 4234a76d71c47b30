"""
Newton's method on the contact laws, each linear problem solved exactly in a sweep over the links.

One iteration makes the laws linear about a trial (`linear_laws`) and solves the chain with them:
it costs about as much as a step without contacts, for any number of links. Iterates satisfy the
dynamics and the joints to rounding; only the laws are iterated for, and `contacts.natural_map`
judges them. The methods `newton` and `newton_dense` differ in how they solve the linear problem.

Far from the solution the method may circle. Then the line between two iterates is searched, and if
that fails the radii of the discs are held for a while, which makes the problem convex: Newton's
method with an exact line search solves it from anywhere, and the radii follow [1]_.

.. [1] V. Acary, B. Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, ch. 13.
"""

import math

from snake_sim_ros.contact.contacts import CENTER
from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import natural_map
from snake_sim_ros.contact.contacts import rolling_disc
from snake_sim_ros.contact.contacts import sliding_disc
from snake_sim_ros.contact.delassus import condense
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.linear_laws import ANCHOR
from snake_sim_ros.contact.linear_laws import DISC
from snake_sim_ros.contact.linear_laws import disc_law
from snake_sim_ros.contact.linear_laws import FREE
from snake_sim_ros.contact.linear_laws import HELD
from snake_sim_ros.contact.linear_laws import ITERATE
from snake_sim_ros.contact.linear_laws import linear_step
from snake_sim_ros.contact.linear_laws import normal_law
from snake_sim_ros.contact.linear_laws import NOTED
from snake_sim_ros.contact.linear_laws import SAVED
from snake_sim_ros.contact.linear_laws import STEP
from snake_sim_ros.contact.linear_laws import TRIAL
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import unload_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.stepping.moreau import begin_step
from snake_sim_ros.stepping.moreau import end_step

COUPLED_STEPS = 6  # Newton iterations before the radii are held
COUPLED_STEPS_LATER = 4  # and between rounds
MANY_STEPS = 100  # while the residual falls
HELD_STEPS = 30
PLAIN_ROUNDS = 8  # rounds after which they are solved for more exactly
ROUNDS_ANEW = 24  # rounds after which they begin anew, where links touch links; see begin_anew
MOST_SHARE = 64.0  # of the way that held radii are moved at once


@compiled
def misfit(laws, contact, table, fraction):
    """
    Compare impulses and laws a fraction of the way from TRIAL, ITERATE to GAMMA, IMPULSE.

    Returns
    -------
    slope : float
        ``sum (P - P(gamma)) . (GAMMA - TRIAL)``: for held radii the derivative of a convex
        function along the way.
    residual : float
        Largest ``|P - P(gamma)|/r`` [m/s].

    """
    slope = normal = sliding = rolling = 0.0
    for a in contact:
        step = table[a, GAMMA] - table[a, TRIAL]
        P_N, _ = normal_law(
            laws, table[a, CENTER], table[a, ANCHOR], table[a, TRIAL] + fraction * step
        )
        radius = P_N if table[a, DISC] == FREE else table[a, DISC]
        P = table[a, ITERATE]
        d = P + fraction * (table[a, IMPULSE] - P) - P_N
        normal = max(normal, abs(d))
        slope += d * step
        d, along = disc_gap(sliding_disc(laws, laws.other, a), table, a, radius, fraction)
        sliding = max(sliding, d)
        slope += along
        if laws.rolling.mu_x > 0.0:
            d, along = disc_gap(rolling_disc(laws, laws.other, a), table, a, radius, fraction)
            rolling = max(rolling, d)
            slope += along
    return slope, max(normal / laws.r_N, sliding / laws.r_T, rolling / laws.r_V)


@inlined
def disc_gap(disc, table, a, radius, fraction):
    """Return |P - P(gamma)| of one kind of friction at contact a, and its part of the slope."""
    k = disc.column
    x, y = table[a, TRIAL + k], table[a, TRIAL + k + 1]
    step_x, step_y = table[a, GAMMA + k] - x, table[a, GAMMA + k + 1] - y
    law_x, law_y, _, _, _, _, _ = disc_law(
        disc, table[a, ANCHOR + k], table[a, ANCHOR + k + 1],
        x + fraction * step_x, y + fraction * step_y, radius,
    )  # fmt: skip
    P_x, P_y = table[a, ITERATE + k], table[a, ITERATE + k + 1]
    d_x = P_x + fraction * (table[a, IMPULSE + k] - P_x) - law_x
    d_y = P_y + fraction * (table[a, IMPULSE + k + 1] - P_y) - law_y
    return math.sqrt(d_x * d_x + d_y * d_y), d_x * step_x + d_y * step_y


@inlined
def line_search(laws, contact, table):
    """
    Return the fraction of the way at which the slope has all but vanished: 1 if it is not reached.

    0 means that the way goes up from its start. False position with halved weights (Illinois).
    """
    high, above = 1.0, misfit(laws, contact, table, 1.0)[0]
    if not above > 0.0:
        return 1.0
    low, below = 0.0, misfit(laws, contact, table, 0.0)[0]
    if not below < 0.0:
        return 0.0
    enough = 0.1 * min(-below, above)
    fraction, side = 0.5, 0
    for _ in range(20):
        fraction = low - below * (high - low) / (above - below)
        slope = misfit(laws, contact, table, fraction)[0]
        if abs(slope) <= enough:
            break
        if slope > 0.0:
            high, above = fraction, slope
            below *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, below = fraction, slope
            above *= 0.5 if side < 0 else 1.0
            side = -1
    return fraction


@inlined
def move(contact, table, fraction):
    """Move TRIAL and ITERATE a fraction of the way to GAMMA and IMPULSE."""
    for a in contact:
        for j in range(5):
            trial, P = table[a, TRIAL + j], table[a, ITERATE + j]
            if fraction == 1.0:  # to the last bit
                table[a, TRIAL + j], table[a, ITERATE + j] = (
                    table[a, GAMMA + j],
                    table[a, IMPULSE + j],
                )
            else:
                table[a, TRIAL + j] = trial + fraction * (table[a, GAMMA + j] - trial)
                table[a, ITERATE + j] = P + fraction * (table[a, IMPULSE + j] - P)


@inlined
def anchor_at_iterate(laws, contact, table):
    """Fill ANCHOR with the admissible impulses next to ITERATE, in scaled components."""
    for a in contact:
        P_N = max(0.0, table[a, ITERATE])
        table[a, ANCHOR] = P_N
        anchor_disc(sliding_disc(laws, laws.other, a), table, a, P_N)
        anchor_disc(rolling_disc(laws, laws.other, a), table, a, P_N)


@inlined
def anchor_disc(disc, table, a, radius):
    """Fill ANCHOR of one kind of friction at contact a."""
    k = disc.column
    x, y = disc.over_x * table[a, ITERATE + k], disc.over_y * table[a, ITERATE + k + 1]
    square = x * x + y * y
    shrink = 1.0 if square <= radius * radius else radius / math.sqrt(square)
    table[a, ANCHOR + k] = disc.mu_x * shrink * x
    table[a, ANCHOR + k + 1] = disc.mu_y * shrink * y


@merged
def coupled_steps(laws, tolerance, limit, contact, table, chain, delassus, rounds):
    """Iterate with the radii that the normal impulses have; return iterations and the verdict."""
    for a in contact:
        table[a, DISC] = FREE
    residual = printed = math.inf
    iterations, steps = 0, COUPLED_STEPS if rounds == 0 else COUPLED_STEPS_LATER
    while iterations < min(steps, limit):
        iterations += 1
        before = residual
        if not linear_step(laws, contact, table, chain, delassus):
            return iterations, math.inf, math.inf
        residual, printed = natural_map(laws, contact, table, tolerance)
        if residual <= tolerance:
            break
        fraction = 1.0
        if rounds + iterations > 1 and residual > 1e3 * tolerance:  # below, rounding would decide
            fraction = line_search(laws, contact, table)
            if fraction == 0.0:
                break
        move(contact, table, fraction)
        anchor_at_iterate(laws, contact, table)
        if residual < 0.95 * before and steps < MANY_STEPS:
            steps += 1  # slow, but it gets there
    return iterations, residual, printed


@merged
def held_steps(laws, tolerance, limit, contact, table, chain, delassus):
    """Solve the convex problem with the radii held; return iterations and the verdict."""
    for a in contact:
        table[a, DISC] = table[a, HELD]
    iterations = 0
    while iterations < min(HELD_STEPS, limit):
        iterations += 1
        if not linear_step(laws, contact, table, chain, delassus):
            return iterations, math.inf, math.inf
        fraction = line_search(laws, contact, table)
        move(contact, table, fraction if fraction > 0.0 else 1.0)
        if fraction == 1.0 and misfit(laws, contact, table, 1.0)[1] <= tolerance:
            break
    residual, printed = natural_map(laws, contact, table, tolerance)
    return iterations, residual, printed


@merged
def newton(laws, tolerance, limit, contact, table, chain, delassus):
    """
    Find impulses and twists that satisfy the contact laws, from what `predict` filled.

    Returns
    -------
    iterations : int
    converged : bool
    residual, printed_residual : float
        Verdict of `natural_map` [m/s].
    fell_back : bool
        Whether the radii were held for a while.

    """
    iterations, fell_back = 0, False
    residual = printed = math.inf
    share, before = 1.0, 0.0
    for rounds in range(limit):
        most = limit - iterations - (HELD_STEPS if rounds > 0 else 0)  # with radii held at the end
        spent, residual, printed = coupled_steps(
            laws, tolerance, most, contact, table, chain, delassus, rounds
        )
        iterations += spent
        if residual <= tolerance or iterations >= limit:
            break
        for a in contact:  # back to where the last round ended
            if rounds > 0:
                for j in range(10):
                    table[a, TRIAL + j] = table[a, SAVED + j]
            else:
                table[a, HELD] = max(0.0, table[a, ITERATE])
                table[a, STEP] = 0.0
        anchor_at_iterate(laws, contact, table)
        fell_back = True
        inner = 1e2 * tolerance if rounds < PLAIN_ROUNDS else 0.1 * tolerance
        spent, residual, printed = held_steps(
            laws, inner, limit - iterations, contact, table, chain, delassus
        )
        iterations += spent
        if residual <= tolerance or iterations >= limit or residual == math.inf:
            break
        anchor_at_iterate(laws, contact, table)
        along, size = follow(contact, table)
        share, before = next_share(share, along, before, rounds), size
        if chain.pairs is not None:
            begin_anew(rounds, contact, table)
        for a in contact:
            table[a, HELD] = max(0.0, table[a, HELD] + share * table[a, STEP])
            for j in range(10):
                table[a, SAVED + j] = table[a, TRIAL + j]  # and ITERATE, next to it
    return iterations, residual <= tolerance, residual, printed, fell_back


@inlined
def begin_anew(rounds, contact, table):
    """
    Hold other radii where the rounds go in a circle: no friction at first, then much everywhere.

    The rounds have a solution to go to, but come to it only from some starts. Robots that fold
    onto themselves with friction of 0.6 and more get there by one of these.
    """
    if rounds != ROUNDS_ANEW and rounds != 2 * ROUNDS_ANEW:
        return
    radius = 0.0
    if rounds > ROUNDS_ANEW:
        for a in contact:
            radius = max(radius, table[a, ANCHOR])
    for a in contact:
        table[a, HELD], table[a, STEP] = radius, 0.0


@inlined
def follow(contact, table):
    """
    Fill STEP, how far the radii held are from the normal impulses that came of them.

    Returns
    -------
    along, size : float
        Product of the steps with those before, and with themselves.

    """
    along = size = 0.0
    for a in contact:
        step = table[a, ANCHOR] - table[a, HELD]
        along += step * table[a, STEP]
        size += step * step
        table[a, STEP] = step
    return along, size


@inlined
def next_share(share, along, before, rounds):
    """Return how much of the next step of the radii to take; see `follow`."""
    if rounds > 0 and along > 0.5 * before:
        return min(2.0 * share, MOST_SHARE)  # slow, all in one direction: further
    if along < 0.0:
        return max(0.5 * min(share, 1.0), 1.0 / MOST_SHARE)  # to and fro: less far
    return share


@merged
def predict(laws, contact, table, history):
    """
    Fill TRIAL and ANCHOR from the last step: impulses and velocities go on changing as they did.

    A new contact starts with GAMMA, its velocities before the contacts act, and without impulse.
    """
    for a in contact:
        for j in range(5):
            table[a, ANCHOR + j] = table[a, ITERATE + j] = history[0, a, j]
            table[a, TRIAL + j] = table[a, GAMMA + j]
        P_N = 0.0
        if history[0, a, 0] > 0.0:
            P_N = history[0, a, 0] + history[2, a, 0]
            for k in range(1, 4, 2):
                x, y = history[1, a, k], history[1, a, k + 1]
                next_x, next_y = x + history[2, a, k], y + history[2, a, k + 1]
                ahead = x * next_x + y * next_y > 0.0
                table[a, TRIAL + k] = next_x if ahead else x
                table[a, TRIAL + k + 1] = next_y if ahead else y
        table[a, TRIAL] = -laws.compliance * (max(0.0, P_N) - table[a, CENTER])


@merged
def remember(contact, table, history):
    """Fill history with the impulses, velocities and changes of the closed contacts, 0 if open."""
    for a in contact:
        table[a, NOTED] = 1.0
        now = table[a, IMPULSE] > 0.0
        before = now and history[0, a, 0] > 0.0
        history[2, a, 0] = table[a, IMPULSE] - history[0, a, 0] if before else 0.0
        for j in range(1, 5):
            change = table[a, GAMMA + j] - history[1, a, j]
            history[2, a, j] = change if before else 0.0
        for j in range(5):
            history[0, a, j] = table[a, IMPULSE + j] if now else 0.0
            history[1, a, j] = table[a, GAMMA + j] if now else 0.0
    for a in range(len(table)):
        if table[a, NOTED] == 0.0 and history[0, a, 0] > 0.0:
            history[:3, a] = 0.0
        table[a, NOTED] = 0.0


@inlined
def solve_contacts(model, laws, contact, table, chain, delassus, history):
    """
    Solve the contacts of a step; return what `moreau.end_step` takes.

    Without a Delassus operator (None) the chain is solved with the laws, else G without the chain.
    """
    predict(laws, contact, table, history)
    if delassus is not None:
        unload_chain(chain)
        factor_chain(chain)
        condense(contact, 5 if laws.rolling.mu_x > 0.0 else 3, table, chain, delassus)
    outcome = newton(
        laws, model.residual_tolerance, model.iteration_limit, contact, table, chain, delassus
    )
    if delassus is not None:
        end_twists(contact, table, chain)
    remember(contact, table, history)
    return outcome


@compiled
def advance(delassus, model, work, q, u, history, angle, rate, report, cycles):
    """Advance q, u and history in place by one step a reference; see `spatial.SpatialStepper`."""
    for k in range(len(angle)):
        cycles[k] = cycle_counter()
        count, laws = begin_step(model, work, q, u, history[0], angle[k], rate[k])
        outcome = solve_contacts(
            model, laws, work.contact[:count], work.table, work.chain, delassus, history
        )
        if not end_step(model, work, q, u, history, count, outcome, report):
            break
    cycles[len(angle)] = cycle_counter()
