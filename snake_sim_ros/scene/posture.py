# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Posture of the robot: joint angles from coordinates, and coordinates from joint angles."""

from functools import lru_cache
import math
from typing import Any

import numpy as np

from snake_sim_ros.scene import gait, obstacles
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Robot, Scene
from snake_sim_ros.scene.rotations import (
    about,
    along_link,
    CONJUGATE,
    FLAT,
    product,
    product_of_numbers,
    rotation_matrices,
)


def joint_angles(q: Array, robot: Robot | None = None) -> Array:
    """
    Return the cardan angles of every joint, eq. (66) in a form that is regular at all angles.

    Between the frames of the joint in both links, ``R_i^T R_{i+1} = R_y(yaw) R_x(pitch)``.

    Parameters
    ----------
    q : ndarray, shape (..., n, 7)
        Link centers [m, frame I] and Euler parameters, scalar first.
    robot : Robot, optional
        Default: one whose joints have the frames of their links, as Aiko.

    Returns
    -------
    ndarray, shape (..., n-1, 2)
        Yaw alpha_h about e_y of link i, pitch alpha_v about e_x of link i+1 [rad].

    """
    inner, outer = joint_frames(rotation_matrices(q[..., 3:]), robot)
    R = np.swapaxes(inner, -1, -2) @ outer
    yaw = np.arctan2(-R[..., 2, 0], R[..., 0, 0])
    pitch = np.arctan2(-R[..., 1, 2], R[..., 1, 1])
    return np.stack([yaw, pitch], axis=-1)


def joint_frames(R: Array, robot: Robot | None) -> tuple[Array, Array]:
    """Return the frames of all joints in I, in the link before and in the one after them."""
    if robot is None or robot.chain.places.aligned:
        return R[..., :-1, :, :], R[..., 1:, :, :]
    places = robot.chain.places
    return R[..., :-1, :, :] @ places.inner, R[..., 1:, :, :] @ places.outer


def joint_rates(q: Array, u: Array, robot: Robot | None = None) -> Array:
    """
    Return the rates of `joint_angles`, shape (..., n-1, 2) [rad/s].

    Parameters
    ----------
    q : ndarray, shape (..., n, 7)
        Link centers [m, frame I] and Euler parameters, scalar first.
    u : ndarray, shape (..., n, 6)
        Velocity [m/s, frame I] and angular velocity [rad/s, frame B] of every link.
    robot : Robot, optional
        As there.

    """
    R = rotation_matrices(q[..., 3:])
    omega = np.einsum('...ij,...j->...i', R, u[..., 3:])
    omega = omega[..., 1:, :] - omega[..., :-1, :]
    inner, outer = joint_frames(R, robot)
    axes = np.stack([inner[..., 1], outer[..., 0]], axis=-2)
    return np.asarray(np.einsum('...ak,...k->...a', axes, omega))


def own_poses(robot: Robot, q: Array) -> tuple[Array, Array]:
    """
    Return the poses of the links' own frames: those in which a robot of single links is given.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (..., n, 7)
        Link centers [m, frame I] and Euler parameters, scalar first.

    Returns
    -------
    position : ndarray, shape (..., n, 3)
        [m, frame I]
    orientation : ndarray, shape (..., n, 4)
        Euler parameters, scalar first.

    """
    chain, R = robot.chain, rotation_matrices(q[..., 3:])
    position = q[..., :3] + np.einsum('...ij,...j->...i', R, chain.frame_place)
    return position, product(q[..., 3:], np.broadcast_to(chain.frame_turn, q[..., 3:].shape))


def from_own_poses(
    robot: Robot, position: Array, orientation: Array, links: Any = slice(None)
) -> Array:
    """Return coordinates (..., k, 7) from poses of some links as `own_poses` returns them."""
    turn, place = robot.chain.frame_turn[links], robot.chain.frame_place[links]
    back = np.broadcast_to(turn * CONJUGATE, orientation.shape)
    p = product(orientation, back)
    center = position - np.einsum('...ij,...j->...i', rotation_matrices(p), place)
    return np.concatenate([center, p], axis=-1)


def pose_of_middle(
    robot: Robot, q: Array, position: Array, orientation: Array
) -> tuple[Array, Array]:
    """
    Return the pose of the middle link when the own frame of the base is moved to a pose.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (n, 7)
        Coordinates before the robot is moved as a rigid body.
    position, orientation : ndarray, shapes (3,) and (4,)
        [m, frame I], Euler parameters, scalar first.

    """
    place, own = own_poses(robot, q)
    turn = product(orientation, own[robot.base_link] * CONJUGATE)
    middle = q[robot.middle_link]
    arm = rotation_matrices(turn) @ (middle[:3] - place[robot.base_link])
    return position + arm, product(turn, middle[3:])


def gaps(robot: Robot, q: Array) -> Array:
    """
    Return the gap functions of the contact spheres, eqs. (9), (10).

    A gap is the height of the lowest point of a sphere over the floor z = 0, positive when apart.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (..., n, 7)
        Link centers [m, frame I] and Euler parameters, scalar first.

    Returns
    -------
    ndarray, shape (..., m)
        Gaps [m] of all spheres; of Aiko those of the front spheres, then those of the rear ones.

    """
    spheres, up = robot.chain.spheres, rotation_matrices(q[..., 3:])[..., 2, :]
    arm = np.einsum('...ak,ak->...a', up[..., spheres.link, :], spheres.place)
    return np.asarray(q[..., spheres.link, 2] + arm - spheres.radius)


