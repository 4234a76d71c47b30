"""
The methods that set-valued contact laws are held against, and that are still in use.

- Regularized contact in a semi-implicit Euler step of fixed size (`make_semi_implicit`).
- A friction pyramid in place of the ellipse (`make_pyramid`).
- Regularized contact as a smooth differential equation for the integrators of SciPy, with steps of
  their own choice (`integrate`).

They have no names among `methods.METHODS`: they are no methods for a robot, but the other side of
a comparison. The first two run in a `simulation.Simulation` that is given their stepper.
"""

from dataclasses import astuple
from dataclasses import dataclass
from functools import partial
import math
import time
from typing import Any
import warnings

import numpy as np
from scipy.integrate import BDF
from scipy.integrate import LSODA
from scipy.integrate import Radau
from scipy.integrate import RK45

from snake_sim_ros.comparison.baselines import minimal_coordinates
from snake_sim_ros.comparison.baselines import penalty as regularized
from snake_sim_ros.comparison.baselines.pyramid import Pyramid
from snake_sim_ros.comparison.course import Course
from snake_sim_ros.comparison.course import SAMPLE
from snake_sim_ros.contact.delassus import make_delassus
from snake_sim_ros.dynamics.energy import imbalance
from snake_sim_ros.dynamics.energy import mechanical_energy
from snake_sim_ros.scene.checked_records import CheckedRecord
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.checked_records import quantity
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import joint_angles
from snake_sim_ros.scene.posture import joint_rates
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping import moreau
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.model import make_model
from snake_sim_ros.stepping.model import make_workspace
from snake_sim_ros.stepping.spatial import SpatialStepper
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.state import State

INTEGRATORS: dict[str, Any] = {'RK45': RK45, 'LSODA': LSODA, 'Radau': Radau, 'BDF': BDF}
STEP = 1e-8  # of differences, in the unit of each number: less than a link sinks in
LAWS = ('tanh', 'rational')
BATCH = 1000  # states whose energies are evaluated together


@dataclass(frozen=True, kw_only=True)
class Penalty(CheckedRecord):
    """
    Regularized contact: a spring-damper for each sphere, friction that is smooth at rest.

    ``F_N = max(0, -k g - d gamma_N)`` for gaps g < 0, with ``d = 2 zeta sqrt(k m/2)``: a link of
    mass m has two spheres. ``F_T = -F_N diag(mu) w/|w| phi(|w|/(mu_max eps))`` with ``w = diag(mu)
    gamma_T``, and phi(s) = tanh(s) or s/(1 + s). The sliding velocity eps is that of the direction
    of largest friction; in the other one it is mu_max/mu times as large.
    """

    law: str = quantity('tanh', '', 'how friction grows with the sliding velocity', choices=LAWS)
    sliding_velocity: float = quantity(
        1e-3, 'm/s', 'sliding velocity eps at which friction is about to be that of Coulomb',
        above=0,
    )  # fmt: skip
    stiffness: float = quantity(1e5, 'N/m', 'stiffness k of each contact sphere', above=0)
    damping_ratio: float = quantity(
        1.0, '1', 'damping ratio zeta of half a link on the spring of one sphere', minimum=0
    )


def make_law(penalty: Penalty) -> regularized.PenaltyLaw:
    """Return the numbers of a penalty as compiled functions take them."""
    return regularized.PenaltyLaw(
        rational=penalty.law == 'rational',
        sliding_velocity=penalty.sliding_velocity,
        stiffness=penalty.stiffness,
        damping_ratio=penalty.damping_ratio,
    )


def refuse_rolling(scene: Scene) -> None:
    """Raise if a scene has rolling friction, which no baseline knows."""
    if scene.friction.rolling > 0.0:
        raise ParameterError(
            f'friction.rolling must be 0 for a baseline, got {scene.friction.rolling:g}'
        )


def make_semi_implicit(scene: Scene, penalty: Penalty) -> Stepper:
    """
    Return a stepper of regularized contact: the paper's step with contact forces that are known.

    Forces are explicit, so the step is limited by the contacts: on a spring of angular frequency
    omega without damping, dt < 2/omega. Every step counts as converged; the residual says how far
    forces and velocities are from the set-valued laws.

    Raises
    ------
    ParameterError
        If the scene has rolling friction.

    """
    refuse_rolling(scene)
    return SpatialStepper(scene, partial(moreau.advance, make_law(penalty)))


