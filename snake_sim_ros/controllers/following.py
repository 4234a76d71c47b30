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
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.controllers.controller import Measured, Reference
from snake_sim_ros.controllers.paths import Course, Pieces, Place, place_on_course, PlanarPath
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.records import Block, BoundCall, entry
from snake_sim_ros.gaits.blending import (
    Blend,
    blend_into,
    check_limits,
    make_mixture,
    Mixture,
    sample_waves,
    shortest_blend,
    Waves,
)
from snake_sim_ros.gaits.steering import (
    make_steered,
    steer,
    Steerable,
    steerable,
    Steered,
    Steering,
    Stride,
)
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.following import Following
from snake_sim_ros.scene.gait import Gait, Table, Wave
from snake_sim_ros.scene.parameters import Array, Scene

# Of one steered gait into the next, if the joints are fast enough [s]. Shorter ones make contacts
# iterate more, longer ones delay the corrections.
SHORTEST_BLEND = 0.7


# ---- compiled -----------------------------------------------------------------------------------


class Guide(NamedTuple):
    """
    Guidance and heading control along a path, see the module, and their memory.

    Attributes
    ----------
    course : Course
    lookahead, integral_gain, heading_gain, heading_filter, period : float
        Those of a `Following`.
    speed : float
        Along the path [m/s].
    bearing : float
        Of the gait [rad].
    place : ndarray, shape (4,)
        The last `Place`; NaN before the first one.
    integral : ndarray, shape (1,)
        s [m].
    filtered : ndarray, shape (2,)
        Course [rad] and its rate [rad/s] behind the reference filter; NaN before the first one.

    """

    course: Course
    lookahead: float
    integral_gain: float
    heading_gain: float
    heading_filter: float
    period: float
    speed: float
    bearing: float
    place: Array
    integral: Array
    filtered: Array


@compiled
def remainder(angle: float) -> float:
    """Return an angle within +-pi [rad]."""
    return angle - 2 * math.pi * math.floor(angle / (2 * math.pi) + 0.5)


@compiled
def filter_course(filtered: Array, frequency: float, course: float, period: float) -> None:
    """Advance a critically damped filter of second order toward a course that is held, exactly."""
    w, off = frequency, -remainder(course - filtered[0])
    slope, decay = filtered[1] + w * off, math.exp(-w * period)
    left = (off + slope * period) * decay
    filtered[0] += left - off
    filtered[1] = slope * decay - w * left


@compiled
def find_place(guide: Guide, center: Array) -> None:
    """Find the next place; a path whose ends meet is followed from its begin."""
    place = guide.place
    if not math.isnan(place[0]):
        place_on_course(guide.course, center, place[0], place)
        return
    place_on_course(guide.course, center, 0.0, place)
    if abs(place[1]) > guide.lookahead:
        place_on_course(guide.course, center, math.nan, place)


@compiled
def turning_along(guide: Guide, position: Array, center: Array) -> float:
    """Return the turning rate [rad/s] for link centers (n, 3) [m]; `center` (2,) is filled."""
    n = len(position)
    center[:] = 0.0
    for i in range(n):
        center[0] += position[i, 0] / n
        center[1] += position[i, 1] / n
    x, y = position[0, 0] - position[n - 1, 0], position[0, 1] - position[n - 1, 1]
    travel = math.atan2(y, x) + guide.bearing
    find_place(guide, center)
    error, direction, curvature = guide.place[1], guide.place[2], guide.place[3]

    reach = guide.lookahead
    off = error + guide.integral_gain * guide.integral[0]
    guide.integral[0] += guide.period * reach * error / (off * off + reach * reach)
    course, turning = direction - math.atan(off / reach), guide.speed * curvature
    if guide.heading_filter > 0.0:
        if math.isnan(guide.filtered[0]):
            guide.filtered[0], guide.filtered[1] = travel, 0.0
        filter_course(guide.filtered, guide.heading_filter, course, guide.period)
        course, turning = guide.filtered[0], guide.filtered[1]
    return float(turning) - guide.speed * guide.heading_gain * remainder(travel - course)


class Follower(NamedTuple):
    """
    A robot that follows a path with a gait.

    Attributes
    ----------
    guide : Guide
    gait : Steerable
    steered : Steered
        What the gait is steered to.
    before : Waves
        What it was steered to at the correction before.
    mixture : Mixture
        Of the gaits since then.
    turning : ndarray, shape (1,)
        The last turning rate [rad/s].
    center : ndarray, shape (2,)
        Of the robot [m].
    position : ndarray, shape (n, 3)
        Centers of its links [m].
    time : ndarray, shape (1,)
        Of the present correction [s].

    """

    guide: Guide
    gait: Steerable
    steered: Steered
    before: Waves
    mixture: Mixture
    turning: Array
    center: Array
    position: Array
    time: Array


@compiled
def take_over(waves: Waves, steered: Waves) -> bool:
    """Copy what steering changes, and return whether it is another gait than before."""
    changes = False
    for axis in range(2):
        for number, new in (
            (waves.amplitude, steered.amplitude),
            (waves.angular_frequency, steered.angular_frequency),
            (waves.offset, steered.offset),
            (waves.gradient, steered.gradient),
        ):
            changes = changes or number[axis] != new[axis]
            number[axis] = new[axis]
    return changes


@entry
def guide_robot(guide: Guide, position: Array, center: Array) -> float:
    """Return the turning rate [rad/s], see `turning_along`."""
    return turning_along(guide, position, center)


