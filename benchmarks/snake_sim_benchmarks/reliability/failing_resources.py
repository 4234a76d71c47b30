# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs without room on a disk or in memory: each says so in one sentence, and ends."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
import signal
import struct
import subprocess
import time

from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from snake_sim_benchmarks.reliability.attacked_node import (
    AttackedNode,
    GraphWatch,
    large_command,
    node,
)

# ---- what can be read of a bag whose recorder was killed, or whose disk was full ----------------


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


# ---- trials -------------------------------------------------------------------------------------


END = 120.0  # s for a program to end, which may have to compile the physics
ROOM = 300_000  # bytes of the disk, or of a file at most
LITTLE = 700_000_000  # bytes of addresses: enough to import the program
LARGE = 10_000_000  # bytes of a message
LARGE_MESSAGES = 20
ANSWER = 10.0  # s for a node to publish again
STATES = ('joint_states',)
ENOUGH = 1_500_000  # bytes, of which the first chunk of a bag is a part
COMMANDS = ['-m', 'snake_sim_ros.commands']


def _limited(limit: str, *arguments: str) -> AttackedNode:
    return AttackedNode([*COMMANDS, *arguments], prefix=['prlimit', limit])


@contextmanager
def _disk(folder: Path, room: int) -> Iterator[list[str]]:
    """
    Make a folder a disk with some room [B], if this process may mount one.

    Yields
    ------
    list of str
        A program to start others with, which limits their files where there is no such disk.

    """
    mount = ['mount', '-t', 'tmpfs', '-o', f'size={room}', 'tmpfs', str(folder)]
    mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    try:
        yield [] if mounted else ['prlimit', f'--fsize={room}']
    finally:
        if mounted:
            subprocess.run(['umount', str(folder)], check=True)


def _verdict(program: AttackedNode, *, named: str) -> str:
    """Return what is wrong with the end of a program, whose last line must have some words."""
    status = program.wait(END)
    if status is None:
        program.end()
        return f'{named}: no end within {END:g} s'
    words = program.lines[-1] if program.lines else ''
    if status in (0, 1) or program.said('Traceback'):
        return f'{named}: ended with status {status}: {words}'
    return '' if named in words else f'the last line does not name {named}: {words}'


def _run(name: str, option: str, duration: str, folder: Path) -> str:
    path, room = folder / name, ROOM if option == 'bag' else ROOM // 10
    arguments = 'run', 'lateral_undulation', '--duration', duration, f'--{option}', str(path)
    with _disk(folder, room) as prefix:
        problem = _verdict(AttackedNode([*COMMANDS, *arguments], prefix=prefix), named=str(path))
        if not problem and option == 'out' and path.exists():
            return f'{path} is there, and is not whole'
    return problem


def _record(folder: Path) -> str:
    """Record a robot until the file takes no more; what is in it must be readable."""
    path, sim = folder / 'run.mcap', node('sim')
    try:
        sim.wait_until_said('physics ready', END)
        with _disk(folder, ROOM) as prefix:
            recorder = AttackedNode([*COMMANDS, 'record', str(path)], prefix=prefix)
            problem, unreadable = _verdict(recorder, named=str(path)), not messages_in(path)
        return problem or (f'{path} has no message that can be read' if unreadable else '')
    finally:
        sim.end()


def _killed_recorder(folder: Path) -> str:
    """Kill a recorder; what it has written must be readable."""
    path, sim = folder / 'killed.mcap', node('sim')
    recorder = AttackedNode([*COMMANDS, 'record', str(path)])
    try:
        sim.wait_until_said('physics ready', END)
        end = time.monotonic() + END
        while not (path.exists() and path.stat().st_size > ENOUGH) and time.monotonic() < end:
            time.sleep(0.1)
        recorder.send(signal.SIGKILL)
        recorder.wait(END)
        return '' if messages_in(path) else f'{path} has no message that can be read'
    finally:
        recorder.end()
        sim.end()


def _large_run(_: Path) -> str:
    duration = '100000'
    arguments = 'run', 'lateral_undulation', '--duration', duration
    return _verdict(_limited(f'--as={2 * LITTLE}', *arguments), named='memory')


def _little_node(name: str) -> str:
    """Start a node with too little memory."""
    return _verdict(node(name, prefix=['prlimit', f'--as={LITTLE // 2}']), named='ulimit -v')


def _large_messages(_: Path) -> str:
    """Send a sim with little memory large messages; it must go on, or end with a sentence."""
    sim, watch = node('sim', prefix=['prlimit', f'--as={2 * LITTLE + 10**8}']), GraphWatch(STATES)
    try:
        if not sim.wait_until_said('physics ready', END):
            return f'sim did not start: {" / ".join(list(sim.lines)[-3:])}'
        commands = watch.publisher('joint_command')
        for _k in range(LARGE_MESSAGES):
            commands.publish(large_command(LARGE))
            watch.spin(0.2)
        if not sim.is_alive:
            return _verdict(sim, named='memory')
        return '' if watch.flow(STATES, ANSWER) else 'sim fell silent after large messages'
    finally:
        sim.end()
        watch.close()


DISK: tuple[Callable[[Path], str], ...] = (
    lambda folder: _run('run.npz', 'out', '2', folder),
    lambda folder: _run('run.csv', 'csv', '2', folder),
    lambda folder: _run('run.mcap', 'bag', '5', folder),
    _record,
    _killed_recorder,
)
MEMORY: tuple[Callable[[Path], str], ...] = (
    _large_run,
    lambda _: _little_node('sim'),
    lambda _: _little_node('gait'),
    lambda _: _little_node('viewer'),
    _large_messages,
)
