# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Path following: line-of-sight guidance, a heading controller, and a gait that is steered.

Guidance aims at a point that is the lookahead distance Delta ahead on the path, e the cross-track
error to the left: ``chi = direction - arctan((e + sigma s)/Delta)``. The integral s removes what
slopes, drifts or a gait that turns by itself leave of e (integral line of sight):
``s' = Delta e/((e + sigma s)^2 + Delta^2)``.

The heading controller turns the robot into that course: ``turning = v (curvature - k error)``. Its
error decays over the distance 1/k, whatever the speed is. The curvature is that of the path, or,
with a reference filter, the rate of a critically damped filter that the course goes through, as in
a cascade of guidance and heading control.

Sources: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2011, section 10.3;
Borhaug, Pavlov, Pettersen, CDC 2008 (integral); Kelasidi, Liljeback, Pettersen, Gravdahl,
Integral line-of-sight guidance for path following control of underwater snake robots, T-RO 2017
(cascade). Theirs are models of snakes without sideways slip; what follows from it for a robot with
Coulomb friction is measured, see docs/controllers.md.
"""

import math

from snake_sim_ros.controllers.controller import Measured, Reference
from snake_sim_ros.controllers.paths import Place, PlanarPath
from snake_sim_ros.gaits.blending import Blend, check_limits, shortest_blend
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.following import Following
from snake_sim_ros.scene.gait import Gait
from snake_sim_ros.scene.parameters import Array, Scene

SHORTEST_BLEND = 0.5  # of one steered gait into the next, if the joints are fast enough [s]


class CourseFilter:
    """A critically damped reference filter of second order, exact for a course that is held."""

    def __init__(self, frequency: float, course: float) -> None:
        self.frequency, self.course, self.rate = frequency, course, 0.0

    def follow(self, course: float, period: float) -> None:
        """Advance by a period [s] toward a course [rad]."""
        w, off = self.frequency, -math.remainder(course - self.course, math.tau)
        slope, decay = self.rate + w * off, math.exp(-w * period)
        left = (off + slope * period) * decay
        self.course += left - off
        self.rate = slope * decay - w * left


class LineOfSight:
    """
    Guidance and heading control: from the places of the links, the speed and turning that follow.

    Parameters
    ----------
    following : Following
        Its gains; its path is not used.
    path : PlanarPath
    stride : Stride
        How the gait moves, for the bearing.
    speed : float
        Along the path [m/s].

    Attributes
    ----------
    place : Place or None
        On the path, at the last call.

    """

    def __init__(
        self, following: Following, path: PlanarPath, stride: Stride, speed: float
    ) -> None:
        self.following, self.path, self.stride, self.speed = following, path, stride, speed
        self.place: Place | None = None
        self._integral = 0.0
        self._filter: CourseFilter | None = None

    def steer(self, position: Array) -> Steering:
        """Return speed and turning rate for link centers (n, 3) [m, frame I]."""
        given, center = self.following, position[:, :2].mean(axis=0)
        self.place = place = self._next_place(center)
        ahead = position[0, :2] - position[-1, :2]
        travel = math.atan2(ahead[1], ahead[0]) + self.stride.bearing

        reach, error = given.lookahead, place.cross_track
        off = error + given.integral_gain * self._integral
        self._integral += given.period * reach * error / (off * off + reach * reach)
        course, turning = place.direction - math.atan(off / reach), self.speed * place.curvature
        if given.heading_filter:
            if not self._filter:
                self._filter = CourseFilter(given.heading_filter, travel)
            self._filter.frequency = given.heading_filter
            self._filter.follow(course, given.period)
            course, turning = self._filter.course, self._filter.rate
        turning -= self.speed * given.heading_gain * math.remainder(travel - course, math.tau)
        return Steering(self.speed, turning)

    def _next_place(self, center: Array) -> Place:
        """Return the next place; a path whose ends meet is followed from its begin."""
        if self.place:
            return self.path.nearest(center, self.place.arc)
        begin = self.path.nearest(center, 0.0)
        is_near = abs(begin.cross_track) <= self.following.lookahead
        return begin if is_near else self.path.nearest(center)


class PathFollower:
    """
    Follows a path with the gait of a scene: lateral undulation, or sidewinding by its bearing.

    Parameters
    ----------
    following : Following
        Its gains, and its path unless another one is given.
    path : PlanarPath, optional
    stride : Stride, optional
        How the gait moves. Default: that of the gait, lateral undulation or sidewinding, as
        measured for Aiko.

    Attributes
    ----------
    guidance : LineOfSight
    steering : Steering
        What the gait was asked for last.

    """

    sees_poses = True

    def __init__(
        self, following: Following, path: PlanarPath | None = None, stride: Stride | None = None
    ) -> None:
        self.following, self.path = following, path or PlanarPath.of(following)
        self.period, self._given = following.period, stride

    def start(self, scene: Scene) -> None:
        """Begin anew; the robot must be able to follow the gait, and the gait to turn."""
        gait, robot = scene.gait, scene.robot
        stride = self._given or Stride.of(gait, scene.friction)
        speed = speed_along(self.following, gait, stride)
        check_limits(gait, robot)
        self.robot, self.gait, self.stride = robot, gait, stride
        self.guidance = LineOfSight(self.following, self.path, stride, speed)
        self.steering = Steering(speed, 0.0)
        duration = max(SHORTEST_BLEND, shortest_blend(robot))
        self.blend = Blend.of(gait, robot.link_count - 1, duration)

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the reference of the gait that is steered toward the path."""
        if measured.position is None:
            raise ParameterError('a path follower needs the positions of the links')
        self.steering = self.guidance.steer(measured.position)
        steered, _ = self.steering.gait(self.gait, self.robot, self.stride)
        if steered != self.blend.gait:
            self.blend = self.blend.changed(time, steered)
        return self.blend.reference


def speed_along(following: Following, gait: Gait, stride: Stride) -> float:
    """
    Return the speed along a path [m/s].

    Raises
    ------
    ParameterError
        If the gait cannot be steered.

    """
    if gait.table:
        raise ParameterError('a path cannot be followed with a gait from a table')
    speed = following.speed or stride.speed(gait)
    if not (speed > 0.0 and gait.yaw.angular_frequency):
        raise ParameterError('a path needs a gait that moves: its angular frequency is 0')
    return speed
