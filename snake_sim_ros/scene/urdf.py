# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Robots from a URDF: the links and joints of a serial chain, and the limits of its joints.

What fixed joints hold together becomes one link, in the frame of its first part. A frame without
mass and shapes between two joints, whose axes meet at right angles there, makes one joint with two
axes of them. The root is anywhere in the chain: joints from there toward link 1 lead backward.
"""

from collections.abc import Iterable
from dataclasses import replace
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.scene.chain import (
    angles_of,
    Array,
    CENTER,
    FixedFrame,
    Joint,
    LARGEST_ANGLE,
    Link,
    Mesh,
    SQUARE,
)
from snake_sim_ros.scene.checked_records import cut, LONGEST_PATH, MOST, ParameterError, quoted
from snake_sim_ros.scene.solids import (
    Body,
    capsule,
    joined,
    Meshes,
    path_of,
    reach,
    Solid,
    turned,
    uniform,
)
from snake_sim_ros.scene.urdf_elements import Hinge, Part, read

TOUCHING = 1e-9  # axes that are nearer to each other meet [m]
LIGHT = 1e-5  # of the mass of a neighbor: frames have some where a program wants all to have it
TOO_FAR = 2.0  # times the distance within which the shapes of a link are, that of its mass
DENSEST = 22_600.0  # osmium [kg/m^3]
NAMED = 3  # of many links or joints, that a sentence names


class FromUrdf(NamedTuple):
    """What a URDF settles of a robot."""

    values: dict[str, Any]  # fields of Robot
    remarks: tuple[str, ...]  # what of the URDF the robot does not have


class Rigid(NamedTuple):
    """Parts that fixed joints hold together, in the frame of the first one."""

    parts: list[tuple[Part, Array]]  # with their frames (4, 4)
    leaving: list[tuple[Hinge, Array]]  # joints to other links, with the frames of the children

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parts."""
        return tuple(part.name for part, _ in self.parts)

    @property
    def name(self) -> str:
        """Name of the first part, for messages."""
        return cut(self.parts[0][0].name)

    @property
    def mass(self) -> float:
        """Mass of all parts [kg]."""
        return sum(part.mass for part, _ in self.parts)

    def is_light(self, mass: float) -> bool:
        """Whether it has no shapes, and hardly any mass beside another one [kg]."""
        return self.mass <= LIGHT * mass and not any(part.solids for part, _ in self.parts)

    @property
    def is_frame(self) -> bool:
        """Whether it is a frame only, without mass and shapes."""
        return self.is_light(0.0)


def robot_of_urdf(
    text: str,
    *,
    folder: Path | None = None,
    base: str = '',
    head: str = '',
    replace_inertia: bool = False,
    name: str = 'robot_description',
) -> FromUrdf:
    """
    Return what a URDF settles of a robot.

    The robot has the largest limits of angle and rate of its axes, an axis those in which it
    differs. Torque limits and friction are lists with one number for each joint.

    Parameters
    ----------
    text : str
        The URDF.
    folder : Path, optional
        Folder of its file. Meshes are searched there, those of a package also above it.
    base : str, optional
        Part of the root in whose frame the base and `Robot.up` are; default: the root itself. A
        root that is a frame only, without mass and shapes, is left out with the joint after it.
    head : str, optional
        Link at the end of the chain that comes first; default: what the URDF says in an element
        ``<snake_sim head="..."/>``, else the root if it is at an end, else the link at the end of
        the first of its joints in the file.
    replace_inertia : bool, optional
        Whether inertias that are missing or cannot be are replaced by those of uniform solids with
        the mass and the shapes of the link. Centers of mass stay those of the URDF.
    name : str, optional
        Name of the URDF in error messages.

    Returns
    -------
    FromUrdf
        ``Robot(**found.values)`` is the robot.

    Raises
    ------
    ParameterError
        If there is no such robot; the message says what is wrong with which link or joint.

    """
    remarks: list[str] = []
    try:
        parts, hinges, wanted = read(text)
        root, carried = tree(parts, hinges)
        while root.is_frame and len(root.leaving) == 1:
            ((hinge, _),) = root.leaving
            root = carried.pop(hinge.child)
            remarks.append(
                f'joint {cut(hinge.name)} is left out: link {cut(hinge.parent)} has neither mass '
                f'nor shapes, so that the robot is free'
            )
        if base:
            root = at_base(root, base, parts)
        chain, joints = serial_chain(root, carried, head or wanted, remarks)
        size = sum(float(np.linalg.norm(hinge.pose[:3, 3])) for hinge in hinges)
        bodies = Bodies(Meshes(folder, {}), replace_inertia, size or math.inf, [], [], [], [])
        links = tuple(bodies.link(rigid) for rigid in chain)
        values = {
            'links': links,
            **limits_of(joints, remarks),
        }
    except ParameterError as error:
        raise ParameterError(f'{cut(name, LONGEST_PATH)}: {error}') from None
    if bodies.replaced:
        remarks.append(f'inertia of uniform solids: {some(bodies.replaced)}')
    if bodies.heavy:
        remarks.append(f'masses that no metal has in such a shape: {some(bodies.heavy)}')
    if bodies.unseen:
        remarks.append(f'meshes that are not found, and not shown: {some(bodies.unseen)}')
    if bodies.silent:
        remarks.append(f'shapes that touch nothing: {some(bodies.silent)}')
    elif not any(link.shapes for link in links):
        remarks.append('no link has a shape: the robot touches nothing')
    return FromUrdf(values, tuple(remarks))


