"""
A method of second order: two-step differences in place of the paper's midpoint.

Deviation: the step of the paper takes its geometry at the middle, but friction, joint rates and
constraints at the velocity of the end. It is therefore of first order. Here all are taken at the
end. With ``q_hat = (4 q_n - q_(n-1))/3``, the same for u, and h = 2/3 dt (BDF2 [1]_),

    M u_E = M u_hat + h(q*, u*) h + W(q*) P,    q_E = q_hat + h F(q*) u_E,

where the star marks the predicted end, ``u* = 2 u_n - u_(n-1)``. The contact laws are unchanged.
They hold for u_E and are solved by Newton's method through the chain. Contacts that may close in
the step take part with their gaps; see `events`.

The formula never differentiates across an event, which is any jump of the velocity: a contact that
lands, however softly; a normal impulse beyond what forces make in a step (an impact without
collision); or a state that is not the end of the step before (a push, another scene). The step
after an event starts anew, in PARTS equal parts, the first with

    u_hat = u_n, h = dt for velocities;    q_hat = q_n + dt/2 F(q_n) u_n, h = dt/2 for coordinates,

which is exact for constant forces; for other forces each event adds an error of dt^2. If the
velocities of a given state violate the joints, the first part is the impact that corrects them:
backward Euler, ``q_hat = q_n`` and h = dt for both. The next part then starts anew.

.. [1] E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", 1996, ch. V.
"""

import math
from typing import Any

from snake_sim_ros.contact.detection import find_contacts
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.contact.newton import Newton
from snake_sim_ros.contact.newton import solve_contacts
from snake_sim_ros.contact.selection import apply_selection_rule
from snake_sim_ros.contact.solver import Problem
from snake_sim_ros.dynamics.balance import applied_torque
from snake_sim_ros.dynamics.balance import axis_loads
from snake_sim_ros.dynamics.balance import link_inertia
from snake_sim_ros.dynamics.balance import smooth_momentum
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import cycle_counter
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.joint_control import implicit_pd_law
from snake_sim_ros.dynamics.kinematics import chain_geometry
from snake_sim_ros.dynamics.kinematics import end_velocities
from snake_sim_ros.dynamics.kinematics import half_rotation
from snake_sim_ros.dynamics.kinematics import joint_coordinates
from snake_sim_ros.dynamics.kinematics import link_frames
from snake_sim_ros.dynamics.kinematics import rates_in_inertial_frame
from snake_sim_ros.dynamics.kinematics import twists
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.bdf2_memory import ANEW
from snake_sim_ros.stepping.bdf2_memory import keep
from snake_sim_ros.stepping.bdf2_memory import recognize
from snake_sim_ros.stepping.bdf2_memory import SMOOTH
from snake_sim_ros.stepping.bdf2_memory import UNKNOWN
from snake_sim_ros.stepping.events import closed_at_end
from snake_sim_ros.stepping.events import Events
from snake_sim_ros.stepping.events import events
from snake_sim_ros.stepping.events import LANDING_SPEED
from snake_sim_ros.stepping.events import leave_gaps
from snake_sim_ros.stepping.moreau import finish
from snake_sim_ros.stepping.moreau import turns_are_small
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.state import without_memory
from snake_sim_ros.stepping.steps import note_outcome

PARTS = 2  # parts of a step that starts anew
# Replaces `selection.PRESS_SPEED`, which is not small beside errors of second order: loads of a
# flat robot follow the heights of its links through the stiff joints, so that these must not sink.
PRESS_SPEED = 3e-8  # [m/s]

