# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The residuals that solvers reach on hard contact problems, which are those of the tests."""

from collections.abc import Iterator
from pathlib import Path
from runpy import run_path
from typing import Any

import numpy as np

from snake_sim_ros import Report
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.stepping.methods import make_stepper

TESTS = Path(__file__).resolve().parents[3] / 'test'


def load_problems() -> dict[str, Any]:
    """Return name -> scene, state, history, joint angles and rates, see test/hard_contacts.py."""
    problems: dict[str, Any] = run_path(str(TESTS / 'hard_contacts.py'))['load_problems']()
    return problems


def reports_by_limit(problem: Any, method: str, most: int) -> Iterator[Report]:
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
