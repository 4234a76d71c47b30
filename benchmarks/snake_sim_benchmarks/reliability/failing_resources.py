# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs without room on a disk or in memory: each says so in one sentence, and ends."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
import signal
import subprocess
import time

from snake_sim_benchmarks.reliability.attacked_node import AttackedNode, node
from snake_sim_benchmarks.reliability.bag_without_end import messages_in
from snake_sim_benchmarks.reliability.graph_watch import GraphWatch, large_command

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


def _verdict(program: AttackedNode, *, told: str) -> str:
    """Return what is wrong with the end of a program, whose last line must have some words."""
    status = program.wait(END)
    if status is None:
        program.end()
        return f'{told}: no end within {END:g} s'
    words = program.lines[-1] if program.lines else ''
    if status in (0, 1) or program.said('Traceback'):
        return f'{told}: ended with status {status}: {words}'
    return '' if told in words else f'the last line does not name {told}: {words}'


def _run(name: str, option: str, duration: str, folder: Path) -> str:
    path, room = folder / name, ROOM if option == 'bag' else ROOM // 10
    arguments = 'run', 'lateral_undulation', '--duration', duration, f'--{option}', str(path)
    with _disk(folder, room) as prefix:
        problem = _verdict(AttackedNode([*COMMANDS, *arguments], prefix=prefix), told=str(path))
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
            problem, unreadable = _verdict(recorder, told=str(path)), not messages_in(path)
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
    return _verdict(_limited(f'--as={2 * LITTLE}', *arguments), told='memory')


def _little_node(name: str) -> str:
    """Start a node with too little memory."""
    return _verdict(node(name, prefix=['prlimit', f'--as={LITTLE // 2}']), told='ulimit -v')


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
            return _verdict(sim, told='memory')
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
