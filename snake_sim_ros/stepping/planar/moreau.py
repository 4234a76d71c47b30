# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The step of `stepping.moreau` for a robot that lies flat: n+2 coordinates, exactly closed joints.

The robot in space moves like this one as long as its pitch references are zero and no contact
lifts off. Of eqs. (72)-(93) there remain the balance in the plane, for a chain with one hinge per
joint (`hinge_chain`), and friction at both spheres of every link. Since friction acts below the
centers of gravity, at the floor, two effects out of the plane remain:

- The normal loads follow from the friction, by the equilibrium of heave, roll and pitch of every
  link. They are not unique. The selection rule of the spatial level takes those of least norm,
  ``P_N = -W_N^T v`` for some v out of the plane. The sweeps that solve the dynamics find them, for
  a chain with springs of unit stiffness at its contacts.
- All links of a flat robot can still roll together, since the rank of the 2n normal directions is
  one short. Only the pitch joints hold the robot, at angles of about 1e-4 rad, which are neglected
  here. Their load is part of the equilibrium.

Deviation: inertia out of the plane is neglected, and so is that contacts slip across while the
robot rolls, by its radius times the change of the roll. This level is the limit of the spatial one
for pitch joints that become stiffer, and a normal compliance that falls with their stiffness. The
difference falls with the roll, which friction and springs determine. It matters where friction
moves the robot by little more than this slip: on slippery floors, and where a gait hardly
advances. `slips_too_far` therefore compares the slip of all steps with the way of the center of
mass.

The laws on the yaw axes are those of `dynamics.joint_laws`. The arrays of `joint_laws.AxisLaws`
are those of all axes, of which the first column is used. Pitch joints hold a flat robot;
`is_overloaded` says whether they could.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.closing import contacts_land, keep_closed, NONE
from snake_sim_ros.contact.problem import Outcome, Solver
from snake_sim_ros.contact.prox_iteration import joint_laws_change, MOST_CHANGES, Trial
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.dynamics.joint_laws import (
    begin_axis_impact,
    begin_joint_laws,
    controller_impulse,
    is_at_stop,
    linearize_axes,
)
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.planar.equilibrium import (
    close_pegs,
    fill_grips,
    fill_momentum,
    find_peg_contacts,
    peg_velocities,
    place_links_in_plane,
)
from snake_sim_ros.stepping.planar.model import PlanarMemory, PlanarModel, PlanarWorkspace
from snake_sim_ros.stepping.planar.solvers import solve_in_plane, yaw_joints, yaw_rates
from snake_sim_ros.stepping.pushes import add_pushes_in_plane, whole_step
from snake_sim_ros.stepping.state import of_contacts
from snake_sim_ros.stepping.steps import (
    count_steps,
    iterations_left,
    note_outcome,
    noted,
    Steps,
    take_step,
)

EFFORT_SHARE = 1 / 128  # share of a step in the mean of iterations
SLIP_MEMORY = 3.0  # time constant with which slip and way are forgotten [s]


@inlined
def hold_absent_yaw_axes(model: PlanarModel, work: PlanarWorkspace) -> None:
    """Fill the loads of yaw axes that a joint does not have; see `balance.hold_absent_axes`."""
    if model.complete:
        return
    for j in range(len(work.torque)):
        if model.side[j, 0] == 0.0:
            work.torque[j], work.chain.damping[j] = 0.0, 1.0


@inlined
def joint_impulses_in_plane(model: PlanarModel, work: PlanarWorkspace) -> bool:
    """Fill work.applied, the impulses of the controllers; return whether a joint meets a stop."""
    for j in range(len(work.applied)):
        rate = work.twist[j + 1, 0] - work.twist[j, 0]
        work.applied[j, 0] = work.torque[j] - work.chain.damping[j] * rate
        work.applied[j, 1] = -model.hold[j] * work.upright.rate[j]
    meets = False
    if model.joint_laws.present:
        for j in range(len(work.applied)):
            work.applied[j, 0] = controller_impulse(work.axes, j, 0)
            meets = meets or is_at_stop(model.joint_laws, work.axes, j, 0)
    return meets


@inlined
def begin_planar_impact(model: PlanarModel, work: PlanarWorkspace) -> None:
    """Fill the laws of the yaw joints in an impact, with the torques of the part before it."""
    laws, axes, loads = model.joint_laws, work.axes, (work.yaw_torque, work.yaw_damping)
    for j in range(len(work.torque)):
        begin_axis_impact(laws, axes, j, 0, work.torque[j], work.chain.damping[j])
    linearize_axes(laws, axes, loads)
    hold_absent_yaw_axes(model, work)


@inlined
def is_overloaded(model: PlanarModel, work: PlanarWorkspace) -> bool:
    """Return whether a pitch joint needs more than its limit and its friction to hold a robot."""
    laws = model.joint_laws
    if laws.present:
        h = model.dt * work.standing.part[0]
        for j in range(len(work.torque)):
            most = laws.torque_limit[j, 1] + laws.friction[j, 1]
            if most < math.inf and abs(model.hold[j] * work.upright.rate[j]) > h * most:
                return True
    return False


