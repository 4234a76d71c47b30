# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Methods without set-valued contact laws that are still in use, to compare ours with.

- Regularized contact in a semi-implicit Euler step of fixed size (`make_semi_implicit`).
- A friction pyramid in place of the ellipse (`make_pyramid`).
- Regularized contact as a smooth differential equation for the integrators of SciPy, which choose
  their step sizes (`integrate`).

They are not among `methods.METHODS`, since they are meant for comparisons only, not for running a
robot. The first two run in a `simulation.Simulation` that is given their stepper.
"""

from dataclasses import astuple, dataclass
from functools import partial
import math
import time
from typing import Any
import warnings

import numpy as np
from scipy.integrate import BDF, LSODA, Radau, RK45

from snake_sim_benchmarks.comparison.baselines import minimal_coordinates, penalty as regularized
from snake_sim_benchmarks.comparison.baselines.pyramid import Pyramid
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD
from snake_sim_benchmarks.comparison.timing import TimedRun, timing_of, trajectory_of_states
from snake_sim_benchmarks.energy import imbalance, mechanical_energy
from snake_sim_ros import ParameterError, Report, Scene, State
from snake_sim_ros.contact.delassus import make_delassus
from snake_sim_ros.scene.checked_records import CheckedRecord, quantity
from snake_sim_ros.scene.gait import amplitudes
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Array, with_settings
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.model import make_model, make_workspace
from snake_sim_ros.stepping.moreau import Moreau
from snake_sim_ros.stepping.spatial import SpatialStepper
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.steps import advance

INTEGRATORS: dict[str, Any] = {'RK45': RK45, 'LSODA': LSODA, 'Radau': Radau, 'BDF': BDF}
JACOBIAN_DIFFERENCE = 1e-8  # in the unit of each number; less than the sag of a link
LAWS = ('tanh', 'rational')
ENERGY_BATCH = 1000  # number of states whose energies are evaluated together


@dataclass(frozen=True, kw_only=True)
class Penalty(CheckedRecord):
    """
    Regularized contact: a spring-damper for each sphere, and friction that is smooth at rest.

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
    """Return the numbers of a penalty in the form that compiled functions take."""
    return regularized.PenaltyLaw(
        rational=penalty.law == 'rational',
        sliding_velocity=penalty.sliding_velocity,
        stiffness=penalty.stiffness,
        damping_ratio=penalty.damping_ratio,
    )


def refuse_rolling(scene: Scene) -> None:
    """Raise an error if a scene has rolling friction, which no baseline supports."""
    if scene.friction.rolling > 0.0:
        raise ParameterError(
            f'friction.rolling must be 0 for a baseline, got {scene.friction.rolling:g}'
        )


def make_semi_implicit(scene: Scene, penalty: Penalty) -> Stepper:
    """
    Return a stepper of regularized contact: the paper's step with explicit contact forces.

    The contacts limit the step, since their forces are explicit: dt < 2/omega for a spring of
    angular frequency omega without damping. Every step counts as converged. The residual says
    how far forces and velocities are from the set-valued laws.

    Raises
    ------
    ParameterError
        If the scene has rolling friction.

    """
    refuse_rolling(scene)
    # Its contacts are inside the floor: no gap is closed.
    scene = with_settings(scene, {'solver.activation_tolerance': 0.0})
    mass = scene.robot.per_link('link_mass')
    springs = regularized.Springs(make_law(penalty), mass, scene.dt)
    return SpatialStepper(scene, partial(advance, Moreau(springs)))


def make_pyramid(scene: Scene) -> Stepper:
    """
    Return a stepper of the paper's step with friction that is bounded separately in x and y.

    The residual is that of these laws, and the printed residual that of Coulomb's law. See
    `pyramid`.

    Raises
    ------
    ParameterError
        If the scene has rolling friction.

    """
    refuse_rolling(scene)
    solver = Pyramid(make_delassus(3 * contact_count(scene), scene.robot.link_count))
    return SpatialStepper(scene, partial(advance, Moreau(solver)))


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
        Number of evaluations of f.

    """

    def __init__(self, scene: Scene, penalty: Penalty) -> None:
        refuse_rolling(scene)
        self.model, self.law = make_model(scene), make_law(penalty)
        self.work = make_workspace(scene)
        n = scene.robot.link_count
        self.motion = minimal_coordinates.LinkVelocities(np.zeros((n, 6)), np.zeros((n, 6)))
        gait = scene.gait
        yaw, pitch = (
            (amplitudes(wave, n - 1), astuple(wave)[1:5]) for wave in (gait.yaw, gait.pitch)
        )
        self.waves = (yaw, pitch), gait.soft_start
        self.middle, self.evaluations = scene.robot.middle_link, 0

    def coordinates(self, state: State) -> Array:
        """Return y of a state with closed joints; its works are 0."""
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

        The differences of the integrators take steps relative to each number. If a number is near
        0, its step moves the stiff joints and contacts by less than rounding errors do, and BDF
        takes tiny time steps with the result.
        """
        steps = np.vstack([np.zeros_like(y), JACOBIAN_DIFFERENCE * np.eye(len(y))])
        rates = self.rates(t, y + steps)
        return np.asarray((rates[1:] - rates[0]).T / JACOBIAN_DIFFERENCE)

    def state(self, y: Array) -> tuple[State, float]:
        """Return the state of all links, and their largest penetration [m]."""
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
) -> TimedRun:
    """
    Integrate the regularized model of a scene with SciPy.

    Parameters
    ----------
    scene : Scene
        Its time step is not used.
    penalty : Penalty
    integrator : str
        RK45, LSODA, Radau or BDF.
    tolerance : float
        Relative, and absolute in SI.
    limit : float
        Wall time of all steps after which the run is stopped [s].
    start : State, optional
        With closed joints. Default: the start of the scene.

    Returns
    -------
    TimedRun
        Its report counts the accepted steps, and as iterations all evaluations of the right-hand
        side, including those for Jacobians. It has no residual (nan). `energy_error` is computed
        from the two works, which are integrated as well.

    Raises
    ------
    ParameterError
        If there is no such integrator, the tolerance is not positive, the scene has rolling
        friction, or the accelerations at the start are not finite.

    """
    _check(integrator, tolerance)
    robot = SmoothRobot(scene, penalty)
    y, compile_seconds = _compiled_start(robot, start or initial_state(scene))
    implicit = {} if integrator == 'RK45' else {'jac': robot.jacobian}
    solver = INTEGRATORS[integrator](
        robot.rate, 0.0, y, scene.duration, rtol=tolerance, atol=tolerance, **implicit
    )
    kept = _Kept(scene, robot, y)
    while solver.status == 'running' and not kept.failure and kept.seconds < limit:
        kept.step(solver)
    report = kept.report(f't = {solver.t:g} s: {integrator}: {kept.failure}')
    return TimedRun(
        trajectory_of_states(scene, kept.samples, SAMPLING_PERIOD, report, kept.seconds),
        timing_of(1e6 * np.array(kept.times), compile_seconds),
        energy_error=kept.energy_error(),
        late=solver.status == 'running' and not kept.failure,
    )


