# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Worlds as SDF files: each solid where it is, exact or as its triangles."""

from xml.etree import ElementTree

import numpy as np
import pytest

from snake_sim_ros import Box, Pipe, Pole, Ramp, World
from snake_sim_ros.commands.main import main
from snake_sim_ros.scene.chain import roll_pitch_yaw
from snake_sim_ros.scene.sdf import STL, write_sdf
from snake_sim_ros.scene.surfaces import surfaces_of

pytestmark = pytest.mark.fast

WORLD = World(
    boxes=(Box(center=(0.5, 0.2, 0.3), size=(0.2, 0.4, 0.6), rpy=(0.3, -0.4, 2.0)),),
    poles=(Pole(start=(1.0, 0.0, 0.5), end=(0.2, -0.7, 0.1), radius=0.03), Pole()),
    pipes=(Pipe(),),
    ramps=(Ramp(heading=1.0),),
)
ROUNDING = 1e-15


@pytest.fixture
def models(tmp_path):
    """Return the models of a world by name."""
    *meshes, path = write_sdf(WORLD, tmp_path / 'ground.sdf')
    assert [file.name for file in meshes] == ['ground_1.stl', 'ground_2.stl']
    return {each.get('name'): each for each in ElementTree.parse(path).findall('world/model')}


def numbers(element, place):
    return np.array(element.findtext(place).split(), dtype=float)


def of(models, name, shape):
    """Return the shape of a static model, its center and its axes."""
    model = models[name]
    assert model.findtext('static') == 'true'
    seen, touched = (
        model.find(f'link/{kind}/geometry/{shape}') for kind in ('visual', 'collision')
    )
    assert ElementTree.tostring(seen) == ElementTree.tostring(touched)
    pose = numbers(model, 'pose')
    return touched, pose[:3], roll_pitch_yaw(tuple(pose[3:]))


def test_boxes_and_poles_are_exact(models):
    box, center, axes = of(models, 'box_1', 'box')
    signs = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    corners = center + (signs * numbers(box, 'size')) @ axes.T
    wanted, _ = surfaces_of(WORLD)[0]
    assert all(np.abs(corners - corner).max(axis=1).min() < ROUNDING for corner in wanted)
    for k, pole in enumerate(WORLD.poles, 1):
        capsule, center, axes = of(models, f'pole_{k}', 'capsule')
        half = axes[:, 2] * numbers(capsule, 'length') / 2
        assert np.abs(center - half - pole.start).max() < ROUNDING
        assert np.abs(center + half - pole.end).max() < ROUNDING
        assert numbers(capsule, 'radius') == [pole.radius]


def test_other_solids_are_triangles_in_files(models, tmp_path):
    assert list(models) == ['floor', 'box_1', 'pole_1', 'pole_2', 'mesh_1', 'mesh_2']
    for k, (vertices, faces) in enumerate(surfaces_of(WORLD)[3:], 1):
        mesh, center, axes = of(models, f'mesh_{k}', 'mesh')
        content = (tmp_path / mesh.findtext('uri')).read_bytes()
        rows = np.frombuffer(content[84:], STL)
        assert int.from_bytes(content[80:84], 'little') == len(rows) == len(faces)
        assert (rows['corners'] == vertices[faces].astype(np.float32)).all()
        assert not center.any() and (axes == np.eye(3)).all()


def test_the_command_writes_the_world_of_a_scene(tmp_path, capsys):
    path = tmp_path / 'stairs.sdf'
    assert main(['sdf', 'stairs', '--out', str(path)]) == 0
    assert capsys.readouterr().out == f'{path}\n'
    assert path.read_text(encoding='utf-8').count('<model') == 1 + 4
    assert main(['sdf', 'sidewinding', '--out', str(path)]) == 2
    assert 'sidewinding has no world' in capsys.readouterr().err
