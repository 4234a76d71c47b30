# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A virtual Aiko: exact nonsmooth simulation of a wheel-less snake robot.

The names in ``__all__`` are the public interface of the library in Python; they need no ROS, and
are loaded when they are first used. Everything else may change between versions. The defaults are
those of the robot Aiko and its surroundings in the paper.

>>> from snake_sim_ros import run
>>> sidewinding = run('sidewinding', duration=3.0)
>>> sidewinding.distance, sidewinding.cost_of_transport
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

from snake_sim_ros.scene import __version__ as __version__

__all__ = [
    'Friction',
    'Gait',
    'Ground',
    'ParameterError',
    'Patches',
    'Pegs',
    'Push',
    'Report',
    'Robot',
    'Run',
    'Scene',
    'Simulation',
    'Solver',
    'Start',
    'State',
    'Table',
    'Wave',
    'load_scene',
    'read_run',
    'run',
    'study',
    'table_of',
]

if TYPE_CHECKING:
    from snake_sim_ros.api import (
        Friction,
        Gait,
        Ground,
        load_scene,
        ParameterError,
        Patches,
        Pegs,
        Push,
        read_run,
        Report,
        Robot,
        Run,
        run,
        Scene,
        Simulation,
        Solver,
        Start,
        State,
        study,
        Table,
        table_of,
        Wave,
    )
else:

    def __getattr__(name: str) -> Any:
        """Load what is public when it is first used, since the compiler takes long to import."""
        if name not in __all__:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        globals()[name] = found = getattr(import_module('snake_sim_ros.api'), name)
        return found

    def __dir__() -> list[str]:
        """Return the names of the module, also of what is not loaded yet."""
        return sorted({*globals(), *__all__})
