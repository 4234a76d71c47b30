# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hard contact problems, stored as single steps.

They are in ``data/hard_contacts.npz``. The first twenty are the steps of cases A to D in which
method newton took most iterations in 15 s. Those named ``mu 5`` are steps of lateral undulation
with mu = 5 on which an earlier solver failed. The others are postures on the floor with a gap of
-1e-9 m that move as one rigid body: at rest or nearly so (redundant contacts), thrown down at
0.3 m/s while turning (every contact lands and slides at once), with a link of 1000 times the mass,
with an upright link, and with a pitched link that slides on its leading end, below and beyond
Painlevé's threshold.

In ``data/hard_steps.npz`` are the steps of most iterations of scenes with friction of 0.5 to 5,
with curled, wedged and entangled robots, rolling friction and joint friction. The program
``benchmarks/snake_sim_benchmarks/hard_steps.py`` writes them.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from snake_sim_ros import Scene, State
from snake_sim_ros.dynamics.joint_control import make_control_memory
from snake_sim_ros.scene.parameters import Array, scene_from_text
from snake_sim_ros.stepping.state import empty_history, History


class StoredStep(NamedTuple):
    """A step of a scene: where it starts, and its joint references."""

    scene: Scene
    state: State
    history: History  # without the memory of a method
    angle: Array  # (n-1, 2) [rad]
    rate: Array  # (n-1, 2) [rad/s]


def problem_names() -> list[str]:
    """Return the names of the stored problems, which is all that collecting tests asks for."""
    with np.load(Path(__file__).parent / 'data' / 'hard_contacts.npz') as file:
        return [str(name) for name in file['name']]


@cache
def load_problems() -> dict[str, StoredStep]:
    """Return the stored problems by their names."""
    with np.load(Path(__file__).parent / 'data' / 'hard_contacts.npz') as file:
        names, texts, links, numbers = (file[key] for key in ('name', 'scene', 'links', 'numbers'))
    problems, start = {}, 0
    for name, text, n in zip(names, texts, links, strict=True):
        parts = []
        for shape in ((n, 7), (n, 6), (5, 2 * n, 5), (n - 1, 2), (n - 1, 2)):
            size = int(np.prod(shape))
            parts.append(numbers[start : start + size].reshape(shape))
            start += size
        scene = replace(scene_from_text(text.decode()), level='spatial')
        impulse, velocity, change = parts[2][:3]
        control = make_control_memory(scene)
        history = History(impulse, velocity, change, np.zeros(1), control)
        problems[str(name)] = StoredStep(scene, State(*parts[:2]), history, *parts[3:])
    assert start == len(numbers)
    return problems


@cache
def load_hard_steps() -> dict[str, list[StoredStep]]:
    """Return the hardest steps by the names of their scenes."""
    with np.load(Path(__file__).parent / 'data' / 'hard_steps.npz') as file:
        data = {key: file[key] for key in file.files}
    scenes = [scene_from_text(text.decode()) for text in data['scene']]
    steps: dict[str, list[StoredStep]] = {str(name): [] for name in data['name']}
    ends = np.cumsum(data['closed'], dtype=int)
    for k, of in enumerate(data['of']):
        scene, part = scenes[of], slice(ends[k] - int(data['closed'][k]), ends[k])
        history = empty_history(scene)
        for array, known in zip(history[:3], data['known'][part].swapaxes(0, 1), strict=True):
            array[data['contact'][part]] = known
        turn = data['turn'][k].astype(float)
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        state = State(np.hstack([data['position'][k], turn]), data['u'][k].astype(float))
        angle, rate = data['angle'][k].astype(float), data['rate'][k].astype(float)
        steps[str(data['name'][of])].append(StoredStep(scene, state, history, angle, rate))
    return steps
