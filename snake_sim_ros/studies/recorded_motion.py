# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a fit needs of a bag: the references of the joints, their angles, and poses of links.

A bag may be that of a run, of a live simulator or of a real robot. Times are those of the stamps;
a message without one has the time of its recording, moved to the clock of the stamps.

References follow from the recorded commands by one of two laws. `held` is that of `sim`: a command
acts from its stamp on and is extrapolated with its velocity for a while; a trajectory begins at
the present reference. `interpolated` takes the commands of the bag of a run, which are samples of
its gait, as points of a smooth curve.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from snake_sim_ros.gaits.joint_reference import JointReference, motion_through
from snake_sim_ros.recording import from_messages
from snake_sim_ros.recording.bag_reader import NOT_OF_ONE, Raw, read_messages
from snake_sim_ros.recording.from_messages import joint_axes
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, ParameterError
from snake_sim_ros.scene.parameters import Array, Robot, Scene, scene_from_text
from snake_sim_ros.scene.posture import from_own_poses

COMMANDS = {  # last part of the name of a topic: its type
    'joint_command': 'sensor_msgs/msg/JointState',
    'joint_trajectory': 'trajectory_msgs/msg/JointTrajectory',
    'position_commands': 'std_msgs/msg/Float64MultiArray',
}
STATES = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'robot_description': 'std_msgs/msg/String',
}
POSES = {  # in the order of preference
    'link_poses': 'geometry_msgs/msg/PoseArray',
    'odom': 'nav_msgs/msg/Odometry',
    'tf': 'tf2_msgs/msg/TFMessage',
}
POSE_TYPES = {
    *POSES.values(),
    'geometry_msgs/msg/PoseStamped',
    'geometry_msgs/msg/PoseWithCovarianceStamped',
    'geometry_msgs/msg/TransformStamped',
}
PARTS = ('position', 'velocity', 'effort')  # of a JointState
LAWS = ('held', 'interpolated')
HORIZON = 0.05  # s for which `sim` extrapolates a command with its velocity by default
BACKWARD = 1.0  # s by which stamps may go back, as where messages overtake each other
FOREIGN = 10.0  # s from the time of recording beyond which a stamp belongs to another clock


class Command(NamedTuple):
    """A command: its topic without namespace, when it acts [s], and the message."""

    topic: str
    time: float
    message: Any


@dataclass(frozen=True)
class Recording:
    """
    A recorded motion.

    Attributes
    ----------
    scene : Scene
        That of the run, or the one that the bag describes.
    is_run : bool
        Whether it is the bag of a run without ROS, whose joints followed the exact gait.
    commands : tuple of Command
        In the order of their times.
    joint_time : ndarray, shape (m,)
        [s]
    joint_angle : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad]; nan where none was measured.
    pose_time : ndarray, shape (k,)
        [s]
    links : ndarray of int, shape (l,)
        Indices of the links whose poses were measured.
    position : ndarray, shape (k, l, 3)
        [m]
    orientation : ndarray, shape (k, l, 4)
        Euler parameters of the link frames B, scalar first.
    dropped : int
        Samples with numbers that are not finite, or with the stamp of another one.

    """

    scene: Scene
    is_run: bool
    commands: tuple[Command, ...]
    joint_time: Array
    joint_angle: Array
    pose_time: Array
    links: Array
    position: Array
    orientation: Array
    dropped: int = 0

    @property
    def begin(self) -> float:
        """Time from which all that is needed is there [s]."""
        return float(max(self.joint_time[0], self.pose_time[0], self.commands[0].time))

    @property
    def end(self) -> float:
        """Time of the last sample of both kinds [s]."""
        return float(min(self.joint_time[-1], self.pose_time[-1]))


