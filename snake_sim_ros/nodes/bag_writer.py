# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Bags: messages as an MCAP file, which `ros2 bag` and other tools open.

The bag of a run without ROS has the topics of the nodes `sim` and `gait`, made by the same
functions, at the same simulated times.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
import re
import sys
from types import TracebackType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from mcap.writer import Writer
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray
import yaml

from snake_sim_ros.nodes.diagnostics import status_of, values_of
from snake_sim_ros.nodes.messages import command_message, LATCHED, stamp_from
from snake_sim_ros.nodes.state_messages import base_name, StateMessages
from snake_sim_ros.nodes.state_publishers import MARKER_PERIOD, SceneMarkers, TransformMessages
from snake_sim_ros.recording.bag_reader import METADATA
from snake_sim_ros.scene import __version__, gait
from snake_sim_ros.scene.parameters import Scene, scene_to_text
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.simulation import Simulation

SEPARATOR = '=' * 80  # between the definitions of a schema
FOREVER = {'sec': 9223372036, 'nsec': 854775807}
DIAGNOSTICS_PERIOD = 1.0  # s
# Bytes too many that rclpy adds to a message which ends with an empty sequence of numbers.
SURPLUS = 4
STATES = QoSProfile(depth=10)
Measure = Callable[[Simulation, int, StateMessages], object]


class BagWriter:
    """
    Writes an MCAP file with messages as ROS 2 sends them.

    Use it as a context: the index is written at the end of it.

    Parameters
    ----------
    path : Path
    scene : Scene, optional
        The scene, which the metadata of the file keep.

    """

    def __init__(self, path: Path, scene: Scene | None = None) -> None:
        self._file = path.open('wb')
        self._writer = Writer(self._file)
        self._writer.start(profile='ros2', library=f'snake_sim_ros {__version__}')
        if scene:
            self._writer.add_metadata(METADATA, {'scene': scene_to_text(scene)})
        self._channels: dict[str, int] = {}
        self._schemas: dict[Any, int] = {}
        self.counts: dict[str, int] = {}

    def add_topic(self, topic: str, kind: Any, qos: QoSProfile) -> None:
        """
        Add a topic before its first message.

        Raises
        ------
        FileNotFoundError
            If the definition of its type is not installed.

        """
        if kind not in self._schemas:
            text = schema_text(kind).encode()
            self._schemas[kind] = self._writer.register_schema(type_name(kind), 'ros2msg', text)
        self._channels[topic] = self._writer.register_channel(
            topic, 'cdr', self._schemas[kind], {'offered_qos_profiles': qos_text(qos)}
        )
        self.counts[topic] = 0

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        """Write a message that was sent at a time [ns]."""
        count = self.counts[topic] = self.counts[topic] + 1
        try:
            self._writer.add_message(
                self._channels[topic], nanoseconds, data, publish_time=nanoseconds, sequence=count
            )
        except OSError as error:
            raise self._full(error) from None

    def __enter__(self) -> 'BagWriter':
        """Return the writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the rest, then the index."""
        try:
            self._writer.finish()
            self._file.close()
        except OSError as again:
            if error is None:
                raise self._full(again) from None

    def _full(self, error: OSError) -> OSError:
        """Return an error that says which file takes no more, and how to get at what is in it."""
        return OSError(
            f'{self._file.name} takes no more: {error.strerror}; the bag ends there, without its '
            f'index, and `mcap recover` of the MCAP tools reads it'
        )


def type_name(kind: Any) -> str:
    """Return the name of a message type as in ``sensor_msgs/msg/JointState``."""
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


def schema_text(kind: Any) -> str:
    """Return the definitions of a message type and of the types in it, as MCAP needs them."""
    found: dict[Any, None] = {}
    _collect(kind, found)
    first, *others = found
    parts = [definition(first)]
    for other in others:
        name = type_name(other).replace('/msg/', '/')
        parts.append(f'{SEPARATOR}\nMSG: {name}\n{definition(other)}')
    return '\n'.join(parts)


def _collect(kind: Any, found: dict[Any, None]) -> None:
    """Add a message type and the types of its fields, each once."""
    if kind in found:
        return
    found[kind] = None
    for text in kind.get_fields_and_field_types().values():
        if inner := re.search(r'(\w+)/(\w+)', text):
            _collect(getattr(import_module(f'{inner[1]}.msg'), inner[2]), found)


@cache
def definition(kind: Any) -> str:
    """
    Return the text that defines a message type, from the installation of its package.

    Raises
    ------
    FileNotFoundError
        If the file is not installed.

    """
    package, _, name = type_name(kind).split('/')
    file = Path('share', package, 'msg', f'{name}.msg')
    for folder in Path(sys.modules[package].__file__ or '').parents:
        if (folder / file).is_file():
            return (folder / file).read_text(encoding='utf-8')
    raise FileNotFoundError(f'no definition of {type_name(kind)}: {file} is not installed')


