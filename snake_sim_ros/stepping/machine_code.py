# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The machine code that an installed package brings, so that it starts without compiling.

    python -m snake_sim_ros.stepping.machine_code FOLDER
    python -m snake_sim_ros.stepping.machine_code --cache

compiles the loops of all methods and levels, on a flat floor and among obstacles, in a cache of
its own, with as many processes as there are cores. What a start loads goes to a folder in FOLDER
that has the name of the sources; see `dynamics.code_cache`. Nothing of the machine goes with it.
What is called by other compiled functions only stays behind: it is in them. With ``--cache`` the
cache of the user gets all.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import gc
import os
from pathlib import Path
import subprocess
import sys
import tempfile

from tqdm import tqdm

from snake_sim_ros.controllers.following import compile_following
from snake_sim_ros.dynamics.code_cache import identity, is_portable, PORTABLE, Shelf
from snake_sim_ros.dynamics.compilation import COMPILES
from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.scene.parameters import load_scene, Scene, with_settings
from snake_sim_ros.stepping.batch import Batch
from snake_sim_ros.stepping.simulation import Simulation

# Scenes by which compiled code differs, those that take longest first.
FORMS = (
    ('obstacle_aided', 'newton'),
    ('lateral_undulation', 'newton'),
    ('obstacle_aided', 'bdf2'),
    ('lateral_undulation', 'bdf2'),
    ('obstacle_aided', 'paper'),
    ('lateral_undulation', 'paper'),
    ('patches', 'bdf2'),  # in the plane; pegs are in space with this method
    ('stairs', 'newton'),  # steps among obstacles; in a world there is more around them
)
# Those of two processes: what several forms of a process need is compiled once. Both take as long,
# and what the first compiles for the last forms of the second is there by then.
HALVES = (0, 4, 2), (1, 3, 5, 6, 7)


def scene_of(number: int) -> Scene:
    """Return the scene of one of FORMS."""
    name, method = FORMS[number]
    return with_settings(load_scene(name), {'method': method})


def compile_form(number: int) -> None:
    """Compile or load everything for one of FORMS."""
    Shelf.shares_work = True
    scene = scene_of(number)
    compile_sampling(scene)
    compile_following()
    simulation = Simulation(scene)
    simulation.compile()
    batch = Batch([simulation])
    angle, rate = simulation.gait_reference(1)
    for _ in range(2):  # the second step goes on in place
        batch.advance(angle[None], rate[None])


def keep_loaded(folder: Path) -> None:
    """Load everything, and copy it to the folder of these sources in another folder."""
    for number in range(len(FORMS)):
        compile_form(number)
    to = folder / identity(libraries=())
    for path in Shelf.loaded:
        room = to / path.parent.name
        room.mkdir(parents=True, exist_ok=True)
        (room / path.name).write_bytes(path.read_bytes())


def compile_all(environment: dict[str, str]) -> None:
    """Compile FORMS in as many processes as there are cores, with a bar."""
    count, numbers = min(os.cpu_count() or 1, len(FORMS)), range(len(FORMS))
    parts = HALVES if count == 2 else [numbers[k::count] for k in range(count)]
    with tqdm(total=len(FORMS), desc='compiling', unit=' forms') as bar:

        def run(part: Sequence[int]) -> None:
            command = [sys.executable, '-m', __spec__.name, '--form', *map(str, part)]
            with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
                for _ in process.stdout or ():
                    bar.update()
            if process.returncode:
                raise subprocess.CalledProcessError(process.returncode, command)

        with ThreadPoolExecutor(count) as pool:
            list(pool.map(run, parts))


def main(arguments: Sequence[str]) -> int:
    """Fill a folder, or do a part of that; return the exit code."""
    match arguments:
        case ['--form', *numbers]:
            gc.set_threshold(100_000)  # 700 objects at first: a tenth of the time is for garbage
            for number in numbers:
                compile_form(int(number))
                print(number, flush=True)
        case ['--cache']:
            compile_all(dict(os.environ))
        case ['--keep', folder]:
            keep_loaded(Path(folder))
        case [folder]:
            if not (COMPILES and is_portable()):
                print(f'this processor or environment cannot compile for {PORTABLE}')
                return 1
            with tempfile.TemporaryDirectory() as cache:
                environment = {**os.environ, 'NUMBA_CACHE_DIR': cache}
                compile_all(environment)
                keep = [sys.executable, '-m', __spec__.name, '--keep', folder]
                subprocess.run(keep, env=environment, check=True)
        case _:
            print(f'usage: python -m {__spec__.name} FOLDER|--cache', file=sys.stderr)
            return 2
    return 0


if __name__ == '__main__':
    with suppress(KeyboardInterrupt):
        sys.exit(main(sys.argv[1:]))
    sys.exit(130)
