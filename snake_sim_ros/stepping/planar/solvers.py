# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contact solvers of a robot that lies flat, with loads that follow from friction.

**Newton's method**, as in `contact.newton`, with the laws of the yaw joints. For given loads,
friction is a convex problem: its laws, linear about a trial velocity (`contact.linear_problem`),
join the inertia of the links, and one sweep over the chain solves them. Loads follow from friction
and friction from loads. Both are iterated together, the loads one iteration behind. This converges
if friction shifts loads by less than itself, as under long robots. A short or nearly straight
robot may tip or roll first, and its step then does not converge. `laws.natural_map` judges the
result, as for any other solver. A step starts from the history of the last one, as in
`contact.sweeps`.

**Projections** of all contacts at once: the paper's iteration, as in `contact.prox_iteration`.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.admissible import anchor_disc
from snake_sim_ros.contact.contacts import Contacts, SLIDING, stiffness
from snake_sim_ros.contact.laws import (
    anchored_disc,
    changes_side,
    floor_disc,
    grip,
    Laws,
    natural_map,
    prox_half_line,
    sliding_bound,
    sliding_disc,
)
from snake_sim_ros.contact.linear_problem import disc_law, linearize_disc, normal_law
from snake_sim_ros.contact.newton import held_tolerance, joints_error, law_error, line_search, move
from snake_sim_ros.contact.problem import ContactHistory, Joints, joints_residual, Outcome, Solver
from snake_sim_ros.contact.prox_iteration import copy_impulses, prox_sliding
from snake_sim_ros.contact.radii import begin_to_follow, follow_loads
from snake_sim_ros.contact.sweeps import forget_others, next_velocity
from snake_sim_ros.dynamics.compilation import compiled, Dispatched, inlined
from snake_sim_ros.dynamics.hinge_chain import factor_hinges, solve_hinges
from snake_sim_ros.dynamics.joint_laws import anchor_axes, linearize_axes
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.planar.equilibrium import (
    add_peg_law,
    factor_bare,
    find_loads,
    in_axes_of_I,
    peg_velocities,
    planar_contact_velocities,
    planar_twists,
)
from snake_sim_ros.stepping.planar.model import PlanarModel, PlanarWorkspace

# Component of `change` in history for the change of the change of a load: nothing rolls here.
SECOND_CHANGE = 3
COUPLED_ITERATIONS = 4  # iterations before the radii are held
MOST_COUPLED_ITERATIONS = 20  # of these, while the residual falls
HELD_ITERATIONS = 30  # iterations with held radii, at most
CONVERGES = 0.5  # an iteration that leaves a larger share of the residual does not converge
NEAR = 4.0  # a bound up to so many tolerances is near: the residual itself may be within
SLIDING_SHARE = 0.98  # share of the square of the radius beyond which friction slides
STILL_SHARE = 0.1  # share of the tolerance up to which the velocity of a contact counts as zero


@Dispatched
def solve_in_plane(  # type: ignore[empty-body]
    solver: Solver,
    model: PlanarModel,
    work: PlanarWorkspace,
    closed: Array,
    history: ContactHistory,
    limit: int,
) -> Outcome:
    """
    Solve the contacts of a step in the plane with the method of the type of `solver`.

    This is `contact.problem.solve_contacts` for the plane, where the normal loads follow from the
    friction: a method fills impulses and velocities in `work.contacts`, and `work.twist`; see
    `equilibrium`.

    Parameters
    ----------
    solver : NamedTuple
    model : PlanarModel
    work : PlanarWorkspace
    closed : ndarray, shape (k,)
        Numbers of the closed contacts.
    history : ContactHistory
        That of the last step; it is replaced by that of this step.
    limit : int
        Most iterations that it may take, at least 1.

    Returns
    -------
    Outcome

    """


