# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The world of a scene as a world of SDFormat 1.9, as Gazebo reads it.

The floor and each solid are static models. Boxes and poles are exact; pipes, ramps, height fields
and meshes are triangles in files of their own, in which pipes have flat facets. Friction is left
out: SDFormat has none along and across a link.
"""

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from snake_sim_ros.scene.chain import angles_of, Array
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.surfaces import surfaces_of
from snake_sim_ros.scene.world import solids_of, World

Element = ElementTree.Element
STL = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])


def write_sdf(world: World, path: Path) -> list[Path]:
    """
    Write a world as an SDF file, and its triangles as STL files beside it.

    Returns
    -------
    list of Path
        All files, that of the world last.

    """
    root = Element('sdf', version='1.9')
    parent, files = ElementTree.SubElement(root, 'world', name=path.stem), list[Path]()
    floor = ElementTree.Element('plane')
    _add(floor, 'normal', (0, 0, 1))
    _add(floor, 'size', (100, 100))
    _add_model(parent, 'floor', floor)
    solids, surfaces = solids_of(world), surfaces_of(world)
    for k, (center, half, axes) in enumerate(
        zip(solids.box_center, solids.box_half, solids.box_axes, strict=True), 1
    ):
        box = Element('box')
        _add(box, 'size', 2.0 * half)
        _add_model(parent, f'box_{k}', box, (*center, *angles_of(axes.T)))
    for k, row in enumerate(solids.poles, 1):
        capsule, way = Element('capsule'), row[3:6] - row[:3]
        _add(capsule, 'radius', row[6:7])
        _add(capsule, 'length', [float(np.linalg.norm(way))])
        turn = 0.0, np.arctan2(np.hypot(way[0], way[1]), way[2]), np.arctan2(way[1], way[0])
        _add_model(parent, f'pole_{k}', capsule, (*(row[:3] + row[3:6]) / 2, *turn))
    for k, (vertices, faces) in enumerate(surfaces[len(solids.box_center) + len(solids.poles) :]):
        files.append(path.with_name(f'{path.stem}_{k + 1}.stl'))
        write_whole(files[-1], stl(vertices, faces))
        mesh = Element('mesh')
        ElementTree.SubElement(mesh, 'uri').text = files[-1].name
        _add_model(parent, f'mesh_{k + 1}', mesh)
    ElementTree.indent(root)
    write_whole(path, ElementTree.tostring(root, encoding='unicode') + '\n')
    return [*files, path]


def stl(vertices: Array, faces: Array) -> bytes:
    """Return triangles (t, 3) of vertices (v, 3) [m] as a binary STL file."""
    rows = np.zeros(len(faces), STL)
    rows['corners'] = vertices[faces]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    rows['normal'] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return bytes(80) + np.uint32(len(faces)).tobytes() + rows.tobytes()


def _add_model(
    parent: Element, name: str, shape: Element, pose: tuple[float, ...] = (0.0,) * 6
) -> None:
    """Append a static model of one shape at a pose: place [m], roll, pitch and yaw [rad]."""
    model = ElementTree.SubElement(parent, 'model', name=name)
    ElementTree.SubElement(model, 'static').text = 'true'
    _add(model, 'pose', pose)
    link = ElementTree.SubElement(model, 'link', name='link')
    for kind in ('collision', 'visual'):
        part = ElementTree.SubElement(link, kind, name=kind)
        ElementTree.SubElement(part, 'geometry').append(shape)


def _add(parent: Element, tag: str, numbers: Iterable[float]) -> None:
    """Append an element with numbers."""
    ElementTree.SubElement(parent, tag).text = ' '.join(repr(float(x)) for x in numbers)
