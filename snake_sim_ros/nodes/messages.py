"""
Messages of names, times and states, as pure functions.

Names: ``link_1`` to ``link_n`` along the robot, ``joint_1_yaw``, ``joint_1_pitch``, ... in this
order. Frames: ``world`` and ``odom`` are the same place, with z up; ``base_link`` is the frame of
the middle link. A link frame on the wire has x along the link toward the next one, y to the left
and z up when the link lies flat (REP 103); its axes are e_z, e_x and e_y of the paper's frame B.
Quaternions on the wire are x y z w, with w >= 0. Joint angles have the paper's signs: yaw positive
turns the next link left, pitch positive turns it down.
"""

from array import array

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import JointState

from snake_sim_ros.nodes.command_messages import joint_names
from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Robot
from snake_sim_ros.rotations import product
from snake_sim_ros.stepping import State

WORLD, ODOM, BASE = 'world', 'odom', 'base_link'
B_TO_WIRE = np.array(
    [0.5, -0.5, -0.5, -0.5]
)  # columns e_z, e_x, e_y: the inverse of rotations.FLAT
WIRE_AXES = [2, 0, 1]  # components of a vector in B along x, y, z of the wire frame


def stamp_from(nanoseconds: int) -> Time:
    """Return a time stamp."""
    sec, nanosec = divmod(nanoseconds, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def seconds_from(stamp: Time) -> float:
    """Return a time stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


class StateMessages:
    """
    The state messages of one robot, made once and filled again for every state.

    Parameters
    ----------
    robot : Robot
    frame_prefix : str, optional
        What the names of the frames ``odom`` and ``base_link`` begin with.

    """

    def __init__(self, robot: Robot, frame_prefix: str = '') -> None:
        self.middle = robot.middle_link
        self.joint_states = JointState(name=joint_names(robot.link_count))
        self.link_poses = PoseArray(poses=[Pose() for _ in range(robot.link_count)])
        self.odom = Odometry(child_frame_id=frame_prefix + BASE)
        self.odom.header.frame_id = frame_prefix + ODOM
        self.link_poses.header.frame_id = WORLD

    def fill(self, stamp: Time, state: State, angle: Array, rate: Array, torque: Array) -> None:
        """
        Fill all messages.

        Parameters
        ----------
        stamp : Time
        state : State
        angle, rate, torque : ndarray, shape (n-1, 2)
            (yaw, pitch) [rad], [rad/s], [N m].

        """
        for message in (self.joint_states, self.link_poses, self.odom):
            message.header.stamp = stamp
        self.joint_states.position = array('d', angle.tobytes())
        self.joint_states.velocity = array('d', rate.tobytes())
        self.joint_states.effort = array('d', torque.tobytes())

        quaternion = product(state.q[:, 3:], B_TO_WIRE)
        quaternion *= np.where(quaternion[:, :1] < 0.0, -1.0, 1.0)
        for pose, r, p in zip(
            self.link_poses.poses, state.q[:, :3].tolist(), quaternion.tolist(), strict=True
        ):
            position, orientation = pose.position, pose.orientation
            position.x, position.y, position.z = r
            orientation.w, orientation.x, orientation.y, orientation.z = p

        self.odom.pose.pose = self.link_poses.poses[self.middle]
        twist, u = self.odom.twist.twist, state.u[self.middle]
        velocity = _in_frame(quaternion[self.middle], u[:3]).tolist()
        twist.linear.x, twist.linear.y, twist.linear.z = velocity
        twist.angular.x, twist.angular.y, twist.angular.z = u[3:][WIRE_AXES].tolist()


def _in_frame(quaternion: Array, vector: Array) -> Array:
    """Return a vector of the world in a frame with the given orientation (scalar first)."""
    back = quaternion * [1.0, -1.0, -1.0, -1.0]
    return product(product(back, np.array([0.0, *vector])), quaternion)[1:]
