# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Snakes with a task: what single environments and vectors of them are made of.

An episode of a snake depends on its random numbers and the actions alone, to the bit: not on other
snakes, on threads or on episodes before.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from gymnasium.spaces import Box
import numpy as np

from snake_sim_ros.learning.actions import KINDS, Residuals
from snake_sim_ros.learning.tasks import Motion, TASKS
from snake_sim_ros.scene.checked_records import nearest, ParameterError, scaled
from snake_sim_ros.scene.parameters import Array, load_scene, Scene, steps_in, with_settings
from snake_sim_ros.stepping.accuracy import RESIDUAL
from snake_sim_ros.stepping.batch import Batch
from snake_sim_ros.stepping.controlled import command_effort
from snake_sim_ros.stepping.exact_sensors import contact_wrenches, imu_readings
from snake_sim_ros.stepping.sampling import (
    begun_samples,
    Command,
    command_of_scene,
    Ended,
    joint_motion,
    STATES,
    trajectory_of,
)
from snake_sim_ros.stepping.simulation import Simulation

Rows = Array | slice  # which of some snakes
ALL = slice(None)
RENDER_MODES = ('rgb_array',)
# What sensors measure at most; beyond, they saturate.
ANGLE, RATE = math.pi, 20.0  # of a joint [rad], [rad/s]
GYROSCOPE, ACCELEROMETER = math.radians(2000), 16 * 9.81  # [rad/s], [m/s^2]
FORCE = 100.0  # of a link [N]
COEFFICIENTS = 'longitudinal', 'transversal', 'backward'
GAINS = 'yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping'


@dataclass(frozen=True)
class Randomization:
    """
    What differs from episode to episode: ranges (least, largest), drawn evenly by the seed.

    Attributes
    ----------
    friction : tuple of float
        Factor of the coefficients of friction.
    gains : tuple of float
        Factor of the gains of the joints.
    command_delay : tuple of float
        From an action to the joints [s]; rounded to steps.
    joint_noise : float
        Standard deviation of the measured angles [rad].

    """

    friction: tuple[float, float] = (1.0, 1.0)
    gains: tuple[float, float] = (1.0, 1.0)
    command_delay: tuple[float, float] = (0.0, 0.0)
    joint_noise: float = 0.0

    def __post_init__(self) -> None:
        """Check that ranges are such."""
        for name, least in (('friction', 0.0), ('gains', 0.0), ('command_delay', 0.0)):
            value = getattr(self, name)
            if not (len(value) == 2 and least <= value[0] <= value[1] < math.inf):
                raise ParameterError(
                    f'{name} must be two numbers in order, at least {least:g}, got {value}'
                )
        if not 0.0 <= self.joint_noise < math.inf:
            raise ParameterError(
                f'joint_noise must be at least 0 rad and finite, got {self.joint_noise}'
            )

    def scene(self, scene: Scene, draws: np.random.Generator) -> Scene:
        """Return the scene of an episode."""
        friction, gains = draws.uniform(*self.friction), draws.uniform(*self.gains)
        delay = draws.uniform(*self.command_delay)
        values: dict[str, Any] = {}
        if self.friction != (1.0, 1.0):
            values |= {
                f'friction.{name}': friction * value
                for name in COEFFICIENTS
                if (value := getattr(scene.friction, name)) is not None
            }
        if self.gains != (1.0, 1.0):
            values |= {f'robot.{k}': scaled(getattr(scene.robot, k), gains) for k in GAINS}
        if self.command_delay != (0.0, 0.0):
            values['robot.command_delay'] = scene.dt * round(delay / scene.dt)
        return with_settings(scene, values) if values else scene


