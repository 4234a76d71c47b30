# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method on the contact laws; each linear problem is solved exactly in a sweep over links.

An iteration makes the laws linear about a trial velocity and solves the chain with them; see
`linear_problem`. For any number of links this costs about as much as a step without contacts. Few
contacts are condensed instead: their Delassus operator is formed once a step
(`delassus.condense`), some sweeps over the contacts improve the prediction, and an iteration
solves a small dense system. The iterates satisfy the dynamics and the joints to rounding. Only the
laws are iterated for, and `laws.natural_map` judges them.

Where joints have laws of their own, an iteration makes these linear, too; see
`dynamics.joint_laws`. Condensed contacts are solved for the linear laws that the joints begin
with. If these do not hold, iterations go on with all contacts on the chain.

Far from the solution the method may cycle. Then the line between two iterates is searched. If that
fails, the radii of the friction discs are held for a while, which makes the problem convex: an
exact line search finds its minimum on the way, so that Newton's method solves it from any start.
The radii follow [1]_, see `radii`. If that takes long, a path leads to the solution, see
`central_path`; where it does not, the radii are held again. All contacts are on the chain then.

When impulses are as accurate as a step needs them, small velocities alone do not show. The
residual of the laws is a velocity. Contacts that share a load in several ways answer to a velocity
v that is left with up to ``v/c``, where c is the small compliance of the selection rule: 1e-9 m/s
may be some percent of a load. Newton's method leaves nothing of the normal laws. What it leaves of
friction that slides is an impulse, and changes loads by less than itself. What it leaves of
friction that sticks are velocities, which count where links hold each other, that is from a few
contacts on. There the method continues until its corrections end, or until rounding ends them.
Where rounding does, the residual alone decides whether the step converged.

.. [1] V. Acary, B. Brogliato, "Numerical Methods for Nonsmooth Dynamical Systems", 2008, ch. 13.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.admissible import (
    anchor_at_iterate,
    keep_best,
    return_best,
    take_admissible,
)
from snake_sim_ros.contact.central_path import begin_path, end_path, follow_path, is_conic
from snake_sim_ros.contact.contacts import CLOSE, Contacts, FREE
from snake_sim_ros.contact.delassus import condense, condensed_twists, make_delassus
from snake_sim_ros.contact.laws import (
    anchored_disc,
    Disc,
    grip,
    impulse_width,
    Laws,
    natural_map,
    rolling_disc,
    rolls,
    selects,
    sliding_disc,
)
from snake_sim_ros.contact.linear_problem import (
    disc_law,
    linear_step,
    list_pairs_last,
    load_chain,
    make_reduced,
    normal_law,
    Operator,
)
from snake_sim_ros.contact.problem import (
    ContactHistory,
    Joints,
    joints_residual,
    LEVER,
    Outcome,
    Problem,
    solve_contacts,
)
from snake_sim_ros.contact.radii import begin_to_follow, follow_loads
from snake_sim_ros.contact.sweeps import improve, predict, remember
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.balance import rates_of_twists
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.joint_laws import (
    anchor_axes,
    axes_error,
    move_axes,
    return_axes,
    save_axes,
)
from snake_sim_ros.scene.parameters import Array, Scene

