# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hard contact problems, stored as single steps, and the residuals that solvers reach on them.

They are in ``config/hard_contacts.npz``. The first twenty are the steps of cases A to D in which
method newton took most iterations in 15 s. Those named ``mu 5`` are steps of lateral undulation
with mu = 5 on which an earlier solver failed. The others are postures on the floor with a gap of
-1e-9 m that move as one rigid body: at rest or nearly so (redundant contacts), thrown down at
0.3 m/s while turning (every contact lands and slides at once), with a link of 1000 times the mass,
with an upright link, and with a pitched link that slides on its leading end, below and beyond
Painlevé's threshold.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.joint_control import make_control_memory
from snake_sim_ros.scene.parameters import Array, CONFIG, Scene, scene_from_text, with_settings
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.state import History, State


class StoredStep(NamedTuple):
    """A step of a scene: where it starts, and its joint references."""

    scene: Scene
    state: State
    history: History  # without the memory of a method
    angle: Array  # (n-1, 2) [rad]
    rate: Array  # (n-1, 2) [rad/s]


def load_problems() -> dict[str, StoredStep]:
    """Return the stored problems by their names."""
    with np.load(CONFIG / 'hard_contacts.npz') as file:
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


def reports_by_limit(problem: StoredStep, method: str, most: int) -> Iterator[Report]:
    """
    Yield the reports of a step whose solver may take 1, 2, 3, 5, 7, 10 ... iterations.

    The last report is the first one that converged, or that of `most` iterations. The tolerances
    are too small to stop a solver that can still improve: 1e-12 m/s, and 1e-14 N s for the
    paper's iteration.
    """
    limits = np.unique(np.round(np.geomspace(1, most, 6 * int(np.log10(most)) + 1)).astype(int))
    for limit in limits:
        settings = {
            'method': method,
            'solver.iteration_limit': int(limit),
            'solver.residual_tolerance': 1e-12,
            'solver.tolerance': 1e-14,
        }
        stepper = make_stepper(with_settings(problem.scene, settings))
        history = problem.history._replace(memory=stepper.empty_history().memory)
        _, _, report = stepper.advance(
            problem.state, history, problem.angle[None], problem.rate[None]
        )
        yield report
        if not report.unconverged:
            return
