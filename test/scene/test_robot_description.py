# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The URDF against the model, as an independent parser reads it; and what viewers show."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from random_states import random_robot
import yaml

from snake_sim_ros import Robot
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.recording.from_messages import B_TO_WIRE
from snake_sim_ros.scene.files import CONFIG
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.scene.rotations import product, rotation_matrices

pytestmark = pytest.mark.fast

ROBOTS = {
    'aiko': Robot(),
    'slender': load_scene('slender_undulation').robot,
    'hyper_redundant': load_scene('hyper_redundant').robot,
    **{str(n): random_robot(np.random.default_rng(n), n) for n in (1, 2, 3, 11, 20)},
}
each_robot = pytest.mark.parametrize('robot', ROBOTS.values(), ids=ROBOTS.keys())


def parsed(robot):
    """Return what MuJoCo makes of the URDF, with all its links: by itself it merges some."""
    mujoco = pytest.importorskip('mujoco')
    root = ElementTree.fromstring(robot_description(robot))
    ElementTree.SubElement(ElementTree.SubElement(root, 'mujoco'), 'compiler', fusestatic='false')
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding='unicode'))


def link_names(robot):
    return [f'link_{i}' for i in range(1, robot.link_count + 1)]


@each_robot
def test_tree_has_one_root_and_all_names_once(robot):
    root = ElementTree.fromstring(robot_description(robot))
    links = [link.get('name') for link in root.findall('link')]
    joints = [joint.get('name') for joint in root.findall('joint')]
    children = [joint.find('child').get('link') for joint in root.findall('joint')]
    assert len({*links}) == len(links)
    assert len({*joints}) == len(joints)
    assert sorted([*children, 'base_link']) == sorted(links)
    assert {joint.find('parent').get('link') for joint in root.findall('joint')} <= {*links}
    revolute = [joint.get('name') for joint in root.findall('joint[@type="revolute"]')]
    assert sorted(revolute) == sorted(robot.axis_names)
    assert {*link_names(robot)} <= {*links}


@each_robot
def test_masses_and_inertias_are_those_of_the_model(robot):
    model = parsed(robot)
    mass, across, along = (
        robot.per_link(name) for name in ('link_mass', 'inertia_transversal', 'inertia_axial')
    )
    for i, name in enumerate(link_names(robot)):
        body = model.body(name)
        assert body.mass[0] == mass[i]
        assert (body.ipos == 0).all()
        R = rotation_matrices(body.iquat)  # principal axes, which the parser sorts
        inertia = R @ np.diag(body.inertia) @ R.T
        assert np.abs(inertia - np.diag([along[i], across[i], across[i]])).max() < 1e-15
    assert mass.sum() <= model.body_mass.sum() < (1 + 1e-6) * mass.sum()
    assert model.body('base_link').mass[0] == 0


@each_robot
def test_joints_have_axes_and_limits_of_the_model(robot):
    model = parsed(robot)
    root = ElementTree.fromstring(robot_description(robot))
    stiffness, damping = robot.per_joint('stiffness'), robot.per_joint('damping')
    for k, name in enumerate(robot.axis_names):
        j, axis = divmod(k, 2)
        joint = model.joint(name)
        sign = 1 if j >= robot.middle_link else -1
        assert (joint.axis == sign * np.array([[0, 0, 1], [0, 1, 0]])[axis]).all()
        assert (joint.range == [-robot.joint_limit, robot.joint_limit]).all()
        limit = root.find(f'joint[@name="{name}"]/limit')
        assert float(limit.get('velocity')) == robot.joint_rate_limit
        torque = stiffness[j, axis] * robot.joint_limit + damping[j, axis] * robot.joint_rate_limit
        assert float(limit.get('effort')) == 2 * torque