# Of normal impulses, relative to the largest one of a step. Estimates may be five times off.
LOAD_ACCURACY = 2e-7
USUAL_TOLERANCE = 1e-9  # a larger one relaxes the accuracy of the loads, too [m/s]
# Contacts that stick without holding links against each other. On a flat floor two are as few: no
# friction acts along a normal there, as it does where a link is wedged.
FEW = 1
FEW_ON_FLOOR = 2
# Residuals above so many tolerances are those of an iteration that is far from the solution, where
# the line between two iterates is searched; below, rounding decides.
FAR_RESIDUAL = 1e3
CONVERGES = 0.95  # an iteration that leaves a larger share of the residual does not converge
NEAR = 1e-5  # unless it is below this: then loads creep until a contact begins to slide [m/s]
# A line search ends at this share of the smaller slope of both ends, and after so many points: the
# next iteration goes on from there, for which a better point gains little.
FLAT_SLOPE, MOST_SEARCHED = 0.1, 20
# Where an axis begins to stick, the slope is steep on 1e-4 of the way and less. With such
# laws every other point halves the interval, after some of them.
STEEP, MOST_STEEP = 8, 40
REFINES = 0.9  # an iteration that leaves a larger share of the residual does not refine it
COUPLED_ITERATIONS = 6  # iterations before the radii are held for the first time
SWEEPS = 4  # sweeps over condensed contacts before the first iteration
MORE_SWEEPS = 100  # and when it does not converge
MOST_SWEPT = 2  # how often that is tried
# Residuals at which points of a path are corrected: the first, times the share, the next [m/s].
FIRST_END, NEXT_END = 1e-4, 0.03
LAST_END = 0.3  # residual at which a path ends, over the tolerance
MOST_POINTS = 250  # of a path
CORRECTIONS = 6  # iterations from a point of a path
LATER_COUPLED_ITERATIONS = 4  # iterations between rounds with held radii
# Iterations after which a path leads to the solution; see `central_path`. With laws of joints
# paths are longer, and Newton's method solves more steps in time.
PATIENCE, PATIENCE_WITH_JOINTS = 40, 100
MOST_COUPLED_ITERATIONS = 100  # of either, while the residual falls
HELD_ITERATIONS = 30  # iterations with held radii, at most
# Radii are far from the loads in the first rounds, for which a rough solution is enough. Later the
# steps of the radii must not be errors of the solution: their directions say how far they go.
INEXACT_ROUNDS = 8  # rounds that solve the problem with held radii inexactly
INEXACT, EXACT = 1e2, 0.1  # residuals of these rounds and of later ones, over the tolerance


class Newton(NamedTuple):
    """Newton's method on the Delassus operator or, for more contacts, on the chain of links."""

    operator: Operator | None  # None: always on the chain, and only that is compiled


def make_operator(most: int, scene: Scene) -> Operator:
    """Return the arrays for up to `most` closed contacts of a scene on the Delassus operator."""
    rows = most * (5 if scene.friction.rolling > 0.0 else 3)
    return Operator(
        make_delassus(rows, scene.robot.link_count),
        make_reduced(rows),
        most,
        MOST_SWEPT,
        np.zeros(1, np.int64),
    )


@inlined
def law_error(
    laws: Laws, closed: Array, contacts: Contacts, fraction: float
) -> tuple[float, float]:
    """
    Compare impulses and laws at a fraction of the way from the trial to the solution.

    Velocities are between `trial` and `gamma`, impulses between `iterate` and `impulse`. `laws`,
    `closed` and `contacts` are those of a `problem.Problem`; the fraction is from 0 to 1.

    Returns
    -------
    slope : float
        ``sum (P - P(gamma)) . (gamma - trial)``. For held radii it is the derivative of a convex
        function along the way.
    residual : float
        Largest ``|P - P(gamma)|/r`` [m/s].

    """
    solution, newton = contacts.solution, contacts.newton
    slope = normal = sliding = rolling = 0.0
    for a in closed:
        step = solution.gamma[a, 0] - newton.trial[a, 0]
        P_N, _ = normal_law(
            laws,
            solution.selection_center[a],
            newton.anchor[a, 0],
            newton.trial[a, 0] + fraction * step,
        )
        radius = P_N if newton.disc_radius[a] == FREE else newton.disc_radius[a]
        radius *= grip(laws.other, contacts, a)
        P = newton.iterate[a, 0]
        d = P + fraction * (solution.impulse[a, 0] - P) - P_N
        normal = max(normal, abs(d))
        slope += d * step
        disc = anchored_disc(laws, laws.other, contacts, a)
        d, along = disc_law_error(disc, contacts, a, radius, fraction)
        sliding = max(sliding, d)
        slope += along
        if rolls(laws):
            d, along = disc_law_error(
                rolling_disc(laws, laws.other, a), contacts, a, radius, fraction
            )
            rolling = max(rolling, d)
            slope += along
    return slope, max(normal / laws.r_N, sliding / laws.r_T, rolling / laws.r_V)


@inlined
def disc_law_error(
    disc: Disc, contacts: Contacts, a: int, radius: float, fraction: float
) -> tuple[float, float]:
    """Return |P - P(gamma)| of one kind of friction at contact a, and its part of the slope."""
    solution, newton = contacts.solution, contacts.newton
    k = disc.column
    x, y = newton.trial[a, k], newton.trial[a, k + 1]
    step_x, step_y = solution.gamma[a, k] - x, solution.gamma[a, k + 1] - y
    law_x, law_y, _, _, _, _, _ = disc_law(
        disc, newton.anchor[a, k], newton.anchor[a, k + 1],
        x + fraction * step_x, y + fraction * step_y, radius,
    )  # fmt: skip
    P_x, P_y = newton.iterate[a, k], newton.iterate[a, k + 1]
    d_x = P_x + fraction * (solution.impulse[a, k] - P_x) - law_x
    d_y = P_y + fraction * (solution.impulse[a, k + 1] - P_y) - law_y
    return math.sqrt(d_x * d_x + d_y * d_y), d_x * step_x + d_y * step_y