def some(texts: Iterable[str]) -> str:
    """Return some of many texts, and how many more there are."""
    listed = list(texts)
    more = f' and {len(listed) - NAMED} more' if len(listed) > NAMED else ''
    return ', '.join(listed[:NAMED]) + more


# ---- the chain ----------------------------------------------------------------------------------


Joints = list[tuple[Joint, tuple[Hinge, ...]]]  # with their axes


def tree(parts: list[Part], hinges: list[Hinge]) -> tuple[Rigid, dict[str, Rigid]]:
    """Return the root of a URDF, and all other links by the names of their first parts."""
    named = {part.name: part for part in parts}
    after: dict[str, list[Hinge]] = {name: [] for name in named}
    before: dict[str, Hinge] = {}
    for hinge in hinges:
        for end in (hinge.parent, hinge.child):
            if end not in named:
                raise ParameterError(f'joint {cut(hinge.name)}: there is no link {quoted(end)}')
        if hinge.child in before:
            raise ParameterError(
                f'link {cut(hinge.child)} must be the child of one joint, got '
                f'{cut(before[hinge.child].name)} and {cut(hinge.name)}'
            )
        before[hinge.child] = hinge
        after[hinge.parent].append(hinge)
    roots = [name for name in named if name not in before]
    tops, found = roots[:1], dict[str, Rigid]()
    for top in tops:  # which grows
        rigid = found[top] = Rigid([(named[top], np.eye(4))], [])
        for part, pose in rigid.parts:  # which grows
            for hinge in after[part.name]:
                child = pose @ hinge.pose
                if hinge.kind == 'fixed':
                    rigid.parts.append((named[hinge.child], child))
                else:
                    rigid.leaving.append((hinge, child))
        tops += [hinge.child for hinge, _ in rigid.leaving]
    if len(roots) != 1 or sum(len(rigid.parts) for rigid in found.values()) < len(parts):
        several = f'the roots {some(map(cut, roots))}'
        raise ParameterError(
            f'joints must connect all links to one root, got '
            f'{several if len(roots) > 1 else "a circle of joints"}'
        )
    return found.pop(roots[0]), found


def at_base(root: Rigid, base: str, parts: list[Part]) -> Rigid:
    """Return the root in the frame of another one of its parts."""
    if base not in root.names:
        known = any(part.name == base for part in parts)
        reason = 'is behind a joint; head names the link at the end that comes first'
        raise ParameterError(
            f'base must be one of {some(map(cut, root.names))}; '
            f'{quoted(base)} {reason if known else "is no link"}'
        )
    found = root.names.index(base)
    back = inverse(root.parts[found][1])
    ordered = [root.parts[found], *root.parts[:found], *root.parts[found + 1 :]]
    return Rigid(
        [(part, back @ pose) for part, pose in ordered],
        [(hinge, back @ pose) for hinge, pose in root.leaving],
    )


