# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Meshes of a URDF, as which the viewer shows the links."""

import numpy as np
import pytest

from snake_sim_ros import load_robot, Robot, Scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.robot_description import robot_description, robot_of
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.view.frames import bodies_of, own_frames, seen_meshes
from snake_sim_ros.view.stage import Stage

trimesh = pytest.importorskip('trimesh')

URDF = """<robot name="two">
{links}
  <joint name="bend" type="revolute">
    <parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="2" effort="3"/>
  </joint>
</robot>"""
LINK = """  <link name="{name}">
    <inertial><origin xyz="0.1 0 0.01"/><mass value="0.5"/>
      <inertia ixx="1e-3" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
    <visual><origin xyz="0.02 0.03 0.04" rpy="0 0 1.5707963267948966"/>
      <geometry><mesh filename="{file}" scale="1 2 1"/></geometry></visual>
  </link>"""
SIZE = 0.2, 0.04, 0.06  # of the box in the file [m]


class Canvas:
    """Keeps what is drawn as meshes, in place of a browser."""

    def __init__(self):
        self.meshes = []

    def add_batched_meshes_simple(self, name, vertices, faces, *places, **how):
        self.meshes.append((name, vertices, len(places[0])))
        return Canvas()

    def __getattr__(self, name):
        return lambda *arguments, **how: Canvas()


def write(folder, *files):
    """Write a URDF whose two links are seen as meshes; return its path."""
    links = '\n'.join(
        LINK.format(name=name, file=file) for name, file in zip('ab', files, strict=True)
    )
    (folder / 'two.urdf').write_text(URDF.format(links=links), encoding='utf-8')
    return folder / 'two.urdf'


@pytest.fixture
def robot(tmp_path):
    (tmp_path / 'my meshes').mkdir()
    trimesh.creation.box(SIZE).export(tmp_path / 'my meshes' / 'shell.stl')
    return load_robot(write(tmp_path, 'my meshes/shell.stl', 'my meshes/shell.stl'))


def in_space(robot, links, vertices):
    """Return the vertices of each link in space, when the robot lies straight."""
    q = initial_coordinates(Scene(robot=robot))
    places, turns = own_frames(robot, q[:, :3], q[:, 3:])
    return [places[i] + vertices @ rotation_matrices(turns)[i].T for i in links]


def test_they_are_where_the_urdf_has_them(robot):
    (links, vertices, faces), *others = seen_meshes(robot)
    assert not others and links.tolist() == [0, 1] and len(faces) == 12
    first, second = in_space(robot, links, vertices)
    # Along x of the link the box is 0.04 m wide, twice that by its scale, and 0.2 m across.
    assert np.ptp(first, axis=0) == pytest.approx([0.08, 0.2, 0.06], abs=1e-7)  # as STL rounds
    assert second - first == pytest.approx(np.tile([0.3, 0.0, 0.0], (8, 1)), abs=1e-7)
    q = initial_coordinates(Scene(robot=robot))
    middle = (first.min(axis=0) + first.max(axis=0)) / 2
    assert middle - q[0, :3] == pytest.approx([0.02 - 0.1, 0.03, 0.04 - 0.01], abs=1e-7)


def test_links_that_look_alike_are_one_mesh(robot):
    canvas = Canvas()
    Stage(canvas, Scene(robot=robot))
    assert [count for name, _, count in canvas.meshes if 'links' in name] == [2]


def test_a_description_names_them_and_is_read_back(robot):
    text = robot_description(robot)
    assert 'my%20meshes/shell.stl' in text
    for mesh, other in zip(robot.links, robot_of(text).links, strict=True):
        assert mesh.meshes[0].file == other.meshes[0].file
        assert other.meshes[0].origin == pytest.approx(mesh.meshes[0].origin, abs=1e-15)
        assert len(mesh.shapes) == len(other.shapes) == 1


def test_links_without_a_mesh_are_drawn_as_their_shapes(tmp_path):
    (tmp_path / 'broken.stl').write_bytes(b'solid nothing')
    robot = load_robot(write(tmp_path, 'broken.stl', 'nowhere.stl'))
    assert len(robot.links[0].meshes) == 1 and not robot.links[1].meshes
    canvas = Canvas()
    with pytest.warns(UserWarning, match='broken.stl is not shown: '):
        Stage(canvas, Scene(robot=robot))
    assert sum(count for name, _, count in canvas.meshes if 'links' in name) == 2
    assert len(bodies_of(robot).link) == 2


def test_a_mesh_that_is_not_found_is_a_remark(tmp_path, capsys):
    from snake_sim_ros.scene.urdf import robot_of_urdf

    text = write(tmp_path, 'nowhere.stl', 'nowhere.stl').read_text(encoding='utf-8')
    found = robot_of_urdf(text, folder=tmp_path)
    assert 'meshes that are not found, and not shown: nowhere.stl' in found.remarks
    assert not any(link.meshes for link in Robot(**found.values).links)
