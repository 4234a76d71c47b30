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

from functools import cache
from importlib import import_module
from typing import Any

from snake_sim_ros.scene import __version__ as __version__


def __getattr__(name: str) -> Any:
    """Load what is public when it is first used, because the compiler takes long to import."""
    homes = _homes()
    if name == '__all__':
        return sorted(homes)
    if name not in homes:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    globals()[name] = found = getattr(import_module(homes[name]), name)
    return found


def __dir__() -> list[str]:
    """Return the names of the module, also of what is not loaded yet."""
    return sorted({*globals(), *_homes()})


@cache
def _homes() -> dict[str, str]:
    """Return public name -> module that defines it, as the stub beside this file imports them."""
    import ast
    from pathlib import Path

    tree = ast.parse(Path(__file__).with_suffix('.pyi').read_text(encoding='utf-8'))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    found = {item.name: str(node.module) for node in imports for item in node.names}
    return {name: home for name, home in found.items() if not name.startswith('_')}
