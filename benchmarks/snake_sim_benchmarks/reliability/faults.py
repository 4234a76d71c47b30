# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Faults around real nodes: they are killed and stopped; clocks, disks, memory and caches fail.

What needs minutes, the rights to mount or a program that is not installed is left out where there
are none.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
import math
import os
from pathlib import Path
import random
import shutil
import signal
import subprocess
import tempfile
import time

from snake_sim_benchmarks.reliability.attacked_node import (
    AttackedNode,
    crowd,
    GraphWatch,
    leave,
    node,
    on_own_domain,
)
from snake_sim_benchmarks.reliability.failing_resources import (
    COMMANDS,
    DISK,
    MEMORY,
    what_is_wrong_with_stamps,
)
from snake_sim_benchmarks.reliability.trials import Trial

# ---- a wall clock that is set for some processes, by the library of faketime --------------------


LIBRARIES = ('/usr/lib/*/faketime/libfaketimeMT.so.1', '/usr/lib/faketime/libfaketimeMT.so.1')
STEPS = (3600.0, -3600.0, 0.1, -0.1, 0.0)  # s by which the clock is off, one after the other


def faketime() -> str:
    """Return the path of the library, empty if it is not installed."""
    root = Path('/')
    found = [str(path) for name in LIBRARIES for path in root.glob(name.lstrip('/'))]
    return found[0] if found else ''


class WallClock:
    """
    The wall clock of processes that are started with its environment; monotonic clocks go on.

    Parameters
    ----------
    folder : Path
        For the file that these processes read at every look at their clock.

    Attributes
    ----------
    environment : dict

    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / 'offset'
        self.environment = {
            'LD_PRELOAD': faketime(),
            'FAKETIME_TIMESTAMP_FILE': str(self._path),
            'FAKETIME_NO_CACHE': '1',
            'FAKETIME_DONT_FAKE_MONOTONIC': '1',
        }
        self.step(0.0)

    def step(self, seconds: float) -> None:
        """Set it so that it is off by some time [s]."""
        new = self._path.with_suffix('.new')
        new.write_text(f'{seconds:+g}s\n', encoding='ascii')
        os.replace(new, self._path)  # No process may read a part of it.


# ---- trials -------------------------------------------------------------------------------------


START = 120.0  # s for a node to start, which may have to compile the physics
RECOVER = 30.0  # s until messages come again; discovery takes a part of it
SILENCE = 10.0  # s without messages after a node goes on that was stopped
PACED = 2.0  # s over which messages are counted
FLOW = ('joint_states', 'joint_command')
NODES = {'sim': (), 'gait': ('use_sim_time:=true', 'start_from:=now'), 'viewer': ('port:=0',)}
MINUTE = 60.0  # s from which on there is time for many robots and participants
ROBOTS = 20
SLOWLY = 0.05  # their real-time factor
FULL_RATE = 200  # Hz of joint_states at a factor of 1
CROWD = 40


@dataclass
class Found:
    """What the tries of one subject came to."""

    tried: int = 0
    problems: list[str] = field(default_factory=list)
    longest: float = 0.0
    figures: str = ''

    def add(self, problem: str) -> None:
        """Count a try, and what went wrong with it unless that is empty."""
        self.tried += 1
        if problem:
            self.problems.append(problem)

    def took(self, seconds: float | None) -> None:
        """Note how long something took."""
        self.longest = max(self.longest, seconds or 0.0)


Attack = Callable[[Found, float, random.Random], None]


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Try every fault; killing and stopping nodes takes the time that is left."""
    subjects: list[tuple[str, str, float, Attack]] = [
        ('full disk', 'programs', 0.0, lambda found, *_: _resources(found, DISK)),
        ('too little memory', 'programs', 0.0, lambda found, *_: _resources(found, MEMORY)),
        ('deleted cache', 'nodes', 0.0, _deleted_cache),
        ('read-only cache', 'nodes', 0.0, _read_only_cache),
        ('steps of the wall clock', 'steps', 0.0, _clock_steps),
    ]
    if seconds >= MINUTE:
        subjects += [
            (f'{ROBOTS} robots on a domain', 'robots', 0.0, _robots),
            (f'{CROWD} participants', 'nodes', 0.0, _crowd),
        ]
    subjects += [
        ('kill -9', 'kills', 0.7 * seconds, _kills),
        ('SIGSTOP', 'stops', 0.3 * seconds, _stops),
    ]
    with on_own_domain(60 + os.getpid() % 40):
        for subject, unit, share, attack in subjects:
            begin, found = time.monotonic(), Found()
            attack(found, share, random.Random(seed))
            yield Trial(
                'faults', subject, unit, found.tried, len(found.problems),
                time.monotonic() - begin, found.longest or math.nan, figures=found.figures,
                first=f'seed {seed}: {found.problems[0]}' if found.problems else '',
            )  # fmt: skip


