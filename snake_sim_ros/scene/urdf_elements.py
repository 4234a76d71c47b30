# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Links and joints of a URDF as it has them; whatever is missing or no number becomes one sentence.

Read with xml.etree: yourdfpy 0.0.60 repairs a file that ends too early and takes a mass without
value for 0, urdf_parser_py is on PyPI as a source of 2021, and trimesh writes URDF only.
"""

from collections import Counter
import math
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from snake_sim_ros.scene.chain import Array, roll_pitch_yaw
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, MOST, ParameterError, quoted
from snake_sim_ros.scene.files import MOST_CHARACTERS
from snake_sim_ros.scene.gait import Numbers
from snake_sim_ros.scene.solids import SIZES, Solid

Element = ElementTree.Element

LEAST = {'': -MOST, ' above 0': math.ulp(0.0), ' of at least 0': 0.0}
EXTENSION = 'snake_sim'  # element of a robot with what a URDF cannot say
MOMENTS = ('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz')


class Part(NamedTuple):
    """A link of a URDF."""

    name: str
    mass: float  # 0 without one [kg]
    pose: Array  # (4, 4) center of mass, and axes of the inertia
    inertia: Array | None  # (3, 3) [kg m^2]
    solids: tuple[Solid, ...]  # with what it touches or, without those, as what it is seen
    touches: bool  # whether it is the former
    meshes: tuple[Solid, ...]  # as which it is seen


class Hinge(NamedTuple):
    """A joint of a URDF."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Array  # (4, 4) frame of the child in that of the parent, at an angle of 0
    axis: Array  # (3,) in the frame of the child
    range: Numbers  # least and largest angle [rad]
    rate: float  # largest one, 0 if there is none [rad/s]
    effort: float  # largest one, 0 if there is none [N m]
    friction: float  # [N m]
    damping: float  # [N m s/rad]
    leader: str | None  # joint that it follows


def read(text: str) -> tuple[list[Part], list[Hinge], str]:
    """Return the links and the joints of a URDF, and the link that it names as head."""
    if len(text) > MOST_CHARACTERS:
        raise ParameterError(f'must have at most {MOST_CHARACTERS} characters, got {len(text)}')
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ParameterError(f'not readable as XML: {cut(str(error), LONGEST_REASON)}') from None
    if root.tag != 'robot':
        raise ParameterError(f'must be a URDF, <robot>, got <{cut(root.tag)}>')
    if any('xacro' in each.tag for each in root.iter()):
        raise ParameterError('must be a URDF, got xacro: the command xacro makes a URDF of it')
    parts = [part_of(each) for each in root.findall('link')]
    hinges = [hinge_of(each) for each in root.findall('joint')]
    if not parts:
        raise ParameterError('must have links, got none')
    for kind, named in (('links', parts), ('joints', hinges)):
        for name, count in Counter(each.name for each in named).most_common(1):
            if count > 1:
                raise ParameterError(
                    f'{kind} must differ in name, got {quoted(name)} {count} times'
                )
    return parts, hinges, child(root, EXTENSION).get('head', '')


def part_of(element: Element) -> Part:
    """Return a link of a URDF."""
    name = text_of(element, 'name', 'a <link>')
    owner, mass, pose, inertia = f'link {cut(name)}', 0.0, np.eye(4), None
    inertial = element.find('inertial')
    if inertial is not None:
        pose = pose_of(inertial, owner)
        (mass,) = numbers(child(inertial, 'mass'), 'value', owner, bound=' of at least 0')
        moments = inertial.find('inertia')
        if moments is not None:
            inertia = np.zeros((3, 3))
            for key in MOMENTS:
                i, j = ('xyz'.index(axis) for axis in key[1:])
                default = None if i == j else [0.0]
                inertia[i, j] = inertia[j, i] = numbers(moments, key, owner, default=default)[0]
    shapes = element.findall('collision')
    solids = tuple(solid_of(each, owner) for each in shapes or element.findall('visual'))
    seen = [each for each in element.findall('visual') if each.find('geometry/mesh') is not None]
    meshes = tuple(solid_of(each, owner) for each in seen)
    return Part(name, mass, pose, inertia, solids, bool(shapes), meshes)


