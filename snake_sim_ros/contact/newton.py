# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method on the contact laws; each linear problem is solved exactly in a sweep over links.

An iteration makes the laws linear about a trial velocity (`linear_laws`) and solves the chain with
them (`linear_problem`). For any number of links this costs about as much as a step without
contacts. Few contacts are condensed instead: their Delassus operator is formed once a step
(`condensing`), some sweeps over the contacts improve the prediction, and an iteration solves a
small dense system (`reduced_problem`). The iterates satisfy the dynamics and the joints to
rounding. Only the laws are iterated
for, and `natural_map.natural_map` judges them. The methods `newton` and `newton_dense` differ in
how they solve the linear problem.

Far from the solution the method may circle. Then the line between two iterates is searched. If
that fails, the radii of the friction discs are held for a while, which makes the problem convex.
Newton's method with an exact line search solves it from any start, and the radii follow [1]_.

.. [1] V. Acary, B. Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, ch. 13.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.admissible import anchor_at_iterate, without_gain
from snake_sim_ros.contact.condensing import condense
from snake_sim_ros.contact.delassus import condensed_twists, Delassus, make_delassus
from snake_sim_ros.contact.line_search import law_error, line_search, move_trial
from snake_sim_ros.contact.linear_problem import linear_step, list_pairs_last
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.reduced_problem import make_reduced, Reduced
from snake_sim_ros.contact.settling import loads_are_accurate, refines
from snake_sim_ros.contact.solver import Outcome, solve
from snake_sim_ros.contact.table import FREE
from snake_sim_ros.contact.warm_start import improve, predict, remember
from snake_sim_ros.dynamics.compilation import compiled, inlined, merged
from snake_sim_ros.scene.parameters import Array

COUPLED_ITERATIONS = 6  # iterations before the radii are held for the first time
SWEEPS = 4  # sweeps over condensed contacts before the first iteration
MORE_SWEEPS = 100  # and when it does not converge
MOST_SWEPT = 2  # how often that is tried
LATER_COUPLED_ITERATIONS = 4  # iterations between rounds with held radii
MOST_COUPLED_ITERATIONS = 100  # of either, while the residual falls
HELD_ITERATIONS = 30  # iterations with held radii, at most
INEXACT_ROUNDS = 8  # rounds that solve the problem with held radii inexactly
RESTART_ROUNDS = 24  # rounds after which radii restart if links can touch; see restart_radii
MOST_RELAXATION = 64.0  # largest share of a radius step that the radii move by


@merged
def iterate_laws(problem, tolerance, limit, operator, rounds, held):
    """
    Iterate with disc radii that are held, which is a convex problem, or that follow the loads.

    One function does both, because `linear_step` is compiled wherever it is called.

    Returns
    -------
    iterations : int
    residual, printed_residual : float
        As `natural_map` returns them [m/s]; infinite if the linear problem has no finite solution.
    exact : bool
        Whether the last solution was corrected for rounding, see `linear_step`, and the limit does
        not keep the loads from becoming accurate.

    """
    laws, closed, contacts, _ = problem
    for a in closed:
        contacts.disc_radius[a] = contacts.held_radius[a] if held else FREE
    residual = printed = math.inf
    exact = goes_on = False
    best = last = math.inf
    iterations, steps = 0, COUPLED_ITERATIONS if rounds <= 0 else LATER_COUPLED_ITERATIONS
    if held:
        steps = HELD_ITERATIONS
    while iterations < min(steps, limit):
        iterations += 1
        before = residual
        # Where a robot explodes, rounding alone keeps the velocities far from the last ones.
        finite, exact = linear_step(problem, operator, residual <= tolerance)
        if not finite:
            return iterations, math.inf, math.inf, False
        if not held:
            residual, printed = natural_map(laws, closed, contacts, tolerance)
            goes_on = False
            if residual <= tolerance and exact:
                best, last, goes_on = refines(
                    laws, closed, contacts, residual, tolerance, best, last
                )
                if not goes_on:
                    break
        fraction = 1.0
        is_far = residual > 1e3 * tolerance  # below, rounding decides
        if held or (is_far and (rounds > 0 or iterations > 1)):
            fraction = line_search(laws, closed, contacts)
        if fraction == 0.0 and not held:
            break
        move_trial(closed, contacts, fraction if fraction > 0.0 else 1.0)
        if held:
            error = law_error(laws, closed, contacts, 1.0)[1] if exact else math.inf
            if fraction == 1.0 and error <= tolerance:
                break
        else:
            anchor_at_iterate(laws, closed, contacts)
            if residual < 0.95 * before and steps < MOST_COUPLED_ITERATIONS:
                steps += 1  # slow, but converging
    if held:
        residual, printed = natural_map(laws, closed, contacts, tolerance)
    return iterations, residual, printed, exact and not (goes_on and iterations < steps)


