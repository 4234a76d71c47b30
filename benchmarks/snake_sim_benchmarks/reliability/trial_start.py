# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node that is started with some arguments and ended at once, in this process."""

from collections.abc import Sequence

import rclpy

from snake_sim_ros.nodes.gait_node import GaitNode
from snake_sim_ros.nodes.node_process import initialize, made


def start_and_end(arguments: Sequence[str]) -> None:
    """
    Make the node `gait` as its process does, and end it.

    Parameters
    ----------
    arguments : sequence of str
        What would stand after ``--ros-args``.

    Raises
    ------
    ParameterError
        If the node does not start with them.

    """
    initialize(['gait', '--ros-args', *arguments])
    try:
        made(GaitNode).destroy_node()
    finally:
        rclpy.try_shutdown()
