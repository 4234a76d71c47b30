# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Pushes: forces and torques from outside at the centers of links, which act for some time.

They are in the balance of every step, beside gravity, so that friction holds what it can hold. A
step of the paper takes their mean over its length. Method `bdf2` divides steps where a push begins
or ends, and starts anew there; see `bdf2.formula`.

Times are counted in ticks, STEP a step. A push begins at the tick before and ends at the
tick after those that are meant, with a force that is so much smaller that its impulse is exact.
"""

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene

STEP = 2**14  # ticks in a step: shorter parts of it would be lost in the tolerances of contacts
NOTHING = (0.0, 0.0, 0.0)
ROUNDING = 1e-3  # ticks by which times are off that are meant to be at one
LATEST = 2.0**40  # steps; what is later never happens


class Stretch(NamedTuple):
    """A step, or the part of it from where a push begins or ends to where the next one does."""

    begin: int  # ticks since time 0
    end: int  # ticks since time 0
    step_end: int  # end of the step, in ticks since time 0


class PushTable(NamedTuple):
    """
    The pushes on a robot, for the steps of a call.

    Compiled functions of this package take this record as `pushes`. They number steps from that
    in `clock`.
    """

    link: Array  # (m,) index of the link, from 0
    force: Array  # (m, 3) at its center [N]
    torque: Array  # (m, 3) [N m]
    turns: Array  # (m,) 1: axes are those of frame B of the link, with which they turn; 0: of I
    lifts: Array  # (m,) 1 if it does not leave a robot that lies flat in the plane
    begin: Array  # (m,) ticks since time 0
    end: Array  # (m,) ticks since time 0
    clock: Array  # (1,) number of the first step of a call, from time 0

    def after(self, steps: int) -> 'PushTable':
        """Return the pushes for the steps that follow after some steps."""
        return self._replace(clock=self.clock + steps) if len(self.link) and steps else self

    def lift(self, count: int) -> Array:
        """Return in which of the next steps a push does not leave the robot flat, (count,)."""
        found = np.zeros(count, dtype=bool)
        for p in self.lifting(count) if len(self.link) else ():
            first = self.begin[p] // STEP - self.clock[0]
            last = -(-self.end[p] // STEP) - self.clock[0]
            found[max(0, first) : last] = True
        return found

    def lifting(self, count: int) -> Array:
        """Return the pushes that do not leave the robot flat in any of the next steps."""
        first, last = self.clock[0] * STEP, (self.clock[0] + count) * STEP
        return np.flatnonzero((self.lifts == 1) & (self.begin < last) & (self.end > first))


@inlined
def whole_step(pushes: PushTable, k: int) -> Stretch:
    """Return step k of a call as a `Stretch`."""
    end = (pushes.clock[0] + k + 1) * STEP
    return Stretch(end - STEP, end, end)


@inlined
def share(pushes: PushTable, p: int, stretch: Stretch) -> float:
    """Return the share of the time of a `Stretch` in which push p acts."""
    first, last = max(stretch.begin, pushes.begin[p]), min(stretch.end, pushes.end[p])
    return max(0, last - first) / (stretch.end - stretch.begin)


@inlined
def add_pushes(
    pushes: PushTable, stretch: Stretch, h: float, R: Array, center: Array, momentum: Array
) -> None:
    """
    Add the impulses of the pushes to the momentum of every link, a wrench about O.

    Parameters
    ----------
    pushes : PushTable
    stretch : Stretch
        The time over which the mean of the forces is taken.
    h : float
        Time for which forces act [s].
    R, center, momentum : ndarray
        As of `balance.smooth_momentum`.

    """
    for p in range(len(pushes.link)):
        i, time = pushes.link[p], h * share(pushes, p, stretch)
        if time > 0.0:
            fx, fy, fz = in_axes_of(pushes.turns[p], R[i], pushes.force[p])
            mx, my, mz = in_axes_of(pushes.turns[p], R[i], pushes.torque[p])
            x, y, z = center[i, 0], center[i, 1], center[i, 2]
            momentum[i, 0] += time * (mx + y * fz - z * fy)
            momentum[i, 1] += time * (my + z * fx - x * fz)
            momentum[i, 2] += time * (mz + x * fy - y * fx)
            momentum[i, 3] += time * fx
            momentum[i, 4] += time * fy
            momentum[i, 5] += time * fz


@inlined
def in_axes_of(turns: int, R: Array, vector: Array) -> Three:
    """Return a vector (3,) of a push in axes of I, for the frame R (3, 3) of its link."""
    x, y, z = vector[0], vector[1], vector[2]
    if turns == 0:
        return x, y, z
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@inlined
def add_pushes_in_plane(
    pushes: PushTable, stretch: Stretch, h: float, heading: Array, center: Array, momentum: Array
) -> None:
    """
    Add the impulses of the pushes in the plane; see `add_pushes`.

    Parameters
    ----------
    pushes, stretch, h
        As of `add_pushes`.
    heading, center, momentum : ndarray
        Of `planar.model.PlanarWorkspace`.

    """
    for p in range(len(pushes.link)):
        i, time = pushes.link[p], h * share(pushes, p, stretch)
        if time > 0.0:
            fx, fy, moment = pushes.force[p, 0], pushes.force[p, 1], pushes.torque[p, 2]
            if pushes.turns[p] == 1:  # frame B of a link that lies flat: across, up, along it
                across, along, moment = fx, pushes.force[p, 2], pushes.torque[p, 1]
                fx = heading[i, 0] * along - heading[i, 1] * across
                fy = heading[i, 1] * along + heading[i, 0] * across
            momentum[i, 0] += time * (moment + center[i, 0] * fy - center[i, 1] * fx)
            momentum[i, 1] += time * fx
            momentum[i, 2] += time * fy


@inlined
def lifts_in_step(pushes: PushTable, step: int) -> bool:
    """Return whether a push acts in one of the next steps that does not leave the robot flat."""
    stretch = whole_step(pushes, step)
    for p in range(len(pushes.link)):
        if pushes.lifts[p] == 1 and share(pushes, p, stretch) > 0.0:
            return True
    return False


class Push(NamedTuple):
    """A push whose times are ticks; see `PushTable` for its numbers."""

    link: int  # index of the link, from 0
    force: Array  # (3,) at its center [N]
    torque: Array  # (3,) [N m]
    turns: bool  # whether axes are those of frame B of the link, with which they turn, not of I
    begin: int  # ticks since time 0
    end: int  # ticks since time 0

    @property
    def lifts(self) -> bool:
        """Whether it does not leave a robot that lies flat in the plane."""
        up = 1 if self.turns else 2  # frame B of a link that lies flat: across, up, along it
        return bool(self.force[up] or np.delete(self.torque, up).any())


def make_push(
    link: int, force: Sequence[float] | Array, torque: Sequence[float] | Array, turns: bool,
    start: float, duration: float,
) -> Push:  # fmt: skip
    """Return a push from a start on for a duration, both in steps."""
    start, duration = min(start, LATEST), min(duration, LATEST)
    begin = math.floor(STEP * start + ROUNDING)
    end = max(begin + 1, math.ceil(STEP * (start + duration) - ROUNDING))
    part = STEP * duration / (end - begin)
    return Push(link, part * np.array(force), part * np.array(torque), turns, begin, end)


def make_table(pushes: Sequence[Push], step: int = 0) -> PushTable:
    """Return the table of some pushes, for a call whose first step has a number."""
    return PushTable(
        link=np.array([push.link for push in pushes], np.int64),
        force=np.array([push.force for push in pushes], float).reshape(-1, 3),
        torque=np.array([push.torque for push in pushes], float).reshape(-1, 3),
        turns=np.array([push.turns for push in pushes], np.int64),
        lifts=np.array([push.lifts for push in pushes], np.int64),
        begin=np.array([push.begin for push in pushes], np.int64),
        end=np.array([push.end for push in pushes], np.int64),
        clock=np.array([step], np.int64),
    )


NO_PUSHES = make_table(())


class Pushes:
    """
    What pushes the robot of a simulation: the pushes of its scene, and those added at run time.

    Of the latter, one on a link takes the place of that before.

    Parameters
    ----------
    scene : Scene

    """

    def __init__(self, scene: Scene) -> None:
        self._begun: dict[int, Push] = {}
        self._waiting: list[Push] = []  # those that begin with the next step, at tick 0 of it
        self.change(scene)

    def change(self, scene: Scene) -> None:
        """Continue with the pushes of another scene, which has the same robot and time step."""
        self._dt, self._links, middle = scene.dt, scene.robot.link_count, scene.robot.middle_link
        self._scene = [
            make_push(
                middle if push.link is None else push.link - 1, push.force, push.torque, False,
                push.start / scene.dt, push.duration / scene.dt,
            )
            for push in scene.pushes
        ]  # fmt: skip
        self._table: PushTable | None = None

    def begin(
        self,
        link: int,
        force: Sequence[float] | Array,
        torque: Sequence[float] | Array = NOTHING,
        *,
        duration: float,
        turns: bool = False,
    ) -> None:
        """
        Begin to push a link with the next step.

        Parameters
        ----------
        link : int
            Index of the link, from 0.
        force, torque : sequence of float, shape (3,)
            At the center of the link [N], [N m].
        duration : float
            [s]
        turns : bool, optional
            Whether force and torque are in frame B of the link, and turn with it. Default: I.

        Raises
        ------
        ParameterError
            If there is no such link, or a number is not usable.

        """
        if not 0.0 < duration < math.inf:
            raise ParameterError(f'duration must be above 0 s and finite, got {duration:g} s')
        if not 0 <= link < self._links:
            raise ParameterError(f'link must be 0 to {self._links - 1}, got {link}')
        force, torque = _checked('force', 'N', force), _checked('torque', 'N m', torque)
        self._waiting.append(make_push(link, force, torque, turns, 0.0, duration / self._dt))

    def clear(self) -> None:
        """End the pushes that began since; those of the scene continue."""
        self._waiting = [
            make_push(link, NOTHING, NOTHING, False, 0.0, 1.0) for link in self._begun
        ]

    def at(self, step: int) -> PushTable:
        """Return the pushes for a call whose first step has a number, counted from time 0."""
        now = step * STEP
        ended = self._begun and any(push.end < now for push in self._begun.values())
        if self._waiting or ended:
            for push in self._waiting:
                begin, end = push.begin + now, push.end + now
                self._begun[push.link] = push._replace(begin=begin, end=end)
            kept = {link: push for link, push in self._begun.items() if push.end >= now}
            self._begun, self._waiting, self._table = kept, [], None
        if self._table is None:
            self._table = make_table([*self._scene, *self._begun.values()])
        self._table.clock[0] = step
        return self._table

    def __bool__(self) -> bool:
        """Return whether a push added while it ran had not ended before the last call."""
        pushes = {**self._begun, **{push.link: push for push in self._waiting}}.values()
        return any(push.force.any() or push.torque.any() for push in pushes)


def _checked(name: str, unit: str, vector: Sequence[float] | Array) -> Array:
    """Return three finite numbers; raise an error if they are something else."""
    found = np.asarray(vector, dtype=float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ParameterError(f'{name} must be 3 finite numbers in {unit}, got {vector}')
    return found
