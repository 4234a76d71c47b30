# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How gaps are closed by a move of the configuration alone.

Contacts that carry load have no gap, but a step leaves one of the size of its error. The twists
that remove it within a time h are the response of the chain to fictitious normal impulses nu,
``G_NN nu = -g/h``. They move the coordinates and change no velocity, so that closing a gap neither
bounces nor drives a link.

What remains is small beside the gap up to which contacts count as closed, `closed_gap`, and both
go to zero with the step: the limit of small steps is a robot on its contacts, whatever the
settings of a method are. Both numbers are needed. The stiff joints of a robot that lies flat turn
a micrometer into tenths of a newton, so that gaps must be closed. And the robot has fewer freedoms
than contacts, so that the gaps of some follow from those of others. If such a contact had to
close a gap that the others do not leave to it, it would carry no load, or that of all others,
however small the gap is.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import Delassus, eliminate
from snake_sim_ros.contact.linear_problem import Operator, solve_linear
from snake_sim_ros.contact.problem import Problem
from snake_sim_ros.contact.shapes import outer, size_of, triple
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.free_chain import unfold_free
from snake_sim_ros.dynamics.joint_drift import turn_link
from snake_sim_ros.scene.chain import JointPlaces
from snake_sim_ros.scene.parameters import Array

# A contact counts as closed up to the way that this acceleration, a fourth of gravity, makes in a
# step [m/s^2].
CLOSED_ACCELERATION = 2.5
LEFT_SHARE = 1 / 16  # share of that gap which closed contacts may keep
ROUNDING = 1e-13  # of a gap [m]
# A step closes no more of a gap than this, nor than this speed closes in it, unless the contact
# came in faster by its own motion. More is not the error of a step: a sphere may have left its
# cell.
MOST_CLOSED = 1e-2  # [m]
CLOSING_SPEED = 1.0  # [m/s]
DEEP = 1e-6  # penetration at the start of a step, beyond its own motion, that is not undone [m]
FAR = 5.0  # gaps: other moves go up to 3.3 times as far, see docs/reliability.md
MOST_RELEASES = 3  # times that such a move is computed anew without contacts that it pulls
MOST_MOVES = 2  # moves of the configuration in a step of the paper that close gaps
GAP_GROWTH = 2.0  # of the largest gap or penetration by such a move, which is else taken back

# The normal directions of a stiff chain may depend on each other. A little compliance, relative to
# the Delassus operator, then leaves the smallest impulses.
COMPLIANCE = 1e-7
NONE = -math.inf  # tolerance of `keep_closed`


def closed_gap(tolerance: float, dt: float) -> float:
    """
    Return the gap up to which a contact counts as closed in a step [m].

    Parameters
    ----------
    tolerance : float
        Its upper bound, `activation_tolerance` of a scene [m]. With 0 contacts close without a
        gap, as the paper prints it, and none are closed by moves.
    dt : float
        Time step [s].

    """
    return min(tolerance, CLOSED_ACCELERATION * dt * dt)


@compiled
def left_gap(closed_gap: float) -> float:
    """Return the gap that a contact may keep at the end of a step [m], at least rounding."""
    return max(LEFT_SHARE * closed_gap, ROUNDING)


@compiled
def most_closed(dt: float) -> float:
    """Return the gap up to which a step of dt [s] closes one [m]."""
    return min(MOST_CLOSED, CLOSING_SPEED * dt)


@inlined
def predict_gaps(closed_gap: float, dt: float, closed: Array, contacts: Contacts) -> None:
    """
    Fill the shifts of contacts that may close in a step of the paper, and add them to gamma_N.

    Deviation: the paper closes a contact once it is inside the floor in the middle of a step. Here
    contacts with a gap take part with ``gamma_N + g/(dt/2) >= 0``, so that they land with none. A
    contact that is deep inside the floor for other reasons than its motion stays where it is.

    Parameters
    ----------
    closed_gap, dt : float
        As of `closed_gap` [m], [s].
    closed, contacts
        Those of a `problem.Problem`, with gaps in the middle of the step and velocities at its
        start; shift, start_gap and approach_velocity are filled.

    """
    geometry, solution = contacts.geometry, contacts.solution
    for a in closed:
        gap, way = geometry.gap[a], 0.5 * dt * solution.gamma[a, 0]
        solution.approach_velocity[a] = solution.gamma[a, 0]
        start = gap - way
        geometry.start_gap[a] = start if start < -2.0 * abs(way) - DEEP else 0.0
        if gap > closed_gap:
            solution.shift[a] = gap / (0.5 * dt)
            solution.gamma[a, 0] += solution.shift[a]


