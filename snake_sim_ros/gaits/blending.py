# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Gaits that change while they run, without a jump in angles or rates.

A gait has a carrier phase for each wave and, for each joint and wave, a complex number z that
turns it into an angle: ``alpha = Im(z exp(i phi)) + psi``, ``z = A_j exp(i ((j - 1) delta +
delta_0))``. A change blends z, the offset psi and the frequency linearly from the old gait to the
new one, with the weight s of `gait.soft_start` over a fixed time. phi is the exact integral of the
frequency, so a new frequency keeps the phase. Changes may come at any time, also during a blend:
the weights of all gaits remain positive and sum to 1. Every convex condition that holds for each
gait therefore holds in between. The limits of the joints are such conditions, see `check_limits`.

The table of a gait is one more term of the sum, with the weight of the gait. Its time runs
from the beginning of the very first gait, whenever it is blended in.

A robot that does not stand where its gait begins blends from its posture into the gait in the same
way: the posture is one more term of the sum, with the first weight, and has no phase.
"""

from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import amplitudes, at_joint, AXES, Gait, soft_start, Table, Wave
from snake_sim_ros.scene.parameters import Array, Robot

LARGEST_RATIO = 4  # of pitch to yaw frequency, whole: the waves then form one motion


# ---- compiled -----------------------------------------------------------------------------------


class Waves(NamedTuple):
    """The numbers of both waves of a gait, (yaw, pitch), shape (2,) each; see `gait.Wave`."""

    amplitude: Array
    angular_frequency: Array
    phase_lag: Array
    phase: Array
    offset: Array
    gradient: Array

    @classmethod
    def of(cls, gait: Gait) -> 'Waves':
        """Return those of a gait, in memory of their own."""
        waves = gait.yaw, gait.pitch
        return cls(*(np.array([getattr(wave, name) for wave in waves]) for name in cls._fields))

    def copied(self) -> 'Waves':
        """Return the same numbers in memory of their own."""
        return Waves(*(numbers.copy() for numbers in self))


class Mixture(NamedTuple):
    """
    Gaits in memory, each blended into the next, with room for k; see `Blend`.

    Attributes
    ----------
    present : ndarray of int64, shape (1,)
        How many there are; the first rows are theirs.
    begin : ndarray, shape (k,)
        Times at which each gait but the first begins to replace the one before [s].
    frequency, offset : ndarray, shape (k, 2)
        Of the yaw and the pitch wave of every gait [rad/s], [rad].
    amplitude : ndarray, shape (k, 4(n-1))
        z of every gait [rad]: the real parts of all joints and their imaginary parts, for the yaw
        wave and then for the pitch wave.
    phase : ndarray, shape (2,)
        Phases that the waves would have at time 0 if the first of these gaits had always run
        [rad].
    shift : ndarray, shape (1,)
        Phase of the pitch wave of the last gait beyond the one in its parameters [rad].
    posture : ndarray, shape (n-1, 2)
        Angles (yaw, pitch) at rest at time 0 [rad].
    entry, fade_in, duration : float
        Times of the blend from the posture, of the soft start of the very first gait, and of every
        blend between gaits [s].
    weight, weight_rate : ndarray, shape (k,)
        Of every gait at a time [1], [1/s].
    carrier : ndarray, shape (2, 2)
        Phases [rad] and frequencies [rad/s] of both waves at that time.
    z, z_rate : ndarray, shape (4(n-1),)
        The sum of all z with these weights, and its rate [rad], [rad/s].

    """

    present: Array
    begin: Array
    frequency: Array
    offset: Array
    amplitude: Array
    phase: Array
    shift: Array
    posture: Array
    entry: float
    fade_in: float
    duration: float
    weight: Array
    weight_rate: Array
    carrier: Array
    z: Array
    z_rate: Array


# Of numbers, not of arrays.
progress: Any = compiled(soft_start)
amplitude_at: Any = compiled(at_joint)


def make_mixture(
    gait: Gait, joint_count: int, duration: float, posture: Array | None, room: int
) -> Mixture:
    """Return a mixture of one gait, see `Blend.of`."""
    begin, weight, weight_rate = np.zeros((3, room))
    frequency, offset = np.zeros((2, room, 2))
    mixture = Mixture(
        present=np.zeros(1, np.int64),
        begin=begin,
        frequency=frequency,
        offset=offset,
        amplitude=np.zeros((room, 4 * joint_count)),
        phase=np.zeros(2),
        shift=np.zeros(1),
        posture=np.zeros((joint_count, 2)) if posture is None else np.array(posture, dtype=float),
        entry=0.0 if posture is None else float(duration),
        fade_in=float(gait.soft_start),
        duration=float(duration),
        weight=weight,
        weight_rate=weight_rate,
        carrier=np.zeros((2, 2)),
        z=np.zeros(4 * joint_count),
        z_rate=np.zeros(4 * joint_count),
    )
    change(mixture, 0.0, Waves.of(gait))
    return mixture


@compiled
def blend_into(mixture: Mixture, time: float, waves: Waves) -> None:
    """Let other waves begin to replace the last gait; see `Blend.changed`."""
    begin, frequency, phase = mixture.begin, mixture.frequency, mixture.phase
    count, over = mixture.present[0], 0
    for i in range(1, count):
        if begin[i] + mixture.duration <= time:
            over = i
    for i in range(1, over + 1):
        for axis in range(2):
            phase[axis] -= delay_of(mixture, i, axis)
    for i in range(over if over else count, count):
        begin[i - over] = begin[i]
        for axis in range(2):
            frequency[i - over, axis] = frequency[i, axis]
            mixture.offset[i - over, axis] = mixture.offset[i, axis]
        for k in range(mixture.amplitude.shape[1]):
            mixture.amplitude[i - over, k] = mixture.amplitude[i, k]
    last = count - over
    begin[last] = time
    for axis in range(2):
        frequency[last, axis] = waves.angular_frequency[axis]
        mixture.offset[last, axis] = waves.offset[axis]
    mixture.present[0] = last + 1
    if last > 0:
        place_pitch_on_yaw(mixture, waves)
    joints = len(mixture.posture)
    for axis in range(2):
        first = waves.phase[axis] + (mixture.shift[0] if axis == 1 else 0.0)
        for j in range(joints):
            amplitude = amplitude_at(waves.amplitude[axis], waves.gradient[axis], j, joints)
            lag = j * waves.phase_lag[axis] + first
            real = 2 * axis * joints + j
            mixture.amplitude[last, real] = amplitude * math.cos(lag)
            mixture.amplitude[last, real + joints] = amplitude * math.sin(lag)


@compiled
def place_pitch_on_yaw(mixture: Mixture, waves: Waves) -> None:
    """If both waves are one motion, shift the pitch wave to its place on the yaw wave."""
    yaw, pitch = waves.angular_frequency[0], waves.angular_frequency[1]
    if yaw * waves.amplitude[0] * waves.amplitude[1] == 0.0:
        return
    for multiple in range(-LARGEST_RATIO, LARGEST_RATIO + 1):
        if abs(pitch - multiple * yaw) < 1e-9 * abs(yaw):
            on_yaw, on_pitch = mixture.phase[0], mixture.phase[1]
            for i in range(1, mixture.present[0]):
                on_yaw -= delay_of(mixture, i, 0)
                on_pitch -= delay_of(mixture, i, 1)
            mixture.shift[0] = multiple * on_yaw - on_pitch


@compiled
def delay_of(mixture: Mixture, i: int, axis: int) -> float:
    """Return the phase at time 0 that change i takes away in the end [rad]."""
    change = mixture.frequency[i, axis] - mixture.frequency[i - 1, axis]
    return float((mixture.begin[i] + mixture.duration / 2) * change)


@compiled
def set_terms(mixture: Mixture, t: float) -> tuple[float, float]:
    """Set weights and carriers at a time, and return the progress into the first gait."""
    T, count, carrier = mixture.duration, mixture.present[0], mixture.carrier
    for axis in range(2):
        omega = mixture.frequency[0, axis]
        carrier[0, axis], carrier[1, axis] = mixture.phase[axis] + omega * t, omega
    entered, entered_rate = progress(t, mixture.entry)
    before, before_rate = entered, entered_rate
    for i in range(1, count):
        age = t - mixture.begin[i]
        s, s_rate = progress(age, T)
        mixture.weight[i - 1], mixture.weight_rate[i - 1] = before - s, before_rate - s_rate
        before, before_rate = s, s_rate
        # The integral of s is T (x^3 - x^4/2) up to x = age/T = 1, then age - T/2.
        x = min(max(age / T, 0.0), 1.0)
        area = T * x * x * x * (1.0 - x / 2.0) + max(age - T, 0.0)
        for axis in range(2):
            change = mixture.frequency[i, axis] - mixture.frequency[i - 1, axis]
            carrier[0, axis] += area * change
            carrier[1, axis] += s * change
    mixture.weight[count - 1], mixture.weight_rate[count - 1] = before, before_rate
    return entered, entered_rate


@compiled
def add_waves(mixture: Mixture, t: float, angle: Array, rate: Array) -> None:
    """Add the waves at a time to what the tables contribute, (n-1, 2), with all that fades."""
    entered, entered_rate = set_terms(mixture, t)
    z, z_rate, joints = mixture.z, mixture.z_rate, len(angle)
    z[:], z_rate[:] = 0.0, 0.0
    for i in range(mixture.present[0]):
        w, w_rate = mixture.weight[i], mixture.weight_rate[i]
        for k in range(len(z)):
            z[k] += w * mixture.amplitude[i, k]
            z_rate[k] += w_rate * mixture.amplitude[i, k]
    for axis in range(2):
        offset, offset_rate = 0.0, 0.0
        for i in range(mixture.present[0]):
            offset += mixture.weight[i] * mixture.offset[i, axis]
            offset_rate += mixture.weight_rate[i] * mixture.offset[i, axis]
        phase, omega = mixture.carrier[0, axis], mixture.carrier[1, axis]
        sine, cosine = math.sin(phase), math.cos(phase)
        for j in range(joints):
            re = 2 * axis * joints + j
            im = re + joints
            real, imaginary = z_rate[re] - omega * z[im], z_rate[im] + omega * z[re]
            angle[j, axis] += z[re] * sine + z[im] * cosine + offset
            rate[j, axis] += real * sine + imaginary * cosine + offset_rate
    if t < mixture.fade_in:
        s, s_rate = progress(t, mixture.fade_in)
        for j in range(joints):
            for axis in range(2):
                rate[j, axis] = s * rate[j, axis] + s_rate * angle[j, axis]
                angle[j, axis] *= s
    if t < mixture.entry:
        for j in range(joints):
            for axis in range(2):
                angle[j, axis] += (1.0 - entered) * mixture.posture[j, axis]
                rate[j, axis] -= entered_rate * mixture.posture[j, axis]


@entry
def change(mixture: Mixture, time: float, waves: Waves) -> None:
    """Change the last gait, see `blend_into`."""
    blend_into(mixture, time, waves)


@entry
def sample_waves(mixture: Mixture, times: Array, angle: Array, rate: Array) -> None:
    """Add the waves at times (m,) to angles [rad] and rates [rad/s], (m, n-1, 2)."""
    for k in range(len(times)):
        add_waves(mixture, times[k], angle[k], rate[k])


@entry
def sample_weights(mixture: Mixture, times: Array, weight: Array, rate: Array) -> None:
    """Fill the weights of all gaits at times (m,) and their rates, (m, k) [1], [1/s]."""
    for k in range(len(times)):
        set_terms(mixture, times[k])
        for i in range(mixture.present[0]):
            weight[k, i], rate[k, i] = mixture.weight[i], mixture.weight_rate[i]


# ---- blends -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Blend:
    """
    The gaits of the last `duration`, each blended into the next, and their joint reference.

    Attributes
    ----------
    gait : Gait
        The last gait.
    mixture : Mixture
        All of them.
    tables : tuple of Table
        The table of every gait.

    """

    gait: Gait
    mixture: Mixture
    tables: tuple[Table, ...]

    @classmethod
    def of(
        cls, gait: Gait, joint_count: int, duration: float, posture: Array | None = None
    ) -> 'Blend':
        """
        Return the reference of one gait from its time 0 on, that of `gait.reference`.

        Parameters
        ----------
        gait : Gait
        joint_count : int
            Number of cardan joints, n-1.
        duration : float
            Time of every blend [s].
        posture : ndarray, shape (n-1, 2), optional
            Angles (yaw, pitch) from which the reference starts at rest and blends into the gait,
            within the joint limit [rad]. By default it is in the gait at once.

        """
        return cls(gait, make_mixture(gait, joint_count, duration, posture, 1), (gait.table,))

    def changed(self, time: float, gait: Gait) -> 'Blend':
        """
        Return the reference that begins to blend into another gait now.

        Both waves keep their phase, with one exception. If the pitch frequency is a whole
        multiple of the yaw frequency up to LARGEST_RATIO, the two waves make up one motion, as in
        sidewinding. Then the phases in the parameters determine the place of the pitch wave on the
        yaw wave, and the blend ends there.

        Parameters
        ----------
        time : float
            Now, not before any earlier change [s].
        gait : Gait
            Its soft start is not used.

        """
        before, count = self.mixture, int(self.mixture.present[0])
        rows: dict[str, Any] = {}
        for name in ROWS:
            each = getattr(before, name)
            rows[name] = np.concatenate([each[:count], each[:1]])
        mixture = before._replace(
            present=before.present.copy(), phase=before.phase.copy(), shift=before.shift.copy(),
            **rows,
        )  # fmt: skip
        change(mixture, float(time), Waves.of(gait))
        tables = (*self.tables, gait.table)[-int(mixture.present[0]) :]
        return Blend(gait, mixture, tables)

    def reference(self, time: float | Array) -> tuple[Array, Array]:
        """
        Return joint reference angles and rates; the rates are the exact derivatives.

        Parameters
        ----------
        time : float or ndarray, shape (m,)
            Time since the very first gait began, not before the last change [s].

        Returns
        -------
        angle, rate : ndarray, shape (n-1, 2) or (m, n-1, 2)
            (yaw, pitch) [rad], [rad/s].

        """
        t = np.ascontiguousarray(time, dtype=float)
        times, shape = t.reshape(-1), self.mixture.posture.shape
        angle, rate = np.zeros((2, len(times), *shape))
        if any(self.tables):
            weight, weight_rate = np.empty((2, len(times), len(self.tables)))
            sample_weights(self.mixture, times, weight, weight_rate)
            for k, table in enumerate(self.tables):
                if table:
                    w, w_rate = weight[:, k, None, None], weight_rate[:, k, None, None]
                    of_table, rate_of_table = table.reference(times)
                    angle += w * of_table
                    rate += w * rate_of_table + w_rate * of_table
        sample_waves(self.mixture, times, angle, rate)
        return angle.reshape(*np.shape(time), *shape), rate.reshape(*np.shape(time), *shape)


ROWS = 'begin', 'frequency', 'offset', 'amplitude', 'weight', 'weight_rate'  # of every gait


def narrowest_limits(robot: Robot, axis: str) -> tuple[float, float, float]:
    """Return least and largest angle [rad] and rate [rad/s] that all joints have at an axis."""
    low, high, rate = (each[:, AXES.index(axis)] for each in robot.limits)
    return (
        float(low.max(initial=-robot.joint_limit)),
        float(high.min(initial=robot.joint_limit)),
        float(rate.min(initial=robot.joint_rate_limit)),
    )


def largest_values(robot: Robot, axis: str) -> dict[str, float]:
    """
    Return name -> largest magnitude of the numbers of the wave of an axis, 'yaw' or 'pitch'.

    The wave is that of all joints, so that the narrowest limits count. The frequency is that of a
    wave without amplitude, see `largest_frequency`.
    """
    least, most, _ = narrowest_limits(robot, axis)
    return {
        'amplitude': max(most - least, 0.0) / 2,
        'angular_frequency': largest_frequency(robot, axis, 0.0),
        'phase_lag': 2 * math.pi,
        'phase': 2 * math.pi,
        'offset': max(abs(least), abs(most)),
        'gradient': 1.0,
    }


def largest_frequency(robot: Robot, axis: str, amplitude: float) -> float:
    """
    Return the largest angular frequency of the wave of an axis with an amplitude [rad/s].

    Half of the joint rate limit r is left to the waves, and half to the blends, see
    `shortest_blend`, so that no change of a gait exceeds the limit. In a blend frequency and
    amplitude are means of those of its gaits, with the same weights. With the largest amplitude a,
    ``omega/(r/a) + A/(2 a) <= 1`` therefore holds during the blend as well, and no numbers with
    this sum have a product above r/2.
    """
    return largest_within(*narrowest_limits(robot, axis), amplitude)


def largest_within(low: float, high: float, rate: float, amplitude: float) -> float:
    """Return the same for least and largest angle [rad] and rate [rad/s]."""
    largest = max(high - low, 0.0) / 2
    return (1.0 - abs(amplitude) / (2 * largest)) * rate / largest if largest else 0.0


def shortest_blend(robot: Robot) -> float:
    """
    Return the shortest time of a blend [s].

    With waves up to the joint limit alpha, the blends of any sequence of gaits add to the rate of
    a joint ``alpha sum_k |w_k'| <= 2 alpha max s' = 3 alpha/T``: half of the joint rate limit. The
    slowest joint counts.
    """
    low, high, rate = robot.limits
    return float((6 * np.maximum(-low, high) / rate).max(initial=0.0))


def usual_blend(robot: Robot) -> float:
    """Return the time of a blend where none is given [s]: 1 s, unless the joints need longer."""
    return max(1.0, shortest_blend(robot))


def check_limits(gait: Gait, robot: Robot) -> None:
    """
    Check that the joints can follow a gait and any blend between gaits that pass.

    Raises
    ------
    ParameterError
        If a number of a wave, a rate of the table, or what `check_reach` adds, is too large.

    """
    if gait.table:
        rate, fastest = robot.limits.rate / 2, gait.table.extremes()[2]
        worst = int((fastest / rate).argmax())
        if fastest.flat[worst] > rate.flat[worst]:
            of = '' if (rate == rate[0, 0]).all() else f' of {robot.name_of_axis(worst)}'
            raise ParameterError(
                f'gait.table must have rates of at most {rate.flat[worst]:.4g} rad/s, half of the '
                f'joint rate limit{of}, got {fastest.flat[worst]:.4g} rad/s'
            )
    for axis, wave in (('yaw', gait.yaw), ('pitch', gait.pitch)):
        for name, largest in largest_values(robot, axis).items():
            value, of = getattr(wave, name), ''
            if name == 'amplitude' and wave.gradient:
                largest /= 1.0 + abs(wave.gradient)
                of = f' with a gradient of {wave.gradient:.4g}'
            if name == 'angular_frequency':
                largest = largest_frequency(robot, axis, wave.largest)
                of = f' with an amplitude of {wave.largest:.4g} rad'
            if abs(value) > largest:
                unit = Wave.__dataclass_fields__[name].metadata['unit']
                raise ParameterError(
                    f'gait.{axis}.{name} must be within +-{largest:.4g} {unit}{of}, '
                    f'got {value:.4g} {unit}'
                )
    check_reach(gait, robot)


def check_reach(gait: Gait, robot: Robot) -> None:
    """
    Check that the angles of a gait are within the limits of the joints.

    Raises
    ------
    ParameterError
        If offset plus or minus amplitude, plus the angles of the table, is beyond them.

    """
    still = np.zeros((robot.link_count - 1, 2))
    low, high = gait.table.extremes()[:2] if gait.table else (still, still)
    for k, (axis, wave) in enumerate((('yaw', gait.yaw), ('pitch', gait.pitch))):
        reach_of_wave = np.abs(amplitudes(wave, len(low)))
        least = wave.offset - reach_of_wave + low[:, k]
        largest = wave.offset + reach_of_wave + high[:, k]
        if len(least) and (beyond := robot.beyond(k, least, largest)):
            j, limit = beyond
            reach = max(largest[j], least[j], key=abs)
            of_table = max(low[j, k], high[j, k], key=abs)
            plus = ' plus the largest angle of gait.table' if of_table else ''
            degrees = ''
            if abs(of_table) > math.pi:
                degrees = '; columns in degrees end in _deg'
            elif abs(reach) > math.pi and not of_table:
                degrees = f'; for degrees say gait.{axis}.amplitude_deg'
            raise ParameterError(
                f'amplitude plus offset of gait.{axis}{plus} must be within {limit}, got '
                f'{reach:.4g} rad{degrees}'
            )
