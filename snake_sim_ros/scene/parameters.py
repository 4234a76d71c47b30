# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Every physical number of a scene, as records, and their conversion from and to YAML.

The defaults are the numbers of the paper [1]; a number that the paper leaves open is marked as an
assumption. NOTATION.md maps the symbols of the paper to the names used here. All values are in SI
units and radians; in YAML a key may end in ``_deg`` and is then converted.

.. [1] A. A. Transeth, R. I. Leine, Ch. Glocker, K. Y. Pettersen, "3-D snake robot motion:
   nonsmooth modeling, simulations, and experiments", IEEE T-RO 24(2), 2008.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, lru_cache
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
import yaml

from snake_sim_ros.scene.chain import (
    base_of,
    CENTER,
    Chain,
    chain_of_equal_links,
    chain_of_links,
    Joint,
    JointLimits,
    LARGEST_ANGLE,
    Link,
    PerAxis,
)
from snake_sim_ros.scene.checked_records import (
    check_components,
    CheckedRecord,
    cut,
    flat_fields,
    from_mapping,
    LONGEST_PATH,
    NamedRecord,
    ParameterError,
    quantity,
    to_mapping,
    values_of,
    with_values,
)
from snake_sim_ros.scene.files import find_file, is_file, parse_yaml, read_mapping, read_text
from snake_sim_ros.scene.following import Following
from snake_sim_ros.scene.gait import Gait, Numbers, Table, table_from, table_to_text
from snake_sim_ros.scene.gait_library import made_gait, made_of, named_gait, NamedGait
from snake_sim_ros.scene.world import in_folder, World

Array = NDArray[Any]
PerLink = float | Numbers
PerJoint = float | Numbers

LOG = logging.getLogger('snake_sim_ros')
STICKY = 1e6  # largest friction: with it everything sticks whose load is more than rounding