@each_robot
def test_joint_states_drive_it_to_the_pose_of_the_model(robot):
    mujoco = pytest.importorskip('mujoco')
    model, rng = parsed(robot), np.random.default_rng(2)
    data = mujoco.MjData(model)
    angle = rng.uniform(-robot.joint_limit, robot.joint_limit, (robot.link_count - 1, 2))
    for name, value in zip(robot.axis_names, angle.ravel(), strict=True):
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    q = chain_coordinates(robot, angle)
    frames = rotation_matrices(product(q[:, 3:], B_TO_WIRE))
    position = q[:, :3] - q[robot.middle_link, :3]
    base = frames[robot.middle_link] * [-1, -1, 1]  # x toward link 1
    assert (data.body('base_link').xpos == 0).all()
    for i, name in enumerate(link_names(robot)):
        body = data.body(name)
        # 40 turns and as many steps of 0.1 m, each with a rounding or two.
        assert np.abs(body.xpos - base.T @ position[i]).max() < 1e-13
        assert np.abs(body.xmat.reshape(3, 3) - base.T @ frames[i]).max() < 1e-13


@each_robot
def test_it_touches_with_the_contact_spheres(robot):
    root = ElementTree.fromstring(robot_description(robot))
    offset, radius = robot.per_link('contact_offset'), robot.per_link('contact_radius')
    for i, name in enumerate(link_names(robot)):
        spheres = root.findall(f'link[@name="{name}"]/collision')
        places = [
            [float(x) for x in sphere.find('origin').get('xyz').split()] for sphere in spheres
        ]
        assert places == [[offset[i], 0, 0], [-offset[i], 0, 0]]
        for sphere in spheres:
            assert float(sphere.find('geometry/sphere').get('radius')) == radius[i]


def test_a_link_without_contact_radius_has_no_shape():
    text = robot_description(Robot(contact_radius=0.0))
    assert 'sphere' not in text
    assert robot_description(Robot(contact_offset=0.0)).count('cylinder') == 0


# ---- what viewers show --------------------------------------------------------------------------

SHOWN = {'/robot_description', '/link_poses', '/markers', '/odom'}
PLOTTED = {'/joint_states', '/diagnostics', '/cmd_vel'}


def topics_in(entry):
    """Return the topics that the texts and keys of a configuration name."""
    if isinstance(entry, dict):
        return {name for pair in entry.items() for part in pair for name in topics_in(part)}
    if isinstance(entry, list):
        return {name for part in entry for name in topics_in(part)}
    return {entry.partition('.')[0]} if isinstance(entry, str) and entry[:1] == '/' else set()


def test_rviz_is_told_topics_and_a_frame_that_exist():
    config = yaml.safe_load((CONFIG / 'aiko.rviz').read_text(encoding='utf-8'))
    assert topics_in(config) == SHOWN
    assert config['Visualization Manager']['Global Options']['Fixed Frame'] == 'world'


def panels(layout):
    """Return the names of all panels of a Foxglove layout, from left to right."""
    if isinstance(layout, str):
        return [layout]
    return [*panels(layout['first']), *panels(layout['second'])]


def test_foxglove_is_told_topics_that_exist_and_shows_all_panels():
    config = json.loads((CONFIG / 'foxglove.json').read_text(encoding='utf-8'))
    assert topics_in(config) == SHOWN | PLOTTED
    assert sorted(panels(config['layout'])) == sorted(config['configById'])


def test_buttons_of_foxglove_are_what_the_gait_can_do():
    config = json.loads((CONFIG / 'foxglove.json').read_text(encoding='utf-8'))
    gait, moves = load_scene('lateral_undulation').gait, {}
    for name, panel in config['configById'].items():
        if name.startswith('Publish!'):
            twist = json.loads(panel['value'])
            steering = Steering(twist['linear']['x'], twist['angular']['z'])
            steered, remarks = steering.gait(gait, Robot(), Stride(0.546))
            assert not remarks
            moves[name] = np.sign([steered.yaw.amplitude, -steered.yaw.offset]).tolist()
    assert moves == {
        'Publish!left': [1, 1],
        'Publish!ahead': [1, 0],
        'Publish!right': [1, -1],
        'Publish!stop': [0, 0],
    }
