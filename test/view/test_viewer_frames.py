# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the viewer shows, without a browser."""

from dataclasses import replace
import math
import socket
import sys

import numpy as np
import pytest

from snake_sim_ros import ParameterError, Robot
from snake_sim_ros.scene.posture import chain_coordinates, gaps, joint_angles
from snake_sim_ros.scene.rotations import about, FLAT, product, rotation_matrices
from snake_sim_ros.view import page as viewer
from snake_sim_ros.view.frames import (
    arrows,
    at_rest,
    capsule,
    curves,
    FARTHEST,
    floor_point,
    force_scale,
    placed,
    PLOTTED_TIME,
    TraceBuffer,
)

ROBOT = Robot()


def frame(time, **changes):
    known = {name: np.full((10, 2), time) for name in ('joint_angle', 'joint_torque')}
    return replace(at_rest(ROBOT), time=time, **{**known, **changes})


def test_posture_of_joint_angles_is_where_odometry_says():
    rng = np.random.default_rng(7)
    q = chain_coordinates(ROBOT, rng.uniform(-0.5, 0.5, (10, 2)))
    turn = product(about(2, 1.1), about(1, 0.3))
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T + [1.0, 2.0, 3.0]
    q[:, 3:] = product(turn, q[:, 3:])
    # base_link has x toward link 1, against e_z, and z along e_y of the middle link.
    middle = q[ROBOT.middle_link]
    base = product(product(middle[3:], FLAT * [1, -1, -1, -1]), about(2, math.pi))
    axes = rotation_matrices(base), rotation_matrices(middle[3:])
    np.testing.assert_allclose(axes[0][:, 0], -axes[1][:, 2], atol=1e-15)
    np.testing.assert_allclose(axes[0][:, 2], axes[1][:, 1], atol=1e-15)
    found = placed(ROBOT, joint_angles(q), (middle[:3], base))
    np.testing.assert_allclose(found[:, :3], q[:, :3], atol=1e-13)
    R = rotation_matrices(found[:, 3:])
    np.testing.assert_allclose(R, rotation_matrices(q[:, 3:]), atol=1e-13)


def test_a_ray_meets_the_floor():
    eye, place = np.array([1.0, -2.0, 3.0]), np.array([4.0, 2.0, 0.0])
    for length in (1e-3, 1.0, 20.0):
        np.testing.assert_allclose(floor_point(eye, length * (place - eye)), place[:2], rtol=1e-15)
    np.testing.assert_array_equal(floor_point(eye, [0.0, 0.0, -1.0]), eye[:2])


@pytest.mark.parametrize(
    'ray',
    [
        ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]),  # parallel
        ([0.0, 0.0, 1.0], [1.0, 0.0, 0.1]),  # the floor is behind the eye
        ([0.0, 0.0, 0.0], [1.0, 0.0, -1.0]),
        ([0.0, 0.0, 1.0], [1.0, 0.0, -0.99 / FARTHEST]),  # too far away
        ([0.0, 0.0, 1.0], [1.0, 0.0, -5e-324]),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 0.0]),
    ],
)
def test_a_ray_that_misses_the_floor_is_no_point(ray):
    assert floor_point(*ray) is None


def test_posture_without_odometry_is_on_the_floor_along_x():
    angle = np.tile([0.2, 0.05], (10, 1))
    q = placed(ROBOT, angle, None)
    np.testing.assert_allclose(joint_angles(q), angle, atol=1e-13)
    assert gaps(ROBOT, q).min() == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(q[:, :2].mean(axis=0), 0.0, atol=1e-15)
    assert q[-1, 0] > q[0, 0]
    assert q[-1, 1] == pytest.approx(q[0, 1], abs=1e-15)


def test_recorder_keeps_a_window_and_begins_again():
    trace_buffer = TraceBuffer(ROBOT)
    for time in np.arange(0.0, PLOTTED_TIME + 5.0, 0.05):
        place = at_rest(ROBOT).position + np.array([time, 0.0, 0.0])
        trace_buffer.add(frame(time, position=place))
    trace = trace_buffer.trace
    assert trace.time[-1] - trace.time[0] == pytest.approx(PLOTTED_TIME, abs=0.05)
    assert trace.joint_angle.shape == (len(trace.time), 10, 2)
    assert trace.path[0, 0] == pytest.approx(0.0, abs=1e-12)  # the path is that of all the time
    assert trace_buffer.distance(frame(0.0, position=place)) == pytest.approx(14.95)
    trace_buffer.add(frame(1.0))
    assert trace_buffer.trace.time.tolist() == [1.0] and len(trace_buffer.trace.path) == 1