@inlined
def line_search(laws: Laws, closed: Array, contacts: Contacts, joints: Joints) -> float:
    """
    Return the fraction of the way at which the slope of `law_error` nearly vanishes.

    The slope is that of contacts and joints. The fraction is 1 if it is still negative at the end
    of the way, and 0 if it is not negative at its start. The method is false position with halved
    weights (Illinois).
    """
    high, above = 1.0, slope_at(laws, closed, contacts, joints, 1.0)
    if not above > 0.0:
        return 1.0
    low, below = 0.0, slope_at(laws, closed, contacts, joints, 0.0)
    if not below < 0.0:
        return 0.0
    enough = FLAT_SLOPE * min(-below, above)
    fraction, side = 0.5, 0
    is_steep = joints.take_part
    for searched in range(MOST_STEEP if is_steep else MOST_SEARCHED):
        fraction = low - below * (high - low) / (above - below)
        if is_steep and searched >= STEEP and searched % 2 == 0:
            fraction, side = 0.5 * (low + high), 0
        slope = slope_at(laws, closed, contacts, joints, fraction)
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
def slope_at(
    laws: Laws, closed: Array, contacts: Contacts, joints: Joints, fraction: float
) -> float:
    """Return the slope of `law_error` and `joint_laws.axes_error` at a fraction of the way."""
    return law_error(laws, closed, contacts, fraction)[0] + joints_error(joints, fraction)[0]


@inlined
def joints_error(joints: Joints, fraction: float) -> tuple[float, float]:
    """Return what `joint_laws.axes_error` does, as a velocity; 0 if they take no part."""
    if not joints.take_part:
        return 0.0, 0.0
    loads = joints.torque, joints.damping
    slope, residual = axes_error(joints.laws, joints.axes, loads, fraction)
    return slope, LEVER * residual


@inlined
def move(closed: Array, contacts: Contacts, joints: Joints, fraction: float) -> None:
    """Move trial and iterate of contacts and joints a fraction of the way to the solution."""
    move_trial(closed, contacts, fraction)
    if joints.take_part:
        move_axes(joints.axes, (joints.torque, joints.damping), fraction)


@inlined
def anchor(problem: Problem) -> None:
    """Fill the anchors of contacts and joints with what is admissible next to the iterate."""
    anchor_at_iterate(problem.laws, problem.closed, problem.contacts)
    if problem.joints.take_part:
        anchor_axes(problem.joints.axes)


@inlined
def move_trial(closed: Array, contacts: Contacts, fraction: float) -> None:
    """
    Move trial and iterate of the contacts a fraction of the way to the solution.

    `trial` moves toward `gamma`, `iterate` toward `impulse`. The fraction is from 0 to 1.
    """
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        for j in range(5):
            trial, P = newton.trial[a, j], newton.iterate[a, j]
            if fraction == 1.0:  # exact to the last bit
                newton.trial[a, j], newton.iterate[a, j] = (
                    solution.gamma[a, j],
                    solution.impulse[a, j],
                )
            else:
                newton.trial[a, j] = trial + fraction * (solution.gamma[a, j] - trial)
                newton.iterate[a, j] = P + fraction * (solution.impulse[a, j] - P)


@inlined
def largest_load(closed: Array, contacts: Contacts) -> float:
    """Return the largest normal impulse of the closed contacts [N s]."""
    largest = 0.0
    for a in closed:
        largest = max(largest, contacts.solution.impulse[a, 0])
    return largest


@inlined
def small_load(laws: Laws, closed: Array, contacts: Contacts) -> float:
    """Return what may be wrong of a normal impulse [N s]."""
    share = LOAD_ACCURACY * max(1.0, laws.residual_tolerance / USUAL_TOLERANCE)
    return share * largest_load(closed, contacts)


