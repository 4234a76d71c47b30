# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Short URDF files for tests, made of links and joints."""

import math

import pytest

from snake_sim_ros import ParameterError
from snake_sim_ros.scene.urdf import robot_of_urdf

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
