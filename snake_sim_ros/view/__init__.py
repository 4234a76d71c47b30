# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a run looks like: a page in the browser, animations."""

from types import ModuleType

from snake_sim_ros.scene.checked_records import ParameterError


def charts() -> ModuleType:
    """
    Return the module `chart`.

    Raises
    ------
    ParameterError
        If matplotlib, which it needs, is not installed.

    """
    try:
        from snake_sim_ros.view import chart
    except ImportError as error:
        raise ParameterError(
            f"plots need matplotlib ({error}): pip install 'snake_sim_ros[plots]'"
        ) from None
    return chart
