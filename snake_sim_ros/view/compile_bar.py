# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The count of compiled functions on stderr, where a run has to compile before it can begin."""

import sys
from typing import TYPE_CHECKING

from snake_sim_ros.dynamics.code_cache import why_compile
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.stepping.simulation import Simulation

if TYPE_CHECKING:
    from tqdm import tqdm

LAYOUT = 'compiling for {elapsed}, {n} functions so far'


def compile_with_bar(simulation: Simulation) -> None:
    """
    Compile what the first steps with the gait of a scene need, and count unless it is there.

    Parameters
    ----------
    simulation : Simulation

    """
    bar: tqdm[None] | None = None

    def count(name: str) -> None:
        nonlocal bar
        if bar is None:
            from tqdm import tqdm  # Most runs need no bar, and it takes long to import.

            if reason := why_compile():
                print(reason, file=sys.stderr)
            bar = tqdm(bar_format=LAYOUT, leave=False)
        bar.update()

    try:
        with watched(count):
            simulation.compile(simulation.scene.gait)
    finally:
        if bar is not None:
            bar.close()