@inlined
def largest_correction(closed: Array, contacts: Contacts) -> float:
    """Return by how much the last iteration changed a normal impulse, at most [N s]."""
    largest = 0.0
    for a in closed:
        largest = max(
            largest, abs(contacts.solution.impulse[a, 0] - contacts.newton.iterate[a, 0])
        )
    return largest


@inlined
def is_negligible(laws: Laws, closed: Array, contacts: Contacts, residual: float) -> bool:
    """
    Return whether any velocities up to a residual [m/s] leave the loads accurate.

    `laws`, `closed` and `contacts` are those of a `problem.Problem`. Without the selection rule
    the loads are not unique, and any residual is enough.
    """
    if not selects(laws):
        return True
    return residual <= laws.compliance * small_load(laws, closed, contacts)


@compiled
def loads_are_accurate(laws: Laws, closed: Array, contacts: Contacts, residual: float) -> bool:
    """
    Return whether a residual [m/s] that is left of friction alone leaves the loads accurate.

    Iterates of Newton's method satisfy the normal laws to rounding; other parameters are those of
    `is_negligible`.
    """
    if is_negligible(laws, closed, contacts, residual):
        return True
    wrong = small_load(laws, closed, contacts)
    return friction_is_accurate(laws, closed, contacts, residual, wrong)


@compiled
def friction_is_accurate(
    laws: Laws, closed: Array, contacts: Contacts, residual: float, wrong: float
) -> bool:
    """Return whether friction leaves the loads accurate to `wrong` [N s]; see the module."""
    still = laws.compliance * wrong
    most = wrong / residual
    sticking = 0
    for a in closed:
        radius = grip(laws.other, contacts, a) * contacts.solution.impulse[a, 0]
        if radius <= 0.0:
            continue
        v = speed(contacts, a, 1)
        if still < v <= residual:
            sticking += 1
        elif v > residual:
            disc = sliding_disc(laws, laws.other, a, contacts.solution.impulse[a, 1])
            if not turns_little(disc, radius, laws.r_T, v, most):
                return False
        if rolls(laws):
            v = speed(contacts, a, 3)
            if still < v <= residual:
                sticking += 1
            elif v > residual:
                disc = rolling_disc(laws, laws.other, a)
                if not turns_little(disc, radius, laws.r_V, v, most):
                    return False
    return sticking <= (FEW_ON_FLOOR if laws.other is None else FEW)


@inlined
def speed(contacts: Contacts, a: int, k: int) -> float:
    """Return the length of the components k and k+1 of the velocity of contact a [m/s]."""
    return math.sqrt(contacts.solution.gamma[a, k] ** 2 + contacts.solution.gamma[a, k + 1] ** 2)


@inlined
def turns_little(disc: Disc, radius: float, r: float, v: float, most: float) -> bool:
    """
    Return whether a residual leaves little of the impulse of friction that slides at v [m/s].

    A residual e leaves it wrong by ``e (R/v + r)``, R the radius of its disc: its direction is
    that of the velocity. `most` is what may be left of this, over e [kg].
    """
    return max(disc.mu_x, disc.mu_y) * radius + r * v <= most * v


@inlined
def corrections_end(correction: float, before: float, wrong: float) -> bool:
    """
    Return whether the remaining corrections add up to less than `wrong` [N s].

    Those of linear convergence are a geometric series. `correction` is the last one and `before`
    the one before it, infinite if there was none.
    """
    share = min(correction / before, 1.0) if before > 0.0 else 0.0
    return correction <= wrong and share * correction <= (1.0 - share) * wrong


@inlined
def refines(
    laws: Laws,
    closed: Array,
    contacts: Contacts,
    residual: float,
    best: float,
    before: float,
) -> tuple[float, float, bool]:
    """
    Return whether Newton's method continues although its residual is within the tolerance.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `problem.Problem`; `iterate` of the contacts has the impulses before.
    residual : float
        The last residual [m/s].
    best, before : float
        Smallest residual and correction of the loads so far, as returned; infinite at first.

    Returns
    -------
    best, before : float
    goes_on : bool

    """
    if residual > REFINES * best:
        return best, before, False
    if loads_are_accurate(laws, closed, contacts, residual):
        return best, before, False
    correction = largest_correction(closed, contacts)
    wrong = small_load(laws, closed, contacts)
    return residual, correction, not corrections_end(correction, before, wrong)


class Round(NamedTuple):
    """What some iterations are for."""

    kind: int  # COUPLED, CLOSER or HELD
    tolerance: float  # residual at which they end [m/s]
    steps: int  # most iterations, unless the residual falls
    searches: bool  # whether the line is searched from the first iteration on


