# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A probe of one `sim`: when its states arrive, how its clock runs, what processor it uses."""

from collections.abc import Callable
from dataclasses import dataclass
from threading import Event
import time
from typing import Any

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.messages import joint_names, seconds_from, stamp_from
from snake_sim_ros.nodes.tools.child_nodes import Child, Interrupted, NodeDied
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene

TIMEOUT = 90.0  # s for compiling and discovery
ANSWER = 10.0  # s for everything else
POINT = 0.1  # s between the points of a trajectory
TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    'link_poses': (PoseArray, QoSProfile(depth=10)),
    'odom': (Odometry, QoSProfile(depth=10)),
    '/clock': (Clock, QoSProfile(depth=1)),
    '/diagnostics': (DiagnosticArray, QoSProfile(depth=10)),
    'robot_description': (
        String,
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    ),
}


@dataclass(frozen=True)
class Noted:
    """A message of joint_states that arrived."""

    stamp: float  # simulated time [s]
    published: float  # wall times [s]
    arrived: float
    effort: float  # torque of one joint [N m]


class SimProbe:
    """
    A node that measures and commands one `sim`, with its executor.

    Parameters
    ----------
    sim : Child
    stop : Event
        A signal sets it.
    joint : str
        Name of the joint whose torque is kept.
    fast : bool
        Serve messages at the least cost, and keep no times of joint_states.

    Attributes
    ----------
    states : list of Noted
        The messages of joint_states that arrived.

    """

    def __init__(self, sim: Child, stop: Event, joint: str, *, fast: bool = False) -> None:
        self.sim, self.stop, self.joint, self.fast = sim, stop, joint, fast
        self.node = Node('pacing')
        self.executor = make_executor(self.node) if fast else SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.heard: set[str] = set()
        self.states: list[Noted] = []
        self.commands = self.node.create_publisher(JointState, 'joint_command', 1)
        self.trajectories = self.node.create_publisher(JointTrajectory, 'joint_trajectory', 1)
        self.parameters = AsyncParameterClient(self.node, 'sim')
        self.resets = self.node.create_client(Trigger, 'sim/reset')

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()

    def until(self, condition: Callable[[], Any], what: str = '', timeout: float = ANSWER) -> None:
        """
        Serve messages until a condition holds.

        Raises
        ------
        Interrupted
        NodeDied
            If time is up, and `what` names what should have come.

        """
        end = time.monotonic() + timeout
        while not condition():
            if self.stop.is_set():
                raise Interrupted
            left = end - time.monotonic()
            if left <= 0.0:
                if what:
                    self.sim.check()
                    raise NodeDied(f'no {what} within {timeout:g} s')
                return
            self.executor.spin_once(timeout_sec=min(left, 0.1))

    def spin(self, seconds: float) -> None:
        """Serve messages for some time [s]."""
        self.until(lambda: False, timeout=seconds)

    def connect(self) -> None:
        """Wait until the node can be reached."""
        self.until(self.is_connected, 'answer from sim', TIMEOUT)
        if (count := self.node.count_publishers('joint_states')) > 1:
            raise ParameterError(
                f'joint_states has {count} publishers, and one is to be measured: end the other '
                f'robots, or set ROS_DOMAIN_ID to a domain without any'
            )

    def is_connected(self) -> bool:
        """Return whether commands and requests reach the node."""
        self.sim.check()
        services = self.parameters.services_are_ready() and self.resets.service_is_ready()
        topics = (self.commands, self.trajectories)
        return services and all(topic.get_subscription_count() for topic in topics)

    def ask(self, future: Any) -> None:
        """Wait for the response of a service."""
        self.until(future.done, 'response of a service')

    def listen(self) -> None:
        """Subscribe to all default topics and wait for a message of all that are periodic."""
        if self.fast:
            self.hear('joint_states', JointState, QoSProfile(depth=10))
        else:
            self.node.create_subscription(JointState, 'joint_states', self._note, 10)
        for topic, (kind, profile) in TOPICS.items():
            self.hear(topic, kind, profile)
        streams = {'joint_states', *TOPICS} - {'/diagnostics'}
        self.until(lambda: self.heard >= streams, 'message on every topic')

    def hear(self, topic: str, kind: Any, profile: QoSProfile) -> None:
        """Subscribe to a topic, and keep only that it has messages."""
        self.node.create_subscription(
            kind, topic, lambda _: self.heard.add(topic), profile, raw=True
        )

    def _note(self, message: JointState, info: dict[str, int]) -> None:
        self.heard.add('joint_states')
        effort = message.effort[message.name.index(self.joint)]
        published = 1e-9 * info['source_timestamp']
        self.states.append(
            Noted(seconds_from(message.header.stamp), published, time.time(), effort)
        )

    def reset(self) -> None:
        """Put the robot back to its start; it holds its posture."""
        self.ask(self.resets.call_async(Trigger.Request()))

    def hurry(self, factor: float) -> None:
        """Set the real-time factor."""
        parameter = Parameter('real_time_factor', value=factor)
        self.ask(self.parameters.set_parameters([parameter]))

    def crawl(self, scene: Scene, seconds: float) -> None:
        """Let the robot follow the gait of a scene for some simulated time [s]."""
        self.trajectories.publish(trajectory(scene, seconds))

    def clock(self) -> tuple[float, float, float]:
        """Return simulated time, wall time and processor time of the node [s]."""
        times: list[tuple[float, float, float]] = []

        def note(message: Clock) -> None:
            now = time.monotonic()
            times.append((seconds_from(message.clock), now, processor_time(self.sim)))

        subscription = self.node.create_subscription(Clock, '/clock', note, 1)
        self.until(lambda: times, 'clock')
        self.node.destroy_subscription(subscription)
        return times[-1]


def processor_time(child: Child) -> float:
    """Return the processor time of a process [s], from the clock of clock_getcpuclockid(3)."""
    return time.clock_gettime(~child.process.pid << 3 | 2)


def trajectory(scene: Scene, seconds: float) -> JointTrajectory:
    """Return the gait of a scene as a trajectory that begins now."""
    axes = scene.robot.link_count - 1
    message = JointTrajectory(joint_names=joint_names(axes + 1))
    times = np.arange(0.0, seconds + POINT, POINT)
    for t, *reference in zip(times, *gait.reference(scene.gait, times, axes), strict=True):
        angle, rate = (part.ravel().tolist() for part in reference)
        stamp = stamp_from(round(1e9 * t))
        begin = Duration(sec=stamp.sec, nanosec=stamp.nanosec)
        message.points.append(
            JointTrajectoryPoint(positions=angle, velocities=rate, time_from_start=begin)
        )
    message.points[-1].velocities = [0.0] * len(message.joint_names)
    return message
