# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A snake as an environment of Gymnasium.

An episode depends on its seed and the actions alone, to the bit: not on other environments, on
processes or on episodes before.
"""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

import gymnasium
from gymnasium.spaces import Box
import numpy as np

from snake_sim_ros.controllers.controller import Measured
from snake_sim_ros.learning.actions import KINDS
from snake_sim_ros.learning.tasks import Motion, TASKS
from snake_sim_ros.scene.checked_records import nearest, ParameterError, scaled
from snake_sim_ros.scene.parameters import Array, load_scene, Scene, steps_in, with_settings
from snake_sim_ros.stepping.controlled import command_effort
from snake_sim_ros.stepping.exact_sensors import contact_wrenches, imu_readings
from snake_sim_ros.stepping.sampling import (
    begun_samples,
    Ended,
    joint_motion,
    STATES,
    trajectory_of,
)
from snake_sim_ros.stepping.simulation import Simulation

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


class SnakeEnv(gymnasium.Env[Array, Array]):
    """
    A snake with a task.

    Actions are from -1 to 1: the least and the largest value of what `action_labels` say.
    Observations are what the robot measures, in the order of `observation_labels`: angles [rad]
    and rates [rad/s] of the joint axes that act, orientation, angular velocity and specific force
    of an inertial unit in the head, forces on all links if asked for, the phase of actions that
    have one, and the command of the task. The reward is the sum of the terms of the task, see
    `tasks`, less the energy of the joints at its price; ``info['reward']`` has every term.

    An episode terminates when its task is done or the motion diverges, which ``info['failure']``
    says. Its truncation is that of Gymnasium's time limit.

    Parameters
    ----------
    task : str, optional
        ``forward``, ``goal`` or ``path``.
    scene : Scene, str or Path, optional
    values : mapping, optional
        Values of the scene by dotted names.
    action : str, optional
        ``angles``, ``residual``, ``gait`` or ``torques``; see `actions`.
    axes : str, optional
        Axes that act and are measured: ``yaw``, ``all``, or ``auto``, which is all where the gait
        of the scene moves pitch joints.
    contacts : bool, optional
        Whether the forces on the links are measured.
    rate : float, optional
        Actions a second [Hz].
    dt : float, optional
        Time step [s], of `newton`: where actions are as rough as those of an agent that begins to
        learn, its short steps take less time than the long ones of `bdf2`.
    energy_price : float, optional
        Reward that a joule costs [1/J].
    randomization : Randomization or mapping, optional
    render_mode : str, optional
        ``rgb_array`` or None.

    Raises
    ------
    ParameterError
        If an argument is not usable; the message says which and why.

    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium declares it
        'render_modes': ['rgb_array'],
        'render_fps': 25,
    }

    def __init__(
        self, task: str = 'forward', *, scene: Any = 'lateral_undulation',
        values: Mapping[str, Any] | None = None, action: str = 'angles', axes: str = 'auto',
        contacts: bool = False, rate: float = 25.0, dt: float = 1e-3,
        energy_price: float = 0.01, randomization: Randomization | Mapping[str, Any] | None = None,
        render_mode: str | None = None,
    ) -> None:  # fmt: skip
        modes = (None, *self.metadata['render_modes'])
        for name, chosen, known in (
            ('task', task, TASKS),
            ('action', action, KINDS),
            ('axes', axes, ('auto', 'yaw', 'all')),
            ('render_mode', render_mode, modes),
        ):
            if chosen not in known:
                raise ParameterError(f'{name}: {nearest(str(chosen), [*map(str, known)])}')
        if not 0.0 < rate < math.inf:
            raise ParameterError(f'rate must be above 0 Hz and finite, got {rate}')
        loaded = scene if isinstance(scene, Scene) else load_scene(scene)
        usual = {'dt': dt, 'method': 'newton', 'accuracy': 0.0}
        loaded = with_settings(loaded, {**usual, **(values or {})})
        if action == 'torques':
            still = dict.fromkeys((f'robot.{name}' for name in GAINS), 0.0)
            loaded = with_settings(loaded, {**still, 'robot.effort_commands': True})
        self.base = loaded
        self.render_mode, self.energy_price, self.contacts = render_mode, energy_price, contacts
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
        self.task = TASKS[task]()
        self.actions = KINDS[action](self.base, robot.axis_places[self.acting])
        low, high = self.actions.low, self.actions.high
        self.action_space = Box(-1.0, 1.0, low.shape, np.float64)
        self.action_labels = tuple(
            f'{label}, {least:g} to {most:g}'
            for label, least, most in zip(self.actions.labels, low, high, strict=True)
        )
        bounds = self._observed()
        self.observation_labels = tuple(label for label, _ in bounds)
        bound = np.array([bound for _, bound in bounds])
        self.observation_space = Box(-bound, bound, dtype=np.float64)
        self._simulation: Simulation | None = None

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

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; `options` are not used."""
        super().reset(seed=seed)
        scene = self.randomization.scene(self.base, self.np_random)
        if self._simulation is None or self._simulation.scene != scene:
            self._simulation = Simulation(scene)
        else:
            self._simulation.reset()
        self._begin = self._simulation.step_count
        self._before = self._simulation.state.u[:1, :3].copy()
        self.actions.start(scene)
        self._motion = Motion.of(self._simulation.state.q[:, :3])
        self.task.start(self._motion, self.np_random)
        return self.observation(self._measured(), self._motion), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """
        Take an action of `action_space`, which is clipped to its bounds.

        Raises
        ------
        ParameterError
            If it has another shape or is not finite, or before the first reset.

        """
        simulation = self._simulation
        if simulation is None:
            raise ParameterError('an episode begins with reset')
        action = self.physical(action)
        if (efforts := self.actions.efforts(action)) is not None:
            command_effort(simulation, efforts)
        done, dt = simulation.step_count - self._begin, simulation.scene.dt
        times = (done + 0.5 + np.arange(self.steps)) * dt
        simulation.advance(*self.actions.reference(action, done * dt, self.period)(times))
        before, self._motion = self._motion, Motion.of(simulation.state.q[:, :3])
        terms, terminated = self.task.progress(before, self._motion)
        measured = self._measured()
        power = np.abs(measured.joint_torque * measured.joint_velocity).sum()
        terms['energy'] = -self.energy_price * self.period * float(power)
        report = simulation.report
        info = {'reward': terms, 'unconverged': report.unconverged, 'failure': report.failure}
        ends = terminated or bool(report.failure)
        seen = self.observation(measured, self._motion)
        return seen, float(sum(terms.values())), ends, False, info

    def physical(self, action: Array) -> Array:
        """
        Return an action in the units of `action_labels`.

        Raises
        ------
        ParameterError
            If it has another shape or is not finite.

        """
        low, high, given = self.actions.low, self.actions.high, np.asarray(action, dtype=float)
        if given.shape != low.shape or not np.isfinite(given).all():
            raise ParameterError(
                f'an action must be {len(low)} finite numbers, got {given.tolist()}'
            )
        return np.asarray(low + 0.5 * (np.clip(given, -1.0, 1.0) + 1.0) * (high - low))

    def observation(self, measured: Measured, motion: Motion) -> Array:
        """Return the observation of what a robot measures, with readings of the head at least."""
        assert measured.imu is not None
        parts = [measured.joint_angle[self.acting], measured.joint_velocity[self.acting]]
        parts.append(measured.imu[0])
        if measured.contact_wrench is not None:
            parts.append(measured.contact_wrench[:, :3].ravel())
        parts += [self.actions.state(), self.task.command(motion)]
        space = self.observation_space
        return np.clip(np.concatenate(parts), space.low, space.high)  # type: ignore[attr-defined]

    def _measured(self) -> Measured:
        """Return what the robot measures now."""
        simulation = self._simulation
        assert simulation
        state, robot = simulation.state, simulation.scene.robot
        motion = joint_motion(robot, state.q[None], state.u[None])
        angle, rate = (robot.by_axis(each[0]) for each in motion)
        if noise := self.randomization.joint_noise:
            angle = angle + self.np_random.normal(0.0, noise, len(angle))
        scene, head, wrench = simulation.scene, slice(0, 1), None
        if self.contacts:
            wrench = contact_wrenches(scene, state, simulation.history)
        measured = Measured(
            angle,
            rate,
            simulation.joint_torque,
            contact_wrench=wrench,
            imu=imu_readings(
                scene.gravity, state.q[head], state.u[head], self._before, self.period
            ),
        )
        self._before = state.u[head, :3].copy()
        return measured

    def render(self) -> Any:
        """Return a picture, (360, 640, 3) of uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        from snake_sim_ros.view.animation import Film

        simulation = self._simulation
        if simulation is None:
            raise ParameterError('an episode begins with reset')
        samples = begun_samples(simulation, 1, 0)
        ended = Ended(simulation.report, 0.0, False)
        trajectory = trajectory_of(simulation.scene, samples, STATES, ended, None)
        return np.asarray(Film(trajectory, '', 1.0).frame(0))
