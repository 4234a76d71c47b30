# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags as a robot leaves them: messages of commands, joint angles and poses at given times."""

import numpy as np
import pytest

pytest.importorskip('mcap_ros2')  # bag_writer needs it
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.nodes.bag_writer import BagWriter
from snake_sim_ros.nodes.messages import command_message, stamp_from
from snake_sim_ros.recording.from_messages import TO_WIRE
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.posture import own_poses

KINDS = {
    'joint_command': JointState,
    'joint_trajectory': JointTrajectory,
    'position_commands': Float64MultiArray,
    'joint_states': JointState,
    'link_poses': PoseArray,
    'odom': Odometry,
    'head': PoseStamped,
}


def write_messages(path, messages, scene=None, prefix='/'):
    """Write (topic, time of recording [s], message) as a bag."""
    with BagWriter(path, scene) as bag:
        for name in dict.fromkeys(name for name, _, _ in messages):
            bag.add_topic(prefix + name, KINDS[name], QoSProfile(depth=10))
        for name, time, message in sorted(messages, key=lambda item: item[1]):
            bag.write(prefix + name, round(time * 1e9), serialize_message(message))
    return path


def gait_commands(scene, times):
    """Return the messages of a gait node at some times."""
    names, count = list(scene.robot.axis_names), scene.robot.link_count - 1
    return [
        (
            'joint_command',
            t,
            command_message(names, stamp_from(round(t * 1e9)), *map(scene.robot.by_axis, told)),
        )
        for t, *told in zip(times, *gait.reference(scene.gait, times, count), strict=True)
    ]


def state_messages(recording, pose='link_poses', lag=0.0):
    """Return the messages of joint states and poses; they are recorded some time [s] later."""
    names = list(recording.scene.robot.axis_names)
    messages = []
    columns = recording.joint_angle
    if columns.ndim == 3:
        columns = recording.scene.robot.by_axis(columns)
    for t, angle in zip(recording.joint_time, columns, strict=True):
        message = JointState(name=names, position=angle.tolist())
        message.header.stamp = stamp_from(round(t * 1e9))
        messages.append(('joint_states', t + lag, message))
    rows = zip(recording.pose_time, recording.position, recording.orientation, strict=True)
    for t, position, orientation in rows:
        message = KINDS[pose]()
        wire = orientation @ TO_WIRE
        if recording.scene.robot.links:
            q = np.concatenate([position, orientation], axis=-1)
            position, own = own_poses(recording.scene.robot, q)
            wire = own[:, [1, 2, 3, 0]]
        if pose == 'link_poses':
            message.poses = [message_of(r, p) for r, p in zip(position, wire, strict=True)]
        elif pose == 'odom':
            x, y, z, w = wire[len(wire) // 2]
            message.child_frame_id = 'base_link'
            message.pose.pose = message_of(position[len(wire) // 2], (y, -x, w, -z))
        else:
            message.pose = message_of(position[0], wire[0])
        message.header.stamp = stamp_from(round(t * 1e9))
        messages.append((pose, t + lag, message))
    return messages


def message_of(position, quaternion):
    """Return a Pose message."""
    pose = PoseStamped().pose
    pose.position.x, pose.position.y, pose.position.z = map(float, position)
    q = pose.orientation
    q.x, q.y, q.z, q.w = map(float, np.asarray(quaternion))
    return pose
