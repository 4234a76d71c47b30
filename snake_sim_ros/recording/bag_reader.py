# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Reading bags: an MCAP file of `snake-sim`, `ros2 bag` or a real robot becomes a trajectory.

`mcap` reads and writes bags, not rosbags, which writes folders only, without the scene in the file
and without checksums, knows the types of its own lists alone, and takes 0.7 s longer to import.
"""

from collections.abc import Callable, Iterator
from os import SEEK_END
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from snake_sim_ros.recording import from_messages
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, ParameterError
from snake_sim_ros.scene.parameters import Array, Robot, Scene, scene_from_text
from snake_sim_ros.scene.posture import chain_coordinates, gaps
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.trajectory import Trajectory

METADATA = 'snake_sim_ros'  # name of the metadata record with the scene of a run
MAGIC = b'\x89MCAP0\r\n'  # at both ends of a complete file
KINDS = {  # last part of the name of a topic: its type
    'joint_states': 'sensor_msgs/msg/JointState',
    'link_poses': 'geometry_msgs/msg/PoseArray',
    'markers': 'visualization_msgs/msg/MarkerArray',
    'robot_description': 'std_msgs/msg/String',
    'diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}
NOT_OF_ONE = 'its messages are not those of one robot'
NOTHING = np.zeros((0, 3)), np.zeros((0, 3))  # points, forces
Messages = list[tuple[float, Any]]  # time [s], message
Raw = list[tuple[float, float, Any]]  # stamp of its header [s], time of its recording [s], message


def read_bag(path: Path, namespace: str | None = None) -> Trajectory:
    """
    Return the trajectory of a robot in a bag.

    The samples are those of `link_poses`. A real robot does not publish them; then the samples are
    those of `joint_states`, and the robot lies at the origin. Contacts are those of the last
    markers before a sample. Where stamps decrease, as after a reset of time, time stands still.
    Without a robot_description the robot is Aiko.

    Parameters
    ----------
    path : Path
        An MCAP file, or the folder that `ros2 bag record -s mcap` makes.
    namespace : str, optional
        Namespace of the robot, such as ``/aiko``; needed if there are several robots.

    Raises
    ------
    ParameterError
        If it is no such file, is not complete, or has neither link poses nor joint states.

    """
    found, others, text = read_messages(path, _is_of_a_state)
    robots = _robots(found, namespace)
    if not robots:
        there = ', '.join(f'{name} ({kind})' for name, kind in others.items()) or 'no messages'
        of = f' of {namespace}' if namespace else ''
        raise ParameterError(
            f'{path} has neither link_poses (geometry_msgs/PoseArray) nor joint_states '
            f'(sensor_msgs/JointState){of}; it has {cut(there, LONGEST_REASON)}'
        )
    if len(robots) > 1:
        names = cut(', '.join(robots), LONGEST_REASON)
        raise ParameterError(f'{path} has several robots; choose one with --namespace: {names}')
    topics = {kind: f'{robots[0].rstrip("/")}/{kind}' for kind in KINDS}
    topics['diagnostics'] = '/diagnostics'
    of_robot = {kind: _timed(found.get(topic, [])) for kind, topic in topics.items()}
    try:
        return _trajectory(of_robot, text)
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None
    except Exception as error:  # messages of which each is whole and which do not fit together
        raise ParameterError(f'{path}: {NOT_OF_ONE}: {cut(str(error), LONGEST_REASON)}') from None


def read_messages(
    path: Path, wanted: Callable[[str, str], bool]
) -> tuple[dict[str, Raw], dict[str, str], str]:
    """
    Return messages of a bag by topic, the types of its other topics, and the scene of its run.

    Parameters
    ----------
    path : Path
        An MCAP file, or a folder of them.
    wanted : callable
        ``wanted(topic, type)`` says whether the messages of a topic are read.

    Raises
    ------
    ParameterError
        If it is no such file, or is not complete.

    """
    found: dict[str, Raw] = {}
    others: dict[str, str] = {}
    text = ''
    for file in _files(path):
        text = _read(file, found, others, wanted) or text
    return found, others, text


def _is_of_a_state(topic: str, kind: str) -> bool:
    """Return whether a trajectory is made of a topic."""
    return KINDS.get(topic.rpartition('/')[2]) == kind


def _robots(found: dict[str, Raw], namespace: str | None) -> list[str]:
    """Return the namespaces that have a robot."""
    topics = [name for name in found if name.endswith(('/link_poses', '/joint_states'))]
    spaces = dict.fromkeys(name.rpartition('/')[0] or '/' for name in topics)
    wanted = namespace and '/' + namespace.strip('/')
    return [space for space in spaces if wanted in (None, space)]


def _timed(raw: Raw) -> Messages:
    """Return messages with their stamps, or with the times of recording if none has a stamp."""
    stamped = any(stamp for stamp, _, _ in raw)
    return [(stamp if stamped else recorded, message) for stamp, recorded, message in raw]


def _trajectory(found: dict[str, Messages], text: str) -> Trajectory:
    source = found['link_poses'] or found['joint_states']
    scene = _scene(found, text)
    n, stamp = scene.robot.link_count, np.array([time for time, _ in source])
    angle, velocity, torque = (
        _joints(found['joint_states'], part, stamp, scene.robot)
        for part in ('position', 'velocity', 'effort')
    )
    if found['link_poses']:
        poses = [from_messages.poses(message, scene.robot) for _, message in source]
        for position, _ in poses:
            if len(position) != n:
                raise ParameterError(
                    f'link_poses must have the {n} links of the robot, got {len(position)}'
                )
        position, orientation = (np.array(parts) for parts in zip(*poses, strict=True))
    else:
        by_joint = scene.robot.by_joint(np.nan_to_num(angle), 0.0)
        q = np.array([chain_coordinates(scene.robot, each) for each in by_joint])
        q[..., 2] -= gaps(scene.robot, q).min(axis=-1, keepdims=True)
        position, orientation = q[..., :3], q[..., 3:]
    sample, point, force = _contacts(found['markers'], stamp)
    return Trajectory(
        scene=scene,
        time=stamp[0] + np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(stamp), 0.0))]),
        position=position,
        orientation=orientation,
        joint_angle=angle,
        joint_velocity=velocity,
        joint_torque=torque,
        contact_sample=sample,
        contact_number=np.full(len(sample), -1),
        contact_point=point,
        contact_force=force,
        level=_levels(found['diagnostics'], stamp),
        report=Report(),
        seconds=0.0,
        interrupted=False,
    )


def _files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag."""
    if not path.exists():
        raise ParameterError(f'no file {path}')
    files = sorted(path.glob('*.mcap')) if path.is_dir() else [path]
    if not files:
        raise ParameterError(f'{path} has no .mcap file; record with ros2 bag record -s mcap')
    return files