class Demo:
    """The nodes of a robot that moves, each of which may be started again."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        self.environment, self.watch = environment or {}, GraphWatch(FLOW)
        self.nodes: dict[str, AttackedNode] = {}
        for name in NODES:
            self.start(name)

    def start(self, name: str) -> None:
        """Start a node, again if it ran."""
        self.nodes[name] = node(name, *NODES[name], environment=self.environment)

    def close(self) -> None:
        """End all."""
        for each in self.nodes.values():
            each.end()
        self.watch.close()

    def dead(self) -> str:
        """Return a sentence on a node that ended; empty if none did."""
        for name, each in self.nodes.items():
            if not each.is_alive:
                return f'{name} ended: {" / ".join(list(each.lines)[-3:])}'
        return ''


def _with_demo(found: Found, seconds: float, try_once: Callable[[Demo], None]) -> None:
    demo = Demo()
    try:
        if demo.watch.flow(FLOW, START) is None:
            found.add(demo.dead() or 'the demo did not start')
            return
        end = time.monotonic() + seconds
        while found.tried == 0 or time.monotonic() < end:
            demo.watch.spin(0.0)
            try_once(demo)
    finally:
        demo.close()


def _kills(found: Found, seconds: float, rng: random.Random) -> None:
    def kill(demo: Demo) -> None:
        name = rng.choice(list(NODES))
        demo.watch.spin(rng.uniform(0.0, 1.0))
        demo.nodes[name].process.kill()
        demo.nodes[name].wait(RECOVER)
        demo.watch.spin(rng.uniform(0.0, 0.5))
        demo.start(name)
        took = demo.watch.flow(FLOW, RECOVER + (START if name == 'sim' else 0.0))
        found.took(took)
        found.add(demo.dead() or ('' if took else f'no messages after {name} was killed'))

    _with_demo(found, seconds, kill)


def _stops(found: Found, seconds: float, rng: random.Random) -> None:
    def stop(demo: Demo) -> None:
        name = rng.choice(list(NODES))
        demo.nodes[name].send(signal.SIGSTOP)
        demo.watch.spin(10.0 ** rng.uniform(-1.0, 1.0 if seconds > 60.0 else 0.3))
        demo.nodes[name].send(signal.SIGCONT)
        took = demo.watch.flow(FLOW, SILENCE)
        found.took(took)
        found.add(demo.dead() or ('' if took else f'no messages after {name} was stopped'))

    _with_demo(found, seconds, stop)


def _clock_steps(found: Found, *_: object) -> None:
    if not faketime():
        found.figures = 'not tried, since faketime is missing'
        return
    with tempfile.TemporaryDirectory() as folder:
        clock, path = WallClock(Path(folder)), Path(folder, 'run.mcap')
        demo = Demo(clock.environment)
        recorder = AttackedNode([*COMMANDS, 'record', str(path)], clock.environment)
        try:
            if demo.watch.flow(FLOW, START) is None:
                found.add(demo.dead() or 'the demo did not start')
                return
            paces = [_pace(demo)]
            for offset in STEPS:
                clock.step(offset)
                took = demo.watch.flow(FLOW, SILENCE)
                found.took(took)
                paces.append(_pace(demo))
                slow = '' if paces[-1] > 0.5 * paces[0] else f'{paces[-1]:.0f} messages a second'
                silent = '' if took else 'no messages'
                problem = demo.dead() or silent or slow
                found.add(f'{problem} with a clock off by {offset:g} s' if problem else '')
            if recorder.end() is None:
                found.problems.append('the recorder did not end')
            elif problem := what_is_wrong_with_stamps(path, '/joint_states'):
                found.problems.append(problem)
            found.figures = f'{paces[0]:.0f} joint_states a second, then {min(paces[1:]):.0f}'
        finally:
            recorder.end()
            demo.close()


def _pace(demo: Demo) -> float:
    """Return how many messages of joint_states come in a second, measured over `PACED`."""
    before = demo.watch.counts[FLOW[0]]
    demo.watch.spin(PACED)
    return (demo.watch.counts[FLOW[0]] - before) / PACED


def _resources(found: Found, cases: tuple[Callable[[Path], str], ...]) -> None:
    if shutil.which('prlimit') is None:
        found.figures = 'not tried without prlimit'
        return
    for case in cases:
        with tempfile.TemporaryDirectory() as folder:
            begin = time.monotonic()
            found.add(case(Path(folder)))
            found.took(time.monotonic() - begin)


def _copied_cache(folder: str) -> dict[str, str]:
    """Return an environment with a copy of the cache in a folder."""
    cache = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'snake_sim_ros'
    if cache.is_dir():
        shutil.copytree(cache, Path(folder, 'snake_sim_ros'), dirs_exist_ok=True)
    return {'XDG_CACHE_HOME': folder}


def _goes_on(sim: AttackedNode) -> str:
    """Return a sentence if a sim does not start and publish."""
    if not sim.wait_until_said('physics ready', START):
        return f'sim did not start: {" / ".join(list(sim.lines)[-3:])}'
    watch = GraphWatch(FLOW[:1])
    try:
        return '' if watch.flow(FLOW[:1], RECOVER) else 'no joint_states'
    finally:
        watch.close()


def _deleted_cache(found: Found, *_: object) -> None:
    with tempfile.TemporaryDirectory() as folder:
        sim = node('sim', environment=_copied_cache(folder))
        try:
            problem = _goes_on(sim)
            shutil.rmtree(Path(folder, 'snake_sim_ros'), ignore_errors=True)
            found.add(problem or _goes_on(sim))
        finally:
            sim.end()


def _read_only_cache(found: Found, *_: object) -> None:
    if subprocess.run(['unshare', '-m', 'true'], capture_output=True, check=False).returncode:
        found.figures = 'not tried without the rights to mount'
        return
    with tempfile.TemporaryDirectory() as folder:
        environment = _copied_cache(folder)
        bind = f'mount --bind {folder} {folder} && mount -o remount,ro,bind {folder} && exec "$@"'
        prefix = ['unshare', '-m', 'sh', '-c', bind, 'sh']
        sim = node('sim', environment=environment, prefix=prefix)
        try:
            found.add(_goes_on(sim))
        finally:
            sim.end()


def _robots(found: Found, *_: object) -> None:
    topics = [f'/robot_{k}/joint_states' for k in range(ROBOTS)]
    watch = GraphWatch(topics)
    slowly = f'real_time_factor:={SLOWLY}'
    sims = [
        node('sim', slowly, f'publish_clock:={str(k == 0).lower()}', f'-r __ns:=/robot_{k}')
        for k in range(ROBOTS)
    ]
    try:
        took = watch.flow(topics, 2 * START)
        found.took(took)
        for k, sim in enumerate(sims):
            silent = f'robot {k} has not been heard: {" / ".join(list(sim.lines)[-2:])}'
            found.add('' if watch.counts[topics[k]] else silent)
        before = dict(watch.counts)
        watch.spin(PACED)
        rates = [(watch.counts[topic] - before[topic]) / PACED for topic in topics]
        found.figures = (
            f'joint_states of a robot come {min(rates):.1f} to {max(rates):.1f} times a second, '
            f'of {FULL_RATE * SLOWLY:g}'
        )
    finally:
        for sim in sims:
            sim.send(signal.SIGINT)
        for sim in sims:
            sim.end()
        watch.close()


def _crowd(found: Found, *_: object) -> None:
    """Start sim where many participants are; one that cannot be heard says nothing of it."""
    contexts = crowd(CROWD)
    sim = node('sim')
    try:
        problem = _goes_on(sim)
        found.add('' if problem == 'no joint_states' else problem)
        heard = 'not heard' if problem else 'heard'
        found.figures = f'beside {CROWD} participants a sim is {heard}'
    finally:
        sim.end()
        leave(contexts)
