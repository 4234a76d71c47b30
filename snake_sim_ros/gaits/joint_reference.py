# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
References of the joints over time: commands, held or extrapolated, trajectories, a limit of rates.

In compiled sampling, rows of the arrays angle [rad] and rate [rad/s] belong to times, columns to
joint axes.
"""

from dataclasses import dataclass, replace

import numpy as np

from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.scene.chain import JointLimits
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import initial_coordinates, joint_angles

# ---- compiled sampling --------------------------------------------------------------------------


@entry
def sample_command(
    times: Array,
    command: tuple[Array, Array, Array],
    horizon: float,
    angle: Array,
    rate: Array,
) -> None:
    """
    Fill angles that change at their rates for a while after their stamps and are held afterwards.

    Parameters
    ----------
    times : ndarray, shape (m,)
        Times to sample at [s].
    command : tuple of ndarray, shape (k,)
        Time of the command [s], angle [rad] and rate [rad/s] of every axis.
    horizon : float
        Time for which a rate acts [s].
    angle, rate : ndarray, shape (m, k)
        Filled.

    """
    stamp, command_angle, command_rate = command
    for i in range(len(times)):
        for k in range(len(stamp)):
            age = times[i] - stamp[k]
            angle[i, k] = command_angle[k] + min(age, horizon) * command_rate[k]
            rate[i, k] = command_rate[k] if age <= horizon else 0.0


@entry
def sample_motion(
    times: Array, axes: Array, knots: Array, coefficients: Array, angle: Array, rate: Array
) -> None:
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


@entry
def hold_at_limit(low: Array, high: Array, angle: Array, rate: Array) -> None:
    """
    Clip angles to their limits, and set the rates of clipped axes to 0.

    Parameters
    ----------
    low, high : ndarray, shape (k,)
        Least and largest angle of every axis [rad].
    angle, rate : ndarray, shape (m, k)
        Changed in place.

    """
    for i in range(angle.shape[0]):
        for k in range(angle.shape[1]):
            if angle[i, k] > high[k] or angle[i, k] < low[k]:
                angle[i, k] = high[k] if angle[i, k] > high[k] else low[k]
                rate[i, k] = 0.0


# ---- motions and commands -----------------------------------------------------------------------


SINGLE_POINT_DURATION = 1e-3  # length of a motion that has only one point [s]
NONE = -1  # in place of an axis


@dataclass(frozen=True)
class Motion:
    """
    A trajectory of some joint axes, cubic in time between its points; after its end the axes hold.

    Attributes
    ----------
    axes : ndarray of int, shape (k,)
        Joint axes, counted along the robot, yaw before pitch; NONE where the motion lost one.
    times : ndarray, shape (points,)
        Times of the points [s].
    coefficients : ndarray, shape (points-1, 4, k)
        Coefficients of the powers 0 to 3 of the time since the begin of a piece.

    """

    axes: Array
    times: Array
    coefficients: Array

    @property
    def begin(self) -> float:
        """Time of the first point [s]."""
        return float(self.times[0])

    @property
    def end(self) -> float:
        """Time of the last point [s]."""
        return float(self.times[-1])

    def extremes(self) -> tuple[Array, Array, Array]:
        """Return least and largest angle [rad] and fastest rate [rad/s], shape (points-1, k)."""
        a, b, c, d = np.moveaxis(self.coefficients, 1, 0)
        span = np.diff(self.times)[:, None]
        moments = [span]
        if c.any() or d.any():
            with np.errstate(divide='ignore', invalid='ignore'):
                root = np.sqrt(c * c - 3 * b * d)
                # Roots of the rate, in the form that takes no difference of near numbers.
                half = -(c + np.copysign(root, c))
                turns = half / (3 * d), b / half
                bends = -c / (3 * d)
            moments += [np.where((s > 0) & (s < span), s, 0.0) for s in (*turns, bends)]
        least, largest, fastest = a.copy(), a.copy(), np.abs(b)
        for s in moments:
            angle = a + s * (b + s * (c + s * d))
            np.minimum(least, angle, out=least)
            np.maximum(largest, angle, out=largest)
            np.maximum(fastest, np.abs(b + s * (2.0 * c + s * (3.0 * d))), out=fastest)
        return least, largest, fastest

    def without(self, axes: Array) -> 'Motion':
        """Return the motion without some axes."""
        return replace(self, axes=np.where(np.isin(self.axes, axes), NONE, self.axes))


def motion_through(axes: Array, times: Array, angle: Array, rate: Array | None) -> Motion:
    """
    Return the motion through some points, as a joint_trajectory_controller interpolates them.

    Parameters
    ----------
    axes : ndarray of int, shape (k,)
        Joint axes, counted along the robot, yaw before pitch.
    times : ndarray, shape (points,)
        Increasing [s].
    angle : ndarray, shape (points, k)
        [rad]
    rate : ndarray, shape (points, k), or None
        [rad/s]. With rates the motion between two points is cubic in time, without rates linear.

    """
    if len(times) == 1:
        times, angle = (
            times[0] + np.array([0.0, SINGLE_POINT_DURATION]),
            np.repeat(angle, 2, axis=0),
        )
        rate = None
    span = np.diff(times)[:, None]
    slope = np.diff(angle, axis=0) / span
    first, last = (slope, slope) if rate is None else (rate[:-1], rate[1:])
    square, cube = (3 * slope - 2 * first - last) / span, (first + last - 2 * slope) / span**2
    return Motion(axes, times, np.stack([angle[:-1], first, square, cube], axis=1))


@dataclass(frozen=True)
class JointReference:
    """
    The last command of every joint axis, each at its own time, and the trajectories.

    Attributes
    ----------
    stamp : ndarray, shape (n-1, 2)
        Time at which the angle holds [s].
    angle, rate : ndarray, shape (n-1, 2)
        (yaw, pitch) [rad], [rad/s].
    motions : tuple of Motion
        In the order in which they begin. From its begin on, a motion replaces angle and rate of
        its axes, and motions that began earlier.

    """

    stamp: Array
    angle: Array
    rate: Array
    motions: tuple[Motion, ...] = ()

    def sample(self, times: Array, horizon: float, limits: JointLimits) -> tuple[Array, Array]:
        """
        Return the reference at given times; a command is extrapolated with its rate for a while.

        Parameters
        ----------
        times : ndarray, shape (m,)
            Increasing [s].
        horizon : float
            Time for which a command is extrapolated [s]; then its angle is held and the rate is
            zero.
        limits : JointLimits
            Of the robot; a reference beyond the angles is held there.

        Returns
        -------
        angle, rate : ndarray, shape (m, n-1, 2)
            [rad], [rad/s]

        """
        times, shape = np.ascontiguousarray(times), (len(times), *self.stamp.shape)
        sampled = np.empty((2, len(times), self.stamp.size))
        command = self.stamp.ravel(), self.angle.ravel(), self.rate.ravel()
        sample_command(times, command, float(horizon), *sampled)
        for motion in self.motions:
            if motion.begin > times[-1]:
                break
            sample_motion(times, motion.axes, motion.times, motion.coefficients, *sampled)
        hold_at_limit(limits.low.ravel(), limits.high.ravel(), *sampled)
        return sampled[0].reshape(shape), sampled[1].reshape(shape)

    def commanded(self, axes: Array, stamp: float, angle: Array, rate: Array) -> 'JointReference':
        """
        Return the reference after a command for some axes, which ends their motions.

        Parameters
        ----------
        axes : ndarray of int, shape (k,)
            Counted along the robot, yaw before pitch.
        stamp : float
            Time at which the angle holds [s].
        angle, rate : ndarray, shape (k,)
            [rad], [rad/s]

        """
        numbers = self.stamp.copy(), self.angle.copy(), self.rate.copy()
        for array, values in zip(numbers, (stamp, angle, rate), strict=True):
            array.flat[axes] = values
        return JointReference(*numbers, _without(self.motions, axes))

    def moved(self, motion: Motion) -> 'JointReference':
        """Return the reference with a motion, which cancels later motions of its axes."""
        earlier = tuple(item for item in self.motions if item.begin < motion.begin)
        later = tuple(item for item in self.motions if item.begin >= motion.begin)
        return replace(self, motions=(*earlier, motion, *_without(later, motion.axes)))

    def settled(self, now: float) -> 'JointReference':
        """Return the same reference from now on, without motions that ended or are covered."""
        begun = [item for item in self.motions if item.begin <= now]
        if not begun or (len(begun) == 1 and begun[0].end > now):
            return self
        kept: tuple[Motion, ...] = ()
        for motion in reversed(begun):
            covered = [item.axes for item in kept]
            kept = (*_without((motion,), np.concatenate([[], *covered])), *kept)
        waiting, reference = self.motions[len(begun) :], self
        while kept and kept[0].end <= now:
            over, *rest = kept
            kept = tuple(rest)
            sampled = np.empty((2, 1, self.stamp.size))
            sample_motion(np.array([over.end]), over.axes, over.times, over.coefficients, *sampled)
            axes = over.axes[over.axes != NONE]
            last = sampled[:, 0, axes]
            reference = replace(reference, motions=()).commanded(axes, over.end, *last)
        return replace(reference, motions=(*kept, *waiting))


def _without(motions: tuple[Motion, ...], axes: Array) -> tuple[Motion, ...]:
    """Return some motions without some axes; motions with no axes left are dropped."""
    left = (item.without(axes) for item in motions)
    return tuple(item for item in left if (item.axes != NONE).any())


def start_posture(scene: Scene, now: float = 0.0) -> JointReference:
    """Return the reference that holds the initial posture of a scene."""
    angle = joint_angles(initial_coordinates(scene), scene.robot)
    return JointReference(np.full(angle.shape, now), angle, np.zeros(angle.shape))


def compile_sampling(scene: Scene) -> None:
    """Compile the functions that sample references, or load them from the cache."""
    still = motion_through(np.array([0]), np.zeros(1), np.zeros((1, 1)), None)
    start_posture(scene).moved(still).sample(np.zeros(1), 0.0, scene.robot.limits)


# ---- limit of rates -----------------------------------------------------------------------------


ROUNDING = 1e-9  # rad by which a reference may be further than it may go


class LimitedReference:
    """
    Holds back references that would move faster than a rate limit.

    Within a publish period a reference may move as far as the limit allows in that time, in a
    single jump if commanded so: commands without rates arrive in steps. Such a reference is left
    unchanged, to the bit. One that moves further approaches its command at the rate limit.

    Parameters
    ----------
    angle : ndarray, shape (n-1, 2)
        Angles (yaw, pitch) at the start [rad].
    now : float
        Simulated time [s].

    Attributes
    ----------
    count : int
        How many times a joint reference began to be held back.

    """

    def __init__(self, angle: Array, now: float = 0.0) -> None:
        self.count = 0
        self.start(angle, now)

    def start(self, angle: Array, now: float) -> None:
        """Start anew from some angles (n-1, 2) at a time."""
        self._angle, self._time = np.array(angle), now
        self._late = np.zeros(angle.shape, dtype=bool)

    def resume(self, axes: Array, angle: Array) -> None:
        """Go on from other angles of some axes, counted along the robot, shape (k,) [rad]."""
        self._angle = self._angle.copy()
        self._angle.flat[axes] = angle
        self._late.flat[axes] = False

    def limited(
        self, times: Array, angle: Array, rate: Array, *, period: float, limit: float | Array
    ) -> tuple[Array, Array]:
        """
        Return references within the rate limit.

        Parameters
        ----------
        times : ndarray, shape (m,)
            Increasing, after the last ones [s].
        angle, rate : ndarray, shape (m, n-1, 2)
            Commanded [rad], [rad/s].
        period : float
            Publish period [s].
        limit : float or ndarray, shape (n-1, 2)
            Largest rate of all axes or of each [rad/s].

        Returns
        -------
        angle, rate : ndarray, shape (m, n-1, 2)
            The same arrays if nothing is held back.

        """
        far = np.abs(angle - self._angle).max(axis=0)
        too_far = far > limit * period + ROUNDING
        self.count += int((too_far & ~self._late).sum())
        led = too_far | self._late
        if led.any():
            way = angle - self._angle
            # In whole nanoseconds, as stamps are: a run has the same bits whenever it begins.
            most = limit * np.round(times - self._time, 9)[:, None, None]
            behind = led & (np.abs(way) > most)
            angle = np.where(behind, self._angle + np.sign(way) * most, angle)
            rate = np.where(behind, np.sign(way) * limit, rate)
            self._late = behind[-1]
        self._angle, self._time = angle[-1], float(times[-1])
        return angle, rate
