# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The parts `ensemble` and `robust` of the bench: errors over families of scenes.

A row of `ensemble` has the spread of the errors of an entrant over perturbed scenes, and a row of
`robust` the largest one over the neighbors of a scene. The error of a run is the largest distance
of the middle link from the converged path of the same scene, over its distance from start to end.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.converged_paths import ConvergedPaths, course_error
from snake_sim_benchmarks.comparison.entrants import Entrant
from snake_sim_benchmarks.comparison.families import family, NEARBY_STEPS, neighbors
from snake_sim_benchmarks.comparison.judges import spread_rows, Trial, worst_rows
from snake_sim_ros.scene.parameters import Scene

ENSEMBLE = 32  # scenes in a family
QUICK_ENSEMBLE = 4
LONGEST_STEP = 0.1  # that a scene may have [s]
REFERENCE_SECONDS, RUN_SECONDS = 4.0, 0.1  # expected wall times, for progress bars

# The entrants of a case with their steps a second, in the order in which they take turns.
Field = Callable[[str], Sequence[tuple[Entrant, float]]]


def ensemble(
    scenes: Mapping[str, Scene], field: Field, paths: ConvergedPaths, size: int
) -> Iterator[Entry]:
    """Yield an entry for each case: all entrants in a family of scenes."""
    for case, scene in scenes.items():
        entered = list(entered_rows('ensemble', case, scene, field(case)))
        run = partial(_ensemble, scene, entered, paths, size)
        guess = size * (REFERENCE_SECONDS + RUN_SECONDS * len(entered))
        yield Entry(tuple(row for _, row in entered), run, guess)


def _ensemble(
    scene: Scene, entered: Sequence[tuple[Entrant, Row]], paths: ConvergedPaths, size: int
) -> list[Row]:
    return spread_rows(entered, (_trial(each, paths) for each in family(scene, size)))


def robust(scenes: Mapping[str, Scene], field: Field, paths: ConvergedPaths) -> Iterator[Entry]:
    """Yield an entry for each case: all entrants in the neighbors of its scene."""
    for case, scene in scenes.items():
        slowest = (1 + NEARBY_STEPS) / LONGEST_STEP
        entries = [(entrant, rate) for entrant, rate in field(case) if rate >= slowest]
        entered = list(entered_rows('robust', case, scene, entries))
        run = partial(_robust, scene, entered, paths)
        guess = 5 * REFERENCE_SECONDS + 7 * RUN_SECONDS * len(entered)
        yield Entry(tuple(row for _, row in entered), run, guess)


def worst_of_neighbors(entrant: Entrant, row: Row, scene: Scene, paths: ConvergedPaths) -> Row:
    """Return a row with the largest error of an entrant in the neighbors of a scene."""
    return _robust(scene, [(entrant, row)], paths)[0]


def _robust(
    scene: Scene, entered: Sequence[tuple[Entrant, Row]], paths: ConvergedPaths
) -> list[Row]:
    nearby = neighbors(scene).values()
    return worst_rows(entered, (_trial(each, paths, factor) for each, factor in nearby))


def _trial(scene: Scene, paths: ConvergedPaths, step_factor: float = 1.0) -> Trial:
    expected = paths.path(scene)
    error = partial(course_error, expected=expected)
    return Trial(scene, error, expected.doubt, step_factor=step_factor)


def entered_rows(
    part: str, case: str, scene: Scene, field: Iterable[tuple[Entrant, float]]
) -> Iterator[tuple[Entrant, Row]]:
    """Yield each entrant of a case with its row, in which only the keys are filled."""
    for entrant, rate in field:
        yield entrant, Row(
            part=part, case=case, method=entrant.method, level=entrant.level,
            setting=entrant.setting, dt=1 / rate, n=scene.robot.link_count,
            duration=scene.duration,
        )  # fmt: skip