def read_recording(
    path: Path,
    scene: Scene | None = None,
    *,
    namespace: str = '',
    pose: str = '',
    link: int | None = None,
) -> Recording:
    """
    Return the recorded motion in a bag.

    Parameters
    ----------
    path : Path
        An MCAP file, or the folder that `ros2 bag record -s mcap` makes.
    scene : Scene, optional
        Default: that of the run, or the one that the bag describes.
    namespace : str, optional
        Namespace of the robot, such as ``/aiko``.
    pose : str, optional
        Topic of the poses. Default: the first of POSES that is there.
    link : int, optional
        Number of the link whose pose it is, from 1. Default: all links of `link_poses`, the middle
        link of other topics.

    Raises
    ------
    ParameterError
        If the bag cannot be read, or lacks something.

    """
    prefix = f'/{namespace.strip("/")}/' if namespace.strip('/') else '/'
    topic = '/' + pose.lstrip('/') if pose else ''
    known = {prefix + name: kind for name, kind in {**COMMANDS, **STATES, **POSES}.items()}
    known['/tf'] = POSES['tf']

    def wanted(name: str, kind: str) -> bool:
        return known.get(name) == kind or (name == topic and kind in POSE_TYPES)

    found, others, text = read_messages(path, wanted)
    try:
        source = _pose_topic(found, prefix, topic)
        _check_topics(found, others, prefix, source, topic)
        base = math.floor(_clock_of(found[prefix + 'joint_states'])[0])
        used = scene or _scene_of(found, text, prefix)
        clock = _Clock(found[prefix + 'joint_states'], base)
        joint_time, joint_angle, lost = _joint_angles(
            found[prefix + 'joint_states'], clock, used.robot
        )
        poses = _poses(source, found[source], clock, used.robot, link)
        pose_time, links, position, orientation, missing = poses
        return Recording(
            used, bool(text), _commands(found, prefix, clock), joint_time, joint_angle,
            pose_time, links, position, orientation, dropped=lost + missing,
        )  # fmt: skip
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None
    except Exception as error:  # messages of which each is whole and which do not fit together
        raise ParameterError(f'{path}: {NOT_OF_ONE}: {cut(str(error), LONGEST_REASON)}') from None


def _pose_topic(found: Mapping[str, Raw], prefix: str, given: str) -> str:
    """Return the topic of the poses; empty if there is none."""
    names = [given] if given else [*(prefix + name for name in POSES), '/tf']
    return next((name for name in names if name in found), '')


def _check_topics(
    found: Mapping[str, Raw], others: Mapping[str, str], prefix: str, source: str, given: str
) -> None:
    """Raise with the topics that are there and those that are wanted if something is missing."""
    missing = []
    if prefix + 'joint_states' not in found:
        missing.append(f'joint angles ({prefix}joint_states, sensor_msgs/JointState)')
    if not any(prefix + name in found for name in COMMANDS):
        missing.append(f'commands ({", ".join(prefix + name for name in COMMANDS)})')
    if not source and given:
        kinds = ', '.join(sorted(kind.rpartition('/')[2] for kind in POSE_TYPES))
        missing.append(f'poses on {given} ({kinds})')
    elif not source:
        names = ', '.join(prefix + name for name in POSES)
        missing.append(f'a pose of a link ({names}, or another with --pose)')
    if missing:
        there = ', '.join([*found, *others]) or 'no messages'
        raise ParameterError(f'a fit needs {" and ".join(missing)}; the bag has {there}')


def _scene_of(found: Mapping[str, Raw], text: str, prefix: str) -> Scene:
    """Return the scene of the run, or the one with the robot that the bag describes."""
    if text:
        return scene_from_text(text)
    described = found.get(prefix + 'robot_description')
    return from_messages.scene_of(described[-1][2].data) if described else Scene()


def _clock_of(raw: Raw) -> list[float]:
    """Return the stamps of messages, or the times of their recording if none has a stamp [s]."""
    stamped = any(stamp for stamp, _, _ in raw)
    return [stamp if stamped else recorded for stamp, recorded, _ in raw]


