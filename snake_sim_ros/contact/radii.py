# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How the radii of friction discs follow the loads, where Newton's method holds them for a round.

With held radii the problem is convex and has one solution. Its loads are the radii that should
have been held; what is missing are the steps of the radii. They are zero where the contact laws
hold, a fixed point of the map from radii to loads.

In the first rounds all radii move by one share of their steps, which follows from how these
repeat or turn back. Rounds in which that does not end take turns: mixing finds the moves after
which the steps vanish, by what earlier moves changed, wherever the map is about linear, also
where loads grow by more than the radii; small shares end cycles between contacts that stick and
contacts that slide. Mixing is that of Anderson [1]_, with the moves combined as in [2]_.

.. [1] D. G. Anderson, "Iterative procedures for nonlinear integral equations", J. ACM 12, 1965.
.. [2] T. Washio, C. W. Oosterlee, "Krylov subspace acceleration for nonlinear multigrid schemes",
   Electronic Transactions on Numerical Analysis 6, 1997.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import Contacts, MIXED
from snake_sim_ros.contact.delassus import Delassus
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.parameters import Array

MOST_RELAXATION = 64.0  # largest share of a radius step that the radii move by
# Radius steps go one way if they repeat more than this share of the last ones: the share by which
# the radii move is then doubled. It is halved where they turn back.
REPEATS = 0.5
TURN = 24  # rounds before the first mixing, of each mixing, and of small shares between them
SMALL = 0.1  # largest share between mixings, and share of what mixing does not account for
GROWS = 1.5  # squares of steps that grow by more than this are no longer those of one linear map
DEPENDENT = 1e-8  # of the square of a change: what is left of it below this is mostly rounding
RESTART_ROUNDS = 24  # rounds after which radii restart if links can touch; see `restart`


class Following(NamedTuple):
    """How the radii have followed the loads so far."""

    relaxation: float  # share of the steps by which the radii move without mixing [1]
    size: float  # sum of the squares of the last steps [N² s²]
    mixed: int  # rounds of the present mixing


@inlined
def begin_to_follow() -> Following:
    """Return what `follow_loads` takes after the first round."""
    return Following(1.0, 0.0, 0)


@inlined
def follow_loads(
    rounds: int, last: Following, closed: Array, contacts: Contacts, pairs: Delassus | None
) -> Following:
    """
    Move the radii after a round.

    Parameters
    ----------
    rounds : int
        Number of the round, from 0.
    last : Following
        What the round before returned, or `begin_to_follow`.
    closed, contacts, pairs
        Those of a `problem.Problem`. Of the closed contacts, `anchor` has the loads of the round,
        and held_radius is moved.

    """
    newton = contacts.newton
    along, size = find_radius_steps(closed, contacts)
    relaxation = next_relaxation(last.relaxation, along, last.size, rounds)
    mixed = 0
    if rounds // TURN % 2 == 1:
        mixed = mix(closed, contacts, last.mixed if size < GROWS * last.size else 0)
    else:
        if rounds >= TURN:
            relaxation = min(relaxation, SMALL)
        for a in closed:
            newton.radius_move[a] = relaxation * newton.radius_step[a]
    for a in closed:
        radius = max(0.0, newton.held_radius[a] + newton.radius_move[a])
        newton.radius_move[a] = radius - newton.held_radius[a]
        newton.held_radius[a] = radius
    if restarts(rounds, pairs):
        restart(rounds, closed, contacts)
        mixed = 0
    return Following(relaxation, size, mixed)


@inlined
def find_radius_steps(closed: Array, contacts: Contacts) -> tuple[float, float]:
    """
    Fill the differences between the normal impulses and the radii that were held for them.

    Of the closed contacts, anchor and held_radius are read; radius_step [N s] and its change are
    replaced.

    Returns
    -------
    along, size : float
        Product of the new differences with the old ones, and with themselves.

    """
    newton = contacts.newton
    along = size = 0.0
    for a in closed:
        step = newton.anchor[a, 0] - newton.held_radius[a]
        along += step * newton.radius_step[a]
        size += step * step
        newton.step_change[a] = step - newton.radius_step[a]
        newton.radius_step[a] = step
    return along, size