@inlined
def predict_sliding(closed: Array, contacts: Contacts, history: ContactHistory) -> None:
    """Fill disc radii, trial and anchor: loads and velocities continue to change as they did."""
    solution, newton = contacts.solution, contacts.newton
    last, change = history.impulse, history.change
    for a in closed:
        P_N = last[a, 0]
        newton.disc_radius[a] = max(0.0, P_N + change[a, 0] + change[a, SECOND_CHANGE])
        for k in range(3):
            newton.anchor[a, k] = last[a, k]
        x, y = next_velocity(history, a, 1)
        known = P_N > 0.0
        newton.trial[a, 0] = 0.0 if known else solution.gamma[a, 0]
        newton.trial[a, 1] = x if known else solution.gamma[a, 1]
        newton.trial[a, 2] = y if known else solution.gamma[a, 2]


@inlined
def remember_sliding(closed: Array, contacts: Contacts, history: ContactHistory) -> None:
    """Fill the history with impulses, velocities and changes, 0 for open contacts."""
    solution = contacts.solution
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        P_N = solution.impulse[a, 0]
        before = last[a, 0] > 0.0
        difference = P_N - last[a, 0] if before else 0.0
        change[a, SECOND_CHANGE] = difference - change[a, 0] if before else 0.0
        change[a, 0] = difference
        last[a, 0] = P_N
        for k in range(1, 3):
            gamma = solution.gamma[a, k]
            change[a, k] = gamma - velocity[a, k] if before else 0.0
            velocity[a, k] = gamma
            last[a, k] = solution.impulse[a, k]
    forget_others(closed, contacts, history)


@inlined
def sliding_law(
    laws: Laws, contacts: Contacts, a: int, again: bool
) -> tuple[float, float, float, float, float]:
    """
    Fill the law of sliding at contact a, linear about the trial velocity, with a held radius.

    Returns
    -------
    P_x, P_y : float
        Impulses at zero velocity or, `again`, at the trial velocity [N s].
    S_xx, S_xy, S_yy : float
        Decrease of the impulses per velocity [kg].

    """
    newton = contacts.newton
    x, y = newton.trial[a, 1], newton.trial[a, 2]
    disc = anchored_disc(laws, laws.other, contacts, a)
    radius = grip(laws.other, contacts, a) * newton.disc_radius[a]
    P_x, P_y, S_xx, S_xy, S_yy, _, _ = disc_law(
        disc, newton.anchor[a, 1], newton.anchor[a, 2], x, y, radius
    )
    newton.law_impulse[a, 1], newton.law_impulse[a, 2] = P_x, P_y
    newton.S_xx[a, SLIDING], newton.S_xy[a, SLIDING] = S_xx, S_xy
    newton.S_yy[a, SLIDING] = S_yy
    if not again:
        P_x, P_y = P_x + S_xx * x + S_xy * y, P_y + S_xy * x + S_yy * y
    return P_x, P_y, S_xx, S_xy, S_yy


@inlined
def add_sliding_laws(model: PlanarModel, work: PlanarWorkspace, again: bool) -> None:
    """
    Fill wrenches and inertias of the links with their loads and the linear laws of sliding.

    If `again`, they are those for the change from the last twists, not for the twists themselves.
    The load then contains what rounding left of the balance.
    """
    laws, contacts, chain, n = model.laws, work.contacts, work.chain, len(work.heading)
    for i in range(n):
        offset = model.offset[i]
        P_x, P_y, S_xx, S_xy, S_yy = sliding_law(laws, contacts, i, again)
        Q_x, Q_y, T_xx, T_xy, T_yy = sliding_law(laws, contacts, model.second[i], again)
        # Along and across the link, and about the middle of its contacts.
        along, across, moment = P_x + Q_x, P_y + Q_y, offset * (P_y - Q_y)
        S_aa, S_ac, S_cc = S_xx + T_xx, S_xy + T_xy, S_yy + T_yy
        S_aw, S_cw = offset * (S_xy - T_xy), offset * (S_yy - T_yy)
        S_ww = offset * offset * S_cc
        # In axes of I, and about O.
        c, s = work.heading[i, 0], work.heading[i, 1]
        x, y = work.middle[i, 0], work.middle[i, 1]
        px, py = c * along - s * across, s * along + c * across
        xx, xy, yy, xw, yw = in_axes_of_I(c, s, (S_aa, S_ac, S_cc, S_aw, S_cw))
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


