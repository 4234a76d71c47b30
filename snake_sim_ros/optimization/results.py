# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an optimization found, as files of scenes and as JSON."""

from collections import Counter
from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any

from snake_sim_ros.optimization.evaluations import Evaluation
from snake_sim_ros.optimization.optimize import objective_names, Outcome
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.parameters import scene_to_text


def write_scenes(outcome: Outcome, out: Path) -> list[Path]:
    """
    Write the best scene, or those of the front, each as a scene that can be run.

    Parameters
    ----------
    outcome : Outcome
    out : Path
        File of the history: ``gait.parquet`` has the scene ``gait.best.yaml`` beside it, or
        ``gait.front/01.yaml`` and so on.

    """
    if len(outcome.problem.objectives) == 1:
        paths = [out.with_suffix('.best.yaml')][: len(outcome.best)]
    else:
        folder = out.with_suffix('.front')
        folder.mkdir(exist_ok=True)
        digits = max(2, len(str(len(outcome.best))))
        paths = [folder / f'{k + 1:0{digits}}.yaml' for k in range(len(outcome.best))]
    for path, item, scene in zip(paths, outcome.best, outcome.scenes, strict=True):
        numbers = ', '.join(f'{name} {value:.6g}' for name, value in _named(outcome, item).items())
        found = f'# Found by snake-sim optimize, evaluation {item.point.number}: {numbers}\n'
        write_whole(path, found + scene_to_text(scene))
    if len(outcome.problem.objectives) > 1:
        for old in {*folder.glob('[0-9]*.yaml')} - {*paths}:
            old.unlink()
    return paths


def _named(outcome: Outcome, item: Evaluation) -> dict[str, float]:
    """Return the objectives of an evaluation by their expressions."""
    texts = [objective.expression.text for objective in outcome.problem.objectives]
    return dict(zip(texts, outcome.objectives_of(item), strict=True))


def summary(outcome: Outcome) -> dict[str, Any]:
    """Return what was found, name -> value as JSON has them."""
    evaluations = outcome.evaluations
    found: dict[str, Any] = {
        'evaluations': len(evaluations),
        'found': sum(not item.is_new for item in evaluations),
        'feasible': sum(item.is_feasible for item in evaluations),
        'stopped': outcome.stopped,
        **Counter(item.status for item in evaluations),
    }
    if evaluations:
        found['start'] = described(outcome, evaluations[0])
    best = [described(outcome, item) for item in outcome.best]
    is_front = len(outcome.problem.objectives) > 1
    return found | ({'front': best} if is_front else {'best': next(iter(best), None)})


def described(outcome: Outcome, item: Evaluation) -> dict[str, Any]:
    """Return an evaluation and its check, if there is one, name -> value as JSON has them."""
    found = {
        'evaluation': item.point.number,
        'values': dict(item.point.values),
        **_achieved(outcome, item),
    }
    check = outcome.checks.get(item.point.number)
    return found | ({'check': _achieved(outcome, check)} if check else {})


def _achieved(outcome: Outcome, item: Evaluation) -> dict[str, Any]:
    """Return what values achieve, name -> value as JSON has them."""
    names = objective_names(outcome.problem)
    return {
        **_finite(dict(zip(names, outcome.objectives_of(item), strict=True))),
        'feasible': item.is_feasible,
        'metrics': _finite(item.metrics),
        'status': item.status,
    }


def _finite(numbers: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return numbers without those that JSON does not have."""
    return {
        name: value if value is not None and math.isfinite(value) else None
        for name, value in numbers.items()
    }
