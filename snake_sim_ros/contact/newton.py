"""
Newton's method on the contact laws; each linear problem is solved exactly in a sweep over links.

An iteration makes the laws linear about a trial velocity (`linear_laws`) and solves the chain with
them (`linear_problem`). For any number of links this costs about as much as a step without
contacts. The iterates satisfy the dynamics and the joints to rounding. Only the laws are iterated
for, and `natural_map.natural_map` judges them. The methods `newton` and `newton_dense` differ in
how they solve the linear problem.

Far from the solution the method may circle. Then the line between two iterates is searched. If
that fails, the radii of the friction discs are held for a while, which makes the problem convex.
Newton's method with an exact line search solves it from any start, and the radii follow [1]_.

.. [1] V. Acary, B. Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, ch. 13.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.delassus import condense
from snake_sim_ros.contact.delassus import Delassus
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.laws import rolling_disc
from snake_sim_ros.contact.laws import sliding_disc
from snake_sim_ros.contact.line_search import law_error
from snake_sim_ros.contact.line_search import line_search
from snake_sim_ros.contact.line_search import move_trial
from snake_sim_ros.contact.linear_problem import linear_step
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.solver import Outcome
from snake_sim_ros.contact.solver import solve
from snake_sim_ros.contact.table import FREE
from snake_sim_ros.contact.warm_start import predict
from snake_sim_ros.contact.warm_start import remember
from snake_sim_ros.dynamics.articulated_body import factor_chain
from snake_sim_ros.dynamics.articulated_body import reset_chain
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged

COUPLED_ITERATIONS = 6  # iterations before the radii are held for the first time
LATER_COUPLED_ITERATIONS = 4  # iterations between rounds with held radii
MOST_COUPLED_ITERATIONS = 100  # of either, while the residual falls
HELD_ITERATIONS = 30  # iterations with held radii, at most
INEXACT_ROUNDS = 8  # rounds that solve the problem with held radii inexactly
RESTART_ROUNDS = 24  # rounds after which radii restart if links can touch; see restart_radii
MOST_RELAXATION = 64.0  # largest share of a radius step that the radii move by


@inlined
def anchor_at_iterate(laws, closed, contacts):
    """Fill the anchors with the admissible impulses next to the iterate, in scaled components."""
    for a in closed:
        P_N = max(0.0, contacts.iterate[a, 0])
        contacts.anchor[a, 0] = P_N
        anchor_disc(sliding_disc(laws, laws.other, a), contacts, a, P_N)
        anchor_disc(rolling_disc(laws, laws.other, a), contacts, a, P_N)


@inlined
def anchor_disc(disc, contacts, a, radius):
    """Fill the anchor of one kind of friction at contact a, for a disc of given radius [N s]."""
    k = disc.column
    x, y = disc.over_x * contacts.iterate[a, k], disc.over_y * contacts.iterate[a, k + 1]
    square = x * x + y * y
    shrink = 1.0 if square <= radius * radius else radius / math.sqrt(square)
    contacts.anchor[a, k] = disc.mu_x * shrink * x
    contacts.anchor[a, k + 1] = disc.mu_y * shrink * y


@merged
def iterate_coupled(problem, tolerance, limit, delassus, rounds):
    """
    Iterate with disc radii that follow the normal impulses.

    Returns
    -------
    iterations : int
    residual, printed_residual : float
        As `natural_map` returns them [m/s]; infinite if the linear problem has no finite solution.

    """
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
        if rounds + iterations > 1 and residual > 1e3 * tolerance:  # below, rounding decides
            fraction = line_search(laws, closed, contacts)
            if fraction == 0.0:
                break
        move_trial(closed, contacts, fraction)
        anchor_at_iterate(laws, closed, contacts)
        if residual < 0.95 * before and steps < MOST_COUPLED_ITERATIONS:
            steps += 1  # slow, but converging
    return iterations, residual, printed


@merged
def iterate_held(problem, tolerance, limit, delassus):
    """
    Solve the convex problem with held disc radii; return what `iterate_coupled` returns.

    The residuals are those after the last iteration.
    """
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

    Parameters
    ----------
    problem : Problem
    tolerance : float
        Natural-map residual at which the iteration stops [m/s].
    limit : int
        Largest number of iterations.
    delassus : Delassus or None
        See `linear_step`.

    Returns
    -------
    Outcome
        Its `fell_back` is true if the radii were held for a while.

    """
    laws, closed, contacts, chain = problem
    iterations, fell_back = 0, False
    residual = printed = math.inf
    relaxation, before = 1.0, 0.0
    for rounds in range(limit):
        # Leave enough for a round with held radii.
        most = limit - iterations - (HELD_ITERATIONS if rounds > 0 else 0)
        spent, residual, printed = iterate_coupled(problem, tolerance, most, delassus, rounds)
        iterations += spent
        if residual <= tolerance or iterations >= limit:
            break
        for a in closed:  # return to the end of the last round
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
        relaxation, before = next_relaxation(relaxation, along, before, rounds), size
        if chain.pair_delassus is not None:
            restart_radii(rounds, closed, contacts)
        for a in closed:
            contacts.held_radius[a] = max(
                0.0, contacts.held_radius[a] + relaxation * contacts.radius_step[a]
            )
            for j in range(5):
                contacts.saved_trial[a, j] = contacts.trial[a, j]
                contacts.saved_iterate[a, j] = contacts.iterate[a, j]
    return Outcome(iterations, residual <= tolerance, residual, printed, fell_back)


@inlined
def restart_radii(rounds, closed, contacts):
    """
    Hold other radii if the rounds go in a circle: no friction, and later much of it everywhere.

    The rounds have a solution to converge to, but reach it only from some starts. Robots that fold
    onto themselves with friction of 0.6 and more reach it from one of these.
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
    Fill the differences between the normal impulses and the radii that were held for them.

    Of the closed contacts, anchor and held_radius are read, and radius_step is replaced [N s].

    Returns
    -------
    along, size : float
        Product of the new differences with the old ones, and with themselves.

    """
    along = size = 0.0
    for a in closed:
        step = contacts.anchor[a, 0] - contacts.held_radius[a]
        along += step * contacts.radius_step[a]
        size += step * step
        contacts.radius_step[a] = step
    return along, size


@inlined
def next_relaxation(relaxation, along, before, rounds):
    """
    Return the share of `radius_step` by which the radii move next.

    Parameters
    ----------
    relaxation : float
        The share of the last round.
    along : float
        As `find_radius_steps` returns it.
    before : float
        The `size` of the round before.
    rounds : int
        Number of the round, from 0.

    """
    if rounds > 0 and along > 0.5 * before:
        return min(2.0 * relaxation, MOST_RELAXATION)  # slow, in one direction: go further
    if along < 0.0:
        return max(0.5 * min(relaxation, 1.0), 1.0 / MOST_RELAXATION)  # to and fro: go less far
    return relaxation


class Newton(NamedTuple):
    """Newton's method on the chain of links or, with arrays for it, on the Delassus operator."""

    delassus: Delassus | None


@solve.register(Newton)
@inlined
def solve_contacts(solver, model, problem, history):
    """
    Solve the contacts of a step; see `solver.solve`.

    Without a Delassus operator the chain is solved together with the laws. With one, the operator
    is formed first and the problem is solved without the chain.
    """
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
