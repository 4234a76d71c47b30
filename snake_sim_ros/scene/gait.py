"""
Joint references of snake gaits as pure functions of time, eqs. (70) and (71).

`soft_start` and `wave` take arrays and, when they are compiled, numbers.
"""

from dataclasses import astuple

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Gait


def reference(gait: Gait, time: float | Array, joint_count: int) -> tuple[Array, Array]:
    """
    Return joint reference angles and rates, eqs. (70), (71).

    ``alpha_i = s(t) (A sin(omega t + (i - 1) delta + delta_0) + psi)`` for joints i = 1 to n-1,
    yaw and pitch alike, with the soft start s of `soft_start`. A negative phase lag delta sends
    the wave from link 1 to link n.

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
    waves = [wave(astuple(numbers), fade, t, joint) for numbers in (gait.yaw, gait.pitch)]
    angle, rate = (np.stack(values, axis=-1) for values in zip(*waves, strict=True))
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
    argument = angular_frequency * t + joint * phase_lag + phase
    angle = amplitude * np.sin(argument) + offset
    rate = amplitude * angular_frequency * np.cos(argument)
    return s * angle, s * rate + s_dot * angle
