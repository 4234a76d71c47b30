# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The controller that a scene names: one of the package, or a class of the user.

A name with a colon is that of a class, or of a function that returns a controller:
``package.module:Name`` for what can be imported, ``file.py:Name`` for a file. The values beside
the name are its keyword arguments. Whoever runs a scene with such a name runs the code it names.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
import inspect
from pathlib import Path
import sys
from types import ModuleType
from typing import Any

from snake_sim_ros.controllers.compliance import ShapeCompliance
from snake_sim_ros.controllers.controller import Controller
from snake_sim_ros.controllers.following import PathFollower
from snake_sim_ros.controllers.obstacle_aided import ObstacleAided
from snake_sim_ros.controllers.oscillators import CentralPatternGenerator
from snake_sim_ros.controllers.partitioning import PartitionedGait
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, nearest, ParameterError
from snake_sim_ros.scene.parameters import Scene

GAIT = 'gait'  # the gait of the scene as it is, also where there is a path
CONTROLLERS: dict[str, Callable[..., Controller]] = {
    'oscillators': CentralPatternGenerator,
    'partitioned_gait': PartitionedGait,
    'compliance': ShapeCompliance,
    'obstacle_aided': ObstacleAided,
}


def controller_of(scene: Scene) -> Controller | None:
    """
    Return the controller of a scene, a new one; None if its gait alone moves the joints.

    Without a name, a scene with a path has a `PathFollower`.

    Raises
    ------
    ParameterError
        If the name or a value beside it is not usable; the message says which and why.

    """
    named = scene.controller
    if named.name == GAIT or not (named or scene.follow):
        if named.values:
            raise ParameterError(f'controller {GAIT} has no values, got {named.values[0][0]}')
        return None
    if not named:
        return PathFollower(scene.follow)
    make = CONTROLLERS.get(named.name) or _imported(named.name)
    values = dict(named.values)
    try:
        inspect.signature(make).bind(**values)
    except (TypeError, ValueError) as error:
        takes = ', '.join(_arguments(make)) or 'no values'
        raise ParameterError(
            f'controller {named.name} takes {takes}; got {", ".join(values) or "none"}: {error}'
        ) from None
    try:
        made = make(**values)
    except ParameterError as error:
        raise ParameterError(f'controller {named.name}: {error}') from None
    if not isinstance(made, Controller):
        raise ParameterError(
            f'controller {named.name} must have period, sees_poses, start and control, got a '
            f'{type(made).__name__}'
        )
    return made


def _arguments(make: Callable[..., Any]) -> list[str]:
    """Return the names of the arguments of a class or a function."""
    try:
        return list(inspect.signature(make).parameters)
    except (TypeError, ValueError):
        return []


def _imported(name: str) -> Callable[..., Any]:
    """Return what ``module:name`` or ``file.py:name`` names."""
    place, colon, what = name.rpartition(':')
    if not colon:
        names = [GAIT, *CONTROLLERS]
        raise ParameterError(
            f'unknown controller {name!r}; {nearest(name, names)} (yours is named '
            f'package.module:Name or file.py:Name)'
        )
    try:
        module = _module_of_file(Path(place)) if place.endswith('.py') else import_module(place)
        found = getattr(module, what)
    except Exception as error:  # the code of others raises whatever it likes
        why = cut(f'{type(error).__name__}: {error}', LONGEST_REASON)
        raise ParameterError(f'controller {name} cannot be imported: {why}') from None
    if not callable(found):
        raise ParameterError(
            f'controller {name} must be a class or a function, got a {type(found).__name__}'
        )
    return found  # type: ignore[no-any-return]


def _module_of_file(path: Path) -> ModuleType:
    """Return the module of a file, which runs once in a process."""
    name = str(path.resolve())
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, name)
    assert spec and spec.loader  # as for every name that ends in .py
    module = sys.modules[name] = module_from_spec(spec)  # dataclasses look for it there
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