def _read(
    path: Path,
    found: dict[str, Raw],
    others: dict[str, str],
    wanted: Callable[[str, str], bool],
) -> str:
    """Add the messages and topics of a file in the order of their times; return its scene."""
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise ParameterError(
            "bags need the package mcap-ros2-support: pip install 'snake_sim_ros[bags]'"
        ) from None
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ParameterError(
                f'{path} is not an MCAP file; snake-sim run --bag and ros2 bag record -s mcap '
                f'write one'
            )
        if file.seek(0, SEEK_END) < 2 * len(MAGIC) or _last(file) != MAGIC:
            raise ParameterError(
                f'{path} is truncated; `mcap recover` of the MCAP tools saves what is there'
            )
        file.seek(0)
        try:
            reader = make_reader(file, validate_crcs=True)
            scene = [r.metadata['scene'] for r in reader.iter_metadata() if r.name == METADATA]
            for topic, *raw in _decoded(reader, others, wanted):
                found.setdefault(topic, []).append(tuple(raw))
        except Exception as error:  # decoders raise anything on broken data
            raise ParameterError(
                f'{path} cannot be read as a bag of ROS 2: {type(error).__name__}: '
                f'{cut(str(error), LONGEST_REASON)}'
            ) from None
    return scene[-1] if scene else ''


def _last(file: BinaryIO) -> bytes:
    """Return the last bytes of a file, of the length of MAGIC."""
    file.seek(-len(MAGIC), SEEK_END)
    return file.read()


def _decoded(
    reader: Any, others: dict[str, str], wanted: Callable[[str, str], bool]
) -> Iterator[tuple[str, float, float, Any]]:
    """Yield topic, stamp [s], time [s] and message of wanted topics; collect the other topics."""
    from mcap_ros2.decoder import DecoderFactory

    factory, decoders = DecoderFactory(), dict[int, Any]()
    for schema, channel, message in reader.iter_messages():
        if schema is None or not wanted(channel.topic, schema.name):
            others[channel.topic] = schema.name if schema else channel.message_encoding
            continue
        if channel.id not in decoders:
            decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
        if decoders[channel.id] is None:
            raise ValueError(
                f'{channel.topic} is encoded as {channel.message_encoding!r}, not cdr'
            )
        content = decoders[channel.id](message.data)
        yield channel.topic, _stamp(content), 1e-9 * message.log_time, content


def _stamp(message: Any) -> float:
    """Return the stamp of a message, 0 if it has none [s]."""
    first = next(iter(getattr(message, 'markers', ())), message)
    header = getattr(first, 'header', None)
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec) if header else 0.0


def _scene(found: dict[str, Messages], text: str) -> Scene:
    """Return the scene in the metadata of a run, or else the one that its topics describe."""
    if text:
        return scene_from_text(text)
    if not found['robot_description']:
        return Scene()
    markers = found['markers'][-1][1].markers if found['markers'] else ()
    return from_messages.scene_of(found['robot_description'][-1][1].data, markers)


def _joints(messages: Messages, part: str, stamp: Array, robot: Robot) -> Array:
    """Return values of the joint axes at some times, shape (m, axes); nan before the first."""
    rows = [np.full((robot.link_count - 1, 2), np.nan)]
    rows += [
        from_messages.joint_axes(item.name, getattr(item, part), robot) for _, item in messages
    ]
    return robot.by_axis(np.array(rows)[_latest(messages, stamp) + 1])


def _latest(messages: Messages, stamp: Array) -> Array:
    """Return the index of the last message up to each time, -1 where there is none."""
    times = np.maximum.accumulate([time for time, _ in messages]) if messages else np.zeros(0)
    return np.searchsorted(times, np.maximum.accumulate(stamp), side='right') - 1


def _contacts(messages: Messages, stamp: Array) -> tuple[Array, Array, Array]:
    """Return sample, point [m] and force [N] of all contacts, each from the last markers."""
    touched = [from_messages.contacts(item.markers) or NOTHING for _, item in messages]
    parts = [NOTHING if k < 0 else touched[k] for k in _latest(messages, stamp)]
    sample = np.repeat(np.arange(len(stamp)), [len(point) for point, _ in parts])
    point, force = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return sample, point, force


def _levels(messages: Messages, stamp: Array) -> Array:
    """Return the level in the last diagnostics before each time, or an empty text."""
    levels = [''] + [
        next((item.value for status in message.status for item in status.values
              if item.key == 'level'), '')
        for _, message in messages
    ]  # fmt: skip
    return np.asarray(np.array(levels)[_latest(messages, stamp) + 1])