@inlined
def add_peg_laws(model: PlanarModel, work: PlanarWorkspace, closed: Array, again: bool) -> None:
    """Add the linear laws of contacts with pegs, as `add_sliding_laws` adds those of the floor."""
    laws, contacts, chain = model.laws, work.contacts, work.chain
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        P_N, S_N = normal_law(laws, 0.0, newton.anchor[a, 0], newton.trial[a, 0])
        newton.law_impulse[a, 0], newton.S_N[a] = P_N, S_N
        newton.P_0[a, 0] = P_N + S_N * newton.trial[a, 0]
        linearize_disc(
            anchored_disc(laws, laws.other, contacts, a), contacts, a, newton.disc_radius[a], 0.0
        )
        normal, along = newton.law_impulse[a, 0], newton.law_impulse[a, 1]
        if not again:
            normal = newton.P_0[a, 0] - newton.S_N[a] * solution.shift[a]
            along = newton.P_0[a, 1]
        add_peg_law(chain, contacts, a, (normal, along), (S_N, newton.S_xx[a, SLIDING]))


@inlined
def yaw_joints(model: PlanarModel, work: PlanarWorkspace) -> Joints:
    """Return the laws of the joints in the plane, where only the yaw axes take part."""
    laws = model.joint_laws
    return Joints(laws.present, laws, work.axes, work.yaw_torque, work.yaw_damping)


@inlined
def yaw_rates(work: PlanarWorkspace) -> None:
    """Fill the rates of the yaw axes."""
    for j in range(len(work.twist) - 1):
        work.axes.rate[j, 0] = work.twist[j + 1, 0] - work.twist[j, 0]


@inlined
def planar_linear_step(
    model: PlanarModel, work: PlanarWorkspace, closed: Array, again: bool
) -> None:
    """
    Fill velocities, impulses and twists with the solution for the linear laws.

    `again` is as in `add_sliding_laws`.
    """
    if model.joint_laws.present:
        linearize_axes(model.joint_laws, work.axes, (work.yaw_torque, work.yaw_damping))
    contacts, chain, n = work.contacts, work.chain, len(work.heading)
    solution, newton = contacts.solution, contacts.newton
    pegs = closed[model.floor :]
    add_sliding_laws(model, work, again)
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
    if model.joint_laws.present:
        yaw_rates(work)
    planar_contact_velocities(model, work)
    peg_velocities(pegs, work)
    for a in pegs:
        slower = newton.trial[a, 0] - solution.gamma[a, 0]
        solution.impulse[a, 0] = newton.law_impulse[a, 0] + newton.S_N[a] * slower
    for a in closed:
        d_x = solution.gamma[a, 1] - newton.trial[a, 1]
        d_y = solution.gamma[a, 2] - newton.trial[a, 2]
        S_xx, S_xy, S_yy, _, _ = stiffness(contacts, a, SLIDING)
        solution.impulse[a, 1] = newton.law_impulse[a, 1] - S_xx * d_x - S_xy * d_y
        solution.impulse[a, 2] = newton.law_impulse[a, 2] - S_xy * d_x - S_yy * d_y


@inlined
def residual_in_plane(model: PlanarModel, closed: Array, contacts: Contacts) -> float:
    """
    Return the residual of `natural_map` [m/s], or an upper bound that is beyond the tolerance.

    The bound costs a tenth. If it is near the tolerance, the residual itself may be below.
    """
    enough = model.laws.residual_tolerance
    residual, _ = sliding_bound(model.laws, model.laws.other, closed, contacts)
    if residual <= enough or (residual > NEAR * enough and residual < math.inf):
        return residual
    residual, _ = natural_map(model.laws, closed, contacts, enough)
    return residual


