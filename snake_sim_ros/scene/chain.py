# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Any chain of links and joints: its records in a scene, and its geometry in the frames of the model.

A robot is given by numbers that are alike for all links (Aiko, section VIII-A), or link by link.
Then a link has a frame of its own choice, as in a URDF: the frame of link i+1 is where `origin`
and `rotation` of joint i put it in that of link i, turned about the axes of the joint. The base of
a URDF may be any of the links; from there to link 1 joints lead backward, and put the frame of
link i in that of link i+1.

The model has its own frames B, in which the equations of the paper hold: at the center of mass,
e_z along the link to the next joint, e_y up and e_x to the left when the robot lies with all
joints at 0. About which axes a joint turns is given by a frame of its own in each of its two
links, see `JointPlaces`. Everything in this module is about that posture unless it says otherwise.
"""

from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity
from snake_sim_ros.scene.gait import Numbers

Array = NDArray[Any]
PerAxis = float | Numbers
SAME = 1e-12  # directions and lengths that differ by less are the same [1], [m]
SQUARE = 1e-9  # largest cosine between two axes at right angles
NOWHERE = (0.0, 0.0, 0.0)
UPRIGHT = 0.9  # cosine between z and links that counts as links along z
CENTER = '_center'  # after the name of a link: that of the frame at its center of mass
YAW_SHARE = 0.1  # least part of an axis along e_y by which it may count as the yaw of a joint
# Angles are regular below 180 degrees, whether a joint has one axis or two; there they jump to
# -180. So much may a joint turn, with 8 degrees for what a controller swings beyond [rad].
LARGEST_ANGLE = 3.0


# ---- records ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Shape(CheckedRecord):
    """A sphere of a link that touches the world, or a capsule: all points near a segment."""

    radius: float = quantity(0.05, 'm', 'radius of the sphere or the capsule', above=0)
    start: Numbers = quantity(NOWHERE, 'm', 'center of the sphere, in the frame of the link')
    end: Numbers | None = quantity(
        None, 'm', 'other end of the axis of a capsule; default: a sphere'
    )

    def __post_init__(self) -> None:
        """Check every field, and that both ends are points."""
        super().__post_init__()
        _check_lengths(self, start=3, end=3)


@dataclass(frozen=True, kw_only=True)
class Mesh(CheckedRecord):
    """A mesh as which a link is seen; it touches nothing."""

    file: str = quantity('', '', 'file of the mesh')
    origin: Numbers = quantity(NOWHERE, 'm', 'its origin, in the frame of the link')
    rotation: Numbers = quantity(NOWHERE, 'rad', 'its roll, pitch and yaw, as in a URDF')
    scale: Numbers = quantity((1.0, 1.0, 1.0), '1', 'factors of its coordinates')

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        _check_lengths(self, origin=3, rotation=3, scale=3)


@dataclass(frozen=True, kw_only=True)
class FixedFrame(CheckedRecord):
    """A frame that moves with a link, such as that of an IMU or a camera."""

    name: str = quantity('', '', 'name of the frame')
    origin: Numbers = quantity(NOWHERE, 'm', 'its origin, in the frame of the link')
    rotation: Numbers = quantity(NOWHERE, 'rad', 'its roll, pitch and yaw, as in a URDF')

    def __post_init__(self) -> None:
        """Check every field, and that it has a name."""
        super().__post_init__()
        _check_lengths(self, origin=3, rotation=3)
        if not self.name:
            raise ParameterError('a fixed frame must have a name, got none')


@dataclass(frozen=True, kw_only=True)
class Link(CheckedRecord):
    """One link of a chain, in a frame of its own choice."""

    name: str = quantity('', '', 'name of the link')
    mass: float = quantity(1.0, 'kg', 'mass', above=0, minimum=1e-9)
    center_of_mass: Numbers = quantity(NOWHERE, 'm', 'center of mass, in the frame of the link')
    inertia: Numbers = quantity(
        (1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0),
        'kg m^2',
        'xx, yy, zz, xy, xz, yz about the center of mass, in axes of the frame',
    )
    shapes: tuple[Shape, ...] = quantity((), '', 'what touches the world')
    meshes: tuple[Mesh, ...] = quantity(
        (), '', 'as what the viewer shows it; default: as its shapes'
    )
    friction: float = quantity(
        1.0, '1', 'factor of all coefficients of friction of this link', minimum=0
    )
    frames: tuple[FixedFrame, ...] = quantity((), '', 'further frames, such as that of an IMU')

    def __post_init__(self) -> None:
        """Check every field, and that a body can have the inertia."""
        super().__post_init__()
        _check_lengths(self, center_of_mass=3, inertia=6)
        least, middle, most = np.linalg.eigvalsh(self.tensor).tolist()
        if least < 1e-18 or most > (least + middle) * (1.0 + 1e-6):
            raise ParameterError(
                f'inertia of {self.name or "a link"} must have principal moments above 0, each at '
                f'most the sum of the others, got {least:.4g}, {middle:.4g}, {most:.4g} kg m^2'
            )

    @property
    def tensor(self) -> Array:
        """Inertia about the center of mass, shape (3, 3) [kg m^2]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True, kw_only=True)
