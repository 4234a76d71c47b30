# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Chains of any links and joints against MuJoCo: poses, Jacobians, inertia and accelerations.

MuJoCo gets the records of links and joints, in the frames that these have, and nothing of the
geometry that is computed from them. It has generalized coordinates, from the first link on.
"""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from random_states import jointed_links, random_chain

from snake_sim_ros import Scene, State
from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.dynamics.force_directions import contact_directions, contact_frame
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, make_stepper

mujoco = pytest.importorskip('mujoco')

GRAVITY = (0.7, -1.1, -9.6)
HEIGHT = 10.0  # m, beyond the length of all chains: nothing touches the floor
LIMP = {f'{axis}_{gain}': 0.0 for axis in ('yaw', 'pitch') for gain in ('stiffness', 'damping')}
# Links, and probability that a joint has two axes: 2 to 24 axes.
CHAINS = [
    (2, 1.0), (3, 0.0), (3, 0.5), (3, 1.0), (4, 0.3), (5, 0.3), (5, 1.0), (6, 0.5), (7, 0.0),
    (8, 0.3), (9, 0.5), (11, 0.3), (13, 1.0), (16, 0.3), (20, 0.2), (25, 0.0),
]  # fmt: skip
STRAIGHT = [(5, 0.5), (11, 1.0)]  # the same, see `straight`


class Flight(NamedTuple):
    """A robot without joint torques above the floor, and the same in MuJoCo, with velocities."""

    scene: Scene
    state: State
    R: Array  # (n, 3, 3) link frames B in I
    angle: Array  # (n-1, 2) of the joints, 0 for axes that do not exist [rad]
    model: 'mujoco.MjModel'
    data: 'mujoco.MjData'


def straight(rng, robot):
    """Return the robot with all joints on a line, and axes upright or to the right, as of Aiko."""
    up, right = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)
    links = [replace(link, center_of_mass=(0.05, 0.0, 0.0)) for link in robot.links]
    joints = []
    for joint in robot.joints:
        axes = (up, right) if joint.second_axis else ((up, right)[rng.integers(2)], None)
        place = {'origin': (0.1, 0.0, 0.0), 'rotation': (0.0, 0.0, 0.0)}
        joints.append(replace(joint, **place, axis=axes[0], second_axis=axes[1]))
    found = replace(robot, links=tuple(links), joints=tuple(joints))
    assert found.chain.places.aligned
    return found


def text_of(numbers):
    """Return numbers as text, without loss."""
    return ' '.join(repr(float(number)) for number in numbers)


def mjcf_of(robot):
    """Return links and joints as MJCF, from their records alone."""
    inside = ''
    for i in reversed(range(robot.link_count)):
        link, place, moves = robot.links[i], '', '<freejoint/>'
        if i > 0:
            joint = robot.joints[i - 1]
            place = f' pos="{text_of(joint.origin)}" euler="{text_of(joint.rotation)}"'
            axes = [axis for axis in (joint.axis, joint.second_axis) if axis is not None]
            moves = ''.join(f'<joint type="hinge" axis="{text_of(axis)}"/>' for axis in axes)
        inertia = (
            f'<inertial pos="{text_of(link.center_of_mass)}" mass="{link.mass!r}" '
            f'fullinertia="{text_of(link.inertia)}"/>'
        )
        inside = f'<body name="{link.name}"{place}>{moves}{inertia}{inside}</body>'
    # Roll, pitch and yaw of a URDF turn about axes that stay: for MuJoCo these are in capitals.
    return (
        '<mujoco><compiler angle="radian" eulerseq="XYZ"/>'
        f'<option gravity="{text_of(GRAVITY)}"/><worldbody>{inside}</worldbody></mujoco>'
    )


def of_links(function, model, data, R):
    """Return (linear in I, angular in B) of all centers of mass, shape (n, 6)."""
    found = np.zeros((len(R), 6))
    for body, row in enumerate(found, 1):
        function(model, data, mujoco.mjtObj.mjOBJ_BODY, body, row, 0)
    return np.hstack([found[:, 3:], np.einsum('iba,ib->ia', R, found[:, :3])])


@pytest.fixture(scope='module', params=list(enumerate(CHAINS + STRAIGHT)), ids=str)
def flight(request):
    """Return a random chain in a random posture, with velocities of up to 3 m/s and 3 rad/s."""
    seed, (links, two_axes) = request.param
    rng = np.random.default_rng(seed)
    robot = replace(random_chain(rng, links, two_axes), **LIMP)
    if seed >= len(CHAINS):
        robot = straight(rng, robot)
    chain = robot.chain
    angle = rng.uniform(-1.3, 1.3, (links - 1, 2)) * chain.places.present
    q = jointed_links(rng, robot, angle).q + HEIGHT * np.eye(7)[2]
    R = rotation_matrices(q[:, 3:])
    model = mujoco.MjModel.from_xml_string(mjcf_of(robot))
    data = mujoco.MjData(model)
    data.qpos[:3] = q[0, :3] + R[0] @ chain.frame_place[0]
    mujoco.mju_mat2Quat(data.qpos[3:7], (R[0] @ chain.frame[0]).ravel())
    data.qpos[7:] = chain.signs * angle[tuple(chain.axes.T)]
    data.qvel[:] = rng.uniform(-3.0, 3.0, model.nv)
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    u = of_links(mujoco.mj_objectVelocity, model, data, R)
    scene = Scene(robot=robot, gravity=GRAVITY, level='spatial')
    return Flight(scene, State(q, u), R, angle, model, data)


def steps(scene, state, count):
    """Return the velocities after each of some steps, and the stepper."""
    stepper, history = make_stepper(scene), empty_history(scene)
    none, found = np.zeros((1, scene.robot.link_count - 1, 2)), []
    for _ in range(count):
        state, history, report = stepper.advance(state, history, none, none)
        assert report.contacts == 0
        found.append(state.u)
    return found, stepper


def links_by_rates(flight):
    """
    Return twists and inertias of all links about O, per velocity of MuJoCo.

    A step from rest leaves the geometry of its start. Its own coordinates are the twist of the
    middle link and the rates of the axes, from which follow the velocities of MuJoCo: that of the
    origin of the first link, in I, its angular velocity in its own frame, and the rates.

    Returns
    -------
    S : ndarray, shape (n, 6, 6 + a)
        Twists, for a axes.
    inertia : ndarray, shape (n, 6, 6)
    center : ndarray, shape (n, 3)

    """
    chain, n = flight.scene.robot.chain, flight.scene.robot.link_count
    _, stepper = steps(flight.scene, State(flight.state.q, np.zeros((n, 6))), 1)
    work, a = stepper.work, len(chain.axes)
    S = np.zeros((n, 6, 6 + a))
    S[:, :, :6] = np.eye(6)
    for column, ((j, k), sign) in enumerate(zip(chain.axes, chain.signs, strict=True), 6):
        beyond = slice(j + 1, n) if j >= n // 2 else slice(0, j + 1)
        S[beyond, :, column] = sign * work.chain.axis[j, k]
    T = np.eye(6 + a)
    arm = work.center[0] + flight.R[0] @ chain.frame_place[0]
    T[:3] = S[0, 3:] + np.cross(S[0, :3], arm, axis=0)
    T[3:6] = (flight.R[0] @ chain.frame[0]).T @ S[0, :3]
    return S @ np.linalg.inv(T), work.chain.bare, work.center


# ---- tests --------------------------------------------------------------------------------------


def test_links_are_where_mujoco_has_them(flight):
    # Positions up to 10 m have a rounding of 2e-15 m, and every joint adds to it. From the middle
    # link on, the coordinates are those of `bdf2`.
    chain, n = flight.scene.robot.chain, flight.scene.robot.link_count
    q, data = flight.state.q, flight.data
    pose, from_middle = np.array([*data.subtree_com[1], *q[n // 2, 3:]]), np.zeros((n, 7))
    kinematics.chain_coordinates(chain.places, chain.mass, pose, flight.angle, from_middle)
    for each in (q, from_middle):
        R = rotation_matrices(each[:, 3:])
        place = each[:, :3] + np.einsum('iab,ib->ia', R, chain.frame_place)
        assert np.abs(place - data.xpos[1:]).max() < 1e-12
        assert np.abs(R @ chain.frame - data.xmat[1:].reshape(-1, 3, 3)).max() < 1e-12
        assert np.abs(each[:, :3] - data.xipos[1:]).max() < 1e-12
    # Every link but the first and the last is along its e_z, from one joint to the next.
    along = np.diff(data.xpos[2:], axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    assert np.abs(flight.R[1:-1, :, 2] - along).max(initial=0.0) < 1e-12


def test_mass_matrix_is_that_of_mujoco(flight):
    # MuJoCo turns the inertia of a link to its principal axes, with a rest of up to 1e-12 of it.
    S, inertia, _ = links_by_rates(flight)
    found, expected = np.einsum('ixa,ixy,iyb->ab', S, inertia, S), np.zeros(2 * [flight.model.nv])
    mujoco.mj_fullM(flight.model, flight.data, expected)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_velocities_of_contact_points_are_those_of_mujoco(flight):
    robot, data, R = flight.scene.robot, flight.data, flight.R
    S, _, center = links_by_rates(flight)
    U = np.hstack([
        S[:, 3:] + np.cross(S[:, :3], center[:, :, None], axis=1),
        np.swapaxes(R, 1, 2) @ S[:, :3],
    ]).reshape(6 * robot.link_count, -1)  # fmt: skip
    assert np.abs(U @ data.qvel - flight.state.u.ravel()).max() < 1e-9
    # First come the first spheres of all links, then all second ones, and so on.
    ends = [[(s.radius, p) for s in link.shapes for p in (s.start, s.end)] for link in robot.links]
    spheres = sorted((k, i, *end) for i, each in enumerate(ends) for k, end in enumerate(each))
    W_N, W_T, _ = contact_directions(robot, R)
    assert W_N.shape[1] == len(spheres)
    for a, (_, i, radius, place) in enumerate(spheres):
        point = data.xpos[i + 1] + data.xmat[i + 1].reshape(3, 3) @ place - [0.0, 0.0, radius]
        J = np.zeros((3, flight.model.nv))
        mujoco.mj_jac(flight.model, data, J, None, point, i + 1)
        e_x, e_y = contact_frame(R, i)
        assert np.abs(W_N[:, a] @ U - J[2]).max() < 1e-9
        assert np.abs(W_T[:, 2 * a] @ U - e_x @ J).max() < 1e-9
        assert np.abs(W_T[:, 2 * a + 1] @ U - e_y @ J).max() < 1e-9


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_accelerations_in_flight_are_those_of_mujoco(flight, method):
    # What a step adds to the velocities is a series in dt. Velocities of `newton` belong to the
    # middle of the step before, so that those of the start take half a step: the second step is
    # the first that counts. Of four dt, each half of the one before, the terms up to dt^3 go.
    # Left are terms of dt^4, 16 times less for half of all dt. With the largest dt and links that
    # turn by w = 16 rad/s, (w dt)^4 / 2^6 of the accelerations are 1e-9; for `newton` it is twice
    # as much, for `bdf2` 30 times. Rounding leaves eps times 10 m/s times the ratio of inertias,
    # 1e2, in velocities: 2e-9 m/s^2 at the least dt, where accelerations are 3 m/s^2 and more.
    found = []
    for k in range(4):
        scene = replace(flight.scene, method=method, dt=1e-3 / 2**k)
        (first, second), _ = steps(scene, flight.state, 2)
        found.append((second - first) / scene.dt)
    for order in (1, 2, 3):
        power = 2**order
        found = [(power * b - a) / (power - 1) for a, b in pairwise(found)]
    # MuJoCo has accelerations as they are felt in a fall: without gravity.
    felt = of_links(mujoco.mj_objectAcceleration, flight.model, flight.data, flight.R)
    fall = np.array([*GRAVITY, 0.0, 0.0, 0.0])
    assert np.abs(found[0] - fall - felt).max() < 1e-7 * np.abs(felt).max()