@inlined
def contacts_land(closed: Array, contacts: Contacts) -> bool:
    """Return whether a contact with a gap carries load: it closes in the step."""
    solution, lands = contacts.solution, False
    for a in closed:
        lands = lands or (solution.shift[a] > 0.0 and solution.impulse[a, 0] > 0.0)
    return lands


@inlined
def keep_closed(closed: Array, contacts: Contacts, tolerance: float) -> int:
    """
    Return how many contacts are closed after contacts with gaps have landed.

    Deviation: with the velocity that closes its gap, a contact that lands in the second half of a
    step would have a part of its impact in this step and the rest in the next one. Two impacts
    with friction are not one: the velocity afterwards would depend on when in a step a contact
    lands, however small the step. The coordinates of the end therefore take the velocities that
    close gaps, and the velocities those of a second solution, in which landed contacts are closed.
    Others that can close take no part in it.

    Parameters
    ----------
    closed, contacts
        Those of a `problem.Problem` that is solved. The numbers of closed contacts are moved to
        the front of `closed`, and their shifts set to 0.
    tolerance : float
        Gap at the end up to which a contact without load is closed, too [m]; NONE: no such is.

    """
    solution, count = contacts.solution, 0
    for k in range(len(closed)):
        a = closed[k]
        loaded = solution.impulse[a, 0] > 0.0 or solution.shift[a] == 0.0
        if loaded or solution.end_gap[a] <= tolerance:
            solution.shift[a] = 0.0
            closed[k], closed[count] = closed[count], a
            count += 1
    return count


@inlined
def move_links(twist: Array, center: Array, q: Array) -> None:
    """Move links, coordinates q (n, 7), by small twists (n, 6) about O, for a time of 1."""
    for i in range(len(q)):
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        wx, wy, wz = twist[i, 0], twist[i, 1], twist[i, 2]
        q[i, 0] += twist[i, 3] + wy * z - wz * y
        q[i, 1] += twist[i, 4] + wz * x - wx * z
        q[i, 2] += twist[i, 5] + wx * y - wy * x
        c = 1.0 / math.sqrt(1.0 + 0.25 * (wx * wx + wy * wy + wz * wz))
        turn_link(q, i, c, 0.5 * c * wx, 0.5 * c * wy, 0.5 * c * wz)


@inlined
def gaps_to_close(
    most: float, time: float, closed: Array, contacts: Contacts
) -> tuple[float, float]:
    """
    Mark the contacts whose end gaps must be closed by ``S_N = 1``.

    They carry load and rest, or they are inside an obstacle. Their end gaps become those that are
    to be closed, which begin at `start_gap`. Those up to `most`, that of `most_closed` [m], are
    closed, and those that the approach before the step makes in a time [s].

    Returns
    -------
    to_close : float
        Largest gap of the marked ones [m].
    worst : float
        Largest gap of those that carry load, marked or not [m].

    """
    geometry, solution, newton = contacts.geometry, contacts.solution, contacts.newton
    to_close = worst = 0.0
    for a in closed:
        solution.end_gap[a] -= geometry.start_gap[a]
        gap, is_loaded = abs(solution.end_gap[a]), solution.is_loaded[a] == 1
        way = max(most, -time * solution.approach_velocity[a])
        closes = gap <= way and (solution.end_gap[a] < 0.0 or is_loaded)
        newton.S_N[a] = 1.0 if closes else 0.0
        if closes:
            to_close = max(to_close, gap)
        if is_loaded and gap < math.inf:  # a sphere that left its cell has none
            worst = max(worst, gap)
    return to_close, worst


class Move(NamedTuple):
    """A move of the configuration that closes gaps."""

    places: JointPlaces
    twist: Array  # (n, 6) of the links about O
    center: Array  # (n, 3) of the links, from O [m]
    time: float  # for which the twists move the links [s]
    gap: float  # the largest one that it closes [m]


@inlined
def goes_far(move: Move) -> bool:
    """Return whether ends of links go much farther than the gap."""
    places, twist, far = move.places, move.twist, FAR * move.gap / move.time
    for i in range(len(twist)):
        omega = triple(twist, i)
        turned = outer(omega, triple(move.center, i))
        vx, vy, vz = twist[i, 3] + turned[0], twist[i, 4] + turned[1], twist[i, 5] + turned[2]
        lever = max(size_of(triple(places.distal, i)), size_of(triple(places.proximal, i)))
        if size_of((vx, vy, vz)) + lever * size_of(omega) > far:
            return True
    return False


