# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A path to the solution of the contact laws, for steps in which Newton's method does not converge.

Friction scaled by its coefficients, S = diag(1, mu_x, mu_y), leaves a contact the impulses
x = S^-1 P of a circular cone K, of whose halves each has its mu_x if friction differs forward and
backward. With the speed of sliding added to the normal velocity [1]_, ``y = S gamma + (c (P_N -
center) + |(S gamma)_T|, 0, 0)`` and the compliance c of the selection rule, the laws are ``x in K,
y in K, x . y = 0``.

On the central path the last equation is ``x o y = m e``, with a number m > 0, the product o of the
Jordan algebra of the cone, and its unit e [2]_. The speed of sliding is smoothed by a speed in
proportion to m. For a large m all contacts push and hardly slide, and there is one solution; for
m = 0 there are the laws.

Friction follows the loads. By that the problem is not monotone, and m need not fall all the way:
the path turns where the determinant of the linear equations changes its sign. It is followed by
its length [3]_, and m falls where the determinant is positive and rises where it is negative.
Lengths are relative to x and y, in the scaling of Nesterov and Todd that makes both the same.

A point takes one factorization of the chain and three linear problems: back to the path, along it,
and what is of second order in both steps. Contacts of two links are condensed, as in
`linear_problem.couple_pairs`. Laws of joints are round on the path, see `dynamics.joint_path`.

.. [1] G. de Saxce, Z.-Q. Feng, "The bipotential method: a constructive approach to design the
   complete contact law with friction", Math. Comput. Modelling 28, 1998.
.. [2] V. Acary, P. Armand, H. M. Nguyen, M. Shpakovych, "Second-order cone programming for
   frictional contact mechanics using interior point algorithm", Optim. Methods Softw., 2024.
.. [3] E. L. Allgower, K. Georg, "Numerical Continuation Methods", 1990.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import Delassus, eliminate, end_twists
from snake_sim_ros.contact.directions import add_contact_wrench, contact_velocities
from snake_sim_ros.contact.laws import grip, Laws, natural_map, OtherFriction, rolls, sliding_disc
from snake_sim_ros.contact.linear_problem import add_point_inertia, count_single, load_chain
from snake_sim_ros.contact.problem import joints_residual, Problem
from snake_sim_ros.contact.shapes import inner, moved, times, triple
from snake_sim_ros.dynamics.articulated_body import Chain, correct_chain, factor_chain, reset_chain
from snake_sim_ros.dynamics.balance import axis_loads, rates_of_twists
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.joint_path import (
    add_steps_of_axes,
    axes_product,
    axes_way,
    begin_axes,
    copy_point,
    end_axes,
    linearize_on_path,
    load_step,
    move_axes_on,
    take_axes,
)
from snake_sim_ros.dynamics.kinematics import copy_rows
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array

LEAST_SPEED = 1e-3  # at which a path begins [m/s]
FIRST_STEP = 1.0  # length of the first step along the path
MOST_OF_WAY = 0.95  # share of the way to the edge of a cone, and by which m falls in a step
OFF_PATH = 1.0  # distance from which a step only returns to the path
LOST = 3.0  # and from which it begins again at the last point, with a shorter step
USUAL = 0.3  # distance that the lengths of steps aim at
LONGER, SHORTER = 2.5, 0.4  # by which a step may be longer or shorter than the last one
AGAIN = 0.4  # by which it is shorter when it is tried again
SHORTEST, LONGEST = 1e-5, 10.0  # step that ends a path, and the longest one
FARTHEST = 100.0  # m over that at first, from which the path came back
LESS = 0.7  # by which a step becomes shorter that would leave a cone
MOST_CORRECTIONS = 3  # points off the path, one after the other
MOST_FALL = 0.999  # share by which m falls at most
TURNING = 3000.0  # rates of joints over which their laws are round, over that speed [rad/m]
# Kinds of steps: back to the path, along it, of second order, and what is taken first.
BACK, ALONG, SECOND, TAKEN = range(4)


@inlined
def is_conic(laws: Laws, other: OtherFriction | None) -> bool:
    """Return whether there is a path for the laws of contacts; `other` is laws.other."""
    if rolls(laws):
        return False
    if other is None:
        return True
    return not other.falls


@inlined
def cone_det(x: Three) -> float:
    """Return ``x_N^2 - |x_T|^2``, without cancellation."""
    length = math.sqrt(x[1] * x[1] + x[2] * x[2])
    return (x[0] - length) * (x[0] + length)