def qos_text(qos: QoSProfile) -> str:
    """Return a quality of service as `ros2 bag` writes it, which plays the topic with it."""
    entry = {
        'history': 'keep_last',
        'depth': qos.depth,
        'reliability': _word(qos.reliability, ReliabilityPolicy.BEST_EFFORT, 'reliable'),
        'durability': _word(qos.durability, DurabilityPolicy.TRANSIENT_LOCAL, 'volatile'),
        'deadline': FOREVER,
        'lifespan': FOREVER,
        'liveliness': 'automatic',
        'liveliness_lease_duration': FOREVER,
        'avoid_ros_namespace_conventions': False,
    }
    return yaml.safe_dump([entry], sort_keys=False)


def _word(policy: Any, special: Any, usual: str) -> str:
    return special.name.lower() if policy == special else usual


class RunTopics:
    """
    The topics of a run in a bag: what `sim` and `gait` would publish of it.

    Parameters
    ----------
    bag : BagWriter
    scene : Scene
    measure : callable, optional
        Called with simulation, simulated time [ns] and state messages, which it may change,
        before these are written.

    """

    def __init__(self, bag: BagWriter, scene: Scene, measure: Measure | None = None) -> None:
        self._bag, self._scene, self._measure = bag, scene, measure
        self._messages, self._markers = StateMessages(scene.robot), SceneMarkers(scene)
        self._names = list(scene.robot.axis_names)
        self._due = {'/markers': 0.0, '/diagnostics': DIAGNOSTICS_PERIOD}
        for topic, kind, qos in (
            ('/robot_description', String, LATCHED),
            ('/joint_command', JointState, STATES),
            ('/joint_states', JointState, STATES),
            ('/link_poses', PoseArray, STATES),
            ('/odom', Odometry, STATES),
            ('/markers', MarkerArray, STATES),
            ('/diagnostics', DiagnosticArray, STATES),
            ('/clock', Clock, QoSProfile(depth=1)),
        ):
            bag.add_topic(topic, kind, qos)
        self._write('/robot_description', 0, String(data=robot_description(scene.robot)))
        self._transforms = None
        if TransformMessages.available:
            self._transforms = TransformMessages(base=base_name(scene.robot))
        if self._transforms:
            bag.add_topic('/tf', TransformMessages.kind, QoSProfile(depth=100))
            bag.add_topic('/tf_static', TransformMessages.kind, LATCHED)
            self._write('/tf_static', 0, self._transforms.fixed)

    def observe(self, simulation: Simulation) -> None:
        """Write the state of the simulation, then the clock."""
        now, messages = round(simulation.time * 1e9), self._messages
        robot = self._scene.robot
        reference = gait.reference(self._scene.gait, simulation.time, robot.link_count - 1)
        angle, rate = map(robot.by_axis, reference)
        command = command_message(self._names, stamp_from(now), angle, rate)
        self._bag.write('/joint_command', now, serialize_message(command)[:-SURPLUS])
        messages.fill(now, simulation.state, simulation.last.joint_torque)
        if self._measure:
            self._measure(simulation, now, messages)
        self._bag.write('/joint_states', now, bytes(messages.joint_states))
        self._bag.write('/link_poses', now, bytes(messages.link_poses))
        self._bag.write('/odom', now, bytes(messages.odom))
        if self._transforms:
            self._transforms.fill(stamp_from(now), messages.base.tolist())
            self._write('/tf', now, self._transforms.moving)
        if self._is_due('/markers', simulation.time, MARKER_PERIOD):
            scene, state, history = simulation.scene, simulation.state, simulation.history
            self._markers.fill(stamp_from(now), *contact_forces(scene, state, history))
            self._write('/markers', now, self._markers.message)
        if self._is_due('/diagnostics', simulation.time, DIAGNOSTICS_PERIOD):
            status = status_of('sim', simulation.report.failure, '', 'run', values_of(simulation))
            message = DiagnosticArray(status=[status])
            message.header.stamp = stamp_from(now)
            self._write('/diagnostics', now, message)
        self._bag.write('/clock', now, bytes(messages.clock))

    def _is_due(self, topic: str, now: float, period: float) -> bool:
        """Return whether a topic that is not written with every state is due at a time [s]."""
        if now < self._due[topic] - 1e-9:
            return False
        self._due[topic] += period
        return True

    def _write(self, topic: str, nanoseconds: int, message: Any) -> None:
        self._bag.write(topic, nanoseconds, serialize_message(message))
