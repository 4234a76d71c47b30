# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Gaits of the literature by name, in its parameters: `gait: {name: rolling, amplitude_deg: 30}`.

Each is a case of the compound serpenoid curve, eqs. (70), (71), or a table of angles. Joint j = 1
is the one behind the head, N the number of joints. ``waves`` is the number of wavelengths along
the body (the spatial frequency), delta = -2 pi waves/N from joint to joint. A wave with a positive
number travels from the head to the tail, at the angular (temporal) frequency omega, which may be
negative to reverse the gait. Where joints of one axis alternate, each takes the angle of its axis.

Sources: [H] Hirose, Biologically Inspired Robots, 1993. [T] Tesch, Lipkin, Brown, Hatton, Peck,
Rembisz, Choset, Parameterized and scripted gaits for modular snake robots, Advanced Robotics 23,
2009. [K] Kelasidi, Pettersen, Gravdahl, Liljeback, Modeling of underwater snake robots, ICRA 2014.
[A] Astley et al., Modulation of orthogonal body waves enables high maneuverability in sidewinding
locomotion, PNAS 112, 2015. [G] Gray, The mechanism of locomotion in snakes, J. Exp. Biol., 1946.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, ClassVar

import numpy as np

from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    from_mapping,
    nearest,
    ParameterError,
    quantity,
)
from snake_sim_ros.scene.gait import Gait, Table, Wave

ROWS = 40  # of a table for each pass of a fold; the spline between them is within 1e-4 rad
QUARTER = math.pi / 2
MADE_OF = '_made_of'  # attribute of a `Gait`, no field: a changed copy does not have it


