# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bar of the compiler, where a command has to compile before it can begin."""

import time

from tqdm import tqdm

from snake_sim_ros.nodes.compiling import Compiler, is_loaded, levels_of
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.view.compile_bar import LAYOUT

LOOK = 0.1  # s between two looks at the compiler


def compile_first(scene: Scene) -> None:
    """Compile the level that the gait of a scene begins with, with a bar unless it is there."""
    simulation = Simulation(scene)
    if is_loaded(lambda: simulation.compile(scene.gait)):
        return
    levels = levels_of(scene)[:1]
    compiler = Compiler(scene, lambda _: simulation.compile(scene.gait), levels)
    with tqdm(total=compiler.most[0], bar_format=LAYOUT, leave=False) as bar:
        try:
            compiler.start()
            while not compiler.is_done:
                time.sleep(LOOK)
                bar.update(min(compiler.functions, bar.total) - bar.n)
        finally:
            compiler.end()
    if compiler.error:
        raise compiler.error
