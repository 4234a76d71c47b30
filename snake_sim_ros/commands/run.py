# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim run`: a scene without ROS, and files of what it did."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
import json
import math
from pathlib import Path
import signal
import sys
from typing import Any, TYPE_CHECKING

from tqdm import tqdm

from snake_sim_ros.commands.output_files import (
    add_outputs,
    outputs,
    print_outputs,
    title_of,
    write,
)
from snake_sim_ros.commands.scene_options import (
    add_accuracy,
    add_method,
    add_scene_options,
    scene_with_accuracy,
)
from snake_sim_ros.commands.sensor_options import add_sensors, sensors_of
from snake_sim_ros.recording.recorded_runs import summary
from snake_sim_ros.recording.recorded_sensors import recorded_sensors
from snake_sim_ros.recording.sensors import Sensors
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.periods import samples_of
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.stepping.trajectory import Trajectory
from snake_sim_ros.studies.metrics import metrics_of_run

if TYPE_CHECKING:
    from snake_sim_ros.stepping.simulation import Simulation

RATE = 100.0  # samples a second [Hz]
BAG_RATE = 200.0  # samples a second with a bag, as `sim` publishes [Hz]


def add_run(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('run')
    command.set_defaults(command=_run)
    command.add_argument('scene', help='YAML file, or the name of a scene in config/')
    add_outputs(command, bag=True)
    command.add_argument('--rate', type=float, help='samples a second [Hz], default 100')
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
    sensors = sensors_of(options, scene.robot.link_count, rate)
    trajectory = _recorded(scene, rate, files.get('bag'), sensors)
    measured = recorded_sensors(trajectory, sensors)
    write(trajectory, files, title_of(options.scene), options.speed, measured)
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
    """Return what a scene does, sampled at a rate [Hz]; show its progress, and write a bag."""
    from snake_sim_ros.commands.compiling import compile_first
    from snake_sim_ros.stepping.simulation import run

    compile_first(scene)
    layout = '{percentage:3.0f} %|{bar}| {n:.2f} of {total:g} s, {remaining} left'
    with ExitStack() as stack:
        keep = _bag(stack, bag, scene, sensors, rate) if bag else None
        bar = stack.enter_context(tqdm(total=scene.duration, bar_format=layout))

        def observe(simulation: 'Simulation') -> None:
            if keep:
                with _later_interruption():
                    keep(simulation)

        def progress(seconds: float) -> None:
            # Rounding may exceed the total, and tqdm would warn of that.
            bar.update(min(seconds, bar.total) - bar.n)

        return run(scene, rate=rate, observe=observe if keep else None, progress=progress)


def _bag(
    stack: ExitStack, path: Path, scene: Scene, sensors: Sensors, rate: float
) -> Callable[['Simulation'], None]:
    """Open a bag for a run; return what writes a sample to it."""
    try:
        from snake_sim_ros.nodes.bag_writer import BagWriter, RunTopics
        from snake_sim_ros.nodes.state_publishers import SensorTopics
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
    """Let an interruption from the keyboard wait until what is inside is done."""
    waiting: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if waiting:
        raise KeyboardInterrupt
