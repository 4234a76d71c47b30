# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The files that `run` and `export` write a run to: their options, their checks, the writing."""

import argparse
from collections.abc import Callable, Mapping
from functools import partial
import math
from pathlib import Path

from tqdm import tqdm

from snake_sim_ros.recording.recorded_runs import write_csv, write_npz
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.trajectory import Trajectory

FORMATS = {'out': '.npz', 'csv': '.csv', 'bag': '.mcap', 'gif': '.gif', 'mp4': '.mp4'}


def add_outputs(command: argparse.ArgumentParser, *, bag: bool) -> None:
    """Add the options that name files to write."""
    texts = {
        'out': 'numbers of everything, for NumPy and for snake-sim view',
        'csv': 'a table with a row for each sample',
        'bag': 'the topics of sim and gait as a ROS 2 bag, 200 states a second unless --rate',
        'gif': 'an animation',
        'mp4': 'an animation',
    }
    for name, suffix in FORMATS.items():
        if bag or name != 'bag':
            command.add_argument(f'--{name}', type=Path, metavar=f'FILE{suffix}', help=texts[name])
    command.add_argument(
        '--speed', type=float, default=1.0,
        help='seconds of the run in a second of an animation, default 1',
    )  # fmt: skip


def outputs(options: argparse.Namespace) -> dict[str, Path]:
    """
    Return the files to write, by the names of their options.

    Raises
    ------
    ParameterError
        If a file has another suffix or its folder does not exist, if a bag exists already, if the
        speed is not usable, or if what an animation needs is not installed.

    """
    files = {name: path for name in FORMATS if (path := getattr(options, name, None))}
    for name, path in files.items():
        if path.suffix != FORMATS[name]:
            raise ParameterError(f'--{name} must end in {FORMATS[name]}, got {path}')
        if not path.absolute().parent.is_dir():
            raise ParameterError(f'--{name}: no folder {path.absolute().parent}')
        if name == 'bag' and path.exists():
            raise ParameterError(f'--bag: {path} exists; name another file, or delete this one')
    if not 0 < options.speed < math.inf:
        raise ParameterError(f'--speed must be above 0 and finite, got {options.speed:g}')
    if {'gif', 'mp4'} & files.keys():
        _animator()
    if 'mp4' in files:
        from snake_sim_ros.view.animation import ffmpeg

        ffmpeg()
    return files


def write(
    trajectory: Trajectory,
    files: dict[str, Path],
    title: str,
    speed: float,
    sensors: Mapping[str, Array] | None = None,
) -> None:
    """
    Write a trajectory in every format but that of a bag, which is written as a scene runs.

    Parameters
    ----------
    trajectory : Trajectory
    files : dict
        As `outputs` returns them.
    title : str
        The text beside the time in animations.
    speed : float
        Seconds of the run in a second of an animation.
    sensors : mapping, optional
        Arrays as `recorded_sensors` returns them.

    """
    if 'out' in files:
        write_npz(trajectory, files['out'], sensors)
    if 'csv' in files:
        write_csv(trajectory, files['csv'], sensors)
    for name in ('gif', 'mp4'):
        if name in files:
            frames = partial(tqdm, desc=files[name].name, unit=' frames', leave=False)
            _animator()(trajectory, files[name], title, speed, frames)


def print_outputs(trajectory: Trajectory, files: dict[str, Path]) -> None:
    """Print how many samples are in each file."""
    for path in files.values():
        print(f'{len(trajectory.time)} samples in {path}')


def title_of(source: str | Path) -> str:
    """Return the name of a scene or a recorded run in words."""
    return Path(source).stem.replace('_', ' ')


def _animator() -> Callable[..., None]:
    """Return the function that draws animations; raise if matplotlib is not installed."""
    try:
        from snake_sim_ros.view.animation import animate
    except ImportError as error:
        raise ParameterError(
            f"animations need matplotlib ({error}): pip install 'snake_sim_ros[plots]'"
        ) from None
    return animate
