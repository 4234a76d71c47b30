# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs without room on a disk or in memory: each says so in one sentence, and ends."""

from collections.abc import Callable
from pathlib import Path
import signal
import time

from snake_sim_ros.nodes.tools.attacked_node import AttackedNode
from snake_sim_ros.nodes.tools.attacked_node import node
from snake_sim_ros.nodes.tools.bag_without_end import messages_in

END = 120.0  # s for a program to end, which may have to compile the physics
ROOM = 300_000  # bytes of a file at most
LITTLE = 700_000_000  # bytes of addresses: enough to import the program
ENOUGH = 1_500_000  # bytes, of which the first chunk of a bag is a part
COMMANDS = ['-m', 'snake_sim_ros.commands']


def _limited(limit: str, *arguments: str) -> AttackedNode:
    return AttackedNode([*COMMANDS, *arguments], prefix=['prlimit', limit])


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
    path = folder / name
    limited = f'--fsize={ROOM // 10 if option != "bag" else ROOM}'
    arguments = 'run', 'lateral_undulation', '--duration', duration, f'--{option}', str(path)
    problem = _verdict(_limited(limited, *arguments), told=str(path))
    if not problem and option == 'out' and path.exists():
        return f'{path} is there, and is not whole'
    return problem


def _record(folder: Path) -> str:
    """Record a robot until the file takes no more; what is in it must be readable."""
    path, sim = folder / 'run.mcap', node('sim')
    try:
        sim.wait_until_said('physics ready', END)
        problem = _verdict(_limited(f'--fsize={ROOM}', 'record', str(path)), told=str(path))
        return problem or ('' if messages_in(path) else f'{path} has no message that can be read')
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


DISK: tuple[Callable[[Path], str], ...] = (
    lambda folder: _run('run.npz', 'out', '2', folder),
    lambda folder: _run('run.csv', 'csv', '2', folder),
    lambda folder: _run('run.mcap', 'bag', '5', folder),
    _record,
    _killed_recorder,
)
MEMORY: tuple[Callable[[Path], str], ...] = (_large_run,)