# Where the controller may act. For both the method takes it at the end of the step, linear about
# the predicted end.
IMPLICIT_SCHEMES = ('average', 'end')
# Where the spatial level is faster, by processor time of both levels in turn, in one process, in
# cases A and B. At the default tolerance `bdf2` with 11 links takes 0.6 to 0.85 of the planar time
# from 1/200 s to 1/20 s (5 links: 0.6 to 1.2), 1.1 at 1/500 s, and 1.3 and more at 1/1000 s. With
# 20 and 40 links it takes 1.05 to 14 times as long; with residual_tolerance 1e-5 m/s it takes 1.6
# to 1.9 times as long at 1/200 s, and 0.85 at 1/20 s. `newton` gains at most a quarter in space,
# and loses from 1/20 s on.
SPATIAL_STEP, SPATIAL_LINKS, SPATIAL_TOLERANCE = 1 / 300, 15, 1e-7  # [s], links, [m/s]


@merged
def formula(phase, dt, q, u, memory, own):
    """
    Fill q_hat, u_hat and u_star of a step from what is known of the motion before it.

    Parameters
    ----------
    phase : float
        UNKNOWN (backward Euler), ANEW or SMOOTH.
    dt : float
        Length of the step or of a part of it [s].
    q, u : ndarray, shapes (n, 7) and (n, 6)
        State at its start; `memory` has the one before.

    Returns
    -------
    h, h_q : float
        Times for which forces act on the velocity, and the velocity on the coordinates [s].

    """
    hat, u_hat, u_star = own.q_hat, own.u_hat, own.u_star
    smooth = phase == SMOOTH
    for i in range(len(q)):
        for k in range(7):
            hat[i, k] = (4.0 * q[i, k] - memory.q_before[i, k]) / 3.0 if smooth else q[i, k]
        for k in range(6):
            before = memory.u_before[i, k]
            u_hat[i, k] = (4.0 * u[i, k] - before) / 3.0 if smooth else u[i, k]
            u_star[i, k] = 2.0 * u[i, k] - before if smooth else u[i, k]
    if smooth:
        return 2.0 / 3.0 * dt, 2.0 / 3.0 * dt
    if phase == UNKNOWN:
        return dt, dt
    for i in range(len(q)):
        p = q[i, 3], q[i, 4], q[i, 5], q[i, 6]
        e0, e1, e2, e3 = half_rotation(p, (u[i, 3], u[i, 4], u[i, 5]), dt / 4)
        hat[i, 3], hat[i, 4], hat[i, 5], hat[i, 6] = e0, e1, e2, e3
        for k in range(3):
            hat[i, k] += dt / 2 * u[i, k]
    return dt, dt / 2


@merged
def predicted_frames(h_q, q, memory, smooth, own, work):
    """Fill work.q_mid with the predicted end of the step, and R and omega with those of it."""
    star = work.q_mid
    for i in range(len(q)):
        for k in range(7):
            star[i, k] = 2.0 * q[i, k] - memory.q_before[i, k] if smooth else q[i, k]
        advance_link(h_q, star, own.q_hat, own.u_star, star, i)
    link_frames(star[:, 3:], work.R)
    rates_in_inertial_frame(work.R, own.u_star, work.omega)


@merged
def begin(model, own, work, h, h_q, late, history):
    """
    Return the contact problem for the predicted end of the step.

    Its closed contacts are those that can close in the step. h and h_q are those of `formula`, and
    `late` is as in `events.leave_gaps`.
    """
    angle, rate = own.end_angle, own.end_rate
    chain_geometry(model.half_length, work.R, work.center, work.chain.axis)
    joint_coordinates(work.R, work.omega, work.coordinate[1])
    for j in range(len(angle)):
        for k in range(2):
            torque, damping = implicit_pd_law(
                h_q, work.coordinate[1, j, k, 0], work.coordinate[1, j, k, 1],
                (angle[j, k], rate[j, k]), model.stiffness[j, k], model.damping[j, k],
            )  # fmt: skip
            work.torque[j, k], work.damping[j, k] = torque * h, damping * h
    axis_loads(work.chain.axis, work.torque, work.damping, work.chain.torque, work.chain.damping)
    link_inertia(model, work.R, work.center, work.chain.bare)
    smooth_momentum(model, h, own.u_hat, own.u_star, work.R, work.center, work.chain.momentum)

    twists(own.u_star, work.omega, work.center, work.chain.twist)
    reach = max(model.activation_tolerance, LANDING_SPEED * h_q)
    count = find_contacts(model.obstacles, reach, model, work, work.q_mid)
    closed, contacts = work.closed[:count], work.contacts
    contact_velocities(closed, contacts, work.chain.frame, work.chain.twist)
    leave_gaps(model, h_q, late, closed, contacts, history.impulse)
    laws = apply_selection_rule(
        model.laws, closed, contacts, model.mass, history.impulse, PRESS_SPEED, model.dt,
        -h * model.gravity[2],
    )  # fmt: skip
    return Problem(laws, closed, contacts, work.chain)


