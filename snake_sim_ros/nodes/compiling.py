# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The compiler beside a program that keeps running, since a first start compiles for half a minute.

Child processes fill the cache on disk, while a thread waits for them and then loads what they
compiled. The program itself compiles nothing, which would stop it for that time. Two processes
share a level: one compiles the contact solver, then what is around the loop over steps, and the
other one the loop. They are not nicer than the program, which may wait for them at any time, and
gets the processor at once because it sleeps most of the time.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
import math
import os
import pickle
import subprocess
import sys
from threading import Event, Lock, Thread
import time
from typing import NamedTuple

from snake_sim_ros.dynamics.code_cache import CodeCache
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.apart import (
    compile_loop,
    compile_search,
    compile_solver,
    function_counts,
)
from snake_sim_ros.stepping.levels import FlatStepper, is_vertical, LevelStepper
from snake_sim_ros.stepping.simulation import LEVELS, Simulation

CHECK = 0.05  # s between two looks whether the program ends
COST = {'planar': 1.0, 'spatial': 1.5}  # relative times of the compiler
KNOWN = 0.2  # part of the work after which its end can be foretold


class NotCompiledError(Exception):
    """A function is not in the cache."""


def refuse(name: str) -> None:
    """Raise NotCompiledError, see `watched`."""
    raise NotCompiledError(name)


def is_loaded(load: Callable[[], object]) -> bool:
    """Call a function that compiles; return whether everything was in the cache, or stop there."""
    try:
        with watched(refuse):
            load()
    except NotCompiledError:
        return False
    return True


def levels_of(scene: Scene) -> tuple[str, ...]:
    """Return the levels that a scene may have, first the one that its gait begins with."""
    simulation = Simulation(scene)
    if isinstance(simulation.stepper, LevelStepper):
        return LEVELS[::-1] if is_vertical(*simulation.gait_reference(1))[0] else LEVELS
    return ('planar',) if isinstance(simulation.stepper, FlatStepper) else ('spatial',)


class Job(NamedTuple):
    """What a child process compiles."""

    scene: Scene
    level: str
    loop: bool  # only the loop over steps, for which it needs the solver of the other process

    def do(self, tell: Callable[[str], object]) -> None:
        """Fill the cache; report the name of every function that is compiled."""
        CodeCache.shares_work = True
        with watched(tell, at_end=True):
            if self.loop:
                compile_search(self.scene, self.level)
                compile_loop(self.scene, self.level)
            else:
                compile_solver(self.scene, self.level)
                compile_sampling(self.scene)
                Simulation(self.scene).compile(levels=[self.level])


class Compiler:
    """
    Compiles the physics of a scene beside the program, once it is started.

    Parameters
    ----------
    scene : Scene
    load : callable
        Takes a level, and calls all that is compiled for it. It is called in another thread.
    levels : sequence of str
        What is compiled, one after the other.

    Attributes
    ----------
    functions : int
        How many functions are compiled so far; those in others count in each of them.
    most : list of int
        How many each level has at most.
    loaded : int
        How many levels are loaded.
    needed : int
        For how many of them the program waits.
    error : Exception, optional
        What `load` raised.

    """

    def __init__(self, scene: Scene, load: Callable[[str], object], levels: Sequence[str]) -> None:
        self.scene, self.load, self.levels = scene, load, levels
        self.functions = self.loaded = self.needed = self._before = 0
        self._counts = [function_counts(scene, level) for level in levels]
        self.most = [sum(counts.values()) for counts in self._counts]
        self.error: Exception | None = None
        self._begin, self._end = time.perf_counter(), Event()
        self._children: list[subprocess.Popen[bytes]] = []
        self._guard = Lock()  # No child starts after the end.
        self._thread = Thread(target=self._work, daemon=True)

    def start(self) -> None:
        """Begin to compile."""
        self._begin = time.perf_counter()
        self._thread.start()

    @property
    def seconds(self) -> float:
        """Wall time since it began [s]."""
        return time.perf_counter() - self._begin

    @property
    def is_done(self) -> bool:
        """Whether all is loaded, or an error came."""
        return self.loaded == len(self.levels) or self.error is not None

    @property
    def awaited(self) -> str:
        """The level that the program waits for, else empty."""
        loaded = self.loaded  # the other thread may raise it
        return self.levels[loaded] if loaded < self.needed else ''

    @property
    def values(self) -> dict[str, object]:
        """How many functions it has, and needs at most, while the program waits for it."""
        most = sum(self.most[: self.needed])
        counts: dict[str, object] = {
            'functions_compiled': min(self.functions, most),
            'functions': most,
        }
        return counts if self.awaited else {}

    @property
    def outlook(self) -> str:
        """What is ready, and when the last level will be, as a clause."""
        last, left = self.levels[-1], self.seconds_left(len(self.levels))
        ready = ', '.join(f'{level} level' for level in LEVELS if level != last)
        when = 'is still being compiled' if math.isnan(left) else f'in about {left:.0f} s'
        return f'{ready}; {last} level {when}'

    def seconds_left(self, count: int) -> float:
        """Return how long it takes about until some levels are loaded [s]; nan if unknown."""
        loaded = min(self.loaded, count - 1)
        part = min(1.0, (self.functions - self._before) / max(1, self.most[loaded]))
        costs = [COST[level] for level in self.levels[:count]]
        done = (sum(costs[:loaded]) + part * costs[loaded]) / sum(costs)
        return self.seconds * (1.0 / done - 1.0) if done > KNOWN else math.nan

    def __str__(self) -> str:
        """Return what it does, as a clause."""
        left = self.seconds_left(max(1, self.needed))
        end = '' if math.isnan(left) else f', about {left:.0f} s left'
        return f'compiling, {self.seconds:.0f} s so far{end}'

    def end(self) -> None:
        """End it, whether it is done or not."""
        with self._guard:
            self._end.set()
        for child in self._children:
            child.kill()
            child.wait()

    def _work(self) -> None:
        """Let children compile one level after the other, and load it."""
        try:
            for level in self.levels:
                for loop in (True, False):
                    self._start_child(Job(self.scene, level, loop))
                while any(child.poll() is None for child in self._children):
                    self._end.wait(CHECK)
                if self._end.is_set():
                    return
                self.load(level)  # It compiles what is still missing, if a child failed.
                self._before = self.functions
                self.loaded += 1
        except Exception as error:
            self.error = error

    def _start_child(self, job: Job) -> None:
        """Start a process that does a job, unless all is over."""
        with self._guard:
            if self._end.is_set():
                return
            # A signal from the terminal reaches the program alone, which ends its children.
            child = subprocess.Popen(
                [sys.executable, '-m', 'snake_sim_ros.nodes.compiling'],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
                start_new_session=True,
            )
            self._children.append(child)
        assert child.stdin
        with suppress(BrokenPipeError), child.stdin:  # It may have been ended.
            pickle.dump(job, child.stdin)
        Thread(target=self._count, args=[child], daemon=True).start()

    def _count(self, child: 'subprocess.Popen[bytes]') -> None:
        assert child.stdout
        counts = self._counts[self.loaded]
        for name in child.stdout:
            self.functions += counts.get(name.decode().strip(), 0)


def main() -> None:
    """Do the job on standard input; end with the program that waits for it."""
    with suppress(EOFError, BrokenPipeError):
        job: Job = pickle.load(sys.stdin.buffer)
        job.do(lambda name: print(name, flush=True))


if __name__ == '__main__':
    from snake_sim_ros.nodes.compiling import main as do_job  # not of __main__: see pickle

    do_job()
