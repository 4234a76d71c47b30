# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the viewer shows, as arrays: the robot at one time, its recent past, and shapes of links.

Nothing here depends on a browser or on ROS. All poses are in frame I, z up. Link frames are
frames B.
"""

from collections import deque
from dataclasses import dataclass
import math
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from snake_sim_ros.scene.chain import Capsules, Mesh, roll_pitch_yaw
from snake_sim_ros.scene.checked_records import cut, LONGEST_PATH, LONGEST_REASON
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.scene.posture import chain_coordinates, gaps, pose_of_middle
from snake_sim_ros.scene.rotations import about, CONJUGATE, FLAT, product, rotation_matrices

PLOTTED_TIME = 10.0  # s, length of the time that plots show
TRACE_PERIOD = 0.025  # s between two samples that are plotted
PATH_STEP = 0.01  # m between two points of a path
PATH_LENGTH = 2000  # points
WEIGHT_ARROW = 3.0  # weight of the robot as an arrow, in lengths of the robot
UPWARD_SCALE = 0.2  # of vertical forces, which are larger by one over the friction coefficient
AXES = 'yaw', 'pitch'
FARTHEST = 100.0  # m, from the eye to a point of the floor that is picked
SEGMENTS, RINGS = 24, 6  # of a capsule: around it, and of each of its ends


@dataclass(frozen=True)
class Frame:
    """The robot at one time; angles, torques and references are NaN where they are not known."""

    time: float  # [s]
    position: Array  # (n, 3) link centers [m, frame I]
    orientation: Array  # (n, 4) Euler parameters of the link frames B, scalar first
    joint_angle: Array  # (n-1, 2) yaw and pitch [rad]
    joint_torque: Array  # (n-1, 2) of yaw and pitch [N m]
    reference: Array  # (n-1, 2) of the joint angles [rad]
    points: Array  # (k, 3) of the contacts, as `contact_forces` returns them [m]
    forces: Array  # (k, 3) of the contacts, likewise [N]


@dataclass(frozen=True)
class Trace:
    """The recent past of the robot."""

    time: Array  # (m,) [s]
    joint_angle: Array  # (m, n-1, 2) as in `Frame`
    reference: Array
    joint_torque: Array
    path: Array  # (k, 3) of the middle link [m]


class TraceBuffer:
    """Keeps the trace of successive frames; it begins again when time goes back."""

    def __init__(self, robot: Robot) -> None:
        self._middle, self._joints = robot.middle_link, robot.link_count - 1
        self._samples: deque[tuple[float, Array]] = deque()
        self._path: deque[Array] = deque(maxlen=PATH_LENGTH)
        self.begin: Array | None = None  # where the middle link was first [m]

    def add(self, frame: Frame) -> None:
        """Add a frame, unless it is less than TRACE_PERIOD later than the last one."""
        if self._samples and frame.time < self._samples[-1][0]:
            self._samples.clear()
            self._path.clear()
            self.begin = None
        here = frame.position[self._middle]
        if self.begin is None:
            self.begin = here
        if not self._path or np.linalg.norm(here - self._path[-1]) >= PATH_STEP:
            self._path.append(here)
        if self._samples and frame.time - self._samples[-1][0] < TRACE_PERIOD:
            return
        joints = np.stack([frame.joint_angle, frame.reference, frame.joint_torque])
        self._samples.append((frame.time, joints))
        while self._samples[0][0] < frame.time - PLOTTED_TIME:
            self._samples.popleft()

    def distance(self, frame: Frame) -> float:
        """Return the distance of the middle link from its first position [m]."""
        begin = frame.position[self._middle] if self.begin is None else self.begin
        return float(np.linalg.norm(frame.position[self._middle] - begin))

    @property
    def trace(self) -> Trace:
        """The trace up to now."""
        time = np.array([time for time, _ in self._samples])
        joints = np.array([joints for _, joints in self._samples])
        joints = joints.reshape(len(time), 3, self._joints, 2)
        angle, reference, torque = np.moveaxis(joints, 1, 0)
        return Trace(time, angle, reference, torque, np.array(self._path).reshape(-1, 3))


def placed(robot: Robot, angle: Array, base: tuple[Array, Array] | None) -> Array:
    """
    Return the coordinates of a robot with known joint angles, shape (n, 7).

    Parameters
    ----------
    robot : Robot
    angle : ndarray, shape (n-1, 2)
        (yaw, pitch) [rad]
    base : tuple of ndarray, optional
        Position [m] and Euler parameters of `base_link`, the middle link turned around, with x
        forward and z up; of a robot whose links are given one by one, those of its base link.
        Without it the robot lies on the floor around the origin, along x.

    """
    q = chain_coordinates(robot, angle)
    middle, center = q[robot.middle_link].copy(), q[:, :3].mean(axis=0)
    if base is not None and robot.links:
        place, turned = pose_of_middle(robot, q, *base)
        turn = product(turned, middle[3:] * CONJUGATE)
        fixed = middle[:3]
    elif base is None:
        along = q[-1, :2] - q[0, :2]
        turn, place, fixed = about(2, -math.atan2(along[1], along[0])), np.zeros(3), center
    else:
        inverse = middle[3:] * CONJUGATE
        turn = product(product(product(base[1], about(2, math.pi)), FLAT), inverse)
        place, fixed = base[0], middle[:3]
    q[:, :3] = place + (q[:, :3] - fixed) @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    if base is None:
        q[:, 2] -= gaps(robot, q).min()
    return q


def at_rest(robot: Robot) -> Frame:
    """Return the frame of a robot before anything is known: straight, on the floor."""
    q = placed(robot, np.zeros((robot.link_count - 1, 2)), None)
    unknown, none = np.full((robot.link_count - 1, 2), math.nan), np.zeros((0, 3))
    return Frame(0.0, q[:, :3], q[:, 3:], unknown, unknown, unknown, none, none)


def curves(trace: Trace, what: str, joint: int) -> tuple[Array, dict[str, Array]]:
    """
    Return the curves of a plot, from the first time on at which all of them are known.

    Parameters
    ----------
    trace : Trace
    what : str
        ``angle`` [deg], with the reference of the joint if it is known, or ``torque`` [N m].
    joint : int
        Index of a joint, for both its axes; -1 is yaw of all joints, -2 pitch of all joints.

    Returns
    -------
    time : ndarray, shape (m,)
        [s]
    curves : dict
        Name -> values, shape (m,).

    """
    values = np.degrees(trace.joint_angle) if what == 'angle' else trace.joint_torque
    if joint < 0:
        named = {f'joint {j + 1}': values[:, j, -1 - joint] for j in range(values.shape[1])}
    else:
        named = {name: values[:, joint, k] for k, name in enumerate(AXES)}
        if what == 'angle':
            commanded = np.degrees(trace.reference[:, joint])
            named |= {f'{name}, commanded': commanded[:, k] for k, name in enumerate(AXES)}
    named = {name: curve for name, curve in named.items() if np.isfinite(curve[-1:]).all()}
    missing = np.isnan(list(named.values())).any(axis=0)
    first = int(np.flatnonzero(missing)[-1]) + 1 if missing.any() else 0
    return trace.time[first:], {name: curve[first:] for name, curve in named.items()}


def force_scale(robot: Robot) -> float:
    """Return the scale of the arrows of forces [m/N]: 1, 2 or 5 times a power of ten."""
    weight = 9.81 * robot.per_link('link_mass').sum()
    wanted = WEIGHT_ARROW * robot.per_link('link_length').sum() / weight
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(power * digit for digit in (1, 2, 5) if power * digit <= wanted)


def arrows(points: Array, forces: Array, scale: float) -> tuple[Array, Array]:
    """
    Return the start and end points of the arrows of forces, along the floor and upward.

    Parameters
    ----------
    points, forces : ndarray, shape (k, 3)
        [m], [N]
    scale : float
        [m/N]

    Returns
    -------
    along, upward : ndarray, shape (k, 2, 3)
        Arrows of the horizontal parts, and of the vertical parts on a scale that is smaller by
        UPWARD_SCALE [m].

    """
    along, upward = scale * forces, UPWARD_SCALE * scale * forces
    along[:, 2] = upward[:, :2] = 0.0
    return np.stack([points, points + along], axis=1), np.stack([points, points + upward], axis=1)


def floor_point(eye: ArrayLike, direction: ArrayLike) -> Array | None:
    """
    Return where a ray from an eye meets the floor, x and y [m, frame I].

    None if it does not, as a ray that is parallel to the floor or leads away from it, or if that
    is farther than FARTHEST.
    """
    x, y, z = map(float, np.asarray(eye))
    along, across, upward = map(float, np.asarray(direction))
    if not z * upward < 0.0:
        return None
    reach = -z / upward
    distance = reach * math.hypot(along, across, upward)
    return np.array([x + reach * along, y + reach * across]) if distance <= FARTHEST else None


def seen_meshes(robot: Robot) -> list[tuple[Array, Array, Array]]:
    """
    Return the meshes as which links are seen: their links, vertices (v, 3) [m] and triangles.

    Vertices are in the own frames of the links, see `own_frames`. Each mesh is read once, for all
    links that have it. One that cannot be read is left out, with a warning.
    """
    links: dict[Mesh, list[int]] = {}
    for i, link in enumerate(robot.links):
        for mesh in link.meshes:
            links.setdefault(mesh, []).append(i)
    read, seen = {file: _read_mesh(file) for file in {mesh.file for mesh in links}}, []
    for mesh, having in links.items():
        vertices, faces = read[mesh.file]
        if len(faces):
            vertices = vertices * mesh.scale @ roll_pitch_yaw(mesh.rotation).T + mesh.origin
            seen.append((np.array(having), vertices, faces))
    return seen


def _read_mesh(file: str) -> tuple[Array, Array]:
    """Return vertices and triangles of a file, none if it cannot be read."""
    try:
        import trimesh

        mesh: Any = trimesh.load(file, force='mesh')
        if not len(mesh.faces):
            raise ValueError('it has no triangles')
        return np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    except Exception as error:  # whatever readers of a dozen formats raise, or without trimesh
        reason = cut(str(error), LONGEST_REASON)
        warn(f'the mesh {cut(file, LONGEST_PATH)} is not shown: {reason}', stacklevel=3)
        return np.zeros((0, 3)), np.zeros((0, 3), int)


def own_frames(robot: Robot, position: Array, orientation: Array) -> tuple[Array, Array]:
    """Return origins (n, 3) and Euler parameters (n, 4) of the links' own frames in frame I."""
    chain = robot.chain
    place = np.einsum('ijk,ik->ij', rotation_matrices(orientation), chain.frame_place)
    return position + place, product(orientation, chain.frame_turn)


