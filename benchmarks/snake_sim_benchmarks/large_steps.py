# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How often a robot traverses steps of a large part of its length, and how it fails.

The scene is `large_step`, with other heights. Each trial starts at another place: up to a
wavelength of the gait farther from the step, up to 5 cm aside, up to 0.05 rad turned. A traversal
has all links on the step within a minute, and no link that lies turns over by more than 90
degrees before. What does not turn over is stuck. `main` prints the table of docs/worlds.md.
"""

from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from snake_sim_ros import load_scene, Run, run
from snake_sim_ros.scene.rotations import rotation_matrices

FACE, MINUTE = 1.0, 60.0  # m, place of the step; s, time of a trial
KINDS = ('traversed', 'turned over', 'stuck')
WIDE = 40.0  # m, of the step, on which robots go on


def trial(share: float, seed: int, values: Mapping[str, Any] | None = None) -> tuple[str, Run]:
    """
    Return how a trial ends, one of `KINDS`, and its run.

    Parameters
    ----------
    share : float
        Height of the step, of the length of the robot.
    seed : int
        Of its start.
    values : mapping, optional
        Other values of the scene.

    """
    robot = load_scene('large_step').robot
    height = share * float(robot.per_link('link_length').sum())
    draw = np.random.default_rng(seed)
    start = {
        'position': (float(draw.uniform(0.0, 0.56)), float(draw.uniform(-0.05, 0.05))),
        'heading': float(draw.uniform(-0.05, 0.05)),
    }
    box = {'center': (-FACE - WIDE / 2, 0.0, height / 2), 'size': (WIDE, WIDE, height)}
    scene = {
        'start': start,
        'world': {'boxes': (box,)},
        'controller.height': height,
        'method': 'bdf2',
        'dt': 1 / 400,
        'duration': MINUTE,
    }
    moved = run('large_step', scene | dict(values or {}), rate=10.0)
    up = rotation_matrices(moved.orientation)[:, :, 2]  # e_z of I in B; e_y^B is up if a link lies
    lies, is_over = np.hypot(up[..., 0], up[..., 1]) > 0.8, up[..., 1] < 0.0
    is_on = (moved.position[:, :, 2] > height).all(axis=1)
    end = int(is_on.argmax()) if is_on.any() else len(moved.time)
    if (lies & is_over)[:end].any():
        return 'turned over', moved
    return ('traversed' if is_on.any() else 'stuck'), moved


def trials(
    share: float, count: int, values: Mapping[str, Any] | None = None
) -> tuple[Counter[str], int]:
    """Return how often trials of a height end in which way, and all unconverged steps."""
    with ThreadPoolExecutor() as pool:
        ends = list(pool.map(lambda seed: trial(share, seed, values), range(count)))
    return Counter(kind for kind, _ in ends), sum(moved.report.unconverged for _, moved in ends)


def main() -> None:
    """Print a row for each height, at two frequencies, and with softer pitch joints."""
    heights = (0.25, 0.33, 0.38, 0.43, 0.48)
    for frequency, stiffness in ((180.0, 200.0), (360.0, 200.0), (360.0, 60.0)):
        values = {
            'gait.angular_frequency_deg': frequency,
            'robot.pitch_stiffness': stiffness,
        }
        for share in heights:
            ends, unconverged = trials(share, 20, values)
            counts = ' | '.join(str(ends[kind]) for kind in KINDS)
            case = f'{frequency:g} degrees/s, {stiffness:g} N m/rad | {100 * share:g} %'
            print(f'| {case} | {counts} | {unconverged} |', flush=True)


if __name__ == '__main__':
    main()