class Snakes:
    """
    Some snakes with a task, each with an episode of its own.

    Parameters
    ----------
    count : int
        How many snakes there are.
    threads : int
        Threads that share them in a step.
    task, scene, values, action, axes, contacts, rate, method, dt, energy_price, randomization, \
    render_mode
        As of `environment.SnakeEnv`.

    Attributes
    ----------
    seen : ndarray, shape (count, k)
        The last observations.

    """

    def __init__(
        self, count: int, threads: int = 1, task: str = 'forward', *,
        scene: Any = 'lateral_undulation', values: Mapping[str, Any] | None = None,
        action: str = 'angles', axes: str = 'auto', contacts: bool = False, rate: float = 25.0,
        method: str = 'newton', dt: float = 1e-3, energy_price: float = 0.01,
        randomization: Randomization | Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:  # fmt: skip
        for name, chosen, known in (
            ('task', task, TASKS),
            ('action', action, KINDS),
            ('axes', axes, ('auto', 'yaw', 'all')),
            ('render_mode', render_mode, (None, *RENDER_MODES)),
        ):
            if chosen not in known:
                raise ParameterError(f'{name}: {nearest(str(chosen), [*map(str, known)])}')
        for name, number in (('num_envs', count), ('threads', threads)):
            if number < 1:
                raise ParameterError(f'{name} must be at least 1, got {number}')
        if not 0.0 < rate < math.inf:
            raise ParameterError(f'rate must be above 0 Hz and finite, got {rate}')
        loaded = scene if isinstance(scene, Scene) else load_scene(scene)
        usual: dict[str, Any] = {'dt': dt, 'method': method, 'accuracy': 0.0}
        if method == 'bdf2':
            # Robots that learn leave the plane again and again; a change of level takes as long
            # as several periods of large steps.
            usual |= {'level': 'spatial', 'solver.residual_tolerance': RESIDUAL}
        loaded = with_settings(loaded, {**usual, **(values or {})})
        if action == 'torques':
            still = dict.fromkeys((f'robot.{name}' for name in GAINS), 0.0)
            loaded = with_settings(loaded, {**still, 'robot.effort_commands': True})
        self.base, self.energy_price, self.contacts = loaded, energy_price, contacts
        self.render_mode = render_mode
        if not isinstance(randomization, Randomization):
            randomization = Randomization(**(randomization or {}))
        self.randomization, self.period = randomization, 1.0 / rate
        self.steps = steps_in(self.period, self.base.dt, 'period of actions')
        robot = self.base.robot
        if axes == 'auto':
            axes = 'all' if self.base.gait.pitch.amplitude or self.base.gait.table else 'yaw'
        self.acting = np.flatnonzero((robot.axis_places % 2 == 0) | (axes == 'all'))
        if not len(self.acting):
            raise ParameterError('the robot has no yaw axes: axes must be all, got yaw')
        self.task = TASKS[task](count)
        self.actions = KINDS[action](self.base, robot.axis_places[self.acting], count)
        self._commands: list[Command | None] = [None] * count  # those that residuals are added to
        command = command_of_scene(self.base) if isinstance(self.actions, Residuals) else None
        self.is_led = command is not None
        if command and command.period != self.steps:
            raise ParameterError(
                f'the period of the controller must be that of actions, {self.period:g} s, got '
                f'{command.period * self.base.dt:g} s'
            )
        low, high = self.actions.low, self.actions.high
        self.action_space = Box(-1.0, 1.0, low.shape, np.float64)
        self.action_labels = tuple(
            f'{label}, {least:g} to {most:g}'
            for label, least, most in zip(self.actions.labels, low, high, strict=True)
        )
        bounds = self._observed()
        self.observation_labels = tuple(label for label, _ in bounds)
        self.bound = np.array([bound for _, bound in bounds])
        self.observation_space = Box(-self.bound, self.bound, dtype=np.float64)
        self.batch = Batch([Simulation(self.base) for _ in range(count)], threads)
        self.begun, self.periods = np.zeros(count, bool), np.zeros(count, np.int64)
        self.seen, self._before = np.zeros((count, len(bounds))), np.zeros((count, 3))
        self.motion = Motion.of(self.batch.q[..., :3])
        self.draws: list[np.random.Generator | None] = [None] * count

    def _observed(self) -> list[tuple[str, float]]:
        """Return label and bound of every number of an observation."""
        robot = self.base.robot
        names = [robot.axis_names[k] for k in self.acting]
        parts = [(f'angle of {name} [rad]', ANGLE) for name in names]
        parts += [(f'rate of {name} [rad/s]', RATE) for name in names]
        head = robot.link_names[0]
        parts += [(f'orientation {c} of {head}', 1.0) for c in 'xyzw']
        parts += [(f'angular velocity {c} of {head} [rad/s]', GYROSCOPE) for c in 'xyz']
        parts += [(f'specific force {c} of {head} [m/s^2]', ACCELEROMETER) for c in 'xyz']
        if self.contacts:
            parts += [(f'force {c} on {k} [N]', FORCE) for k in robot.link_names for c in 'xyz']
        parts += [(label, 1.0) for label in self.actions.state_labels]
        return parts + list(zip(self.task.labels, self.task.bound.tolist(), strict=True))

    def begin(self, rows: Sequence[int], draws: Sequence[np.random.Generator]) -> None:
        """Begin episodes of some snakes, each with its random numbers; observe them."""
        scenes = [self.randomization.scene(self.base, each) for each in draws]
        for i, scene, each in zip(rows, scenes, draws, strict=True):
            simulation = self.batch.simulation(i)
            if simulation.scene == scene:
                simulation.reset()
                simulation.step_count = 0
            else:
                simulation = Simulation(scene)
            self.batch.put(i, simulation)
            self.actions.start(i, scene)
            self._commands[i] = command_of_scene(scene) if self.is_led else None
            self.draws[i] = each
        chosen = np.array(rows)
        self.begun[chosen], self.periods[chosen] = True, 0
        self._before[chosen] = self.batch.u[chosen, 0, :3]
        self.motion = Motion.of(self.batch.q[..., :3])
        for i, each in zip(rows, draws, strict=True):
            self.task.start(i, self.motion.of_robot(i), each)
        self._see(chosen)

    def step(self, action: Array, rows: Rows = ALL) -> tuple[dict[str, Array], Array]:
        """
        Take actions, in the units of `action_labels`, of some snakes; observe them.

        Parameters
        ----------
        action : ndarray, shape (count, k)
            Of all snakes.
        rows : ndarray of int or slice, optional
            Those that take steps; others must begin anew before the next action.

        Returns
        -------
        terms : dict of ndarray, shape (count,)
            The terms of the rewards by name.
        done : ndarray of bool, shape (count,)
            Whose task is done.

        """
        chosen = np.arange(len(self.seen))[rows]
        if (efforts := self.actions.efforts(action)) is not None:
            for i in chosen.tolist():
                command_effort(self.batch.simulation(i), efforts[i])
        if isinstance(self.actions, Residuals):
            for i in chosen.tolist():
                if command := self._commands[i]:
                    self.actions.leads[i] = command.control(self.batch.simulation(i))
        dt, done = self.base.dt, self.periods * self.steps
        times = (done[:, None] + 0.5 + np.arange(self.steps)) * dt
        references = self.actions.references(action, done * dt, self.period)
        self.batch.advance(*references(times), chosen)
        self.periods[rows] += 1
        before, self.motion = self.motion, Motion.of(self.batch.q[..., :3])
        terms, ends = self.task.progress(before, self.motion)
        rate = self._see(rows)
        torque = self.base.robot.by_axis(self.batch.torque)
        power = np.zeros(len(self.seen))
        power[rows] = np.abs(torque[rows] * rate).cumsum(axis=-1)[..., -1]
        return {**terms, 'energy': -self.energy_price * self.period * power}, ends

    def failure(self, i: int) -> str:
        """Return why the motion of a snake diverged; empty if it did not."""
        return self.batch.simulation(i).report.failure if self.batch.failed[i] else ''

    def physical(self, action: Any, what: str, shape: tuple[int, ...]) -> Array:
        """
        Return actions of a shape, whose last axis is that of their numbers, in physical units.

        Raises
        ------
        ParameterError
            If they have another shape or are not finite; `what` is what they must be.

        """
        low, high = self.actions.low, self.actions.high
        try:
            given = np.asarray(action, dtype=float)
        except (TypeError, ValueError):
            given = np.full(0, math.nan)
        if given.shape != shape:
            raise ParameterError(f'{what}, got shape {np.shape(given)}')
        if not np.isfinite(given).all():
            place = np.argwhere(~np.isfinite(given))[0].tolist()
            raise ParameterError(f'{what}, got {given[tuple(place)]} at {place}')
        return np.asarray(low + 0.5 * (np.clip(given, -1.0, 1.0) + 1.0) * (high - low))

    def observation(
        self, joints: tuple[Array, Array], imu: Array, force: Array | None, motion: Motion,
        rows: Rows = ALL,
    ) -> Array:  # fmt: skip
        """
        Return the observations of m of the snakes.

        Parameters
        ----------
        joints : tuple of ndarray, shape (m, axes)
            Angles and rates of all joint axes [rad], [rad/s].
        imu : ndarray, shape (m, 10)
            Readings of the head, see `exact_sensors.imu_readings`.
        force : ndarray, shape (m, n, 3), or None
            On the links [N].
        motion : Motion
            Of all snakes.
        rows : ndarray of int or slice, optional
            Which of them.

        """
        parts = [each[:, self.acting] for each in joints]
        parts.append(imu)
        if force is not None:
            parts.append(force.reshape(len(force), -1))
        parts += [self.actions.state()[rows], self.task.command(motion)[rows]]
        found: Array = np.concatenate(parts, axis=1)
        return found.clip(-self.bound, self.bound)

    def _see(self, rows: Rows) -> Array:
        """Observe some snakes; return the rates of their joint axes, shape (m, axes) [rad/s]."""
        robot, q, u = self.base.robot, self.batch.q[rows], self.batch.u[rows]
        angle, rate = (robot.by_axis(each) for each in joint_motion(robot, q, u))
        chosen = np.arange(len(self.seen))[rows].tolist()
        if noise := self.randomization.joint_noise:
            draws = [self.draws[i] for i in chosen]
            added = [each.normal(0.0, noise, angle.shape[1]) for each in draws if each]
            angle = angle + np.array(added)
        force = None
        if self.contacts:
            now = (self.batch.now(i) for i in chosen)
            force = np.array([contact_wrenches(*each)[:, :3] for each in now])
        before = self._before[rows]
        imu = imu_readings(self.base.gravity, q[:, 0], u[:, 0], before, self.period)
        self._before[rows] = u[:, 0, :3]
        self.seen[rows] = self.observation((angle, rate), imu, force, self.motion, rows)
        return rate

    def picture(self, i: int) -> Array:
        """Return a picture of a snake, (360, 640, 3) of uint8."""
        from snake_sim_ros.view.animation import Film

        simulation = self.batch.simulation(i)
        samples = begun_samples(simulation, 1, 0)
        ended = Ended(simulation.report, 0.0, False)
        trajectory = trajectory_of(simulation.scene, samples, STATES, ended, None)
        return np.asarray(Film(trajectory, '', 1.0).frame(0))
