# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The package simulation_interfaces, the standard of simulators in ROS 2, where it is installed.

`messages`, `services` and `actions` are its modules, or None: the ROS 2 packages on PyPI do not
have it. A type that only newer versions have is looked for with `getattr`.
"""

from importlib import import_module
from typing import Any


def _module(name: str) -> Any:
    try:
        return import_module(f'simulation_interfaces.{name}')
    except ImportError:
        return None


messages, services, actions = (_module(name) for name in ('msg', 'srv', 'action'))
