# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Random worlds: solids of all kinds, on which robots are dropped and driven, judged as in `physics`.

A world has one to ten boxes, stairs, ramps, poles, pipes, height fields, egg crates and meshes in
any place, also in each other and flush with each other. As a script it runs Aiko in many of them,
and prints how deep links are in solids, for the page on worlds.
"""

from collections.abc import Iterator

import numpy as np

from snake_sim_benchmarks.reliability.physics import attack, METHODS
from snake_sim_benchmarks.reliability.random_scenes import (
    random_gait,
    random_world,
    scene_of,
    WORLDS,
)
from snake_sim_benchmarks.reliability.trials import Trial
from snake_sim_ros import Report, Scene, Simulation

COUNT, SEED = 600, 600
STEPS = {'newton': 1000, 'bdf2': 200}  # in a second
MOST_FRICTION = 0.8


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Attack worlds with each method for its share of the time."""
    for number, method in enumerate(METHODS):
        yield attack('worlds', (WORLDS, method), seconds / len(METHODS), (seed, number))


def run_aiko(number: int, method: str) -> Report:
    """Let Aiko move by random waves in a random world for a second."""
    rng, aiko = np.random.default_rng((SEED, number)), Scene().robot
    world = random_world(rng, aiko.link_count, float(aiko.per_link('link_length')[0]))
    along, across = rng.uniform(0.0, MOST_FRICTION, 2).tolist()
    scene = scene_of({
        'scene': {
            'world': world,
            'friction': {'longitudinal': along, 'transversal': across},
            'gait': {**random_gait(rng), 'soft_start': 0.3},
            'method': method,
            'dt': 1 / STEPS[method],
            'level': 'spatial',
        }
    })  # fmt: skip
    simulation = Simulation(scene)
    return simulation.advance(*simulation.gait_reference(STEPS[method]))


def main() -> None:
    """Print how many steps did not converge, and how deep links were."""
    for method in METHODS:
        reports = [run_aiko(number, method) for number in range(COUNT)]
        depth = np.quantile([each.penetration_max for each in reports], [0.5, 0.99, 1.0])
        total = sum(reports, Report())
        print(
            f'{method}: unconverged {total.unconverged} of {total.steps}, overflows '
            f'{total.overflows}, diverged {sum(bool(each.failure) for each in reports)}; depth '
            f'{depth[0]:.2g}, {depth[1]:.2g}, {depth[2]:.2g} m'
        )


if __name__ == '__main__':
    main()
