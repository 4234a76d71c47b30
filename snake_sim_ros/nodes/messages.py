"""
Messages of names, times and states, as pure functions.

Names: ``link_1`` to ``link_n`` along the robot, ``joint_1_yaw``, ``joint_1_pitch``, ... in this
order. Frames: ``world`` and ``odom`` are the same place, with z up; ``base_link`` is the middle
link turned around, with x forward, toward link 1. A link frame on the wire has x along the link
toward the next one, y to the left and z up when the link lies flat (REP 103); its axes are e_z,
e_x and e_y of the paper's frame B. Quaternions on the wire are x y z w, with w >= 0. Joint angles
have the paper's signs: yaw positive turns the next link left, pitch positive turns it down.
"""

from collections.abc import Sequence
import math
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from snake_sim_ros.nodes.command_messages import joint_names
from snake_sim_ros.recording.from_messages import TO_WIRE
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Robot
from snake_sim_ros.stepping.base import State
from snake_sim_ros.stepping.simulation import joint_motion

WORLD, ODOM, BASE = 'world', 'odom', 'base_link'
WIRE_AXES = [2, 0, 1]  # components of a vector in B along x, y, z of the wire frame
TURNED = np.array([-1.0, -1.0, 1.0])  # signs of such components in a frame turned around
ENCAPSULATION = 4  # bytes that tell the encoding of a message
MARK = math.pi  # a number that is found again in the bytes of a message


def stamp_from(nanoseconds: int) -> Time:
    """Return a time stamp."""
    sec, nanosec = divmod(nanoseconds, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def seconds_from(stamp: Time) -> float:
    """Return a time stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


class Imprint:
    """
    A message as the bytes that the middleware sends, with numbers that are written in place.

    Where they are is found by the value that they have at first, not known. rclpy takes twenty
    times longer to make the bytes of nested messages than to send them.

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
        """Return the numbers from that of a given value on, to be written."""
        count = math.prod(shape)
        place = self._data.index(np.float64(first).tobytes()) if count else 0
        return np.frombuffer(self._data, count=count, offset=place).reshape(shape)

    def __bytes__(self) -> bytes:
        """Return what a publisher takes in place of the message."""
        return bytes(self._data)


class StateMessages:
    """
    The state messages of one robot, made once and filled again for every state.

    Parameters
    ----------
    robot : Robot
    frame_prefix : str, optional
        What the names of the frames ``odom`` and ``base_link`` begin with.

    Attributes
    ----------
    joint_states, link_poses, odom, clock : Imprint
    base : ndarray, shape (7,)
        Pose of ``base_link``: position [m, frame world], quaternion x y z w.

    """

    def __init__(self, robot: Robot, frame_prefix: str = '') -> None:
        self.middle, n = robot.middle_link, robot.link_count
        names, first = joint_names(n), (MARK, 2 * MARK, 3 * MARK)
        position, velocity, effort = ([mark] * len(names) for mark in first)
        self.joint_states = Imprint(
            JointState(name=names, position=position, velocity=velocity, effort=effort)
        )
        self.angle, self.rate, self.torque = (
            self.joint_states.numbers(mark, n - 1, 2) for mark in first
        )

        poses = PoseArray(poses=[Pose() for _ in range(n)])
        poses.header.frame_id, poses.poses[0].position.x = WORLD, MARK
        self.link_poses = Imprint(poses)
        self.poses = self.link_poses.numbers(MARK, n, 7)

        odom = Odometry(child_frame_id=frame_prefix + BASE)
        odom.header.frame_id = frame_prefix + ODOM
        odom.pose.pose.position.x, odom.twist.twist.linear.x = MARK, 2 * MARK
        self.odom = Imprint(odom)
        self.base, self.twist = self.odom.numbers(MARK, 7), self.odom.numbers(2 * MARK, 6)

        self.clock = Imprint(Clock())

    def fill(self, nanoseconds: int, state: State, torque: Array) -> None:
        """
        Fill all messages.

        Parameters
        ----------
        nanoseconds : int
            Simulated time [ns].
        state : State
        torque : ndarray, shape (n-1, 2)
            (yaw, pitch) [N m].

        """
        for imprint in (self.joint_states, self.link_poses, self.odom, self.clock):
            imprint.stamp[:] = divmod(nanoseconds, 1_000_000_000)
        self.angle[:], self.rate[:] = joint_motion(state.q[None], state.u[None])
        self.torque[:] = torque

        quaternion = state.q[:, 3:] @ TO_WIRE
        self.poses[:, :3] = state.q[:, :3]
        self.poses[:, 3:] = np.where(quaternion[:, 3:] < 0.0, -quaternion, quaternion)

        # The middle link turned around: its quaternion times that of half a turn about z.
        x, y, z, w = quaternion[self.middle].tolist()
        turned = (y, -x, w, -z) if z <= 0.0 else (-y, x, -w, z)
        self.base[:3], self.base[3:] = self.poses[self.middle, :3], turned
        u = state.u[self.middle]
        self.twist[:3] = seen_from(turned, u[:3].tolist())
        self.twist[3:] = u[3:][WIRE_AXES] * TURNED


def seen_from(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Return a vector of the world in a frame that is turned by a quaternion x y z w."""
    x, y, z, w = quaternion
    a, b, c = vector
    p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a - w * p + y * r - z * q, b - w * q + z * p - x * r, c - w * r + x * q - y * p
