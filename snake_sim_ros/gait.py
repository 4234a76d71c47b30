"""Joint references of snake gaits as pure functions of time, eqs. (70) and (71)."""

import numpy as np

from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Gait
from snake_sim_ros.parameters import Wave


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
    s, s_dot = soft_start(t, gait.soft_start)
    waves = [_wave(wave, t, np.arange(joint_count)) for wave in (gait.yaw, gait.pitch)]
    angle = np.stack([s * value for value, _ in waves], axis=-1)
    rate = np.stack([s * derivative + s_dot * value for value, derivative in waves], axis=-1)
    return angle, rate


def soft_start(time: Array, duration: float) -> tuple[Array, Array]:
    """
    Return the fade-in s = 3x^2 - 2x^3, x = t/T_s up to 1, and its rate [1/s].

    Assumption: the paper names a soft start without its formula; this one is continuous with its
    rate.
    """
    if duration == 0.0:
        return np.ones_like(time), np.zeros_like(time)
    x = np.clip(time / duration, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / duration


def _wave(wave: Wave, t: Array, joint: Array) -> tuple[Array, Array]:
    phase = wave.angular_frequency * t + joint * wave.phase_lag + wave.phase
    angle = wave.amplitude * np.sin(phase) + wave.offset
    return angle, wave.amplitude * wave.angular_frequency * np.cos(phase)
