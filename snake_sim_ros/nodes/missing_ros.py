# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a program says that needs ROS 2 where it is not installed; it imports nothing of it."""

from snake_sim_ros.scene.checked_records import ParameterError


def missing_ros(what: str, command: str, error: ImportError) -> ParameterError:
    """Return what to raise where ROS 2 is missing."""
    return ParameterError(
        f'{what} needs ROS 2 ({error}): source a ROS 2 installation, or ./run {command}'
    )
