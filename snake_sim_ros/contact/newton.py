"""
Newton's method on the contact laws, each linear problem solved exactly in a sweep over the links.

One iteration makes the laws linear about a trial (`linear_laws`) and solves the chain with them:
it costs about as much as a step without contacts, for any number of links. Iterates satisfy the
dynamics and the joints to rounding; only the laws are iterated for, and `natural_map.natural_map`
judges them. The methods `newton` and `newton_dense` differ in how they solve the linear problem.

Far from the solution the method may circle. Then the line between two iterates is searched, and if
that fails the radii of the discs are held for a while, which makes the problem convex: Newton's
method with an exact line search solves it from anywhere, and the radii follow [1]_.

.. [1] V. Acary, B. Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, ch. 13.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.delassus import condense
from snake_sim_ros.contact.delassus import Delassus
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.laws import rolling_disc
from snake_sim_ros.contact.laws import sliding_disc
from snake_sim_ros.contact.linear_laws import disc_law
from snake_sim_ros.contact.linear_laws import linear_step
from snake_sim_ros.contact.linear_laws import normal_law
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.solver import Outcome
from snake_sim_ros.contact.solver import solve
from snake_sim_ros.contact.table import FREE
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import reset_chain
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged

COUPLED_ITERATIONS = 6  # Newton iterations before the radii are held
LATER_COUPLED_ITERATIONS = 4  # and between rounds
MOST_COUPLED_ITERATIONS = 100  # while the residual falls
HELD_ITERATIONS = 30
INEXACT_ROUNDS = 8  # rounds after which they are solved for more exactly
RESTART_ROUNDS = 24  # rounds after which they begin anew, where links touch links; see begin_anew
MOST_RELAXATION = 64.0  # of the way that held radii are moved at once


@compiled
def law_error(laws, closed, contacts, fraction):
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
    for a in closed:
        step = contacts.gamma[a, 0] - contacts.trial[a, 0]
        P_N, _ = normal_law(
            laws,
            contacts.selection_center[a],
            contacts.anchor[a, 0],
            contacts.trial[a, 0] + fraction * step,
        )
        radius = P_N if contacts.disc_radius[a] == FREE else contacts.disc_radius[a]
        P = contacts.iterate[a, 0]
        d = P + fraction * (contacts.impulse[a, 0] - P) - P_N
        normal = max(normal, abs(d))
        slope += d * step
        d, along = disc_law_error(sliding_disc(laws, laws.other, a), contacts, a, radius, fraction)
        sliding = max(sliding, d)
        slope += along
        if laws.rolling.mu_x > 0.0:
            d, along = disc_law_error(
                rolling_disc(laws, laws.other, a), contacts, a, radius, fraction
            )
            rolling = max(rolling, d)
            slope += along
    return slope, max(normal / laws.r_N, sliding / laws.r_T, rolling / laws.r_V)


@inlined
def disc_law_error(disc, contacts, a, radius, fraction):
    """Return |P - P(gamma)| of one kind of friction at contact a, and its part of the slope."""
    k = disc.column
    x, y = contacts.trial[a, k], contacts.trial[a, k + 1]
    step_x, step_y = contacts.gamma[a, k] - x, contacts.gamma[a, k + 1] - y
    law_x, law_y, _, _, _, _, _ = disc_law(
        disc, contacts.anchor[a, k], contacts.anchor[a, k + 1],
        x + fraction * step_x, y + fraction * step_y, radius,
    )  # fmt: skip
    P_x, P_y = contacts.iterate[a, k], contacts.iterate[a, k + 1]
    d_x = P_x + fraction * (contacts.impulse[a, k] - P_x) - law_x
    d_y = P_y + fraction * (contacts.impulse[a, k + 1] - P_y) - law_y
    return math.sqrt(d_x * d_x + d_y * d_y), d_x * step_x + d_y * step_y


@inlined
def line_search(laws, closed, contacts):
    """
    Return the fraction of the way at which the slope has all but vanished: 1 if it is not reached.

    0 means that the way goes up from its start. False position with halved weights (Illinois).
    """
    high, above = 1.0, law_error(laws, closed, contacts, 1.0)[0]
    if not above > 0.0:
        return 1.0
    low, below = 0.0, law_error(laws, closed, contacts, 0.0)[0]
    if not below < 0.0:
        return 0.0
    enough = 0.1 * min(-below, above)
    fraction, side = 0.5, 0
    for _ in range(20):
        fraction = low - below * (high - low) / (above - below)
        slope = law_error(laws, closed, contacts, fraction)[0]
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
def move_trial(closed, contacts, fraction):
    """Move TRIAL and ITERATE a fraction of the way to GAMMA and IMPULSE."""
    for a in closed:
        for j in range(5):
            trial, P = contacts.trial[a, j], contacts.iterate[a, j]
            if fraction == 1.0:  # to the last bit
                contacts.trial[a, j], contacts.iterate[a, j] = (
                    contacts.gamma[a, j],
                    contacts.impulse[a, j],
                )
            else:
                contacts.trial[a, j] = trial + fraction * (contacts.gamma[a, j] - trial)
                contacts.iterate[a, j] = P + fraction * (contacts.impulse[a, j] - P)


@inlined
def anchor_at_iterate(laws, closed, contacts):
    """Fill ANCHOR with the admissible impulses next to ITERATE, in scaled components."""
    for a in closed:
        P_N = max(0.0, contacts.iterate[a, 0])
        contacts.anchor[a, 0] = P_N
        anchor_disc(sliding_disc(laws, laws.other, a), contacts, a, P_N)
        anchor_disc(rolling_disc(laws, laws.other, a), contacts, a, P_N)


@inlined
def anchor_disc(disc, contacts, a, radius):
    """Fill ANCHOR of one kind of friction at contact a."""
    k = disc.column
    x, y = disc.over_x * contacts.iterate[a, k], disc.over_y * contacts.iterate[a, k + 1]
    square = x * x + y * y
    shrink = 1.0 if square <= radius * radius else radius / math.sqrt(square)
    contacts.anchor[a, k] = disc.mu_x * shrink * x
    contacts.anchor[a, k + 1] = disc.mu_y * shrink * y


@merged
def iterate_coupled(problem, tolerance, limit, delassus, rounds):
    """Iterate with the radii that the normal impulses have; return iterations and the verdict."""
    laws, closed, contacts, _ = problem
    for a in closed:
        contacts.disc_radius[a] = FREE
    residual = printed = math.inf
    iterations, steps = 0, COUPLED_ITERATIONS if rounds == 0 else LATER_COUPLED_ITERATIONS
    while iterations < min(steps, limit):
        iterations += 1
        before = residual
        if not linear_step(problem, delassus):
            return iterations, math.inf, math.inf
        residual, printed = natural_map(laws, closed, contacts, tolerance)
        if residual <= tolerance:
            break
        fraction = 1.0
        if rounds + iterations > 1 and residual > 1e3 * tolerance:  # below, rounding would decide
            fraction = line_search(laws, closed, contacts)
            if fraction == 0.0:
                break
        move_trial(closed, contacts, fraction)
        anchor_at_iterate(laws, closed, contacts)
        if residual < 0.95 * before and steps < MOST_COUPLED_ITERATIONS:
            steps += 1  # slow, but it gets there
    return iterations, residual, printed


@merged
def iterate_held(problem, tolerance, limit, delassus):
    """Solve the convex problem with the radii held; return iterations and the verdict."""
    laws, closed, contacts, _ = problem
    for a in closed:
        contacts.disc_radius[a] = contacts.held_radius[a]
    iterations = 0
    while iterations < min(HELD_ITERATIONS, limit):
        iterations += 1
        if not linear_step(problem, delassus):
            return iterations, math.inf, math.inf
        fraction = line_search(laws, closed, contacts)
        move_trial(closed, contacts, fraction if fraction > 0.0 else 1.0)
        if fraction == 1.0 and law_error(laws, closed, contacts, 1.0)[1] <= tolerance:
            break
    residual, printed = natural_map(laws, closed, contacts, tolerance)
    return iterations, residual, printed


@merged
def iterate(problem, tolerance, limit, delassus):
    """
    Find impulses and twists that satisfy the contact laws, from what `predict` filled.

    Returns
    -------
    Outcome
        It fell back if the radii were held for a while.

    """
    laws, closed, contacts, chain = problem
    iterations, fell_back = 0, False
    residual = printed = math.inf
    share, before = 1.0, 0.0
    for rounds in range(limit):
        most = (
            limit - iterations - (HELD_ITERATIONS if rounds > 0 else 0)
        )  # with radii held at the end
        spent, residual, printed = iterate_coupled(problem, tolerance, most, delassus, rounds)
        iterations += spent
        if residual <= tolerance or iterations >= limit:
            break
        for a in closed:  # back to where the last round ended
            if rounds > 0:
                for j in range(5):
                    contacts.trial[a, j] = contacts.saved_trial[a, j]
                    contacts.iterate[a, j] = contacts.saved_iterate[a, j]
            else:
                contacts.held_radius[a] = max(0.0, contacts.iterate[a, 0])
                contacts.radius_step[a] = 0.0
        anchor_at_iterate(laws, closed, contacts)
        fell_back = True
        inner = 1e2 * tolerance if rounds < INEXACT_ROUNDS else 0.1 * tolerance
        spent, residual, printed = iterate_held(problem, inner, limit - iterations, delassus)
        iterations += spent
        if residual <= tolerance or iterations >= limit or residual == math.inf:
            break
        anchor_at_iterate(laws, closed, contacts)
        along, size = find_radius_steps(closed, contacts)
        share, before = next_relaxation(share, along, before, rounds), size
        if chain.pair_delassus is not None:
            restart_radii(rounds, closed, contacts)
        for a in closed:
            contacts.held_radius[a] = max(
                0.0, contacts.held_radius[a] + share * contacts.radius_step[a]
            )
            for j in range(5):
                contacts.saved_trial[a, j] = contacts.trial[a, j]
                contacts.saved_iterate[a, j] = contacts.iterate[a, j]
    return Outcome(iterations, residual <= tolerance, residual, printed, fell_back)


@inlined
def restart_radii(rounds, closed, contacts):
    """
    Hold other radii where the rounds go in a circle: no friction at first, then much everywhere.

    The rounds have a solution to go to, but come to it only from some starts. Robots that fold
    onto themselves with friction of 0.6 and more get there by one of these.
    """
    if rounds != RESTART_ROUNDS and rounds != 2 * RESTART_ROUNDS:
        return
    radius = 0.0
    if rounds > RESTART_ROUNDS:
        for a in closed:
            radius = max(radius, contacts.anchor[a, 0])
    for a in closed:
        contacts.held_radius[a], contacts.radius_step[a] = radius, 0.0


@inlined
def find_radius_steps(closed, contacts):
    """
    Fill STEP, how far the radii held are from the normal impulses that came of them.

    Returns
    -------
    along, size : float
        Product of the steps with those before, and with themselves.

    """
    along = size = 0.0
    for a in closed:
        step = contacts.anchor[a, 0] - contacts.held_radius[a]
        along += step * contacts.radius_step[a]
        size += step * step
        contacts.radius_step[a] = step
    return along, size


@inlined
def next_relaxation(share, along, before, rounds):
    """Return how much of the next step of the radii to take; see `find_radius_steps`."""
    if rounds > 0 and along > 0.5 * before:
        return min(2.0 * share, MOST_RELAXATION)  # slow, all in one direction: further
    if along < 0.0:
        return max(0.5 * min(share, 1.0), 1.0 / MOST_RELAXATION)  # to and fro: less far
    return share


@merged
def predict(laws, closed, contacts, history):
    """
    Fill TRIAL and ANCHOR from the last step: impulses and velocities go on changing as they did.

    A new contact starts with GAMMA, its velocities before the contacts act, and without impulse.
    """
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        for j in range(5):
            contacts.anchor[a, j] = contacts.iterate[a, j] = last[a, j]
            contacts.trial[a, j] = contacts.gamma[a, j]
        P_N = 0.0
        if last[a, 0] > 0.0:
            P_N = last[a, 0] + change[a, 0]
            for k in range(1, 4, 2):
                x, y = velocity[a, k], velocity[a, k + 1]
                next_x, next_y = x + change[a, k], y + change[a, k + 1]
                ahead = x * next_x + y * next_y > 0.0
                contacts.trial[a, k] = next_x if ahead else x
                contacts.trial[a, k + 1] = next_y if ahead else y
        contacts.trial[a, 0] = -laws.compliance * (max(0.0, P_N) - contacts.selection_center[a])


@merged
def remember(closed, contacts, history):
    """Fill history with the impulses, velocities and changes of the closed contacts, 0 if open."""
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        contacts.is_closed[a] = 1
        now = contacts.impulse[a, 0] > 0.0
        before = now and last[a, 0] > 0.0
        change[a, 0] = contacts.impulse[a, 0] - last[a, 0] if before else 0.0
        for j in range(1, 5):
            difference = contacts.gamma[a, j] - velocity[a, j]
            change[a, j] = difference if before else 0.0
        for j in range(5):
            last[a, j] = contacts.impulse[a, j] if now else 0.0
            velocity[a, j] = contacts.gamma[a, j] if now else 0.0
    for a in range(len(contacts)):
        if contacts.is_closed[a] == 0 and last[a, 0] > 0.0:
            for j in range(5):
                last[a, j] = velocity[a, j] = change[a, j] = 0.0
        contacts.is_closed[a] = 0


class Newton(NamedTuple):
    """Newton's method, on the chain of links or, with its arrays, on the Delassus operator."""

    delassus: Delassus | None


@solve.register(Newton)
@inlined
def solve_contacts(solver, model, problem, history):
    """Solve the contacts of a step; see `solver.solve`."""
    laws, closed, contacts, _ = problem
    predict(laws, closed, contacts, history)
    begin_condensed(problem, solver.delassus)
    outcome = iterate(problem, model.residual_tolerance, model.iteration_limit, solver.delassus)
    end_condensed(problem, solver.delassus)
    remember(closed, contacts, history)
    return outcome


@inlined
def begin_condensed(problem, delassus):
    """Form the Delassus operator, if there is one."""
    laws, closed, contacts, chain = problem
    if delassus is not None:
        reset_chain(chain)
        factor_chain(chain)
        condense(closed, 5 if laws.rolling.mu_x > 0.0 else 3, contacts, chain, delassus)


@inlined
def end_condensed(problem, delassus):
    """Fill the twists of the chain, if the impulses come from a Delassus operator."""
    _, closed, contacts, chain = problem
    if delassus is not None:
        end_twists(closed, contacts, chain)
