# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What sensors on the robot measure: its links, its contacts and its joints.

The node `sim` and recorded runs compute it by the same functions, number by number, so that both
have the same bits. Vectors are in the frame of their link as messages have it: x along the link
toward the next one, y to the left and z up when the link lies flat. An IMU at a further frame of a
link measures there, and in axes of that frame.

The bits of the noise depend on the seed, the sensor and the number of the sample alone: every
sensor has its own stream of random numbers, so that requests to one do not change another.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from snake_sim_ros.scene.chain import euler_parameters, roll_pitch_yaw
from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    cut,
    ParameterError,
    quantity,
    quoted,
)
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.scene.rotations import B_TO_WIRE, CONJUGATE, product, rotation_matrices
from snake_sim_ros.stepping.exact_sensors import (
    ACCELERATION,
    ANGULAR_VELOCITY,
    contact_wrenches,
    imu_readings,
    ORIENTATION,
    turned,
    wrenches_on_links,
)
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.trajectory import Trajectory

Links = str | int | tuple[str | int, ...]  # names and numbers of links, or all
MEASURED = slice(4, 10)  # what an IMU measures with errors
MOST_STATES = 10**15  # from one sample of a sensor to the next


@dataclass(frozen=True, kw_only=True)
class Sensors(CheckedRecord):
    """Which sensors there are, and how well they measure; deviations are those of noise."""

    imu_links: Links = quantity(
        (), '', 'links with an IMU: names such as link_6, numbers from 1, or all; frames of links'
    )
    contact_force_links: Links = quantity(
        (), '', 'links whose contact forces are measured: names, numbers from 1, or all'
    )
    sensor_rate: float = quantity(
        0.0, 'Hz', 'samples per second of imu and contact_forces (0 = every state)', minimum=0
    )
    sensor_seed: int = quantity(
        0, '', 'seed of all noise; equal seeds give identical bits', minimum=0, maximum=2**63 - 1
    )
    imu_angular_velocity_noise: float = quantity(
        0.0, 'rad/s', 'standard deviation of the noise of each component', minimum=0
    )
    imu_angular_velocity_bias: float | tuple[float, ...] = quantity(
        0.0, 'rad/s', 'constant error: one number for x, y and z, or three'
    )
    imu_acceleration_noise: float = quantity(
        0.0, 'm/s^2', 'standard deviation of the noise of each component', minimum=0
    )
    imu_acceleration_bias: float | tuple[float, ...] = quantity(
        0.0, 'm/s^2', 'constant error: one number for x, y and z, or three'
    )
    contact_force_noise: float = quantity(
        0.0, 'N', 'standard deviation of the noise of each component', minimum=0
    )
    contact_torque_noise: float = quantity(
        0.0, 'N m', 'standard deviation of the noise of each component', minimum=0
    )
    joint_position_noise: float = quantity(
        0.0, 'rad', 'standard deviation of the noise in joint_states', minimum=0
    )
    joint_velocity_noise: float = quantity(
        0.0, 'rad/s', 'standard deviation of the noise in joint_states', minimum=0
    )
    joint_effort_noise: float = quantity(
        0.0, 'N m', 'standard deviation of the noise in joint_states', minimum=0
    )

    def __post_init__(self) -> None:
        """Check every field, that links can be such, and that biases have three components."""
        for name in ('imu_links', 'contact_force_links'):
            value = getattr(self, name)
            links = value if isinstance(value, (list, tuple)) else [value]
            if not all(isinstance(link, (str, int)) and link is not True for link in links):
                raise ParameterError(
                    f'{name} must be names or numbers of links, got {quoted(value)}'
                )
        super().__post_init__()
        for name in ('imu_angular_velocity_bias', 'imu_acceleration_bias'):
            value = getattr(self, name)
            if isinstance(value, tuple) and len(value) != 3:
                raise ParameterError(f'{name} must be one number or three, got {len(value)}')

    def links(self, name: str, robot: Robot) -> list[int]:
        """
        Return the indices of links, each once and in order.

        Parameters
        ----------
        name : str
            `imu_links` or `contact_force_links`.
        robot : Robot

        Raises
        ------
        ParameterError
            If there is no such link.

        """
        return _links(getattr(self, name), robot, name)

    def imus(self, robot: Robot) -> 'Imus':
        """
        Return where the IMUs are: each once, those of links in order, then those of their frames.

        Raises
        ------
        ParameterError
            If there is no such link or frame.

        """
        chain, given = robot.chain, _each(self.imu_links)
        frames = [(i, frame) for i, link in enumerate(robot.links) for frame in link.frames]
        at = [(k, *found) for k, found in enumerate(frames) if found[1].name in given]
        names = [frame.name for _, _, frame in at]
        rest = tuple(each for each in given if each not in names) if at else self.imu_links
        try:
            links = _links(rest, robot, 'imu_links')
        except ParameterError as error:
            known = ', '.join(cut(frame.name) for _, frame in frames[:3])
            raise ParameterError(f'{error}{known and f", their frames {known}"}') from None
        count, n = len(links), len(links) + len(at)
        place, turn = np.zeros((n, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        for row, (_, i, frame) in enumerate(at, count):
            own = chain.frame[i]
            place[row] = chain.frame_place[i] + own @ frame.origin
            axes = euler_parameters((own @ roll_pitch_yaw(frame.rotation))[None])[0]
            turn[row] = product(axes, B_TO_WIRE * CONJUGATE)
        return Imus(
            names=(*(robot.link_names[i] for i in links), *names),
            frames=(*(chain.center_names[i] for i in links), *names),
            streams=(*links, *(FIRST_FRAME + k for k, _, _ in at)),
            link=np.array([*links, *(i for _, i, _ in at)], dtype=int),
            place=place,
            turn=turn,
        )

    def states_in_sample(self, rate: float) -> int:
        """
        Return how many states there are to a sample if there are so many a second [Hz].

        Raises
        ------
        ParameterError
            If the rate of the sensors does not divide that of the states.

        """
        if self.sensor_rate == 0.0:
            return 1
        count = round(min(rate / self.sensor_rate, MOST_STATES))
        if count < 1 or abs(count * self.sensor_rate - rate) > 1e-9 * rate:
            raise ParameterError(
                f'sensor_rate must divide the rate of the states, {rate:g} Hz, or be 0; '
                f'got {self.sensor_rate:g} Hz'
            )
        return count


def _each(given: Links) -> tuple[str | int, ...]:
    """Return what is given, one or several, as several."""
    return given if isinstance(given, tuple) else (given,)


def _links(given: Links, robot: Robot, what: str) -> list[int]:
    """Return the indices of links, see `Sensors.links`; `what` is where they come from."""
    if given == 'all':
        return list(range(robot.link_count))
    return sorted({link_index(link, robot, what) for link in _each(given)})


def link_index(name: str | int, robot: Robot, what: str) -> int:
    """
    Return the index from 0 of a link by its name or by its number from 1.

    Parameters
    ----------
    name : str or int
    robot : Robot
    what : str
        Where the name comes from, for the error.

    Raises
    ------
    ParameterError
        If there is no such link.

    """
    names = robot.link_names
    if name in names:
        return names.index(str(name))
    number = cut(str(name))
    number = number if robot.links else number.removeprefix('link_')
    is_number = number.isascii() and number.isdigit() and len(number) < 10
    if is_number and 1 <= int(number) <= len(names):
        return int(number) - 1
    raise ParameterError(
        f'{what}: no link {quoted(name)}; the links are {names[0]} to {names[-1]}'
    )


class Imus(NamedTuple):
    """
    Where the k IMUs of a robot are: at centers of links or at their further frames.

    The frame B of an IMU lies to its axes as that of a link to the axes of the link in messages.
    """

    names: tuple[str, ...]  # of the links or of their frames
    frames: tuple[str, ...]  # in which they measure
    streams: tuple[int, ...]  # of their noise, see `imu_noise`
    link: Array  # (k,)
    place: Array  # (k, 3) link center to the IMU, frame B of the link [m]
    turn: Array  # (k, 4) frame B of the IMU in that of the link, Euler parameters

    def moves(self, q: Array, u: Array) -> tuple[Array, Array]:
        """
        Return coordinates (..., k, 7) and velocities (..., k, 6) of the IMUs.

        Parameters
        ----------
        q : ndarray, shape (..., n, 7)
        u : ndarray, shape (..., n, 6)
            Of the links, see `state.State`.

        """
        q, u = q[..., self.link, :].copy(), u[..., self.link, :].copy()
        if not self.place.any() and (self.turn[:, 0] == 1.0).all():
            return q, u
        R, omega = rotation_matrices(q[..., 3:]), u[..., 3:]
        q[..., :3] += turned(R, np.broadcast_to(self.place, omega.shape))
        u[..., :3] += turned(R, np.cross(omega, self.place))
        q[..., 3:] = product(q[..., 3:], self.turn)
        u[..., 3:] = turned(rotation_matrices(self.turn * CONJUGATE), omega)
        return q, u


# ---- noise --------------------------------------------------------------------------------------


JOINTS, IMU, CONTACTS = range(3)  # kinds of sensors
FIRST_FRAME = 1000  # after the numbers of links
PORTION = 10_000  # samples that are drawn in one go


class Noise:
    """
    Constant and random errors of one sensor.

    Parameters
    ----------
    seed, sensor : int
        The stream: that of the child `sensor` of the seed, as `SeedSequence.spawn` makes it.
    deviation, bias : ndarray, shape (k,)
        Standard deviations and constant errors of the k numbers of a sample.

    """

    def __init__(self, seed: int, sensor: int, deviation: Array, bias: Array) -> None:
        self._key, self._deviation, self._bias = (seed, sensor), deviation, bias
        self.is_exact = not (deviation.any() or bias.any())
        self._restart()

    def _restart(self) -> None:
        seed, sensor = self._key
        sequence = np.random.SeedSequence(seed, spawn_key=(sensor,))
        self._numbers = np.random.Generator(np.random.PCG64(sequence))
        self._drawn, self._last = 0, np.zeros(len(self._deviation))

    def added(self, value: Array, row: int) -> Array:
        """Return a sample (k,) with its errors; `row` is its number, from 0."""
        if self.is_exact:
            return value
        if self._drawn > row + 1:
            self._restart()
        while self._drawn <= row:
            drawn = self._draw(min(row + 1 - self._drawn, PORTION))
            self._last = drawn[-1]
        return self._with(value, self._last)

    def added_to_all(self, values: Array) -> Array:
        """Return the samples (m, k) from the first one on with their errors."""
        if self.is_exact:
            return values
        self._restart()
        return self._with(values, self._draw(len(values)))

    def _draw(self, count: int) -> Array:
        self._drawn += count
        return self._numbers.standard_normal((count, len(self._deviation)))

    def _with(self, values: Array, drawn: Array) -> Array:
        return np.asarray(values + self._bias + self._deviation * drawn)


def joint_noise(sensors: Sensors, robot: Robot) -> Noise:
    """Return the errors of angles, rates and torques of all joint axes, one after the other."""
    deviations = (
        sensors.joint_position_noise,
        sensors.joint_velocity_noise,
        sensors.joint_effort_noise,
    )
    return _noise(sensors, 0, JOINTS, np.repeat(deviations, len(robot.axis_names)))


def imu_noise(sensors: Sensors, link: int) -> Noise:
    """
    Return the errors of angular velocity and specific force at a link, index from 0.

    Those of frames of links are numbered from FIRST_FRAME on, in the order of all frames.
    """
    deviation = np.repeat([sensors.imu_angular_velocity_noise, sensors.imu_acceleration_noise], 3)
    bias = np.ravel(
        np.stack(
            [
                np.broadcast_to(sensors.imu_angular_velocity_bias, 3),
                np.broadcast_to(sensors.imu_acceleration_bias, 3),
            ]
        )
    )
    return _noise(sensors, link, IMU, deviation, bias)


def contact_noise(sensors: Sensors, link: int) -> Noise:
    """Return the errors of force and torque of the contacts of a link, index from 0."""
    deviation = np.repeat([sensors.contact_force_noise, sensors.contact_torque_noise], 3)
    return _noise(sensors, link, CONTACTS, deviation)


def _noise(
    sensors: Sensors, link: int, kind: int, deviation: Array, bias: Array | None = None
) -> Noise:
    no_bias = np.zeros(len(deviation)) if bias is None else bias
    return Noise(sensors.sensor_seed, 3 * link + kind, np.asarray(deviation, dtype=float), no_bias)


# ---- sensors of a simulation --------------------------------------------------------------------


class SensorReader:
    """
    Reads the sensors at the states of a simulation, one after the other.

    Parameters
    ----------
    simulation : Simulation
    sensors : Sensors
    steps : int
        Steps from one state to the next.
    rate : float
        States a second [Hz].

    Attributes
    ----------
    imu_places : Imus
    contact_links : list of int
        Indices of the links whose contact forces are measured.

    Raises
    ------
    ParameterError
        If there is no such link, or the rate of the sensors does not divide that of the states.

    """

    def __init__(self, simulation: Simulation, sensors: Sensors, steps: int, rate: float) -> None:
        self.robot = simulation.scene.robot
        self.imu_places = sensors.imus(self.robot)
        self.contact_links = sensors.links('contact_force_links', self.robot)
        self._simulation, self._steps = simulation, steps
        self._steps_in_sample = steps * sensors.states_in_sample(rate)
        self._joints = joint_noise(sensors, self.robot)
        self._imus = [imu_noise(sensors, link) for link in self.imu_places.streams]
        self._contacts = [contact_noise(sensors, link) for link in self.contact_links]
        self.restart()

    def restart(self) -> None:
        """Make the present state the first sample, from which on all noise begins anew."""
        self._begin, self._row = self._simulation.step_count, 0
        self.rest()

    def rest(self) -> None:
        """Take the present velocities as those before, too: the robot was put here."""
        self._before = self._velocity = self._moves()[1][:, :3]

    def _moves(self) -> tuple[Array, Array]:
        state = self._simulation.state
        return self.imu_places.moves(state.q, state.u)

    def is_due(self) -> bool:
        """Return whether the present state is a sample of the IMUs and of the contacts."""
        return (self._simulation.step_count - self._begin) % self._steps_in_sample == 0

    def _row_at(self, steps: int) -> int:
        return int(self._simulation.step_count - self._begin) // steps

    def imus(self) -> Array:
        """Return the readings of the IMUs, shape (links, 10), as `imu_readings` does."""
        scene, row = self._simulation.scene, self._row_at(self._steps_in_sample)
        q, u = self._moves()
        if row != self._row:
            self._row, self._before, self._velocity = row, self._velocity, u[:, :3]
        found = imu_readings(scene.gravity, q, u, self._before, self._steps_in_sample * scene.dt)
        for reading, noise in zip(found, self._imus, strict=True):
            reading[MEASURED] = noise.added(reading[MEASURED], row)
        return found

    def wrenches(self) -> Array:
        """Return the wrenches of the contacts, (links, 6), as `wrenches_on_links`."""
        simulation, row = self._simulation, self._row_at(self._steps_in_sample)
        now = simulation.state, simulation.history
        found: Array = contact_wrenches(simulation.scene, *now)[self.contact_links]
        for wrench, noise in zip(found, self._contacts, strict=True):
            wrench[:] = noise.added(wrench, row)
        return found

    def add_noise(self, angle: Array, rate: Array, torque: Array) -> None:
        """Add the noise of the present state to angles, rates and torques of the axes (axes,)."""
        if self._joints.is_exact:
            return
        parts = (angle, rate, torque)
        measured = self._joints.added(np.stack(parts).ravel(), self._row_at(self._steps))
        for part, found in zip(parts, measured.reshape(3, *angle.shape), strict=True):
            part[:] = found


# ---- sensors of a recorded run ------------------------------------------------------------------


def recorded_sensors(trajectory: Trajectory, sensors: Sensors) -> dict[str, Array]:
    """
    Return what sensors would have measured in a run, as the node `sim` publishes it.

    Parameters
    ----------
    trajectory : Trajectory
        Of `simulation.run`; its samples are the states of the node. In files there are no
        velocities.
    sensors : Sensors

    Returns
    -------
    dict
        ``sensor_time`` (s,) [s] with an entry for each of s samples. If there are IMUs,
        ``imu_name`` (k,) of links or frames, ``imu_link`` (k,) with numbers of the links from 1,
        ``imu_orientation`` (s, k, 4) x y z w,
        ``imu_angular_velocity`` (s, k, 3) [rad/s] and ``imu_linear_acceleration`` (s, k, 3), the
        specific force [m/s^2]. If contact forces are measured, ``contact_link`` (c,) with numbers
        from 1, and ``contact_wrench`` (s, c, 6) [N], [N m]. If joints have noise,
        ``measured_joint_angle``, ``measured_joint_velocity`` and ``measured_joint_torque``
        (m, axes), at all m states.

    Raises
    ------
    ParameterError
        If there is no such link, the rate of the sensors does not divide that of the samples, or
        velocities are needed and unknown.

    """
    scene, m = trajectory.scene, len(trajectory.time)
    imus = sensors.imus(scene.robot)
    touching = sensors.links('contact_force_links', scene.robot)
    steps = round((trajectory.time[1] - trajectory.time[0]) / scene.dt) if m > 1 else 1
    every = sensors.states_in_sample(1.0 / (steps * scene.dt))
    found: dict[str, Array] = {}
    if imus.names or touching:
        found['sensor_time'] = trajectory.time[::every]
    if imus.names:
        readings = _imus(trajectory, sensors, imus, every, every * steps * scene.dt)
        found['imu_name'] = np.array(imus.names)
        found['imu_link'] = imus.link + 1
        found['imu_orientation'] = readings[..., ORIENTATION]
        found['imu_angular_velocity'] = readings[..., ANGULAR_VELOCITY]
        found['imu_linear_acceleration'] = readings[..., ACCELERATION]
    if touching:
        found['contact_link'] = np.array(touching) + 1
        found['contact_wrench'] = _wrenches(trajectory, sensors, touching, every)
    noise = joint_noise(sensors, scene.robot)
    if not noise.is_exact:
        names = ('angle', 'velocity', 'torque')
        true = np.stack([getattr(trajectory, f'joint_{name}') for name in names], axis=1)
        measured = noise.added_to_all(true.reshape(m, -1)).reshape(true.shape)
        found |= {f'measured_joint_{name}': measured[:, k] for k, name in enumerate(names)}
    return found


def _imus(trajectory: Trajectory, sensors: Sensors, imus: Imus, every: int, time: float) -> Array:
    """Return the readings of all IMUs at every so many states, which are a time [s] apart."""
    if not trajectory.velocity.size:
        raise ParameterError('an IMU needs the velocities of a run, which are not in its file')
    q, u = imus.moves(trajectory.coordinates[::every], trajectory.velocity[::every])
    before = np.concatenate([u[:1, :, :3], u[:-1, :, :3]])
    readings = imu_readings(trajectory.scene.gravity, q, u, before, time)
    for k, link in enumerate(imus.streams):
        exact = readings[:, k, MEASURED]
        readings[:, k, MEASURED] = imu_noise(sensors, link).added_to_all(exact)
    return readings


def _wrenches(trajectory: Trajectory, sensors: Sensors, links: list[int], every: int) -> Array:
    """Return the wrenches of the contacts on links at every so many states."""
    kept = trajectory.every(every)
    if (kept.contact_number < 0).any():
        raise ParameterError('the run does not say which contacts its forces belong to')
    wrenches = wrenches_on_links(
        kept.scene, kept.coordinates, kept.contact_sample, kept.contact_number,
        kept.contact_point, kept.contact_force,
    )[:, links]  # fmt: skip
    for k, link in enumerate(links):
        wrenches[:, k] = contact_noise(sensors, link).added_to_all(wrenches[:, k])
    return wrenches
