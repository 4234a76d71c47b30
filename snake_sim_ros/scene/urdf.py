# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Robots from a URDF: the links and joints of a serial chain, and the limits of its joints.

What fixed joints hold together becomes one link, in the frame of its first part. A frame without
mass and shapes between two joints, whose axes meet at right angles there, makes one joint with two
axes of them.
"""

from collections.abc import Iterable
from dataclasses import replace
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.scene.chain import angles_of, Array, Joint, LARGEST_ANGLE, Link, Mesh, SQUARE
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
    def name(self) -> str:
        """Name of the first part."""
        return cut(self.parts[0][0].name)

    @property
    def is_frame(self) -> bool:
        """Whether it is a frame only, without mass and shapes."""
        return not any(part.mass or part.solids for part, _ in self.parts)


def robot_of_urdf(
    text: str,
    *,
    folder: Path | None = None,
    base: str = '',
    replace_inertia: bool = False,
    name: str = 'robot_description',
) -> FromUrdf:
    """
    Return what a URDF settles of a robot.

    The robot has one limit of angles and one of rates, the largest ones of its joints. Torque
    limits and friction are lists with one number for each joint.

    Parameters
    ----------
    text : str
        The URDF.
    folder : Path, optional
        Folder of its file. Meshes are searched there, those of a package also above it.
    base : str, optional
        Link that begins the chain, in whose frame `Robot.up` is; default: the root. A root that is
        a frame only, without mass and shapes, is left out with the joint after it.
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
        parts, hinges = read(text)
        chain = serial_chain(parts, hinges)
        while len(chain) > 1 and chain[0].is_frame:
            hinge, _ = chain.pop(0).leaving[0]
            remarks.append(
                f'joint {cut(hinge.name)} is left out: link {cut(hinge.parent)} has neither mass '
                f'nor shapes, so that the robot is free'
            )
        if base:
            chain[0] = at_base(chain, base)
        joints = joints_of(chain)
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


def serial_chain(parts: list[Part], hinges: list[Hinge]) -> list[Rigid]:
    """Return the links of a chain from its root on."""
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
    roots = [cut(name) for name in named if name not in before]
    top = [name for name in named if name not in before][:1]
    chain = []
    while top:
        rigid = Rigid([(named[top[0]], np.eye(4))], [])
        for part, pose in rigid.parts:  # which grows
            for hinge in after[part.name]:
                child = pose @ hinge.pose
                if hinge.kind == 'fixed':
                    rigid.parts.append((named[hinge.child], child))
                else:
                    rigid.leaving.append((hinge, child))
        if len(rigid.leaving) > 1:
            raise ParameterError(
                f'must be a chain, got the joints '
                f'{some(cut(hinge.name) for hinge, _ in rigid.leaving)} on link {rigid.name}; '
                f'begin at one end, and make joints beside the chain fixed'
            )
        chain.append(rigid)
        top = [hinge.child for hinge, _ in rigid.leaving]
    if len(roots) != 1 or sum(len(rigid.parts) for rigid in chain) < len(parts):
        raise ParameterError(
            f'joints must connect all links to one root, got '
            f'{f"the roots {some(roots)}" if len(roots) > 1 else "a circle of joints"}'
        )
    return chain


def at_base(chain: list[Rigid], base: str) -> Rigid:
    """Return the first link of a chain in the frame of another one of its parts."""
    parts, leaving = chain[0]
    found = next((k for k, (part, _) in enumerate(parts) if part.name == base), None)
    if found is None:
        known = any(part.name == base for rigid in chain for part, _ in rigid.parts)
        reason = 'is behind a joint: write the chain from there on' if known else 'is no link'
        raise ParameterError(
            f'base must be one of {some(cut(part.name) for part, _ in parts)}; '
            f'{quoted(base)} {reason}'
        )
    back, (_, pose) = np.eye(4), parts[found]
    back[:3, :3] = pose[:3, :3].T
    back[:3, 3] = -back[:3, :3] @ pose[:3, 3]
    parts = [parts[found], *parts[:found], *parts[found + 1 :]]
    return Rigid(
        [(part, back @ pose) for part, pose in parts],
        [(hinge, back @ pose) for hinge, pose in leaving],
    )


def joints_of(chain: list[Rigid]) -> list[tuple[Joint, tuple[Hinge, ...]]]:
    """Return the joints of a chain and their axes; frames between two axes are taken out of it."""
    joints: list[tuple[Joint, tuple[Hinge, ...]]] = []
    while len(joints) < len(chain) - 1:
        k = len(joints)
        (hinge, pose), rigid = turning(chain[k]), chain[k + 1]
        if not (rigid.is_frame and rigid.leaving):
            joints.append((joint_at(pose, hinge, hinge.axis), (hinge,)))
            continue
        second, step = turning(chain.pop(k + 1))
        axis = step[:3, :3].T @ hinge.axis
        norms = float(np.linalg.norm(axis) * np.linalg.norm(second.axis))
        cosine = float(axis @ second.axis) / norms if norms > 0.0 else 1.0
        distance = float(np.linalg.norm(step[:3, 3]))
        if abs(cosine) > SQUARE or distance > TOUCHING:
            angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            raise ParameterError(
                f'link {rigid.name} has neither mass nor shapes: its joints {cut(hinge.name)} and '
                f'{cut(second.name)} must be at one point and at right angles, got a distance of '
                f'{distance:g} m and {angle:.6g} degrees; write angles with all their digits, or '
                f'give the link a mass'
            )
        more = {'second_axis': tuple(second.axis.tolist()), 'second_name': second.name}
        joints.append((joint_at(pose @ step, hinge, axis, **more), (hinge, second)))
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


def joint_at(pose: Array, hinge: Hinge, axis: Array, **more: Any) -> Joint:
    """Return a joint, with the frame (4, 4) of the link after it in that of the one before it."""
    return Joint(
        name=hinge.name,
        origin=tuple(pose[:3, 3].tolist()),
        rotation=angles_of(pose[:3, :3]),
        axis=tuple(axis.tolist()),
        **more,
    )


def limits_of(joints: list[tuple[Joint, tuple[Hinge, ...]]], remarks: list[str]) -> dict[str, Any]:
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
        try:
            return Link(
                name=rigid.parts[0][0].name,
                mass=mass,
                center_of_mass=tuple(center.tolist()),
                inertia=tuple(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()),
                shapes=tuple(shapes),
                meshes=tuple(mesh for mesh in meshes if mesh),
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
                    f'uniform solids with replace_inertia'
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
