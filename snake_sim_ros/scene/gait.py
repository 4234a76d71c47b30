# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Joint references of snake gaits as pure functions of time, eqs. (70) and (71), and tables.

`soft_start` and `wave` take arrays and, when they are compiled, numbers.
"""

import numpy as np

from snake_sim_ros.scene.parameters import Array, Gait


def reference(gait: Gait, time: float | Array, joint_count: int) -> tuple[Array, Array]:
    """
    Return joint reference angles and rates, eqs. (70), (71).

    ``alpha_i = s(t) (A sin(omega t + (i - 1) delta + delta_0) + psi)`` for joints i = 1 to n-1,
    yaw and pitch alike, with the soft start s of `soft_start`. A negative phase lag delta sends
    the wave from link 1 to link n. The table of a gait is added to its waves before they fade in.

    Parameters
    ----------
    gait : Gait
    time : float or ndarray, shape (m,)
        Time since the gait began [s].
    joint_count : int
        Number of cardan joints, n-1.

    Returns
    -------
    angle, rate : ndarray, shape (n-1, 2) or (m, n-1, 2)
        Reference (yaw, pitch) [rad] and its time derivative [rad/s].

    """
    t = np.asarray(time, dtype=float)[..., None]
    fade, joint = soft_start(t, gait.soft_start), np.arange(joint_count)
    angle, rate = np.zeros((2, *t.shape[:-1], joint_count, 2))
    for axis, numbers in enumerate((gait.yaw, gait.pitch)):
        if numbers.amplitude != 0.0 or numbers.offset != 0.0:
            each = numbers.amplitude, numbers.angular_frequency, numbers.phase_lag
            numbers_of_wave = *each, numbers.phase, numbers.offset
            angle[..., axis], rate[..., axis] = wave(numbers_of_wave, fade, t, joint)
    if gait.table:
        s, s_dot = (value[..., None] for value in fade)
        told, told_rate = gait.table.reference(t[..., 0])
        angle += s * told
        rate += s * told_rate + s_dot * told
    return angle, rate


def soft_start(time: Array, duration: float) -> tuple[Array, Array]:
    """
    Return the fade-in s = 3x^2 - 2x^3, x = t/T_s up to 1, and its rate [1/s].

    Assumption: the paper mentions a soft start without its formula; this one and its rate are
    continuous.

    Parameters
    ----------
    time : ndarray
        Time since the gait began [s].
    duration : float
        T_s [s]; with 0 there is no soft start.

    """
    if duration == 0.0:
        return 1.0 + 0.0 * time, 0.0 * time
    x = np.minimum(np.maximum(time / duration, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / duration


def wave(
    numbers: tuple[float, ...], fade: tuple[Array, Array], t: Array, joint: Array
) -> tuple[Array, Array]:
    """
    Return angle [rad] and rate [rad/s] of one wave that fades in.

    Parameters
    ----------
    numbers : tuple of float
        The values of a `parameters.Wave`.
    fade : tuple of ndarray
        As `soft_start` returns it.
    t : ndarray
        Time since the gait began [s].
    joint : ndarray
        Number of the joint, from 0.

    """
    amplitude, angular_frequency, phase_lag, phase, offset = numbers
    s, s_dot = fade
    # sin and cos of a sum: of each time and of each joint once, not of all pairs.
    sine, cosine = np.sin(angular_frequency * t + phase), np.cos(angular_frequency * t + phase)
    s_joint, c_joint = amplitude * np.sin(joint * phase_lag), amplitude * np.cos(joint * phase_lag)
    angle = sine * c_joint + (cosine * s_joint + offset)
    rate = (s * angular_frequency * cosine) * c_joint - (s * angular_frequency * sine) * s_joint
    return s * angle, rate + s_dot * angle
