# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands on a scene: `snake-sim run`, `demo`, `urdf` and `sdf`."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
import json
import math
from pathlib import Path
import signal
import sys
from typing import Any

from tqdm import tqdm

from snake_sim_ros.commands.options import (
    add_accuracy,
    add_method,
    add_outputs,
    add_scene_options,
    add_scene_or_default,
    add_sensors,
    outputs,
    print_outputs,
    scene_from,
    scene_with_accuracy,
    sensors_of,
    title_of,
    write_outputs,
)
from snake_sim_ros.nodes.programs import missing_ros
from snake_sim_ros.recording.recorded_runs import summary
from snake_sim_ros.recording.sensors import recorded_sensors, Sensors
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import samples_of, Scene
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.scene.sdf import write_sdf
from snake_sim_ros.scene.urdf_ros2_control import with_ros2_control
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.simulation import simulate, Simulation
from snake_sim_ros.stepping.trajectory import Trajectory
from snake_sim_ros.studies.metrics import metrics_of_run
from snake_sim_ros.view.compile_bar import compile_with_bar

RATE = 100.0  # samples a second [Hz]
LOOK = 0.1  # s between two looks at the compiler
BAG_RATE = 200.0  # samples a second with a bag, as `sim` publishes [Hz]


# ---- run ----------------------------------------------------------------------------------------


def add_run(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('run')
    command.set_defaults(command=_run)
    command.add_argument('scene', help='YAML file, or the name of a scene in config/')
    add_outputs(command, bag=True)
    command.add_argument(
        '--rate', type=float, help='samples per second [Hz], default 100, with --bag 200'
    )
    add_accuracy(command)
    add_method(command)
    add_scene_options(command)
    add_sensors(command)


def _run(options: argparse.Namespace) -> int:
    """Run a scene and write what it did; the last line on standard output is JSON."""
    files = outputs(options)
    usual = BAG_RATE if 'bag' in files else RATE
    rate = usual if options.rate is None else options.rate
    if not 0.0 < rate < math.inf:
        raise ParameterError(f'rate must be above 0 Hz and finite, got {rate:g} Hz')
    scene = scene_with_accuracy(options, options.scene, 1.0 / rate)
    make_stepper(scene)
    steps, samples = samples_of(scene, rate)
    make_samples(scene, steps, samples + 1)  # whether memory suffices
    sensors = sensors_of(options, scene.robot, rate)
    trajectory = _recorded(scene, rate, files.get('bag'), sensors)
    measured = recorded_sensors(trajectory, sensors)
    write_outputs(trajectory, files, title_of(options.scene), options.speed, measured)
    report, link = trajectory.report, scene.robot.middle_link
    x, y, z = trajectory.position[-1, link]
    print(f'link {link + 1} at ({x:.4f}, {y:.4f}, {z:.4f}) m after {trajectory.time[-1]:g} s')
    if report.failure:
        print(f'diverged: {report.failure}', file=sys.stderr)
    print_outputs(trajectory, files)
    print(json.dumps({**summary(trajectory), **metrics_of_run(trajectory)}))
    if report.status is Status.DIVERGED:
        return 1
    return 130 if trajectory.interrupted else 0


def _recorded(scene: Scene, rate: float, bag: Path | None, sensors: Sensors) -> Trajectory:
    """Return the trajectory of a scene, sampled at a rate [Hz]; show its progress, write a bag."""
    compile_with_bar(Simulation(scene))
    layout = '{percentage:3.0f} %|{bar}| {n:.2f} of {total:g} s, {remaining} left'
    with ExitStack() as stack:
        keep = _bag(stack, bag, scene, sensors, rate) if bag else None
        bar = stack.enter_context(tqdm(total=scene.duration, bar_format=layout))

        def observe(simulation: Simulation) -> None:
            if keep:
                with _later_interruption():
                    keep(simulation)

        def progress(seconds: float) -> None:
            # Rounding may exceed the total, and tqdm would warn of that.
            bar.update(min(seconds, bar.total) - bar.n)

        return simulate(scene, rate=rate, observe=observe if keep else None, progress=progress)


def _bag(
    stack: ExitStack, path: Path, scene: Scene, sensors: Sensors, rate: float
) -> Callable[[Simulation], None]:
    """Open a bag for a run; return what writes a sample to it."""
    try:
        from snake_sim_ros.nodes.bag_writer import BagWriter, RunTopics
        from snake_sim_ros.nodes.sensor_topics import SensorTopics
    except ImportError as error:
        raise ParameterError(
            f'--bag needs ROS 2 and mcap ({error}): source a ROS 2 installation, or ./run run, '
            f"and pip install 'snake_sim_ros[bags]'"
        ) from None
    writer = stack.enter_context(BagWriter(path, scene))
    measure = SensorTopics(writer, sensors, rate).measure if sensors != Sensors() else None
    return RunTopics(writer, scene, measure).observe


@contextmanager
def _later_interruption() -> Iterator[None]:
    """Defer an interruption from the keyboard to the end of the block."""
    waiting: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if waiting:
        raise KeyboardInterrupt


# ---- demo ---------------------------------------------------------------------------------------


def add_demo(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('demo')
    command.set_defaults(command=_demo)
    add_scene_or_default(command)
    command.add_argument(
        '--duration', type=float, default=15.0, help='duration of the gait [s], default 15'
    )
    command.add_argument(
        '--out', type=Path, default=Path('demo.png'), metavar='FILE.png', help='default: demo.png'
    )


def _demo(options: argparse.Namespace) -> int:
    try:
        from snake_sim_ros.nodes.tools.demo import demo
    except ImportError as error:
        raise missing_ros('the demo', 'demo', error) from None
    return demo(options.scene, options.duration, options.out)


# ---- urdf ---------------------------------------------------------------------------------------


def add_urdf(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('urdf')
    command.set_defaults(command=_urdf)
    add_scene_or_default(command)
    add_scene_options(command)
    command.add_argument(
        '--ros2-control', nargs='*', metavar='INTERFACE',
        help='add a <ros2_control> element with these command interfaces: position (default), '
        'velocity, effort',
    )  # fmt: skip


def _urdf(options: argparse.Namespace) -> int:
    robot = scene_from(options, options.scene).robot
    text = robot_description(robot)
    if options.ros2_control is not None:
        text = with_ros2_control(text, robot, options.ros2_control or ['position'])
    print(text)
    return 0


# ---- sdf ----------------------------------------------------------------------------------------


def add_sdf(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('sdf')
    command.set_defaults(command=_sdf)
    command.add_argument('scene', help='YAML file, or the name of a scene in config/')
    add_scene_options(command)
    command.add_argument(
        '--out', type=Path, default=Path('world.sdf'), metavar='FILE.sdf',
        help='default: world.sdf; meshes are written beside it',
    )  # fmt: skip


def _sdf(options: argparse.Namespace) -> int:
    world = scene_from(options, options.scene).world
    if not world:
        raise ParameterError(f'{options.scene} has no world')
    for path in write_sdf(world, options.out):
        print(path)
    return 0