def serial_chain(
    root: Rigid, carried: dict[str, Rigid], head: str, remarks: list[str]
) -> tuple[list[Rigid], Joints]:
    """
    Return the links of a chain in order, and its joints.

    Parameters
    ----------
    root : Rigid
    carried : dict
        All other links by the names of their first parts.
    head : str
        Part of the link at the end that comes first; '' for the default, see `robot_of_urdf`.
    remarks : list of str
        Gets one if the root is between both ends and nothing says which of them comes first.

    """
    if root.is_frame and len(root.leaving) == 2:
        root = beside(root, carried)
    refuse_branches(root, [hinge for hinge, _ in root.leaving])
    sides = [side_of(root, place, carried) for place in root.leaving]
    is_between = len(sides) == 2
    while len(sides) < 2:
        sides.insert(0, [root])
    ends = [side[-1] for side in sides]
    if head and not any(head in end.names for end in ends):
        raise ParameterError(
            f'head must be a link at an end of the chain, such as {ends[0].name} or '
            f'{ends[1].name}, got {quoted(head)}'
        )
    if is_between and not head:
        remarks.append(
            f'link {ends[0].name} is the first one, as the root is between both ends; '
            f'head: {ends[1].name} turns the order round'
        )
    before, after = sides if not head or head in ends[0].names else sides[::-1]
    joints = [*reversed(joints_of(before, backward=True)), *joints_of(after, backward=False)]
    return [*before[:0:-1], root, *after[1:]], joints


def beside(root: Rigid, carried: dict[str, Rigid]) -> Rigid:
    """Return the first link on a root that is a frame between two joints, as root instead."""
    (hinge, at), (other, pose) = root.leaving
    part, link = root.parts[0][0], carried.pop(hinge.child)
    # The frame coincides with that of the link, against which it turns the other way.
    carried[part.name] = Rigid([(part, np.eye(4))], [(other, inverse(at) @ pose)])
    turned = hinge._replace(child=part.name, axis=-hinge.axis)
    return Rigid(link.parts, [*link.leaving, (turned, np.eye(4))])


def side_of(root: Rigid, place: tuple[Hinge, Array], carried: dict[str, Rigid]) -> list[Rigid]:
    """Return the links from the root, with one of its joints alone, to the end beyond it."""
    side = [Rigid(root.parts, [place])]
    while side[-1].leaving:
        ((hinge, _),) = side[-1].leaving
        side.append(carried[hinge.child])
        refuse_branches(side[-1], [hinge, *(after for after, _ in side[-1].leaving)])
    return side


def refuse_branches(rigid: Rigid, hinges: list[Hinge]) -> None:
    """Raise an error if a link has more than two joints."""
    if len(hinges) > 2:
        raise ParameterError(
            f'must be a chain, with at most two moving joints on a link, got '
            f'{some(cut(hinge.name) for hinge in hinges)} on link {rigid.name}; make joints '
            f'beside the chain fixed'
        )


def joints_of(side: list[Rigid], *, backward: bool) -> Joints:
    """Return the joints from the root to an end; frames between two axes are taken out of it."""
    joints: Joints = []
    while len(joints) < len(side) - 1:
        k = len(joints)
        (hinge, pose), rigid = turning(side[k]), side[k + 1]
        if rigid.leaving and rigid.is_light(max(side[k].mass, side[k + 2].mass)):
            second, step = turning(rigid)
            axis = step[:3, :3].T @ hinge.axis
            norms = float(np.linalg.norm(axis) * np.linalg.norm(second.axis))
            cosine = float(axis @ second.axis) / norms if norms > 0.0 else 1.0
            distance = float(np.linalg.norm(step[:3, 3]))
            if abs(cosine) <= SQUARE and distance <= TOUCHING:
                axes = [(hinge, axis), (second, second.axis)]
                ordered = axes[::-1] if backward else axes
                joints.append(joint_at(pose @ step, ordered, backward=backward))
                del side[k + 1]
                continue
            if rigid.is_frame:
                angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
                raise ParameterError(
                    f'link {rigid.name} has neither mass nor shapes: its joints {cut(hinge.name)} '
                    f'and {cut(second.name)} must be at one point and at right angles, got a '
                    f'distance of {distance:g} m and {angle:.6g} degrees; write angles with all '
                    f'their digits, or give the link a mass'
                )
        joints.append(joint_at(pose, [(hinge, hinge.axis)], backward=backward))
    return joints