@inlined
def begin_planar_step(model: PlanarModel, work: PlanarWorkspace, steps: Steps, k: int) -> int:
    """
    Fill the workspace for the contact solver in step k, with the velocities at its start.

    Returns
    -------
    int
        Number of closed contacts: all with the floor, and those with pegs.

    """
    q, u, angle, rate = steps.q, steps.u, steps.angle[k], steps.rate[k]
    n, dt, chain = len(u), model.dt, work.chain
    for i in range(n):
        theta = q[2 + i] + dt / 2 * u[i, 2]
        work.heading[i, 0], work.heading[i, 1] = math.cos(theta), math.sin(theta)
    place_links_in_plane(model, work, model.fall)
    for j in range(n - 1):
        difference, turn = q[3 + j] - q[2 + j], u[j + 1, 2] - u[j, 2]
        torque, damping = pd_law(
            model.pd_scheme, dt, (difference, turn), (difference + dt / 2 * turn, turn),
            (angle[j, 0], rate[j, 0]), (model.stiffness[j], model.damping[j]),
        )  # fmt: skip
        work.torque[j], chain.damping[j] = torque * dt, damping * dt
        work.bend[j, 0, 0], work.bend[j, 0, 1] = difference + dt / 2 * turn, turn
    hold_absent_yaw_axes(model, work)
    if model.joint_laws.present:
        begin_joint_laws(
            model.joint_laws, work.axes, dt, work.bend, (work.yaw_torque, work.yaw_damping)
        )
    x, y = q[0] + dt / 2 * u[0, 0], q[1] + dt / 2 * u[0, 1]
    fill_grips(model.patches, model, work, x - work.center[0, 0], y - work.center[0, 1])
    fill_momentum(model, work, u, u)
    stretch = whole_step(steps.pushes, k)
    add_pushes_in_plane(steps.pushes, stretch, dt, work.heading, work.center, work.momentum)
    return model.floor + find_peg_contacts(model, work, q, u)


@inlined
def is_planar(model: PlanarModel, work: PlanarWorkspace, steps: Steps, outcome: Outcome) -> bool:
    """
    Return whether the solution of a step is planar, and all links turn by less than pi/2.

    Otherwise the report says which of both does not hold. work.standing is filled: a step is not
    planar, too, where loads follow friction so closely that the steps in the plane take more
    iterations than they save.
    """
    report, memory = steps.report[0], steps.history.memory
    memory.effort[0] += EFFORT_SHARE * (outcome.iterations - memory.effort[0])
    tires = memory.effort[0] > model.most_effort
    tires |= not outcome.converged and outcome.iterations > model.most_effort
    work.standing.slips[0], work.standing.tires[0] = 0, tires
    work.standing.overloaded[0] = is_overloaded(model, work)
    if not (
        (outcome.converged or model.patient)
        and work.standing.least_load[0] > 0.0
        and work.standing.overloaded[0] == 0
        and abs(work.standing.roll[0]) <= model.most_roll
        and not tires
    ):
        report.not_planar = 1
        return False
    if model.held and slips_too_far(model, work, memory):
        work.standing.slips[0] = report.not_planar = 1
        return False
    for i in range(len(work.twist)):
        turn = model.dt * abs(work.twist[i, 0])
        if not (turn < math.pi / 2 and math.isfinite(work.twist[i, 1] + work.twist[i, 2])):
            report.failed_link, report.failed_turn = i + 1, turn
            return False
    return True


@inlined
def slips_too_far(model: PlanarModel, work: PlanarWorkspace, memory: PlanarMemory) -> bool:
    """
    Return whether contacts slip too far by rolling; if not, add slip and way to the memory.

    Some slip is always neglected, since a gait begins with a roll and no way. In addition, a share
    of the way of the center of mass is neglected.
    """
    mass = p_x = p_y = 0.0
    for i in range(len(work.twist)):
        m, omega = model.mass[i], work.twist[i, 0]
        mass += m
        p_x += m * (work.twist[i, 1] - omega * work.center[i, 1])
        p_y += m * (work.twist[i, 2] + omega * work.center[i, 0])
    h = model.dt * work.standing.part[0]
    left = 1.0 / (1.0 + h / SLIP_MEMORY)
    turn = abs(work.standing.roll[0] - memory.roll[0])
    slip = left * memory.slip[0] + model.height * turn
    way = left * memory.way[0] + h * math.sqrt(p_x * p_x + p_y * p_y) / mass
    if not slip <= model.free_slip + model.most_slip * way:
        return True
    memory.roll[0], memory.slip[0], memory.way[0] = work.standing.roll[0], slip, way
    return False


