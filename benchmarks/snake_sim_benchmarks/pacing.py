# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The measurement of how well the `sim` node keeps time, and what that costs.

The node runs in a process of its own, while the robot does lateral undulation as one long
trajectory. Processor times are those of its process. The middleware stamps each message when it is
published, so that delays of the probe do not count.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
import json
import random
import sys
from threading import Event
import time
from typing import Any

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
import rclpy
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
from visualization_msgs.msg import MarkerArray

from snake_sim_ros import ParameterError, Scene, Simulation
from snake_sim_ros.nodes.executors import make_executor
from snake_sim_ros.nodes.messages import seconds_from, stamp_from
from snake_sim_ros.nodes.programs import interruptible
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.nodes.tools.child_nodes import Child, children, Interrupted, NodeDied, start
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, load_scene, steps_in

# ---- a client of sim ----------------------------------------------------------------------------


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
    message = JointTrajectory(joint_names=list(scene.robot.axis_names))
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


# ---- measurements -------------------------------------------------------------------------------


SCENE = 'lateral_undulation'
RATE = 200.0  # Hz, the publish rate at real-time factor 1
PEACE = 0.5  # s for the node to come to rest after a change
JOINT = 'joint_5_yaw'
STEP = 0.02  # rad by which the joint steps back and forth
RESPONSE = 0.1  # N m, a change of its torque that only a command can cause
PAUSE = (8.0, 12.0)  # publish periods between two commands, at random
HURRY = 100.0  # real-time factor up to which the trajectory lasts as fast as possible
PERIODS = 1000  # of which the median is taken


@dataclass(frozen=True)
class Load:
    """The pace of the node under some load."""

    real_time_factor: float  # simulated time per wall time as set; 0 is as fast as possible
    publish_rate: float  # [Hz]
    listeners: str  # which topics have a subscriber
    reached: float  # simulated time per wall time that it reaches
    processor: float  # cores that its process uses
    us_per_period: float  # processor time for a publish period, of all threads of the process [µs]