@inlined
def reflected(x: Three) -> Three:
    """Return (x_N, -x_T)."""
    return x[0], -x[1], -x[2]


@inlined
def way_to_edge(x: Three, d: Three) -> float:
    """Return the largest a for which ``x + a d`` is in the cone that x is in, at most 1e9."""
    a, b, c = d[0] * d[0] - d[1] * d[1] - d[2] * d[2], inner(x, reflected(d)), cone_det(x)
    way = 1e9
    if d[0] < 0.0:
        way = min(way, -x[0] / d[0])
    inside = b * b - a * c
    if inside >= 0.0:
        q = -(b + math.copysign(math.sqrt(inside), b))
        if a != 0.0 and q / a > 0.0:
            way = min(way, q / a)
        if q != 0.0 and c / q > 0.0:
            way = min(way, c / q)
    return way


@inlined
def scaled_once(eta: float, w: Three, y: Three) -> Three:
    """Return W y of the scaling with ``W^2 = eta^2 (2 w w^T - J)``, J = diag(1, -1, -1)."""
    along = w[1] * y[1] + w[2] * y[2]
    share = y[0] + along / (1.0 + w[0])
    return (
        eta * (w[0] * y[0] + along),
        eta * (y[1] + share * w[1]),
        eta * (y[2] + share * w[2]),
    )


@inlined
def scaled_twice(eta: float, w: Three, y: Three) -> Three:
    """Return ``W^2 y``; see `scaled_once`."""
    both = 2.0 * eta * eta * inner(w, y)
    square = eta * eta
    return both * w[0] - square * y[0], both * w[1] + square * y[1], both * w[2] + square * y[2]


@inlined
def set_three(array: Array, a: int, x: Three) -> None:
    """Set a row of an array."""
    array[a, 0], array[a, 1], array[a, 2] = x[0], x[1], x[2]


@inlined
def smoothed_speed(contacts: Contacts, a: int, smoothing: float) -> float:
    """Return the smoothed sliding velocity of contact a, scaled by friction [m/s]."""
    path = contacts.path
    x, y = path.mu[a, 0] * path.gamma[a, 1], path.mu[a, 1] * path.gamma[a, 2]
    return math.sqrt(x * x + y * y + smoothing * smoothing)


@inlined
def velocity_of(laws: Laws, contacts: Contacts, a: int, smoothing: float) -> Three:
    """Return what y of contact a has to be, see the module [m/s]."""
    path = contacts.path
    rule = laws.compliance * (path.x[a, 0] - contacts.solution.selection_center[a])
    return (
        path.gamma[a, 0] + rule + smoothed_speed(contacts, a, smoothing),
        path.mu[a, 0] * path.gamma[a, 1],
        path.mu[a, 1] * path.gamma[a, 2],
    )


@inlined
def side_of(laws: Laws, contacts: Contacts, a: int) -> float:
    """Return mu_x of contact a on the side that its impulse is on."""
    disc = sliding_disc(laws, laws.other, a, contacts.path.x[a, 1])
    return grip(laws.other, contacts, a) * disc.mu_x


@inlined
def take_sides(laws: Laws, closed: Array, contacts: Contacts) -> None:
    """Scale x and y anew where impulses are on the other side; on the path both are 0 between."""
    path = contacts.path
    for a in closed:
        mu_x = side_of(laws, contacts, a)
        if mu_x != path.mu[a, 0] and mu_x * path.mu[a, 0] > 0.0:
            share = path.mu[a, 0] / mu_x
            path.x[a, 1], path.y[a, 1] = share * path.x[a, 1], path.y[a, 1] / share
            path.mu[a, 0] = mu_x


class Point(NamedTuple):
    """A point of the path, with x, y and gamma of the contacts."""

    m: float  # [N s m/s]
    first: float  # m at which the path began [N s m/s]
    speed: float  # scale of y there [m/s]
    step: float  # length of the next step