def make_pyramid(scene: Scene) -> Stepper:
    """
    Return a stepper of the paper's step whose friction is bounded in each direction alone.

    The residual is that of these laws, the printed one that of Coulomb's; see `pyramid`.

    Raises
    ------
    ParameterError
        If the scene has rolling friction.

    """
    refuse_rolling(scene)
    solver = Pyramid(make_delassus(3 * contact_count(scene)))
    return SpatialStepper(scene, partial(moreau.advance, solver))


class SmoothRobot:
    """
    The regularized model of a scene as an ordinary differential equation dy/dt = f(t, y).

    Its numbers y, 15 + 4 (n-1) of them, are: center [m, frame I] and Euler parameters of the
    middle link, all joint angles (yaw, pitch) [rad]; velocity [m/s, frame I] and angular velocity
    [rad/s, frame B] of the middle link, all joint rates [rad/s]; work of the joints and of the
    contacts [J]. The controllers follow the gait of the scene at all times.

    Attributes
    ----------
    evaluations : int
        How often f was evaluated.

    """

    def __init__(self, scene: Scene, penalty: Penalty) -> None:
        refuse_rolling(scene)
        self.model, self.law = make_model(scene), make_law(penalty)
        self.work = make_workspace(scene)
        n = scene.robot.link_count
        self.motion = minimal_coordinates.Motion(np.zeros((n, 6)), np.zeros((n, 6)))
        gait = scene.gait
        self.waves = (astuple(gait.yaw), astuple(gait.pitch)), gait.soft_start
        self.middle, self.evaluations = scene.robot.middle_link, 0

    def coordinates(self, state: State) -> Array:
        """Return y of a state whose joints are closed, without work."""
        root = self.middle
        angle, rate = joint_angles(state.q), joint_rates(state.q, state.u)
        parts = state.q[root], angle.ravel(), state.u[root], rate.ravel(), np.zeros(2)
        return np.concatenate(parts)

    def rates(self, t: float, rows: Array) -> Array:
        """Return f(t, y) for all rows y of shape (k, m)."""
        rates = np.empty_like(rows)
        minimal_coordinates.rates_of_change(
            self.model, self.law, self.waves, self.work, self.motion, float(t), rows, rates
        )
        self.evaluations += len(rows)
        return rates

    def rate(self, t: float, y: Array) -> Array:
        """Return f(t, y), shape (m,)."""
        return np.asarray(self.rates(t, y[None])[0])

    def jacobian(self, t: float, y: Array) -> Array:
        """
        Return df/dy by differences, shape (m, m).

        The integrators' own differences take steps relative to every number. Where one is near 0,
        such a step moves the stiff joints and contacts by less than rounding does, and what comes
        out lets BDF take tiny steps.
        """
        rates = self.rates(t, y + np.vstack([np.zeros_like(y), STEP * np.eye(len(y))]))
        return np.asarray((rates[1:] - rates[0]).T / STEP)

    def state(self, y: Array) -> tuple[State, float]:
        """Return the state of all links, and their deepest gap below zero [m]."""
        depth = minimal_coordinates.configuration(self.model, self.work, self.motion, y)
        q = self.work.q_mid.copy()
        q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1)[:, None]
        return State(q, self.motion.u.copy()), float(depth)


