# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Messages that nobody should send, as bytes: those of good messages with some fields changed.

The numbers of a message become NaN, infinite, denormal or huge, its lists empty, long or full of
twins, its texts long or no text at all. Some messages are damaged as bytes, too.
"""

from dataclasses import dataclass
import random
import struct
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseArray, PoseStamped, Twist, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from rosidl_parser.definition import AbstractNestedType, AbstractString, Array, BasicType
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from snake_sim_ros import Robot
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.scene.robot_description import robot_description

LINKS = 11
NAMES = list(Robot(link_count=LINKS).axis_names)
NUMBERS = (
    *(float('nan'), float('inf'), -float('inf'), 5e-324, 1e-310, -1e-308, 0.0, -0.0),
    *(1.8e308 / 2, -1e300, 1e30, 1e9, -1e6, 100.0, 3.2, -0.8, 1e-9),
)
WORDS = (
    *('', 'joint_1_yaw', 'joint_1_yaw', 'joint_11_yaw', 'joint_2_pitch', '/', '../..', 'world'),
    *('link_3', 'joint_1_yaw\x01', 'e\u0301', '%s%n{0}', 'x' * 300),
)
LONG = 10_000_000  # bytes of the longest text
POINTS = 100_000  # of the longest trajectory
CHANGES = 3  # of a message at most


@dataclass(frozen=True)
class Topic:
    """A topic that a node reads."""

    name: str
    kind: Any


TOPICS: dict[str, tuple[Topic, ...]] = {
    'sim': (
        Topic('joint_command', JointState),
        Topic('position_commands', Float64MultiArray),
        Topic('joint_trajectory', JointTrajectory),
        Topic('sim/push', WrenchStamped),
        Topic('sim/set_pose', PoseStamped),
    ),
    'gait': (
        Topic('cmd_vel', Twist),
        Topic('joint_states', JointState),
    ),
    'viewer': (
        Topic('joint_states', JointState),
        Topic('link_poses', PoseArray),
        Topic('odom', Odometry),
        Topic('joint_command', JointState),
        Topic('markers', MarkerArray),
        Topic('robot_description', String),
        Topic('/diagnostics', DiagnosticArray),
    ),
}

# The clock of a node that goes by it.
TIME = Topic('/clock', Clock)


def good_message(kind: Any, rng: random.Random) -> Any:
    """Return a message that a node can use."""
    angles = [rng.uniform(-0.7, 0.7) for _ in NAMES]
    message = kind()
    if kind is JointState:
        message.name, message.position = NAMES, angles
    elif kind is Float64MultiArray:
        message.data = angles
    elif kind is JointTrajectory:
        message.joint_names = NAMES
        for k in range(1, 4):
            point = JointTrajectoryPoint(positions=[angle * k / 3 for angle in angles])
            point.time_from_start.sec = k
            message.points.append(point)
    elif kind is PoseArray:
        message.poses = [PoseStamped().pose for _ in range(LINKS)]
    elif kind is MarkerArray:
        message.markers = [
            Marker(ns='scene', type=k, points=[Point(x=0.1), Point()]) for k in range(1, 6)
        ]
    elif kind is Clock:
        message.clock = stamp_from(time.monotonic_ns())
    elif kind is String:
        message.data = robot_description(Robot())
    elif kind is DiagnosticArray:
        values = [KeyValue(key='real_time_factor', value='1'), KeyValue(key='state', value='up')]
        message.status = [DiagnosticStatus(name='sim: physics', message='ok', values=values)]
    return message


def hostile_message(kind: Any, rng: random.Random) -> bytes:
    """Return the bytes of a message with some fields that are not usable, or damaged bytes."""
    message = good_message(kind, rng)
    for _ in range(rng.randint(1, CHANGES)):
        _change(message, rng)
    data = serialize_message(message)
    return damaged(data, rng) if rng.random() < 0.3 else data


def largest_message(kind: Any, rng: random.Random) -> bytes:
    """Return the bytes of a message with very many points, or with a very long text or list."""
    message = good_message(kind, rng)
    if kind is JointTrajectory:
        message.points = [message.points[0]] * POINTS
    elif kind is JointState:
        message.name = ['x' * LONG]
    elif kind is String:
        message.data = 'x' * LONG
    elif kind is Float64MultiArray:
        message.data = [0.1] * (LONG // 8)
    elif hasattr(message, 'header'):
        message.header.frame_id = 'x' * LONG
    return serialize_message(message)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return the bytes of a message with some that are others, or without its end."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        place = rng.randrange(len(changed) + 1)
        length = rng.choice((0, 1, 255, 2**16, 2**31 - 1, 2**32 - 1, rng.randrange(2**32)))
        new = rng.choice((bytes([rng.randrange(256)]), b'\xff\xfe\x80', struct.pack('<I', length)))
        changed[place : place + len(new)] = new
    if changed and rng.random() < 0.3:
        del changed[rng.randrange(len(changed)) :]
    return bytes(changed)


def _change(message: Any, rng: random.Random) -> None:
    """Change a field of a message, or of a message in it."""
    names = list(message.get_fields_and_field_types())
    index = rng.randrange(len(names))
    field, value = message.SLOT_TYPES[index], getattr(message, names[index])
    if isinstance(field, AbstractNestedType):
        if not isinstance(field, Array):
            setattr(message, names[index], _changed_list(field.value_type, list(value), rng))
    elif isinstance(field, (AbstractString, BasicType)):
        setattr(message, names[index], _changed_value(field, rng))
    else:
        _change(value, rng)


def _changed_list(item: Any, values: list[Any], rng: random.Random) -> list[Any]:
    how = rng.choice(('empty', 'shorter', 'twins', 'longer', 'value'))
    if how == 'empty' or not values:
        return []
    if how == 'shorter':
        return values[:-1]
    if how == 'twins':
        return values[:1] * len(values)
    if how == 'longer':
        return values * rng.choice((2, 50))
    place = rng.randrange(len(values))
    if isinstance(item, (AbstractString, BasicType)):
        values[place] = _changed_value(item, rng)
    else:
        _change(values[place], rng)
    return values


def _changed_value(field: Any, rng: random.Random) -> Any:
    if isinstance(field, AbstractString):
        return rng.choice(WORDS)
    kind = field.typename
    if kind in ('double', 'float'):
        value = rng.choice(NUMBERS)
        return value if kind == 'double' or abs(value) < 1e38 else 0.0
    if kind == 'boolean':
        return rng.random() < 0.5
    if kind == 'octet':
        return bytes([rng.randrange(256)])
    bits = int(kind.removeprefix('u').removeprefix('int'))
    low, high = (0, 2**bits - 1) if kind.startswith('u') else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    return rng.choice((low, min(high, 2 ** (bits - 1) - 1), 0, 1, rng.randrange(low, high)))