def turning(rigid: Rigid) -> tuple[Hinge, Array]:
    """Return the joint after a link, which must turn."""
    ((hinge, pose),) = rigid.leaving
    if hinge.kind not in ('revolute', 'continuous'):
        raise ParameterError(
            f'joint {cut(hinge.name)} must be revolute, continuous or fixed, got '
            f'{quoted(hinge.kind)}'
        )
    if hinge.leader is not None:
        raise ParameterError(
            f'joint {cut(hinge.name)} must turn by itself, got <mimic> of {quoted(hinge.leader)}; '
            f'remove it, or make the joint fixed'
        )
    return hinge, pose


def joint_at(
    pose: Array, axes: list[tuple[Hinge, Array]], *, backward: bool
) -> tuple[Joint, tuple[Hinge, ...]]:
    """Return a joint and its axes, with the frame (4, 4) of its child in that of its parent."""
    (hinge, axis), *others = axes
    more: dict[str, Any] = {}
    if others:
        ((second, direction),) = others
        more = {'second_axis': tuple(direction.tolist()), 'second_name': second.name}
    made = Joint(
        name=hinge.name,
        origin=tuple(pose[:3, 3].tolist()),
        rotation=angles_of(pose[:3, :3]),
        axis=tuple(axis.tolist()),
        backward=backward,
        **more,
    )
    return made, tuple(hinge for hinge, _ in axes)


def inverse(pose: Array) -> Array:
    """Return the inverse of a frame (4, 4)."""
    back = np.eye(4)
    back[:3, :3] = pose[:3, :3].T
    back[:3, 3] = -back[:3, :3] @ pose[:3, 3]
    return back


def limits_of(joints: Joints, remarks: list[str]) -> dict[str, Any]:
    """
    Return the joints of a robot with the limits of their axes, and the friction of these.

    The robot has the largest limits of all its axes, an axis those in which it differs.
    """
    hinges = [hinge for _, axes in joints for hinge in axes]
    if not hinges:
        return {'joints': ()}
    limit = min(max(abs(angle) for hinge in hinges for angle in hinge.range), LARGEST_ANGLE)
    rate = max(hinge.rate for hinge in hinges)
    values: dict[str, Any] = {
        'joints': tuple(limited(joint, axes, limit, rate) for joint, axes in joints),
        'joint_limit': limit,
    }
    if rate:
        values['joint_rate_limit'] = rate
    if any(hinge.effort for hinge in hinges):
        for name, axis in (('yaw', 0), ('pitch', -1)):
            values[f'{name}_torque_limit'] = tuple(axes[axis].effort or MOST for _, axes in joints)
    values['joint_friction'] = tuple(hinge.friction for hinge in hinges)
    values['joint_viscous_friction'] = tuple(hinge.damping for hinge in hinges)
    wider = [hinge for hinge in hinges if max(map(abs, hinge.range)) > LARGEST_ANGLE]
    if wider:
        found = some(
            f'{each.range[0]:g} to {each.range[1]:g} of {cut(each.name)}' for each in wider
        )
        remarks.append(f'joints turn by up to {LARGEST_ANGLE:g} rad to a side, not {found}')
    return values


def limited(joint: Joint, axes: tuple[Hinge, ...], limit: float, rate: float) -> Joint:
    """Return a joint with limits of its axes where they are not those of the robot."""
    low = [max(axis.range[0], -limit) for axis in axes]
    high = [min(axis.range[1], limit) for axis in axes]
    rates = [axis.rate or rate for axis in axes]
    for axis, least, most in zip(axes, low, high, strict=True):
        if not least < most:
            raise ParameterError(
                f'joint {cut(axis.name)} must turn within +-{LARGEST_ANGLE:g} rad, got angles of '
                f'{axis.range[0]:g} to {axis.range[1]:g} rad'
            )
    own = (('lower', low, -limit), ('upper', high, limit), ('rate', rates, rate))
    differing: dict[str, Any] = {
        name: tuple(each) for name, each, default in own if {*each} != {default}
    }
    return replace(joint, **differing)


# ---- masses and shapes --------------------------------------------------------------------------