@entry
def correct(follower: Follower) -> None:
    """Steer the gait along the path from now on."""
    turning = turning_along(follower.guide, follower.position, follower.center)
    follower.turning[0] = turning
    steer(follower.gait, follower.guide.speed, turning, follower.steered)
    if take_over(follower.before, follower.steered.waves):
        blend_into(follower.mixture, follower.time[0], follower.steered.waves)


# ---- controllers --------------------------------------------------------------------------------


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
    path, stride
    guide : Guide

    """

    def __init__(
        self, following: Following, path: PlanarPath, stride: Stride, speed: float
    ) -> None:
        self.path, self.stride, self._center = path, stride, np.zeros(2)
        self.guide = Guide(
            course=path.course,
            **gains_of(following),
            speed=float(speed),
            bearing=float(stride.bearing),
            place=np.full(4, math.nan),
            integral=np.zeros(1),
            filtered=np.full(2, math.nan),
        )

    @property
    def place(self) -> Place | None:
        """The place on the path at the last call."""
        return None if np.isnan(self.guide.place[0]) else Place(*self.guide.place.tolist())

    def change(self, following: Following, speed: float) -> None:
        """Go on with other gains and another speed."""
        self.guide = self.guide._replace(**gains_of(following), speed=float(speed))

    def steer(self, position: Array) -> Steering:
        """Return speed and turning rate for link centers (n, 3) [m, frame I]."""
        turning = guide_robot(self.guide, np.ascontiguousarray(position), self._center)
        return Steering(self.guide.speed, turning)


def gains_of(following: Following) -> dict[str, Any]:
    """Return the fields of a `Guide` that are gains."""
    names = 'lookahead', 'integral_gain', 'heading_gain', 'heading_filter', 'period'
    return {name: float(getattr(following, name)) for name in names}


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

    """

    sees_poses = True

    def __init__(
        self, following: Following, path: PlanarPath | None = None, stride: Stride | None = None
    ) -> None:
        self.following, self.path = following, path or PlanarPath.of(following)
        self.period, self._given = following.period, stride

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how a copy is made, also in another process; it has to be started."""
        return type(self), (self.following, self.path, self._given)

    def start(self, scene: Scene) -> None:
        """Begin anew; the robot must be able to follow the gait, and the gait to turn."""
        gait, robot = scene.gait, scene.robot
        stride = self._given or Stride.of(gait, scene.friction)
        speed = speed_along(self.following, gait, stride)
        check_limits(gait, robot)
        self.guidance = LineOfSight(self.following, self.path, stride, speed)
        duration = max(SHORTEST_BLEND, shortest_blend(robot))
        able = steerable(gait, robot, stride, speed)
        self._follower = Follower(
            guide=self.guidance.guide,
            gait=able,
            steered=make_steered(able),
            before=able.waves.copied(),
            mixture=make_mixture(
                gait, robot.link_count - 1, duration, None, 3 + math.ceil(duration / self.period)
            ),
            turning=np.zeros(1),
            center=np.zeros(2),
            position=np.zeros((robot.link_count, 3)),
            time=np.zeros(1),
        )
        self._correct = BoundCall(correct, Block(self._follower))
        self._sampled = self._make_samples(0)

    @property
    def steering(self) -> Steering:
        """What the gait was asked for last."""
        return Steering(self.guidance.guide.speed, float(self._follower.turning[0]))

    def control(self, measured: Measured, time: float) -> Reference:
        """Return the reference of the gait that is steered toward the path."""
        if measured.position is None:
            raise ParameterError('a path follower needs the positions of the links')
        self._follower.position[:], self._follower.time[0] = measured.position, time
        self._correct()
        return self._reference

    def _reference(self, times: Array) -> tuple[Array, Array]:
        if len(times) != len(self._sampled[0]):
            self._sampled = self._make_samples(len(times))
        into, angle, rate, call = self._sampled
        into[:], angle[:], rate[:] = times, 0.0, 0.0
        call()
        return angle.copy(), rate.copy()

    def _make_samples(self, count: int) -> tuple[Array, Array, Array, BoundCall]:
        """Return times, angles and rates, and the call that fills them."""
        mixture, times = self._follower.mixture, np.zeros(count)
        angle, rate = np.zeros((2, count, *mixture.posture.shape))
        given = map(Block, (mixture, times, angle, rate))
        return times, angle, rate, BoundCall(sample_waves, *given)


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


def compile_following() -> None:
    """Compile what gaits that change and path followers need, or load it from the cache."""
    scene = Scene(gait=Gait(yaw=Wave(amplitude=0.1, angular_frequency=1.0)))
    path = PlanarPath.line((0.0, 0.0), (1.0, 0.0))
    joints = np.zeros(len(scene.robot.axis_names))
    places = np.zeros((scene.robot.link_count, 3))
    follower = PathFollower(Following(), path)
    follower.start(scene)
    follower.control(Measured(joints, joints, joints, places), 0.0)(np.zeros(1))
    follower.guidance.steer(places)
    several = Pieces(*(array[None] for array in path.pieces))
    several.nearest(np.zeros((1, 2)), np.zeros(1))
    path.nearest((0.0, 0.0))
    stopped, _ = Steering(0.0, 0.0).gait(scene.gait, scene.robot, Stride(1.0))
    table = Table.of([0.0, 1.0], np.zeros((2, 1, 2)))
    Blend.of(Gait(table=table), 1, 1.0).changed(0.0, stopped).reference(0.0)
