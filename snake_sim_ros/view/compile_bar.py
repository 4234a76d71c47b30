# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bar of the compiler on stderr, where a run has to compile before it can begin."""

import sys

from tqdm import tqdm

from snake_sim_ros.dynamics.code_cache import why_compile
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.stepping.apart import function_counts
from snake_sim_ros.stepping.levels import is_vertical
from snake_sim_ros.stepping.simulation import Simulation

LAYOUT = 'compiling |{bar}| {n:.0f} of at most {total} functions, {elapsed}'


def compile_with_bar(simulation: Simulation) -> None:
    """
    Compile what the first steps with the gait of a scene need, with a bar unless it is there.

    Parameters
    ----------
    simulation : Simulation

    """
    is_spatial = is_vertical(*simulation.gait_reference(1))[0]
    level = 'spatial' if is_spatial else simulation.stepper.level
    counts: dict[str, int] = {}
    bar: tqdm[None] | None = None

    def tell(name: str) -> None:
        nonlocal bar
        if bar is None:
            if reason := why_compile():
                print(reason, file=sys.stderr)
            counts.update(function_counts(simulation.scene, level))
            bar = tqdm(total=sum(counts.values()), bar_format=LAYOUT, leave=False)
        bar.update(min(counts.get(name, 0), bar.total - bar.n))

    try:
        with watched(tell, at_end=True):
            simulation.compile(simulation.scene.gait)
    finally:
        if bar is not None:
            bar.close()
