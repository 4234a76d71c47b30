# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The balance of a flat robot: velocities in the plane, loads out of it, and contacts with pegs.

Functions take a `model.PlanarModel` as `model`, and fill a `model.PlanarWorkspace` as `work`. Pegs
are found as `contact.detection` finds them in space.
"""

import math

from snake_sim_ros.contact.closing import (
    GAP_GROWTH,
    gaps_to_close,
    left_gap,
    most_closed,
    MOST_MOVES,
    predict_gaps,
)
from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.detection import (
    at_peg,
    end_of_capsules,
    fill_grip,
    gap_to_peg,
    is_beyond,
    Patches,
    reach_of_step,
)
from snake_sim_ros.contact.laws import OtherFriction, viscosity
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.hinge_chain import factor_hinges, HingeChain, solve_hinges
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.planar.model import PlanarModel, PlanarWorkspace


@inlined
def in_axes_of_I(
    c: float, s: float, S: tuple[float, float, float, float, float]
) -> tuple[float, float, float, float, float]:
    """
    Return entries xx, xy, yy, xw, yw of a link's inertia about its center, in axes of I.

    S are the entries along-along, along-across, across-across, along-turning and across-turning in
    axes of the link, with heading (c, s).
    """
    S_aa, S_ac, S_cc, S_aw, S_cw = S
    xx = c * c * S_aa - 2.0 * c * s * S_ac + s * s * S_cc
    xy = c * s * (S_aa - S_cc) + (c * c - s * s) * S_ac
    yy = s * s * S_aa + 2.0 * c * s * S_ac + c * c * S_cc
    return xx, xy, yy, c * S_aw - s * S_cw, s * S_aw + c * S_cw


@inlined
def fill_momentum(model: PlanarModel, work: PlanarWorkspace, u: Array, u_start: Array) -> None:
    """Fill inertias and momenta of links with velocities u (n, 3), and gamma of u_start (n, 3)."""
    n = len(u)
    for i in range(n):
        m, x, y = model.mass[i], work.center[i, 0], work.center[i, 1]
        px, py = m * u[i, 0], m * u[i, 1]
        work.momentum[i, 0] = model.inertia[i] * u[i, 2] + x * py - y * px
        work.momentum[i, 1], work.momentum[i, 2] = px, py
        A = work.bare[i]
        A[0], A[1], A[2] = model.inertia[i] + m * (x * x + y * y), -m * y, m * x
        A[3], A[4], A[5] = m, 0.0, m
        omega = u_start[i, 2]
        vx = u_start[i, 0] - omega * (work.middle[i, 1] - y)
        vy = u_start[i, 1] + omega * (work.middle[i, 0] - x)
        fill_link_velocities(model, work, i, (vx, vy, omega))
    add_viscous_friction_in_plane(model.laws.other, model, work)


@inlined
def add_viscous_friction_in_plane(
    other: OtherFriction | None, model: PlanarModel, work: PlanarWorkspace
) -> None:
    """Add the viscous friction to the inertias of links; see `laws.add_viscous_friction`."""
    if other is None:
        return
    h, n = model.dt * work.standing.part[0], len(work.heading)
    for i in range(n if other.is_viscous else 0):
        front = viscosity(other, h, work.contacts, i)
        rear = viscosity(other, h, work.contacts, model.second[i])
        along, across = front[0] + rear[0], front[1] + rear[1]
        turning, offset = model.offset[i] * (front[1] - rear[1]), model.offset[i]
        c, s = work.heading[i, 0], work.heading[i, 1]
        x, y = work.middle[i, 0], work.middle[i, 1]
        xx, xy, yy, xw, yw = in_axes_of_I(c, s, (along, 0.0, across, 0.0, turning))
        a_x, a_y = xw - y * xx + x * xy, yw - y * xy + x * yy
        A = work.bare[i]
        A[0] += offset * offset * across + (x * yw - y * xw) + (x * a_y - y * a_x)
        A[1] += a_x
        A[2] += a_y
        A[3] += xx
        A[4] += xy
        A[5] += yy


@inlined
def viscous_impulses(
    other: OtherFriction | None, model: PlanarModel, h: float, contacts: Contacts, i: int
) -> tuple[float, float]:
    """Return the impulse of viscous friction in a time h [s] along and across link i."""
    if other is None:
        return 0.0, 0.0
    along = across = 0.0
    for a in (i, model.second[i]):
        c_x, c_y = viscosity(other, h, contacts, a)
        along, across = (
            along - c_x * contacts.solution.gamma[a, 1],
            across - c_y * contacts.solution.gamma[a, 2],
        )
    return along, across


@inlined
def place_links_in_plane(
    model: PlanarModel, work: PlanarWorkspace, weight_velocity: float
) -> None:
    """
    Fill link centers and joint axes from the headings, and factor the chain for the loads.

    `weight_velocity` is the vertical velocity that the weight adds in this part of a step [m/s].
    """
    heading, center, front, rear = work.heading, work.center, model.front, model.rear
    work.standing.part[0] = weight_velocity / model.fall
    n = len(heading)
    root = n // 2
    center[root, 0] = center[root, 1] = 0.0
    for k in range(root):
        i = root - 1 - k
        for axis in range(2):
            step = front[i] * heading[i, axis] + rear[i + 1] * heading[i + 1, axis]
            center[i, axis] = center[i + 1, axis] - step
        i = root + 1 + k
        if i < n:
            for axis in range(2):
                step = front[i - 1] * heading[i - 1, axis] + rear[i] * heading[i, axis]
                center[i, axis] = center[i - 1, axis] + step
    flat, upright = work.chain.axis, work.upright.axis
    for j in range(n - 1):
        x = center[j, 0] + front[j] * heading[j, 0]
        y = center[j, 1] + front[j] * heading[j, 1]
        sign = model.side[j, 0]
        flat[j, 0], flat[j, 1], flat[j, 2] = sign, sign * y, -sign * x
        sign = model.side[j, 1]
        a, b = -sign * heading[j + 1, 1], sign * heading[j + 1, 0]  # e_x of link j+1
        upright[j, 0], upright[j, 1], upright[j, 2] = a, b, b * x - a * y
        work.upright.damping[j] = model.hold[j]
    for i in range(n):
        x, y, fall = center[i, 0], center[i, 1], model.mass[i] * weight_velocity
        work.weight[i, 0] = work.impact[i, 0] + y * fall
        work.weight[i, 1] = work.impact[i, 1] - x * fall
        work.weight[i, 2] = work.impact[i, 2] + fall
        ahead = model.ahead[i]
        x, y = x + ahead * heading[i, 0], y + ahead * heading[i, 1]
        work.middle[i, 0], work.middle[i, 1] = x, y
        reach_x, reach_y = model.offset[i] * heading[i, 0], model.offset[i] * heading[i, 1]
        A, count = work.upright.inertia[i], model.spheres_of_link[i]
        # Of contacts at +- reach: (y, -x, 1) times itself.
        A[0], A[1] = count * (y * y + reach_y * reach_y), -count * (x * y + reach_x * reach_y)
        A[2] = count * y
        A[3], A[4], A[5] = count * (x * x + reach_x * reach_x), -count * x, count
    A = work.upright.inertia[root]
    A[0] += model.root_hold
    A[3] += model.root_hold
    factor_hinges(work.upright)


@inlined
def fill_grips(
    patches: Patches | None, model: PlanarModel, work: PlanarWorkspace, x: float, y: float
) -> None:
    """
    Fill the grip of the contacts with the floor, for O at (x, y) in I [m].

    `patches` is ``model.patches``, an argument of its own so that Numba leaves out the branch on
    None.
    """
    if patches is None:
        return
    n = len(work.heading)
    for i in range(n):
        middle_x, middle_y, own = x + work.middle[i, 0], y + work.middle[i, 1], model.grip[i]
        arm_x, arm_y = model.offset[i] * work.heading[i, 0], model.offset[i] * work.heading[i, 1]
        place, other = (middle_x + arm_x, middle_y + arm_y), (middle_x - arm_x, middle_y - arm_y)
        fill_grip(patches, work.contacts, i, place, own)
        if model.spheres_of_link[i] > 1.0:
            fill_grip(patches, work.contacts, model.second[i], other, own)


@inlined
def fill_link_velocities(model: PlanarModel, work: PlanarWorkspace, i: int, v: Three) -> None:
    """Fill the sliding velocities of the contacts of link i, from that of their middle."""
    solution, (vx, vy, omega) = work.contacts.solution, v
    c, s = work.heading[i, 0], work.heading[i, 1]
    along, across, turning = c * vx + s * vy, c * vy - s * vx, model.offset[i] * omega
    a = model.second[i]
    solution.gamma[i, 1] = solution.gamma[a, 1] = along
    solution.gamma[i, 2], solution.gamma[a, 2] = across + turning, across - turning


@inlined
def planar_contact_velocities(model: PlanarModel, work: PlanarWorkspace) -> None:
    """Fill the sliding velocities of all contacts with the floor, from work.twist."""
    n = len(work.heading)
    for i in range(n):
        x, y = work.middle[i, 0], work.middle[i, 1]
        w = work.twist[i, 0]
        vx, vy = work.twist[i, 1] - w * y, work.twist[i, 2] + w * x
        fill_link_velocities(model, work, i, (vx, vy, w))


@compiled
def factor_bare(work: PlanarWorkspace) -> None:
    """Factor the chain in the plane with the inertias of the links alone."""
    for i in range(len(work.bare)):
        for k in range(6):
            work.chain.inertia[i, k] = work.bare[i, k]
    factor_hinges(work.chain)


@compiled
def planar_twists(model: PlanarModel, work: PlanarWorkspace) -> None:
    """Fill the twists and sliding velocities that follow from the friction impulses."""
    chain, contacts, n = work.chain, work.contacts, len(work.heading)
    solution = contacts.solution
    for i in range(n):
        c, s = work.heading[i, 0], work.heading[i, 1]
        a = model.second[i]
        along = solution.impulse[i, 1] + solution.impulse[a, 1]
        across = solution.impulse[i, 2] + solution.impulse[a, 2]
        moment = model.offset[i] * (solution.impulse[i, 2] - solution.impulse[a, 2])
        px, py = c * along - s * across, s * along + c * across
        moment += work.middle[i, 0] * py - work.middle[i, 1] * px
        chain.wrench[i, 0] = work.momentum[i, 0] + moment
        chain.wrench[i, 1] = work.momentum[i, 1] + px
        chain.wrench[i, 2] = work.momentum[i, 2] + py
    solve_hinges(chain, work.torque)
    for i in range(n):
        for k in range(3):
            work.twist[i, k] = chain.twist[i, k]
    planar_contact_velocities(model, work)


@inlined
def find_loads(model: PlanarModel, work: PlanarWorkspace) -> None:
    """
    Fill the normal impulses that balance the friction impulses, and work.standing.

    work.standing then has the smallest of them and the largest roll of a link. Friction across a
    link within the tolerance of the solver is neglected: nothing holds a single link against it.
    """
    contacts, upright, n = work.contacts, work.upright, len(work.heading)
    solution = contacts.solution
    h = model.dt * work.standing.part[0]
    for i in range(n):
        c, s = work.heading[i, 0], work.heading[i, 1]
        a = model.second[i]
        along, across = viscous_impulses(model.laws.other, model, h, contacts, i)
        along += solution.impulse[i, 1] + solution.impulse[a, 1]
        across += solution.impulse[i, 2] + solution.impulse[a, 2]
        if abs(across) <= model.mass[i] * model.laws.residual_tolerance:
            across = 0.0
        upright.wrench[i, 0] = work.weight[i, 0] + model.height * (s * along + c * across)
        upright.wrench[i, 1] = work.weight[i, 1] - model.height * (c * along - s * across)
        upright.wrench[i, 2] = work.weight[i, 2]
    solve_hinges(upright, work.no_torque)
    least, turn = math.inf, 0.0
    for i in range(n):
        wx, wy = upright.twist[i, 0], upright.twist[i, 1]
        c, s = work.heading[i, 0], work.heading[i, 1]
        load = wy * work.middle[i, 0] - wx * work.middle[i, 1] - upright.twist[i, 2]
        lever, a = model.offset[i] * (wy * c - wx * s), model.second[i]
        solution.impulse[i, 0], solution.impulse[a, 0] = load + lever, load - lever
        least = min(least, load - abs(lever))
        turn = max(turn, abs(wx * c + wy * s))
    root = n // 2
    tilt = upright.twist[root, 0] * work.heading[root, 0]
    tilt += upright.twist[root, 1] * work.heading[root, 1]
    roll = turn * model.roll_compliance / work.standing.part[0]
    work.standing.least_load[0], work.standing.roll[0] = least, roll if tilt > 0.0 else -roll


@inlined
def find_peg_contacts(model: PlanarModel, work: PlanarWorkspace, q: Array, u: Array) -> int:
    """Fill the contacts with pegs that may close in the step; return their number."""
    floor, capsules = model.floor, model.capsules
    count, contacts = 0, work.contacts
    geometry, solution = contacts.geometry, contacts.solution
    most = reach_of_step(model.closed_gap, 0.5 * model.dt)
    for k in range(len(model.pegs)):
        x, y = q[0] + 0.5 * model.dt * u[0, 0], q[1] + 0.5 * model.dt * u[0, 1]
        for m in range(len(capsules.link)):
            i, middle, radius = capsules.link[m], capsules.center[m, 2], capsules.radius[m]
            c, s = work.heading[i, 0], work.heading[i, 1]
            place = (
                x + work.center[i, 0] - work.center[0, 0] + middle * c,
                y + work.center[i, 1] - work.center[0, 1] + middle * s,
            )
            if is_beyond(most, model.pegs, capsules, place, m, k):
                continue
            gap, arm, normal_x, normal_y = at_peg(model.pegs, capsules, place, (c, s), m, k)
            if gap <= most:
                a = model.first_peg + k * len(capsules.link) + m
                work.closed[floor + count] = a
                count += 1
                geometry.link[a], geometry.gap[a], solution.shift[a] = i, gap, 0.0
                geometry.heading[a, 0], geometry.heading[a, 1] = -normal_y, normal_x
                point_x = (middle + arm) * c - radius * normal_x
                point_y = (middle + arm) * s - radius * normal_y
                geometry.point[a, 0] = work.center[i, 0] + point_x
                geometry.point[a, 1] = work.center[i, 1] + point_y
                vx, vy = u[i, 0] - u[i, 2] * point_y, u[i, 1] + u[i, 2] * point_x
                solution.gamma[a, 0] = normal_x * vx + normal_y * vy
                solution.gamma[a, 1] = normal_x * vy - normal_y * vx
    predict_gaps(model.closed_gap, model.dt, work.closed[floor : floor + count], contacts)
    return count


@inlined
def peg_velocities(closed: Array, work: PlanarWorkspace) -> None:
    """Fill the velocities of the contacts with pegs, with their shifts, from work.twist."""
    for a in closed:
        i = work.contacts.geometry.link[a]
        t_x, t_y = work.contacts.geometry.heading[a, 0], work.contacts.geometry.heading[a, 1]
        w = work.twist[i, 0]
        vx = work.twist[i, 1] - w * work.contacts.geometry.point[a, 1]
        vy = work.twist[i, 2] + w * work.contacts.geometry.point[a, 0]
        work.contacts.solution.gamma[a, 0] = t_y * vx - t_x * vy + work.contacts.solution.shift[a]
        work.contacts.solution.gamma[a, 1] = t_x * vx + t_y * vy


@inlined
def add_peg_law(
    chain: HingeChain,
    contacts: Contacts,
    a: int,
    impulse: tuple[float, float],
    decrease: tuple[float, float],
) -> None:
    """
    Add impulses [N s] and their decrease per velocity [kg] at contact a to its link.

    Both are along the normal and along the link.
    """
    geometry, (normal, along), (S_N, S_T) = contacts.geometry, impulse, decrease
    t_x, t_y = geometry.heading[a, 0], geometry.heading[a, 1]
    x, y = geometry.point[a, 0], geometry.point[a, 1]
    n_x, n_y = t_y, -t_x
    px, py = normal * n_x + along * t_x, normal * n_y + along * t_y
    xx, yy = S_N * n_x * n_x + S_T * t_x * t_x, S_N * n_y * n_y + S_T * t_y * t_y
    xy = S_N * n_x * n_y + S_T * t_x * t_y
    a_x, a_y = x * xy - y * xx, x * yy - y * xy
    i = geometry.link[a]
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
def close_pegs(model: PlanarModel, work: PlanarWorkspace, closed: Array, q: Array) -> float:
    """
    Close the gaps of contacts with pegs at the end of a step, as `moreau.close_step` does.

    Parameters
    ----------
    model : PlanarModel
    work : PlanarWorkspace
        Its chain is replaced; impulses are read.
    closed : ndarray
        Numbers of the contacts with pegs.
    q : ndarray, shape (n+2,)
        Coordinates at the end of the step; corrected.

    Returns
    -------
    float
        Largest penetration of the robot into a peg [m].

    """
    chain, contacts, n = work.chain, work.contacts, len(work.heading)
    solution, newton = contacts.solution, contacts.newton
    depth, before = peg_gaps(model, contacts, q), math.inf
    for a in closed:
        solution.is_loaded[a] = solution.impulse[a, 0] > 0.0
    for move in range(MOST_MOVES + 1 if model.closed_gap > 0.0 else 0):
        to_close, worst = gaps_to_close(most_closed(model.dt), model.dt, closed, contacts)
        worst = max(worst, depth)
        if worst > GAP_GROWTH * before:
            move_links_in_plane(work, -1.0, q)
            return peg_gaps(model, contacts, q)
        if move == MOST_MOVES or not to_close > left_gap(model.closed_gap):
            break
        before = worst
        for i in range(n):
            for k in range(6):
                chain.inertia[i, k] = work.bare[i, k]
            for k in range(3):
                chain.wrench[i, k] = 0.0
        for a in closed:
            S_N = newton.S_N[a] / model.laws.proximal_compliance
            add_peg_law(chain, contacts, a, (-S_N * solution.end_gap[a], 0.0), (S_N, 0.0))
        factor_hinges(chain)
        solve_hinges(chain, work.no_torque)
        move_links_in_plane(work, 1.0, q)
        depth = peg_gaps(model, contacts, q)
    return depth


@inlined
def move_links_in_plane(work: PlanarWorkspace, h: float, q: Array) -> None:
    """Move links, coordinates q (n+2,), with the small twists of the chain for a time h."""
    twist, center = work.chain.twist, work.center
    for i in range(len(center)):
        q[2 + i] += h * twist[i, 0]
    q[0] += h * (twist[0, 1] - twist[0, 0] * center[0, 1])
    q[1] += h * (twist[0, 2] + twist[0, 0] * center[0, 0])


@inlined
def peg_gaps(model: PlanarModel, contacts: Contacts, q: Array) -> float:
    """Fill the end gaps of all contacts with pegs; return the largest penetration [m]."""
    deepest = x = y = reach_x = reach_y = 0.0
    capsules, end = model.capsules, 0
    for i in range(len(model.mass) if len(model.pegs) > 0 else 0):
        c, s = math.cos(q[2 + i]), math.sin(q[2 + i])
        if i > 0:
            x, y = x + reach_x + model.rear[i] * c, y + reach_y + model.rear[i] * s
        reach_x, reach_y = model.front[i] * c, model.front[i] * s
        begin, end = end, end_of_capsules(capsules, end, i)
        for m in range(begin, end):
            middle = capsules.center[m, 2]
            place = q[0] + x + middle * c, q[1] + y + middle * s
            for k in range(len(model.pegs)):
                gap = gap_to_peg(model.pegs, capsules, place, (c, s), m, k)
                contacts.solution.end_gap[model.first_peg + k * len(capsules.link) + m] = gap
                deepest = max(deepest, -gap)
    return deepest
