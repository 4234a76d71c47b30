# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What can be read of a bag whose recorder was killed, or whose disk was full."""

from itertools import pairwise
from pathlib import Path
import struct

from mcap.exceptions import McapError
from mcap.records import Channel, Message
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


def what_is_wrong_with_stamps(path: Path, topic: str) -> str:
    """
    Return a sentence if the stamps of a topic of a bag do not grow; empty if all do.

    Parameters
    ----------
    path : Path
    topic : str
        Its messages begin with a header.

    """
    channel, stamps = None, []
    try:
        with path.open('rb') as file:
            for record in StreamReader(file).records:
                if isinstance(record, Channel) and record.topic == topic:
                    channel = record.id
                elif isinstance(record, Message) and record.channel_id == channel:
                    stamps.append(struct.unpack('<iI', record.data[4:12]))
    except (OSError, McapError, struct.error) as error:
        return f'{path.name} cannot be read: {error}'
    if not stamps:
        return f'{path.name} has no {topic}'
    back = sum(later <= earlier for earlier, later in pairwise(stamps))
    return f'{back} of {len(stamps)} stamps of {topic} do not grow' if back else ''