@inlined
def next_relaxation(relaxation: float, along: float, before: float, rounds: int) -> float:
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
    if rounds > 0 and along > REPEATS * before:
        return min(2.0 * relaxation, MOST_RELAXATION)  # slow, in one direction: go further
    if along < 0.0:
        return max(0.5 * min(relaxation, 1.0), 1.0 / MOST_RELAXATION)  # it oscillates: go less far
    return relaxation


@compiled
def mix(closed: Array, contacts: Contacts, mixed: int) -> int:
    """
    Fill the moves of the radii after which, as far as earlier moves tell, their steps vanish.

    Moves are kept in combinations whose changes of the steps are orthonormal. What the steps have
    along these is undone by the combinations; of the rest, radii move by a small share. No move
    is longer than the radii are.

    Parameters
    ----------
    mixed : int
        Rounds of this mixing so far; with 0 no earlier move is known.

    Returns
    -------
    mixed : int
        That of the next round.

    """
    newton = contacts.newton
    if mixed > 0:
        keep_move(closed, contacts, (mixed - 1) % MIXED, min(mixed - 1, MIXED))
    for a in closed:
        newton.radius_move[a] = SMALL * newton.radius_step[a]
    for k in range(min(mixed, MIXED)):
        share = 0.0
        for a in closed:
            share += newton.radius_step[a] * newton.changes[a, k]
        for a in closed:
            move = newton.moves[a, k] + SMALL * newton.changes[a, k]
            newton.radius_move[a] -= share * move
    length = longest = 0.0
    for a in closed:
        length += newton.radius_move[a] ** 2
        longest += newton.held_radius[a] ** 2
    if length > longest:
        for a in closed:
            newton.radius_move[a] = SMALL * newton.radius_step[a]
    return mixed + 1


@inlined
def keep_move(closed: Array, contacts: Contacts, slot: int, count: int) -> None:
    """Keep the last move as one of `count` others; its change is made orthonormal to theirs."""
    newton = contacts.newton
    all_of_it = rest = 0.0
    for a in closed:
        newton.moves[a, slot] = newton.radius_move[a]
        newton.changes[a, slot] = newton.step_change[a]
        all_of_it += newton.step_change[a] ** 2
    for k in range(count):
        if k != slot:
            share = 0.0
            for a in closed:
                share += newton.changes[a, slot] * newton.changes[a, k]
            for a in closed:
                newton.changes[a, slot] -= share * newton.changes[a, k]
                newton.moves[a, slot] -= share * newton.moves[a, k]
    for a in closed:
        rest += newton.changes[a, slot] ** 2
    scale = 1.0 / math.sqrt(rest) if rest > DEPENDENT * all_of_it else 0.0
    for a in closed:
        newton.changes[a, slot] *= scale
        newton.moves[a, slot] *= scale


@inlined
def restarts(rounds: int, pairs: Delassus | None) -> bool:
    """
    Return whether other radii are held after a round: links may touch, and the rounds cycle.

    The rounds have a solution to converge to, but reach it only from some starts. Robots that fold
    onto themselves with friction of 0.6 and more reach it from one of those of `restart`. Other
    robots have no `pairs`, or none with rows; see `linear_problem.couple_pairs`.
    """
    if pairs is not None:
        return len(pairs.operator) > 0 and (
            rounds == RESTART_ROUNDS or rounds == 2 * RESTART_ROUNDS
        )
    return False


@inlined
def restart(rounds: int, closed: Array, contacts: Contacts) -> None:
    """Hold no friction, and the second time much of it everywhere."""
    newton = contacts.newton
    radius = 0.0
    if rounds > RESTART_ROUNDS:
        for a in closed:
            radius = max(radius, newton.anchor[a, 0])
    for a in closed:
        newton.held_radius[a], newton.radius_step[a] = radius, 0.0