def solid_of(element: Element, owner: str) -> Solid:
    """Return a shape of a link of a URDF."""
    shapes = element.findall('geometry/*')
    if len(shapes) != 1 or shapes[0].tag not in SIZES:
        raise ParameterError(
            f'<geometry> of {owner} must be one of {", ".join(SIZES)}, got '
            f'{", ".join(cut(each.tag) for each in shapes) or "none"}'
        )
    (shape,), kind, pose = shapes, shapes[0].tag, pose_of(element, owner)
    if kind == 'mesh':
        file = text_of(shape, 'filename', f'<mesh> of {owner}')
        return Solid(kind, tuple(numbers(shape, 'scale', owner, 3, default=[1.0] * 3)), pose, file)
    found = SIZES[kind].items()
    size = [x for key, n in found for x in numbers(shape, key, owner, n, bound=' above 0')]
    return Solid(kind, tuple(size), pose)


def hinge_of(element: Element) -> Hinge:
    """Return a joint of a URDF."""
    name = text_of(element, 'name', 'a <joint>')
    owner = f'joint {cut(name)}'
    kind = text_of(element, 'type', owner)
    limit, dynamics, mimic = child(element, 'limit'), child(element, 'dynamics'), 'mimic'
    low, high = -math.inf, math.inf
    if kind == 'revolute' and limit.attrib:
        (low,), (high,) = (numbers(limit, key, owner, default=[0.0]) for key in ('lower', 'upper'))
        if not low < high:
            raise ParameterError(
                f'lower of <limit> of {owner} must be below upper, got {low:g} and {high:g} rad; '
                f'a joint that does not turn is fixed'
            )
    (rate,), (effort,), (friction,), (damping,) = (
        numbers(found, key, owner, default=[0.0], bound=' of at least 0')
        for found, key in (
            (limit, 'velocity'), (limit, 'effort'), (dynamics, 'friction'), (dynamics, 'damping')
        )
    )  # fmt: skip
    return Hinge(
        name=name,
        kind=kind,
        parent=text_of(child(element, 'parent'), 'link', f'<parent> of {owner}'),
        child=text_of(child(element, 'child'), 'link', f'<child> of {owner}'),
        pose=pose_of(element, owner),
        axis=np.array(numbers(child(element, 'axis'), 'xyz', owner, 3, default=[1.0, 0.0, 0.0])),
        range=(low, high),
        rate=rate,
        effort=effort,
        friction=friction,
        damping=damping,
        leader=None if element.find(mimic) is None else child(element, mimic).get('joint', ''),
    )


def pose_of(element: Element, owner: str) -> Array:
    """Return the frame that is the origin of an element, shape (4, 4)."""
    origin, pose = child(element, 'origin'), np.eye(4)
    pose[:3, 3], angles = (
        numbers(origin, key, owner, 3, default=[0.0] * 3) for key in ('xyz', 'rpy')
    )
    pose[:3, :3] = roll_pitch_yaw(tuple(angles))
    return pose


def child(element: Element, tag: str) -> Element:
    """Return the first child with a tag; one without attributes if there is none."""
    found = element.find(tag)
    return Element(tag) if found is None else found


def text_of(element: Element, key: str, owner: str) -> str:
    """Return an attribute that an element must have."""
    found = element.get(key, '')
    if not found:
        raise ParameterError(f'{owner} must have a {key}, got none')
    return found


def numbers(
    element: Element,
    key: str,
    owner: str,
    count: int = 1,
    *,
    default: list[float] | None = None,
    bound: str = '',
) -> list[float]:
    """Return the numbers of an attribute of an element, which belongs to a link or a joint."""
    text = element.get(key)
    if text is None and default is not None:
        return default
    try:
        found = [float(each) for each in (text or '').split()]
    except ValueError:
        found = []
    if len(found) == count and all(LEAST[bound] <= each <= MOST for each in found):
        return found
    wanted = 'a number' if count == 1 else f'{count} numbers'
    got = 'none' if text is None else quoted(text)
    raise ParameterError(f'{key} of <{element.tag}> of {owner} must be {wanted}{bound}, got {got}')