@compiled
def begin_path(problem: Problem) -> Point:
    """Fill x, y and gamma of the closed contacts with those where the path begins."""
    laws, closed, contacts, chain, _, joints = problem
    solution, path = contacts.solution, contacts.path
    if joints.take_part:
        load_chain(joints, chain)
    reset_chain(chain)
    factor_chain(chain)
    for a in closed:
        for j in range(5):
            solution.impulse[a, j] = 0.0
        disc = sliding_disc(laws, laws.other, a, -1.0)
        factor = grip(laws.other, contacts, a)
        path.mu[a, 0], path.mu[a, 1] = factor * disc.mu_x, factor * disc.mu_y
    end_twists(closed, contacts, chain)
    speed = LEAST_SPEED
    for a in closed:
        rule = laws.compliance * solution.selection_center[a]
        speed = max(speed, abs(solution.gamma[a, 0] - rule))
        speed = max(speed, abs(path.mu[a, 0] * solution.gamma[a, 1]))
        speed = max(speed, abs(path.mu[a, 1] * solution.gamma[a, 2]))
    for a in closed:
        solution.impulse[a, 0] = laws.r_N * speed
    end_twists(closed, contacts, chain)
    for a in closed:
        set_three(path.x, a, (laws.r_N * speed, 0.0, 0.0))
        set_three(path.y, a, (speed, 0.0, 0.0))
        set_three(path.gamma, a, triple(solution.gamma, a))
    if joints.take_part:
        rates_of_twists(chain, joints.axes.rate)
        begin_axes(joints.axes, (joints.torque, joints.damping))
    first = laws.r_N * speed * speed
    return Point(first, first, speed, FIRST_STEP)


@inlined
def linearize(problem: Problem, smoothing: float) -> None:
    """Fill scaling and stiffness of the contacts, ``dP = P' - K dgamma``, and loads of joints."""
    laws, closed, contacts, _, _, joints = problem
    path, c = contacts.path, laws.compliance
    if joints.take_part:
        linearize_on_path(joints.laws, joints.axes, joints.damping, TURNING * smoothing)
    for a in closed:
        x, y = triple(path.x, a), triple(path.y, a)
        det_x, det_y = math.sqrt(cone_det(x)), math.sqrt(cone_det(y))
        x, y = times(1.0 / det_x, x), times(1.0 / det_y, reflected(y))
        over = 1.0 / math.sqrt(2.0 + 2.0 * inner(x, reflected(y)))
        w = times(over, moved(x, 1.0, y))
        eta = math.sqrt(det_x / det_y)
        path.eta[a] = eta
        set_three(path.w, a, w)
        speed = smoothed_speed(contacts, a, smoothing)
        t_x = path.mu[a, 0] * path.gamma[a, 1] / speed
        t_y = path.mu[a, 1] * path.gamma[a, 2] / speed
        path.follow[a, 0], path.follow[a, 1] = t_x, t_y
        v = scaled_twice(eta, w, (1.0, 0.0, 0.0))
        share, square = c / (1.0 + c * v[0]), eta * eta
        # M = W^2 - c v v^T/(1 + c v_N), and K = S M B S with the friction that slides in B.
        M_NN, M_Nx, M_Ny = times(1.0 - share * v[0], v)
        M_xx = (2.0 * w[1] * w[1] + 1.0) * square - share * v[1] * v[1]
        M_xy = 2.0 * w[1] * w[2] * square - share * v[1] * v[2]
        M_yy = (2.0 * w[2] * w[2] + 1.0) * square - share * v[2] * v[2]
        mu_x, mu_y, K = path.mu[a, 0], path.mu[a, 1], path.stiffness[a]
        K[0, 0], K[0, 1], K[0, 2] = M_NN, mu_x * (M_Nx + M_NN * t_x), mu_y * (M_Ny + M_NN * t_y)
        K[1, 0], K[1, 1] = mu_x * M_Nx, mu_x * mu_x * (M_xx + M_Nx * t_x)
        K[1, 2] = mu_x * mu_y * (M_xy + M_Nx * t_y)
        K[2, 0], K[2, 1] = mu_y * M_Ny, mu_x * mu_y * (M_xy + M_Ny * t_x)
        K[2, 2] = mu_y * mu_y * (M_yy + M_Ny * t_y)


@inlined
def axes_of(contacts: Contacts, frame: Array | None, a: int) -> tuple[Three, Three, Three]:
    """Return the axes of contact a, normal, e_x and e_y, in I."""
    if frame is None:
        x, y = contacts.geometry.heading[a, 0], contacts.geometry.heading[a, 1]
        return (0.0, 0.0, 1.0), (x, y, 0.0), (-y, x, 0.0)
    return triple(frame[a], 0), triple(frame[a], 1), triple(frame[a], 2)