class Bodies(NamedTuple):
    """How links get the masses and the shapes of their parts."""

    meshes: Meshes
    replace: bool  # whether inertias that cannot be are replaced
    size: float  # of the robot [m]
    replaced: list[str]  # parts of which that was done
    heavy: list[str]  # masses that cannot be in their shapes
    silent: list[str]  # shapes that touch nothing
    unseen: list[str]  # meshes that are not found

    def link(self, rigid: Rigid) -> Link:
        """Return a link of the robot."""
        mass, center, inertia = joined([self.body(part, pose) for part, pose in rigid.parts])
        if not mass:
            raise ParameterError(
                f'link {rigid.name} must have a mass above 0, got none; give it an <inertial>, or '
                f'make a joint of it fixed'
            )
        shapes, touches = [], any(part.touches for part, _ in rigid.parts)
        for part, pose in rigid.parts:
            if part.touches or not touches:
                solids, missing = self.known(part)
                shapes += [capsule(solid, pose) for solid in solids]
                self.silent.extend(f'of link {rigid.name} {reason}' for reason in missing)
        meshes = [self.seen(mesh, pose) for part, pose in rigid.parts for mesh in part.meshes]
        name = rigid.names[0]
        frames = [
            FixedFrame(
                name=part.name,
                origin=tuple(pose[:3, 3].tolist()),
                rotation=angles_of(pose[:3, :3]),
            )
            for part, pose in rigid.parts[1:] if part.name != name + CENTER
        ]  # fmt: skip
        try:
            return Link(
                name=name,
                mass=mass,
                center_of_mass=tuple(center.tolist()),
                inertia=tuple(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()),
                shapes=tuple(shapes),
                meshes=tuple(mesh for mesh in meshes if mesh),
                frames=tuple(frames),
            )
        except ParameterError as error:
            raise ParameterError(f'link {rigid.name}: {error}') from None

    def body(self, part: Part, pose: Array) -> Body:
        """Return a part with its frame in that of its link as a body there."""
        at, inertia = pose @ part.pose, part.inertia
        center = at[:3, 3]
        if not part.mass and (inertia is None or not inertia.any() or self.replace):
            return 0.0, center, np.zeros((3, 3))
        solids, missing = self.known(part)
        within, (volume, _, moments) = self.size, joined([uniform(solid) for solid in solids])
        if solids and not missing:
            within = max(reach(solid, part.pose[:3, 3]) for solid in solids)
            if part.mass > DENSEST * volume:
                self.heavy.append(f'{part.mass:g} kg of {cut(part.name)}')
        if flaw := flaw_of(part.mass, inertia, within):
            if not self.replace:
                raise ParameterError(
                    f'inertia of link {cut(part.name)} {flaw}; correct it, or take that of '
                    f'uniform solids with replace_inertia: true beside urdf'
                )
            if missing or not volume:
                raise ParameterError(
                    f'link {cut(part.name)} must have shapes for an inertia of uniform solids, '
                    f'got {", ".join(missing[:1]) or "none with a volume"}'
                )
            self.replaced.append(cut(part.name))
            return part.mass, center, turned(pose, part.mass / volume * moments)
        return part.mass, center, turned(at, np.asarray(inertia))

    def seen(self, mesh: Solid, pose: Array) -> Mesh | None:
        """Return a mesh of a part with its frame in that of its link; None if it is not found."""
        path, at = path_of(mesh.file, self.meshes.folder), pose @ mesh.pose
        if path is None:
            if (name := cut(mesh.file, LONGEST_PATH)) not in self.unseen:
                self.unseen.append(name)
            return None
        return Mesh(
            file=str(path.resolve()),
            origin=tuple(at[:3, 3].tolist()),
            rotation=angles_of(at[:3, :3]),
            scale=mesh.size,
        )

    def known(self, part: Part) -> tuple[list[Solid], list[str]]:
        """Return the solids of a part, boxes for meshes, and what is not known of others."""
        solids, missing = [], []
        for solid in part.solids:
            try:
                solids.append(self.meshes.box(solid) if solid.file else solid)
            except ParameterError as error:
                missing.append(str(error))
        return solids, missing


def flaw_of(mass: float, inertia: Array | None, within: float) -> str:
    """Return why nothing with a mass within a distance of its center has an inertia, or ''."""
    if inertia is None:
        return 'is missing'
    least, middle, most = np.linalg.eigvalsh(inertia).tolist()
    moments = f'got principal moments of {least:.4g}, {middle:.4g}, {most:.4g} kg m^2'
    if not mass:
        return f'must be 0 without a mass, {moments}'
    if least < 1e-18 or most > (least + middle) * (1.0 + 1e-6):
        return f'must have principal moments above 0, each at most the sum of others, {moments}'
    if most > mass * (TOO_FAR * within) ** 2:
        return f'is too large for {mass:g} kg within {within:.3g} m of its center, {moments}'
    return ''
