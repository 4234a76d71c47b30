# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the node `sim` publishes: state, transforms, sensors and markers."""

from collections.abc import Iterable
import time
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseArray, TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

from snake_sim_ros.gaits.joint_reference import JointReference
from snake_sim_ros.nodes.messages import BASE, LATCHED, ODOM, stamp_from, WORLD
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.state_messages import base_name, MARK, SerializedMessage, StateMessages
from snake_sim_ros.recording.from_messages import FORCE_SCALE
from snake_sim_ros.recording.sensors import SensorReader, Sensors
from snake_sim_ros.scene.obstacles import cell_centers, FOUNDATION, PEG_HEIGHT
from snake_sim_ros.scene.parameters import Array, Ground, Patches, Scene, steps_in
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.scene.surfaces import surfaces_of
from snake_sim_ros.scene.urdf_ros2_control import with_ros2_control
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.exact_sensors import ACCELERATION, ANGULAR_VELOCITY, ORIENTATION
from snake_sim_ros.stepping.simulation import Simulation

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    TFMessage = None

# ---- transforms ---------------------------------------------------------------------------------


class TransformMessages:
    """
    The transforms from world to odom, which is fixed, and from odom to base_link.

    They are as tf2_ros.StaticTransformBroadcaster and tf2_ros.TransformBroadcaster publish them. A
    robot_state_publisher makes the frames of the links, from ``robot_description`` and
    ``joint_states``.

    Attributes
    ----------
    fixed, moving : TFMessage
        For /tf_static and /tf.

    """

    kind = TFMessage
    available = TFMessage is not None

    def __init__(self, frame_prefix: str = '', base: str = BASE) -> None:
        identity = TransformStamped(child_frame_id=frame_prefix + ODOM)
        identity.header.frame_id = WORLD
        self.fixed = TFMessage(transforms=[identity])
        self._transform = TransformStamped(child_frame_id=frame_prefix + base)
        self._transform.header.frame_id = frame_prefix + ODOM
        self.moving = TFMessage(transforms=[self._transform])

    def fill(self, stamp: Time, pose: list[float]) -> None:
        """Fill the moving one with the pose of the base: position [m], quaternion x y z w."""
        transform = self._transform.transform
        self._transform.header.stamp = stamp
        moved, turned = transform.translation, transform.rotation
        moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w = pose


class Transforms:
    """Publishes the transforms."""

    def __init__(self, node: Node, frame_prefix: str) -> None:
        self._prefix = frame_prefix
        self.publisher = node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100))
        self.static = node.create_publisher(TFMessage, '/tf_static', LATCHED)

    def begin(self, base: str) -> None:
        """Publish the pose of a base of this name from now on."""
        self.messages = TransformMessages(self._prefix, base)
        self.static.publish(self.messages.fixed)

    def publish(self, stamp: Time, pose: list[float]) -> None:
        """Publish the pose of the base: position [m], quaternion x y z w."""
        self.messages.fill(stamp, pose)
        self.publisher.publish(self.messages.moving)


# ---- markers ------------------------------------------------------------------------------------

# Markers: what viewers draw besides the robot, its contacts and its obstacles.
#
# Namespace `contacts` has the contact points as spheres (id 0) and the forces on the robot as
# lines that begin there (id 1), with a length of FORCE_SCALE for each newton. Without contacts
# both are deleted. Namespace `scene` has the ground as one list of boxes (id 0) and the pegs as
# cylinders (ids from 1). Namespace `patches` has patches of friction as one list of plates (id 0).
# Namespace `world` has the solids of a world as triangles, one marker each (ids from 0), in the
# first of WORLD_PERIOD messages. All markers are in frame `world` and have no lifetime: they stay
# until replaced. The first message of a scene deletes those of the scene before.


POINT_SIZE = 0.012  # m
LINE_WIDTH = 0.004  # m
PLATE = 0.002  # m, thickness of patches
# Solids do not move, and may have many triangles. A prime number of messages: whoever takes only
# every so many of them gets these, too.
WORLD_PERIOD = 29
MARKER_PERIOD = 1 / 30  # s between two messages at least, which is enough for the eye
COLORS = {
    'point': (1.0, 1.0, 1.0, 1.0),
    'force': (0.1, 0.8, 0.3, 1.0),
    'ground': (0.55, 0.55, 0.58, 1.0),
    'peg': (0.35, 0.45, 0.65, 1.0),
}


