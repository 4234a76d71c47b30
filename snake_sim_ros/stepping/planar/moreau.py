"""
The time step of a robot that lies flat, in the plane: n+2 coordinates, joints eliminated exactly.

The robot of `spatial` moves like this one as long as its pitch joints are told to be straight and
no contact lifts off. What is left of eqs. (72)-(93) are the balance in the plane, a chain of links
with one hinge a joint (`hinge_chain`), and friction at both spheres of every link. Two things of
space remain, because friction acts at the floor, below the centers of gravity:

- The normal loads follow from the equilibrium out of the plane, heave, roll and pitch of every
  link, given the friction. They are not unique; the selection rule of `spatial` takes those of
  least norm. A least-norm load is ``P_N = -W_N^T v`` for some v out of the plane, so that the same
  sweeps that solve the dynamics find it: a chain with springs of unit stiffness at its contacts.
- A flat robot can still roll, all links at once, and only its pitch joints hold it (the rank of
  the 2n normal directions is one short). They do so at angles of some 1e-4 rad, left out here;
  their load is part of the equilibrium.

Deviation: inertia out of the plane is left out, and so is that contacts slip across while the
robot rolls, by its radius times the change of the roll. This level is the limit of `spatial` for
pitch joints that are stiffer and stiffer, and a normal compliance that falls with their stiffness:
the difference falls with the roll, which friction and springs make. It counts where friction moves
the robot by little more than it slips so: on slippery floors, and where a gait hardly advances.
That is what `rolls_too_far` watches: the slip of all steps against the way of the center of mass.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.contacts import GAMMA
from snake_sim_ros.contact.contacts import IMPULSE
from snake_sim_ros.contact.contacts import Laws
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.hinge_chain import factor_hinges
from snake_sim_ros.dynamics.hinge_chain import HingeChain
from snake_sim_ros.dynamics.hinge_chain import solve_hinges
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.planar.pegs import peg_depth
from snake_sim_ros.stepping.planar.pegs import touch_pegs
from snake_sim_ros.stepping.report import CONTACTS
from snake_sim_ros.stepping.report import FAILED_LINK
from snake_sim_ros.stepping.report import FAILED_VALUE
from snake_sim_ros.stepping.report import LEFT
from snake_sim_ros.stepping.report import note_outcome
from snake_sim_ros.stepping.report import PENETRATION
from snake_sim_ros.stepping.report import STEPS

# Share of a contact's stiffness with which the floor holds the robot against rolling: none, but
# so a straight robot is noticed, that nothing else holds.
UNHELD = 1e-10
LEAN = 1e-3  # roll of the robot at which it does not lie flat, and that is always left out [rad]
SLIPPING = 5e-3  # share of the way up to which the slip by rolling is left out
FADE = 3.0  # time in which slip and way are forgotten [s]

LEAST, ROLL, PART, ROLLS = range(4)  # in work.standing, see find_loads and is_planar
# In history from PREVIOUS on, counted from its end: the roll after the last step, by which the
# largest of a link is meant, with the sign of that of the middle link [rad]; the slip and the way
# up to there [m]. The last two are kept while the robot is at the spatial level.
LAST_ROLL, SLIP, WAY = -3, -4, -5


class PlanarModel(NamedTuple):
    """The numbers of a scene as the compiled step takes them; names as in `parameters`."""

    half_length: Array
    mass: Array
    inertia: Array  # (n,) about the vertical
    inertia_axial: Array
    offset: Array
    radius: float  # of all contact spheres
    stiffness: Array  # (n-1,) of the yaw joints
    damping: Array
    hold: Array  # (n-1,) share of a pitch joint in holding the robot
    lean: float  # roll [rad] for a unit of turning about a horizontal axis
    fall: float  # vertical velocity that the weight adds in a step [m/s]
    share: Array  # (n,) of every link in the point that section VII-C holds
    laws: Laws
    dt: float
    tolerance: float
    residual_tolerance: float
    iteration_limit: int
    most_lean: float  # roll that is too much to be left out [rad]
    most_slip: float  # share of the way of the center of mass up to which its slip is left out
    held: bool  # whether pitch joints hold the robot; if not, what they let roll is rounding
    patient: bool  # whether steps that do not converge are taken, and counted
    pd_scheme: int
    keeps_center: bool  # whether that is the center of mass, and not link 1
    pegs: Array  # (pegs, 3) x, y, radius [m]
    first_peg: int  # number of the first contact with a peg
    activation_tolerance: float


class PlanarWorkspace(NamedTuple):
    """Arrays that the step fills, made once; the plane is that of the link centers."""

    heading: Array  # (n, 2) direction of every link
    center: Array  # (n, 2) of every link, from O, the center of the middle link
    torque: Array  # (n-1,) impulse of the controller, without its implicit part [N m s]
    momentum: Array  # (n, 3) impulse wrench of everything but contacts and torques
    bare: Array  # (n, 6) inertia of the links about O
    applied: Array  # (n-1, 2) impulse of the joints with the implicit part [N m s]
    impact: Array  # (n, 3) momentum out of the plane that the first step takes up
    weight: Array  # (n, 3) load out of the plane of everything but the contacts
    no_torque: Array  # (n-1,) zero
    chain: HingeChain  # in the plane
    upright: HingeChain  # out of it, with a spring at each contact
    contact: Array  # (c,) indices of the closed contacts of c, first the 2n with the floor
    table: Array  # (c, COLUMNS) see contacts and newton
    twist: Array  # (n, 3) the last twists in the plane
    standing: Array  # (4,) LEAST, ROLL, PART, ROLLS
    q_hat: Array  # (n+2,), u_hat, u_star, u_start (n, 3), q_start (n+2,): see planar_bdf2
    u_hat: Array
    u_star: Array
    q_start: Array
    u_start: Array


@inlined
def begin_step(model, work, q, u, angle, rate):
    """
    Fill all that a contact solver needs; velocities (n, 3) are those of the start.

    Returns
    -------
    int
        Closed contacts: all 2n with the floor, and those with pegs.

    """
    n, dt, chain = len(u), model.dt, work.chain
    for i in range(n):
        theta = q[2 + i] + dt / 2 * u[i, 2]
        work.heading[i, 0], work.heading[i, 1] = math.cos(theta), math.sin(theta)
    place_links(model, work, model.fall)
    for j in range(n - 1):
        difference, turn = q[3 + j] - q[2 + j], u[j + 1, 2] - u[j, 2]
        torque, damping = pd_law(
            model.pd_scheme, dt, (difference, turn), (difference + dt / 2 * turn, turn),
            (angle[j, 0], rate[j, 0]), model.stiffness[j], model.damping[j],
        )  # fmt: skip
        work.torque[j], chain.damping[j] = torque * dt, damping * dt
    fill_momentum(model, work, u, u)
    return 2 * n + touch_pegs(model, work, q, u)


@inlined
def fill_momentum(model, work, u, u_start):
    """Fill the inertias and momenta of links that move with u (n, 3), velocities with u_start."""
    n = len(u)
    for i in range(n):
        m, x, y = model.mass[i], work.center[i, 0], work.center[i, 1]
        px, py = m * u[i, 0], m * u[i, 1]
        work.momentum[i, 0] = model.inertia[i] * u[i, 2] + x * py - y * px
        work.momentum[i, 1], work.momentum[i, 2] = px, py
        A = work.bare[i]
        A[0], A[1], A[2] = model.inertia[i] + m * (x * x + y * y), -m * y, m * x
        A[3], A[4], A[5] = m, 0.0, m
        c, s = work.heading[i, 0], work.heading[i, 1]
        vx, vy, omega = u_start[i, 0], u_start[i, 1], u_start[i, 2]
        table_velocities(work.table, i, n, model.offset[i], c, s, vx, vy, omega)


@inlined
def place_links(model, work, weight_velocity):
    """
    Fill centers from O, the axes of both chains, and prepare the equilibrium for loads.

    The weight would let links fall at a given velocity [m/s], as large as the part of the step is.
    """
    heading, center, half = work.heading, work.center, model.half_length
    work.standing[PART] = weight_velocity / model.fall
    n = len(heading)
    root = n // 2
    center[root, 0] = center[root, 1] = 0.0
    for k in range(root):
        i = root - 1 - k
        for axis in range(2):
            step = half[i] * heading[i, axis] + half[i + 1] * heading[i + 1, axis]
            center[i, axis] = center[i + 1, axis] - step
        i = root + 1 + k
        if i < n:
            for axis in range(2):
                step = half[i - 1] * heading[i - 1, axis] + half[i] * heading[i, axis]
                center[i, axis] = center[i - 1, axis] + step
    flat, upright = work.chain.axis, work.upright.axis
    for j in range(n - 1):
        x = center[j, 0] + half[j] * heading[j, 0]
        y = center[j, 1] + half[j] * heading[j, 1]
        sign = 1.0 if j >= root else -1.0
        flat[j, 0], flat[j, 1], flat[j, 2] = sign, sign * y, -sign * x
        a, b = -sign * heading[j + 1, 1], sign * heading[j + 1, 0]  # e_x of link j+1
        upright[j, 0], upright[j, 1], upright[j, 2] = a, b, b * x - a * y
        work.upright.damping[j] = model.hold[j]
    for i in range(n):
        x, y, fall = center[i, 0], center[i, 1], model.mass[i] * weight_velocity
        reach_x, reach_y = model.offset[i] * heading[i, 0], model.offset[i] * heading[i, 1]
        A = work.upright.inertia[i]  # of contacts at +- reach: (y, -x, 1) times itself
        A[0], A[1] = 2.0 * (y * y + reach_y * reach_y), -2.0 * (x * y + reach_x * reach_y)
        A[2] = 2.0 * y
        A[3], A[4], A[5] = 2.0 * (x * x + reach_x * reach_x), -2.0 * x, 2.0
        work.weight[i, 0] = work.impact[i, 0] + y * fall
        work.weight[i, 1] = work.impact[i, 1] - x * fall
        work.weight[i, 2] = work.impact[i, 2] + fall
    A = work.upright.inertia[root]
    unheld = UNHELD * half[root] * half[root]
    A[0] += unheld
    A[3] += unheld
    factor_hinges(work.upright)


@inlined
def table_velocities(table, i, n, offset, c, s, vx, vy, omega):
    """Fill the sliding velocities of both contacts of a link that moves with given velocities."""
    along, across, turning = c * vx + s * vy, c * vy - s * vx, offset * omega
    table[i, GAMMA + 1] = table[n + i, GAMMA + 1] = along
    table[i, GAMMA + 2], table[n + i, GAMMA + 2] = across + turning, across - turning


@inlined
def contact_velocities(model, work):
    """Fill the sliding velocities of all contacts that work.twist makes."""
    n = len(work.heading)
    for i in range(n):
        x, y = work.center[i, 0], work.center[i, 1]
        c, s = work.heading[i, 0], work.heading[i, 1]
        w = work.twist[i, 0]
        vx, vy = work.twist[i, 1] - w * y, work.twist[i, 2] + w * x
        table_velocities(work.table, i, n, model.offset[i], c, s, vx, vy, w)


@compiled
def factor_bare(work):
    """Prepare the chain of the links alone."""
    for i in range(len(work.bare)):
        for k in range(6):
            work.chain.inertia[i, k] = work.bare[i, k]
    factor_hinges(work.chain)


@compiled
def end_twists(model, work):
    """Fill twists and sliding velocities that the friction impulses in the table lead to."""
    chain, table, n = work.chain, work.table, len(work.heading)
    for i in range(n):
        c, s = work.heading[i, 0], work.heading[i, 1]
        along = table[i, IMPULSE + 1] + table[n + i, IMPULSE + 1]
        across = table[i, IMPULSE + 2] + table[n + i, IMPULSE + 2]
        moment = model.offset[i] * (table[i, IMPULSE + 2] - table[n + i, IMPULSE + 2])
        px, py = c * along - s * across, s * along + c * across
        moment += work.center[i, 0] * py - work.center[i, 1] * px
        chain.wrench[i, 0] = work.momentum[i, 0] + moment
        chain.wrench[i, 1] = work.momentum[i, 1] + px
        chain.wrench[i, 2] = work.momentum[i, 2] + py
    solve_hinges(chain, work.torque)
    for i in range(n):
        for k in range(3):
            work.twist[i, k] = chain.twist[i, k]
    contact_velocities(model, work)


@compiled
def condense(model, work, delassus):
    """Fill the Delassus operator and the free velocities of sliding; normal rows are zero."""
    table, contact, free = work.table, work.contact, delassus.free
    for a in contact:
        table[a, IMPULSE + 1] = table[a, IMPULSE + 2] = 0.0
    end_twists(model, work)
    for k, a in enumerate(contact):
        for j in range(3):
            free[3 * k + j] = table[a, GAMMA + j]
    for k, a in enumerate(contact):
        for j in range(3):
            if j > 0:
                table[a, IMPULSE + j] = 1.0
                end_twists(model, work)
                table[a, IMPULSE + j] = 0.0
            for other, b in enumerate(contact):
                for i in range(3):
                    row = 3 * other + i
                    velocity = table[b, GAMMA + i] - free[row] if j > 0 else 0.0
                    delassus.operator[3 * k + j, row] = velocity


@inlined
def find_loads(model, work):
    """
    Fill the normal impulses that go with the friction impulses in the table.

    In work.standing are then LEAST, the smallest of them [N s], and ROLL, the largest roll of a
    link with the sign of that of the middle link [rad]. What a solver may leave of friction rolls
    nothing: one link that stands would not be held against it.
    """
    table, upright, n = work.table, work.upright, len(work.heading)
    for i in range(n):
        c, s = work.heading[i, 0], work.heading[i, 1]
        along = table[i, IMPULSE + 1] + table[n + i, IMPULSE + 1]
        across = table[i, IMPULSE + 2] + table[n + i, IMPULSE + 2]
        if abs(across) <= model.mass[i] * model.residual_tolerance:
            across = 0.0
        upright.wrench[i, 0] = work.weight[i, 0] + model.radius * (s * along + c * across)
        upright.wrench[i, 1] = work.weight[i, 1] - model.radius * (c * along - s * across)
        upright.wrench[i, 2] = work.weight[i, 2]
    solve_hinges(upright, work.no_torque)
    least, turn = math.inf, 0.0
    for i in range(n):
        wx, wy = upright.twist[i, 0], upright.twist[i, 1]
        c, s = work.heading[i, 0], work.heading[i, 1]
        load = wy * work.center[i, 0] - wx * work.center[i, 1] - upright.twist[i, 2]
        lever = model.offset[i] * (wy * c - wx * s)
        table[i, IMPULSE], table[n + i, IMPULSE] = load + lever, load - lever
        least = min(least, load - abs(lever))
        turn = max(turn, abs(wx * c + wy * s))
    root = n // 2
    tilt = upright.twist[root, 0] * work.heading[root, 0]
    tilt += upright.twist[root, 1] * work.heading[root, 1]
    lean = turn * model.lean / work.standing[PART]
    work.standing[LEAST], work.standing[ROLL] = least, lean if tilt > 0.0 else -lean


@inlined
def is_planar(model, work, history, outcome, report):
    """
    Return whether the solution of a step is planar, and no link turns further than resolved.

    In work.standing, ROLLS is then whether what it rolls is all that is not planar.
    """
    work.standing[ROLLS] = 0.0
    if not (
        (outcome[1] or model.patient)
        and work.standing[LEAST] > 0.0
        and abs(work.standing[ROLL]) <= model.most_lean
    ):
        report[LEFT] = 1.0
        return False
    if model.held and rolls_too_far(model, work, history):
        work.standing[ROLLS] = report[LEFT] = 1.0
        return False
    for i in range(len(work.twist)):
        turn = model.dt * abs(work.twist[i, 0])
        if not (turn < math.pi / 2 and math.isfinite(work.twist[i, 1] + work.twist[i, 2])):
            report[FAILED_LINK], report[FAILED_VALUE] = i + 1, turn
            history[:] = 0.0
            return False
    return True


@merged
def rolls_too_far(model, work, history):
    """
    Return whether contacts slip too far by rolling to leave that out; if not, note it in history.

    What a roll of LEAN makes is always left out, as a gait begins with one and no way. Besides
    that as much is as a share of the way of the center of mass.
    """
    memory = history[3:].reshape(history[3:].size)
    mass = p_x = p_y = 0.0
    for i in range(len(work.twist)):
        m, omega = model.mass[i], work.twist[i, 0]
        mass += m
        p_x += m * (work.twist[i, 1] - omega * work.center[i, 1])
        p_y += m * (work.twist[i, 2] + omega * work.center[i, 0])
    h = model.dt * work.standing[PART]
    left = 1.0 / (1.0 + h / FADE)
    turn = abs(work.standing[ROLL] - memory[LAST_ROLL])
    slip = left * memory[SLIP] + model.radius * turn
    way = left * memory[WAY] + h * math.sqrt(p_x * p_x + p_y * p_y) / mass
    if not slip <= model.radius * LEAN + model.most_slip * way:
        return True
    memory[LAST_ROLL], memory[SLIP], memory[WAY] = work.standing[ROLL], slip, way
    return False


@inlined
def end_velocities(model, work, u):
    """Fill u (n, 3) from the twists, and the impulses of the joints that go with them."""
    twist, n = work.twist, len(u)
    for j in range(n - 1):
        yaw_rate = twist[j + 1, 0] - twist[j, 0]
        work.applied[j, 0] = work.torque[j] - work.chain.damping[j] * yaw_rate
        work.applied[j, 1] = -model.hold[j] * work.upright.rate[j]
    for i in range(n):
        u[i, 0] = twist[i, 1] - twist[i, 0] * work.center[i, 1]
        u[i, 1] = twist[i, 2] + twist[i, 0] * work.center[i, 0]
        u[i, 2] = twist[i, 0]
        for k in range(3):
            work.impact[i, k] = 0.0


@inlined
def end_step(model, work, q, u, history, count, outcome, report):
    """
    Move q (n+2,) and u (n, 3) to the end of the step, unless it is not planar or diverged.

    Parameters
    ----------
    count : int
        Closed contacts.
    outcome : tuple
        What a contact solver returns, see `moreau.end_step`.

    Returns
    -------
    bool
        Whether it was done.

    """
    if not is_planar(model, work, history, outcome, report):
        return False
    before_x, before_y = held_point(model, q)
    move(model, 0.5 * model.dt, q, u)
    end_velocities(model, work, u)
    move(model, 0.5 * model.dt, q, u)
    after_x, after_y = held_point(model, q)
    q[0] += before_x - after_x
    q[1] += before_y - after_y
    note_outcome(outcome, report)
    report[STEPS] += 1
    report[CONTACTS] = count
    report[PENETRATION] = max(report[PENETRATION], peg_depth(model, q))
    return True


@inlined
def move(model, h, q, u):
    """Move the robot for a time h, as a whole with the point that section VII-C holds."""
    for i in range(len(u)):
        q[2 + i] += h * u[i, 2]
    for i in range(len(u) if model.keeps_center else 1):
        q[0] += h * model.share[i] * u[i, 0]
        q[1] += h * model.share[i] * u[i, 1]


@inlined
def held_point(model, q):
    """Return the point of the robot that section VII-C holds, from the center of link 1 [m]."""
    x = y = held_x = held_y = reach_x = reach_y = 0.0
    for i in range(len(model.mass) if model.keeps_center else 0):
        step_x = model.half_length[i] * math.cos(q[2 + i])
        step_y = model.half_length[i] * math.sin(q[2 + i])
        if i > 0:
            x, y = x + reach_x + step_x, y + reach_y + step_y
        reach_x, reach_y = step_x, step_y
        held_x += model.share[i] * x
        held_y += model.share[i] * y
    return held_x, held_y
