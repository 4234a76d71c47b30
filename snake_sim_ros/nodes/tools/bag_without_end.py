# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What can be read of a bag whose recorder was killed, or whose disk was full."""

from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader


def messages_in(path: Path) -> int:
    """Return how many messages a bag has up to its end, wherever that is."""
    count = 0
    with path.open('rb') as file:
        try:
            for record in StreamReader(file).records:
                count += isinstance(record, Message)
        except McapError:  # the end
            pass
    return count