class SceneMarkers:
    """
    The markers of one scene, made once and filled again for every state.

    Attributes
    ----------
    message : MarkerArray

    """

    def __init__(self, scene: Scene) -> None:
        self.points = _marker('contacts', 0, Marker.SPHERE_LIST, 'point', [POINT_SIZE] * 3)
        self.forces = _marker('contacts', 1, Marker.LINE_LIST, 'force', [LINE_WIDTH, 0, 0])
        markers = [self.points, self.forces]
        if scene.ground.heights:
            markers.append(_ground(scene.ground))
        if scene.patches.factors:
            markers.append(_patches(scene.patches))
        height = PEG_HEIGHT * scene.robot.per_link('contact_radius').max()
        for k, (x, y, radius) in enumerate(scene.pegs.axes, 1):
            peg = _marker('scene', k, Marker.CYLINDER, 'peg', [2 * radius, 2 * radius, height])
            peg.pose.position = _point((x, y, height / 2))
            markers.append(peg)
        self.solids = [_solid(k, *surface) for k, surface in enumerate(surfaces_of(scene.world))]
        self.others, self.filled = markers, 0
        self.message = MarkerArray(markers=markers)
        self._before = Marker(action=Marker.DELETEALL)
        self._before.header.frame_id = WORLD

    def fill(self, stamp: Time, points: Array, forces: Array) -> None:
        """
        Fill the message with contacts.

        Parameters
        ----------
        stamp : Time
        points, forces : ndarray, shape (k, 3)
            Contact points [m] and forces on the robot [N], as `contact_forces` returns them.

        """
        action = Marker.ADD if len(points) else Marker.DELETE
        ends = np.stack([points, points + FORCE_SCALE * forces], axis=1).reshape(-1, 3)
        for marker, entries in ((self.points, points), (self.forces, ends)):
            marker.action = action
            marker.points = [_point(entry) for entry in entries.tolist()]
        is_whole = self.filled % WORLD_PERIOD == 0
        self.message.markers = self.others + self.solids if is_whole else self.others
        if not self.filled:
            self.message.markers = [self._before, *self.message.markers]
        self.filled += 1
        for marker in self.message.markers:
            marker.header.stamp = stamp


def _solid(number: int, vertices: Array, faces: Array) -> Marker:
    """Return the surface of a solid as a list of triangles."""
    marker = _marker('world', number, Marker.TRIANGLE_LIST, 'ground', [1.0, 1.0, 1.0])
    marker.points = [_point(vertex) for vertex in vertices[faces].reshape(-1, 3).tolist()]
    return marker


def _ground(ground: Ground) -> Marker:
    """Return the cells of the ground as boxes of one size, as a list of boxes must have."""
    heights = np.array(ground.heights)
    lowest = min(0.0, heights.min()) - FOUNDATION
    size = [ground.cell, ground.cell, heights.max() - lowest]
    marker = _marker('scene', 0, Marker.CUBE_LIST, 'ground', size)
    centers = np.dstack([cell_centers(ground), heights - size[2] / 2]).reshape(-1, 3)
    marker.points = [_point(center) for center in centers.tolist()]
    return marker


def _patches(patches: Patches) -> Marker:
    """Return patches as plates just below the floor, the darker the more friction they have."""
    marker = _marker('patches', 0, Marker.CUBE_LIST, 'ground', [patches.cell, patches.cell, PLATE])
    for (row, column), factor in np.ndenumerate(np.array(patches.factors)):
        x, y = patches.origin + patches.cell * (np.array([column, row]) + 0.5)
        marker.points.append(_point((x, y, -PLATE / 2)))
        shade = 1.0 / (1.0 + float(factor))
        marker.colors.append(ColorRGBA(r=shade, g=shade, b=shade, a=1.0))
    return marker


def _marker(namespace: str, number: int, kind: int, color: str, scale: Iterable[float]) -> Marker:
    """Return a marker without points; its scale is in metres."""
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id = WORLD
    marker.scale.x, marker.scale.y, marker.scale.z = map(float, scale)
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = COLORS[color]
    return marker


def _point(entry: Iterable[float]) -> Point:
    """Return three numbers as a message."""
    x, y, z = entry
    return Point(x=float(x), y=float(y), z=float(z))


# ---- sensors ------------------------------------------------------------------------------------


