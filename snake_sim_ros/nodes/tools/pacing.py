"""
How well the `sim` node keeps time, and what that costs.

The node runs in a process of its own, while the robot does lateral undulation as one long
trajectory. Processor times are those of its process; the times at which it publishes are what the
middleware notes with every message, so that delays of the watcher are not in them.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from dataclasses import dataclass
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

from snake_sim_ros.nodes.messages import StateMessages
from snake_sim_ros.nodes.sim_node import Settings
from snake_sim_ros.nodes.tools.processes import Child
from snake_sim_ros.nodes.tools.processes import children
from snake_sim_ros.nodes.tools.processes import Interrupted
from snake_sim_ros.nodes.tools.processes import interruptible
from snake_sim_ros.nodes.tools.processes import NodeDied
from snake_sim_ros.nodes.tools.processes import start
from snake_sim_ros.nodes.tools.watcher import Noted
from snake_sim_ros.nodes.tools.watcher import Watcher
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.quantities import ParameterError
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.simulation import steps_in

SCENE = 'lateral_undulation'
RATE = 200.0  # Hz, the publish rate at real-time factor 1
PEACE = 0.5  # s, for the node to come to rest after a change
JOINT = 'joint_5_yaw'
STEP = 0.02  # rad, back and forth, of the joint whose response is awaited
RESPONSE = 0.1  # N m, a change of its torque that only a command makes
PAUSE = (8.0, 12.0)  # publish periods between two commands
HURRY = 100.0  # real-time factor that the trajectory of a free run is long enough for
PERIODS = 1000  # to take the median of


@dataclass(frozen=True)
class Load:
    """
    What the node does under some load.

    Attributes
    ----------
    real_time_factor : float
        Simulated time per wall time that is asked for; 0 is as fast as possible.
    publish_rate : float
        [Hz]
    listeners : str
        Who listens.
    reached : float
        Simulated time per wall time that it reaches.
    processor : float
        Cores that its process uses.
    us_per_period : float
        Processor time for one publish period, of all threads of the process [µs].

    """

    real_time_factor: float
    publish_rate: float
    listeners: str
    reached: float
    processor: float
    us_per_period: float


def pacing(duration: float, rates: Sequence[float]) -> int:
    """
    Measure how the node keeps time and print it; the last line is JSON.

    Parameters
    ----------
    duration : float
        Of each part [s].
    rates : sequence of float
        Publish rates at which it runs as fast as possible [Hz].

    Returns
    -------
    int
        0; 1 if the node died; 130 if interrupted.

    Raises
    ------
    ParameterError
        If the duration or a rate is not usable, or if there is another robot on the graph.

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
    """Return what all parts measured, and print it meanwhile."""
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
    """Return what the node does at real-time factor 1, and jitter and time to the effect."""
    loads = []
    with closing(Watcher(sim, stop, JOINT)) as watcher:
        watcher.connect()
        loads.append(load(watcher, scene, duration, 'nobody', RATE, 1.0))
        watcher.listen()
        loads.append(load(watcher, scene, duration, 'all default topics', RATE, 1.0))
        times = {'jitter_ms': jitter(watcher.states), 'effect': effect(watcher, duration)}
        watcher.hear('markers', MarkerArray, QoSProfile(depth=10))
        loads.append(load(watcher, scene, duration, 'markers as well', RATE, 1.0))
    print('between two states, off the period [ms]; from a command to the state that shows it:')
    for name, values in (times['jitter_ms'] | times['effect']).items():
        print(f'  {name:22}', *(f'{key} {value:7.3f}  ' for key, value in values.items()))
    return loads, times


def free(sim: Child, stop: Event, scene: Scene, duration: float, rate: float) -> list[Load]:
    """Return what the node does as fast as possible."""
    loads = []
    with closing(Watcher(sim, stop, JOINT, fast=True)) as watcher:
        watcher.connect()
        loads.append(load(watcher, scene, duration, 'nobody', rate, 0.0))
        watcher.listen()
        loads.append(load(watcher, scene, duration, 'all default topics', rate, 0.0))
    return loads


def load(
    watcher: Watcher, scene: Scene, duration: float, listeners: str, rate: float, factor: float
) -> Load:
    """Let the robot crawl at a real-time factor and return and print what the node does."""
    watcher.hurry(factor)
    watcher.reset()
    watcher.crawl(scene, (factor or HURRY) * (PEACE + duration))
    watcher.spin(PEACE)
    watcher.states.clear()
    begin = watcher.clock()
    watcher.spin(duration)
    simulated, wall, processor = np.subtract(watcher.clock(), begin).tolist()
    watcher.sim.check()
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
    """Return how far times between two states are from the period, as sent and as received."""
    periods = np.diff([state.stamp for state in states])
    return {
        name: spread(1e3 * np.abs(np.diff(times) - periods))
        for name, times in (
            ('published', [state.published for state in states]),
            ('received', [state.arrived for state in states]),
        )
    }


def effect(watcher: Watcher, duration: float) -> dict[str, dict[str, float]]:
    """
    Return how long it takes from a command to the first state that shows its effect.

    The robot lies still. One joint is told to step back and forth, at random phases of the publish
    period; its torque answers in the first step that knows the command. Counted are publish
    periods from the last state before the command, so 1 is the best, and wall time until the
    state is published and received.
    """
    watcher.hurry(1.0)
    watcher.reset()
    watcher.spin(PEACE)
    end = time.monotonic() + duration
    answers, angle = [], 0.0
    while time.monotonic() < end:
        angle = STEP - angle
        answers.append(response(watcher, angle))
    names = ('periods', 'ms until published', 'ms until received')
    return dict(zip(names, map(spread, np.transpose(answers)), strict=True))


def response(watcher: Watcher, angle: float) -> tuple[float, float, float]:
    """Return periods, and ms until published and received, from a command to its effect."""
    states = watcher.states
    states.clear()
    watcher.spin(random.uniform(*PAUSE) / RATE)
    watcher.until(lambda: states, 'state')
    before, sent = states[-1].effort, time.time()
    watcher.commands.publish(JointState(name=[JOINT], position=[angle]))

    def effects() -> list[Noted]:
        later = (item for item in states if item.published > sent)
        return [item for item in later if abs(item.effort - before) > RESPONSE]

    watcher.until(effects, 'effect of a command')
    first = effects()[0]
    last = max(item.stamp for item in states if item.published < sent)
    return (
        RATE * (first.stamp - last),
        1e3 * (first.published - sent),
        1e3 * (first.arrived - sent),
    )


def spread(values: Array) -> dict[str, float]:
    """Return median, 99 % quantile and largest of some values."""
    p50, p99 = np.quantile(values, [0.5, 0.99]).tolist()
    return {'p50': p50, 'p99': p99, 'max': float(values.max())}


def period_costs(scene: Scene) -> dict[str, float]:
    """Return name -> median time of the parts of a publish period [us], nobody listening."""
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