@compiled
def advance_link(h, frame, hat, u, q, i):
    """Fill q of link i with ``hat + h F(frame) u``, with Euler parameters of length 1."""
    p = frame[i, 3], frame[i, 4], frame[i, 5], frame[i, 6]
    e = half_rotation(p, (u[i, 3], u[i, 4], u[i, 5]), h / 2)
    for k in range(3):
        q[i, k] = hat[i, k] + h * u[i, k]
    e0, e1 = hat[i, 3] + e[0] - p[0], hat[i, 4] + e[1] - p[1]
    e2, e3 = hat[i, 5] + e[2] - p[2], hat[i, 6] + e[3] - p[3]
    s = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    q[i, 3], q[i, 4], q[i, 5], q[i, 6] = s * e0, s * e1, s * e2, s * e3


@merged
def solve_landing(model, own, work, problem, h, h_q, history, report):
    """
    Solve the contacts and, if they land, once more without their gaps.

    The velocity that moves the coordinates is then in own.u_star, and the velocity after the
    impact in the twists of the chain.

    Returns
    -------
    small : bool
        Whether `turns_are_small`.
    found : Events

    """
    laws, closed, contacts, chain = problem
    found = Events(False, False, 0)
    for again in range(2):  # one call of the solver, which is compiled where it is called
        landing = Problem(laws, closed, contacts, chain)
        outcome = solve_contacts(Newton(None), model, landing, history)
        note_outcome(outcome, report)
        if not turns_are_small(model.dt, chain.twist, report):
            return False, found
        if again:
            break
        end_velocities(chain.twist, work.R, work.center, own.u_star)
        found = events(model, h, closed, contacts)
        if not found.lands:
            break
        closed = closed[: closed_at_end(h_q, model.activation_tolerance, closed, contacts)]
    return True, found


@inlined
def end_references(dt, part, known, angle, rate, memory, own):
    """
    Fill the joint references at the end of part `part` of PARTS, from those at the middle.

    They are extrapolated with their mean acceleration since the step before, if that is known.
    """
    late = dt * (part / PARTS - 0.5)
    for j in range(len(angle)):
        for axis in range(2):
            acceleration = (rate[j, axis] - memory.rate[j, axis]) / dt if known else 0.0
            own.end_rate[j, axis] = rate[j, axis] + late * acceleration
            mean = rate[j, axis] + 0.5 * late * acceleration
            own.end_angle[j, axis] = angle[j, axis] + late * mean


@merged
def one_part(own, model, work, dt, steps):
    """
    Advance q, u and history by dt, a step or a part of it, to the references in own.end_angle.

    Returns
    -------
    int
        1 if there was an event, 0 if not, -1 if the part diverged; q and u are then unchanged.

    """
    q, u, report, history = steps.q, steps.u, steps.report[0], steps.history
    n, memory = len(q), history.memory
    phase, span = memory.phase[0], memory.span[0]
    h, h_q = formula(phase, dt, q, u, memory, own)
    predicted_frames(h_q, q, memory, phase == SMOOTH, own, work)
    scale = h / (span if span > 0.0 else model.dt)
    for a in range(len(history.impulse)):
        for j in range(5):
            history.impulse[a, j] *= scale
        history.change[a, 0] *= scale

    contact_history = without_memory(history)
    problem = begin(model, own, work, h, h_q, dt - h_q, contact_history)
    small, found = solve_landing(model, own, work, problem, h, h_q, contact_history, report)
    if not small:
        return -1
    report.contacts = found.closed
    applied_torque(work.R, work.chain.twist, work.torque, work.damping, work.applied)
    for j in range(n - 1):
        for axis in range(2):
            work.applied[j, axis] *= model.dt / h
    if found.jumps:
        for a in range(len(history.change)):
            for j in range(5):
                history.change[a, j] = 0.0

    keep(q, u, memory.q_before, memory.u_before)
    for i in range(n):
        advance_link(h_q, work.q_mid, own.q_hat, own.u_star, q, i)
    end_velocities(work.chain.twist, work.R, work.center, u)
    memory.span[0] = h
    memory.phase[0] = ANEW if found.jumps or phase == UNKNOWN else SMOOTH
    return 1 if found.jumps else 0


