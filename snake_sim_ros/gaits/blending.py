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

from dataclasses import dataclass, replace
import math

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import amplitudes, AXES, Gait, soft_start, Table, Wave
from snake_sim_ros.scene.parameters import Array, Robot

FREQUENCY_RATIOS = range(-4, 5)  # pitch over yaw frequency; the waves then form one motion


@dataclass(frozen=True)
class Blend:
    """
    The gaits of the last `duration`, each blended into the next, and their joint reference.

    Attributes
    ----------
    gait : Gait
        The last gait.
    joint_count : int
        Number of cardan joints, n-1.
    duration : float
        Time of every blend [s].
    fade_in : float
        Time of the soft start of the very first gait [s].
    posture : ndarray, shape (n-1, 2)
        Angles (yaw, pitch) at rest at time 0 [rad].
    entry : float
        Time of the blend from the posture into the very first gait [s]; 0 if there is none.
    begins : ndarray, shape (m,)
        Times at which each gait but the first begins to replace the one before [s].
    frequency, offset : ndarray, shape (m+1, 2)
        Of the yaw and the pitch wave of every gait [rad/s], [rad].
    amplitude : ndarray of complex, shape (m+1, n-1, 2)
        z of every gait and joint [rad].
    phase : ndarray, shape (2,)
        Phases that the waves would have at time 0 if the first of these gaits had always run
        [rad].
    shift : float
        Phase of the pitch wave of the last gait beyond the one in its parameters [rad].
    tables : tuple of Table
        The table of every gait.

    """

    gait: Gait
    joint_count: int
    duration: float
    fade_in: float
    posture: Array
    entry: float
    begins: Array
    frequency: Array
    offset: Array
    amplitude: Array
    phase: Array
    shift: float
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
        return cls(
            gait=gait,
            joint_count=joint_count,
            duration=duration,
            fade_in=gait.soft_start,
            posture=np.zeros((joint_count, 2)) if posture is None else posture,
            entry=0.0 if posture is None else duration,
            begins=np.zeros(0),
            frequency=_frequency(gait)[None],
            offset=_offset(gait)[None],
            amplitude=_amplitude(gait, joint_count, 0.0)[None],
            phase=np.zeros(2),
            shift=0.0,
            tables=(gait.table,),
        )

    def changed(self, time: float, gait: Gait) -> 'Blend':
        """
        Return the reference that begins to blend into another gait now.

        Both waves keep their phase, with one exception. If the pitch frequency is one of the
        multiples FREQUENCY_RATIOS of the yaw frequency, the two waves make up one motion, as in
        sidewinding. Then the phases in the parameters determine the place of the pitch wave on the
        yaw wave, and the blend ends there.

        Parameters
        ----------
        time : float
            Now, not before any earlier change [s].
        gait : Gait
            Its soft start is not used.

        """
        over = np.searchsorted(self.begins + self.duration, time, side='right')
        phase = self.phase - self._delays[:over].sum(axis=0)
        later = replace(
            self,
            gait=gait,
            begins=np.append(self.begins[over:], time),
            frequency=np.vstack([self.frequency[over:], _frequency(gait)]),
            offset=np.vstack([self.offset[over:], _offset(gait)]),
            phase=phase,
            tables=(*self.tables[over:], gait.table),
        )
        yaw, pitch = later.frequency[-1]
        shift, waves = self.shift, yaw * gait.yaw.amplitude * gait.pitch.amplitude
        for multiple in FREQUENCY_RATIOS:
            if waves != 0.0 and abs(pitch - multiple * yaw) < 1e-9 * abs(yaw):
                on_yaw, on_pitch = phase - later._delays.sum(axis=0)
                shift = multiple * on_yaw - on_pitch
        amplitude = _amplitude(gait, self.joint_count, shift)[None]
        return replace(later, amplitude=np.vstack([self.amplitude[over:], amplitude]), shift=shift)

    def reference(self, time: float | Array) -> tuple[Array, Array]:
        """
        Return joint reference angles and rates; the rates are the exact derivatives.

        Parameters
        ----------
        time : float or ndarray, shape (k,)
            Time since the very first gait began, not before the last change [s].

        Returns
        -------
        angle, rate : ndarray, shape (n-1, 2) or (k, n-1, 2)
            (yaw, pitch) [rad], [rad/s].

        """
        t = np.asarray(time, dtype=float)[..., None]
        age, m = t - self.begins, len(self.begins)
        s, s_dot = soft_start(age, self.duration)
        entered, entered_dot = soft_start(t, self.entry)
        weight, weight_dot = _weights(s, entered), _weights(s_dot, entered_dot)
        # The integral of s is T (x^3 - x^4/2) up to x = age/T = 1, then age - T/2.
        x = np.minimum(np.maximum(age / self.duration, 0.0), 1.0)
        area = self.duration * x * x * x * (1.0 - x / 2.0) + np.maximum(age - self.duration, 0.0)
        changes = self.frequency[1:] - self.frequency[:-1]
        phase = self.phase + self.frequency[0] * t + area @ changes
        omega = (self.frequency[0] + s @ changes)[..., None]
        # Axes come before joints: what all joints share is then one number for many.
        numbers = np.empty((m + 1, 4 * self.joint_count + 2))
        by_axis = np.ascontiguousarray(self.amplitude.swapaxes(1, 2))
        numbers[:, :-2], numbers[:, -2:] = by_axis.reshape(m + 1, -1).view(float), self.offset
        now, change = weight @ numbers, weight_dot @ numbers
        shape = *t.shape[:-1], 2, self.joint_count
        z, z_dot = (part[..., :-2].view(complex).reshape(shape) for part in (now, change))
        carrier = np.exp(1j * phase)[..., None]
        angle = (z * carrier).imag + now[..., -2:, None]
        rate = ((z_dot + 1j * omega * z) * carrier).imag + change[..., -2:, None]
        angle, rate = (np.ascontiguousarray(each.swapaxes(-1, -2)) for each in (angle, rate))
        for k, table in enumerate(self.tables):
            if table:
                w, w_dot = weight[..., k, None, None], weight_dot[..., k, None, None]
                of_table, rate_of_table = table.reference(t[..., 0])
                angle, rate = angle + w * of_table, rate + w * rate_of_table + w_dot * of_table
        if t.min(initial=math.inf) < self.fade_in:
            fade, fade_dot = (value[..., None] for value in soft_start(t, self.fade_in))
            angle, rate = fade * angle, fade * rate + fade_dot * angle
        if self.entry:
            angle += (1.0 - entered)[..., None] * self.posture
            rate -= entered_dot[..., None] * self.posture
        return angle, rate

    @property
    def _delays(self) -> Array:
        """Phases at time 0 that every change takes away in the end, shape (m, 2) [rad]."""
        return (self.begins + self.duration / 2)[:, None] * np.diff(self.frequency, axis=0)


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
    least, most, rate = narrowest_limits(robot, axis)
    largest = max(most - least, 0.0) / 2
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


def _frequency(gait: Gait) -> Array:
    return np.array([gait.yaw.angular_frequency, gait.pitch.angular_frequency])


def _offset(gait: Gait) -> Array:
    return np.array([gait.yaw.offset, gait.pitch.offset])


def _amplitude(gait: Gait, joint_count: int, shift: float) -> Array:
    """Return z of every joint, with the pitch wave shifted by an angle, shape (n-1, 2)."""
    joint = np.arange(joint_count)
    yaw, pitch = (
        amplitudes(wave, joint_count) * np.exp(1j * (joint * wave.phase_lag + wave.phase + angle))
        for wave, angle in ((gait.yaw, 0.0), (gait.pitch, shift))
    )
    return np.column_stack([yaw, pitch])


def _weights(s: Array, first: Array) -> Array:
    """
    Return the weights of the gaits from the progress of the changes, shape (..., m+1).

    `first` is the progress into the first gait, shape (..., 1); with rates of s and `first` it
    returns those of the weights.
    """
    weight = np.empty((*s.shape[:-1], s.shape[-1] + 1))
    weight[..., :1] = first
    weight[..., 1:] = s
    weight[..., :-1] -= s
    return weight
