# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Markers of contacts and obstacles, without any node."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from snake_sim_ros import Ground, Patches, Pegs, Scene
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.nodes.state_publishers import SceneMarkers
from snake_sim_ros.recording.from_messages import FORCE_SCALE
from snake_sim_ros.scene.world import Box, Pole, World

pytestmark = pytest.mark.fast

STAMP = stamp_from(5_000_000)
NOTHING = np.zeros((0, 3))
POINTS = np.array([[0.1, 0.2, 0.0], [0.3, 0.4, 0.0]])
FORCES = np.array([[1.0, 2.0, 3.0], [0.0, -1.0, 4.0]])


def drawn(scene, *contents, before=()):
    """Return what a viewer that gets all messages shows: namespace and id -> marker."""
    shown, markers = dict(before), SceneMarkers(scene)
    for points, forces in contents:
        markers.fill(STAMP, points, forces)
        # As it arrives: a field of a wrong type would arrive as garbage.
        for marker in deserialize_message(serialize_message(markers.message), MarkerArray).markers:
            assert marker.header.frame_id == 'world'
            assert marker.header.stamp == STAMP
            assert marker.lifetime.sec == marker.lifetime.nanosec == 0
            if marker.action == Marker.DELETEALL:
                shown.clear()
            elif marker.action == Marker.DELETE:
                shown.pop((marker.ns, marker.id), None)
            else:
                assert marker.action == Marker.ADD
                shown[marker.ns, marker.id] = marker
    return shown


def places(marker):
    return np.array([[point.x, point.y, point.z] for point in marker.points])


def test_contacts_are_spheres_and_lines_along_the_forces():
    shown = drawn(Scene(), (POINTS, FORCES))
    assert shown.keys() == {('contacts', 0), ('contacts', 1)}
    spheres, lines = shown.values()
    assert (spheres.type, lines.type) == (Marker.SPHERE_LIST, Marker.LINE_LIST)
    assert (places(spheres) == POINTS).all()
    assert (places(lines)[::2] == POINTS).all()
    assert places(lines)[1::2] - POINTS == pytest.approx(FORCE_SCALE * FORCES, abs=1e-15)
    for marker in shown.values():
        assert marker.color.a == 1.0
        assert marker.scale.x > 0
        assert marker.pose.orientation.w == 1.0


def test_nothing_is_left_of_contacts_that_open():
    fewer = drawn(Scene(), (POINTS, FORCES), (POINTS[:1], FORCES[:1]))
    assert [len(marker.points) for marker in fewer.values()] == [1, 2]
    assert not drawn(Scene(), (POINTS, FORCES), (NOTHING, NOTHING))
    assert len(drawn(Scene(), (NOTHING, NOTHING), (POINTS, FORCES))) == 2


def test_pegs_are_cylinders_on_the_ground():
    pegs = Pegs(x=(1.0, 2.0), y=(-0.5, 0.5), radius=(0.03, 0.05))
    shown = drawn(Scene(pegs=pegs), (NOTHING, NOTHING))
    assert shown.keys() == {('scene', 1), ('scene', 2)}
    for (x, y, radius), peg in zip(pegs.axes, shown.values(), strict=True):
        assert peg.type == Marker.CYLINDER
        assert (peg.pose.position.x, peg.pose.position.y) == (x, y)
        assert peg.scale.x == peg.scale.y == 2 * radius
        assert peg.pose.position.z == peg.scale.z / 2 > 0


def test_nothing_is_left_of_the_scene_before():
    before = drawn(Scene(pegs=Pegs(x=(1.0, 2.0), y=(-0.5, 0.5))), (POINTS, FORCES))
    after = drawn(Scene(pegs=Pegs(x=(3.0,), y=(0.0,))), (NOTHING, NOTHING), before=before)
    assert [marker.pose.position.x for marker in after.values()] == [3.0]


def test_patches_are_plates_below_the_floor_darker_where_friction_is_larger():
    patches = Patches(factors=((0.5, 1.0, 2.0),), cell=0.4, origin=(-0.6, 1.0))
    ((key, plates),) = drawn(Scene(patches=patches), (NOTHING, NOTHING)).items()
    assert (key, plates.type) == (('patches', 0), Marker.CUBE_LIST)
    assert places(plates)[:, :2] == pytest.approx(np.array([[-0.4, 1.2], [0.0, 1.2], [0.4, 1.2]]))
    assert places(plates)[:, 2] + plates.scale.z / 2 == pytest.approx(np.zeros(3))
    shades = [color.r for color in plates.colors]
    assert shades == sorted(shades, reverse=True)


def test_cells_of_the_ground_are_boxes_up_to_their_heights():
    heights = ((0.0, 0.02, -0.05), (0.1, 0.0, 0.03))
    scene = Scene(ground=Ground(heights=heights, cell=0.5, origin=(-1.0, 2.0)))
    ((key, ground),) = drawn(scene, (NOTHING, NOTHING)).items()
    assert key == ('scene', 0)
    assert ground.type == Marker.CUBE_LIST
    assert ground.scale.x == ground.scale.y == 0.5
    centers = places(ground)
    assert centers[:, 2] + ground.scale.z / 2 == pytest.approx(np.ravel(heights), abs=1e-15)
    assert (centers[:, 2] - ground.scale.z / 2).max() < -0.05  # no gaps below
    x, y = centers[5, :2]
    assert (x, y) == (-1.0 + 2.5 * 0.5, 2.0 + 1.5 * 0.5)


def test_solids_of_a_world_are_triangles_in_some_messages():
    world = World(boxes=(Box(center=(0.0, 0.0, 0.1), size=(1.0, 0.5, 0.2)),), poles=(Pole(),))
    scene = Scene(world=world)
    shown = drawn(scene, *[(POINTS, FORCES)] * 3)
    box, pole = shown['world', 0], shown['world', 1]
    assert box.type == pole.type == Marker.TRIANGLE_LIST
    corners = places(box)
    assert len(corners) == 36
    assert np.allclose(corners.min(axis=0), [-0.5, -0.25, 0.0])
    assert np.allclose(corners.max(axis=0), [0.5, 0.25, 0.2])
    # Counterclockwise from outside: the volume below all triangles is that of the box.
    a, b, c = corners.reshape(-1, 3, 3).transpose(1, 0, 2)
    assert np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6 == pytest.approx(0.1)
    markers = SceneMarkers(scene)
    for k in range(3):
        markers.fill(STAMP, NOTHING, NOTHING)
        assert any(marker.ns == 'world' for marker in markers.message.markers) == (k == 0)