def _check(integrator: str, tolerance: float) -> None:
    """Raise an error if there is no such integrator, or if the tolerance is not positive."""
    if integrator not in INTEGRATORS:
        raise ParameterError(
            f'unknown integrator {integrator!r}; choose from: {", ".join(INTEGRATORS)}'
        )
    if not tolerance > 0.0:
        raise ParameterError(f'tolerance must be above 0, got {tolerance:g}')


def _compiled_start(robot: SmoothRobot, start: State) -> tuple[Array, float]:
    """Return y of a start, and the wall time of compiling the right-hand side [s]."""
    begin = time.perf_counter()
    y = robot.coordinates(start)
    if not np.isfinite(robot.rate(0.0, y)).all():
        raise ParameterError('start must have finite accelerations, its velocities are too large')
    robot.state(y)
    robot.evaluations = 0
    return y, time.perf_counter() - begin


class _Kept:
    """Samples, times and energies of the accepted steps of an integrator of SciPy."""

    def __init__(self, scene: Scene, robot: SmoothRobot, y: Array) -> None:
        self.scene, self.robot = scene, robot
        state, self.depth = robot.state(y)
        self.samples, self.last = [state], y
        self.states, self.energies = [state], np.zeros(0)
        self.work: list[Array] = []  # of joints and contacts in every step [J]
        self.times: list[float] = []  # wall time of every step [s]
        self.seconds, self.failure = 0.0, ''

    def report(self, failure: str) -> Report:
        """Return the report of all steps; `failure` is its sentence if they failed."""
        return Report(
            steps=len(self.times),
            iterations=self.robot.evaluations,
            residual_max=math.nan,
            printed_residual_max=math.nan,
            penetration_max=self.depth,
            joint_torque=self.robot.work.chain.torque.copy(),
            failure=failure if self.failure else '',
        )

    def step(self, solver: Any) -> None:
        """Take one step, or note the reason why it failed."""
        self.failure, seconds = self._step(solver)
        self.seconds += seconds
        if self.failure:
            return
        self.times.append(seconds)
        state, depth = self.robot.state(solver.y)
        self.depth = max(self.depth, depth)
        self.states.append(state)
        if len(self.states) == ENERGY_BATCH:
            self.add_energies()
        self.work.append(solver.y[-2:] - self.last[-2:])
        self.last = solver.y.copy()
        while (t := SAMPLING_PERIOD * len(self.samples)) <= solver.t + 1e-9:
            y = solver.dense_output()(min(t, solver.t))
            self.samples.append(self.robot.state(y)[0])

    @staticmethod
    def _step(solver: Any) -> tuple[str, float]:
        """Take one step; return its failure, empty if there is none, and its wall time [s]."""
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # LSODA warns of what it reports
                message = solver.step()
        except ValueError as error:  # a matrix of Radau or BDF that is not finite
            return str(error), 0.0
        seconds = time.perf_counter() - begin
        if solver.status == 'failed':
            return str(message), seconds
        return '' if np.isfinite(solver.y).all() else 'the state is not finite', seconds

    def add_energies(self) -> None:
        """Evaluate the energies of the states since the last call, and drop these states."""
        q, u = (np.array([getattr(state, name) for state in self.states]) for name in 'qu')
        self.energies = np.append(self.energies, mechanical_energy(self.scene, q, u))
        self.states = []

    def energy_error(self) -> float:
        """Return `energy.imbalance` of all steps."""
        if self.states:
            self.add_energies()
        joints, contacts = np.array(self.work).reshape(-1, 2).T
        return imbalance(self.energies, contacts, joints)
