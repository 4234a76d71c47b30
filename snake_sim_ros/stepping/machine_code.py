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
from concurrent.futures import as_completed, ThreadPoolExecutor
from contextlib import suppress
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
    ('obstacle_aided', 'bdf2'),
    ('lateral_undulation', 'newton'),
    ('lateral_undulation', 'bdf2'),
    ('obstacle_aided', 'paper'),
    ('lateral_undulation', 'paper'),
    ('patches', 'bdf2'),  # in the plane; pegs are in space with this method
    ('stairs', 'newton'),  # steps among obstacles; in a world there is more around them
)


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


def call(environment: dict[str, str], *arguments: str) -> None:
    """Call this program in another process; raise an error if it fails."""
    subprocess.run([sys.executable, '-m', __spec__.name, *arguments], env=environment, check=True)


def compile_all(environment: dict[str, str]) -> None:
    """Compile FORMS, each in a process, with a bar."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        runs = [pool.submit(call, environment, '--form', str(k)) for k in range(len(FORMS))]
        for run in tqdm(as_completed(runs), total=len(runs), desc='compiling', unit=' forms'):
            run.result()


def main(arguments: Sequence[str]) -> int:
    """Fill a folder, or do a part of that; return the exit code."""
    match arguments:
        case ['--form', number]:
            compile_form(int(number))
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
                call(environment, '--keep', folder)
        case _:
            print(f'usage: python -m {__spec__.name} FOLDER|--cache', file=sys.stderr)
            return 2
    return 0


if __name__ == '__main__':
    with suppress(KeyboardInterrupt):
        sys.exit(main(sys.argv[1:]))
    sys.exit(130)
