# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The robot as a URDF, for viewers and for programs that compute its kinematics or its masses.

The tree begins at `base_link`, the middle link turned around, so that x is forward, toward link 1
(REP 103). Frames of `link_i` are those of the messages: at the center, x along the link toward the
next one, y to the left and z up when the link lies flat. Joint coordinates are those of the model:
the next link is turned against a link by ``R_z(yaw) R_y(pitch)``. Between link 1 and the base the
tree runs backward: there pitch comes first, and both axes are turned around.

In a URDF a link has its frame at its joint. A link therefore hangs on a frame `link_i_end`, at the
joint that leads to it. Between the two axes of a joint is `cross_i`, which has a mass only because
parsers require one.

Stiffness and damping belong to the controller and are not part of the URDF.
"""

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from snake_sim_ros.scene.chain import angles_of, FixedFrame, Shape
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, MOST, ParameterError
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.scene.urdf import robot_of_urdf
from snake_sim_ros.scene.urdf_elements import EXTENSION

# Mass and moments of inertia of a cross, relative to those of the link that hangs on it. Parsers
# accept moments above 1e-14 kg m^2, which those of 200 links of 7 mm still exceed.
ROBOT_NAME = 'snake_robot'
CROSS = np.array([1e-6, 1e-5, 1e-5, 1e-5])
COLORS = {
    'head': (0.80, 0.25, 0.10, 1.0),
    'odd': (0.93, 0.69, 0.13, 1.0),
    'even': (0.25, 0.27, 0.30, 1.0),
}
AXES = {'yaw': np.array([0, 0, 1]), 'pitch': np.array([0, 1, 0])}
TO_WIRE_FRAME = np.eye(3)[[2, 0, 1]].T  # columns e_z, e_x, e_y of a frame B
ALONG_X = (0.0, math.pi / 2, 0.0)  # roll, pitch and yaw of a cylinder, which is along z


def robot_description(robot: Robot) -> str:
    """
    Return a robot as a URDF.

    Joints are limited to the angles and rates that references may have. The effort is the torque
    limit of the robot or, without one, the largest torque of the controller within these limits,
    when reference and joint are at opposite limits. Friction of a joint is its dynamics.
    """
    root = ElementTree.Element('robot', name=ROBOT_NAME)
    for name, color in COLORS.items():
        element(element(root, 'material', name=name), 'color', rgba=color)
    if robot.links:
        _add_chain(root, robot)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding='unicode')
    middle, half = robot.middle_link, robot.per_link('link_length') / 2
    element(root, 'link', name='base_link')
    for i in range(robot.link_count):
        _add_link(root, robot, i)
    base = _join(root, 'base', 'base_link', f'link_{middle + 1}', 0.0)
    element(base, 'origin', xyz=(0, 0, 0), rpy=(0.0, 0.0, math.pi))
    for j in range(robot.link_count - 1):
        parent, child, sign = (j, j + 1, 1) if j >= middle else (j + 1, j, -1)
        cross, end = f'cross_{j + 1}', f'link_{child + 1}_end'
        _add_inertia(element(root, 'link', name=cross), CROSS * _inertia(robot, child))
        element(root, 'link', name=end)
        first, second = list(AXES)[::sign]
        for axis, inner, outer, x in (
            (first, f'link_{parent + 1}', cross, sign * half[parent]),
            (second, cross, end, 0.0),
        ):
            joint = _join(root, f'joint_{j + 1}_{axis}', inner, outer, x, 'revolute')
            element(joint, 'axis', xyz=sign * AXES[axis])
            element(joint, 'limit', **_limits(robot, j, axis))
            _add_dynamics(joint, robot, j, list(AXES).index(axis))
        _join(root, end, end, f'link_{child + 1}', sign * half[child])
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode')


def _add_chain(root: ElementTree.Element, robot: Robot) -> None:
    """
    Append links and joints that are given one by one, in their own frames, from the base on.

    Each link carries its further frames, and one at its center of mass, in which sensors measure.
    A joint with two axes has a `cross` between both, as those of Aiko have. If the base is not
    link 1, `snake_sim` says which end of the chain is the first.
    """
    chain = robot.chain
    if robot.base_link:
        element(root, EXTENSION, head=robot.link_names[0])
    for i, (item, name) in enumerate(zip(robot.links, robot.link_names, strict=True)):
        link = element(root, 'link', name=name)
        inertial = element(link, 'inertial')
        element(inertial, 'origin', xyz=item.center_of_mass)
        element(inertial, 'mass', value=item.mass)
        moments = zip(('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz'), item.inertia, strict=True)
        element(inertial, 'inertia', **dict(moments))
        for shape in item.shapes:
            _add_capsule(link, '' if item.meshes else color_name(i), shape)
        for mesh in item.meshes:
            part = element(link, 'visual')
            element(part, 'origin', xyz=mesh.origin, rpy=mesh.rotation)
            file = Path(mesh.file).absolute().as_uri()
            element(element(part, 'geometry'), 'mesh', filename=file, scale=mesh.scale)
        turn = angles_of(chain.frame[i].T @ TO_WIRE_FRAME)
        center = FixedFrame(name=chain.center_names[i], origin=item.center_of_mass, rotation=turn)
        for frame in (center, *item.frames):
            element(root, 'link', name=frame.name)
            fixed = _join(root, f'{frame.name}_fixed', name, frame.name, 0.0)
            element(fixed, 'origin', xyz=frame.origin, rpy=frame.rotation)
    for j, hinge in enumerate(robot.joints):
        places = [(k, slot) for k, (at, slot) in enumerate(chain.axes.tolist()) if at == j]
        axes = [axis for axis in (hinge.axis, hinge.second_axis) if axis is not None]
        way = -1 if hinge.backward else 1
        parent, child = robot.link_names[j : j + 2][::way]
        for m, ((k, slot), axis) in enumerate([*zip(places, axes, strict=True)][::way]):
            here = child if m == len(places) - 1 else f'{chain.names[k]}_cross'
            joint = _join(root, chain.names[k], parent, here, 0.0, 'revolute')
            if m == 0:
                element(joint, 'origin', xyz=hinge.origin, rpy=hinge.rotation)
            element(joint, 'axis', xyz=np.array(axis) / np.linalg.norm(axis))
            element(joint, 'limit', **_limits(robot, j, list(AXES)[slot]))
            _add_dynamics(joint, robot, j, slot)
            if here != child:
                _add_inertia(element(root, 'link', name=here), CROSS * robot.links[j + 1].mass)
            parent = here


def _add_dynamics(joint: ElementTree.Element, robot: Robot, j: int, slot: int) -> None:
    """Append the friction of an axis of joint j, if it has any."""
    friction, viscous = (
        float(robot.per_joint(name)[j, slot]) for name in ('friction', 'viscous_friction')
    )
    if friction > 0.0 or viscous > 0.0:
        element(joint, 'dynamics', damping=viscous, friction=friction)


def _add_capsule(link: ElementTree.Element, color: str, shape: Shape) -> None:
    """Append a sphere, or a capsule as two spheres and a cylinder; seen if it has a color."""
    start = np.array(shape.start)
    end = start if shape.end is None else np.array(shape.end)
    length = float(np.linalg.norm(end - start))
    for place in (start, end) if length else (start,):
        for kind in ('visual', 'collision') if color else ('collision',):
            part = element(link, kind)
            element(part, 'origin', xyz=place)
            if kind == 'visual':
                element(part, 'material', name=color)
            element(element(part, 'geometry'), 'sphere', radius=shape.radius)
    if length and color:
        x, y, z = (end - start) / length
        rpy = (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x))
        part = element(link, 'visual')
        element(part, 'origin', xyz=(start + end) / 2, rpy=rpy)
        element(part, 'material', name=color)
        element(element(part, 'geometry'), 'cylinder', radius=shape.radius, length=length)


def robot_of(urdf: str) -> Robot:
    """
    Return the robot that a URDF describes; gains are the defaults.

    It is one of `robot_description`, or of any chain; see `urdf.robot_of_urdf`.

    Raises
    ------
    ParameterError
        If it is neither.

    """
    try:
        root = ElementTree.fromstring(urdf)
        links = {link.get('name', ''): link for link in root.iter('link')}
        joints = {joint.get('name', ''): joint for joint in root.iter('joint')}
        if 'base' not in joints and not {'link_1_end', 'link_2_end'} & {*links}:
            found = robot_of_urdf(urdf, replace_inertia=True)
            return Robot(**found.values)
        n = sum(name.startswith('link_') and not name.endswith('_end') for name in links)
        limit = _child(joints['joint_1_yaw'], 'limit')
        limits = {name: float(limit[name]) for name in ('upper', 'velocity')}
        rows = [_robot_link(links[f'link_{i + 1}'], joints) for i in range(n)]
    except (ElementTree.ParseError, KeyError, ValueError) as error:
        raise ParameterError(
            f'robot_description must be a URDF as snake-sim urdf prints it, with links link_1, '
            f'link_2, ... in a chain; {type(error).__name__}: {cut(str(error), LONGEST_REASON)}'
        ) from None
    columns = {name: tuple(row[name] for row in rows) for name in rows[0]}
    values: dict[str, Any] = {
        name: column[0] if len(set(column)) == 1 else column for name, column in columns.items()
    }
    upper, rate = limits['upper'], limits['velocity']
    return Robot(link_count=n, joint_limit=upper, joint_rate_limit=rate, **values)


def _robot_link(
    link: ElementTree.Element, joints: dict[str, ElementTree.Element]
) -> dict[str, float]:
    """Return the entries of one link in the lists of a robot."""
    name = link.get('name', '')
    # The joint that the link hangs on; the middle link hangs on none but carries two.
    on_it = [item for item in joints.values() if _child(item, 'parent')['link'] == name]
    joint = joints.get(f'{name}_end', on_it[0] if on_it else None)
    if joint is None:
        raise KeyError(f'a joint of {name}')
    spheres = [shape for shape in link.iter('visual') if shape.find('geometry/sphere') is not None]
    radii = [float(_child(shape, 'geometry/sphere')['radius']) for shape in spheres]
    inertia = _child(link, 'inertial/inertia')
    return {
        'link_length': 2 * abs(_x(joint)),
        'link_mass': float(_child(link, 'inertial/mass')['value']),
        'inertia_axial': float(inertia['ixx']),
        'inertia_transversal': float(inertia['iyy']),
        'contact_radius': max(radii, default=0.0),
        'contact_offset': max((_x(shape) for shape in spheres), default=0.0),
    }


def _x(part: ElementTree.Element) -> float:
    """Return x of the origin of a part [m]."""
    numbers = _child(part, 'origin')['xyz'].split()
    if len(numbers) != 3:
        raise ValueError(
            f'xyz of an origin must be three numbers, got {" ".join(numbers) or "nothing"}'
        )
    return float(numbers[0])


def _child(parent: ElementTree.Element, path: str) -> dict[str, str]:
    """Return the attributes of the element at a path."""
    found = parent.find(path)
    if found is None:
        raise KeyError(f'{path} of {parent.get("name", parent.tag)}')
    return found.attrib


def color_name(link: int) -> str:
    """Return the name in COLORS of the color of a link."""
    return 'head' if link == 0 else ('odd', 'even')[link % 2]


def _add_link(root: ElementTree.Element, robot: Robot, i: int) -> None:
    """Append link i; it looks like a capsule and touches with the spheres at its ends."""
    link = element(root, 'link', name=f'link_{i + 1}')
    _add_inertia(link, _inertia(robot, i))
    radius, offset = robot.per_link('contact_radius')[i], robot.per_link('contact_offset')[i]
    if not radius:
        return
    color = color_name(i)
    for x in (offset, -offset) if offset else (0.0,):
        for kind in ('visual', 'collision'):
            element(_add_shape(link, kind, color, x), 'sphere', radius=radius)
    if offset:
        geometry = _add_shape(link, 'visual', color, 0.0)
        element(geometry, 'cylinder', radius=radius, length=2 * offset)


def _add_shape(link: ElementTree.Element, kind: str, color: str, x: float) -> ElementTree.Element:
    """Append a visual or collision element along x of a link; return its geometry."""
    shape = element(link, kind)
    element(shape, 'origin', xyz=(x, 0, 0), rpy=ALONG_X)
    if kind == 'visual':
        element(shape, 'material', name=color)
    return element(shape, 'geometry')


def _inertia(robot: Robot, i: int) -> Array:
    """Return mass [kg] and moments of inertia about x, y, z [kg m^2] of link i, shape (4,)."""
    names = 'link_mass', 'inertia_axial', 'inertia_transversal', 'inertia_transversal'
    return np.array([robot.per_link(name)[i] for name in names])


def _add_inertia(link: ElementTree.Element, inertia: Array) -> None:
    """Append mass and moments of inertia to a link, as `_inertia` returns them."""
    mass, ixx, iyy, izz = inertia
    inertial = element(link, 'inertial')
    element(inertial, 'mass', value=mass)
    element(inertial, 'inertia', ixx=ixx, iyy=iyy, izz=izz, ixy=0, ixz=0, iyz=0)


def _join(
    root: ElementTree.Element, name: str, parent: str, child: str, x: float, kind: str = 'fixed'
) -> ElementTree.Element:
    """Append a joint whose frame is at x of the parent [m]."""
    joint = element(root, 'joint', name=name, type=kind)
    element(joint, 'parent', link=parent)
    element(joint, 'child', link=child)
    if x:
        element(joint, 'origin', xyz=(x, 0, 0))
    return joint


def _limits(robot: Robot, j: int, axis: str) -> dict[str, float]:
    """Return the limits of an axis of joint j [rad], [rad/s], [N m], with its own sign."""
    k = list(AXES).index(axis)
    low, high, rate = (float(x) for (x,) in robot.limits_of_axes(np.array([2 * j + k])))
    stiffness, damping = (robot.per_joint(name)[j, k] for name in ('stiffness', 'damping'))
    effort = robot.per_joint('torque_limit')[j, k]
    if effort >= MOST:
        effort = stiffness * (high - low) + 2 * damping * rate
    return {'lower': low, 'upper': high, 'velocity': rate, 'effort': effort}


def element(parent: ElementTree.Element, tag: str, /, **attributes: Any) -> ElementTree.Element:
    """Append an element; numbers are written with all their digits."""
    texts = {
        key: value if isinstance(value, str) else ' '.join(map(str, np.ravel(value).tolist()))
        for key, value in attributes.items()
    }
    return ElementTree.SubElement(parent, tag, texts)