COUPLED, CLOSER, HELD = range(3)  # kinds of rounds: radii follow; likewise, `close_law`; are held


@compiled
def iterate_laws(
    problem: Problem, limit: int, operator: Operator | None, round: Round
) -> tuple[int, float, float, bool]:
    """
    Iterate with disc radii that are held, which is a convex problem, or that follow the loads.

    Returns
    -------
    iterations : int
    residual, printed_residual : float
        As `natural_map` returns them [m/s]; infinite if the linear problem has no finite solution.
    exact : bool
        Whether the last solution was corrected for rounding, see `linear_step`, and the limit does
        not keep the loads from becoming accurate.

    """
    laws, closed, contacts, _, _, joints = problem
    tolerance, steps, held = round.tolerance, round.steps, round.kind == HELD
    closer, rough = round.kind == CLOSER, round.tolerance > laws.residual_tolerance
    for a in closed:
        contacts.newton.disc_radius[a] = contacts.newton.held_radius[a] if held else FREE
        if closer:
            contacts.newton.disc_radius[a] = CLOSE
    residual = printed = math.inf
    exact = goes_on = False
    best = last = math.inf
    iterations = 0
    while iterations < min(steps, limit):
        iterations += 1
        before = residual
        # Where a robot explodes, rounding alone keeps the velocities far from the last ones.
        finite, exact = linear_step(problem, operator, residual <= tolerance)
        if not finite:
            return iterations, math.inf, math.inf, False
        if not held:
            residual, printed = natural_map(laws, closed, contacts, tolerance)
            residual = max(residual, joints_residual(joints))
            goes_on = False
            if residual <= tolerance and (exact or rough):
                if not rough:
                    best, last, goes_on = refines(laws, closed, contacts, residual, best, last)
                if not goes_on:
                    if closer:
                        move(closed, contacts, joints, 1.0)
                    break
        fraction = 1.0
        is_far = residual > FAR_RESIDUAL * tolerance
        if held or (is_far and (round.searches or iterations > 1) and not closer):
            fraction = line_search(laws, closed, contacts, joints)
        if fraction == 0.0 and not held:
            break
        move(closed, contacts, joints, fraction if fraction > 0.0 else 1.0)
        if held:
            error = math.inf
            if fraction == 1.0 and exact:
                error = law_error(laws, closed, contacts, 1.0)[1]
                error = max(error, joints_error(joints, 1.0)[1])
            if error <= tolerance:
                break
        else:
            anchor(problem)
            converges = residual < CONVERGES * before or residual <= NEAR
            if converges and steps < MOST_COUPLED_ITERATIONS:
                steps += 1  # slow, but converging
    if held:
        residual, printed = natural_map(laws, closed, contacts, tolerance)
        residual = max(residual, joints_residual(joints))
    return iterations, residual, printed, exact and not (goes_on and iterations < steps)


