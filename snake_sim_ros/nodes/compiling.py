"""
The compiler beside a program that goes on, since a first start compiles for half a minute.

Child processes fill the cache on disk, one for each level, while a thread waits for them and then
loads what they compiled. The program itself compiles nothing, which would stop it for that time.
"""

from collections.abc import Callable
import os
import pickle
import subprocess
import sys
from threading import Event
from threading import Thread
import time

from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.levels import LevelStepper
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import LEVELS
from snake_sim_ros.stepping.simulation import Simulation

CHECK = 0.05  # s between two looks whether the program ends


class NotCompiledError(Exception):
    """A function is not in the cache."""


def is_loaded(load: Callable[[], object]) -> bool:
    """Call a function that compiles; return whether everything was in the cache, or stop there."""

    def refuse(name: str) -> None:
        raise NotCompiledError(name)

    try:
        with watched(refuse):
            load()
    except NotCompiledError:
        return False
    return True


class Compiler:
    """
    Compiles the physics of a scene beside the program, once it is started.

    Parameters
    ----------
    scene : Scene
    load : callable
        Calls all that is compiled, when it is on disk. It is called in another thread.

    Attributes
    ----------
    functions : int
        How many functions are compiled so far.
    error : Exception, optional
        What `load` raised.

    """

    def __init__(self, scene: Scene, load: Callable[[], object]) -> None:
        self.functions = 0
        self.error: Exception | None = None
        self._scene, self._load, self._end = scene, load, Event()
        self._begin = time.perf_counter()
        self._children: list[subprocess.Popen[bytes]] = []
        self._thread = Thread(target=self._wait_and_load, daemon=True)

    def start(self) -> None:
        """Begin to compile."""
        levels = LEVELS if isinstance(make_stepper(self._scene), LevelStepper) else LEVELS[1:]
        self._children = [self._child(level) for level in levels]
        for child in self._children:
            Thread(target=self._count, args=[child], daemon=True).start()
        self._thread.start()

    @property
    def seconds(self) -> float:
        """Wall time since it began [s]."""
        return time.perf_counter() - self._begin

    @property
    def is_done(self) -> bool:
        """Whether all is loaded, or an error came."""
        return not self._thread.is_alive()

    def __str__(self) -> str:
        """Return what it does, as a clause."""
        return f'compiling, {self.seconds:.0f} s so far'

    def end(self) -> None:
        """End it, whether it is done or not."""
        self._end.set()
        for child in self._children:
            if child.poll() is None:
                child.kill()
        for child in self._children:
            child.wait()

    def _child(self, level: str) -> 'subprocess.Popen[bytes]':
        # A signal from the terminal reaches the program alone, which ends its children.
        child = subprocess.Popen(
            [sys.executable, '-m', 'snake_sim_ros.nodes.compiling'],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
        )
        assert child.stdin
        with child.stdin:
            pickle.dump((self._scene, level), child.stdin)
        return child

    def _count(self, child: 'subprocess.Popen[bytes]') -> None:
        assert child.stdout
        for _ in child.stdout:
            self.functions += 1

    def _wait_and_load(self) -> None:
        while any(child.poll() is None for child in self._children):
            if self._end.wait(CHECK):
                return
        try:
            self._load()  # It compiles what is still missing, if a child failed.
        except Exception as error:  # noqa: BLE001  The program decides what to do.
            self.error = error


def compile_level(scene: Scene, level: str, tell: Callable[[str], object]) -> None:
    """Fill the cache with what a level of a scene needs; tell the name of every function."""
    with watched(tell):
        compile_sampling(scene)
        Simulation(scene).compile(levels=[level])


def main() -> None:
    """Compile the level of the scene that stand on standard input."""
    scene, level = pickle.load(sys.stdin.buffer)
    compile_level(scene, level, lambda name: print(name, flush=True))


if __name__ == '__main__':
    main()