@inlined
def end_planar_velocities(work: PlanarWorkspace, u: Array) -> None:
    """Fill u (n, 3) from the twists."""
    twist = work.twist
    for i in range(len(u)):
        u[i, 0] = twist[i, 1] - twist[i, 0] * work.center[i, 1]
        u[i, 1] = twist[i, 2] + twist[i, 0] * work.center[i, 0]
        u[i, 2] = twist[i, 0]


@inlined
def stop_impact(work: PlanarWorkspace) -> None:
    """Empty the momentum out of the plane, which the first step has stopped."""
    for i in range(len(work.impact)):
        for k in range(3):
            work.impact[i, k] = 0.0


@inlined
def end_planar_step(
    model: PlanarModel, work: PlanarWorkspace, steps: Steps, count: int, outcome: Outcome
) -> bool:
    """
    Move q and u to the end of the step, unless it is not planar or diverges.

    Returns
    -------
    bool
        Whether the step was taken.

    """
    q, u, report = steps.q, steps.u, steps.report[0]
    if not is_planar(model, work, steps, outcome):
        return False
    before_x, before_y = held_point(model, q)
    move_in_plane(model, 0.5 * model.dt, q, u)
    joint_impulses_in_plane(model, work)
    end_planar_velocities(work, u)
    stop_impact(work)
    move_in_plane(model, 0.5 * model.dt, q, work.moving)
    after_x, after_y = held_point(model, q)
    q[0] += before_x - after_x
    q[1] += before_y - after_y
    note_outcome(outcome, report)
    report.steps += 1
    report.contacts = count
    depth = close_pegs(model, work, work.closed[model.floor : count], q)
    report.penetration_max = max(report.penetration_max, depth)
    return True


@inlined
def move_in_plane(model: PlanarModel, h: float, q: Array, u: Array) -> None:
    """Move the headings for a time h [s], and the robot as the point that section VII-C holds."""
    for i in range(len(u)):
        q[2 + i] += h * u[i, 2]
    for i in range(len(u) if model.keeps_center else 1):
        q[0] += h * model.share[i] * u[i, 0]
        q[1] += h * model.share[i] * u[i, 1]


@inlined
def held_point(model: PlanarModel, q: Array) -> tuple[float, float]:
    """Return x and y of the point that section VII-C holds, from the center of link 1 [m]."""
    x = y = held_x = held_y = reach_x = reach_y = 0.0
    for i in range(len(model.mass) if model.keeps_center else 0):
        c, s = math.cos(q[2 + i]), math.sin(q[2 + i])
        if i > 0:
            x, y = x + reach_x + model.rear[i] * c, y + reach_y + model.rear[i] * s
        reach_x, reach_y = model.front[i] * c, model.front[i] * s
        held_x += model.share[i] * x
        held_y += model.share[i] * y
    return held_x, held_y


@inlined
def solve_planar_step(
    solver: Solver, model: PlanarModel, work: PlanarWorkspace, steps: Steps, count: int
) -> tuple[int, Outcome]:
    """
    Solve the first `count` contacts and, if links land on pegs, once more.

    As `stepping.moreau.solve_step`; return the contacts of the last solution, and its outcome.
    `work.moving` has the velocities that move the coordinates.
    """
    history, report, lands = of_contacts(steps.history), steps.report[0], False
    most, floor = report.iterations + model.iteration_limit, model.floor
    joints = yaw_joints(model, work)
    while True:  # one call of the solver, which is compiled where it is called
        for attempt in range(MOST_CHANGES):
            left = iterations_left(most, report)
            outcome = solve_in_plane(solver, model, work, work.closed[:count], history, left)
            trial = Trial(outcome.iterations, outcome.converged, attempt, left)
            yaw_rates(work)
            if not joint_laws_change(model.laws, work.contacts, joints, trial, report):
                break
        if lands:
            break
        end_planar_velocities(work, work.moving)
        if outcome.iterations >= left or not outcome.converged:
            break
        pegs = work.closed[floor:count]
        if not contacts_land(pegs, work.contacts):
            break
        kept = keep_closed(pegs, work.contacts, NONE)
        lands, count = True, floor + kept
        note_outcome(outcome, report)
        peg_velocities(pegs[:kept], work)
    return count, outcome


class PlanarMoreau(NamedTuple):
    """The step of the paper in the plane, with a contact solver; see `solvers.solve_in_plane`."""

    solver: Solver


@take_step.register(PlanarMoreau)
@inlined
def take_planar_step(
    own: PlanarMoreau, model: PlanarModel, work: PlanarWorkspace, steps: Steps, k: int, shows: bool
) -> tuple[bool, float]:
    """Take step k, unless it is not planar; see `steps.take_step`."""
    report = steps.report[0]
    before = noted(report)
    count = begin_planar_step(model, work, steps, k)
    count, outcome = solve_planar_step(own.solver, model, work, steps, count)
    goes_on = end_planar_step(model, work, steps, count, outcome)
    if goes_on:
        count_steps(before, report)
    return goes_on, model.dt