@inlined
def iterate(problem: Problem, limit: int, operator: Operator | None) -> Outcome:
    """
    Find impulses and twists that satisfy the contact laws, from what `predict` filled.

    Parameters
    ----------
    problem : Problem
    limit : int
        Largest number of iterations.
    operator : Operator or None

    Returns
    -------
    Outcome
        Its `fell_back` is true if the radii were held for a while.

    """
    laws, closed, contacts, chain, pairs, joints = problem
    tolerance = laws.residual_tolerance
    iterations, fell_back, held, done, refined = 0, False, False, False, False
    residual = printed = math.inf
    following, least, best = begin_to_follow(), math.inf, math.inf
    swept = attempts_with_sweeps(operator)
    rounds = -swept
    may_follow = is_conic(laws, laws.other)
    patience = PATIENCE_WITH_JOINTS if joints.take_part else PATIENCE
    while iterations < limit:
        steps = COUPLED_ITERATIONS if rounds <= 0 else LATER_COUPLED_ITERATIONS
        round, most = Round(COUPLED, tolerance, steps, rounds > 0), limit - iterations
        if held:
            creeps = residual <= NEAR and residual < CONVERGES * least
            least = min(least, residual)
            begin_held(problem, rounds > 0 and not creeps)
            round = Round(HELD, held_tolerance(rounds, tolerance), HELD_ITERATIONS, True)
            fell_back = True
        elif rounds > 0:
            most -= HELD_ITERATIONS  # leave enough for a round with held radii
            if most < 0:
                break  # the impulses of the last round take energy and leave no penetration
        elif swept > 0:
            sweeps = SWEEPS if rounds == -swept else MORE_SWEEPS
            sweep_contacts(laws, closed, contacts, operator, sweeps)
        takes = joints.take_part and is_on_chain(operator)
        part = Joints(takes, joints.laws, joints.axes, joints.torque, joints.damping)
        spent, residual, printed, exact = iterate_laws(
            Problem(laws, closed, contacts, chain, pairs, part), most, operator, round
        )
        iterations += spent
        done = residual <= tolerance and exact
        if done and held and not refined:
            refined = True  # once, with radii that follow
            done = loads_are_accurate(laws, closed, contacts, residual)
        if done and leaves_joints(problem, operator):
            done, held, swept, rounds, best = False, False, 0, 0, math.inf
            continue
        if done or (held and residual == math.inf):
            break
        best = keep_best(closed, contacts, residual, best)
        if held:
            anchor(problem)
            following = follow_loads(rounds, following, closed, contacts, pairs)
            keep_round(problem)
        if held or rounds < 0:
            held = False
            rounds += 1
            continue
        held = True
        if may_follow and patience <= iterations < limit - 2 * HELD_ITERATIONS:
            may_follow = False
            keep_on_chain(operator)
            spent, residual, printed, done = solve_on_path(
                problem, min(MOST_POINTS, limit - iterations - HELD_ITERATIONS), operator
            )
            iterations += spent
            if done:
                break
            best = keep_best(closed, contacts, residual, best)
    if best < residual and not done:
        return_best(closed, contacts)
    return Outcome(iterations, done, residual, printed, fell_back)


@compiled
def solve_on_path(
    problem: Problem, limit: int, operator: Operator | None
) -> tuple[int, float, float, bool]:
    """
    Follow the path of `central_path` to the laws, and correct its end; all contacts on the chain.

    Returns
    -------
    iterations : int
    residual, printed_residual : float
        As `natural_map` returns them [m/s].
    done : bool
        Whether the laws hold.

    """
    laws, closed, contacts, _, _, _ = problem
    tolerance, newton, solution = laws.residual_tolerance, contacts.newton, contacts.solution
    point, iterations, enough, residual = begin_path(problem), 0, FIRST_END, 0.0
    while residual <= enough and iterations < limit - CORRECTIONS:
        enough = max(LAST_END * tolerance, NEXT_END * enough)
        most = limit - CORRECTIONS - iterations
        point, count, residual = follow_path(problem, point, most, enough)
        iterations += count
        if residual > enough:
            break
        for a in closed:
            for j in range(5):
                newton.trial[a, j] = solution.gamma[a, j]
                newton.iterate[a, j] = solution.impulse[a, j]
        anchor(problem)
        spent, at_end, printed, exact = iterate_laws(
            problem, CORRECTIONS, operator, Round(CLOSER, tolerance, CORRECTIONS, False)
        )
        iterations += spent
        if at_end <= tolerance and exact:
            return iterations, at_end, printed, True
        if enough <= tolerance:
            break
    residual, printed = end_path(problem)
    return iterations, residual, printed, residual <= tolerance


@inlined
def held_tolerance(rounds: int, tolerance: float) -> float:
    """Return how well a round solves the problem with held radii, for a `tolerance` [m/s]."""
    return (INEXACT if rounds < INEXACT_ROUNDS else EXACT) * tolerance


@inlined
def keep_round(problem: Problem) -> None:
    """Keep the end of a round with held radii, from which the next one of this kind begins."""
    newton = problem.contacts.newton
    for a in problem.closed:
        for j in range(5):
            newton.saved_trial[a, j] = newton.trial[a, j]
            newton.saved_iterate[a, j] = newton.iterate[a, j]
    save_axes(problem.joints.axes)


@inlined
def begin_held(problem: Problem, returns: bool) -> None:
    """
    Return to the end of the last round or, otherwise, hold the present radii; fill the anchors.

    Where loads creep toward the solution, the present ones are nearer to it than that round.
    """
    newton = problem.contacts.newton
    for a in problem.closed:
        if returns:
            for j in range(5):
                newton.trial[a, j] = newton.saved_trial[a, j]
                newton.iterate[a, j] = newton.saved_iterate[a, j]
        else:
            newton.held_radius[a] = max(0.0, newton.iterate[a, 0])
            newton.radius_step[a] = 0.0
    if returns:
        return_axes(problem.joints.axes)
    anchor(problem)