def pacing(duration: float, rates: Sequence[float]) -> int:
    """
    Measure how the node keeps time and print it; the last line is JSON.

    Parameters
    ----------
    duration : float
        Duration of each part [s].
    rates : sequence of float
        Publish rates at which it runs as fast as possible [Hz].

    Returns
    -------
    int
        0; 1 if the node died; 130 if interrupted.

    Raises
    ------
    ParameterError
        If the duration or a rate is not usable, or if there is another robot.

    """
    if not duration > 0:
        raise ParameterError(f'--duration must be above 0 s, got {duration:g} s')
    scene = load_scene(SCENE)
    for rate in rates:
        steps_in(1.0 / Settings(publish_rate=rate).publish_rate, scene.dt, 'publish period')
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    try:
        with interruptible() as stop:
            print(json.dumps(measured(scene, duration, rates, stop)))
    except Interrupted:
        print('interrupted')
        return 130
    except NodeDied as error:
        print(f'./run pacing: {error}', file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()
    return 0


def measured(scene: Scene, duration: float, rates: Sequence[float], stop: Event) -> dict[str, Any]:
    """Return the results of all parts, and print them meanwhile."""
    with children() as nodes:
        nodes.append(start('sim', f'scene:={SCENE}', f'publish_rate:={RATE}'))
        loads, times = paced(nodes[-1], stop, scene, duration)
        for rate in rates:
            nodes.pop().end()
            nodes.append(start('sim', f'scene:={SCENE}', f'publish_rate:={rate}'))
            loads += free(nodes[-1], stop, scene, duration, rate)
    costs = period_costs(scene)
    print(f'wall time of parts of a period at {RATE:g} Hz, in this process, nobody listens:')
    for what, cost in costs.items():
        print(f'  {what:30} {cost:7.1f} us')
    return {
        'duration': duration,
        'loads': [asdict(load) for load in loads],
        **times,
        'us_per_period': costs,
    }


def paced(
    sim: Child, stop: Event, scene: Scene, duration: float
) -> tuple[list[Load], dict[str, Any]]:
    """Return the loads at real-time factor 1, and the jitter and the delay of effects."""
    loads = []
    with closing(SimProbe(sim, stop, JOINT)) as probe:
        probe.connect()
        loads.append(load(probe, scene, duration, 'nobody', RATE, 1.0))
        probe.listen()
        loads.append(load(probe, scene, duration, 'all default topics', RATE, 1.0))
        times = {'jitter_ms': jitter(probe.states), 'effect': effect(probe, duration)}
        probe.hear('markers', MarkerArray, QoSProfile(depth=10))
        loads.append(load(probe, scene, duration, 'markers as well', RATE, 1.0))
    print('between two states, off the period [ms]; from a command to the state that shows it:')
    for name, values in (times['jitter_ms'] | times['effect']).items():
        print(f'  {name:22}', *(f'{key} {value:7.3f}  ' for key, value in values.items()))
    return loads, times


def free(sim: Child, stop: Event, scene: Scene, duration: float, rate: float) -> list[Load]:
    """Return the loads of a node that runs as fast as possible."""
    loads = []
    with closing(SimProbe(sim, stop, JOINT, fast=True)) as probe:
        probe.connect()
        loads.append(load(probe, scene, duration, 'nobody', rate, 0.0))
        probe.listen()
        loads.append(load(probe, scene, duration, 'all default topics', rate, 0.0))
    return loads


def load(
    probe: SimProbe, scene: Scene, duration: float, listeners: str, rate: float, factor: float
) -> Load:
    """Let the robot crawl at a real-time factor; return and print the pace of the node."""
    probe.hurry(factor)
    probe.reset()
    probe.crawl(scene, (factor or HURRY) * (PEACE + duration))
    probe.spin(PEACE)
    probe.states.clear()
    begin = probe.clock()
    probe.spin(duration)
    simulated, wall, processor = np.subtract(probe.clock(), begin).tolist()
    probe.sim.check()
    periods = rate * simulated
    result = Load(
        factor, rate, listeners, simulated / wall, processor / wall, 1e6 * processor / periods
    )
    print(
        f'  {"as fast as possible" if factor == 0 else f"real-time factor {factor:g}":20} '
        f'{rate:4g} Hz  heard by {listeners:18} reached {result.reached:6.2f}, '
        f'{100 * result.processor:4.0f} % of a core, {result.us_per_period:4.0f} us a period',
        flush=True,
    )
    return result


def jitter(states: list[Noted]) -> dict[str, dict[str, float]]:
    """Return by how much [ms] times between two states differ from the period."""
    periods = np.diff([state.stamp for state in states])
    return {
        name: spread(1e3 * np.abs(np.diff(times) - periods))
        for name, times in (
            ('published', [state.published for state in states]),
            ('received', [state.arrived for state in states]),
        )
    }


def effect(probe: SimProbe, duration: float) -> dict[str, dict[str, float]]:
    """
    Return the time from a command to the first state that shows its effect.

    The robot lies still. Commands make one joint step back and forth, at random phases of the
    publish period; its torque changes in the first step that knows the command. The result has
    publish periods from the last state before the command, so that 1 is the best, and wall times
    until the state is published and received.
    """
    probe.hurry(1.0)
    probe.reset()
    probe.spin(PEACE)
    end = time.monotonic() + duration
    answers, angle = [], 0.0
    while time.monotonic() < end:
        angle = STEP - angle
        answers.append(response(probe, angle))
    names = ('periods', 'ms until published', 'ms until received')
    return dict(zip(names, map(spread, np.transpose(answers)), strict=True))


def response(probe: SimProbe, angle: float) -> tuple[float, float, float]:
    """Return periods, ms until published and ms until received, of one command."""
    states = probe.states
    states.clear()
    probe.spin(random.uniform(*PAUSE) / RATE)
    probe.until(lambda: states, 'state')
    before, sent = states[-1].effort, time.time()
    probe.commands.publish(JointState(name=[JOINT], position=[angle]))

    def effects() -> list[Noted]:
        later = (item for item in states if item.published > sent)
        return [item for item in later if abs(item.effort - before) > RESPONSE]

    probe.until(effects, 'effect of a command')
    first = effects()[0]
    last = max(item.stamp for item in states if item.published < sent)
    return (
        RATE * (first.stamp - last),
        1e3 * (first.published - sent),
        1e3 * (first.arrived - sent),
    )


def spread(values: Array) -> dict[str, float]:
    """Return median, 99 % quantile and maximum of some values."""
    p50, p99 = np.quantile(values, [0.5, 0.99]).tolist()
    return {'p50': p50, 'p99': p99, 'max': float(values.max())}


def period_costs(scene: Scene) -> dict[str, float]:
    """Return name -> median time of a part of a publish period [us], without subscribers."""
    simulation, node = Simulation(scene), Node('pacing')
    simulation.compile(scene.gait)
    messages = StateMessages(scene.robot)
    publishers = [
        (node.create_publisher(JointState, '~/joint_states', 10), messages.joint_states),
        (node.create_publisher(PoseArray, '~/link_poses', 10), messages.link_poses),
        (node.create_publisher(Odometry, '~/odom', 10), messages.odom),
        (node.create_publisher(Clock, '~/clock', 1), messages.clock),
    ]
    steps = steps_in(1 / RATE, scene.dt, 'publish period')
    marks = []
    for _ in range(PERIODS):
        reference = simulation.gait_reference(steps)
        mark = [time.perf_counter()]
        report = simulation.advance(*reference)
        mark.append(time.perf_counter())
        messages.fill(round(1e9 * simulation.time), simulation.state, report.joint_torque)
        mark.append(time.perf_counter())
        for publisher, message in publishers:
            publisher.publish(bytes(message))
        mark.append(time.perf_counter())
        marks.append(mark)
    node.destroy_node()
    names = (f'{steps} steps of physics', 'filling the state messages', 'publishing them')
    return dict(zip(names, np.median(1e6 * np.diff(marks), axis=0).tolist(), strict=True))
