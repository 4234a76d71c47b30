# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How far a robot gets between pegs at random places: its gait alone, and with feedback.

Boards are rectangles of pegs, tried one after the other at random places of `default_rng(seed)`,
as far as they are a distance from the others and beside the robot, which begins straight. The
values of the controllers were chosen on boards with seeds from 100 on; `SEEDS` are for judgement.

    ./run python benchmarks/snake_sim_benchmarks/peg_boards.py [seconds]
"""

from collections.abc import Iterator
import sys
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros import load_scene, run, Scene
from snake_sim_ros.controllers.wide_wave import AMPLITUDE, PHASE_LAG

SEEDS = range(10)
BOX = (-4.0, -1.25), (1.0, 1.25)  # corners [m]
TRIED = 4000  # places
RADIUS = 0.03  # of a peg [m]
BESIDE = 0.11, 0.83  # half width and half length of what the robot takes at its start [m]
WIDE = {'amplitude': AMPLITUDE, 'phase_lag': -PHASE_LAG}  # the wave of both controllers at rest


class Kind(NamedTuple):
    """A kind of boards: the least distance of two pegs [m] and the friction of the floor."""

    distance: float
    longitudinal: float
    transversal: float


KINDS = {
    'sparse, friction of case A': Kind(0.3, 0.1, 0.5),
    'dense, isotropic friction': Kind(0.2, 0.2, 0.2),
}
WAYS: dict[str, dict[str, Any]] = {
    'gait alone': {},
    'wide gait alone': {'gait': {'yaw': WIDE}},
    'compliance': {'controller': 'compliance'},
    'obstacle_aided': {'controller': 'obstacle_aided'},
}


def board(seed: int, distance: float) -> np.ndarray:
    """Return the places of pegs, (m, 2) [m]."""
    random, found = np.random.default_rng(seed), np.empty((0, 2))
    for place in np.round(random.uniform(BOX[0], BOX[1], (TRIED, 2)), 2):
        is_free = (np.linalg.norm(found - place, axis=1) >= distance).all()
        if is_free and (abs(place[1]) > BESIDE[0] or abs(place[0]) > BESIDE[1]):
            found = np.vstack([found, place])
    return found


def scene(kind: Kind, seed: int, duration: float) -> Scene:
    """Return lateral undulation on a board."""
    x, y = board(seed, kind.distance).T.tolist()
    return load_scene(
        'lateral_undulation',
        friction={'longitudinal': kind.longitudinal, 'transversal': kind.transversal},
        pegs={'x': x, 'y': y, 'radius': RADIUS, 'friction': 0.2},
        start={'yaw': 0.0},
        gait={'soft_start': 1.5},
        duration=duration,
    )


def rows(duration: float) -> Iterator[tuple[str, int, str, float, int, float]]:
    """Yield kind, seed, way, distance [m], unconverged steps, largest torque [N m] of runs."""
    for name, kind in KINDS.items():
        for seed in SEEDS:
            on = scene(kind, seed, duration)
            for way, values in WAYS.items():
                moved = run(on, **values)
                torque = float(np.abs(moved.joint_torque).max())
                yield name, seed, way, moved.distance, moved.report.unconverged, torque


def main() -> None:
    """Print all runs, and on how many boards each way is ahead of the gait alone."""
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    found: dict[str, dict[str, list[float]]] = {}
    for kind, seed, way, distance, unconverged, torque in rows(duration):
        found.setdefault(kind, {}).setdefault(way, []).append(distance)
        print(
            f'{kind}, board {seed}, {way}: {distance:.2f} m, {unconverged} steps unconverged, '
            f'{torque:.0f} N m',
            flush=True,
        )
    for kind, ways in found.items():
        alone = np.array(ways['gait alone'])
        for way, distances in ways.items():
            ahead = int((np.array(distances) > alone).sum())
            print(f'{kind}, {way}: {np.mean(distances):.2f} m, ahead on {ahead} of {len(alone)}')


if __name__ == '__main__':
    main()
