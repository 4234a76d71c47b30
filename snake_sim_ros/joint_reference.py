"""What the joints are told over time: commands, held or extrapolated, and trajectories."""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.interpolate import PPoly

from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Scene
from snake_sim_ros.posture import joint_angles
from snake_sim_ros.stepping import initial_state

INSTANT = 1e-3  # s, the length of a motion that has one point only


@dataclass(frozen=True)
class Motion:
    """
    A trajectory of some joint axes; after its end they hold.

    Attributes
    ----------
    axes : ndarray of int, shape (k,)
        Which axes, counted along the robot, yaw before pitch.
    angle, rate : PPoly
        Of time [s], with values of shape (k,) [rad], [rad/s].

    """

    axes: Array
    angle: PPoly
    rate: PPoly

    @property
    def begin(self) -> float:
        """Time of the first point [s]."""
        return float(self.angle.x[0])

    @property
    def end(self) -> float:
        """Time of the last point [s]."""
        return float(self.angle.x[-1])

    def without(self, axes: Array) -> 'Motion':
        """Return the motion of all axes but some."""
        keep = ~np.isin(self.axes, axes)
        angle, rate = (PPoly(part.c[..., keep], part.x) for part in (self.angle, self.rate))
        return Motion(self.axes[keep], angle, rate)


def motion_through(axes: Array, times: Array, angle: Array, rate: Array | None) -> Motion:
    """
    Return the motion through some points, as a joint_trajectory_controller interpolates them.

    Parameters
    ----------
    axes : ndarray of int, shape (k,)
    times : ndarray, shape (points,)
        Increasing [s].
    angle : ndarray, shape (points, k)
        [rad]
    rate : ndarray, shape (points, k), or None
        [rad/s]. With rates the motion is cubic in time between two points, without it is linear.

    """
    if len(times) == 1:
        times, angle = times[0] + np.array([0.0, INSTANT]), np.repeat(angle, 2, axis=0)
        rate = None
    if rate is None:
        slope = np.diff(angle, axis=0) / np.diff(times)[:, None]
        curve = PPoly(np.array([slope, angle[:-1]]), times)
    else:
        curve = CubicHermiteSpline(times, angle, rate)
    return Motion(axes, curve, curve.derivative())


@dataclass(frozen=True)
class JointReference:
    """
    What the joints were last told, each axis at its own time.

    Attributes
    ----------
    stamp : ndarray, shape (n-1, 2)
        Time at which the angle holds [s].
    angle, rate : ndarray, shape (n-1, 2)
        (yaw, pitch) [rad], [rad/s].
    motions : tuple of Motion
        In the order in which they begin. Once one has begun it goes before angle and rate, and
        before the motions that began earlier.

    """

    stamp: Array
    angle: Array
    rate: Array
    motions: tuple[Motion, ...] = ()

    def sample(self, times: Array, horizon: float, limit: float) -> tuple[Array, Array]:
        """
        Return the reference at given times; a command is extrapolated with its rate for a while.

        Parameters
        ----------
        times : ndarray, shape (m,)
            Increasing [s].
        horizon : float
            How long a command is extrapolated [s]; then its angle is held and the rate is zero.
        limit : float
            Largest angle [rad]; a reference beyond it stands still there.

        Returns
        -------
        angle, rate : ndarray, shape (m, n-1, 2)

        """
        age = times[:, None, None] - self.stamp
        angle = self.angle + np.minimum(age, horizon) * self.rate
        rate = np.where(age <= horizon, self.rate, 0.0)
        for motion in self.motions:
            begun = slice(int(times.searchsorted(motion.begin)), None)
            at, end = times[begun], motion.end
            moving = at[:, None] < end
            at = np.minimum(at, end)
            angle.reshape(len(times), -1)[begun, motion.axes] = motion.angle(at)
            rate.reshape(len(times), -1)[begun, motion.axes] = moving * motion.rate(at)
        inside = np.abs(angle) <= limit
        if inside.all():
            return angle, rate
        return np.clip(angle, -limit, limit), np.where(inside, rate, 0.0)

    def commanded(self, axes: Array, stamp: float, angle: Array, rate: Array) -> 'JointReference':
        """
        Return the reference after a command for some axes; their motions end.

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
        """Return the reference with a motion; what its axes would do from its begin on is void."""
        earlier = tuple(item for item in self.motions if item.begin < motion.begin)
        later = tuple(item for item in self.motions if item.begin >= motion.begin)
        return replace(self, motions=(*earlier, motion, *_without(later, motion.axes)))

    def settled(self, now: float) -> 'JointReference':
        """Return the same from now on, without motions that are over or covered by others."""
        if not any(item.end <= now or len(self.motions) > 1 for item in self.motions):
            return self
        kept: tuple[Motion, ...] = ()
        for motion in reversed(self.motions):
            covered = [item.axes for item in kept if item.begin <= now]
            kept = (*_without((motion,), np.concatenate([[], *covered])), *kept)
        reference = self
        while kept and kept[0].end <= now:
            over, *rest = kept
            kept = tuple(rest)
            reference = replace(reference, motions=()).commanded(
                over.axes, over.end, over.angle(over.end), np.zeros(len(over.axes))
            )
        return replace(reference, motions=kept)


def _without(motions: tuple[Motion, ...], axes: Array) -> tuple[Motion, ...]:
    """Return what is left of some motions without some axes."""
    left = (item.without(axes) for item in motions)
    return tuple(item for item in left if len(item.axes))


def start_posture(scene: Scene, now: float = 0.0) -> JointReference:
    """Return the reference that holds the initial posture of a scene."""
    angle = joint_angles(initial_state(scene).q)
    return JointReference(np.full(angle.shape, now), angle, np.zeros(angle.shape))
