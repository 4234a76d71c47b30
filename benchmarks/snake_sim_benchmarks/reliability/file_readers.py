# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What reads files of every kind, as commands and nodes do, and goes on with what was read.

This runs in a process of its own, which the reader may exhaust or kill. It answers for each file
what came of it.
"""

from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
import os
from pathlib import Path
import resource
import sys
import time
from typing import NamedTuple

import rclpy

from snake_sim_benchmarks.comparison.csv_tables import read_table
from snake_sim_ros import ParameterError, Scene, Simulation
from snake_sim_ros.gaits.blending import check_reach
from snake_sim_ros.nodes.gait_node import GaitNode
from snake_sim_ros.nodes.node_process import initialize, made
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.recording.recorded_runs import read_npz, read_run, summary, write_csv, write_npz
from snake_sim_ros.scene.files import parse_yaml
from snake_sim_ros.scene.parameters import (
    load_scene,
    samples_of,
    scene_from_text,
    scene_to_text,
    with_settings,
)
from snake_sim_ros.scene.robot_description import robot_of
from snake_sim_ros.stepping.methods import with_usual_steps
from snake_sim_ros.studies.problem import load_problem
from snake_sim_ros.studies.recorded_motion import read_recording
from snake_sim_ros.studies.study import load_study
from snake_sim_ros.studies.table import Journal


def start_and_end(arguments: Sequence[str]) -> None:
    """
    Make the node `gait` as its process does, and end it.

    Parameters
    ----------
    arguments : sequence of str
        What would stand after ``--ros-args``.

    Raises
    ------
    ParameterError
        If the node does not start with them.

    """
    initialize(['gait', '--ros-args', *arguments])
    try:
        made(GaitNode).destroy_node()
    finally:
        rclpy.try_shutdown()


LONGEST_SENTENCE = 2000  # characters; names of all keys or parameters may be in it
ADDRESS_SPACE = 4_000_000_000  # bytes beyond those that the process has, where a bomb ends


class Answer(NamedTuple):
    """What came of a file."""

    wrong: str  # empty if it was read, or refused in one sentence
    was_read: bool
    seconds: float  # of the processor
    memory: float  # peak of the process so far [MB]


def _build(scene: Scene) -> None:
    """Make the simulation of a scene, without compiling or stepping, and that of its steps."""
    check_reach(scene.gait, scene.robot)
    Simulation(scene)
    if scene_from_text(scene_to_text(scene)) != scene:
        raise AssertionError('the scene is another one after it was written and read')
    samples_of(with_usual_steps(scene, {}, 0.01), 100.0)


def _scene(path: Path) -> None:
    _build(load_scene(path))


def _robot(path: Path) -> None:
    _build(load_scene(path.with_name('scene_of_robot.yaml')))


def _settings(path: Path) -> None:
    """Read lines KEY=VALUE as they come with the option --set."""
    settings = {}
    for line in path.read_text(encoding='utf-8', errors='replace').splitlines():
        key, _, value = line.partition('=')
        settings[key] = parse_yaml(value)
    _build(with_settings(Scene(), settings))


def _study(path: Path) -> None:
    study = load_study(path)
    for number in range(min(len(study.variations), 3)):
        with_settings(study.scene, study.variations.row(number))


def _optimization(path: Path) -> None:
    problem = load_problem(path)
    problem.present()
    problem.check_plan()


def _urdf(path: Path) -> None:
    robot_of(path.read_text(encoding='utf-8', errors='surrogateescape'))


def _run(path: Path) -> None:
    trajectory = read_npz(path)
    summary(trajectory)
    write_csv(trajectory.every(2), path.with_suffix('.csv'))
    write_npz(trajectory, path.with_name('again.npz'))
    trajectory.contacts(0)


def _checkpoint(path: Path) -> None:
    simulation = checkpoint.read(path)
    simulation.gait_reference(1)
    checkpoint.write(simulation, path.with_name('again.npz'))


def _bag(path: Path) -> None:
    refused: list[ParameterError] = []
    for read in (read_run, read_recording):
        try:
            read(path)
        except ParameterError as error:
            refused.append(error)
    if refused:
        raise max(refused, key=lambda error: len(str(error)))


def _journal(path: Path) -> None:
    journal = Journal(path)
    journal.runs()
    journal.close()


def _parameters(path: Path) -> None:
    """Make a node with a file of parameters, which the parser of ROS reads first."""
    start_and_end(['--params-file', str(path), '--disable-rosout-logs'])


READERS: dict[str, Callable[[Path], object]] = {
    'scene.yaml': _scene,
    'robot.yaml': _robot,
    'settings.txt': _settings,
    'study.yaml': _study,
    'optimization.yaml': _optimization,
    'robot.urdf': _urdf,
    'run.npz': _run,
    'checkpoint.npz': _checkpoint,
    'bag.mcap': _bag,
    'table.csv': read_table,
    'study.journal': _journal,
    'parameters.yaml': _parameters,
}


def read(path: Path) -> Answer:
    """Read a file, whose name says of what kind it is."""
    wrong, was_read, begin = '', False, time.process_time()
    try:
        READERS[path.name](path)
        was_read = True
    except ParameterError as error:
        sentence = str(error)
        if not sentence.isprintable() or len(sentence) > LONGEST_SENTENCE + 2 * len(str(path)):
            wrong = f'a message of {len(sentence)} characters: {sentence[:200]!r}'
    except Exception as error:
        wrong = f'{type(error).__name__}: {str(error)[:200]}'
    seconds = time.process_time() - begin
    return Answer(wrong, was_read, seconds, peak())


def peak() -> float:
    """Return the peak of the resident memory of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def serve(connection: Connection) -> None:
    """Answer with the result of each file whose path comes, until there is no other one."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())  # parsers of ROS write there
    pages = int(Path('/proc/self/statm').read_text(encoding='ascii').split()[0])
    most = pages * resource.getpagesize() + ADDRESS_SPACE
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    while True:
        try:
            path = connection.recv()
        except EOFError:
            return
        connection.send(read(Path(path)))
