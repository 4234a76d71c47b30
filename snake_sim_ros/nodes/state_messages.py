# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Messages of a robot's state.

The names are ``link_1`` to ``link_n`` along the robot and ``joint_1_yaw``, ``joint_1_pitch``,
... in this order. The frames ``world`` and ``odom`` coincide and have z up. The frame
``base_link`` is that of the middle link, turned around: x points forward, toward link 1. A link
frame on the wire has x along the link toward the next one, y to the left and z up when the link
lies flat (REP 103); its axes are e_z, e_x and e_y of the paper's frame B. Quaternions on the
wire are x y z w, with w >= 0. Joint angles have the paper's signs: a positive yaw turns the next
link left, a positive pitch turns it down.

A robot whose links are given one by one has the names of its links and joints, and its links have
their own frames. Its base is the root of its URDF, if it comes from one.
"""

from collections.abc import Sequence
import math
from typing import Any

from geometry_msgs.msg import Pose, PoseArray
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from snake_sim_ros.nodes.messages import BASE, ODOM, WORLD
from snake_sim_ros.recording.from_messages import TO_WIRE
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.scene.posture import own_poses
from snake_sim_ros.scene.rotations import rotation_matrices, WIRE_AXES
from snake_sim_ros.stepping.sampling import joint_motion
from snake_sim_ros.stepping.state import State

TURNED = np.array([-1.0, -1.0, 1.0])  # signs of such components in a frame turned around
ENCAPSULATION = 4  # bytes at the begin of a message, which name its encoding
MARK = math.pi  # a number that can be found in the bytes of a message


def base_name(robot: Robot) -> str:
    """Return the name of the frame at the root of the tree of links."""
    return robot.link_names[robot.base_link] if robot.links else BASE


class SerializedMessage:
    """
    A message as the bytes that the middleware sends; its numbers are overwritten in place.

    rclpy takes twenty times longer to make the bytes of nested messages than to send them, so the
    bytes are made once. The place of a number in them is found by its first value.

    Parameters
    ----------
    message : Any
        A message that begins with a stamp or a header. Its texts and lengths stay as they are.

    Attributes
    ----------
    stamp : ndarray of int32, shape (2,)
        Seconds and nanoseconds.

    """

    def __init__(self, message: Any) -> None:
        self._data = bytearray(serialize_message(message))
        self.stamp = np.frombuffer(self._data, np.int32, 2, offset=ENCAPSULATION)

    def numbers(self, first: float, *shape: int) -> Array:
        """Return a view, to be written, of the numbers that begin with one of a given value."""
        count = math.prod(shape)
        place = self._data.index(np.float64(first).tobytes()) if count else 0
        return np.frombuffer(self._data, count=count, offset=place).reshape(shape)

    def __bytes__(self) -> bytes:
        """Return the bytes, which a publisher takes in place of the message."""
        return bytes(self._data)


class StateMessages:
    """
    The state messages of one robot, made once and filled again for every state.

    Parameters
    ----------
    robot : Robot
    frame_prefix : str, optional
        Prefix of the names of the frames ``odom`` and ``base_link``.

    Attributes
    ----------
    joint_states, link_poses, odom, clock : SerializedMessage
    base : ndarray, shape (7,)
        Pose of ``base_link``: position [m, frame world], quaternion x y z w.

    """

    def __init__(self, robot: Robot, frame_prefix: str = '') -> None:
        self.robot, self.middle, n = robot, robot.middle_link, robot.link_count
        self.resolution = robot.encoder_resolution
        names, first = list(robot.axis_names), (MARK, 2 * MARK, 3 * MARK)
        position, velocity, effort = ([mark] * len(names) for mark in first)
        self.joint_states = SerializedMessage(
            JointState(name=names, position=position, velocity=velocity, effort=effort)
        )
        self.angle, self.rate, self.torque = (
            self.joint_states.numbers(mark, len(names)) for mark in first
        )

        poses = PoseArray(poses=[Pose() for _ in range(n)])
        poses.header.frame_id, poses.poses[0].position.x = WORLD, MARK
        self.link_poses = SerializedMessage(poses)
        self.poses = self.link_poses.numbers(MARK, n, 7)

        odom = Odometry(child_frame_id=frame_prefix + base_name(robot))
        odom.header.frame_id = frame_prefix + ODOM
        odom.pose.pose.position.x, odom.twist.twist.linear.x = MARK, 2 * MARK
        self.odom = SerializedMessage(odom)
        self.base, self.twist = self.odom.numbers(MARK, 7), self.odom.numbers(2 * MARK, 6)

        self.clock = SerializedMessage(Clock())

    def fill(
        self, nanoseconds: int, state: State, torque: Array,
        motion: tuple[Array, Array] | None = None,
    ) -> None:  # fmt: skip
        """
        Write a state into all messages.

        Parameters
        ----------
        nanoseconds : int
            Simulated time [ns].
        state : State
        torque : ndarray, shape (n-1, 2)
            Joint torque (yaw, pitch) [N m].
        motion : tuple of ndarray, shapes (n-1, 2), optional
            Joint angles [rad] and rates [rad/s], if they are known. Default: those of the state.

        """
        for serialized in (self.joint_states, self.link_poses, self.odom, self.clock):
            serialized.stamp[:] = divmod(nanoseconds, 1_000_000_000)
        robot = self.robot
        angle, rate = motion or joint_motion(robot, state.q[None], state.u[None])
        self.angle[:], self.rate[:] = robot.by_axis(angle), robot.by_axis(rate)
        if self.resolution > 0.0:
            self.angle[:] = self.resolution * np.floor(self.angle / self.resolution + 0.5)
        self.torque[:] = robot.by_axis(torque)

        if robot.links:
            self._fill_own_frames(state)
            return
        quaternion = state.q[:, 3:] @ TO_WIRE
        self.poses[:, :3] = state.q[:, :3]
        self.poses[:, 3:] = np.where(quaternion[:, 3:] < 0.0, -quaternion, quaternion)

        # The base is the middle link, turned by half a turn about its z axis.
        x, y, z, w = quaternion[self.middle].tolist()
        turned = (y, -x, w, -z) if z <= 0.0 else (-y, x, -w, z)
        self.base[:3], self.base[3:] = self.poses[self.middle, :3], turned
        u = state.u[self.middle]
        self.twist[:3] = seen_from(turned, u[:3].tolist())
        self.twist[3:] = u[3:][WIRE_AXES] * TURNED

    def _fill_own_frames(self, state: State) -> None:
        """Write the poses of the links' own frames, of which one is the base."""
        base, (position, orientation) = self.robot.base_link, own_poses(self.robot, state.q)
        self.poses[:, :3] = position
        self.poses[:, 3:] = np.where(orientation[:, :1] < 0.0, -orientation, orientation)[
            :, [1, 2, 3, 0]
        ]
        self.base[:] = self.poses[base]
        chain, u, R = self.robot.chain, state.u[base], rotation_matrices(state.q[base, 3:])
        linear = u[:3] + np.cross(R @ u[3:], R @ chain.frame_place[base])
        self.twist[:3] = seen_from(self.base[3:].tolist(), linear.tolist())
        self.twist[3:] = chain.frame[base].T @ u[3:]


def seen_from(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Return the components of a world vector in a frame turned by a quaternion x y z w."""
    x, y, z, w = quaternion
    a, b, c = vector
    p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a - w * p + y * r - z * q, b - w * q + z * p - x * r, c - w * r + x * q - y * p
