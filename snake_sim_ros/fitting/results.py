# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a fit found, as text, as JSON and as the file of a scene."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros.fitting.fit import Fit
from snake_sim_ros.fitting.judgement import Judgement, what_is_not_told
from snake_sim_ros.fitting.unknowns import scene_at
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.parameters import Scene, scene_to_text

NOT_EXPLAINED = 'the model does not explain the recording, so the intervals do not hold: '


def write_scene(found: Fit, scene: Scene, source: Path, path: Path) -> None:
    """
    Write a scene with the values found.

    Parameters
    ----------
    found : Fit
    scene : Scene
        The scene as it was; all but the values found are kept.
    source : Path
        The recording, for a comment.
    path : Path
        Where the scene is written.

    """
    pairs = zip(found.unknowns, found.values, strict=True)
    numbers = ', '.join(f'{unknown.name} {value:.6g}' for unknown, value in pairs)
    text = scene_to_text(scene_at(scene, found.unknowns, found.x))
    write_whole(path, f'# Found by snake-sim fit in {source.name}: {numbers}\n{text}')


def lines(found: Fit, judgement: Judgement) -> list[str]:
    """Return what was found in lines of text."""
    told = []
    rows = zip(found.unknowns, found.values, judgement.interval, judgement.bootstrap, strict=True)
    for unknown, value, (low, high), drawn in rows:
        unit = '' if unknown.unit == '1' else f' {unknown.unit}'
        told.append(
            f'{unknown.name}: {value:.5g}{unit}, 95 % within {low:.5g} to {high:.5g} '
            f'(bootstrap {drawn[0]:.5g} to {drawn[1]:.5g})'
        )
    names = [unknown.name for unknown in found.unknowns]
    if len(names) > 1:
        told.append('correlation')
        width = max(map(len, names))
        told += [
            f'  {name:{width}} ' + ' '.join(f'{number:7.3f}' for number in row)
            for name, row in zip(names, judgement.correlation, strict=True)
        ]
    told += [f'{name} is at a bound' for name in found.at_bound]
    told += what_is_not_told(found, judgement)
    sizes = ', '.join(f'{name} {value:.3g}' for name, value in judgement.size.items())
    told.append(f'residuals in units of the stated noise: {sizes}')
    if judgement.failures:
        told.append(NOT_EXPLAINED + '; '.join(judgement.failures))
    else:
        told.append('the model explains the recording: what is left is noise')
    return told


def summary(found: Fit, judgement: Judgement) -> dict[str, Any]:
    """Return what was found, name -> value as JSON has them."""
    rows = zip(
        found.unknowns, found.values, judgement.deviation, judgement.interval,
        judgement.bootstrap, strict=True,
    )  # fmt: skip
    values = {
        unknown.name: {
            'value': value,
            'start': unknown.start,
            'deviation': float(deviation * (value if unknown.is_positive else 1.0)),
            'interval': interval.tolist(),
            'bootstrap': drawn.tolist(),
        }
        for unknown, value, deviation, interval, drawn in rows
    }
    return {
        'values': values,
        'correlation': np.nan_to_num(judgement.correlation).tolist(),
        'singular_values': judgement.singular.tolist(),
        'not_told': what_is_not_told(found, judgement),
        'at_bound': list(found.at_bound),
        'residuals': judgement.size,
        'probability': {'constancy': judgement.constancy, 'memory': judgement.memory},
        'explained': not judgement.failures,
        'failures': list(judgement.failures),
        'segments': len(found.residuals),
        'numbers': sum(len(item.flat()) for item in found.residuals),
        'dropped': found.replay.recording.dropped,
        'simulations': found.evaluations,
    }


def coverage(truth: Sequence[float], repeats: Sequence[tuple[Fit, Judgement]]) -> dict[str, Any]:
    """
    Return how often intervals cover the truth, and how large errors are, as JSON has them.

    Parameters
    ----------
    truth : sequence of float
        The values with which recordings were made.
    repeats : sequence of tuple
        What was found in each of them.

    """
    true = np.array(truth)
    values = np.array([found.values for found, _ in repeats])
    names = [unknown.name for unknown in repeats[0][0].unknowns]

    def share(intervals: list[Any]) -> dict[str, float]:
        low, high = np.moveaxis(np.array(intervals), -1, 0)
        covers = (low <= true) & (true <= high)
        return dict(zip(names, covers.mean(axis=0).tolist(), strict=True))

    error = np.sqrt(((values - true) ** 2).mean(axis=0)).tolist()
    largest = np.abs(values - true).max(axis=0).tolist()
    return {
        'recordings': len(repeats),
        'covered': share([judgement.interval for _, judgement in repeats]),
        'covered_by_bootstrap': share([judgement.bootstrap for _, judgement in repeats]),
        'error': dict(zip(names, error, strict=True)),
        'largest_error': dict(zip(names, largest, strict=True)),
        'failed_tests': sum(bool(judgement.failures) for _, judgement in repeats),
    }
