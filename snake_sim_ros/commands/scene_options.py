# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arguments with which several commands choose a scene and change it, and the scene they mean."""

import argparse
from pathlib import Path
from typing import Any

from snake_sim_ros.gaits.blending import check_reach
from snake_sim_ros.scene.checked_records import from_mapping, ParameterError
from snake_sim_ros.scene.dotted_names import by_dotted_names
from snake_sim_ros.scene.parameters import load_scene, Robot, Scene, with_settings
from snake_sim_ros.scene.quoting import quoted
from snake_sim_ros.scene.scene_files import find_file, read_mapping
from snake_sim_ros.scene.yaml_text import parse_yaml
from snake_sim_ros.stepping.accuracy import USUAL_ACCURACY
from snake_sim_ros.stepping.methods import AUTO, METHODS, STEPPING, with_usual_steps

# The cases A to D of the paper.
CASES = ('lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting')


def add_method(command: argparse.ArgumentParser) -> None:
    """Add the option that replaces the method of the scene."""
    names = ', '.join([AUTO, *METHODS])
    command.add_argument('--method', help=f'instead of that of the scene: {names}')


def add_accuracy(command: argparse.ArgumentParser) -> None:
    """Add the option that chooses the steps of the scene."""
    command.add_argument(
        '--accuracy', type=float, metavar='ERROR',
        help=f'relative error of the path in a gait cycle, default {USUAL_ACCURACY:g} if neither '
        f'{" nor ".join(STEPPING)} is given here or in the scene; 0: steps as in the scene',
    )  # fmt: skip


def add_scene_options(command: argparse.ArgumentParser) -> None:
    """Add the options that change values of the scene."""
    command.add_argument('--duration', type=float, help='instead of that of the scene [s]')
    command.add_argument(
        '--set', action='append', default=[], metavar='KEY=VALUE',
        help='any value of the scene, such as friction.longitudinal=0.2 or '
        'gait.yaw.amplitude_deg=30; may be given often',
    )  # fmt: skip


def add_scene_or_default(command: argparse.ArgumentParser) -> None:
    """Add a scene as an argument that may be left out."""
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
        If there is no such scene, a value is not usable, or the gait is beyond the joint limit.

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
    """Return the values that the options of a command give, by their dotted names in a scene."""
    settings = by_dotted_names(given_values(options.set, '--set'), Scene())
    if isinstance(settings.get('robot'), str):
        path = find_file(settings['robot'], Path(), '--set')
        settings['robot'] = from_mapping(Robot, read_mapping(path), path.name)
    for key in ('duration', 'method', 'accuracy'):
        if getattr(options, key, None) is not None:
            settings[key] = getattr(options, key)
    return settings


def given_values(items: list[str], option: str) -> dict[str, Any]:
    """Return the values of KEY=VALUE items that were given with an option, by their keys."""
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
    Return the scene of `scene_from` with the steps that its accuracy asks for, if it has one.

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
        If there is no such scene, or a value is not usable.

    """
    scene, given = scene_from(options, source), given_settings(options)
    return with_usual_steps(scene, given, period)