@inlined
def settle_loads(model: PlanarModel, work: PlanarWorkspace, closed: Array) -> None:
    """
    Fill the radii with loads that fit friction better than the last ones.

    Friction that slides is proportional to the load, while its direction hardly changes. The loads
    are therefore found once more, with friction for the loads that were found.
    """
    laws, contacts = model.laws, work.contacts
    solution, newton = contacts.solution, contacts.newton
    for a in closed:
        radius, P_N = newton.disc_radius[a], max(0.0, solution.impulse[a, 0])
        disc = floor_disc(laws, laws.other, solution.impulse[a, 1])
        most = grip(laws.other, contacts, a) * radius
        x, y = disc.over_x * solution.impulse[a, 1], disc.over_y * solution.impulse[a, 2]
        if radius > 0.0 and x * x + y * y >= SLIDING_SHARE * most * most:
            solution.impulse[a, 1] *= P_N / radius
            solution.impulse[a, 2] *= P_N / radius
    find_loads(model, work)
    for a in closed:
        newton.disc_radius[a] = max(0.0, solution.impulse[a, 0])


@inlined
def iterate_coupled_in_plane(
    model: PlanarModel, work: PlanarWorkspace, closed: Array, limit: int
) -> tuple[int, float]:
    """Iterate with the loads of the last iteration; return iterations and residual [m/s]."""
    laws, contacts, joints = model.laws, work.contacts, yaw_joints(model, work)
    residual, iterations, steps = math.inf, 0, COUPLED_ITERATIONS
    while iterations < min(steps, limit):
        before = residual
        planar_linear_step(model, work, closed, iterations > 0)
        find_loads(model, work)
        residual = residual_in_plane(model, closed, contacts)
        residual = max(residual, joints_residual(joints))
        iterations += 1
        if residual <= laws.residual_tolerance or not math.isfinite(residual):
            break
        if residual < CONVERGES * before and steps < MOST_COUPLED_ITERATIONS:
            steps += 1
        settle_loads(model, work, closed)
        move(closed, contacts, joints, 1.0)
        anchor_what_moves(laws, closed, contacts, joints)
    return iterations, residual


@compiled
def iterate_held_in_plane(
    model: PlanarModel,
    work: PlanarWorkspace,
    closed: Array,
    tolerance: float,
    again: bool,
    limit: int,
) -> int:
    """Solve the convex problem with held radii and anchors; return the number of iterations."""
    laws, contacts, joints = model.laws, work.contacts, yaw_joints(model, work)
    solution, newton = contacts.solution, contacts.newton
    for a in closed:  # takes no part in the line search
        solution.impulse[a, 0] = newton.iterate[a, 0] = newton.anchor[a, 0]
    iterations = 0
    while iterations < min(HELD_ITERATIONS, limit):
        planar_linear_step(model, work, closed, again or iterations > 0)
        iterations += 1
        fraction = line_search(laws, closed, contacts, joints) if again or iterations > 1 else 1.0
        if fraction == 0.0:
            fraction = 1.0
        for i in range(len(work.twist)):
            for k in range(3):
                work.twist[i, k] -= (1.0 - fraction) * work.chain.twist[i, k]
        move(closed, contacts, joints, fraction)
        if fraction == 1.0:
            error = law_error(laws, closed, contacts, 1.0)[1]
            if max(error, joints_error(joints, 1.0)[1]) <= tolerance:
                break
    return iterations


@inlined
def anchor_what_moves(laws: Laws, closed: Array, contacts: Contacts, joints: Joints) -> None:
    """
    Fill the anchors as `newton.anchor`, except for friction of contacts that are still.

    Contacts that stick share a load in many ways. Rounding, which leaves them a velocity, would
    shift it a little in every round, and the normal loads with it. Where the friction against
    sliding forward and backward differs, the anchor must still be on the side of the impulse.
    """
    solution, newton = contacts.solution, contacts.newton
    still = STILL_SHARE * laws.residual_tolerance
    for a in closed:
        P_N = max(0.0, newton.iterate[a, 0])
        newton.anchor[a, 0] = P_N
        x, y = solution.gamma[a, 1], solution.gamma[a, 2]
        moves = x * x + y * y > still * still
        if moves or changes_side(laws.other, contacts, a):
            disc = sliding_disc(laws, laws.other, a, newton.iterate[a, 1])
            anchor_disc(disc, contacts, a, grip(laws.other, contacts, a) * P_N)
    if joints.take_part:
        anchor_axes(joints.axes)