@dataclass(frozen=True, kw_only=True)
class Friction(CheckedRecord):
    """
    Coefficients of spatial Coulomb friction, of rolling friction and of viscous friction.

    A link slides forward along e_z of its frame, from link 1 to link n. What resists that is
    `longitudinal`; `backward` resists sliding the other way, and is equal if it is not given. The
    admissible forces are then two halves of ellipses, which share the half axis `transversal`.

    Viscous friction is added to it: a force against the sliding velocity and proportional to it,
    whatever the load. A link has half of it at each of its two contacts, while they are closed.

    While a contact slides, the coefficients may fall with its speed v, from those given to their
    `kinetic_ratio` r, by the factor ``r + (1 - r)/(1 + (v/stribeck_speed)^2)``.
    """

    longitudinal: float = quantity(
        0.1, '1', 'Coulomb mu_Tx along the link', minimum=0, maximum=STICKY
    )
    backward: float | None = quantity(
        None,
        '1',
        'Coulomb mu_Tx of a link that slides backward; default: longitudinal',
        minimum=0,
        maximum=STICKY,
    )
    transversal: float = quantity(
        0.5, '1', 'Coulomb mu_Ty across the link', minimum=0, maximum=STICKY
    )
    rolling: float = quantity(
        0.0, '1', 'rolling friction mu_V (assumption: none)', minimum=0, maximum=STICKY
    )
    viscous_longitudinal: float = quantity(
        0.0, 'N s/m', 'viscous friction of a link along it', minimum=0, maximum=STICKY
    )
    viscous_transversal: float = quantity(
        0.0, 'N s/m', 'viscous friction of a link across it', minimum=0, maximum=STICKY
    )

    kinetic_ratio: float = quantity(
        1.0, '1', 'sliding coefficients at high speed over those at rest', minimum=0, maximum=1
    )
    stribeck_speed: float = quantity(
        0.01, 'm/s', 'speed at which sliding coefficients have fallen half way', above=0,
        minimum=1e-6,
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Check every field, and that coefficients that fall are those of sliding alone."""
        super().__post_init__()
        if self.falls and self.rolling > 0.0:
            raise ParameterError(
                f'kinetic_ratio {self.kinetic_ratio:g} needs rolling 0, got {self.rolling:g}: '
                f'rolling friction does not fall with speed'
            )

    @property
    def falls(self) -> bool:
        """Whether sliding coefficients fall with speed."""
        return self.kinetic_ratio < 1.0

    @property
    def against_backward(self) -> float:
        """Coefficient along a link that slides backward."""
        return self.longitudinal if self.backward is None else self.backward

    @property
    def has_direction(self) -> bool:
        """Whether forward and backward sliding differ."""
        return self.against_backward != self.longitudinal

    @property
    def is_one_ellipse(self) -> bool:
        """Whether the ellipse of `longitudinal` and `transversal` is all that resists sliding."""
        return not (self.has_direction or self.is_viscous or self.falls)

    @property
    def is_viscous(self) -> bool:
        """Whether there is viscous friction."""
        return max(self.viscous_longitudinal, self.viscous_transversal) > 0.0

    @property
    def viscous_of_contact(self) -> tuple[float, float]:
        """Viscous friction of one of both contacts of a link, along and across it [N s/m]."""
        return 0.5 * self.viscous_longitudinal, 0.5 * self.viscous_transversal


@dataclass(frozen=True, kw_only=True)
class Pegs(CheckedRecord):
    """Round vertical posts of any height, fixed to the ground, one entry for each."""

    x: Numbers = quantity((), 'm', 'x of the peg axes')
    y: Numbers = quantity((), 'm', 'y of the peg axes')
    radius: PerLink = quantity(0.05, 'm', 'radius of all pegs or of each', above=0, minimum=1e-6)
    friction: float = quantity(
        0.2, '1', 'Coulomb friction in all directions', minimum=0, maximum=STICKY
    )

    def __post_init__(self) -> None:
        """Check every field, and that there are as many x as y and radii."""
        super().__post_init__()
        if len(self.x) != len(self.y):
            raise ParameterError(
                f'x and y must be of one length, got {len(self.x)} and {len(self.y)} numbers'
            )
        if isinstance(self.radius, tuple) and len(self.radius) != len(self.x):
            raise ParameterError(
                f'radius must be one number or one for each of the {len(self.x)} pegs, '
                f'got {len(self.radius)} numbers'
            )

    @property
    def axes(self) -> NDArray[Any]:
        """x, y and radius of every peg, shape (pegs, 3) [m]."""
        radius = np.broadcast_to(np.asarray(self.radius, dtype=float), (len(self.x),))
        return np.column_stack([self.x, self.y, radius]).reshape(-1, 3)


@dataclass(frozen=True, kw_only=True)
class Ground(CheckedRecord):
    """The ground as square cells of constant height; everywhere else it is z = 0."""

    heights: tuple[Numbers, ...] = quantity(
        (), 'm', 'heights of the cells: along x in a row, the rows along y'
    )
    cell: float = quantity(0.2, 'm', 'side of a cell', above=0, minimum=1e-6)
    origin: Numbers = quantity((0.0, 0.0), 'm', 'corner of the cells with the least x and y')

    def __post_init__(self) -> None:
        """Check every field, that rows have one length, and that the origin is a point."""
        super().__post_init__()
        _check_cells('heights', self.heights, self.origin)


@dataclass(frozen=True, kw_only=True)
class Patches(CheckedRecord):
    """
    Square patches of the ground with another friction; everywhere else the factor is 1.

    A factor multiplies all coefficients of `Friction` for the spheres whose centers are above the
    cell. Walls belong to the cell that the sphere is above.
    """

    factors: tuple[Numbers, ...] = quantity(
        (),
        '1',
        'factors of friction of the cells: along x in a row, the rows along y',
        minimum=0,
        maximum=STICKY,
    )
    cell: float = quantity(0.2, 'm', 'side of a cell', above=0, minimum=1e-6)
    origin: Numbers = quantity((0.0, 0.0), 'm', 'corner of the cells with the least x and y')

    def __post_init__(self) -> None:
        """Check every field, that rows have one length, and that the origin is a point."""
        super().__post_init__()
        _check_cells('factors', self.factors, self.origin)


def _check_cells(name: str, rows: tuple[Numbers, ...], origin: Numbers) -> None:
    """Raise an error if rows of cells differ in length, or if their origin is not a point."""
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ParameterError(
            f'{name} must be rows of one length, got rows of {lengths[0]} and of '
            f'{lengths[-1]} numbers'
        )
    if len(origin) != 2:
        raise ParameterError(f'origin must have 2 components, got {len(origin)}')


NOTHING = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Start(CheckedRecord):
    """
    Posture and place of the robot at the start, where it is at rest.

    Angles are one number for all joints or one for each. The centroid of the links is at
    `position`. Their principal axis, with link 1 at its end with the smaller x, has the direction
    `heading`, and the last link is up by the angle `tilt`. The lowest contact sphere is `height`
    above the ground.
    """

    yaw: PerJoint | None = quantity(
        None, 'rad', 'yaw angles of the joints; default: those of the gait at t = 0'
    )
    pitch: PerJoint | None = quantity(
        None, 'rad', 'pitch angles of the joints; default: those of the gait at t = 0'
    )
    position: Numbers = quantity((0.0, 0.0), 'm', 'x and y of the centroid of the links')
    heading: float = quantity(
        0.0, 'rad', 'angle from the x axis to the robot, counterclockwise from above'
    )
    tilt: float = quantity(
        0.0, 'rad', 'angle between the floor and the robot, whose last link is up'
    )
    height: float = quantity(
        0.0, 'm', 'gap between the lowest contact sphere and the ground', minimum=0
    )

    def __post_init__(self) -> None:
        """Check every field, and that the position is a point."""
        super().__post_init__()
        if len(self.position) != 2:
            raise ParameterError(f'position must have 2 components, got {len(self.position)}')

    def check(self, robot: 'Robot') -> None:
        """
        Check that the joints of a robot can have the angles.

        Raises
        ------
        ParameterError
            If they are not one number or one for each joint, or beyond the limits of a joint.

        """
        joint_count = robot.link_count - 1
        for k, (name, angle) in enumerate((('yaw', self.yaw), ('pitch', self.pitch))):
            if isinstance(angle, tuple) and len(angle) != joint_count:
                raise ParameterError(
                    f'start.{name} must be one number or one for each of the {joint_count} '
                    f'joints, got {len(angle)} numbers'
                )
            angles = np.broadcast_to(0.0 if angle is None else angle, joint_count)
            if angle is not None and joint_count and (beyond := robot.beyond(k, angles, angles)):
                j, limit = beyond
                degrees = f'; for degrees say start.{name}_deg' if abs(angles[j]) > math.pi else ''
                raise ParameterError(
                    f'start.{name} must be within {limit}, got {angles[j]:.4g} rad{degrees}'
                )


@dataclass(frozen=True, kw_only=True)
class Push(CheckedRecord):
    """A force and a torque at the center of a link for some time, in axes of the world."""

    link: int | None = quantity(
        None, '1', 'number of the link, from 1 as in link_1; default: the middle one', minimum=1
    )
    force: Numbers = quantity(NOTHING, 'N', 'force at the center of the link')
    torque: Numbers = quantity(NOTHING, 'N m', 'torque about the center of the link')
    start: float = quantity(0.0, 's', 'simulated time at which it begins', minimum=0)
    duration: float = quantity(0.1, 's', 'how long it lasts', above=0)

    def __post_init__(self) -> None:
        """Check every field, and that it pushes."""
        super().__post_init__()
        for name, vector in (('force', self.force), ('torque', self.torque)):
            check_components(name, vector, 3)
        if not any(self.force + self.torque):
            raise ParameterError('a push must have a force or a torque that is not 0')


INERTIAS = ('as_printed', 'consistent')


@dataclass(frozen=True, kw_only=True)
class Robot(CheckedRecord):
    """
    Links and joints of the robot; the defaults are those of Aiko, section VIII-A.

    A quantity of a link is one number for all links or one number for each; a gain of a joint is
    one number for all joints or one for each. With the inertia `as_printed` the moments of inertia
    are the given ones; with `consistent` they follow from mass, length and contact radius of each
    link.
    """

    link_count: int = quantity(11, '1', 'number of links n', minimum=1, maximum=200)
    link_length: PerLink = quantity(
        0.122, 'm', 'distance between adjacent joints L', above=0, minimum=1e-6
    )
    link_mass: PerLink = quantity(7.5 / 11, 'kg', 'link mass m', above=0, minimum=1e-9)
    inertia: str = quantity(
        'as_printed',
        '',
        'moments of inertia: the values given, or those of a uniform cylinder',
        choices=INERTIAS,
    )
    inertia_transversal: PerLink = quantity(
        9.63e-4, 'kg m^2', 'moment of inertia Theta_1 across the link', above=0, minimum=1e-18
    )
    inertia_axial: PerLink = quantity(
        2.35e-4, 'kg m^2', 'moment of inertia Theta_3 along the link', above=0, minimum=1e-18
    )
    contact_offset: PerLink = quantity(
        0.0393, 'm', 'distance L_GS from the center of a link to a contact sphere', minimum=0
    )
    contact_radius: PerLink = quantity(0.0525, 'm', 'contact sphere radius L_SC', minimum=0)
    yaw_stiffness: PerJoint = quantity(
        40.0, 'N m/rad', 'horizontal gain K_hp', minimum=0, maximum=1e9
    )
    yaw_damping: PerJoint = quantity(
        0.2, 'N m s/rad', 'horizontal gain K_hd', minimum=0, maximum=1e9
    )
    pitch_stiffness: PerJoint = quantity(
        800.0, 'N m/rad', 'vertical gain K_vp', minimum=0, maximum=1e9
    )
    pitch_damping: PerJoint = quantity(
        0.2, 'N m s/rad', 'vertical gain K_vd', minimum=0, maximum=1e9
    )
    joint_rate_limit: float = quantity(
        10.0, 'rad/s', 'largest joint reference rate accepted (assumption)', above=0
    )
    joint_limit: float = quantity(
        math.pi / 4, 'rad', 'largest joint reference accepted', above=0, maximum=LARGEST_ANGLE
    )
    joint_stop: bool = quantity(False, '', 'whether joints have a hard stop at their limits')
    rate_stop: bool = quantity(False, '', 'whether joint rates are limited to joint_rate_limit')
    yaw_torque_limit: PerJoint | None = quantity(
        None, 'N m', 'largest torque of the horizontal controller (none = unlimited)', minimum=0
    )
    pitch_torque_limit: PerJoint | None = quantity(
        None, 'N m', 'largest torque of the vertical controller (none = unlimited)', minimum=0
    )
    joint_friction: PerAxis = quantity(
        0.0, 'N m', 'Coulomb friction of joints or of each axis (assumption: none)', minimum=0
    )
    control_rate: float = quantity(
        0.0, 'Hz', 'rate at which controllers sample their encoders (0 = continuously)', minimum=0
    )
    reference_rate: float = quantity(
        0.0,
        'Hz',
        'rate at which controllers sample and hold their reference (0 = continuously)',
        minimum=0,
    )
    command_delay: float = quantity(
        0.0, 's', 'delay before a reference takes effect (assumption: none)', minimum=0, maximum=10
    )
    encoder_resolution: float = quantity(
        0.0,
        'rad',
        'resolution of measured joint angles, also in joint_states (0 = exact)',
        minimum=0,
        maximum=1,
    )
    effort_commands: bool = quantity(
        False, '', 'whether commands may carry torques in addition to angles and rates'
    )
    joint_viscous_friction: PerAxis = quantity(
        0.0, 'N m s/rad', 'viscous friction, likewise (assumption: none)', minimum=0
    )
    links: tuple[Link, ...] = quantity(
        (), '', 'the links one by one, if they are not given by the numbers above'
    )
    joints: tuple[Joint, ...] = quantity((), '', 'the joints between these links')
    up: Numbers | None = quantity(
        None, '1', 'what is up in the frame of the base, where joints begin; default: its z'
    )

    def __post_init__(self) -> None:
        """Check every field, the lengths of lists, and that a cylinder has an inertia."""
        if isinstance(self.links, int):
            raise ParameterError(
                f'links must be the links one by one, got {self.links}: their number is link_count'
            )
        super().__post_init__()
        if self.links or self.joints:
            self._check_chain()
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name in ('links', 'joints', 'up'):
                continue
            count, parts = self.link_count, 'links'
            if item.name.endswith(('_stiffness', '_damping', '_torque_limit', '_friction')):
                count, parts = self.link_count - 1, 'joints'
            counts = {count}
            if item.name.endswith('_friction') and isinstance(value, tuple):
                counts.add(len(self.axis_names))
                parts = f'joints or {len(self.axis_names)} axes'
            if isinstance(value, tuple) and len(value) not in counts:
                raise ParameterError(
                    f'{item.name} must be one number or one for each of the {count} {parts}, '
                    f'got {len(value)} numbers'
                )
        if self.inertia == 'consistent' and (self.per_link('inertia_axial') < 1e-18).any():
            raise ParameterError(
                'contact_radius must make the inertia of a cylinder (consistent) at least 1e-18 '
                f'kg m^2, got {self.per_link("contact_radius").min():g} m'
            )

    def _check_chain(self) -> None:
        """Check the links and joints that are given one by one, and let them count."""
        most = type(self).__dataclass_fields__['link_count'].metadata['maximum']
        if len(self.links) > most:
            raise ParameterError(f'links must be at most {most:g}, got {len(self.links)}')
        if len(self.joints) != len(self.links) - 1:
            raise ParameterError(
                f'joints must be one fewer than the links, got {len(self.joints)} joints and '
                f'{len(self.links)} links'
            )
        if self.up is not None and (len(self.up) != 3 or not any(self.up)):
            raise ParameterError(f'up must be a direction of 3 numbers, got {list(self.up)}')
        default = type(self).link_count
        if self.link_count not in (default, len(self.links)):
            raise ParameterError(
                f'link_count must be the number of links, {len(self.links)}, got {self.link_count}'
            )
        object.__setattr__(self, 'link_count', len(self.links))
        names = [name for joint in self.joints for name in joint.axis_names]
        links = [link.name for link in self.links]
        frames = [frame.name for link in self.links for frame in link.frames]
        if frames:
            frames += links + [name + CENTER for name in links if name]
        for what, given in (('joint axes', names), ('links', links), ('frames', frames)):
            twice = sorted(name for name, count in Counter(given).items() if count > 1 and name)
            if twice:
                raise ParameterError(f'names of {what} must differ, got {twice[0]!r} twice')
        backward = [joint.backward for joint in self.joints]
        if backward != sorted(backward, reverse=True):
            raise ParameterError(
                f'joints that lead backward must come before the others, got '
                f'{self.joints[backward.index(False)].name or "another one"} before them'
            )
        if not any(link.shapes for link in self.links):
            raise ParameterError('a link must have shapes to lie on: all links have none')
        for joint in self.joints:
            low, high, _ = joint.limits(self.joint_limit, self.joint_rate_limit)
            for name, least, most in zip(joint.axis_names, low, high, strict=True):
                if not least < most:
                    raise ParameterError(
                        f'lower of {name or "a joint"} must be below upper, both within '
                        f'joint_limit, got {least:.4g} and {most:.4g} rad'
                    )
        _ = self.chain

    @cached_property
    def chain(self) -> Chain:
        """Geometry and masses of the robot; the arrays must not be changed."""
        return _chain_of(self)

    def per_link(self, name: str) -> Array:
        """
        Return the quantity `name` of every link, shape (n,).

        Consistent moments of inertia are those of a uniform cylinder of the link's mass m, length
        L and contact radius r: ``Theta_1 = m (3 r^2 + L^2)/12``, ``Theta_3 = m r^2/2``.
        """
        if self.links:
            return self._link_by_link(name)
        if self.inertia == 'consistent' and name in ('inertia_transversal', 'inertia_axial'):
            m, L, r = map(self.per_link, ('link_mass', 'link_length', 'contact_radius'))
            across, along = m * (3 * r**2 + L**2) / 12, m * r**2 / 2
            return np.asarray(along if name == 'inertia_axial' else across)
        return self._each(name, self.link_count)

    def _link_by_link(self, name: str) -> Array:
        """
        Return the quantity `name` of links that are given one by one, shape (n,).

        The length is that between the joints, of the first and the last link twice the way from
        the center of mass to the joint. The contact radius is that of the largest sphere, 0
        without spheres, the contact offset that of the furthest one along the link.
        """
        chain = self.chain
        if name == 'link_mass':
            return chain.mass
        if name == 'link_length':
            places, n = chain.places, self.link_count
            twice = [1.0 if 0 < i < n - 1 else 2.0 for i in range(n)]
            return np.asarray(twice * np.linalg.norm(places.distal - places.proximal, axis=1))
        if name.startswith('inertia_'):
            moments = np.diagonal(chain.inertia, axis1=1, axis2=2)
            return moments[:, 2] if name == 'inertia_axial' else moments[:, :2].mean(axis=1)
        of = (
            chain.spheres.radius if name == 'contact_radius' else np.abs(chain.spheres.place[:, 2])
        )
        found = np.zeros(self.link_count)
        np.maximum.at(found, chain.spheres.link, of)
        return found

    def per_joint(self, name: str) -> Array:
        """
        Return a quantity of the axes (yaw, pitch) of every joint, shape (n-1, 2).

        Its name is stiffness, damping, torque_limit, friction or viscous_friction. For an axis
        that a joint does not have it is 0, its torque limit infinite.
        """
        count, axes = self.link_count - 1, self.chain.axes
        if name.endswith('friction'):
            each = getattr(self, f'joint_{name}')
            values = np.zeros((count, 2))
            if isinstance(each, tuple) and len(each) == len(axes):
                values[axes[:, 0], axes[:, 1]] = each
            else:
                values.T[:] = each
        else:
            values = np.column_stack([self._each(f'{k}_{name}', count) for k in ('yaw', 'pitch')])
        if self.links:
            none = math.inf if name == 'torque_limit' else 0.0
            values[self.chain.places.present == 0.0] = none
        return values

    @cached_property
    def limits(self) -> JointLimits:
        """Limits of all axes; an axis without its own has those of the robot."""
        shape = (self.link_count - 1, 2)
        limit, rate = self.joint_limit, self.joint_rate_limit
        found = JointLimits(*(np.full(shape, value) for value in (-limit, limit, rate)))
        if self.joints:
            own = [joint.limits(limit, rate) for joint in self.joints]
            given = JointLimits(*(np.concatenate(each) for each in zip(*own, strict=True)))
            joint, slot = self.chain.axes.T
            for each, values in zip(found, given.turned(self.chain.signs < 0.0), strict=True):
                each[joint, slot] = values
        return found

    def limits_of_axes(self, places: Array) -> JointLimits:
        """Return the limits of axes at some `axis_places`, with their own signs, shape (k,)."""
        found = JointLimits(*(each.reshape(-1)[places] for each in self.limits))
        return found.turned(self.place_signs[places] < 0.0)

    def beyond(self, slot: int, least: Array, largest: Array) -> tuple[int, str] | None:
        """
        Return the joint whose angles are furthest beyond its limits, and a text about these.

        Parameters
        ----------
        slot : int
            0 for the yaw axes, 1 for the pitch axes.
        least, largest : ndarray, shape (n-1,)
            Angles that the joints have, with the signs of the model [rad].

        """
        limits = JointLimits(*(each[:, slot] for each in self.limits))
        low, high, excess = limits.low, limits.high, limits.excess(least, largest)
        j = int(excess.argmax())
        if not excess[j] > 0.0:
            return None
        if (high == self.joint_limit).all() and (low == -self.joint_limit).all():
            return j, f'the joint limit, {range_text(low[j], high[j])}'
        name = self.name_of_axis(2 * j + slot)
        return j, f'the joint limit of {name}, {range_text(low[j], high[j])}'

    def name_of_axis(self, place: int) -> str:
        """Return the name of the axis at one of `axis_places`; an absent one has that of Aiko."""
        for at, name in zip(self.axis_places, self.axis_names, strict=True):
            if at == place:
                return name
        return f'joint_{place // 2 + 1}_{("yaw", "pitch")[place % 2]}'

    def _each(self, name: str, count: int) -> Array:
        """Return the quantity `name` of every link or every joint, shape (count,)."""
        value = getattr(self, name)
        if value is None:
            return np.full(count, math.inf)
        return np.array(value) if isinstance(value, tuple) else np.full(count, value)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links: link_1, link_2, ... unless they are given one by one."""
        return self.chain.link_names

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the joint axes, in the order of the columns of all arrays with one for each."""
        return self.chain.names

    @property
    def axis_places(self) -> Array:
        """Places of the joint axes among (yaw, pitch) of all joints in a row, shape (axes,)."""
        return np.asarray(self.chain.axes @ [2, 1])

    @property
    def axis_signs(self) -> Array:
        """Signs of the joint axes, shape (axes,): -1 where the model turns the other way."""
        return self.chain.signs

    @property
    def place_signs(self) -> Array:
        """The same for all (yaw, pitch) of all joints in a row, shape (2(n-1),)."""
        signs = np.ones(2 * (self.link_count - 1))
        signs[self.axis_places] = self.axis_signs
        return signs

    def by_axis(self, values: Array) -> Array:
        """
        Return values of the joint axes as columns, in the order of `axis_names`.

        Parameters
        ----------
        values : ndarray, shape (..., n-1, 2)
            Of the (yaw, pitch) of every joint, as compiled code and gaits have them.

        Returns
        -------
        ndarray, shape (..., axes)
            For Aiko a view of the values, with 2(n-1) columns.

        """
        if not self.links:
            return values.reshape(*values.shape[:-2], 2 * values.shape[-2])
        axes, signs = self.chain.axes, self.chain.signs
        return np.asarray(signs * values[..., axes[:, 0], axes[:, 1]])

    def by_joint(self, values: Array, absent: float = math.nan) -> Array:
        """
        Return columns of joint axes as (yaw, pitch) of every joint: the inverse of `by_axis`.

        Parameters
        ----------
        values : ndarray, shape (..., axes)
        absent : float, optional
            Value of an axis that a joint does not have.

        Returns
        -------
        ndarray, shape (..., n-1, 2)

        """
        shape = *values.shape[:-1], self.link_count - 1, 2
        if not self.links:
            return values.reshape(shape)
        found, (axes, signs) = np.full(shape, absent), (self.chain.axes, self.chain.signs)
        found[..., axes[:, 0], axes[:, 1]] = signs * values
        return found

    @property
    def base_link(self) -> int:
        """Index of the link in whose frame the base is: the middle one, or where joints begin."""
        return base_of(self.joints) if self.links else self.middle_link

    @property
    def middle_link(self) -> int:
        """Index of the middle link: 5 for Aiko, the paper's link 6."""
        return self.link_count // 2


def range_text(low: float, high: float) -> str:
    """Return a range of angles [rad] as text."""
    return f'+-{high:.4g} rad' if low == -high else f'{low:.4g} to {high:.4g} rad'


@lru_cache(maxsize=64)
def _chain_of(robot: Robot) -> Chain:
    """Return `robot.chain`."""
    if robot.links:
        return chain_of_links(robot.links, robot.joints, robot.up)
    return chain_of_equal_links(robot)


@dataclass(frozen=True, kw_only=True)
class Solver(CheckedRecord):
    """Numbers of the contact iteration, section VII-B."""

    normal_compliance: float = quantity(
        1e-4,
        '1',
        'selection rule: normal compliance delta, relative to the Delassus operator (0 = none)',
        minimum=0,
    )
    activation_tolerance: float = quantity(
        1e-6,
        'm',
        'gap below which a contact is closed, at most 2.5 m/s^2 dt^2 (0 = as printed)',
        minimum=0,
    )
    residual_tolerance: float = quantity(
        1e-9, 'm/s', 'natural-map residual at which Newton and Gauss-Seidel methods stop', above=0
    )
    tolerance: float = quantity(
        1e-7,
        'N s',
        "stopping tolerance eps of eq. (93), the paper's iteration (assumption)",
        above=0,
    )
    iteration_limit: int = quantity(
        0,
        '1',
        'iterations after which a step counts as unconverged; 0: 1000 of newton and bdf2, 5000 '
        'of paper',
        minimum=0,
        maximum=10**12,
    )
    r_normal: float = quantity(0.1, 'kg', 'prox parameter r_N', above=0)
    r_sliding: float = quantity(0.01, 'kg', 'prox parameter r_T', above=0)
    r_rolling: float = quantity(0.05, 'kg', 'prox parameter r_V', above=0)


# Schemes at the start and the middle of a step are explicit, those with its mean and its end are
# implicit. The method bdf2 has only the implicit ones, and one law of second order for both.
PD_SCHEMES = ('start', 'midpoint', 'average', 'end')
LEVELS = ('auto', 'planar', 'spatial')
NEWTON_METHODS = ('newton', 'bdf2', 'auto')
DRIFT_CORRECTIONS = ('paper', 'center_of_mass', 'none')


@dataclass(frozen=True, kw_only=True)
class Scene(CheckedRecord):
    """
    Everything needed to repeat a run, in SI units and radians.

    The defaults are Aiko at rest on the floor of case A, with friction 0.1 along and 0.5 across
    the links. `load_scene` makes a scene by name and replaces values in it.
    """

    robot: Robot = Robot()
    friction: Friction = Friction()
    patches: Patches = Patches()
    ground: Ground = Ground()
    pegs: Pegs = Pegs()
    world: World = World()
    self_contact: bool = quantity(False, '', 'whether links that are not neighbors can touch')
    self_contact_friction: float = quantity(
        0.2, '1', 'Coulomb friction of links on each other', minimum=0, maximum=STICKY
    )
    gait: Gait = Gait()
    follow: Following = Following()
    controller: NamedRecord = NamedRecord()
    start: Start = Start()
    pushes: tuple[Push, ...] = quantity((), '', 'forces and torques that act for some time')
    solver: Solver = Solver()
    gravity: tuple[float, ...] = quantity(
        (0.0, 0.0, -9.81), 'm/s^2', 'gravity in the inertial frame; tilt it for a slope'
    )
    dt: float = quantity(1 / 4000, 's', 'time step', above=0, minimum=1e-12, maximum=0.1)
    accuracy: float = quantity(
        0.0,
        '1',
        'target relative path error per gait cycle; steps are subdivided to meet it (0 = off)',
        minimum=0,
        maximum=0.1,
    )
    duration: float = quantity(15.0, 's', 'length of an offline run', above=0, maximum=1e9)
    method: str = quantity('newton', '', 'time-stepping method, or auto')
    level: str = quantity(
        'auto', '', 'model level; auto is planar as long as that is exact', choices=LEVELS
    )
    settling_time: float = quantity(
        0.1,
        's',
        'how long a robot must lie flat and still before auto becomes planar again',
        above=0,
        maximum=1e9,
    )
    pd_scheme: str = quantity(
        'average', '', 'where in the step the joint controller is evaluated', choices=PD_SCHEMES
    )
    drift_correction: str = quantity(
        'center_of_mass',
        '',
        'what the drift correction of section VII-C holds fixed',
        choices=DRIFT_CORRECTIONS,
    )

    @property
    def iteration_limit(self) -> int:
        """Iterations after which a step counts as unconverged, of the solver or of the method."""
        usual = 1000 if self.method in NEWTON_METHODS else 5000
        return self.solver.iteration_limit or usual

    def __post_init__(self) -> None:
        """Check every field, and what depends on several of them."""
        super().__post_init__()
        joints, given = self.robot.link_count - 1, self.gait.table.joint_count
        if self.gait.table and given != joints:
            raise ParameterError(
                f'gait.table must have the {joints} joints of the robot, got {given} joints'
            )
        self.start.check(self.robot)
        for push in self.pushes:
            if push.link and push.link > joints + 1:
                raise ParameterError(f'link of a push must be 1 to {joints + 1}, got {push.link}')
        check_components('gravity', self.gravity, 3)
        if self.world and self.ground.heights:
            raise ParameterError(
                'ground.heights must be empty in a scene with a world; world.boxes and '
                'world.height_fields take their place'
            )
        if self.ground.heights:
            widest = 2 * float(self.robot.per_link('contact_radius').max())
            if self.ground.cell < widest:
                raise ParameterError(
                    f'ground.cell must be at least twice the largest contact radius, {widest:g} '
                    f'm, got {self.ground.cell:g} m'
                )


def load_scene(source: str | Path) -> Scene:
    """
    Read a scene from a YAML file, or by name from those that come with the package.

    Parameters
    ----------
    source : str or Path
        A file, or the name of a scene in config/ with or without ``.yaml``. The robot that a scene
        names, a YAML file or a URDF, is searched in the folder of the scene, then in config/. A
        URDF is a scene of that robot alone.

    Raises
    ------
    ParameterError
        If the file is missing or unreadable, or if anything in it is not usable.

    """
    path = find_file(source, Path())
    if path.suffix == '.urdf':
        return Scene(robot=load_robot(path.name, path.parent, path.name))
    mapping = read_mapping(path)
    names = {str(key).removesuffix('_deg') for key in mapping}
    if names and names <= {item.name for item in fields(Robot)}:
        name = cut(str(source), LONGEST_PATH)
        raise ParameterError(f'{name} is a robot, not a scene; scenes say "robot: {name}"')
    robot = mapping.get('robot')
    if isinstance(robot, str) or (isinstance(robot, Mapping) and 'urdf' in robot):
        mapping['robot'] = to_mapping(load_robot(robot, path.parent, path.name))
    return _scene(mapping, path.name, path.parent)


def load_robot(
    source: Any, folder: Path = Path(), where: str = 'robot', gains: Robot | None = None
) -> Robot:
    """
    Return a robot from a file, from the text of a URDF, or from its values.

    Parameters
    ----------
    source : str, Path or mapping
        A YAML file or the name of a robot in config/; a URDF, as a file or as a text; or a mapping
        of values. Its key `urdf` names a URDF, `base` a link in whose frame the base is, `head`
        one at the end that comes first, and `replace_inertia: true` replaces inertias that cannot
        be.
    folder : Path, optional
        Where files are searched.
    where : str, optional
        What names the robot, for errors.
    gains : Robot, optional
        What a URDF does not say is that of this robot. Default: as Aiko.

    Raises
    ------
    ParameterError
        If the source is not usable.

    """
    if isinstance(source, Mapping) and 'urdf' in source:
        given = dict(source)
        keys = ('base', 'head', 'replace_inertia')
        options = {key: given.pop(key) for key in keys if key in given}
        values = _values_of_urdf(given.pop('urdf'), folder, where, **options)
        robot: Robot = from_mapping(Robot, values | given, where)
        return robot
    if isinstance(source, Mapping):
        robot = from_mapping(Robot, source, where)
        return robot
    if str(source).lstrip().startswith('<') or str(source).endswith('.urdf'):
        values = _values_of_urdf(str(source), folder, where)
        kept = values_of(gains) if gains else {}
        robot = from_mapping(Robot, {**kept, 'link_count': len(values['links']), **values}, where)
        return robot
    path = find_file(source, folder, where)
    robot = from_mapping(Robot, read_mapping(path), path.name)
    return robot


def _values_of_urdf(source: str, folder: Path, where: str, **options: Any) -> dict[str, Any]:
    """Return the values that a URDF, a text or a file, gives a robot; log what it leaves out."""
    from snake_sim_ros.scene.urdf import robot_of_urdf

    name = where
    if not source.lstrip().startswith('<'):
        path = find_file(source, folder, where)
        source, folder, name = read_text(path), path.parent, path.name
    found = robot_of_urdf(source, folder=folder, name=name, **options)
    for remark in found.remarks:
        LOG.warning('%s: %s', name, remark)
    return found.values


def _scene(mapping: Any, where: str, folder: Path) -> Scene:
    """Return the scene of a mapping; the file of a table is in a folder."""
    gait = mapping.get('gait') if isinstance(mapping, Mapping) else None
    if isinstance(gait, Mapping) and (gait.get('table') or 'name' in gait):
        robot = from_mapping(Robot, mapping.get('robot'), f'{where}: robot')
        try:
            if 'name' in gait:
                gait = named_gait(gait, robot.link_count - 1)
            else:
                gait = {**gait, 'table': table_from(gait['table'], folder, robot)}
        except ParameterError as error:
            raise ParameterError(f'{where}: {error}') from None
        mapping = {**mapping, 'gait': gait}
    if isinstance(mapping, Mapping) and 'world' in mapping:
        mapping = {**mapping, 'world': in_folder(mapping['world'], folder)}
    scene: Scene = from_mapping(Scene, mapping, where)
    file, _, name = scene.controller.name.rpartition(':')
    if file.endswith('.py') and is_file(folder / file):
        found = f'{(folder / file).resolve()}:{name}'
        scene = replace(scene, controller=replace(scene.controller, name=found))
    return scene


def scene_from_text(text: str) -> Scene:
    """Return the scene that `scene_to_text` wrote."""
    return _scene(parse_yaml(text), 'scene', Path())


def scene_to_text(scene: Scene) -> str:
    """Return the scene as YAML text, in SI units and radians, without leaving out defaults."""
    mapping = to_mapping(scene)
    if scene.gait.table:
        mapping['gait']['table'] = table_to_text(scene.gait.table)
    return yaml.safe_dump(mapping, sort_keys=False)


def with_settings(scene: Scene, settings: Mapping[str, Any]) -> Scene:
    """
    Return the scene with some values replaced.

    Parameters
    ----------
    scene : Scene
    settings : mapping
        Dotted names to values, such as ``{'dt': 0.01}``; `gait.table` may be a file, `gait` a
        `NamedGait`, and with `gait.name` all of `gait` are parameters of the gait of that name. A
        gait that has a name takes its parameters, such as `gait.waves`, without it as well.

    Raises
    ------
    ParameterError
        If a name is unknown or a value not usable.

    """
    gait = settings.get('gait')
    if isinstance(gait, NamedGait) or 'gait.name' in settings:
        given = {
            name.removeprefix('gait.'): value
            for name, value in settings.items()
            if name.startswith('gait.')
        }
        settings = {name: settings[name] for name in settings if name.partition('.')[0] != 'gait'}
        scene = with_values(scene, settings)
        joints = scene.robot.link_count - 1
        if isinstance(gait, NamedGait):
            return replace(scene, gait=made_gait(gait, joints))
        return replace(scene, gait=named_gait(given, joints))
    if (named := made_of(scene.gait)) and (own := _parameters_in(settings, named)):
        rest = {name: value for name, value in settings.items() if name not in own}
        given = {name.removeprefix('gait.'): value for name, value in own.items()}
        scene, known = with_settings(scene, rest), values_of(named)
        for name in given:
            known.pop(name.removesuffix('_deg'), None)
        if made_of(scene.gait) is None:
            raise ParameterError(
                f'{next(iter(own))} is of gait {named.name}: its waves must not be set as well'
            )
        made = named_gait({'name': named.name, **known, **given}, scene.robot.link_count - 1)
        return replace(scene, gait=made)
    if (source := settings.get('gait.table')) is not None:
        count = settings.get('robot.link_count')
        robot = scene.robot if count is None else Robot(link_count=int(count))
        settings = {**settings, 'gait.table': table_from(source, Path(), robot)}
    changed: Scene = with_values(scene, settings)
    return changed


def _parameters_in(settings: Mapping[str, Any], named: NamedGait) -> dict[str, Any]:
    """Return those settings that are parameters of a named gait, none if all are of any gait."""
    known = {f'gait.{name}' for name in values_of(named)}
    own = {name: settings[name] for name in settings if name.removesuffix('_deg') in known}
    of_gait = [name for name in settings if name.startswith('gait.')]
    is_waves = own.keys() <= {'gait.soft_start'} and len(of_gait) > len(own)
    return {} if is_waves else own


def named_values(scene: Scene) -> dict[str, tuple[Any, Mapping[str, Any]]]:
    """Return `flat_fields` of a scene, and the parameters of its gait if that has a name."""
    named = made_of(scene.gait)
    return flat_fields(scene) | (flat_fields(named, 'gait.') if named else {})


def by_dotted_names(values: Mapping[str, Any], record: Any, prefix: str = '') -> dict[str, Any]:
    """Return nested values by dotted names, as far as a record has records inside."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        inside = getattr(record, name, None) if isinstance(name, str) else None
        if isinstance(value, Mapping) and is_dataclass(inside) and not isinstance(inside, Table):
            found |= by_dotted_names(value, inside, f'{prefix}{name}.')
        else:
            found[f'{prefix}{name}'] = value
    return found


MOST_STEPS = 2**53  # in any period


def steps_in(period: float, dt: float, name: str) -> int:
    """
    Return the number of steps in a period [s]; `name` is that of the period in the message.

    Raises
    ------
    ParameterError
        If the time step dt [s] does not divide the period.

    """
    if not period / dt <= MOST_STEPS:
        raise ParameterError(
            f'{name} must be at most {MOST_STEPS} steps of {dt:g} s, got {period:g} s'
        )
    steps = round(period / dt)
    if steps < 1 or abs(steps * dt - period) > 1e-9 * period:
        raise ParameterError(f'dt must divide the {name}: got dt={dt:g} s, period={period:g} s')
    return steps


def samples_of(scene: Scene, rate: float) -> tuple[int, int]:
    """
    Return the steps between two samples of a run at a rate [Hz], and the samples after the first.

    Raises
    ------
    ParameterError
        If dt does not divide the sampling period, or the sampling period the duration.

    """
    if not rate > 0:
        raise ParameterError(f'rate must be above 0 Hz, got {rate:g} Hz')
    steps = steps_in(1.0 / rate, scene.dt, 'sampling period')
    samples, rest = divmod(steps_in(scene.duration, scene.dt, 'duration'), steps)
    if rest:
        raise ParameterError(
            f'duration must be a multiple of the sampling period, 1/{rate:g} s; '
            f'got {scene.duration:g} s'
        )
    return steps, samples