@merged
def iterate(problem, tolerance, limit, operator):
    """
    Find impulses and twists that satisfy the contact laws, from what `predict` filled.

    Parameters
    ----------
    problem : Problem
    tolerance : float
        Natural-map residual at which the iteration stops [m/s].
    limit : int
        Largest number of iterations.
    operator : Operator or None

    Returns
    -------
    Outcome
        Its `fell_back` is true if the radii were held for a while.

    """
    laws, closed, contacts, chain = problem
    iterations, fell_back, held, done, refined = 0, False, False, False, False
    residual = printed = math.inf
    relaxation, before = 1.0, 0.0
    swept = attempts_with_sweeps(operator)
    rounds = -swept
    while iterations < limit:
        inner, most = tolerance, limit - iterations
        if held:
            begin_held(rounds, closed, contacts)
            anchor_at_iterate(laws, closed, contacts)
            inner = 1e2 * tolerance if rounds < INEXACT_ROUNDS else 0.1 * tolerance
            fell_back = True
        elif rounds > 0:
            most -= HELD_ITERATIONS  # leave enough for a round with held radii
            if most < 0:
                break  # the impulses of the last round take energy and leave no penetration
        elif swept > 0:
            sweeps = SWEEPS if rounds == -swept else MORE_SWEEPS
            sweep_contacts(laws, closed, contacts, operator, sweeps)
        spent, residual, printed, exact = iterate_laws(
            problem, inner, most, operator, rounds, held
        )
        iterations += spent
        done = residual <= tolerance and exact
        if done and held and not refined:
            refined = True  # once, with radii that follow
            done = loads_are_accurate(laws, closed, contacts, residual, tolerance)
        if done or (held and residual == math.inf):
            break
        if held:
            anchor_at_iterate(laws, closed, contacts)
            along, size = find_radius_steps(closed, contacts)
            relaxation, before = next_relaxation(relaxation, along, before, rounds), size
            restart_radii(rounds, closed, contacts, chain.pair_delassus)
            end_held(relaxation, closed, contacts)
        if held or rounds < 0:
            held = False
            rounds += 1
        else:
            held = True
    return Outcome(iterations, done, residual, printed, fell_back)


@inlined
def end_held(relaxation, closed, contacts):
    """Move the radii that are held by a share of their steps, and keep the end of the round."""
    for a in closed:
        contacts.held_radius[a] = max(
            0.0, contacts.held_radius[a] + relaxation * contacts.radius_step[a]
        )
        for j in range(5):
            contacts.saved_trial[a, j] = contacts.trial[a, j]
            contacts.saved_iterate[a, j] = contacts.iterate[a, j]


@inlined
def begin_held(rounds, closed, contacts):
    """Return to the end of the last round or, before the first one, hold the radii of now."""
    for a in closed:
        if rounds > 0:
            for j in range(5):
                contacts.trial[a, j] = contacts.saved_trial[a, j]
                contacts.iterate[a, j] = contacts.saved_iterate[a, j]
        else:
            contacts.held_radius[a] = max(0.0, contacts.iterate[a, 0])
            contacts.radius_step[a] = 0.0


