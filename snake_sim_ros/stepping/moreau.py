"""
The time step of the paper [1] compiled, with the joints eliminated in one sweep over the links.

The step is that of `reference.py`, whose docstrings name the equations. What differs is the
algebra: W_J and P_J never appear. The velocities that satisfy ``W_J^T u_E = 0`` are those of a
chain of links with two hinge axes a joint, and the articulated-body algorithm [2] solves the
balance (75) for them in one sweep from both ends to the middle link and one back: the work grows
with the number of links.

A twist is (angular velocity, velocity of the body point at O), an impulse wrench is (moment about
O, impulse), both in axes of I. O is common to all links: nothing is transformed in the sweeps.
Because (75) and the joint constraint need only directions, O and the link centers may be placed as
if the joints were closed exactly.

.. [1] Transeth, Leine, Glocker, Pettersen, IEEE T-RO 24(2), 2008.
.. [2] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer 2008, ch. 7.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.contact.contacts import contact_velocities
from snake_sim_ros.contact.contacts import Laws
from snake_sim_ros.contact.contacts import make_disc
from snake_sim_ros.contact.contacts import selected
from snake_sim_ros.contact.delassus import make_delassus
from snake_sim_ros.contact.detection import contacts_of
from snake_sim_ros.contact.detection import deepest
from snake_sim_ros.contact.detection import make_obstacles
from snake_sim_ros.contact.detection import make_other_friction
from snake_sim_ros.contact.detection import Obstacles
from snake_sim_ros.contact.linear_laws import NOTED
from snake_sim_ros.contact.projections import LEAST
from snake_sim_ros.contact.projections import PRESS
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.dynamics.force_directions import mean_delassus
from snake_sim_ros.dynamics.joint_control import pd_law
from snake_sim_ros.dynamics.joint_control import START
from snake_sim_ros.dynamics.kinematics import chain_geometry
from snake_sim_ros.dynamics.kinematics import close_joints
from snake_sim_ros.dynamics.kinematics import end_coordinates
from snake_sim_ros.dynamics.kinematics import end_velocities
from snake_sim_ros.dynamics.kinematics import joint_coordinates
from snake_sim_ros.dynamics.kinematics import joint_violation
from snake_sim_ros.dynamics.kinematics import lies_flat_and_still
from snake_sim_ros.dynamics.kinematics import link_frames
from snake_sim_ros.dynamics.kinematics import middle_coordinates
from snake_sim_ros.dynamics.kinematics import rates_in_inertial_frame
from snake_sim_ros.dynamics.kinematics import twists
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.obstacles import is_flat
from snake_sim_ros.scene.obstacles import pairs
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import DRIFT_CORRECTIONS
from snake_sim_ros.scene.parameters import PD_SCHEMES
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.base import check_arguments
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import SETTLING
from snake_sim_ros.stepping.base import State
from snake_sim_ros.stepping.report import CONTACTS
from snake_sim_ros.stepping.report import FAILED_LINK
from snake_sim_ros.stepping.report import FAILED_VALUE
from snake_sim_ros.stepping.report import GAP_MAX
from snake_sim_ros.stepping.report import note_outcome
from snake_sim_ros.stepping.report import PENETRATION
from snake_sim_ros.stepping.report import report_from
from snake_sim_ros.stepping.report import REPORT_SIZE
from snake_sim_ros.stepping.report import STEPS
from snake_sim_ros.stepping.report import TWIST_MAX

COLUMNS = NOTED + 1  # of the table of contacts
# Compliance of the proximal point method, relative to the Delassus operator: it changes no
# solution. Smaller is closer to the laws in one iteration, and loses digits to rounding.
PROXIMAL = 1e-5


class Model(NamedTuple):
    """The numbers of a scene as the compiled step takes them; names as in `parameters`."""

    half_length: Array
    mass: Array
    inertia_transversal: Array
    inertia_axial: Array
    contact_offset: Array
    contact_radius: Array
    stiffness: Array
    damping: Array
    gravity: Array
    laws: Laws
    activation_tolerance: float
    dt: float
    tolerance: float
    residual_tolerance: float
    iteration_limit: int
    pd_scheme: int
    drift_correction: int
    settle_steps: int  # steps to lie flat and still before the loop ends; 0 does not watch for it
    obstacles: Obstacles | None  # None: a flat floor


class Workspace(NamedTuple):
    """Arrays that the step fills, made once."""

    q_mid: Array  # (n, 7) coordinates at the middle of the step, Euler parameters not normalized
    R: Array  # (n, 3, 3) link frames in I
    omega: Array  # (n, 3) angular velocities at the start of the step, in I
    center: Array  # (n, 3) link centers from O
    coordinate: Array  # (2, n-1, 2, 2) joint (yaw, pitch) x (angle, rate), at start and middle
    torque: Array  # (n-1, 2) impulse of the controller, without its implicit part [N m s]
    damping: Array  # (n-1, 2) implicit part of the controller, times dt [N m s^2]
    applied: Array  # (n-1, 2) impulse of the controller with its implicit part [N m s]
    q_hat: Array  # (n, 7), u_hat, u_star (n, 6), q_start (n, 7), u_start (n, 6),
    u_hat: Array  # end_angle, end_rate (n-1, 2): see bdf2
    u_star: Array
    q_start: Array
    u_start: Array
    end_angle: Array
    end_rate: Array
    chain: Chain
    contact: Array  # (c,) indices of the closed contacts of c
    table: Array  # (c, COLUMNS) see contacts and newton


@merged
def joint_control(model, coordinate, angle, rate, torques, dampings):
    """Fill the impulses and the implicit damping of the controller on every joint axis."""
    start, mid = coordinate[0], coordinate[1]
    for j in range(len(torques)):
        for k in range(2):
            torque, damping = pd_law(
                model.pd_scheme,
                model.dt,
                (start[j, k, 0], start[j, k, 1]),
                (mid[j, k, 0], mid[j, k, 1]),
                (angle[j, k], rate[j, k]),
                model.stiffness[j, k],
                model.damping[j, k],
            )
            torques[j, k] = torque * model.dt
            dampings[j, k] = damping * model.dt


@inlined
def axis_loads(axis, torque, damping, axis_torque, axis_damping):
    """
    Fill what the controller does to the rates s of the joint axes.

    The axes a, b of a joint are at right angles only up to the drift of a step, c = a . b. A
    relative angular velocity s_1 a + s_2 b has the joint rates J s with J = [[1, c], [c, 1]], so a
    torque T is J T on the axes and a damping K is J K J.
    """
    for j in range(len(axis)):
        c = 0.0
        for k in range(3):
            c += axis[j, 0, k] * axis[j, 1, k]
        axis_torque[j, 0] = torque[j, 0] + c * torque[j, 1]
        axis_torque[j, 1] = torque[j, 1] + c * torque[j, 0]
        axis_damping[j, 0] = damping[j, 0] + c * c * damping[j, 1]
        axis_damping[j, 1] = c * (damping[j, 0] + damping[j, 1])
        axis_damping[j, 2] = damping[j, 1] + c * c * damping[j, 0]


@inlined
def applied_torque(R, twist, torque, damping, applied):
    """Fill the impulse of the controller on every joint, with the rates at the end of the step."""
    for j in range(len(torque)):
        yaw_rate = pitch_rate = 0.0
        for k in range(3):
            relative = twist[j + 1, k] - twist[j, k]
            yaw_rate += R[j, k, 1] * relative
            pitch_rate += R[j + 1, k, 0] * relative
        applied[j, 0] = torque[j, 0] - damping[j, 0] * yaw_rate
        applied[j, 1] = torque[j, 1] - damping[j, 1] * pitch_rate


@inlined
def link_inertia(model, R, center, inertia):
    """Fill the 6x6 inertia of every link about O, eqs. (47), (48)."""
    for i in range(len(R)):
        m, transversal = model.mass[i], model.inertia_transversal[i]
        slender = model.inertia_axial[i] - transversal
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        square = x * x + y * y + z * z
        A = inertia[i]
        for k in range(3):
            for j in range(3):
                A[k, j] = slender * R[i, k, 2] * R[i, j, 2] - m * center[i, k] * center[i, j]
                A[k + 3, j + 3] = 0.0
            A[k, k] += transversal + m * square
            A[k + 3, k + 3] = m
            A[k, k + 3] = A[k + 3, k] = 0.0
        A[0, 4] = A[4, 0] = -m * z
        A[0, 5] = A[5, 0] = m * y
        A[1, 3] = A[3, 1] = m * z
        A[1, 5] = A[5, 1] = -m * x
        A[2, 3] = A[3, 2] = -m * y
        A[2, 4] = A[4, 2] = m * x


@inlined
def smooth_momentum(model, dt, u, u_h, R, center, momentum):
    """Fill M u + h(u_h) dt of every link as an impulse wrench about O, eq. (75)."""
    for i in range(len(u)):
        slender = (model.inertia_axial[i] - model.inertia_transversal[i]) * dt
        wx, wy, wz = u_h[i, 3], u_h[i, 4], u_h[i, 5]
        lx = model.inertia_transversal[i] * u[i, 3] - slender * wy * wz
        ly = model.inertia_transversal[i] * u[i, 4] + slender * wz * wx
        lz = model.inertia_axial[i] * u[i, 5]
        px = model.mass[i] * (u[i, 0] + dt * model.gravity[0])
        py = model.mass[i] * (u[i, 1] + dt * model.gravity[1])
        pz = model.mass[i] * (u[i, 2] + dt * model.gravity[2])
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        momentum[i, 0] = R[i, 0, 0] * lx + R[i, 0, 1] * ly + R[i, 0, 2] * lz + y * pz - z * py
        momentum[i, 1] = R[i, 1, 0] * lx + R[i, 1, 1] * ly + R[i, 1, 2] * lz + z * px - x * pz
        momentum[i, 2] = R[i, 2, 0] * lx + R[i, 2, 1] * ly + R[i, 2, 2] * lz + x * py - y * px
        momentum[i, 3], momentum[i, 4], momentum[i, 5] = px, py, pz


@inlined
def begin_step(model, work, q, u, impulse, angle, rate):
    """
    Fill all that a contact solver needs, section VII; velocities are those of the start.

    Returns
    -------
    count : int
        Closed contacts.
    laws : Laws
        Contact laws of this step.

    """
    R, chain = work.R, work.chain
    middle_coordinates(model.dt, q, u, work.q_mid)
    if model.pd_scheme == START:
        link_frames(q[:, 3:], R)
        rates_in_inertial_frame(R, u, work.omega)
        joint_coordinates(R, work.omega, work.coordinate[0])
    link_frames(work.q_mid[:, 3:], R)
    rates_in_inertial_frame(R, u, work.omega)
    joint_coordinates(R, work.omega, work.coordinate[1])
    chain_geometry(model.half_length, R, work.center, chain.axis)
    joint_control(model, work.coordinate, angle, rate, work.torque, work.damping)
    axis_loads(chain.axis, work.torque, work.damping, chain.torque, chain.damping)
    link_inertia(model, R, work.center, chain.bare)
    smooth_momentum(model, model.dt, u, u, R, work.center, chain.momentum)
    twists(u, work.omega, work.center, chain.twist)
    count = contacts_of(model.obstacles, model.activation_tolerance, model, work, work.q_mid)
    contact = work.contact[:count]
    contact_velocities(contact, work.table, chain.frame, chain.twist)
    fall = -model.dt * model.gravity[2]
    return count, selected(
        model.laws, contact, work.table, model.mass, impulse, PRESS, model.dt, fall
    )


@inlined
def end_step(model, work, q, u, history, count, outcome, report):
    """
    Move q and u to the end of the step with the twists of the chain; return False if it diverged.

    Parameters
    ----------
    outcome : tuple
        What a contact solver returns: iterations, whether they converged, the residual with and
        without the selection rule [m/s], and whether the solver fell back on a slower method.

    """
    if not turns_are_small(model.dt, work.chain.twist, report):
        history[:] = 0.0
        return False
    applied_torque(work.R, work.chain.twist, work.torque, work.damping, work.applied)
    end_velocities(work.chain.twist, work.R, work.center, u)
    end_coordinates(model.dt, work.q_mid, u, q)
    note_outcome(outcome, report)
    report[CONTACTS] = count
    return finish(model, work.chain.twist, q, u, history, report)


@inlined
def turns_are_small(dt, twist, report):
    """Return whether no link turns further in a step than is resolved; report the first if not."""
    for i in range(len(twist)):
        turn = dt * math.sqrt(twist[i, 0] ** 2 + twist[i, 1] ** 2 + twist[i, 2] ** 2)
        if not (turn < math.pi / 2 and math.isfinite(twist[i, 3] + twist[i, 4] + twist[i, 5])):
            report[FAILED_LINK], report[FAILED_VALUE] = i + 1, turn
            return False
    return True


@inlined
def finish(model, twist, q, u, history, report):
    """
    Close the joints at the end of a step, and report how it was.

    Returns
    -------
    bool
        Whether to go on: not if the robot is watched, and has lain flat and still for long enough.

    """
    gap, violation = joint_violation(model.half_length, q)
    close_joints(model.drift_correction, model.half_length, model.mass, q)
    report[STEPS] += 1
    depth = deepest(model.obstacles, model.contact_offset, model.contact_radius, q)
    report[PENETRATION] = max(report[PENETRATION], depth)
    report[GAP_MAX] = max(report[GAP_MAX], gap)
    report[TWIST_MAX] = max(report[TWIST_MAX], violation)
    if model.settle_steps == 0:
        return True
    lies = lies_flat_and_still(model.contact_offset, model.contact_radius, q, u, twist)
    left = history[SETTLING] - 1.0 if lies else model.settle_steps
    history[SETTLING] = left
    return left > 0.0


def make_model(scene: Scene) -> Model:
    """Return the numbers of a scene as the compiled step takes them."""
    robot, friction, solver = scene.robot, scene.friction, scene.solver
    size = mean_delassus(robot)
    laws = Laws(
        sliding=make_disc(1, friction.longitudinal, friction.transversal, PROXIMAL * size),
        rolling=make_disc(3, friction.rolling, friction.rolling, PROXIMAL * size),
        compliance=solver.normal_compliance * size,
        least=LEAST * size,
        proximal=PROXIMAL * size,
        r_N=solver.r_normal,
        r_T=solver.r_sliding,
        r_V=solver.r_rolling,
        other=make_other_friction(scene, PROXIMAL * size),
    )
    return Model(
        half_length=robot.per_link('link_length') / 2,
        mass=robot.per_link('link_mass'),
        inertia_transversal=robot.per_link('inertia_transversal'),
        inertia_axial=robot.per_link('inertia_axial'),
        contact_offset=robot.per_link('contact_offset'),
        contact_radius=robot.per_link('contact_radius'),
        stiffness=robot.per_joint('stiffness'),
        damping=robot.per_joint('damping'),
        gravity=np.array(scene.gravity),
        laws=laws,
        activation_tolerance=solver.activation_tolerance,
        dt=scene.dt,
        tolerance=solver.tolerance,
        residual_tolerance=solver.residual_tolerance,
        iteration_limit=solver.iteration_limit,
        pd_scheme=PD_SCHEMES.index(scene.pd_scheme),
        drift_correction=DRIFT_CORRECTIONS.index(scene.drift_correction),
        settle_steps=0,
        obstacles=make_obstacles(scene),
    )


def make_workspace(scene: Scene) -> Workspace:
    """Return the arrays of the compiled step for a scene."""
    n, count, zeros = scene.robot.link_count, contact_count(scene), np.zeros
    return Workspace(
        q_mid=zeros((n, 7)),
        R=zeros((n, 3, 3)),
        omega=zeros((n, 3)),
        center=zeros((n, 3)),
        coordinate=zeros((2, n - 1, 2, 2)),
        torque=zeros((n - 1, 2)),
        damping=zeros((n - 1, 2)),
        applied=zeros((n - 1, 2)),
        q_hat=zeros((n, 7)),
        u_hat=zeros((n, 6)),
        u_star=zeros((n, 6)),
        q_start=zeros((n, 7)),
        u_start=zeros((n, 6)),
        end_angle=zeros((n - 1, 2)),
        end_rate=zeros((n - 1, 2)),
        chain=Chain(
            axis=zeros((n - 1, 2, 6)),
            torque=zeros((n - 1, 2)),
            damping=zeros((n - 1, 3)),
            bare=zeros((n, 6, 6)),
            momentum=zeros((n, 6)),
            inertia=zeros((n, 6, 6)),
            wrench=zeros((n, 6)),
            left=zeros((n - 1, 2, 6)),
            right=zeros((n - 1, 2, 6)),
            compliance=zeros((n - 1, 4)),
            load=zeros((n - 1, 2)),
            rate=zeros((n - 1, 2)),
            rate_correction=zeros((n - 1, 2)),
            left_over=zeros((n - 1, 2)),
            twist=zeros((n, 6)),
            correction=zeros((n, 6)),
            no_torque=zeros((n - 1, 2)),
            frame=None if is_flat(scene) else zeros((count, 3, 3)),
            pairs=make_delassus(5 * len(pairs(scene))) if scene.self_contact else None,
        ),
        contact=np.zeros(count, np.int64),
        table=zeros((count, COLUMNS)),
    )


class SpatialStepper:
    """
    A compiled contact solver in the time step of the paper; see `base.Stepper`.

    Parameters
    ----------
    scene : Scene
    loop : callable
        Compiled ``advance(model, work, q, u, history, angle, rate, report, cycles)``: advances q,
        u and history in place by one step a reference, up to the first that diverges, and fills
        cycles with the time stamps between the steps. What else it takes is bound before: a type
        of work that all loops share is compiled once.

    """

    level = 'spatial'

    def __init__(self, scene: Scene, loop: Callable[..., None]) -> None:
        self.model = make_model(scene)
        self.work = make_workspace(scene)
        self.loop = loop
        self.cycles = np.zeros(1, np.int64)

    def watch(self, settle_steps: int) -> None:
        """Let `advance` end early when the robot has lain flat and still for that many steps."""
        self.model = self.model._replace(settle_steps=settle_steps)

    def advance(
        self, state: State, history: Array, angle: Array, rate: Array
    ) -> tuple[State, Array, Report]:
        """Return state, history and report after as many steps as there are references."""
        counts = len(self.model.mass), len(self.work.contact)
        check_arguments(*counts, state, history, angle, rate)
        q, u, history = state.q.copy(), state.u.copy(), history.copy()
        numbers, self.cycles = np.zeros(REPORT_SIZE), np.zeros(len(angle) + 1, np.int64)
        angle, rate = np.ascontiguousarray(angle), np.ascontiguousarray(rate)
        self.loop(self.model, self.work, q, u, history, angle, rate, numbers, self.cycles)
        return State(q, u), history, report_from(numbers, self.work.applied, self.model.dt)