@solve_contacts.register(Newton)
@inlined
def solve_with_newton(
    solver: Newton, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """Solve the contacts of a step; see `problem.solve_contacts`."""
    prepare_contacts(solver.operator, problem)
    return solve_prepared(solver.operator, problem, history, limit)


@inlined
def prepare_contacts(operator: Operator | None, problem: Problem) -> None:
    """
    Condense the contacts, if they are few, for any number of calls of `solve_prepared`.

    The closed contacts of these calls may be some of those here, and may have other shifts.
    """
    laws, closed, contacts, chain, pairs, joints = problem
    list_pairs_last(closed, contacts, pairs)
    if operator is not None:
        operator.is_condensed[0] = 1 if len(closed) <= operator.most else 0
        if operator.is_condensed[0] and joints.take_part:
            load_chain(joints, chain)
        if operator.is_condensed[0]:
            condense(closed, impulse_width(laws), contacts, chain, operator.delassus)


@compiled
def condense_anew(operator: Operator, problem: Problem) -> None:
    """Condense other contacts of the same step, if they are few; see `prepare_contacts`."""
    prepare_contacts(operator, problem)


@inlined
def solve_prepared(
    operator: Operator | None, problem: Problem, history: ContactHistory, limit: int
) -> Outcome:
    """Solve contacts after `prepare_contacts`; see `problem.solve_contacts`."""
    laws, closed, contacts, chain, _, _ = problem
    predict(laws, closed, contacts, history)
    outcome = iterate(problem, limit, operator)
    fill_twists(laws, closed, contacts, chain, operator)
    if not outcome.converged:
        outcome = admissible_outcome(problem, outcome)
    remember(closed, contacts, history)
    return outcome


@compiled
def admissible_outcome(problem: Problem, outcome: Outcome) -> Outcome:
    """Take admissible impulses; return the outcome with what they leave of all laws."""
    laws, _, _, chain, _, joints = problem
    residual, printed = take_admissible(problem)
    if joints.take_part:
        rates_of_twists(chain, joints.axes.rate)
        residual = max(residual, joints_residual(joints))
    converged = residual <= laws.residual_tolerance
    return Outcome(outcome.iterations, converged, residual, printed, outcome.fell_back)


# Numba leaves out branches on None in functions of which `operator` is an argument of its own.


@inlined
def is_on_chain(operator: Operator | None) -> bool:
    """Return whether the contacts of this step are not condensed."""
    if operator is not None:
        return operator.is_condensed[0] == 0
    return True


@inlined
def keep_on_chain(operator: Operator | None) -> None:
    """Condense the contacts of this step no longer."""
    if operator is not None:
        operator.is_condensed[0] = 0


@inlined
def leaves_joints(problem: Problem, operator: Operator | None) -> bool:
    """
    Return whether the laws of the joints do not hold with contacts that were condensed.

    Then these are not condensed any more, and the laws are linear about the solution.
    """
    laws, closed, contacts, chain, _, joints = problem
    if operator is not None:
        if operator.is_condensed[0] and joints.take_part:
            fill_twists(laws, closed, contacts, chain, operator)
            rates_of_twists(chain, joints.axes.rate)
            if joints_residual(joints) > laws.residual_tolerance:
                keep_on_chain(operator)
                move_axes(joints.axes, (joints.torque, joints.damping), 1.0)
                anchor_axes(joints.axes)
                return True
    return False


@inlined
def attempts_with_sweeps(operator: Operator | None) -> int:
    """Return how often sweeps over the contacts are tried in this step."""
    if operator is not None and operator.is_condensed[0] > 0:
        return operator.swept
    return 0


@inlined
def sweep_contacts(
    laws: Laws, closed: Array, contacts: Contacts, operator: Operator | None, sweeps: int
) -> None:
    """Do some sweeps over the contacts of the operator; see `sweeps.improve`."""
    if operator is not None:
        improve(laws, closed, contacts, operator.delassus, sweeps)


@inlined
def fill_twists(
    laws: Laws, closed: Array, contacts: Contacts, chain: Chain, operator: Operator | None
) -> None:
    """Fill the twists of the links that impulses found on the operator cause."""
    if operator is not None:
        if operator.is_condensed[0]:
            condensed_twists(closed, impulse_width(laws), contacts, chain, operator.delassus)
