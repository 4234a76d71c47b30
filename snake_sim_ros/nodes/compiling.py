# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The compiler beside a node that keeps running, for physics whose machine code is not there yet.

A child process fills the cache on disk, while a thread waits for it and then loads what it
compiled. The node itself compiles nothing, which would stop it for that time. The child is not
nicer than the node, which may wait for it at any time, and gets the processor at once because it
sleeps most of the time.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
import os
import pickle
import subprocess
import sys
from threading import Event, Lock, Thread
import time

from snake_sim_ros.dynamics.code_cache import Shelf
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.levels import FlatStepper, is_vertical, LevelStepper
from snake_sim_ros.stepping.simulation import LEVELS, Simulation

CHECK = 0.05  # s between two looks whether the node ends


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


class Compiler:
    """
    Compiles the physics of a scene beside the node, once it is started.

    Parameters
    ----------
    scene : Scene
    load : callable
        Takes a level, and calls all that is compiled for it. It is called in another thread.
    levels : sequence of str
        What is compiled, one after the other.

    Attributes
    ----------
    loaded : int
        How many levels are loaded.
    needed : int
        For how many of them the node waits.
    error : Exception, optional
        What `load` raised.

    """

    def __init__(self, scene: Scene, load: Callable[[str], object], levels: Sequence[str]) -> None:
        self.scene, self.load, self.levels = scene, load, levels
        self.loaded = self.needed = 0
        self.error: Exception | None = None
        self._begin, self._end = time.perf_counter(), Event()
        self._child: subprocess.Popen[bytes] | None = None
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
        """The level that the node waits for, else empty."""
        loaded = self.loaded  # the other thread may raise it
        return self.levels[loaded] if loaded < self.needed else ''

    @property
    def outlook(self) -> str:
        """What is ready, and what is not, as a clause."""
        last = self.levels[-1]
        ready = ', '.join(f'{level} level' for level in LEVELS if level != last)
        return f'{ready}; {last} level is still being compiled'

    def __str__(self) -> str:
        """Return what it does, as a clause."""
        return f'compiling, {self.seconds:.0f} s so far'

    def end(self) -> None:
        """End it, whether it is done or not."""
        with self._guard:
            self._end.set()
        if self._child:
            self._child.kill()
            self._child.wait()

    def _work(self) -> None:
        """Let a child compile one level after the other, and load it."""
        try:
            for level in self.levels:
                child = self._start_child(level)
                while child and child.poll() is None:
                    self._end.wait(CHECK)
                if self._end.is_set():
                    return
                self.load(level)  # It compiles what is still missing, if the child failed.
                self.loaded += 1
        except Exception as error:
            self.error = error

    def _start_child(self, level: str) -> 'subprocess.Popen[bytes] | None':
        """Start the process that compiles a level, unless all is over."""
        with self._guard:
            if self._end.is_set():
                return None
            # A signal from the terminal reaches the node alone, which ends its child.
            self._child = child = subprocess.Popen(
                [sys.executable, '-m', __name__],
                stdin=subprocess.PIPE,
                env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
                start_new_session=True,
            )
        assert child.stdin
        with suppress(BrokenPipeError), child.stdin:  # It may have been ended.
            pickle.dump((self.scene, level), child.stdin)
        return child


def main() -> None:
    """Fill the cache for the scene and level on standard input."""
    with suppress(EOFError):  # The node that waits for it has ended.
        scene, level = pickle.load(sys.stdin.buffer)
        Shelf.shares_work = True
        compile_sampling(scene)
        Simulation(scene).compile(levels=[level])


if __name__ == '__main__':
    main()