@inlined
def add_cones(closed: Array, contacts: Contacts, frame: Array | None, inertia: Array) -> None:
    """Add the stiffness of the closed contacts, none of two links, to inertias (n, 6, 6)."""
    geometry, stiffness = contacts.geometry, contacts.path.stiffness
    for a in closed:
        normal, e_x, e_y = axes_of(contacts, frame, a)
        K, p = stiffness[a], triple(geometry.point, a)
        by_n = moved(moved(times(K[0, 0], normal), K[0, 1], e_x), K[0, 2], e_y)
        by_x = moved(moved(times(K[1, 0], normal), K[1, 1], e_x), K[1, 2], e_y)
        by_y = moved(moved(times(K[2, 0], normal), K[2, 1], e_x), K[2, 2], e_y)
        x = moved(moved(times(normal[0], by_n), e_x[0], by_x), e_y[0], by_y)
        y = moved(moved(times(normal[1], by_n), e_x[1], by_x), e_y[1], by_y)
        z = moved(moved(times(normal[2], by_n), e_x[2], by_x), e_y[2], by_y)
        rows = (
            moved(times(p[1], z), -p[2], y),  # p~ K
            moved(times(p[2], x), -p[0], z),
            moved(times(p[0], y), -p[1], x),
            x,  # K
            y,
            z,
        )
        add_point_inertia(rows, p, inertia[geometry.link[a]])


