# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages read back as what they were made of: robots, poses, joints, contacts, obstacles."""

from dataclasses import replace
import re

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseArray
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker

from snake_sim_ros import ParameterError, Robot, Scene
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.nodes.state_publishers import SceneMarkers
from snake_sim_ros.recording import from_messages
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.robot_description import robot_description, robot_of
from snake_sim_ros.scene.surfaces import surfaces_of
from snake_sim_ros.scene.world import Box, Pipe, Ramp, World
from snake_sim_ros.stepping.state import initial_state

pytestmark = pytest.mark.fast

LISTS = {
    'link_length': (0.1, 0.2, 0.15, 0.12),
    'link_mass': (0.5, 0.6, 0.7, 0.8),
    'contact_radius': (0.05, 0.04, 0.0, 0.03),
    'contact_offset': (0.03, 0.0, 0.02, 0.01),
}


@pytest.mark.parametrize(
    'robot',
    [
        Robot(),
        Robot(link_count=2),
        Robot(link_count=7, link_length=0.2, contact_offset=0.0, joint_limit=1.0),
        Robot(link_count=200, link_length=0.0067, contact_offset=0.002, contact_radius=0.003),
        Robot(link_count=4, joint_rate_limit=3.0, **LISTS),
    ],
)
def test_robot_of_its_description(robot):
    found = robot_of(robot_description(robot))
    assert (found.link_count, found.joint_limit, found.joint_rate_limit) == (
        robot.link_count,
        robot.joint_limit,
        robot.joint_rate_limit,
    )
    names = ('link_length', 'link_mass', 'inertia_axial', 'inertia_transversal', 'contact_radius')
    for name in names:
        assert (found.per_link(name) == robot.per_link(name)).all(), name
    # A link without a radius has no spheres whose places the description could tell.
    shown = robot.per_link('contact_radius') > 0
    assert (found.per_link('contact_offset') == robot.per_link('contact_offset') * shown).all()


@pytest.mark.parametrize(
    'urdf', ['', 'no xml', '<robot/>', '<robot><link name="a"/></robot>',
             robot_description(Robot()).replace('link_5', 'limb_5'),
             robot_description(Robot()).replace('radius', 'girth'),
             robot_description(Robot()).replace('velocity', 'speed'),
             re.sub('xyz="[^"]*"', 'xyz=""', robot_description(Robot())),
             re.sub('xyz="[^"]*"', 'xyz="0 0"', robot_description(Robot()))]
)  # fmt: skip
def test_other_descriptions(urdf):
    with pytest.raises(ParameterError, match='robot_description must be a URDF as snake-sim urdf'):
        robot_of(urdf)


def test_places_without_numbers_are_named():
    text = robot_description(Robot()).replace('xyz="0.0393 0.0 0.0"', 'xyz=" "')
    assert text != robot_description(Robot())
    with pytest.raises(ParameterError, match='xyz of an origin must be three numbers, got not'):
        robot_of(text)


def test_poses_are_those_of_the_state():
    scene = load_scene('lateral_undulation')
    state = initial_state(scene)
    # The head lies on its side, the tail is turned around; one of them has a negative scalar.
    state.q[0, 3:] = np.array([-0.1, 0.7, 0.5, 0.5]) / 1.0
    messages = StateMessages(scene.robot)
    messages.fill(0, state, np.zeros((10, 2)))
    message = deserialize_message(bytes(messages.link_poses), PoseArray)
    position, orientation = from_messages.poses(message, scene.robot)
    assert (position == state.q[:, :3]).all()
    # Both signs are the same rotation; sums of four products of halves round to 2e-16.
    sign = np.sign((orientation * state.q[:, 3:]).sum(axis=1, keepdims=True))
    assert np.abs(sign * orientation - state.q[:, 3:]).max() < 1e-15


def test_joints_by_name():
    axes = from_messages.joint_axes(
        ['joint_2_pitch', 'joint_1_yaw', 'wheel'], [0.2, 0.1, 7.0], Robot(link_count=3)
    )
    assert np.array_equal(axes, [[0.1, np.nan], [np.nan, 0.2]], equal_nan=True)
    assert np.isnan(from_messages.joint_axes(['joint_1_yaw'], [], Robot(link_count=4))).all()
    assert from_messages.joint_axes([], [], Robot(link_count=1)).shape == (0, 2)


@pytest.mark.parametrize('name', ['obstacle_aided', 'step', 'lateral_undulation'])
def test_scene_of_its_markers(name):
    scene = load_scene(name)
    found = from_messages.scene_of(
        robot_description(scene.robot), SceneMarkers(scene).message.markers
    )
    assert found.robot.per_link('link_length') == pytest.approx(0.122, abs=1e-15)
    assert found.pegs.axes == pytest.approx(scene.pegs.axes, abs=1e-15)
    # Boxes are given by their centers: this takes a few roundings of numbers below 4 m.
    assert np.shape(found.ground.heights) == np.shape(scene.ground.heights)
    assert np.array(found.ground.heights) == pytest.approx(
        np.array(scene.ground.heights), abs=1e-14
    )
    if scene.ground.heights:
        assert found.ground.origin == pytest.approx(scene.ground.origin, abs=1e-14)
        assert found.ground.cell == scene.ground.cell


def test_solids_of_markers():
    world = World(boxes=(Box(),), pipes=(Pipe(),), ramps=(Ramp(heading=0.5),))
    markers = SceneMarkers(Scene(world=world))
    markers.fill(Time(), *np.zeros((2, 0, 3)))
    found = from_messages.solids(markers.message.markers)
    for (vertices, faces), (points, corners) in zip(surfaces_of(world), found, strict=True):
        assert (points[corners] == vertices[faces]).all()
        assert len(points) == len(vertices)
    # What is no triangle is left out, and so is what is nowhere.
    broken = Marker(ns='world', type=Marker.TRIANGLE_LIST)
    broken.points = [Point(x=float(k)) for k in range(4)]
    assert [len(faces) for _, faces in from_messages.solids([broken])] == [1]
    broken.points[0].x = np.nan
    assert not from_messages.solids([broken, Marker(ns='world', type=Marker.TRIANGLE_LIST)])


def test_contacts_of_markers():
    markers = SceneMarkers(Scene())
    assert from_messages.contacts([]) is None
    points, forces = np.arange(6.0).reshape(2, 3), np.array([[0.0, 1.0, 40.0], [-2.0, 0.0, 3.0]])
    markers.fill(Time(), points, forces)
    found = from_messages.contacts(markers.message.markers)
    assert found is not None
    assert (found[0] == points).all()
    assert found[1] == pytest.approx(forces, abs=1e-12)
    markers.fill(Time(), points[:0], forces[:0])
    assert [len(part) for part in from_messages.contacts(markers.message.markers)] == [0, 0]


def test_a_marker_that_was_deleted_is_not_there():
    scene = load_scene('obstacle_aided')
    markers = SceneMarkers(scene).message.markers
    for marker in markers:
        marker.action = 2
    assert from_messages.scene_of(robot_description(scene.robot), markers) == replace(
        Scene(), robot=robot_of(robot_description(scene.robot))
    )