def test_curves_begin_when_all_of_them_are_known():
    trace_buffer = TraceBuffer(ROBOT)
    for k in range(6):
        told = np.full((10, 2), 0.1 if k >= 2 else math.nan)
        trace_buffer.add(frame(0.1 * k, reference=told))
    time, named = curves(trace_buffer.trace, 'angle', 4)
    np.testing.assert_allclose(time, [0.2, 0.3, 0.4, 0.5])
    assert list(named) == ['yaw', 'pitch', 'yaw, commanded', 'pitch, commanded']
    np.testing.assert_allclose(named['yaw'], np.degrees(time))
    np.testing.assert_allclose(named['pitch, commanded'], math.degrees(0.1))
    time, named = curves(trace_buffer.trace, 'torque', -2)
    assert len(time) == 6 and list(named) == [f'joint {j}' for j in range(1, 11)]


def test_what_is_not_known_has_no_curve():
    trace_buffer = TraceBuffer(ROBOT)
    trace_buffer.add(frame(0.0, joint_torque=np.full((10, 2), math.nan)))
    assert list(curves(trace_buffer.trace, 'angle', 0)[1]) == ['yaw', 'pitch']
    assert curves(trace_buffer.trace, 'torque', 0)[1] == {}


def test_recorder_of_a_single_link():
    robot = Robot(link_count=1)
    trace_buffer = TraceBuffer(robot)
    trace_buffer.add(at_rest(robot))
    assert trace_buffer.trace.joint_angle.shape == (1, 0, 2)


def test_arrows_split_a_force():
    point, force = np.array([[1.0, 2.0, 0.0]]), np.array([[3.0, 4.0, 5.0]])
    along, upward = arrows(point, force, 0.1)
    np.testing.assert_allclose(along[0], [[1.0, 2.0, 0.0], [1.3, 2.4, 0.0]])
    np.testing.assert_allclose(upward[0], [[1.0, 2.0, 0.0], [1.0, 2.0, 0.1]])
    assert force.tolist() == [[3.0, 4.0, 5.0]]


def test_scale_of_forces_is_a_round_number():
    assert force_scale(ROBOT) == pytest.approx(0.05)  # 3 * 1.342 m / 73.6 N = 0.0547 m/N
    heavy = replace(ROBOT, link_mass=100 * ROBOT.link_mass)
    assert force_scale(heavy) == pytest.approx(5e-4)


def test_capsule_is_closed_and_looks_outward():
    radius, offset = 0.05, 0.04
    vertices, faces = capsule(radius, offset)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6
    exact = math.pi * radius**2 * (2 * offset + 4 / 3 * radius)
    # A polygon of 24 corners has sin(2 pi/24)/(2 pi/24) = 0.989 of the area of its circle.
    assert 0.96 * exact < volume < exact
    beyond = np.maximum(np.abs(vertices[:, 2]) - offset, 0.0)
    np.testing.assert_allclose(
        np.hypot(np.hypot(vertices[:, 0], vertices[:, 1]), beyond), radius, atol=1e-15
    )


@pytest.mark.parametrize(
    ('host', 'port', 'sentence'),
    [
        ('127.0.0.1', -1, 'port must be 0 (any free one) to 65535, got -1'),
        ('nowhere.invalid', 0, "host must be an address of this machine, got 'nowhere.invalid'"),
        ('192.0.2.1', 0, "host must be an address of this machine, got '192.0.2.1'"),
    ],
)
def test_unusable_address(host, port, sentence):
    with pytest.raises(
        ParameterError, match='^' + sentence.replace('(', r'\(').replace(')', r'\)')
    ):
        viewer.check_address(host, port)


def test_port_in_use():
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        with pytest.raises(ParameterError, match=f'^port {port} of 127.0.0.1 is in use; choose'):
            viewer.check_address('127.0.0.1', port)


def test_no_browser_is_said(monkeypatch, capsys):
    page = type('Page', (), {'url': 'http://127.0.0.1:1'})()
    monkeypatch.setattr(viewer.webbrowser, 'open', lambda url: False)
    viewer.announce(page, open_browser=True)
    assert capsys.readouterr().out.splitlines() == [
        'the viewer is at http://127.0.0.1:1',
        'there is no browser here; open http://127.0.0.1:1 in one yourself',
    ]


def test_viser_that_is_missing_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, 'viser', None)
    with pytest.raises(ParameterError, match=r"viser, .*: pip install 'snake_sim_ros\[viewer\]'$"):
        viewer.Page('', '127.0.0.1', 0)


def test_camera_of_a_narrow_window_has_the_robot_above_the_sheet():
    position, fov = np.array([-1.0, -3.0, 2.0]), math.radians(50)
    look_at = viewer.lowered(position, np.zeros(3), fov)
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    across = np.cross(ahead, (0.0, 0.0, 1.0))
    up = np.cross(across / np.linalg.norm(across), ahead)
    # A place of the window is the tangent of an angle over that of half the field of view.
    height = (-position @ up) / (-position @ ahead) / math.tan(fov / 2)
    # The middle of the window is at 0, of its upper 60 % at 0.4.
    assert height == pytest.approx(0.4, abs=0.03)
    assert -position @ across == pytest.approx(0.0, abs=1e-12)