def center_of_mass(robot: Robot, q: Array) -> Array:
    """Return the center of mass of the robot [m, frame I], shape (..., 3)."""
    mass = robot.chain.mass
    return np.asarray(np.einsum('i,...ij->...j', mass, q[..., :3]) / mass.sum())


def chain_coordinates(robot: Robot, angle: Array) -> Array:
    """
    Return the coordinates of the robot with given joint angles, link 1 flat at the origin.

    Parameters
    ----------
    robot : Robot
    angle : ndarray, shape (n-1, 2)
        Yaw and pitch of every joint [rad].

    Returns
    -------
    ndarray, shape (n, 7)
        Link centers [m, frame I] and Euler parameters, scalar first.

    """
    if robot.links:
        return _chain_coordinates(robot, angle)
    half = (robot.per_link('link_length') / 2).tolist()
    p = tuple(FLAT.tolist())
    x, y, z, e_z = 0.0, 0.0, 0.0, along_link(p)
    q = [(x, y, z, *p)]
    for i, (yaw, pitch) in enumerate(angle.tolist()):
        turn = math.cos(yaw / 2), 0.0, math.sin(yaw / 2), 0.0
        bend = math.cos(pitch / 2), math.sin(pitch / 2), 0.0, 0.0
        p = product_of_numbers(product_of_numbers(p, turn), bend)
        before, e_z = e_z, along_link(p)
        x = x + half[i] * before[0] + half[i + 1] * e_z[0]
        y = y + half[i] * before[1] + half[i + 1] * e_z[1]
        z = z + half[i] * before[2] + half[i + 1] * e_z[2]
        q.append((x, y, z, *p))
    return np.array(q)


def _chain_coordinates(robot: Robot, angle: Array) -> Array:
    """Return `chain_coordinates` of a robot whose links are given one by one."""
    places, present = robot.chain.places, robot.chain.places.present
    q = np.zeros((robot.link_count, 7))
    q[0, 3:] = FLAT
    for j, (yaw, pitch) in enumerate(present * angle):
        p = product(product(q[j, 3:], places.inner_turn[j]), about(1, yaw))
        back = places.outer_turn[j] * CONJUGATE
        q[j + 1, 3:] = product(product(p, about(0, pitch)), back)
        before, after = rotation_matrices(q[j : j + 2, 3:])
        q[j + 1, :3] = q[j, :3] + before @ places.distal[j] - after @ places.proximal[j + 1]
    return q


def initial_angles(scene: Scene) -> Array:
    """
    Return the joint angles (yaw, pitch) at the start of a scene, shape (n-1, 2) [rad].

    They are those of the gait at t = 0, unless `scene.start` has others.
    """
    angle, _ = gait.reference(scene.gait, 0.0, scene.robot.link_count - 1)
    for axis, given in enumerate((scene.start.yaw, scene.start.pitch)):
        if given is not None:
            angle[:, axis] = given
    return angle


def initial_coordinates(scene: Scene) -> Array:
    """
    Return the coordinates at the start of a scene, shape (n, 7).

    Joints have their `initial_angles`. By default, the centroid of the links is above the origin,
    their principal axis is along e_x of I, and the lowest sphere touches the ground.

    Raises
    ------
    ParameterError
        If a link is inside a peg or inside another link.

    """
    angle, start = initial_angles(scene), scene.start
    found, lowest = _centered_coordinates(scene.robot, angle.tobytes())
    q = found.copy()
    if start.tilt != 0.0:
        turn = about(1, -start.tilt)
        q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
        q[:, 3:] = product(turn, q[:, 3:])
        q[:, :2] -= q[:, :2].mean(axis=0)
        lowest = gaps(scene.robot, q).min()
    if start.heading != 0.0:
        turn = about(2, start.heading)
        q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
        q[:, 3:] = product(turn, q[:, 3:])
    if any(start.position):
        q[:, :2] += start.position
    q[:, 2] += obstacles.lift_onto_ground(scene, q) if scene.ground.heights else -lowest
    if start.height:
        q[:, 2] += start.height
    if scene.pegs.x or scene.self_contact:
        refuse_overlap(scene, q)
    return q


@lru_cache(maxsize=64)
def _centered_coordinates(robot: Robot, angles: bytes) -> tuple[Array, float]:
    """
    Return the coordinates with their centroid at the origin, and the lowest of their `gaps`.

    Many scenes of a study begin in the same posture. `angles` are those of `chain_coordinates`.
    """
    q = chain_coordinates(robot, np.frombuffer(angles).reshape(-1, 2))
    q[:, :2] -= q[:, :2].mean(axis=0)
    (xx, xy), (_, yy) = q[:, :2].T @ q[:, :2]
    turn = about(2, -math.atan2(2 * xy, xx - yy) / 2)
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    return q, float(gaps(robot, q).min())


def refuse_overlap(scene: Scene, q: Array) -> None:
    """Raise an error if a link is inside a peg or another link."""
    first = obstacles.first_peg(scene)
    gap = obstacles.contact_geometry(scene, q)[0][first:]
    if gap.min(initial=0.0) >= 0.0:
        return
    a = first + int(gap.argmin())
    depth, (link, other) = -gap.min(), obstacles.contact_links(scene)[a] + 1
    if other > 0:
        raise ParameterError(
            f'links must be apart at the start: link {link} is {depth:.3g} m inside link {other}'
        )
    peg = (a - first) // len(scene.robot.chain.capsules.link)
    x, y, radius = scene.pegs.axes[peg]
    raise ParameterError(
        f'pegs must be beside the robot at its start: peg {peg + 1} at ({x:g}, {y:g}) m with '
        f'radius {radius:g} m is {depth:.3g} m inside link {link}'
    )