@inlined
def let_go(closed: Array, contacts: Contacts, pairs: Delassus | None, move: Move) -> bool:
    """
    Unmark the contacts that a move would pull onto an obstacle; return if any are.

    The contacts are those of `close_gaps`. Without load, a penetration is an inequality: such
    contacts open as others close. To close both would take a long way sideways where normals are
    nearly parallel; on a flat floor, where `pairs` is None, all are the same. Contacts with load
    follow the obstacle, unless the move goes far, see `goes_far`: they then keep their gaps.
    """
    if pairs is None:
        return False
    solution, newton, far, found = contacts.solution, contacts.newton, goes_far(move), False
    for a in closed:
        is_marked = newton.S_N[a] > 0.0
        may_open = far or solution.is_loaded[a] == 0
        pulls = is_marked and may_open and solution.impulse[a, 0] < 0.0
        newton.S_N[a] = 1.0 if is_marked and not pulls else 0.0
        found = found or pulls
    return found


@inlined
def close_gaps(operator: Operator, problem: Problem, h: float) -> None:
    """
    Fill the twists of the chain with those that close the end gaps of contacts in a time h [s].

    The contacts are those of the closed ones whose `S_N` is 1 instead of 0. Normal impulses become
    those of the move.

    Parameters
    ----------
    operator : Operator
        As `newton.prepare_contacts` left it.
    problem : Problem
        Momentum and torques of its chain are set to 0, if the contacts are not condensed.
    h : float
        Time for which the twists move the links [s].

    """
    if operator.is_condensed[0]:
        close_condensed(problem.closed, problem.contacts, problem.chain, operator.delassus, h)
    else:
        close_on_links(problem, h)


@inlined
def close_condensed(
    closed: Array, contacts: Contacts, chain: Chain, delassus: Delassus, h: float
) -> None:
    """Do what `close_gaps` does with the Delassus operator."""
    solution, newton = contacts.solution, contacts.newton
    B, G, load, X = delassus.system, delassus.operator, chain.free.end_load, delassus.loads
    depth, middle = delassus.depth, 6 + 2 * ((len(chain.axis) + 1) // 2)
    count = 0
    for a in closed:
        if newton.S_N[a] > 0.0:
            column, row = newton.row[a], 0
            for b in closed:
                if newton.S_N[b] > 0.0:
                    B[row, count] = G[newton.row[b], column]
                    row += 1
            B[count, count] *= 1.0 + COMPLIANCE
            count += 1
    row = 0
    for a in closed:
        if newton.S_N[a] > 0.0:
            B[row, count] = -solution.end_gap[a] / h
            row += 1
    eliminate(B, count)
    for m in range(len(load)):
        load[m] = 0.0
    row = 0
    for a in closed:
        if newton.S_N[a] > 0.0:
            column, solution.impulse[a, 0] = newton.row[a], B[row, count]
            for m in range(6 + 2 * depth[column, 0]):
                load[m] += X[column, m] * B[row, count]
            for m in range(middle, middle + 2 * depth[column, 1]):
                load[m] += X[column, m] * B[row, count]
            row += 1
    unfold_free(chain.free, load, chain.twist)


@compiled
def close_on_links(problem: Problem, h: float) -> None:
    """Do what `close_gaps` does by a sweep over the chain, with stiff linear laws."""
    laws, closed, contacts, chain, _, _ = problem
    solution, newton = contacts.solution, contacts.newton
    for i in range(len(chain.momentum)):
        for k in range(6):
            chain.momentum[i, k] = 0.0
    for j in range(len(chain.torque)):
        chain.torque[j, 0] = chain.torque[j, 1] = 0.0
    for a in closed:
        S_N = newton.S_N[a] / laws.proximal_compliance
        # A sphere that has left its cell has an infinite gap, and nothing to close.
        gap = solution.end_gap[a] if math.isfinite(solution.end_gap[a]) else 0.0
        newton.S_N[a], newton.trial[a, 0] = S_N, 0.0
        newton.law_impulse[a, 0] = -S_N * gap / h
        newton.P_0[a, 0] = newton.law_impulse[a, 0]
        solution.shift[a] = 0.0
        for kind in range(2):
            newton.S_xx[a, kind] = newton.S_xy[a, kind] = newton.S_yy[a, kind] = 0.0
            newton.S_xN[a, kind] = newton.S_yN[a, kind] = 0.0
        for k in range(1, 5):
            newton.P_0[a, k] = newton.law_impulse[a, k] = newton.trial[a, k] = 0.0
    solve_linear(problem, True)
