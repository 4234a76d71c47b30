# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Options that commands share, their checks, and the scenes, sensors and files they stand for."""

import argparse
from collections.abc import Callable, Mapping
from functools import partial
import math
from pathlib import Path
from typing import Any

from tqdm import tqdm

from snake_sim_ros.gaits.blending import check_reach
from snake_sim_ros.recording.recorded_runs import write_csv, write_npz
from snake_sim_ros.recording.sensors import Sensors
from snake_sim_ros.scene.checked_records import from_mapping, ParameterError, quoted
from snake_sim_ros.scene.files import parse_yaml
from snake_sim_ros.scene.parameters import (
    Array,
    by_dotted_names,
    load_robot,
    load_scene,
    Robot,
    Scene,
    with_settings,
)
from snake_sim_ros.stepping.accuracy import USUAL_ACCURACY
from snake_sim_ros.stepping.methods import AUTO, METHODS, STEPPING, with_usual_steps
from snake_sim_ros.stepping.trajectory import Trajectory

# The cases A to D of the paper.
CASES = ('lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting')


# ---- scenes -------------------------------------------------------------------------------------


def add_method(command: argparse.ArgumentParser) -> None:
    """Add the option that replaces the method of the scene."""
    names = ', '.join([AUTO, *METHODS])
    command.add_argument('--method', help=f'override the method of the scene: {names}')


def add_accuracy(command: argparse.ArgumentParser) -> None:
    """Add the option that chooses the steps of the scene."""
    command.add_argument(
        '--accuracy', type=float, metavar='ERROR',
        help='target relative path error per gait cycle; steps are subdivided to meet it; default '
        f'{USUAL_ACCURACY:g} if neither {" nor ".join(STEPPING)} is given; 0: steps of the scene',
    )  # fmt: skip


def add_scene_options(command: argparse.ArgumentParser) -> None:
    """Add the options that change values of the scene."""
    command.add_argument('--duration', type=float, help='override the duration of the scene [s]')
    command.add_argument(
        '--set', action='append', default=[], metavar='KEY=VALUE',
        help='set any value of the scene, such as friction.longitudinal=0.2 or '
        'gait.yaw.amplitude_deg=30; may be repeated',
    )  # fmt: skip


def add_scene_or_default(command: argparse.ArgumentParser) -> None:
    """Add a scene as an optional argument."""
    command.add_argument('scene', nargs='?', default=CASES[0], help='default: lateral_undulation')


def scene_from(options: argparse.Namespace, source: str) -> Scene:
    """
    Return a scene with the values that the options of a command give.

    Parameters
    ----------
    options : Namespace
        Of a command with `add_scene_options`, and `add_method` if it has that.
    source : str
        A YAML file, or the name of a scene in config/.

    Raises
    ------
    ParameterError
        If there is no such scene, a value is invalid, or the gait exceeds the joint limit.

    """
    loaded = load_scene(source)
    scene = with_settings(loaded, given_settings(options))
    try:
        check_reach(scene.gait, scene.robot)
    except ParameterError as error:
        if scene.gait != loaded.gait or scene.robot != loaded.robot:
            raise
        raise ParameterError(f'{Path(source).name}: {error}') from None
    return scene


