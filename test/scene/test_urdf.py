# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Robots from a URDF: kinematics and masses against other readers, closed forms, and limits.

The reader of this file multiplies the frames that a URDF names, and knows nothing of chains.
"""

from dataclasses import replace
import math
import sys
from xml.etree import ElementTree

from modular import aiko_link_by_link, modular_robot
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from urdf_texts import (
    at,
    FINE,
    fixed,
    HUGE,
    joint,
    link,
    MESH,
    QUARTER,
    refusal,
    shape,
    SPHERE,
    TINY,
    urdf,
    written_from,
)

from snake_sim_ros import Joint, Link, ParameterError, Robot, Scene, Shape
from snake_sim_ros.scene.chain import angles_of, roll_pitch_yaw
from snake_sim_ros.scene.checked_records import from_mapping
from snake_sim_ros.scene.files import CONFIG, read_mapping
from snake_sim_ros.scene.parameters import scene_from_text, scene_to_text
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.robot_description import robot_description, robot_of
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.scene.urdf import robot_of_urdf

pytestmark = pytest.mark.fast


def robot_from(text, **how):
    return Robot(**robot_of_urdf(text, **how).values)


# ---- kinematics ---------------------------------------------------------------------------------


def random_part(rng, name):
    """Return a link with any mass, center of mass and inertia."""
    turn = Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()
    xx, yy, zz = np.einsum('ij,j->ij', turn, rng.uniform(0.5, 0.9, 3) * 1e-3) @ turn.T
    inertia = (
        (
            f'ixx="{xx[0]!r}" iyy="{yy[1]!r}" izz="{zz[2]!r}" '
            f'ixy="{xx[1]!r}" ixz="{xx[2]!r}" iyz="{yy[2]!r}"'
        )
        .replace('np.float64(', '')
        .replace(')', '')
    )
    origin = at(rng.uniform(-0.03, 0.03, 3), rng.uniform(-3, 3, 3))
    return link(name, rng.uniform(0.5, 1.5), inertia, origin)


def random_urdf(seed, root=0, cardan=0.3):
    """Return a chain of links of up to three parts, with joints of one axis and of two."""
    rng, elements, ends = np.random.default_rng(seed), [], []
    for i in range(5):
        elements.append(random_part(rng, f'link_{i}'))
        end = f'link_{i}'
        for k in range(rng.integers(0, 3)):
            part = f'part_{i}_{k}'
            parent = rng.choice([end, f'link_{i}'])
            elements.append(random_part(rng, part))
            elements.append(fixed(parent, part, rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3, 3)))
            end = part if rng.uniform() < 0.7 else end
        ends.append(end)
    for i in range(4):
        where, axis = (rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3, 3)), rng.standard_normal(3)
        end, child = (ends[i], i + 1) if i >= root else (ends[i + 1], i)
        if rng.uniform() > cardan:
            elements.append(joint(f'hinge_{i}', end, f'link_{child}', *where, axis))
            continue
        angles = rng.uniform(-3, 3, 3)
        second = np.cross(roll_pitch_yaw(angles).T @ axis, rng.standard_normal(3))
        elements += [
            link(f'cross_{i}', None),
            joint(f'hinge_{i}', end, f'cross_{i}', *where, axis),
            joint(f'hinge_{i}_b', f'cross_{i}', f'link_{child}', (0, 0, 0), angles, second),
        ]
    return urdf(*elements)


def reu(modules=4):
    """Return a robot like REU: three parts a module, one without mass, and a frame as root."""
    elements = [link('root', None), fixed('root', 'in_0', (0, 0, 0.026), (0, -QUARTER, 0))]
    for i in range(modules):
        tube = shape('<cylinder length="0.0208" radius="0.0254"/>')
        elements += [
            link(f'in_{i}', 0.01, TINY, shapes=shape(kind='visual')),
            link(f'body_{i}', 0.103, TINY, shapes=tube),
            link(f'out_{i}', 0.0, TINY.replace('1e-5', '0'), shapes=' '),
            fixed(f'in_{i}', f'body_{i}', (0, -0.0066, 0), (QUARTER, 0, 0)),
            fixed(f'body_{i}', f'out_{i}', (0, 0, 0.044), (0, QUARTER, 0)),
        ]
        if i:
            name, turn = f'reu_joint_out2in_{i - 1}', (0, math.pi, -QUARTER)
            elements.append(joint(name, f'out_{i - 1}', f'in_{i}', (0, 0, 0), turn))
    return urdf(*elements)


def sea(modules=4):
    """Return a robot like SEA: two halves a module, with a joint between them."""
    elements = [link('base', 0.05, TINY), fixed('base', 'input_1', (0, 0, 0.025))]
    for i in range(1, modules + 1):
        elements += [link(f'input_{i}', 0.103), link(f'output_{i}', 0.103)]
        where = (0, 0, 0.0366), (0, 0, 0), (0, 1, 0)
        elements.append(joint(f'SA{i:03d}__MoJo', f'input_{i}', f'output_{i}', *where))
        if i < modules:
            ends = f'output_{i}', f'input_{i + 1}'
            elements.append(fixed(*ends, (0, 0, 0.0273), (0, 0, -QUARTER)))
    return urdf(*elements)


def rsnake(modules=4):
    """Return a robot like RSnake: modules that are alike, each turned against the one before."""
    elements = [link('root', None), fixed('root', 'module_0', (0, 0, 0.05))]
    for i in range(modules):
        elements.append(link(f'module_{i}'))
        if i:
            ends = f'module_{i - 1}', f'module_{i}'
            where = (0.145, 0, 0), (QUARTER, 0, 0)
            elements.append(joint(f'module_{i - 1}_to_{i}', *ends, *where))
    return urdf(*elements)


CHAINS = {
    'reu': reu(),
    'sea': sea(),
    'rsnake': rsnake(),
    **{f'random_{seed}': random_urdf(seed) for seed in range(8)},
    **{f'root_{seed}': random_urdf(8 + seed, root=seed % 5) for seed in range(1, 15)},
}
each_chain = pytest.mark.parametrize('text', CHAINS.values(), ids=CHAINS.keys())


def frames_by_hand(text, angles):
    """Return the frames of all links in that of the root: products of what the URDF says."""
    root, frames = ElementTree.fromstring(text), {}
    joints = {each.find('child').get('link'): each for each in root.findall('joint')}

    def frame(name):
        if name not in joints:
            return np.eye(4)
        if name not in frames:
            found, step, turn = joints[name], np.eye(4), np.eye(4)
            if (origin := found.find('origin')) is not None:
                step[:3, 3] = [float(x) for x in origin.get('xyz').split()]
                rpy = [float(x) for x in origin.get('rpy', '0 0 0').split()]
                step[:3, :3] = Rotation.from_euler('xyz', rpy).as_matrix()
            if found.get('type') != 'fixed':
                axis = np.array([float(x) for x in found.find('axis').get('xyz').split()])
                angle = angles.get(found.get('name'), 0.0) / np.linalg.norm(axis)
                turn[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
            frames[name] = frame(found.find('parent').get('link')) @ step @ turn
        return frames[name]

    return {each.get('name'): frame(each.get('name')) for each in root.findall('link')}


def frames_of(robot, angles):
    """Return the frames of the links of a robot in that of the base."""
    columns = np.array([angles[name] for name in robot.axis_names])
    q = chain_coordinates(robot, robot.by_joint(columns, 0.0))
    R, frames = rotation_matrices(q[:, 3:]), np.tile(np.eye(4), (len(q), 1, 1))
    frames[:, :3, :3] = R @ robot.chain.frame
    frames[:, :3, 3] = q[:, :3] + np.einsum('ijk,ik->ij', R, robot.chain.frame_place)
    frames = np.linalg.inv(frames[robot.base_link]) @ frames
    return dict(zip((each.name for each in robot.links), frames, strict=True))


def postures(robot, count=5):
    rng = np.random.default_rng(count)
    for _ in range(count):
        yield dict(
            zip(robot.axis_names, rng.uniform(-1.5, 1.5, len(robot.axis_names)), strict=True)
        )


@each_chain
def test_kinematics_are_products_of_the_frames_of_the_urdf(text):
    robot = robot_from(text)
    for angles in postures(robot):
        expected = frames_by_hand(text, angles)
        for name, frame in frames_of(robot, angles).items():
            assert np.abs(frame - expected[name]).max() < 1e-14


@each_chain
def test_kinematics_are_those_of_an_independent_reader(text):
    # MuJoCo takes the root for the world.
    mujoco = pytest.importorskip('mujoco')
    robot, root = robot_from(text), ElementTree.fromstring(text)
    compiler = ElementTree.SubElement(ElementTree.SubElement(root, 'mujoco'), 'compiler')
    compiler.attrib.update(fusestatic='false', boundmass='1e-3', boundinertia='1e-6')
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding='unicode'))
    data = mujoco.MjData(model)
    first = robot.links[robot.base_link].name
    parts = frames_by_hand(text, {})
    for angles in postures(robot):
        for name, angle in angles.items():
            data.joint(name).qpos = angle
        mujoco.mj_kinematics(model, data)
        for name, frame in frames_of(robot, angles).items():
            if name != first:
                expected = parts[first][:3, :3].T @ (data.body(name).xpos - parts[first][:3, 3])
                assert np.abs(frame[:3, 3] - expected).max() < 1e-12
                turn = parts[first][:3, :3].T @ data.body(name).xmat.reshape(3, 3)
                assert np.abs(frame[:3, :3] - turn).max() < 1e-12


@each_chain
def test_masses_are_those_of_an_independent_reader(text):
    mujoco = pytest.importorskip('mujoco')
    root = ElementTree.fromstring(text)
    # With a free root MuJoCo keeps it, and merges what is fixed.
    root.append(ElementTree.Element('link', name='free_world'))
    above = {each.find('child').get('link') for each in root.findall('joint')}
    top = next(each.get('name') for each in root.findall('link') if each.get('name') not in above)
    free = ElementTree.SubElement(root, 'joint', name='free', type='floating')
    ElementTree.SubElement(free, 'parent', link='free_world')
    ElementTree.SubElement(free, 'child', link=top)
    compiler = ElementTree.SubElement(ElementTree.SubElement(root, 'mujoco'), 'compiler')
    compiler.attrib.update(fusestatic='true', boundmass='1e-12', boundinertia='1e-15')
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding='unicode'))
    for found in robot_from(text).links:
        body = model.body(found.name)
        R = rotation_matrices(body.iquat)
        assert found.mass == pytest.approx(body.mass[0], rel=1e-10)
        assert np.abs(found.center_of_mass - body.ipos).max() < 1e-12
        assert np.abs(found.tensor - R @ np.diag(body.inertia) @ R.T).max() < 1e-13


@pytest.mark.parametrize('name', ['reu', 'sea', 'rsnake'])
def test_robots_of_the_package_move_as_such_a_urdf(name):
    robot = from_mapping(Robot, read_mapping(CONFIG / f'{name}.yaml'), name)
    modules = len(robot.joints) + (name != 'sea')
    text = {'reu': reu, 'sea': sea, 'rsnake': rsnake}[name](modules)
    first = {'reu': 'in_0', 'sea': 'base', 'rsnake': 'module_0'}[name]
    other = robot_from(text, base=first)
    assert robot.axis_names == other.axis_names
    for angles in postures(robot):
        frames = frames_of(robot, angles).values()
        for frame, expected in zip(frames, frames_of(other, angles).values(), strict=True):
            assert np.abs(frame - expected).max() < 1e-14


@pytest.mark.parametrize('pitch', [-QUARTER, -1.57, -1.0, 0.0, 0.5, QUARTER - 1e-6, QUARTER])
def test_angles_of_a_rotation_give_it_back_at_any_pitch(pitch):
    for roll, yaw in np.random.default_rng(3).uniform(-3, 3, (20, 2)):
        R = roll_pitch_yaw((roll, pitch, yaw))
        assert np.abs(roll_pitch_yaw(angles_of(R)) - R).max() < 1e-15


@each_chain
def test_the_published_description_has_all_frames_of_the_urdf(text):
    # Those of fixed parts, such as an IMU, and of the root; a frame in a joint with two axes is
    # replaced.
    robot = robot_from(text)
    published = robot_description(robot)
    base = robot.link_names[robot.base_link]
    for angles in postures(robot, 2):
        frames, expected = (frames_by_hand(each, angles) for each in (published, text))
        known = {name for name in expected if not name.startswith('cross_')}
        assert known <= {*frames}
        back = np.linalg.inv(expected[base])
        for name in known:
            assert np.abs(frames[name] - back @ expected[name]).max() < 1e-14
    again = robot_of(published)
    assert again.link_names == robot.link_names and again.axis_names == robot.axis_names
    names = [[frame.name for frame in link.frames] for link in robot.links]
    assert [[frame.name for frame in link.frames] for link in again.links] == names


# ---- links --------------------------------------------------------------------------------------


def test_what_is_fixed_has_the_mass_and_inertia_of_both():
    # Two parts of 1 and 3 kg at 0.4 m along x; the second one is turned about z by 90 degrees.
    light, heavy = ('ixx="1e-3" iyy="2e-3" izz="2.5e-3" ixy="0" ixz="0" iyz="0"', FINE)
    turned = link('b', 3.0, light, origin=at((0, -0.1, 0)))
    text = urdf(link('a', 1.0, heavy), turned, fixed('a', 'b', (0.3, 0, 0), (0, 0, QUARTER)))
    (found,) = robot_from(text).links
    assert found.name == 'a'
    assert found.mass == 4.0
    assert found.center_of_mass == pytest.approx((0.3, 0.0, 0.0), abs=1e-16)
    across = 1.0 * 3.0 / 4.0 * 0.4**2
    moments = 1e-3 + 2e-3, 1e-3 + 1e-3 + across, 1e-3 + 2.5e-3 + across
    assert found.inertia == pytest.approx((*moments, 0, 0, 0), abs=1e-16)


def test_a_link_without_fixed_parts_stays_as_it_is_to_the_bit():
    rng = np.random.default_rng(2)
    place = rng.uniform(-0.1, 0.1, 3)
    inertia = 'ixx="7.1e-4" iyy="8.3e-4" izz="9.7e-4" ixy="1.1e-5" ixz="2.3e-5" iyz="-3.1e-5"'
    (found,) = robot_from(urdf(link('a', 0.1, inertia, at(place)))).links
    assert found.mass == 0.1
    assert found.center_of_mass == tuple(place)
    assert found.inertia == (7.1e-4, 8.3e-4, 9.7e-4, 1.1e-5, 2.3e-5, -3.1e-5)


def test_shapes_of_fixed_parts_are_moved_and_those_to_look_at_are_not_taken():
    seen = shape('<box size="9 9 9"/>', kind='visual')
    text = urdf(
        link('a', shapes=shape(SPHERE, at((0.01, 0, 0))) + seen),
        link('b', shapes=shape('<capsule radius="0.02" length="0.2"/>', at((0, 0, 0.1)))),
        link('c', None, shapes=seen),
        fixed('a', 'b', (0.3, 0, 0), (0, QUARTER, 0)),
        fixed('b', 'c'),
    )
    first, second = robot_from(text).links[0].shapes
    assert (first.radius, first.start, first.end) == (0.05, (0.01, 0.0, 0.0), None)
    assert second.radius == 0.02
    assert second.start == pytest.approx((0.3, 0, 0), abs=1e-16)
    assert second.end == pytest.approx((0.5, 0, 0), abs=1e-16)


TOUCHING = {
    # geometry: radius, half of the axis, which coordinate it is along
    '<sphere radius="0.3"/>': (0.3, None, None),
    '<cylinder radius="0.1" length="0.5"/>': (0.1, 0.15, 2),
    '<cylinder radius="0.1" length="0.15"/>': (0.1, None, None),
    '<cylinder radius="0.1" length="0.2"/>': (0.1, None, None),
    '<capsule radius="0.1" length="0.5"/>': (0.1, 0.25, 2),
    '<box size="0.2 0.6 0.3"/>': (0.125, 0.175, 1),
    '<box size="0.2 0.2 0.2"/>': (0.1, None, None),
}


@pytest.mark.parametrize('kind', ['collision', 'visual'])
@pytest.mark.parametrize('geometry', TOUCHING)
def test_shapes_touch_as_capsules(geometry, kind):
    radius, half, along = TOUCHING[geometry]
    place = np.array([0.1, 0.2, 0.3])
    text = urdf(link('a', 10.0, HUGE.replace('100', '0.1'), '', shape(geometry, at(place), kind)))
    (found,) = robot_from(text).links[0].shapes
    assert found.radius == pytest.approx(radius, rel=1e-15)
    if half is None:
        assert found.end is None
        assert found.start == tuple(place)
        return
    step = half * np.eye(3)[along]
    assert found.start == pytest.approx(tuple(place - step), rel=1e-15)
    assert found.end == pytest.approx(tuple(place + step), rel=1e-15)


def capsule_moments(r, L):
    """Return volume and moments across and along of a capsule, by integration over slices."""

    def width(z):
        return math.sqrt(max(0.0, r * r - max(0.0, abs(z) - L / 2) ** 2))

    def integral(function):
        pairs = (-L / 2 - r, -L / 2), (-L / 2, L / 2), (L / 2, L / 2 + r)
        return sum(quad(function, *pair, epsabs=1e-16)[0] for pair in pairs)

    volume = integral(lambda z: math.pi * width(z) ** 2)
    along = integral(lambda z: math.pi / 2 * width(z) ** 4)
    across = integral(lambda z: math.pi * width(z) ** 2 * (width(z) ** 2 / 4 + z * z))
    return volume, across, along


def uniform_moments(geometry):
    """Return moments of inertia of a solid of 2 kg about its center."""
    if geometry.startswith('<capsule'):
        volume, across, along = capsule_moments(0.1, 0.5)
        return np.array([across, across, along]) * 2.0 / volume
    return {
        '<box size="0.2 0.6 0.3"/>': np.array([0.45, 0.13, 0.4]) / 6,
        '<cylinder radius="0.1" length="0.5"/>': np.array([0.28, 0.28, 0.06]) / 6,
        '<sphere radius="0.3"/>': np.full(3, 0.072),
    }[geometry]


@pytest.mark.parametrize('given', [HUGE, HUGE.replace('ixx="100"', 'ixx="0"'), 'mass only'])
@pytest.mark.parametrize(
    'geometry',
    [
        '<box size="0.2 0.6 0.3"/>',
        '<cylinder radius="0.1" length="0.5"/>',
        '<sphere radius="0.3"/>',
        '<capsule radius="0.1" length="0.5"/>',
    ],
)
def test_inertias_that_cannot_be_are_those_of_uniform_solids(geometry, given):
    origin, where = at((0.5, 0, 0), (0.3, 0.2, 0.1)), at((0.1, 0.2, 0.3), (QUARTER, 0, 0))
    text = urdf(link('a', 2.0, given, origin, shape(geometry, where)))
    if given == 'mass only':
        text = text.replace('<inertia mass only/>', '')
    assert 'link a' in refusal(text) and 'replace_inertia' in refusal(text)
    found = robot_of_urdf(text, replace_inertia=True)
    (made,) = Robot(**found.values).links
    assert (made.mass, made.center_of_mass) == (2.0, (0.5, 0.0, 0.0))
    xx, yy, zz = uniform_moments(geometry)
    assert made.inertia == pytest.approx((xx, zz, yy, 0, 0, 0), rel=1e-12, abs=1e-16)
    assert found.remarks == ('inertia of uniform solids: a',)


def test_two_solids_have_the_inertia_of_one_body():
    # Halves of a box of 0.2 m, 0.4 m and 0.3 m, next to each other.
    half = '<box size="0.2 0.2 0.3"/>'
    text = urdf(
        link('a', 2.0, HUGE, '', shape(half, at((0, 0.1, 0))) + shape(half, at((0, 0.3, 0))))
    )
    (found,) = robot_from(text, replace_inertia=True).links
    expected = [0.25 / 6, 0.13 / 6, 0.2 / 6, 0, 0, 0]
    assert found.inertia == pytest.approx(expected, rel=1e-14, abs=1e-16)


def test_inertias_that_can_be_are_not_replaced():
    text = urdf(link('a'), link('b', 1.0, HUGE), joint('j', 'a', 'b'))
    links = robot_from(text, replace_inertia=True).links
    assert links[0].inertia == (1e-3, 1e-3, 1e-3, 0, 0, 0)
    assert links[1].inertia == pytest.approx((1e-3, 1e-3, 1e-3, 0, 0, 0))  # 2/5 m r^2


def test_masses_that_no_metal_has_are_remarked():
    text = urdf(link('a', 1.0, FINE, '', shape('<cylinder radius="0.006" length="0.02"/>')))
    found = robot_of_urdf(text, replace_inertia=True)
    assert found.remarks[1] == 'masses that no metal has in such a shape: 1 kg of a'


# ---- meshes -------------------------------------------------------------------------------------


def write_box(path):
    """Write a box of 200, 600 and 300 mm, which begins at x = 100 mm."""
    trimesh = pytest.importorskip('trimesh')
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box(bounds=[[100, 0, 0], [300, 600, 300]]).export(path)


@pytest.mark.parametrize(
    'file', ['box.stl', 'meshes/box.obj', 'package://robots/meshes/box.stl', 'file://{}/box.ply']
)
def test_meshes_are_boxes(file, tmp_path):
    folder = tmp_path / 'robots' / 'urdf'
    file = file.format(tmp_path)
    name = file.rpartition('://')[2]
    write_box(tmp_path / name if '://' in file else folder / name)
    text = urdf(link('a', 2.0, HUGE, '', shape(MESH.format(file))))
    (found,) = robot_from(text, folder=folder, replace_inertia=True).links
    assert found.inertia[:3] == pytest.approx(uniform_moments('<box size="0.2 0.6 0.3"/>'))
    (made,) = found.shapes
    assert made.radius == pytest.approx(0.125)
    assert made.start == pytest.approx((0.2, 0.125, -0.15))
    assert made.end == pytest.approx((0.2, 0.475, -0.15))


@pytest.mark.parametrize('folder', [True, False])
@pytest.mark.parametrize(
    'file', ['none.stl', 'package://no/none.stl', 'http://host/none.stl', 'x' * 300]
)
def test_meshes_that_are_not_there_touch_nothing(file, folder, tmp_path):
    found = robot_of_urdf(
        urdf(link('a', shapes=shape(MESH.format(file)))), folder=tmp_path if folder else None
    )
    assert not found.values['links'][0].shapes
    assert found.remarks[0].startswith('shapes that touch nothing: of link a')
    text = urdf(link('a', 1.0, HUGE, '', shape(MESH.format(file)))).replace('<inertia ', '<other ')
    message = refusal(text, folder=tmp_path if folder else None, replace_inertia=True)
    assert message.startswith('robot_description: link a must have shapes for an inertia')


def test_meshes_that_cannot_be_read_touch_nothing(tmp_path):
    pytest.importorskip('trimesh')
    (tmp_path / 'broken.stl').write_text('solid')
    (tmp_path / 'unknown.xyz9').write_text('what')
    for file in ('broken.stl', 'unknown.xyz9'):
        text = urdf(link('a', shapes=shape(MESH.format(file))))
        (remark,) = robot_of_urdf(text, folder=tmp_path).remarks
        assert remark.startswith(
            f'shapes that touch nothing: of link a the mesh {file}, which is '
        )


def test_a_flat_mesh_has_no_volume(tmp_path):
    write_box(tmp_path / 'box.stl')
    geometry = MESH.format('box.stl').replace('-0.001', '0')
    (remark,) = robot_of_urdf(urdf(link('a', shapes=shape(geometry))), folder=tmp_path).remarks
    assert remark.endswith('the mesh box.stl, which has no volume')


def test_without_trimesh_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / 'box.stl').write_text('solid')
    monkeypatch.setitem(sys.modules, 'trimesh', None)
    text = urdf(link('a', shapes=shape(MESH.format('box.stl'))))
    (remark,) = robot_of_urdf(text, folder=tmp_path).remarks
    assert remark.endswith("which needs trimesh: pip install 'snake_sim_ros[urdf]'")


# ---- joints -------------------------------------------------------------------------------------


def limit(**values):
    return f'<limit {" ".join(f"{key}={str(value)!r}" for key, value in values.items())}/>'


def three(first, second, kinds=('revolute', 'revolute')):
    """Return a chain of three links, with further elements of both joints."""
    ends = (('a', 'b'), ('b', 'c'))
    return urdf(
        *(link(name) for name in 'abc'),
        *(
            joint(f'j{k}', *ends[k], kind=kinds[k], limit=more)
            for k, more in enumerate((first, second))
        ),
    )


SAME = limit(lower=-1, upper=1, velocity=3, effort=2)
LIMITS = [
    (
        SAME,
        SAME,
        {'joint_limit': 1.0, 'joint_rate_limit': 3.0, 'yaw_torque_limit': (2.0, 2.0)},
        [],
    ),
    (
        SAME,
        limit(lower=-0.5, upper=1.2, velocity=2, effort=4),
        {'joint_limit': 1.2, 'joint_rate_limit': 3.0, 'pitch_torque_limit': (2.0, 4.0)},
        [],
    ),
    (
        SAME,
        limit(lower=-2, upper=2, effort=0, velocity=0),
        {'joint_limit': 2.0, 'joint_rate_limit': 3.0, 'yaw_torque_limit': (2.0, 1e30)},
        [],
    ),
    (
        SAME,
        limit(lower=-1, upper=3.14, velocity=3, effort=2),
        {'joint_limit': 3.0},
        ['joints turn by up to 3 rad to a side, not -1 to 3.14 of j1'],
    ),
    (
        '',
        '<dynamics damping="0.1" friction="0.2"/>',
        {'joint_limit': 3.0, 'joint_friction': (0, 0.2), 'joint_viscous_friction': (0, 0.1)},
        ['joints turn by up to 3 rad to a side, not -inf to inf of j0, -inf to inf of j1'],
    ),
    (
        SAME,
        limit(upper=1),
        {'joint_limit': 1.0},
        [],
    ),
]


@pytest.mark.parametrize('first, second, expected, remarks', LIMITS)
def test_limits_and_friction(first, second, expected, remarks):
    found = robot_of_urdf(three(first, second))
    for name, value in expected.items():
        assert found.values[name] == value
    assert list(found.remarks) == remarks
    torques = found.values.get('yaw_torque_limit')
    assert torques == found.values.get('pitch_torque_limit')
    assert (torques is None) == (first == '')
    assert ('joint_rate_limit' in found.values) == (first != '')


def test_continuous_joints_have_the_largest_limit():
    text = three(SAME, limit(velocity=3, effort=2), kinds=('revolute', 'continuous'))
    found = robot_of_urdf(text)
    assert found.values['joint_limit'] == 3.0
    assert '-inf to inf of j1' in found.remarks[0]
    assert Robot(**found.values).limits.high.tolist() == [[1.0, 3.0], [3.0, 3.0]]


def test_a_joint_that_cannot_reach_its_limits_is_refused():
    assert refusal(three(SAME, limit(lower=3.1, upper=6))) == (
        'robot_description: joint j1 must turn within +-3 rad, got angles of 3.1 to 6 rad'
    )


OWN = [  # limits of angle, velocity and effort, friction and damping
    (-1.0, 1.0, 3.0, 2.0, 0.1, 0.0),
    (-0.5, 1.2, 2.0, 4.0, 0.2, 0.03),
    (0.25, 2.75, 1.5, 9.0, 0.0, 0.01),
    (-2.9, 0.0, 0.5, 0.125, 0.05, 0.02),
]


def elements(low, high, rate, effort, friction, damping):
    own = limit(lower=low, upper=high, velocity=rate, effort=effort)
    return {'limit': own, 'more': f'<dynamics friction="{friction}" damping="{damping}"/>'}


def own_limits(text):
    """Return what a URDF says of its joints that turn, by name."""
    rows = {}
    for each in ElementTree.fromstring(text).findall('joint[@type="revolute"]'):
        found, dynamics = each.find('limit').attrib, each.find('dynamics')
        row = [found[key] for key in ('lower', 'upper', 'velocity', 'effort')]
        of = {} if dynamics is None else dynamics.attrib
        rows[each.get('name')] = (*map(float, row), *(float(of.get(k, 0)) for k in KEYS))
    return rows


KEYS = 'friction', 'damping'


def test_each_axis_keeps_its_limits_there_and_back():
    # The first joint has one axis, which points down, the next one two, the last one lies across.
    text = urdf(
        *(link(name) for name in 'abcd'),
        link('cross', None),
        joint('one', 'a', 'b', axis=(0, 0, -1), **elements(*OWN[0])),
        joint('two', 'b', 'cross', **elements(*OWN[1])),
        joint('three', 'cross', 'c', (0, 0, 0), axis=(0, -1, 0), **elements(*OWN[2])),
        joint('four', 'c', 'd', axis=(0, 1, 0), **elements(*OWN[3])),
    )
    expected = dict(zip(('one', 'two', 'three', 'four'), OWN, strict=True))
    assert own_limits(text) == expected
    found = robot_of_urdf(text)
    assert not found.remarks
    robot = Robot(**found.values)
    assert own_limits(robot_description(robot)) == expected
    again = robot_of(robot_description(robot))
    assert again.joints == robot.joints and own_limits(robot_description(again)) == expected
    for name in ('torque_limit', 'friction', 'viscous_friction'):
        assert (again.per_joint(name) == robot.per_joint(name)).all()
    # With the signs of the model, in which axes point up and to the left.
    assert robot.limits.low.tolist() == [[-1.0, -2.9], [-0.5, -2.75], [-2.9, -2.9]]
    assert robot.limits.high.tolist() == [[1.0, 2.9], [1.2, -0.25], [2.9, 0.0]]
    assert robot.limits.rate.tolist() == [[3.0, 3.0], [2.0, 1.5], [3.0, 0.5]]


def test_limits_of_the_robot_hold_for_all_axes():
    robot = Robot(**robot_of_urdf(three(SAME, limit(lower=-0.5, upper=2, velocity=2))).values)
    tight = replace(robot, joint_limit=0.75, joint_rate_limit=2.5)
    assert tight.limits.low[:, 0].tolist() == [-0.75, -0.5]
    assert tight.limits.high[:, 0].tolist() == [0.75, 0.75]
    assert tight.limits.rate[:, 0].tolist() == [2.5, 2.0]
    assert scene_from_text(scene_to_text(Scene(robot=tight))).robot == tight


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'lower': 0.5, 'upper': 0.25}, 'lower of j must be below upper, .*got 0.5 and 0.25 rad'),
        ({'lower': 1.0}, 'both within joint_limit, got 1 and 0.7854 rad'),
        ({'upper': (0.1, 0.2)}, 'upper of j must be one number or one for each of its 1 axes'),
        ({'upper': 3.1}, 'upper must be at most 3 rad, got 3.1 rad'),
        ({'rate': 0.0}, 'rate must be above 0 rad/s'),
    ],
)
def test_limits_that_cannot_be_are_refused(given, message):
    links = tuple(Link(name=name, shapes=(Shape(),)) for name in 'ab')
    with pytest.raises(ParameterError, match=message):
        Robot(links=links, joints=(Joint(name='j', origin=(0.1, 0.0, 0.0), **given),))


def test_an_axis_is_x_by_default():
    text = urdf(link('a'), link('b'), joint('j', 'a', 'b')).replace(
        '<axis xyz="0.0 0.0 1.0"/>', ''
    )
    assert robot_from(text).joints[0].axis == (1.0, 0.0, 0.0)


def cardan(place=(0, 0, 0), angles=(0, 0, 0), axis=(0, 1, 0), middle=None):
    more = '<dynamics friction="{}" damping="0"/>'
    strong = '<limit lower="-1" upper="1" effort="9" velocity="3"/>'
    return urdf(
        link('a'),
        link('cross', None) if middle is None else middle,
        link('b'),
        joint('one', 'a', 'cross', more=more.format(1)),
        joint('two', 'cross', 'b', place, angles, axis, more=more.format(2), limit=strong),
    )


@pytest.mark.parametrize('middle', [None, link('cross', 0.0, HUGE), link('cross', 0.0, '')])
def test_two_joints_at_one_point_are_one_with_two_axes(middle):
    if middle:
        middle = middle.replace(shape(), '').replace('<inertia />', '')
    found = robot_of_urdf(cardan(angles=(0, QUARTER, 0), middle=middle))
    (made,) = found.values['joints']
    assert made.axis_names == ('one', 'two')
    assert made.origin == (0.1, 0.0, 0.0)
    assert made.axis == pytest.approx((-1, 0, 0), abs=1e-15)  # z of the link before it
    assert made.second_axis == (0.0, 1.0, 0.0)
    assert found.values['yaw_torque_limit'] == (2.0,)
    assert found.values['pitch_torque_limit'] == (9.0,)
    assert found.values['joint_friction'] == (1.0, 2.0)
    assert not found.remarks
    assert Robot(**found.values).chain.axes.tolist() == [[0, 0], [0, 1]]


@pytest.mark.parametrize(
    'more, got',
    [
        ({'place': (0.02, 0, 0)}, 'a distance of 0.02 m and 90 degrees'),
        ({'axis': (0, 1, 0.1)}, 'a distance of 0 m and 84.2894 degrees'),
        ({'angles': (0, 1.57, 0), 'axis': (1, 0, 0)}, '0 m and 179.954 degrees'),
        ({'axis': (0, 0, 0)}, 'a distance of 0 m and 0 degrees'),
    ],
)
def test_frames_between_other_joints_are_refused(more, got):
    message = refusal(cardan(**more))
    assert message.startswith('robot_description: link cross has neither mass nor shapes')
    assert 'joints one and two must be at one point and at right angles' in message
    assert got in message and 'give the link a mass' in message


# ---- where a chain begins -----------------------------------------------------------------------


def test_a_chain_begins_in_the_frame_of_its_base():
    text, angles = reu(), {f'reu_joint_out2in_{k}': 0.3 * k for k in range(3)}
    frames = frames_by_hand(text, angles)
    for base in ('root', 'in_0', 'body_0', 'out_0'):
        robot = robot_from(text, base=base)
        assert robot.links[0].name == base
        assert robot.chain.mass == pytest.approx(np.full(4, 0.113))
        for name, frame in frames_of(robot, angles).items():
            assert np.abs(np.linalg.inv(frames[base]) @ frames[name] - frame).max() < 1e-15
    assert robot_from(text).links[0].name == 'root'


@pytest.mark.parametrize(
    'base, reason',
    [
        ('in_3', "'in_3' is behind a joint; head names the link at the end that comes first"),
        ('in_4', "'in_4' is no link"),
    ],
)
def test_a_base_that_does_not_begin_the_chain_is_refused(base, reason):
    message = refusal(reu(), base=base)
    assert (
        message
        == f'robot_description: base must be one of root, in_0, body_0 and 1 more; {reason}'
    )


ROBOTS = {'single axes': modular_robot(6), 'two axes': aiko_link_by_link(5)}


def numbers_of(chain):
    """Return all numbers of a chain by which it moves and touches, but for those of fast paths."""
    fields = chain.mass, chain.inertia, chain.axes, chain.signs
    fields = *fields, *chain.places, *chain.spheres, *chain.capsules
    return np.hstack([np.ravel(each) for each in fields if not isinstance(each, bool)])


@pytest.mark.parametrize('name', ROBOTS)
def test_a_robot_does_not_depend_on_its_root(name):
    expected = ROBOTS[name]
    for root in range(expected.link_count):
        text = written_from(expected, root)
        robot = robot_from(text, head=expected.link_names[0])
        assert robot.base_link == root and robot.link_names == expected.link_names
        assert robot.axis_names == expected.axis_names
        assert all(joint.backward == (j < root) for j, joint in enumerate(robot.joints))
        # Sums and products of three numbers below 1 m, a few for each of six links.
        assert np.abs(numbers_of(robot.chain) - numbers_of(expected.chain)).max() < 1e-14
        for angles in postures(robot):
            frames = frames_by_hand(text, angles)
            for link_name, frame in frames_of(robot, angles).items():
                assert np.abs(frame - frames[link_name]).max() < 1e-14
        # And so does what is published of it.
        again = robot_of(robot_description(robot))
        assert again.base_link == root and again.link_names == robot.link_names
        assert again.axis_names == robot.axis_names


def test_the_urdf_of_aiko_whose_root_is_in_the_middle_is_aiko():
    aiko = Robot()
    robot = robot_from(robot_description(aiko))
    assert robot.base_link == aiko.middle_link
    assert robot.axis_names == aiko.axis_names and (robot.axis_signs == 1.0).all()
    angles = np.random.default_rng(0).uniform(-0.7, 0.7, (10, 2))
    # Twenty turns, each with a rounding or two, of links 0.12 m long.
    q, expected = (chain_coordinates(each, angles) for each in (robot, aiko))
    assert np.abs(q - q[0] - (expected - expected[0])).max() < 1e-14
    assert np.abs(robot.chain.inertia - aiko.chain.inertia).max() < 1e-18


def test_a_published_robot_may_have_a_base_link():
    text = written_from(modular_robot(4), 1).replace('module_1', 'base_link')
    robot = robot_of(robot_description(robot_from(text)))
    assert robot.link_names == ('module_0', 'base_link', 'module_2', 'module_3')


def test_head_says_which_end_comes_first():
    expected = modular_robot(5)
    names, axes = expected.link_names, expected.axis_names
    text = written_from(expected, 2)
    found = robot_of_urdf(text)
    assert Robot(**found.values).link_names == names
    assert found.remarks == (
        'link module_0 is the first one, as the root is between both ends; head: module_4 turns '
        'the order round',
    )
    for root in range(5):
        text = written_from(expected, root)
        for head in names[0], names[4]:
            found, way = robot_of_urdf(text, head=head), 1 if head == names[0] else -1
            robot = Robot(**found.values)
            assert robot.link_names == names[::way] and robot.axis_names == axes[::way]
            assert robot.link_names[robot.base_link] == names[root] and not found.remarks
            element = f'<snake_sim head="{head}"/></robot>'
            assert robot_of_urdf(text.replace('</robot>', element)) == found
    # A root at an end is first by itself, and needs no remark.
    for root in (0, 4):
        found = robot_of_urdf(written_from(expected, root))
        assert found.values['links'][0].name == names[root] and not found.remarks


@pytest.mark.parametrize('head, got', [('module_1', "'module_1'"), ('head', "'head'")])
def test_a_head_that_is_not_at_an_end_is_refused(head, got):
    assert refusal(written_from(modular_robot(4), 1), head=head) == (
        f'robot_description: head must be a link at an end of the chain, such as module_0 or '
        f'module_3, got {got}'
    )


def test_a_frame_between_two_axes_may_be_the_root():
    text = urdf(
        link('cross', None), *(link(name) for name in 'abcd'),
        joint('one', 'cross', 'b', (0.1, 0.2, 0.3), (1, 2, 3), (0, 0, 1)),
        joint('two', 'cross', 'c', (0.1, 0.2, 0.3), (1, 2, 3), (0, 1, 0)),
        joint('zero', 'b', 'a'), joint('three', 'c', 'd'),
    )  # fmt: skip
    robot = robot_from(text)
    assert robot.link_names == ('a', 'b', 'c', 'd') and robot.base_link == 1
    assert robot.axis_names == ('zero', 'one', 'two', 'three')
    for angles in postures(robot):
        frames = frames_by_hand(text, angles)
        for name, frame in frames_of(robot, angles).items():
            assert np.abs(frame - np.linalg.inv(frames['b']) @ frames[name]).max() < 1e-15
    assert 'got a distance of 0.1 m' in refusal(text.replace('0.1 0.2 0.3', '0.2 0.2 0.3', 1))


@pytest.mark.parametrize('kind', ['floating', 'planar', 'revolute'])
def test_a_robot_is_free_of_a_world_without_mass(kind):
    text = urdf(
        link('world', None), link('a'), link('b'), joint('anchor', 'world', 'a', kind=kind),
        joint('j', 'a', 'b'),
    )  # fmt: skip
    found = robot_of_urdf(text)
    assert [each.name for each in found.values['links']] == ['a', 'b']
    assert found.remarks == (
        'joint anchor is left out: link world has neither mass nor shapes, so that the robot is '
        'free',
    )