class _Clock:
    """
    The clock of the stamps of the joint states.

    It says what time it was when a message was recorded, which a message without stamp needs.
    """

    def __init__(self, raw: Raw, base: float) -> None:
        self.base = base
        recorded = np.array([moment for _, moment, _ in raw])
        stamps = np.array(_clock_of(raw)) - base
        back = np.diff(stamps)
        if len(back) and back.min() < -BACKWARD:
            at = int(back.argmin())
            raise ParameterError(
                f'time goes back from {stamps[at]:.3f} s to {stamps[at + 1]:.3f} s in '
                f'joint_states; record without a reset'
            )
        order = np.argsort(recorded, kind='stable')
        self._recorded, self._stamps = recorded[order], np.maximum.accumulate(stamps[order])

    def __call__(self, stamp: float, recorded: float) -> float:
        """Return the time of a message since the base [s]."""
        since = np.interp(recorded, self._recorded, self._stamps)
        if recorded > self._recorded[-1]:
            since += recorded - self._recorded[-1]
        elif recorded < self._recorded[0]:
            since += recorded - self._recorded[0]
        is_foreign = stamp <= 0.0 or abs(stamp - self.base - since) > FOREIGN
        return float(since if is_foreign else stamp - self.base)


def _commands(found: Mapping[str, Raw], prefix: str, clock: _Clock) -> tuple[Command, ...]:
    """Return all commands in the order of their times."""
    commands = [
        Command(name, clock(stamp, recorded), message)
        for name in COMMANDS
        for stamp, recorded, message in found.get(prefix + name, [])
    ]
    for topic, time, message in commands:
        if topic == 'joint_command' and _is_torque(message):
            raise ParameterError(
                f'joint_command at {time:.3f} s has efforts alone, which a fit does not simulate; '
                f'it needs positions or velocities'
            )
    return tuple(sorted(commands, key=lambda item: item.time))


def _is_torque(message: Any) -> bool:
    """Return whether a JointState has efforts, but neither positions nor velocities."""
    has = {part: np.isfinite(getattr(message, part)).any() for part in PARTS}
    return bool(has['effort'] and not (has['position'] or has['velocity']))


def _joint_angles(raw: Raw, clock: _Clock, robot: Robot) -> tuple[Array, Array, int]:
    """Return times, angles and the number of samples without use."""
    angle = np.array([
        from_messages.joint_axes(message.name, message.position, robot) for _, _, message in raw
    ])  # fmt: skip
    angle[~np.isfinite(angle)] = np.nan
    if np.isnan(angle).all():
        raise ParameterError(
            f'joint_states must have finite positions of {robot.axis_names[0]} to '
            f'{robot.axis_names[-1]}; got {", ".join(raw[-1][2].name) or "no names"}'
        )
    time = np.array([clock(stamp, recorded) for stamp, recorded, _ in raw])
    rows = _usable(time, ~np.isnan(angle).all(axis=(1, 2)))
    return time[rows], angle[rows], len(time) - len(rows)


def _usable(time: Array, is_finite: Array) -> Array:
    """Return the rows of samples that can be used, in the order of time, one for each stamp."""
    rows = np.flatnonzero(is_finite)
    _, first = np.unique(time[rows], return_index=True)
    return np.asarray(rows[first])