class SensorMessages:
    """
    The messages of the sensors of a robot, made once and filled again for every sample.

    A covariance is that of the noise; where there is none it is zero, which means unknown. The
    orientation is exact.

    Parameters
    ----------
    reader : SensorReader
    sensors : Sensors
    frame_prefix : str, optional
        Prefix of the names of frames.

    Attributes
    ----------
    imus, wrenches : dict
        Topic -> SerializedMessage, in the order of the links that have sensors.

    """

    def __init__(self, reader: SensorReader, sensors: Sensors, frame_prefix: str = '') -> None:
        self._reader = reader
        self.imus: dict[str, SerializedMessage] = {}
        self.wrenches: dict[str, SerializedMessage] = {}
        self._readings: list[tuple[Array, Array, Array]] = []
        self._loads: list[Array] = []
        names, frames = reader.robot.link_names, reader.robot.chain.center_names
        for name, frame in zip(reader.imu_places.names, reader.imu_places.frames, strict=True):
            message = _imu(sensors, frame_prefix + frame)
            self.imus[f'imu/{name}'] = message
            numbers = message.numbers(MARK, 37)
            self._readings.append((numbers[:4], numbers[13:16], numbers[25:28]))
        for link in reader.contact_links:
            wrench = WrenchStamped()
            wrench.header.frame_id, wrench.wrench.force.x = frame_prefix + frames[link], MARK
            message = SerializedMessage(wrench)
            self.wrenches[f'contact_forces/{names[link]}'] = message
            self._loads.append(message.numbers(MARK, 6))

    def fill_imus(self, nanoseconds: int) -> None:
        """Write the readings of the present state of simulated time [ns]."""
        for message in self.imus.values():
            message.stamp[:] = divmod(nanoseconds, 1_000_000_000)
        for reading, parts in zip(self._reader.imus(), self._readings, strict=True):
            places = (ORIENTATION, ANGULAR_VELOCITY, ACCELERATION)
            for part, place in zip(parts, places, strict=True):
                part[:] = reading[place]

    def fill_wrenches(self, nanoseconds: int) -> None:
        """Write the contact forces of the step before simulated time [ns]."""
        for message in self.wrenches.values():
            message.stamp[:] = divmod(nanoseconds, 1_000_000_000)
        for wrench, load in zip(self._reader.wrenches(), self._loads, strict=True):
            load[:] = wrench


def _imu(sensors: Sensors, frame: str) -> SerializedMessage:
    """Return a message with the covariances of the noise."""
    message = Imu()
    message.header.frame_id, message.orientation.x = frame, MARK
    for covariance, deviation in (
        (message.angular_velocity_covariance, sensors.imu_angular_velocity_noise),
        (message.linear_acceleration_covariance, sensors.imu_acceleration_noise),
    ):
        covariance[:] = np.ravel(deviation**2 * np.eye(3))
    return SerializedMessage(message)


LOOK = 0.03  # s of wall time between two looks for readers of contact forces


class SensorPublishers:
    """
    Publishes what the sensors of a robot measure; nothing if it has none.

    Contact forces are computed only while somebody reads them.

    Attributes
    ----------
    reader : SensorReader

    """

    def __init__(self, node: Node, frame_prefix: str) -> None:
        self._node, self._prefix = node, frame_prefix
        self._imus: list[tuple[Any, Any]] = []
        self._wrenches: list[tuple[Any, Any]] = []

    def begin(self, simulation: Simulation, settings: Settings) -> None:
        """Publish the readings of a simulation from now on; raise if it has no such sensors."""
        rate = settings.publish_rate
        steps = steps_in(1.0 / rate, simulation.scene.dt, 'publish period')
        self.reader = SensorReader(simulation, settings, steps, rate)
        for publisher, _ in self._imus + self._wrenches:
            self._node.destroy_publisher(publisher)
        self._messages = SensorMessages(self.reader, settings, self._prefix)
        self._imus = _publishers(self._node, Imu, self._messages.imus)
        self._wrenches = _publishers(self._node, WrenchStamped, self._messages.wrenches)
        self._read: list[tuple[Any, Any]] = []  # those of `_wrenches` that somebody reads
        self._looked = 0.0  # wall time of the last look for readers [s]

    def publish(self, nanoseconds: int, *, contacts: bool) -> None:
        """
        Publish a sample if one is due.

        Parameters
        ----------
        nanoseconds : int
            Simulated time [ns].
        contacts : bool
            Whether contact forces can be computed, by compiled functions.

        """
        if not (self._imus or self._wrenches) or not self.reader.is_due():
            return
        if self._imus:
            self._messages.fill_imus(nanoseconds)
            for publisher, message in self._imus:
                publisher.publish(bytes(message))
        if self._wrenches and contacts:
            self._look()
            if self._read:
                self._messages.fill_wrenches(nanoseconds)
            for publisher, message in self._read:
                publisher.publish(bytes(message))

    def _look(self) -> None:
        now = time.monotonic()
        if now - self._looked >= LOOK:
            self._looked = now
            self._read = [item for item in self._wrenches if item[0].get_subscription_count()]