@dataclass(frozen=True, kw_only=True)
class NamedGait(CheckedRecord):
    """A gait in the parameters of the literature; its waves are those of `gait`."""

    name: ClassVar[str]

    soft_start: float = quantity(
        2.0, 's', 'time over which the gait fades in from a straight robot', minimum=0
    )

    def gait(self, joint_count: int) -> Gait:
        """Return the gait of a robot with some joints, cardan or of one axis, N."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class PeriodicGait(NamedGait):
    """A gait that is made of waves of one frequency."""

    angular_frequency: float = quantity(math.radians(80), 'rad/s', 'angular frequency omega')


@dataclass(frozen=True, kw_only=True)
class LateralUndulation(PeriodicGait):
    """
    Serpenoid curve of the yaw joints [H]: ``alpha_j = A sin(omega t + (j-1) delta) + psi``.

    It advances where friction across the links exceeds that along them, or between pegs.
    """

    name: ClassVar[str] = 'lateral_undulation'

    amplitude: float = quantity(math.radians(30), 'rad', 'amplitude A')
    waves: float = quantity(1.4, '1', 'wavelengths along the body')
    offset: float = quantity(0.0, 'rad', 'offset psi, which turns the robot right')

    def gait(self, joint_count: int) -> Gait:
        """Return its yaw wave."""
        return Gait(yaw=_wave(self, joint_count, offset=self.offset), soft_start=self.soft_start)


@dataclass(frozen=True, kw_only=True)
class EelLike(LateralUndulation):
    """
    Lateral undulation whose amplitude grows toward the tail [K]: ``A j/(N+2)`` in place of A.

    [K] counts links from the tail: ``(n-i)/(n+1)`` with n = N+1 links.
    """

    name: ClassVar[str] = 'eel_like'

    amplitude: float = quantity(math.radians(50), 'rad', 'amplitude A')

    def gait(self, joint_count: int) -> Gait:
        """Return its yaw wave, with the amplitude as a mean and a gradient along the body."""
        links = joint_count + 1
        mean, gradient = self.amplitude * links / (2 * (links + 1)), (links - 2) / links
        yaw = _wave(self, joint_count, amplitude=mean, gradient=gradient, offset=self.offset)
        return Gait(yaw=yaw, soft_start=self.soft_start)


@dataclass(frozen=True, kw_only=True)
class Sidewinding(PeriodicGait):
    """
    Two waves in quadrature, which lift the links that move to the side [T].

    A gradient makes it conical: the robot turns as a cone rolls (Gong, Hatton, Choset, ICRA 2012).
    """

    name: ClassVar[str] = 'sidewinding'

    amplitude: float = quantity(math.radians(30), 'rad', 'amplitude of the yaw joints')
    lift: float = quantity(math.radians(10), 'rad', 'amplitude of the pitch joints')
    waves: float = quantity(1.4, '1', 'wavelengths along the body')
    gradient: float = quantity(
        0.0, '1', 'gradient of both amplitudes along the body', minimum=-1, maximum=1
    )
    side: str = quantity('left', '', 'where it moves, seen from above', choices=('left', 'right'))

    def gait(self, joint_count: int) -> Gait:
        """Return its waves."""
        phase = QUARTER if self.side == 'left' else -QUARTER
        shape = {'gradient': self.gradient}
        return Gait(
            yaw=_wave(self, joint_count, **shape),
            pitch=_wave(self, joint_count, amplitude=self.lift, phase=phase, **shape),
            soft_start=self.soft_start,
        )


@dataclass(frozen=True, kw_only=True)
class TurnInPlace(PeriodicGait):
    """
    Sidewinding to one side in front, to the other side behind: reversal turning [A].

    The pitch wave is a quarter of a cycle ahead of the yaw wave at one end of the body and behind
    at the other end, so that the ends push opposite ways. The other side is the mirror image.
    """

    name: ClassVar[str] = 'turn_in_place'

    amplitude: float = quantity(math.radians(30), 'rad', 'amplitude of the yaw joints')
    lift: float = quantity(math.radians(10), 'rad', 'amplitude of the pitch joints')
    waves: float = quantity(1.0, '1', 'wavelengths along the body')
    side: str = quantity('left', '', 'where it turns, seen from above', choices=('left', 'right'))

    def gait(self, joint_count: int) -> Gait:
        """Return its waves."""
        phase = QUARTER if self.side == 'left' else -QUARTER
        yaw = _wave(self, joint_count)
        lag = yaw.phase_lag + math.pi / max(1, joint_count - 1)
        pitch = _wave(self, joint_count, amplitude=self.lift, phase=phase, phase_lag=lag)
        return Gait(yaw=yaw, pitch=pitch, soft_start=self.soft_start)


@dataclass(frozen=True, kw_only=True)
class Rolling(PeriodicGait):
    """
    An arc that rolls about its own axis, sideways over the floor [T].

    ``alpha_yaw = A sin(omega t)``, ``alpha_pitch = A cos(omega t)`` for all joints: the body bends
    to the curvature A/L, in a plane that turns.
    """

    name: ClassVar[str] = 'rolling'

    amplitude: float = quantity(math.radians(12), 'rad', 'angle A from link to link')

    def gait(self, joint_count: int) -> Gait:
        """Return its waves."""
        wave = Wave(amplitude=self.amplitude, angular_frequency=self.angular_frequency)
        return _quadrature(self, wave)


@dataclass(frozen=True, kw_only=True)
class RollingHelix(PeriodicGait):
    """
    A helix that rolls about its own axis, as around a pole or inside a pipe [T].

    ``alpha_yaw = A sin(omega t + (j-1) delta)``, ``alpha_pitch = A cos(omega t + (j-1) delta)``:
    curvature A/L, torsion delta/L.
    """

    name: ClassVar[str] = 'rolling_helix'

    amplitude: float = quantity(math.radians(25), 'rad', 'angle A from link to link')
    waves: float = quantity(1.0, '1', 'turns of the bending plane along the body')

    def gait(self, joint_count: int) -> Gait:
        """Return its waves."""
        return _quadrature(self, _wave(self, joint_count))


@dataclass(frozen=True, kw_only=True)
class LinearProgression(PeriodicGait):
    """
    A wave of the pitch joints alone [T]: ``alpha_j = A sin(omega t - (j-1) delta)``.

    It travels from the tail to the head, as in a caterpillar, and its crests carry links ahead. A
    straight robot with round links that stands on crests tips over sooner or later. A bend gives
    it a base, and makes it go around.
    """

    name: ClassVar[str] = 'linear_progression'

    amplitude: float = quantity(math.radians(25), 'rad', 'amplitude A')
    waves: float = quantity(1.5, '1', 'wavelengths along the body')
    bend: float = quantity(0.0, 'rad', 'offset of the yaw joints, which keeps it upright')

    def gait(self, joint_count: int) -> Gait:
        """Return its pitch wave, and the bend."""
        pitch = _wave(self, joint_count, phase_lag=-_lag(self.waves, joint_count))
        return Gait(yaw=Wave(offset=self.bend), pitch=pitch, soft_start=self.soft_start)


@dataclass(frozen=True, kw_only=True)
class Concertina(NamedGait):
    """
    A fold that passes along the body from the tail to the head, to either side in turn [G].

    What lies straight holds by friction while the few links in the fold are drawn ahead. The fold
    is the curve ``y ~ cos^4(pi u/w)`` of width w, with angles in proportion to its curvature:
    ``alpha_j = A (cos^4 x - 3 cos^2 x sin^2 x)``, ``x = pi (j - c)/w``, c its center. The
    robot advances a pass by what the fold shortens it, if less than half of its weight moves.
    """

    name: ClassVar[str] = 'concertina'

    amplitude: float = quantity(math.radians(40), 'rad', 'largest angle A of a joint')
    width: float = quantity(8.0, '1', 'width w of the fold in joints', minimum=3)
    period: float = quantity(3.0, 's', 'time in which the fold passes', above=0)

    def gait(self, joint_count: int) -> Gait:
        """Return its table: a pass to each side, again and again."""
        place, joints = np.arange(ROWS + 1) / ROWS, np.arange(joint_count)
        center = joint_count - 1 + self.width / 2 - place * (joint_count - 1 + self.width)
        x = math.pi * np.clip((joints - center[:, None]) / self.width, -0.5, 0.5)
        cosine, sine = np.cos(x) ** 2, np.sin(x) ** 2
        fold = self.amplitude * cosine * (cosine - 3.0 * sine)
        angle = np.zeros((2 * ROWS + 1, joint_count, 2))
        angle[: ROWS + 1, :, 0], angle[ROWS:, :, 0] = fold, -fold
        time = self.period * np.arange(2 * ROWS + 1) / ROWS
        return Gait(table=Table.of(time, angle, repeat=True), soft_start=self.soft_start)


GAITS: dict[str, type[NamedGait]] = {
    each.name: each
    for each in (
        LateralUndulation, EelLike, Sidewinding, TurnInPlace, Rolling, RollingHelix,
        LinearProgression, Concertina,
    )
}  # fmt: skip


def named_gait(values: Mapping[str, Any], joint_count: int) -> Gait:
    """
    Return the gait of a name and its parameters.

    Parameters
    ----------
    values : mapping
        `name` and parameters of that gait; a key may end in ``_deg``.
    joint_count : int
        Number of joints, N.

    Raises
    ------
    ParameterError
        If there is no such gait, or a parameter is not usable.

    """
    given = dict(values)
    name = given.pop('name')
    if name not in GAITS:
        raise ParameterError(f'gait.name: unknown gait {name!r}; {nearest(name, GAITS)}')
    found: NamedGait = from_mapping(GAITS[name], given, f'gait {name}')
    return made_gait(found, joint_count)


def made_gait(named: NamedGait, joint_count: int) -> Gait:
    """Return the gait of a robot with some joints, which remembers what it is made of."""
    found = named.gait(joint_count)
    object.__setattr__(found, MADE_OF, named)
    return found


def made_of(gait: Gait) -> NamedGait | None:
    """Return what a gait is made of, None if a wave of it was changed since, or nothing is."""
    return getattr(gait, MADE_OF, None)


def _lag(waves: float, joint_count: int) -> float:
    """Return the phase lag from joint to joint of a number of waves along the body [rad]."""
    return -2 * math.pi * waves / joint_count


def _wave(given: Any, joint_count: int, **values: float) -> Wave:
    """Return the wave of a gait with amplitude, frequency and number of waves."""
    usual = {'amplitude': given.amplitude, 'phase_lag': _lag(given.waves, joint_count)}
    return Wave(angular_frequency=given.angular_frequency, **{**usual, **values})


def _quadrature(given: NamedGait, yaw: Wave) -> Gait:
    """Return the gait whose pitch is a quarter of a cycle ahead of its yaw, else the same."""
    return Gait(yaw=yaw, pitch=replace(yaw, phase=QUARTER), soft_start=given.soft_start)
