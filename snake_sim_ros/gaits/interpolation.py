# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiled sampling of joint references; see `joint_reference`.

The rows of the arrays angle [rad] and rate [rad/s] belong to times, their columns to joint axes.
"""

import math

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled


@compiled
def sample_command(times, stamp, told_angle, told_rate, horizon, angle, rate):
    """
    Fill angles that change at their rates for a while after their stamps and are held afterwards.

    Parameters
    ----------
    times : ndarray, shape (m,)
        Times to sample at [s].
    stamp, told_angle, told_rate : ndarray, shape (k,)
        Time of the command [s], angle [rad] and rate [rad/s] of every axis.
    horizon : float
        Time for which a rate acts [s].
    angle, rate : ndarray, shape (m, k)
        Filled.

    """
    for i in range(len(times)):
        for k in range(len(stamp)):
            age = times[i] - stamp[k]
            angle[i, k] = told_angle[k] + min(age, horizon) * told_rate[k]
            rate[i, k] = told_rate[k] if age <= horizon else 0.0


@compiled
def sample_motion(times, axes, knots, coefficients, angle, rate):
    """
    Fill the columns of some axes from the begin of a motion on; see `Motion`.

    Parameters
    ----------
    times : ndarray, shape (m,)
        Times to sample at, increasing [s].
    axes : ndarray of int, shape (k,)
        Columns to fill; negative where none is.
    knots : ndarray, shape (points,)
        Times of the points of the motion [s].
    coefficients : ndarray, shape (points-1, 4, k)
        Coefficients of its pieces.
    angle, rate : ndarray, shape (m, all axes)
        Filled in part.

    """
    piece, last = 0, len(knots) - 1
    for i in range(len(times)):
        if times[i] < knots[0]:
            continue
        if knots[piece + 1] <= times[i]:
            piece = min(np.searchsorted(knots, times[i], 'right'), last) - 1
        moving = times[i] < knots[last]
        s = min(times[i], knots[last]) - knots[piece]
        for k in range(len(axes)):
            if axes[k] < 0:
                continue
            a, b = coefficients[piece, 0, k], coefficients[piece, 1, k]
            c, d = coefficients[piece, 2, k], coefficients[piece, 3, k]
            angle[i, axes[k]] = a + s * (b + s * (c + s * d))
            rate[i, axes[k]] = b + s * (2.0 * c + s * (3.0 * d)) if moving else 0.0


@compiled
def hold_at_limit(limit, angle, rate):
    """
    Clip angles to a limit [rad], and set the rates of clipped axes to 0.

    Parameters
    ----------
    limit : float
        Largest magnitude of an angle [rad].
    angle, rate : ndarray, shape (m, k)
        Changed in place.

    """
    for i in range(angle.shape[0]):
        for k in range(angle.shape[1]):
            if abs(angle[i, k]) > limit:
                angle[i, k] = math.copysign(limit, angle[i, k])
                rate[i, k] = 0.0
