# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Warnings of a node that may recur with every message or every step."""

import time

from rclpy.node import Node

WARN_PERIOD = 5.0  # s between two warnings of one kind


class ThrottledWarnings:
    """Logs warnings of a node, of each kind at most one every `WARN_PERIOD`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._last: dict[str, float] = {}

    def __call__(self, kind: str, sentence: str) -> None:
        """Log a warning, unless one of its kind was logged within the last `WARN_PERIOD`."""
        now = time.monotonic()
        if now - self._last.get(kind, -WARN_PERIOD) >= WARN_PERIOD:
            self._last[kind] = now
            self._node.get_logger().warning(sentence)
