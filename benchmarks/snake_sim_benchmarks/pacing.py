# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The measurement of how well the `sim` node keeps time, and what that costs.

The node runs in a process of its own, while the robot does lateral undulation as one long
trajectory. Processor times are those of its process. The middleware stamps each message when it is
published, so that delays of the probe do not count.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
import json
import random
import sys
from threading import Event
import time
from typing import Any

from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from snake_sim_benchmarks.sim_probe import Noted, SimProbe
from snake_sim_ros.nodes.programs import interruptible
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.state_messages import StateMessages
from snake_sim_ros.nodes.tools.child_nodes import Child, children, Interrupted, NodeDied, start
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, load_scene, Scene, steps_in
from snake_sim_ros.stepping.simulation import Simulation

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
        print(f'snake-sim pacing: {error}', file=sys.stderr)
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
