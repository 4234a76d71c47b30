# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Short URDF files for tests, made of links and joints."""

import math

import numpy as np
import pytest

from snake_sim_ros import ParameterError
from snake_sim_ros.scene.chain import angles_of, frames_at_rest, roll_pitch_yaw
from snake_sim_ros.scene.urdf import robot_of_urdf
from snake_sim_ros.view.frames import turned_to

QUARTER = math.pi / 2
FINE = 'ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"'
HUGE, TINY = FINE.replace('1e-3', '100'), FINE.replace('1e-3', '1e-5')
MESH = '<mesh filename="{}" scale="0.001 0.001 -0.001"/>'
SPHERE = '<sphere radius="0.05"/>'


def texts(values):
    """Return numbers as an attribute has them."""
    return ' '.join(map(repr, map(float, values)))


def at(place=(0, 0, 0), angles=(0, 0, 0)):
    return f'<origin xyz="{texts(place)}" rpy="{texts(angles)}"/>'


def shape(geometry=SPHERE, origin='', kind='collision'):
    return f'<{kind}>{origin}<geometry>{geometry}</geometry></{kind}>'


def link(name, mass=1.0, inertia=FINE, origin='', shapes=None):
    """Return a link; without a mass it is a frame."""
    inertial = f'<inertial>{origin}<mass value="{mass}"/><inertia {inertia}/></inertial>'
    shapes = (shape() if mass is not None else '') if shapes is None else shapes
    return f'<link name="{name}">{inertial if mass is not None else ""}{shapes}</link>'


def joint(name, parent, child, place=(0.1, 0, 0), angles=(0, 0, 0), axis=(0, 0, 1), **more):
    """Return a joint; `kind` is its type, `limit` and `more` are further elements."""
    kind = more.get('kind', 'revolute')
    limit = more.get('limit', '<limit lower="-1" upper="1" effort="2" velocity="3"/>')
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'{at(place, angles)}<axis xyz="{texts(axis)}"/>{limit}{more.get("more", "")}</joint>'
    )


def urdf(*elements):
    return f'<?xml version="1.0"?><robot name="r">{"".join(elements)}</robot>'


def fixed(parent, child, *where):
    return joint(f'{parent}_{child}', parent, child, *where, kind='fixed')


def refusal(text, **how):
    """Return the one sentence with which a URDF is refused."""
    with pytest.raises(ParameterError) as caught:
        robot_of_urdf(text, **how)
    message = str(caught.value)
    assert '\n' not in message
    return message


def written_from(robot, root):
    """
    Return a robot whose joints all lead forward as a URDF whose root is one of its links.

    Links from link 1 to the root have other frames there, at their joints toward the root and with
    any axes: a URDF has no choice where.
    """
    rng, (origin, turn) = np.random.default_rng(root), frames_at_rest(robot.joints)
    place, axes = origin.copy(), turn.copy()
    place[:root] = origin[1 : root + 1]
    for i in range(root):
        axes[i] = roll_pitch_yaw(rng.uniform(-3, 3, 3))

    def pose(i, point, frame):
        """Return a point and a frame in those of a link as the origin of an element."""
        return at(axes[i].T @ (point - place[i]), angles_of(axes[i].T @ frame))

    elements = []
    for i, item in enumerate(robot.links):
        shapes = ''
        for each in item.shapes:
            ends = [origin[i] + turn[i] @ end for end in (each.start, each.end)]
            along = ends[1] - ends[0]
            length = float(np.linalg.norm(along))
            frame = turned_to(along / length)
            geometry = f'<capsule radius="{each.radius!r}" length="{length!r}"/>'
            shapes += shape(geometry, pose(i, (ends[0] + ends[1]) / 2, frame))
        keys = zip(('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz'), item.inertia, strict=True)
        inertia = ' '.join(f'{key}="{value!r}"' for key, value in keys)
        center = pose(i, origin[i] + turn[i] @ item.center_of_mass, turn[i])
        elements.append(link(item.name, item.mass, inertia, center, shapes))
    for j, hinge in enumerate(robot.joints):
        parent, child, way = (j, j + 1, 1) if j >= root else (j + 1, j, -1)
        turned = [turn[j + 1] @ axis for axis in (hinge.axis, hinge.second_axis) if axis]
        found = [*zip(hinge.axis_names, turned, strict=True)][::way]
        where = axes[parent].T @ (place[child] - place[parent])
        angles, end = angles_of(axes[parent].T @ axes[child]), robot.links[parent].name
        for k, (name, axis) in enumerate(found):
            here = robot.links[child].name if k == len(found) - 1 else f'{name}_cross'
            if k < len(found) - 1:
                elements.append(link(here, None))
            elements.append(joint(name, end, here, where, angles, way * axes[child].T @ axis))
            end, where, angles = here, (0, 0, 0), (0, 0, 0)
    return urdf(*elements)