class Joint(CheckedRecord):
    """
    The joint between a link of a chain and the next one, with one axis or two.

    If it leads backward, from the next link to this one, both change their parts: `origin` and
    `rotation` put the frame of this link in that of the next one, and positive angles turn this
    link about the axes, which are in its frame. The first axis is that nearer to this link.
    """

    name: str = quantity('', '', 'name of the joint, and of its first axis')
    origin: Numbers = quantity(NOWHERE, 'm', 'frame of the next link: its origin, in this link')
    rotation: Numbers = quantity(NOWHERE, 'rad', 'its roll, pitch and yaw, as in a URDF')
    axis: Numbers = quantity((0.0, 0.0, 1.0), '1', 'axis, in the frame of the next link')
    second_axis: Numbers | None = quantity(
        None, '1', 'second axis, at right angles to the first; default: none'
    )
    second_name: str = quantity('', '', 'name of the second axis; default: <name>_2')
    backward: bool = quantity(
        False, '', 'whether it puts this link in the next one, which is then the one before'
    )
    lower: PerAxis | None = quantity(
        None,
        'rad',
        'least angle of both axes or of each; default: -joint_limit of the robot',
        minimum=-LARGEST_ANGLE,
        maximum=LARGEST_ANGLE,
    )
    upper: PerAxis | None = quantity(
        None,
        'rad',
        'largest angle, likewise; default: joint_limit',
        minimum=-LARGEST_ANGLE,
        maximum=LARGEST_ANGLE,
    )
    rate: PerAxis | None = quantity(
        None, 'rad/s', 'largest rate, likewise; default: joint_rate_limit', above=0
    )

    def __post_init__(self) -> None:
        """Check every field, and that the axes are directions at right angles."""
        super().__post_init__()
        _check_lengths(self, origin=3, rotation=3, axis=3, second_axis=3)
        axes = [np.array(axis) for axis in (self.axis, self.second_axis) if axis is not None]
        name = self.name or 'a joint'
        for axis in axes:
            if not np.linalg.norm(axis) > SQUARE:
                raise ParameterError(f'axis of {name} must not be 0, got {axis.tolist()}')
        if len(axes) > 1:
            cosine = axes[0] @ axes[1] / np.linalg.norm(axes[0]) / np.linalg.norm(axes[1])
            if abs(cosine) > SQUARE:
                raise ParameterError(
                    f'axis and second_axis of {name} must be at right angles, got an angle of '
                    f'{math.degrees(math.acos(min(1.0, abs(cosine)))):.4g} degrees'
                )
        for field in ('lower', 'upper', 'rate'):
            value = getattr(self, field)
            if isinstance(value, tuple) and len(value) != len(axes):
                raise ParameterError(
                    f'{field} of {name} must be one number or one for each of its {len(axes)} '
                    f'axes, got {len(value)} numbers'
                )

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes."""
        if self.second_axis is None:
            return (self.name,)
        return self.name, self.second_name or f'{self.name}_2'

    def limits(self, limit: float, rate: float) -> tuple[Array, Array, Array]:
        """
        Return least angle, largest angle and largest rate of its axes, each of shape (axes,).

        Parameters
        ----------
        limit, rate : float
            Those of all axes of the robot, which those of an axis do not exceed [rad], [rad/s].

        """
        count = len(self.axis_names)
        own = ((self.lower, -limit), (self.upper, limit), (self.rate, rate))
        low, high, most = (np.full(count, d if v is None else v, dtype=float) for v, d in own)
        return np.maximum(low, -limit), np.minimum(high, limit), np.minimum(most, rate)


def _check_lengths(record: Any, **lengths: int) -> None:
    """Raise an error if fields of a record do not have so many numbers."""
    for name, length in lengths.items():
        value = getattr(record, name)
        if value is not None and len(value) != length:
            raise ParameterError(f'{name} must have {length} numbers, got {len(value)}')


# ---- geometry -----------------------------------------------------------------------------------


class JointPlaces(NamedTuple):
    """
    Where the joints of n links are in the link frames B, and how their axes lie.

    Joint j has a frame in link j, about whose e_y its first axis turns, and one in link j+1, about
    whose e_x its second axis turns. At angles of 0 both coincide. The frames of the joints of Aiko
    are those of its links.
    """

    distal: Array  # (n, 3) link center to the joint toward the next link, frame B [m]
    proximal: Array  # (n, 3) link center to the joint toward the link before, frame B [m]
    aligned: bool  # whether the frames of all joints are those of their links
    inner: Array  # (n-1, 3, 3) frame of joint j in link j
    outer: Array  # (n-1, 3, 3) frame of joint j in link j+1
    inner_turn: Array  # (n-1, 4) the same as Euler parameters
    outer_turn: Array  # (n-1, 4)
    present: Array  # (n-1, 2) 1 for an axis, 0 for one that a joint does not have
    complete: bool  # whether all joints have two axes
    straight: bool  # whether all joints are on the axes e_z of their links


class JointLimits(NamedTuple):
    """Limits of the axes (yaw, pitch) of the joints, with the signs that the model has."""

    low: Array  # (n-1, 2) least angle [rad]
    high: Array  # (n-1, 2) largest angle [rad]
    rate: Array  # (n-1, 2) largest rate [rad/s]

    def turned(self, around: Array) -> 'JointLimits':
        """Return the limits of the same axes, some of which are turned around."""
        low, high = np.where(around, -self.high, self.low), np.where(around, -self.low, self.high)
        return JointLimits(low, high, self.rate)

    def excess(self, least: Array, largest: Array) -> Array:
        """Return how far angles from least to largest are beyond the limits [rad]."""
        return np.asarray(np.maximum(self.low - least, largest - self.high))


class Spheres(NamedTuple):
    """
    The spheres of n links that touch the world, numbered as their contacts with the floor.

    First come the first spheres of all links, then all second ones, and so on: of Aiko the front
    spheres and then the rear ones, eq. (10).
    """

    link: Array  # (m,)
    place: Array  # (m, 3) link center to the center of the sphere, frame B [m]
    radius: Array  # (m,) [m]
    grip: Array  # (m,) factor of friction of the link
    reach: Array  # (n,) how far the spheres of a link reach from its center [m]
    begin: Array  # (n+1,) where the spheres of a link begin in of_link
    of_link: Array  # (m,) numbers of the spheres, link by link
    straight: bool  # whether the centers of all spheres are on the axes e_z of their links


class Capsules(NamedTuple):
    """The capsules of the links, which touch pegs; a sphere is one without length."""

    link: Array  # (c,)
    center: Array  # (c, 3) link center to the middle of the axis, frame B [m]
    axis: Array  # (c, 3) unit vector along the axis, frame B
    half: Array  # (c,) half of the length of the axis [m]
    radius: Array  # (c,) [m]


class Chain(NamedTuple):
    """The geometry and the masses of a robot of n links, in the link frames B."""

    mass: Array  # (n,) [kg]
    inertia: Array  # (n, 3, 3) about the link center [kg m^2]
    places: JointPlaces
    spheres: Spheres
    capsules: Capsules
    axes: Array  # (a, 2) joint and slot of every axis, in the order of their names
    signs: Array  # (a,) 1, or -1 for an axis that turns the other way than in the model
    names: tuple[str, ...]  # of the axes
    frame_place: Array  # (n, 3) link center to the origin of the link's own frame, frame B [m]
    frame: Array  # (n, 3, 3) the link's own frame in B
    frame_turn: Array  # (n, 4) the same as Euler parameters
    link_names: tuple[str, ...]
    center_names: tuple[str, ...]  # of the frames at the centers, in which sensors measure


def chain_of_equal_links(robot: Any) -> Chain:
    """Return the chain of a robot whose links are given by numbers, with two axes a joint."""
    n, names = robot.link_count, tuple(f'link_{i + 1}' for i in range(robot.link_count))
    half, offset = robot.per_link('link_length') / 2, robot.per_link('contact_offset')
    radius, along = robot.per_link('contact_radius'), np.tile([0.0, 0.0, 1.0], (n, 1))
    across, axial = (robot.per_link(f'inertia_{name}') for name in ('transversal', 'axial'))
    still = np.tile([1.0, 0.0, 0.0, 0.0], (n - 1, 1))
    frames = np.tile(np.eye(3), (n - 1, 1, 1))
    joint, slot = np.divmod(np.arange(2 * (n - 1)), 2)
    return Chain(
        mass=robot.per_link('link_mass'),
        inertia=np.array([np.diag(each) for each in np.column_stack([across, across, axial])]),
        places=JointPlaces(
            half[:, None] * along, -half[:, None] * along, True, frames, frames.copy(), still,
            still.copy(), np.ones((n - 1, 2)), True, True,
        ),
        spheres=Spheres(
            link=np.tile(np.arange(n), 2),
            place=np.concatenate([offset[:, None] * along, -offset[:, None] * along]),
            radius=np.tile(radius, 2),
            grip=np.ones(2 * n),
            reach=offset + radius,
            begin=2 * np.arange(n + 1),
            of_link=np.arange(2 * n).reshape(2, n).T.ravel().copy(),
            straight=True,
        ),
        capsules=Capsules(np.arange(n), np.zeros((n, 3)), along, offset, radius),
        axes=np.column_stack([joint, slot]),
        signs=np.ones(2 * (n - 1)),
        names=tuple(f'joint_{j + 1}_{axis}' for j in range(n - 1) for axis in ('yaw', 'pitch')),
        frame_place=np.zeros((n, 3)),
        frame=np.tile(np.eye(3)[[2, 0, 1]].T, (n, 1, 1)),
        frame_turn=np.tile([0.5, -0.5, -0.5, -0.5], (n, 1)),
        link_names=names,
        center_names=names,
    )  # fmt: skip


def chain_of_links(
    links: tuple[Link, ...], joints: tuple[Joint, ...], up: Numbers | None
) -> Chain:
    """
    Return the chain of links and joints that are given one by one.

    Parameters
    ----------
    links : tuple of Link, length n
    joints : tuple of Joint, length n-1
    up : tuple of 3 float, optional
        Direction that is up when the robot lies on a floor, in the frame of the base. Default: z,
        or x if the links are along z.

    """
    n, (origin, turn) = len(links), frames_at_rest(joints)
    carried = [j if joint.backward else j + 1 for j, joint in enumerate(joints)]
    center = origin + np.einsum('ijk,ik->ij', turn, [link.center_of_mass for link in links])
    along = directions_along(center, origin[carried])
    upright = np.abs(along[:, 2]).min() > UPRIGHT
    B = link_frames(along, np.array(up or ((1.0, 0.0, 0.0) if upright else (0.0, 0.0, 1.0))))

    def local(i: int, point: Array) -> Array:
        """Return a point in the frame B of link i."""
        return np.asarray(B[i].T @ (point - center[i]))

    distal, proximal = np.zeros((n, 3)), np.zeros((n, 3))
    inner, outer, present = np.zeros((n - 1, 3, 3)), np.zeros((n - 1, 3, 3)), np.zeros((n - 1, 2))
    axes, signs, axis_names = [], [], []
    for j, (joint, child) in enumerate(zip(joints, carried, strict=True)):
        distal[j], proximal[j + 1] = local(j, origin[child]), local(j + 1, origin[child])
        frame, found = joint_frame(joint, turn[child], B[j])
        inner[j], outer[j] = snapped(B[j].T @ frame), snapped(B[j + 1].T @ frame)
        for name, (slot, sign) in zip(joint.axis_names, found, strict=True):
            present[j, slot] = 1.0
            axes.append((j, slot))
            signs.append(sign)
            axis_names.append(name)
    names = tuple(link.name or f'link_{i + 1}' for i, link in enumerate(links))
    unit = np.eye(3)
    aligned = bool((inner == unit).all() and (outer == unit).all())
    own = np.array([turn[i].T @ B[i] for i in range(n)])
    places = JointPlaces(
        distal, proximal, aligned, inner, outer, euler_parameters(inner), euler_parameters(outer),
        present, bool(present.all()), not (distal[:, :2].any() or proximal[:, :2].any()),
    )  # fmt: skip
    shapes = [
        (i, link.friction, shape.radius, local(i, origin[i] + turn[i] @ shape.start),
         local(i, origin[i] + turn[i] @ (shape.start if shape.end is None else shape.end)))
        for i, link in enumerate(links) for shape in link.shapes
    ]  # fmt: skip
    return Chain(
        mass=np.array([link.mass for link in links]),
        inertia=np.array([
            _symmetric(own[i].T @ link.tensor @ own[i]) for i, link in enumerate(links)
        ]),
        places=places,
        spheres=spheres_of(n, shapes),
        capsules=capsules_of(shapes),
        axes=np.array(axes, dtype=int).reshape(-1, 2),
        signs=np.array(signs),
        names=tuple(axis_names),
        frame_place=np.array([local(i, origin[i]) for i in range(n)]),
        frame=np.array([each.T for each in own]),
        frame_turn=euler_parameters(np.array([each.T for each in own])),
        link_names=names,
        center_names=tuple(name + CENTER for name in names),
    )  # fmt: skip


def base_of(joints: tuple[Joint, ...]) -> int:
    """Return the index of the link from which the joints lead, backward and forward."""
    return sum(joint.backward for joint in joints)


def frames_at_rest(joints: tuple[Joint, ...]) -> tuple[Array, Array]:
    """
    Return the links' own frames in that of the base.

    Parameters
    ----------
    joints : tuple of Joint, length n-1

    Returns
    -------
    origin : ndarray, shape (n, 3)
        [m]
    turn : ndarray, shape (n, 3, 3)

    """
    n, base = len(joints) + 1, base_of(joints)
    origin, turn = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
    ways = [(j + 1, j) for j in reversed(range(base))] + [(j, j + 1) for j in range(base, n - 1)]
    for parent, child in ways:
        joint = joints[min(parent, child)]
        origin[child] = origin[parent] + turn[parent] @ joint.origin
        turn[child] = turn[parent] @ roll_pitch_yaw(joint.rotation)
    return origin, turn


def directions_along(center: Array, joints: Array) -> Array:
    """
    Return the unit vector along every link, from the joint before it to the joint after it.

    The first and the last link, and a link whose joints are at one point, have the direction of a
    neighbor; with two links it is that between center of mass and joint.

    Parameters
    ----------
    center : ndarray, shape (n, 3)
        Centers of mass [m].
    joints : ndarray, shape (n-1, 3)
        [m]

    """
    n = len(center)
    along = np.zeros((n, 3))
    along[1:-1] = np.diff(joints, axis=0)
    known = np.linalg.norm(along, axis=1) > SAME
    if not known.any():
        ends = np.concatenate([center[:1], joints, center[-1:]])
        whole = ends[-1] - ends[0]
        along[:] = whole if np.linalg.norm(whole) > SAME else (1.0, 0.0, 0.0)
        known[:] = True
    places = np.flatnonzero(known)
    nearest = [places[np.abs(places - i).argmin()] for i in range(n)]
    along = along[nearest]
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))


def link_frames(along: Array, up: Array) -> Array:
    """Return the frames B of links along some directions (n, 3), shape (n, 3, 3)."""
    frames = []
    for e_z in along:
        e_y = up - (up @ e_z) * e_z
        if np.linalg.norm(e_y) < 1e-6 * np.linalg.norm(up):
            raise ParameterError(
                f'up must not be along a link, got {up.tolist()} for a link along '
                f'{np.round(e_z, 6).tolist()}'
            )
        e_y = e_y / np.linalg.norm(e_y)
        frames.append(np.column_stack([np.cross(e_y, e_z), e_y, e_z]))
    return np.array(frames)


def joint_frame(joint: Joint, turn: Array, B: Array) -> tuple[Array, list[tuple[int, float]]]:
    """
    Return the frame of a joint, and slot and sign of each of its axes.

    Parameters
    ----------
    joint : Joint
    turn : ndarray, shape (3, 3)
        Frame of the link after the joint, of the one before it if the joint leads backward.
    B : ndarray, shape (3, 3)
        Frame B of the link before it.

    Returns
    -------
    frame : ndarray, shape (3, 3)
        Its e_y is the first axis and its e_x the second one.
    slots : list of tuple
        Slot (0 first, 1 second) and sign of every axis. A single axis is the first one if it is
        upright rather than across the link. An axis that points down or to the right has the sign
        -1: the model turns about the opposite direction, to the left and downward like all others.

    """
    turn = -turn if joint.backward else turn  # the next link turns the other way against this one
    first = turn @ np.array(joint.axis) / np.linalg.norm(joint.axis)
    upright, across = B[:, 1] @ first, B[:, 0] @ first
    if joint.second_axis is not None:
        second = turn @ np.array(joint.second_axis) / np.linalg.norm(joint.second_axis)
        one = -1.0 if upright < -SAME else 1.0
        two = -1.0 if B[:, 0] @ second < -SAME else 1.0
        e_y, e_x = one * first, two * second
        slots = [(0, one), (1, two)]
    elif abs(upright) >= abs(across) and abs(upright) > YAW_SHARE:
        sign = -1.0 if upright < 0.0 else 1.0
        e_y = sign * first
        e_x = across_of(e_y, B[:, 0], B[:, 2])
        slots = [(0, sign)]
    else:
        sign = -1.0 if across < -SAME else 1.0
        e_x = sign * first
        e_y = across_of(e_x, B[:, 1], B[:, 2])
        slots = [(1, sign)]
    return np.column_stack([e_x, e_y, np.cross(e_x, e_y)]), slots


def across_of(axis: Array, wanted: Array, otherwise: Array) -> Array:
    """Return the unit vector at right angles to an axis that is nearest to a wanted one."""
    part = wanted - (wanted @ axis) * axis
    if np.linalg.norm(part) < 1e-3:
        part = otherwise - (otherwise @ axis) * axis
    return np.asarray(part / np.linalg.norm(part))


def spheres_of(n: int, shapes: list[tuple[int, float, float, Array, Array]]) -> Spheres:
    """Return the spheres of links: of a capsule those at its ends."""
    found: list[list[tuple[Any, ...]]] = [[] for _ in range(n)]
    for i, grip, radius, start, end in shapes:
        found[i].append((i, start, radius, grip))
        if (start != end).any():
            found[i].append((i, end, radius, grip))
    rank = [(k, i) for i, each in enumerate(found) for k in range(len(each))]
    number = {place: a for a, place in enumerate(sorted(rank))}
    rows = [found[i][k] for k, i in number]
    counts = [len(each) for each in found]
    return Spheres(
        link=np.array([row[0] for row in rows], dtype=int),
        place=np.array([row[1] for row in rows]).reshape(-1, 3),
        radius=np.array([row[2] for row in rows], dtype=float),
        grip=np.array([row[3] for row in rows], dtype=float),
        reach=np.array(
            [max((np.linalg.norm(row[1]) + row[2] for row in each), default=0.0) for each in found]
        ),
        begin=np.concatenate([[0], np.cumsum(counts)]).astype(int),
        of_link=np.array([number[place] for place in rank], dtype=int),
        straight=not any(row[1][:2].any() for row in rows),
    )


def capsules_of(shapes: list[tuple[int, float, float, Array, Array]]) -> Capsules:
    """Return the capsules of links."""
    rows = []
    for i, _, radius, start, end in shapes:
        length = float(np.linalg.norm(end - start))
        axis = (end - start) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
        rows.append((i, (start + end) / 2, axis, length / 2, radius))
    return Capsules(
        np.array([row[0] for row in rows], dtype=int),
        np.array([row[1] for row in rows]).reshape(-1, 3),
        np.array([row[2] for row in rows]).reshape(-1, 3),
        np.array([row[3] for row in rows], dtype=float),
        np.array([row[4] for row in rows], dtype=float),
    )


# ---- rotations ----------------------------------------------------------------------------------


def roll_pitch_yaw(angles: Numbers) -> Array:
    """Return ``R_z(yaw) R_y(pitch) R_x(roll)``, as URDF has it, shape (3, 3)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in angles)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


def angles_of(R: Array) -> Numbers:
    """Return roll, pitch and yaw of a rotation, at any pitch: inverse of `roll_pitch_yaw`."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    return roll + 0.0, pitch + 0.0, yaw + 0.0  # without -0.0


def euler_parameters(R: Array) -> Array:
    """Return Euler parameters of rotation matrices (k, 3, 3), shape (k, 4), scalar first."""
    from scipy.spatial.transform import Rotation

    if not len(R):
        return np.zeros((0, 4))
    return np.ascontiguousarray(Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]])


def snapped(R: Array) -> Array:
    """Return a rotation without rounding where its entries are 0, 1 and -1 but for that."""
    exact = np.round(R)
    return exact if np.abs(R - exact).max() < SAME else R


def _symmetric(A: Array) -> Array:
    """Return a symmetric matrix without the rounding by which it is not."""
    return 0.5 * (A + A.T)