@compiled
def factor_cones(problem: Problem) -> float:
    """
    Factor the chain with the stiffness of its contacts, and condense those of two links.

    Returns
    -------
    float
        The sign of the determinant, 1 or -1.

    """
    _, closed, contacts, chain, pairs, joints = problem
    single = closed[: count_single(closed, contacts, pairs)]
    if joints.take_part:
        axis_loads(joints.torque, joints.damping, chain)
    reset_chain(chain)
    no_torques(chain)
    add_cones(single, contacts, chain.frame, chain.inertia)
    factor_chain(chain)
    sign, root = 1.0, chain.inertia[len(chain.inertia) // 2]
    for k in range(6):
        sign = math.copysign(sign, sign * root[k, k])
    for j in range(len(chain.compliance)):
        D = chain.compliance[j]
        sign = math.copysign(sign, sign * (D[0] * D[3] - D[1] * D[2]))
    return sign * condense_cones(closed[len(single) :], contacts, chain, pairs)


@inlined
def condense_cones(
    closed: Array, contacts: Contacts, chain: Chain, pairs: Delassus | None
) -> float:
    """
    Fill pairs.operator with G of the contacts of two links on the factored chain.

    Returns
    -------
    float
        The sign of the determinant of ``1 + K G``.

    """
    if pairs is None or len(closed) == 0:
        return 1.0
    for k in range(len(closed)):
        for j in range(3):
            row = pairs.operator[3 * k + j]
            respond_to(closed[k : k + 1], j, contacts, chain)
            contact_velocities(closed, contacts, chain.frame, chain.twist)
            for other, b in enumerate(closed):
                for i in range(3):
                    shift = contacts.solution.shift[b] if i == 0 else 0.0
                    row[3 * other + i] = contacts.solution.gamma[b, i] - shift
    return solve_pairs(closed, contacts, pairs)


@compiled
def respond_to(one: Array, j: int, contacts: Contacts, chain: Chain) -> None:
    """Fill the twists for a unit impulse j of one contact."""
    for i in range(3):
        contacts.solution.impulse[one[0], i] = 1.0 if i == j else 0.0
    no_twists(chain)
    add_twists(one, contacts, chain)


@inlined
def no_twists(chain: Chain) -> None:
    """Set the twists to 0."""
    for i in range(len(chain.twist)):
        for k in range(6):
            chain.twist[i, k] = 0.0


@inlined
def add_twists(closed: Array, contacts: Contacts, chain: Chain) -> None:
    """Add the twists that the impulses of some contacts cause on the factored chain."""
    for i in range(len(chain.wrench)):
        for k in range(6):
            chain.wrench[i, k] = 0.0
    add_contact_wrench(closed, contacts, chain.frame, chain.wrench)
    correct_chain(chain)


@inlined
def no_torques(chain: Chain) -> None:
    """Set the torques that `add_twists` takes to 0."""
    for j in range(len(chain.residual_torque)):
        chain.residual_torque[j, 0] = chain.residual_torque[j, 1] = 0.0


@compiled
def respond(problem: Problem, kind: int) -> None:
    """Fill a step from what `load_cone` and `load_step` filled; see `linearize`."""
    laws, closed, contacts, chain, pairs, joints = problem
    count = count_single(closed, contacts, pairs)
    no_twists(chain)
    if joints.take_part:
        axis_loads(joints.torque, joints.damping, chain)
        copy_rows(chain.torque, chain.residual_torque, 2)
    add_twists(closed[:count], contacts, chain)
    no_torques(chain)
    respond_with_pairs(closed[count:], contacts, chain, pairs)
    contact_velocities(closed, contacts, chain.frame, chain.twist)
    for a in closed:
        contacts.solution.gamma[a, 0] -= contacts.solution.shift[a]
        take_response(laws, contacts, a, kind)
    if joints.take_part:
        rates_of_twists(chain, joints.axes.rate)
        take_axes(joints.axes, (joints.torque, joints.damping), kind)


@inlined
def respond_with_pairs(
    closed: Array, contacts: Contacts, chain: Chain, pairs: Delassus | None
) -> None:
    """Add the twists that the contacts of two links cause, ``(1 + K G) dP = P' - K dgamma``."""
    if pairs is None or len(closed) == 0:
        return
    solution, K, rows = contacts.solution, contacts.path.stiffness, 3 * len(closed)
    contact_velocities(closed, contacts, chain.frame, chain.twist)
    for k, a in enumerate(closed):
        gamma_N = solution.gamma[a, 0] - solution.shift[a]
        x, y = solution.gamma[a, 1], solution.gamma[a, 2]
        for j in range(3):
            felt = K[a, j, 0] * gamma_N + K[a, j, 1] * x + K[a, j, 2] * y
            pairs.system[3 * k + j, rows] = solution.impulse[a, j] - felt
    solve_pairs(closed, contacts, pairs)
    for k, a in enumerate(closed):
        for j in range(3):
            solution.impulse[a, j] = pairs.system[3 * k + j, rows]
    add_twists(closed, contacts, chain)


@compiled
def solve_pairs(closed: Array, contacts: Contacts, pairs: Delassus) -> float:
    """Solve ``(1 + K G) x = b``, b in the last column of pairs.system; see `eliminate`."""
    K, B, rows = contacts.path.stiffness, pairs.system, 3 * len(closed)
    for column in range(rows):
        g = pairs.operator[column]
        for k, a in enumerate(closed):
            for j in range(3):
                felt = K[a, j, 0] * g[3 * k] + K[a, j, 1] * g[3 * k + 1]
                B[3 * k + j, column] = felt + K[a, j, 2] * g[3 * k + 2]
        B[column, column] += 1.0
    return eliminate(B, rows)


@inlined
def load_cone(laws: Laws, contacts: Contacts, a: int, goal: Three, rest: Three) -> None:
    """Fill the impulse P' of contact a for ``dx + W^2 dy = goal``, ``dy - dF = rest``."""
    path, c = contacts.path, laws.compliance
    w, eta = triple(path.w, a), path.eta[a]
    b = moved(goal, -1.0, scaled_twice(eta, w, rest))
    set_three(path.right, a, b)
    set_three(path.rest, a, rest)
    v = scaled_twice(eta, w, (1.0, 0.0, 0.0))
    b = moved(b, -c * b[0] / (1.0 + c * v[0]), v)
    set_three(contacts.solution.impulse, a, (b[0], path.mu[a, 0] * b[1], path.mu[a, 1] * b[2]))


@inlined
def take_response(laws: Laws, contacts: Contacts, a: int, kind: int) -> None:
    """Fill the step of contact a that follows from a response."""
    path, c, gamma = contacts.path, laws.compliance, contacts.solution.gamma
    w, eta = triple(path.w, a), path.eta[a]
    x, y = path.mu[a, 0] * gamma[a, 1], path.mu[a, 1] * gamma[a, 2]
    h = gamma[a, 0] + path.follow[a, 0] * x + path.follow[a, 1] * y, x, y
    r = moved(triple(path.right, a), -1.0, scaled_twice(eta, w, h))
    v = scaled_twice(eta, w, (1.0, 0.0, 0.0))
    r, rest = moved(r, -c * r[0] / (1.0 + c * v[0]), v), triple(path.rest, a)
    set_three(path.step_x[a], kind, r)
    set_three(path.step_y[a], kind, (rest[0] + h[0] + c * r[0], rest[1] + h[1], rest[2] + h[2]))
    set_three(path.step_gamma[a], kind, triple(gamma, a))


@inlined
def product(problem: Problem, m: float, one: int, other: int) -> float:
    """Return the inner product of two steps, in the scaling at the point where they begin."""
    _, closed, contacts, _, _, joints = problem
    total, count = 0.0, 6.0 * len(closed)
    for a in closed:
        total += product_at(contacts, a, one, other)
    if joints.take_part:
        total += m * axes_product(joints.laws, joints.axes, one, other)
        count += 2.0 * len(joints.torque)
    return total / (count * m)


@inlined
def product_at(contacts: Contacts, a: int, one: int, other: int) -> float:
    """Return the part of contact a of `product`, without its factor."""
    path = contacts.path
    w, square = triple(path.w, a), path.eta[a] * path.eta[a]
    back = reflected(w)
    d, e = triple(path.step_x[a], one), triple(path.step_x[a], other)
    by_x = 2.0 * inner(back, d) * inner(back, e) - inner(d, reflected(e))
    d, e = triple(path.step_y[a], one), triple(path.step_y[a], other)
    by_y = 2.0 * inner(w, d) * inner(w, e) - inner(d, reflected(e))
    return by_x / square + by_y * square


@inlined
def is_inside(closed: Array, contacts: Contacts) -> bool:
    """Return whether x and y of all contacts are inside of their cones."""
    path = contacts.path
    for a in closed:
        if not (cone_det(triple(path.x, a)) > 0.0 and cone_det(triple(path.y, a)) > 0.0):
            return False
    return True


@inlined
def size_of_step(problem: Problem, m: float, kind: int) -> float:
    """Return by how much a step changes a contact or an axis, relative to themselves, at most."""
    _, closed, contacts, _, _, joints = problem
    largest = total = 0.0
    for a in closed:
        square = product_at(contacts, a, kind, kind)
        largest, total = max(largest, square), total + square
    size = math.sqrt(largest / m) if math.isfinite(total) else math.inf
    return max(size, axes_way(joints.laws, joints.axes, kind)) if joints.take_part else size


@inlined
def add_steps(problem: Problem, kind: int, one: int, share: float, other: int) -> None:
    """Let a step be the sum of one and a share of another."""
    path, joints = problem.contacts.path, problem.joints
    if joints.take_part:
        add_steps_of_axes(joints.axes, kind, one, share, other)
    for a in problem.closed:
        for j in range(3):
            path.step_x[a, kind, j] = path.step_x[a, one, j] + share * path.step_x[a, other, j]
            path.step_y[a, kind, j] = path.step_y[a, one, j] + share * path.step_y[a, other, j]
            gamma = path.step_gamma[a, one, j] + share * path.step_gamma[a, other, j]
            path.step_gamma[a, kind, j] = gamma


@inlined
def move_on(problem: Problem, share: float, kind: int) -> None:
    """Move x, y and gamma, and the axes, by a share of a step."""
    path, joints = problem.contacts.path, problem.joints
    if joints.take_part:
        move_axes_on(joints.axes, share, kind)
    for a in problem.closed:
        for j in range(3):
            path.x[a, j] += share * path.step_x[a, kind, j]
            path.y[a, j] += share * path.step_y[a, kind, j]
            path.gamma[a, j] += share * path.step_gamma[a, kind, j]


@inlined
def way_of(closed: Array, contacts: Contacts, kind: int) -> float:
    """Return the largest multiple of a step that stays in the cones."""
    path, way = contacts.path, 1e9
    for a in closed:
        way = min(way, way_to_edge(triple(path.x, a), triple(path.step_x[a], kind)))
        way = min(way, way_to_edge(triple(path.y, a), triple(path.step_y[a], kind)))
    return way


@inlined
def find_back(problem: Problem, m: float, smoothing: float) -> None:
    """Fill the step BACK to the path, for the present m."""
    laws, closed, contacts, _, _, joints = problem
    if joints.take_part:
        load_step(joints.laws, joints.axes, joints.torque, TURNING * smoothing, False)
    path = contacts.path
    for a in closed:
        x, y = triple(path.x, a), triple(path.y, a)
        goal = moved(times(m / cone_det(y), reflected(y)), -1.0, x)
        rest = moved(velocity_of(laws, contacts, a, smoothing), -1.0, y)
        load_cone(laws, contacts, a, goal, rest)
    respond(problem, BACK)


@inlined
def find_along(problem: Problem, m: float, smoothing: float) -> None:
    """Fill the step ALONG the path by which m would change by itself."""
    laws, closed, contacts, _, _, joints = problem
    if joints.take_part:
        load_step(joints.laws, joints.axes, joints.torque, TURNING * smoothing, True)
    for a in closed:
        y, speed = triple(contacts.path.y, a), smoothed_speed(contacts, a, smoothing)
        goal = times(m / cone_det(y), reflected(y))
        load_cone(laws, contacts, a, goal, (smoothing * smoothing / speed, 0.0, 0.0))
    respond(problem, ALONG)


@inlined
def find_second(problem: Problem, m: float, smoothing: float) -> None:
    """Fill the step SECOND to the path from where x, y and gamma were moved since `find_back`."""
    laws, closed, contacts, _, _, joints = problem
    if joints.take_part:
        load_step(joints.laws, joints.axes, joints.torque, TURNING * smoothing, False)
    path = contacts.path
    for a in closed:
        w, eta, y = triple(path.w, a), path.eta[a], triple(path.y, a)
        middle = triple(path.middle, a)
        p = scaled_once(1.0 / eta, reflected(w), triple(path.x, a))
        r = scaled_once(eta, w, y)
        left = m - inner(p, r), -p[0] * r[1] - r[0] * p[1], -p[0] * r[2] - r[0] * p[2]
        goal = scaled_once(eta, w, divided(left, middle))
        rest = moved(velocity_of(laws, contacts, a, smoothing), -1.0, y)
        load_cone(laws, contacts, a, goal, rest)
    respond(problem, SECOND)


@inlined
def divided(a: Three, b: Three) -> Three:
    """Return the x with ``b o x = a`` in the Jordan algebra of the cone."""
    along = b[1] * a[1] + b[2] * a[2]
    x = (b[0] * a[0] - along) / cone_det(b)
    return x, (a[1] - x * b[1]) / b[0], (a[2] - x * b[2]) / b[0]


@inlined
def keep_point(problem: Problem) -> None:
    """Keep x, y and gamma, and the axes, to which `return_to_point` returns."""
    path, joints = problem.contacts.path, problem.joints
    if joints.take_part:
        copy_point(joints.axes.path.point, joints.axes.path.kept)
    for a in problem.closed:
        set_three(path.kept[a], 0, triple(path.x, a))
        set_three(path.kept[a], 1, triple(path.y, a))
        set_three(path.kept[a], 2, triple(path.gamma, a))


@inlined
def return_to_point(problem: Problem) -> None:
    """Return to the point of `keep_point`."""
    path, joints = problem.contacts.path, problem.joints
    if joints.take_part:
        copy_point(joints.axes.path.kept, joints.axes.path.point)
    for a in problem.closed:
        set_three(path.x, a, triple(path.kept[a], 0))
        set_three(path.y, a, triple(path.kept[a], 1))
        set_three(path.gamma, a, triple(path.kept[a], 2))
        path.mu[a, 0] = side_of(problem.laws, problem.contacts, a)


@inlined
def keep_middle(closed: Array, contacts: Contacts) -> None:
    """Keep W y, which is W^-1 x, of every contact."""
    path = contacts.path
    for a in closed:
        middle = scaled_once(path.eta[a], triple(path.w, a), triple(path.y, a))
        set_three(path.middle, a, middle)


@inlined
def residual_on_path(problem: Problem, enough: float) -> tuple[float, float]:
    """Fill impulses, velocities and rates; return what `natural_map` does, with the joints."""
    laws, closed, contacts, _, _, joints = problem
    path, solution = contacts.path, contacts.solution
    for a in closed:
        solution.impulse[a, 0] = path.x[a, 0]
        for j in range(2):
            solution.impulse[a, 1 + j] = path.mu[a, j] * path.x[a, 1 + j]
        set_three(solution.gamma, a, triple(path.gamma, a))
    if joints.take_part:
        end_axes(joints.axes, (joints.torque, joints.damping))
    residual, printed = natural_map(laws, closed, contacts, enough)
    return max(residual, joints_residual(joints)), printed


@compiled
def follow_path(
    problem: Problem, point: Point, limit: int, enough: float
) -> tuple[Point, int, float]:
    """
    Follow the path from a point until the residual of the laws is `enough` [m/s].

    Impulses and velocities of the contacts are filled with those of the last point. Impulses are
    admissible.

    Returns
    -------
    point : Point
    count : int
        Points that were found, each with a factorization.
    residual : float
        That of the last point [m/s].

    """
    laws, closed, contacts, _, _, _ = problem
    m, first, speed, step = point
    kept_step, kept_m = step, m
    can_return, corrections, points, residual = False, 0, 0, math.inf
    while points < limit and residual > enough and m <= FARTHEST * first:
        points += 1
        smoothing = speed * m / first
        linearize(problem, smoothing)
        sign = -factor_cones(problem)  # m falls where the determinant is positive
        find_back(problem, m, smoothing)
        find_along(problem, m, smoothing)
        square = product(problem, m, ALONG, ALONG) + 1.0
        change = -product(problem, m, BACK, ALONG) / square
        add_steps(problem, BACK, BACK, change, ALONG)
        off = size_of_step(problem, m, BACK)
        corrections = corrections + 1 if off > OFF_PATH else 0
        if not off <= LOST or corrections > MOST_CORRECTIONS:
            kept_step *= AGAIN
            if not can_return or kept_step < SHORTEST:
                break
            return_to_point(problem)
            m, step, corrections = kept_m, kept_step, 0
            continue
        taken = step if off <= OFF_PATH else 0.0
        per_step = sign / math.sqrt(square)
        while True:
            add_steps(problem, TAKEN, BACK, taken * per_step, ALONG)
            falls = change + taken * per_step
            way = way_of(closed, contacts, TAKEN)
            if falls < -MOST_OF_WAY:
                way = min(way, MOST_OF_WAY / -falls)
            if way * MOST_OF_WAY >= 1.0 or taken == 0.0:
                break
            taken = LESS * taken if taken > SHORTEST else 0.0
        share = min(1.0, MOST_OF_WAY * way)
        if taken > 0.0:
            keep_point(problem)
            kept_m, kept_step, can_return, step = m, taken, True, taken
        keep_middle(closed, contacts)
        move_on(problem, share, TAKEN)
        falls *= share
        if taken > 0.0:
            find_second(problem, m * (1.0 + falls), smoothing * (1.0 + falls))
            change = -product(problem, m, SECOND, ALONG) / square
            add_steps(problem, SECOND, SECOND, change, ALONG)
            if size_of_step(problem, m, SECOND) <= LOST:
                share = min(1.0, MOST_OF_WAY * way_of(closed, contacts, SECOND))
                move_on(problem, share, SECOND)
                falls += share * change
            longer = math.sqrt(USUAL / max(off, 1e-3))
            step = min(LONGEST, step * min(LONGER, max(SHORTER, longer)))
        m *= 1.0 + max(falls, -MOST_FALL)
        residual = math.inf
        take_sides(laws, closed, contacts)
        if is_inside(closed, contacts):
            residual = residual_on_path(problem, enough)[0]
        elif can_return and kept_step > SHORTEST:
            return_to_point(problem)
            kept_step *= AGAIN
            m, step = kept_m, kept_step
        else:
            break
    return Point(m, first, speed, step), points, residual


@compiled
def end_path(problem: Problem) -> tuple[float, float]:
    """
    Fill impulses, velocities and twists of the last point, without impulses of contacts that open.

    Returns
    -------
    residual, printed_residual : float
        As `natural_map` returns them [m/s].

    """
    laws, closed, contacts, chain, _, joints = problem
    path, solution = contacts.path, contacts.solution
    residual_on_path(problem, 0.0)
    if joints.take_part:
        axis_loads(joints.torque, joints.damping, chain)
    for a in closed:
        rule = laws.compliance * (path.x[a, 0] - solution.selection_center[a])
        if path.x[a, 0] <= laws.r_N * (path.gamma[a, 0] + rule):
            set_three(solution.impulse, a, (0.0, 0.0, 0.0))
    reset_chain(chain)
    factor_chain(chain)
    end_twists(closed, contacts, chain)
    if not math.isfinite(chain.twist[0, 3] + chain.twist[len(chain.twist) - 1, 3]):
        return math.inf, math.inf
    if joints.take_part:
        rates_of_twists(chain, joints.axes.rate)
    residual, printed = natural_map(laws, closed, contacts, 0.0)
    return max(residual, joints_residual(joints)), printed