class PlanarNewton(NamedTuple):
    """Newton's method on the chain of links; it needs no arrays of its own."""

    no_arrays: None = None


@solve_in_plane.register(PlanarNewton)
@inlined
def solve_planar_contacts(
    solver: PlanarNewton,
    model: PlanarModel,
    work: PlanarWorkspace,
    closed: Array,
    history: ContactHistory,
    limit: int,
) -> Outcome:
    """Solve the contacts of a step; see `solve_in_plane`."""
    laws, contacts, joints = model.laws, work.contacts, yaw_joints(model, work)
    newton = contacts.newton
    predict_sliding(closed, contacts, history)
    iterations, residual = iterate_coupled_in_plane(model, work, closed, limit)
    rounds, following = 0, begin_to_follow()
    while residual > laws.residual_tolerance and iterations < limit:
        if rounds == 0:
            predict_sliding(closed, contacts, history)
            for a in closed:
                newton.held_radius[a], newton.radius_step[a] = newton.disc_radius[a], 0.0
        for a in closed:
            newton.disc_radius[a] = newton.held_radius[a]
        inner = held_tolerance(rounds, laws.residual_tolerance)
        iterations += iterate_held_in_plane(
            model, work, closed, inner, rounds > 0, limit - iterations
        )
        find_loads(model, work)
        residual, _ = natural_map(laws, closed, contacts, laws.residual_tolerance)
        residual = max(residual, joints_residual(joints))
        move(closed, contacts, joints, 1.0)
        anchor_what_moves(laws, closed, contacts, joints)
        following = follow_loads(rounds, following, closed, contacts, None)
        rounds += 1
    remember_sliding(closed, contacts, history)
    converged = residual <= laws.residual_tolerance
    return Outcome(iterations, converged, residual, residual, rounds > 0)


@inlined
def prox_friction(model: PlanarModel, work: PlanarWorkspace, impulse: Array) -> float:
    """Fill impulse as `contact.prox_iteration.prox_sweep` does, for known loads."""
    laws, contacts = model.laws, work.contacts
    solution = contacts.solution
    normal = sliding = 0.0
    for a in work.closed:
        P_N, P_x, P_y = solution.impulse[a, 0], solution.impulse[a, 1], solution.impulse[a, 2]
        new_x, new_y = prox_sliding(laws, contacts, a, prox_half_line(P_N))
        normal += (P_N - impulse[a, 0]) ** 2
        sliding += (new_x - P_x) ** 2 + (new_y - P_y) ** 2
        impulse[a, 0], impulse[a, 1], impulse[a, 2] = P_N, new_x, new_y
    return math.sqrt(normal) + math.sqrt(sliding)


class PlanarProxIteration(NamedTuple):
    """The paper's iteration; it needs no arrays of its own."""

    no_arrays: None = None


@solve_in_plane.register(PlanarProxIteration)
@inlined
def solve_plane_with_projections(
    solver: PlanarProxIteration,
    model: PlanarModel,
    work: PlanarWorkspace,
    closed: Array,
    history: ContactHistory,
    limit: int,
) -> Outcome:
    """Project until the laws hold, with loads that follow from friction; see `solve_in_plane`."""
    contacts, impulse, tolerance = work.contacts, history.impulse, model.laws.change_tolerance
    factor_bare(work)
    iterations, change = 0, math.inf
    while not change < tolerance and iterations < limit:
        copy_impulses(closed, impulse, contacts)
        planar_twists(model, work)
        find_loads(model, work)
        change = prox_friction(model, work, impulse)
        iterations += 1
    residual, printed = natural_map(model.laws, closed, contacts, 0.0)
    return Outcome(iterations, change < tolerance, residual, printed, False)