def bodies_of(robot: Robot) -> Capsules:
    """Return what is drawn of the links: their capsules, or a rod between joints without any."""
    capsules, places = robot.chain.capsules, robot.chain.places
    rows = []
    for i in np.setdiff1d(np.arange(robot.link_count), capsules.link):
        ends = places.proximal[i], places.distal[i]
        if i in (0, robot.link_count - 1):  # which ends at its center
            ends = (np.zeros(3), ends[1] if i == 0 else ends[0])
        way = ends[1] - ends[0]
        length = float(np.linalg.norm(way))
        axis = way / length if length else np.array([0.0, 0.0, 1.0])
        rows.append((i, (ends[0] + ends[1]) / 2, axis, length / 2, 0.0))
    if not rows:
        return capsules
    more = (np.array(column) for column in zip(*rows, strict=True))
    return Capsules(*map(np.concatenate, zip(capsules, more, strict=True)))


def turned_to(axis: Array) -> Array:
    """Return a rotation matrix whose last column is a unit vector, the identity for e_z."""
    if axis[2] == 1.0:
        return np.eye(3)
    other = np.eye(3)[int(np.abs(axis).argmin())]
    across = np.cross(other, axis)
    across /= np.linalg.norm(across)
    return np.column_stack([np.cross(across, axis), across, axis])


def capsule(radius: float, offset: float) -> tuple[Array, Array]:
    """
    Return vertices (v, 3) [m] and triangles (f, 3) of a link in its frame B.

    Parameters
    ----------
    radius : float
        Radius of the spheres at its ends and of the cylinder between them [m].
    offset : float
        Distance of the centers of the spheres from that of the link, along e_z [m].

    """
    half = np.linspace(0.0, math.pi / 2, RINGS + 1)
    polar = np.concatenate([half, half + math.pi / 2])  # from the end in front to the rear one
    center = np.repeat([offset, -offset], RINGS + 1)
    around = np.arange(SEGMENTS) * 2 * math.pi / SEGMENTS
    across = np.sin(polar)[:, None] * np.stack([np.cos(around), np.sin(around)])[:, None, :]
    along = np.broadcast_to((center + radius * np.cos(polar))[:, None], across.shape[1:])
    vertices = np.stack([radius * across[0], radius * across[1], along], axis=-1)
    ring, k = np.indices((len(polar) - 1, SEGMENTS))
    a, b = ring * SEGMENTS + k, ring * SEGMENTS + (k + 1) % SEGMENTS
    c, d = a + SEGMENTS, b + SEGMENTS
    faces = np.concatenate([np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)])
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)