def given_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return the values given by the options of a command, by their dotted names in a scene."""
    settings = by_dotted_names(given_values(options.set, '--set'), Scene())
    if isinstance(settings.get('robot'), str):
        settings['robot'] = load_robot(settings['robot'], Path(), '--set')
    for key in ('duration', 'method', 'accuracy'):
        if getattr(options, key, None) is not None:
            settings[key] = getattr(options, key)
    return settings


def given_values(items: list[str], option: str) -> dict[str, Any]:
    """Return the values of KEY=VALUE items given with an option, by their keys."""
    values: dict[str, Any] = {}
    for item in items:
        key, separator, value = item.partition('=')
        if not separator:
            raise ParameterError(f'{option} must be KEY=VALUE, got {quoted(item)}')
        try:
            values[key] = parse_yaml(value)
        except ParameterError as error:
            raise ParameterError(f'{option} {key}: {error}') from None
    return values


def scene_with_accuracy(options: argparse.Namespace, source: str, period: float) -> Scene:
    """
    Return the scene of `scene_from`, with the steps that its accuracy requires, if it has one.

    Parameters
    ----------
    options : Namespace
        Of a command with `add_accuracy`, `add_method` and `add_scene_options`.
    source : str
        A YAML file, or the name of a scene in config/.
    period : float
        Time between two samples [s].

    Raises
    ------
    ParameterError
        If there is no such scene, or a value is invalid.

    """
    scene, given = scene_from(options, source), given_settings(options)
    return with_usual_steps(scene, given, period)


# ---- sensors ------------------------------------------------------------------------------------


OF_LINKS = {'imu': 'imu_links', 'contact_forces': 'contact_force_links'}


def add_sensors(command: argparse.ArgumentParser) -> None:
    """Add the options that select sensors and their errors."""
    imu, contacts = 'or frame of a link with an IMU', 'whose contacts are measured'
    for name, what in (('imu', imu), ('contact-forces', contacts)):
        command.add_argument(
            f'--{name}', action='append', default=[], metavar='LINK',
            help=f'link {what}: link_6, 6 or all; may be repeated',
        )  # fmt: skip
    command.add_argument(
        '--sensor', action='append', default=[], metavar='KEY=VALUE',
        help='noise, bias, rate or seed, named like the parameters of sim, such as '
        'imu_acceleration_noise=0.02; may be repeated',
    )  # fmt: skip


def sensors_of(options: argparse.Namespace, robot: Robot, rate: float) -> Sensors:
    """
    Return the sensors that the options of `add_sensors` choose.

    Parameters
    ----------
    options : Namespace
    robot : Robot
    rate : float
        States a second [Hz].

    Raises
    ------
    ParameterError
        If a value is invalid.

    """
    values = given_values(options.sensor, '--sensor')
    for option, name in OF_LINKS.items():
        if links := [parse_yaml(link) for link in getattr(options, option)]:
            if name in values:
                flag = option.replace('_', '-')
                raise ParameterError(f'links are given twice, by --{flag} and by --sensor {name}')
            values[name] = 'all' if 'all' in links else links
    sensors: Sensors = from_mapping(Sensors, values, '--sensor')
    sensors.imus(robot)
    sensors.links('contact_force_links', robot)
    sensors.states_in_sample(rate)
    return sensors


# ---- files to write -----------------------------------------------------------------------------


FORMATS = {'out': '.npz', 'csv': '.csv', 'bag': '.mcap', 'gif': '.gif', 'mp4': '.mp4'}


def add_outputs(command: argparse.ArgumentParser, *, bag: bool) -> None:
    """Add the options that name files to write."""
    texts = {
        'out': 'all results as NumPy arrays, also for snake-sim view',
        'csv': 'a table with one row per sample',
        'bag': 'the topics of sim and gait as a ROS 2 bag, 200 states a second by default',
        'gif': 'an animation',
        'mp4': 'an animation',
    }
    for name, suffix in FORMATS.items():
        if bag or name != 'bag':
            command.add_argument(f'--{name}', type=Path, metavar=f'FILE{suffix}', help=texts[name])
    command.add_argument(
        '--speed', type=float, default=1.0,
        help='simulated seconds per second of an animation, default 1',
    )  # fmt: skip


def outputs(options: argparse.Namespace) -> dict[str, Path]:
    """
    Return the files to write, by the names of their options.

    Raises
    ------
    ParameterError
        If a file has the wrong suffix, its folder does not exist, a bag already exists, the speed
        is invalid, or a package that an animation needs is not installed.

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


def write_outputs(
    trajectory: Trajectory,
    files: dict[str, Path],
    title: str,
    speed: float,
    sensors: Mapping[str, Array] | None = None,
) -> None:
    """
    Write a trajectory in all formats but bags, which are written while a scene runs.

    Parameters
    ----------
    trajectory : Trajectory
    files : dict
        As `outputs` returns them.
    title : str
        The text beside the time in animations.
    speed : float
        Simulated seconds per second of an animation.
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


def add_namespace(command: argparse.ArgumentParser) -> None:
    """Add the option."""
    command.add_argument(
        '--namespace', metavar='NAME', help='namespace of the robot, if a bag has several'
    )