@merged
def step(own, model, work, steps, k):
    """Take step k; return whether the loop continues."""
    q, u, report, memory = steps.q, steps.u, steps.report[0], steps.history.memory
    angle, rate = steps.angle[k], steps.rate[k]
    known, smooth = memory.span[0] > 0.0, memory.phase[0] == SMOOTH
    parts, event = 1 if smooth else PARTS, memory.phase[0] == UNKNOWN
    unconverged, fallbacks = report.unconverged, report.fallbacks
    keep(q, u, own.q_start, own.u_start)
    for part in range(PARTS - parts, PARTS):
        end_references(model.dt, part + 1, known, angle, rate, memory, own)
        outcome = one_part(own, model, work, model.dt / parts, steps)
        if outcome < 0:
            keep(own.q_start, own.u_start, q, u)
            return False
        event = event or outcome > 0
    for j in range(len(rate)):
        for axis in range(2):
            memory.rate[j, axis] = rate[j, axis]
    if not smooth:
        keep(own.q_start, own.u_start, memory.q_before, memory.u_before)
    memory.phase[0] = ANEW if event else SMOOTH
    report.unconverged = min(report.unconverged, unconverged + 1)  # steps, not parts of them
    report.fallbacks = min(report.fallbacks, fallbacks + 1)
    return finish(model, work.chain.twist, q, u, steps.history.settling, report)


@compiled
def advance(own, model, work, steps):
    """Take the steps up to the first that diverges; see `spatial.SpatialStepper`."""
    q, u, memory = steps.q, steps.u, steps.history.memory
    recognize(model, work, q, u, memory)
    for k in range(len(steps.angle)):
        steps.cycles[k] = cycle_counter()
        if not step(own, model, work, steps, k):
            break
    keep(q, u, memory.q, memory.u)
    steps.cycles[len(steps.angle)] = cycle_counter()


def what_is_not_possible(scene: Scene) -> str:
    """Return why the method cannot run a scene, as a sentence; empty if it can."""
    if scene.pd_scheme in IMPLICIT_SCHEMES:
        return ''
    return (
        f'pd_scheme {scene.pd_scheme} is explicit, and method bdf2 takes the controller at the '
        f'end of a step; choose pd_scheme {" or ".join(IMPLICIT_SCHEMES)}, or method newton'
    )


def is_faster_in_space(scene: Scene) -> bool:
    """Return whether the spatial level takes less time for a planar scene; see SPATIAL_STEP."""
    return (
        scene.dt > SPATIAL_STEP
        and scene.robot.link_count <= SPATIAL_LINKS
        and scene.solver.residual_tolerance < SPATIAL_TOLERANCE
    )


def where_impulses_acted(scene: Scene, state: State, memory: Any) -> tuple[Array, float]:
    """
    Return the coordinates (n, 7) at which the last impulses acted, and for how long [s].

    They acted at the end of the step, up to the error of its prediction. The memory of either
    level keeps the time; if it is empty, as after a change of the scene, it is the whole step.
    """
    span = memory.last_span() if memory else 0.0  # None: of another method
    return state.q, span or scene.dt