def _poses(
    topic: str, raw: Raw, clock: _Clock, robot: Robot, link: int | None
) -> tuple[Array, Array, Array, Array, int]:
    """Return times, links, positions, orientations, and the number of samples without use."""
    n = robot.link_count
    if link is not None and not 1 <= link <= n:
        raise ParameterError(f'--link must be 1 to {n}, got {link}')
    arrays = [len(message.poses) for _, _, message in raw if hasattr(message, 'poses')]
    if arrays:
        if set(arrays) != {n}:
            raise ParameterError(
                f'{topic} must have the {n} links of the robot, got {min(arrays)} poses; --scene '
                f'names a scene with another robot'
            )
        links = np.arange(n) if link is None else np.array([link - 1])
        time = np.array([clock(stamp, recorded) for stamp, recorded, _ in raw])
        both = [from_messages.poses(message, robot) for _, _, message in raw]
        position, orientation = (np.array(part)[:, links] for part in zip(*both, strict=True))
    else:
        links = np.array([robot.base_link if link is None else link - 1])
        name = robot.link_names[links[0]]
        names = (name,) if robot.links else ('base_link', name)
        rows, turned = _single_poses(topic, raw, clock, names)
        time = np.array([moment for moment, _ in rows])
        numbers = np.array([pose for _, pose in rows])
        position = numbers[:, None, :3]
        if robot.links:
            own = numbers[:, None, [6, 3, 4, 5]]
            q = from_own_poses(robot, position, own, links)
            position, orientation = q[..., :3], q[..., 3:]
        else:
            wire = np.where(turned[:, None], _half_turned(numbers[:, 3:]), numbers[:, 3:])
            orientation = (wire @ from_messages.TO_WIRE.T)[:, None]
    size = np.linalg.norm(orientation, axis=-1, keepdims=True)
    with np.errstate(invalid='ignore', divide='ignore'):
        orientation = orientation / size
    is_finite = np.isfinite(position).all(axis=(1, 2)) & np.isfinite(orientation).all(axis=(1, 2))
    kept = _usable(time, is_finite)
    if not len(kept):
        raise ParameterError(f'{topic} has no pose with finite numbers and an orientation')
    return time[kept], links, position[kept], orientation[kept], len(time) - len(kept)


def _single_poses(
    topic: str, raw: Raw, clock: _Clock, frames: tuple[str, ...]
) -> tuple[list[tuple[float, Sequence[float]]], Array]:
    """
    Return times and poses of a link, and whether each is that of the frame base_link.

    That frame is the frame of the link, turned around, unless the robot has links of its own.
    """
    rows, turned = list[tuple[float, Sequence[float]]](), list[bool]()
    for stamp, recorded, message in raw:
        for item in getattr(message, 'transforms', [message]):
            frame = getattr(item, 'child_frame_id', '').rpartition('/')[2]
            if hasattr(message, 'transforms'):
                if frame not in frames:
                    continue
                stamp = item.header.stamp.sec + 1e-9 * item.header.stamp.nanosec
            pose = getattr(item, 'transform', None) or item.pose
            pose = getattr(pose, 'pose', pose)
            r = getattr(pose, 'translation', None) or pose.position
            p = getattr(pose, 'rotation', None) or pose.orientation
            rows.append((clock(stamp, recorded), (r.x, r.y, r.z, p.x, p.y, p.z, p.w)))
            turned.append(frame == 'base_link')
    if not rows:
        raise ParameterError(f'{topic} has no {" or ".join(frames)}')
    return rows, np.array(turned)


def _half_turned(quaternion: Array) -> Array:
    """Return quaternions x y z w turned by half a turn about their own z axes, shape (k, 4)."""
    x, y, z, w = quaternion.T
    return np.stack([y, -x, w, -z], axis=-1)


def references(
    recording: Recording, robot: Robot, times: Array, law: str, horizon: float = HORIZON
) -> tuple[Array, Array]:
    """
    Return the references of the joints.

    Parameters
    ----------
    recording : Recording
    robot : Robot
    times : ndarray, shape (k,)
        Increasing [s].
    law : str
        One of LAWS.
    horizon : float, optional
        Time for which a command is extrapolated with its velocity [s].

    Returns
    -------
    angle, rate : ndarray, shape (k, n-1, 2)
        (yaw, pitch) [rad], [rad/s]

    """
    commands = recording.commands
    if law == 'interpolated' and len(commands) > 1 and _are_points(commands, robot):
        return _curve(commands, robot, times)
    first = recording.joint_angle[0].copy()
    reference = JointReference(
        np.full(first.shape, -np.inf), np.nan_to_num(first), np.zeros(first.shape)
    )
    moments = np.array([command.time for command in commands])
    places = np.searchsorted(times, moments)
    ends = np.append(places[1:], len(times))
    parts = [reference.sample(times[: places[0]], horizon, robot.limits)]
    for command, begin, end in zip(commands, places, ends, strict=True):
        reference = _after(command, reference, robot, horizon)
        if end > begin:
            parts.append(reference.sample(times[begin:end], horizon, robot.limits))
            reference = reference.settled(float(times[end - 1]))
    angle, rate = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return angle, rate