def integrate(
    scene: Scene,
    penalty: Penalty,
    integrator: str,
    tolerance: float,
    limit: float,
    *,
    start: State | None = None,
) -> Course:
    """
    Return the course of the regularized model of a scene as SciPy integrates it.

    Parameters
    ----------
    scene : Scene
        Its time step means nothing here.
    penalty : Penalty
    integrator : str
        RK45, LSODA, Radau or BDF.
    tolerance : float
        Relative, and absolute in SI.
    limit : float
        Wall time of all steps after which the run is stopped [s].
    start : State, optional
        With closed joints; without it, that of the scene.

    Returns
    -------
    Course
        Its steps are the accepted ones, its iterations all evaluations of the right-hand side,
        those for Jacobians included. It has no residual (nan). `energy_error` is of the two works
        that are integrated too.

    Raises
    ------
    ParameterError
        If there is no such integrator, the tolerance is not positive, the scene has rolling
        friction, or the accelerations at the start are not finite.

    """
    if integrator not in INTEGRATORS:
        raise ParameterError(
            f'unknown integrator {integrator!r}; choose from: {", ".join(INTEGRATORS)}'
        )
    if not tolerance > 0.0:
        raise ParameterError(f'tolerance must be above 0, got {tolerance:g}')
    robot, begin = SmoothRobot(scene, penalty), time.perf_counter()
    y = robot.coordinates(start or initial_state(scene))
    if not np.isfinite(robot.rate(0.0, y)).all():
        raise ParameterError('start must have finite accelerations, its velocities are too large')
    robot.state(y)
    robot.evaluations, compile_seconds = 0, time.perf_counter() - begin
    implicit = {} if integrator == 'RK45' else {'jac': robot.jacobian}
    solver = INTEGRATORS[integrator](
        robot.rate, 0.0, y, scene.duration, rtol=tolerance, atol=tolerance, **implicit
    )
    run = _Run(scene, robot, y)
    failure = ''
    while solver.status == 'running' and not failure and run.seconds < limit:
        failure = run.step(solver)
    report = Report(
        steps=len(run.times),
        iterations=robot.evaluations,
        residual_max=math.nan,
        printed_residual_max=math.nan,
        penetration_max=run.depth,
        joint_torque=robot.work.chain.torque.copy(),
        failure=f't = {solver.t:g} s: {integrator}: {failure}' if failure else '',
    )
    times = 1e6 * np.array(run.times or [np.nan])
    q = np.array([state.q for state in run.samples])
    return Course(
        position=q[..., :3],
        axis=rotation_matrices(q[..., 3:])[..., 2],
        joint_angle=joint_angles(q),
        seconds=run.seconds,
        median=float(np.median(times)),
        p99=float(np.percentile(times, 99)),
        compile_seconds=compile_seconds,
        report=report,
        energy_error=run.energy_error(),
        late=solver.status == 'running' and not failure,
    )


class _Run:
    """What is kept of the accepted steps of an integrator of SciPy."""

    def __init__(self, scene: Scene, robot: SmoothRobot, y: Array) -> None:
        self.scene, self.robot = scene, robot
        state, self.depth = robot.state(y)
        self.samples, self.last = [state], y
        self.states, self.energies = [state], np.zeros(0)
        self.work: list[Array] = []  # of joints and contacts in every step [J]
        self.times: list[float] = []  # wall time of every step [s]
        self.seconds = 0.0

    def step(self, solver: Any) -> str:
        """Take one step; return why it failed, or nothing."""
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # LSODA warns of what it reports
                message = solver.step()
        except ValueError as error:  # a matrix of Radau or BDF that is not finite
            return str(error)
        seconds = time.perf_counter() - begin
        self.seconds += seconds
        if solver.status == 'failed':
            return str(message)
        if not np.isfinite(solver.y).all():
            return 'the state is not finite'
        self.times.append(seconds)
        state, depth = self.robot.state(solver.y)
        self.depth = max(self.depth, depth)
        self.states.append(state)
        if len(self.states) == BATCH:
            self.add_energies()
        self.work.append(solver.y[-2:] - self.last[-2:])
        self.last = solver.y.copy()
        while (t := SAMPLE * len(self.samples)) <= solver.t + 1e-9:
            y = solver.dense_output()(min(t, solver.t))
            self.samples.append(self.robot.state(y)[0])
        return ''

    def add_energies(self) -> None:
        """Evaluate the energies of states since the last time, and forget the states."""
        q, u = (np.array([getattr(state, name) for state in self.states]) for name in 'qu')
        self.energies = np.append(self.energies, mechanical_energy(self.scene, q, u))
        self.states = []

    def energy_error(self) -> float:
        """Return `energy.imbalance` of all steps."""
        if self.states:
            self.add_energies()
        joints, contacts = np.array(self.work).reshape(-1, 2).T
        return imbalance(self.energies, contacts, joints)
