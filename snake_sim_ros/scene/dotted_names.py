# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Values of a scene in groups, and by the dotted names that `parameters.with_settings` takes."""

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

from snake_sim_ros.scene.gait_table import Table


def by_dotted_names(values: Mapping[str, Any], record: Any, prefix: str = '') -> dict[str, Any]:
    """Return nested values by dotted names, as far as a record has records inside."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        inside = getattr(record, name, None) if isinstance(name, str) else None
        if isinstance(value, Mapping) and is_dataclass(inside) and not isinstance(inside, Table):
            found |= by_dotted_names(value, inside, f'{prefix}{name}.')
        else:
            found[f'{prefix}{name}'] = value
    return found