def _publishers(node: Node, kind: Any, messages: dict[str, Any]) -> list[tuple[Any, Any]]:
    return [(node.create_publisher(kind, topic, 10), item) for topic, item in messages.items()]


# ---- all topics ---------------------------------------------------------------------------------

LAST_TIME = QoSProfile(depth=1)  # A newer time replaces one that waits.


class StatePublishers:
    """
    Publishes the state of a simulation.

    Attributes
    ----------
    sensors : SensorPublishers

    """

    def __init__(
        self, node: Node, simulation: Simulation, settings: Settings, *, has_clock: bool = True
    ) -> None:
        self._node, self._prefix = node, settings.frame_prefix
        if self._prefix == 'auto':
            self._prefix = f'{node.get_namespace()}/'.lstrip('/')
        self.sensors = SensorPublishers(node, self._prefix)
        self._joint_states = node.create_publisher(
            JointState,
            'joint_states',
            10,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._link_poses = node.create_publisher(PoseArray, 'link_poses', 10)
        self._odom = node.create_publisher(Odometry, 'odom', 10)
        self._markers = node.create_publisher(MarkerArray, 'markers', 10)
        self._marked = 0.0  # wall time of the last markers [s]
        clock = has_clock and settings.publish_clock
        description = settings.publish_robot_description
        self._clock = node.create_publisher(Clock, '/clock', LAST_TIME) if clock else None
        self._description = (
            node.create_publisher(String, 'robot_description', LATCHED) if description else None
        )
        self._transforms = None
        if settings.publish_tf and TransformMessages.available:
            self._transforms = Transforms(node, self._prefix)
        elif settings.publish_tf:
            node.get_logger().info('no /tf: the package tf2_msgs is not installed')
        self.begin(simulation, settings)

    def begin(self, simulation: Simulation, settings: Settings) -> None:
        """
        Publish the state of a simulation from now on, and at once its robot description.

        Raises
        ------
        ParameterError
            If its robot does not have the sensors of the settings. Nothing has changed then.

        """
        self.sensors.begin(simulation, settings)
        self._simulation, robot = simulation, simulation.scene.robot
        self._messages = StateMessages(robot, self._prefix)
        self._scene_markers = SceneMarkers(simulation.scene)
        if self._transforms:
            self._transforms.begin(base_name(robot))
        if self._description:
            text = robot_description(robot)
            if interfaces := settings.ros2_control.split():
                topics = map(self._node.resolve_topic_name, ('joint_command', 'joint_states'))
                given = dict(zip(('commands', 'states'), topics, strict=True))
                text = with_ros2_control(text, robot, interfaces, **given)
            self._description.publish(String(data=text))

    def publish(self, nanoseconds: int, held: JointReference | None = None) -> None:
        """
        Publish the state at a simulated time, then the clock.

        Parameters
        ----------
        nanoseconds : int
        held : JointReference, optional
            Angles and rates of the joints where they are known. Default: from the state, by
            compiled functions.

        """
        messages, simulation = self._messages, self._simulation
        motion = (held.angle, held.rate) if held else None
        messages.fill(nanoseconds, simulation.state, simulation.last.joint_torque, motion)
        self.sensors.reader.add_noise(messages.angle, messages.rate, messages.torque)
        self._joint_states.publish(bytes(messages.joint_states))
        self._link_poses.publish(bytes(messages.link_poses))
        self._odom.publish(bytes(messages.odom))
        if self._transforms:
            self._transforms.publish(stamp_from(nanoseconds), messages.base.tolist())
        self.sensors.publish(nanoseconds, contacts=held is None)
        if not held:
            self.publish_markers(nanoseconds)
        if self._clock:
            self._clock.publish(bytes(messages.clock))

    def show_obstacles(self, scene: Scene) -> None:
        """Show the obstacles of another scene from now on."""
        self._scene_markers = SceneMarkers(scene)

    def publish_markers(self, nanoseconds: int) -> None:
        """Publish contacts and obstacles, if somebody subscribed and the last ones are old."""
        if not self._markers.get_subscription_count():
            return
        now, simulation = time.monotonic(), self._simulation
        if now - self._marked >= MARKER_PERIOD:
            self._marked = now
            touched = contact_forces(simulation.scene, simulation.state, simulation.history)
            self._scene_markers.fill(stamp_from(nanoseconds), *touched)
            self._markers.publish(self._scene_markers.message)