def _after(command: Command, last: JointReference, robot: Robot, horizon: float) -> JointReference:
    """Return the reference after a command; one that is not usable changes nothing."""
    message, (low, high, _) = command.message, robot.limits
    if command.topic == 'position_commands':
        data = np.array(message.data, dtype=float)
        if len(data) != len(robot.axis_names) or not np.isfinite(data).all():
            return last
        axes = robot.axis_places
        angle = np.clip(robot.axis_signs * data, low.flat[axes], high.flat[axes])
        return last.commanded(axes, command.time, angle, np.zeros(len(angle)))
    if command.topic == 'joint_trajectory':
        return _with_trajectory(command, last, robot, horizon)
    angle = joint_axes(message.name, message.position, robot).ravel()
    rate = joint_axes(message.name, message.velocity, robot).ravel()
    axes = np.flatnonzero(np.isfinite(angle) | np.isfinite(rate))
    if not len(axes) or command.time < last.stamp.flat[axes].max():
        return last
    # Velocities alone move joints on from where their references are.
    (there,), _ = last.sample(np.array([command.time]), horizon, robot.limits)
    angle = np.where(np.isfinite(angle), angle, there.ravel())
    limited = np.clip(angle[axes], low.flat[axes], high.flat[axes])
    return last.commanded(axes, command.time, limited, np.nan_to_num(rate[axes]))


def _with_trajectory(
    command: Command, last: JointReference, robot: Robot, horizon: float
) -> JointReference:
    """Return the reference with a trajectory that begins where the joints are commanded to be."""
    message, begin = command.message, command.time
    places = dict(zip(robot.axis_names, robot.axis_places.tolist(), strict=True))
    known = [(places[name], k) for k, name in enumerate(message.joint_names) if name in places]
    axes, columns = np.array(sorted(known), dtype=int).reshape(-1, 2).T.copy()
    signs = robot.place_signs
    spans = [point.time_from_start for point in message.points]
    times = begin + np.array([span.sec + 1e-9 * span.nanosec for span in spans])
    rows = [point for point, time in zip(message.points, times, strict=True) if time > begin]
    if not len(axes) or not rows:
        return last
    angle = signs[axes] * np.array([point.positions for point in rows])[:, columns]
    with_rates = all(len(point.velocities) for point in rows)
    rate = None
    if with_rates:
        rate = signs[axes] * np.array([point.velocities for point in rows])[:, columns]
    if not np.isfinite(angle).all() or (np.diff(times) <= 0.0).any():
        return last
    start = last.sample(np.array([begin]), horizon, robot.limits)
    here, speed = (part.reshape(1, -1)[:, axes] for part in start)
    limited = np.clip(angle, robot.limits.low.flat[axes], robot.limits.high.flat[axes])
    return last.moved(motion_through(
        axes, np.insert(times[times > begin], 0, begin), np.concatenate([here, limited]),
        None if rate is None else np.concatenate([speed, rate]),
    ))  # fmt: skip


def _are_points(commands: Sequence[Command], robot: Robot) -> bool:
    """Return whether all commands are angles and velocities of all joints."""
    count = len(robot.axis_names)
    return all(
        item.topic == 'joint_command'
        and len(item.message.position) == len(item.message.velocity) == count
        for item in commands
    )


def _curve(commands: Sequence[Command], robot: Robot, times: Array) -> tuple[Array, Array]:
    """Return angles and rates on the curve through commands with velocities."""
    moments, first = np.unique([item.time for item in commands], return_index=True)
    angle, rate = (
        np.array([
            joint_axes(commands[k].message.name, getattr(commands[k].message, part), robot)
            for k in first
        ])
        for part in ('position', 'velocity')
    )  # fmt: skip
    # All axes are commanded but those that a joint does not have.
    curve = CubicHermiteSpline(moments, np.nan_to_num(angle), np.nan_to_num(rate))
    within = np.clip(times, moments[0], moments[-1])
    return curve(within), curve.derivative()(within)