@inlined
def restart_radii(rounds, closed, contacts, pairs):
    """
    Hold other radii if the rounds go in a circle: no friction, and later much of it everywhere.

    The rounds have a solution to converge to, but reach it only from some starts. Robots that fold
    onto themselves with friction of 0.6 and more reach it from one of these. Other robots have no
    `pairs`, or none with rows; see `linear_problem.couple_pairs`.
    """
    if pairs is None or len(pairs.operator) == 0:
        return
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


class Operator(NamedTuple):
    """The Delassus operator of few contacts, and arrays for linear problems on it."""

    delassus: Delassus
    reduced: Reduced
    most: int  # largest number of contacts that are condensed
    swept: int  # how often sweeps over the contacts are tried
    is_condensed: Array  # (1,) 1 if the contacts of this step are


class Newton(NamedTuple):
    """Newton's method on the Delassus operator or, for more contacts, on the chain of links."""

    operator: Operator | None  # None: always on the chain, and only that is compiled


def make_operator(most: int, width: int, links: int, swept: int = MOST_SWEPT) -> Operator:
    """
    Return the arrays for contacts on the Delassus operator.

    Parameters
    ----------
    most : int
        Largest number of closed contacts for which the Delassus operator is formed.
    width : int
        Components of a contact: 3, or 5 with rolling friction.
    links : int
        Number of links.
    swept : int
        How often sweeps over the contacts are tried. Where more contacts stick than hold a robot,
        they leave impulses of friction that press its links against each other.

    """
    return Operator(
        make_delassus(width * most, links),
        make_reduced(width * most),
        most,
        swept,
        np.zeros(1, np.int64),
    )


@solve.register(Newton)
@inlined
def solve_contacts(solver, model, problem, history, limit):
    """Solve the contacts of a step; see `solver.solve`."""
    prepare_contacts(solver.operator, problem)
    return solve_prepared(solver.operator, model, problem, history, limit)


@inlined
def prepare_contacts(operator, problem):
    """
    Condense the contacts, if they are few, for any number of calls of `solve_prepared`.

    The closed contacts of these calls may be some of those here, and may have other shifts.
    """
    laws, closed, contacts, chain = problem
    list_pairs_last(closed, contacts, chain.pair_delassus)
    if operator is not None:
        operator.is_condensed[0] = 1 if len(closed) <= operator.most else 0
        if operator.is_condensed[0]:
            width = 5 if laws.rolling.mu_x > 0.0 else 3
            condense(closed, width, contacts, chain, operator.delassus)


@compiled
def condense_anew(operator, problem):
    """Condense other contacts of the same step, if they are few; see `prepare_contacts`."""
    prepare_contacts(operator, problem)


@merged
def solve_prepared(operator, model, problem, history, limit):
    """Solve contacts after `prepare_contacts`; see `solver.solve`."""
    laws, closed, contacts, chain = problem
    predict(laws, closed, contacts, history)
    outcome = iterate(problem, model.residual_tolerance, limit, operator)
    fill_twists(laws, closed, contacts, chain, operator)
    outcome = without_gain(problem, outcome)
    remember(closed, contacts, history)
    return outcome


# Numba leaves out branches on None in functions of which `operator` is an argument of its own.


@inlined
def attempts_with_sweeps(operator):
    """Return how often sweeps over the contacts are tried in this step."""
    if operator is not None and operator.is_condensed[0] > 0:
        return operator.swept
    return 0


@inlined
def sweep_contacts(laws, closed, contacts, operator, sweeps):
    """Do some sweeps over the contacts of the operator; see `warm_start.improve`."""
    if operator is not None:
        improve(laws, closed, contacts, operator.delassus, sweeps)


@inlined
def fill_twists(laws, closed, contacts, chain, operator):
    """Fill the twists of the links that impulses found on the operator cause."""
    if operator is not None:
        if operator.is_condensed[0]:
            width = 5 if laws.rolling.mu_x > 0.0 else 3
            condensed_twists(closed, width, contacts, chain, operator.delassus)
