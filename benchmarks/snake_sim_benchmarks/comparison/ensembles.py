# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The parts `ensemble` and `robust` of the bench: errors over families of scenes.

An error over 15 s of a gait with landings depends on chance, so that no single run, lucky or not,
may decide. A row of `ensemble` has the spread of the errors of an entrant over perturbed scenes,
and a row of `robust` the largest one over the neighbors of a scene. The error of a run is the
largest distance of the middle link from the converged path of the same scene, over its distance
from start to end. In every trial all entrants take turns, so that a disturbance of the machine
affects them all and ratios of their times are those of one run.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
import math
from typing import NamedTuple

import numpy as np
from scipy.stats import bootstrap

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.entrants import Entrant
from snake_sim_benchmarks.comparison.paths import (
    ConvergedPaths,
    Course,
    course_error,
    Start,
    step_count,
)
from snake_sim_ros import ParameterError, Scene
from snake_sim_ros.scene.parameters import Array

# ---- the spread of errors -----------------------------------------------------------------------


CONFIDENCE = 0.9  # of the interval of the root mean square
RESAMPLES = 4000
RESAMPLING_SEED = 17  # of the resamples, so that a table repeats


class Spread(NamedTuple):
    """
    Root mean square, its bootstrap interval, median and 90 % quantile of some errors.

    The interval has the probability CONFIDENCE. With one error it is that error alone.
    """

    rms: float
    low: float
    high: float
    median: float
    quantile: float


def root_mean_square(values: Array, axis: int = -1) -> Array:
    """Return the root of the mean of squares along an axis."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=axis)))


def spread(errors: Sequence[float]) -> Spread:
    """
    Return the spread of errors.

    Runs that failed have infinite errors. Then the root mean square is infinite and has no
    interval (nan).
    """
    values = np.asarray(errors, dtype=float)
    rms = float(root_mean_square(values))
    low, high = (np.nan, np.nan) if np.isinf(rms) else (rms, rms)
    if len(values) > 1 and np.isfinite(rms):
        found = bootstrap(
            (values,), root_mean_square, confidence_level=CONFIDENCE, n_resamples=RESAMPLES,
            method='percentile', random_state=np.random.default_rng(RESAMPLING_SEED),
        )  # fmt: skip
        low, high = found.confidence_interval
    ordered = np.sort(values)
    return Spread(rms, float(low), float(high), _quantile(ordered, 0.5), _quantile(ordered, 0.9))


def _quantile(ordered: Array, share: float) -> float:
    """Return a quantile of ordered values, linear between two of them; infinity stays infinite."""
    place = share * (len(ordered) - 1)
    below, above = int(np.floor(place)), int(np.ceil(place))
    if below == above or np.isinf(ordered[above]):
        return float(ordered[above])
    return float(ordered[below] + (place - below) * (ordered[above] - ordered[below]))


def undisturbed(costs: Sequence[float]) -> float:
    """
    Return the cost that one trial in ten stays below, nan without trials that ended.

    What else runs on the machine only makes trials longer, and may do so in most of them.
    """
    ended = sorted(cost for cost in costs if np.isfinite(cost))
    return _quantile(np.array(ended), 0.1) if ended else math.nan


# ---- families of scenes -------------------------------------------------------------------------


FRICTION_SPREAD = 0.1  # both coefficients are multiplied by 0.9 to 1.1, by the same number
SOFT_STARTS = (4.0, 5.0)  # s, of scenes with a soft start
SEED = 17
NEARBY_STEPS = 0.2  # neighbors have time steps that are 20 % shorter and longer,
NEARBY_SCENES = 0.02  # and friction and yaw amplitude that are 2 % smaller and larger


def family(scene: Scene, count: int) -> list[Scene]:
    """
    Return perturbed scenes, always the same ones.

    Friction, the phase of the gait and the time of the soft start are drawn uniformly. The phases
    of yaw and pitch change together, so that the gait is the same one at another time. A larger
    family begins with the scenes of a smaller one.

    A scene without a soft start gets none. With one, the forces of case A, whose links all stick
    to the floor while the gait fades in, are not unique, and runs of `newton` at 1/8000 and
    1/16000 s come to end 0.3 to 0.7 % of the way apart: there is nothing to judge errors by.
    """
    random = np.random.default_rng(SEED)
    return [
        perturbed(
            scene,
            friction=random.uniform(1 - FRICTION_SPREAD, 1 + FRICTION_SPREAD),
            phase=random.uniform(0.0, 1.0),
            soft_start=random.uniform(*SOFT_STARTS),
        )
        for _ in range(count)
    ]


def perturbed(scene: Scene, friction: float, phase: float, soft_start: float) -> Scene:
    """Return a scene with friction times a factor, at a phase of its gait, 0 to 1."""
    gait, first = scene.gait, frequency(scene)
    waves = {
        name: replace(
            wave, phase=wave.phase + 2 * math.pi * phase * wave.angular_frequency / first
        )
        for name, wave in (('yaw', gait.yaw), ('pitch', gait.pitch))
    }
    gait = replace(gait, yaw=waves['yaw'], pitch=waves['pitch'])
    gait = replace(gait, soft_start=soft_start if gait.soft_start else 0.0)
    return with_friction(replace(scene, gait=gait), friction)


def frequency(scene: Scene) -> float:
    """Return the angular frequency of the gait, that of yaw if there is yaw [rad/s]."""
    yaw, pitch = scene.gait.yaw, scene.gait.pitch
    return (yaw if yaw.amplitude else pitch).angular_frequency


def with_friction(scene: Scene, factor: float) -> Scene:
    """Return a scene with all coefficients of sliding friction times a factor."""
    friction = scene.friction
    return replace(
        scene,
        friction=replace(
            friction,
            longitudinal=factor * friction.longitudinal,
            backward=None if friction.backward is None else factor * friction.backward,
            transversal=factor * friction.transversal,
        ),
    )


def neighbors(scene: Scene) -> Mapping[str, tuple[Scene, float]]:
    """
    Return the scenes over which a robust bound is the largest error, with factors of the step.

    Returns
    -------
    dict
        What is changed -> the scene, and what its time step is multiplied by.

    """
    yaw = scene.gait.yaw
    found = {
        'as given': (scene, 1.0),
        'shorter steps': (scene, 1 - NEARBY_STEPS),
        'longer steps': (scene, 1 + NEARBY_STEPS),
    }
    for side in (-1, 1):
        factor = 1 + side * NEARBY_SCENES
        wave = replace(yaw, amplitude=factor * yaw.amplitude)
        change = 'more' if side > 0 else 'less'
        found[f'{change} friction'] = with_friction(scene, factor), 1.0
        found[f'{change} amplitude'] = replace(scene, gait=replace(scene.gait, yaw=wave)), 1.0
    return found


# ---- trials of many entrants --------------------------------------------------------------------


class Trial(NamedTuple):
    """
    A run that every entrant takes.

    Attributes
    ----------
    scene : Scene
        Without the settings and the step of an entrant.
    error : callable
        ``error(course)`` returns the error of a course, relative to the way gone.
    doubt : float
        Error of the reference of this trial, relative to the way gone.
    start : Start or None
        None for the start of the scene.
    step_factor : float
        What the time step of an entrant is multiplied by.

    """

    scene: Scene
    error: Callable[[Course], float]
    doubt: float
    start: Start | None = None
    step_factor: float = 1.0


@dataclass
class Result:
    """
    What an entrant did in some trials.

    Attributes
    ----------
    row : Row
        With its keys only.
    errors, costs : list of float
        Relative errors, and processor time over simulated time.
    unconverged : int
    message : str
        The first failure, or why the entrant was refused.
    refused : bool
        Whether it cannot run at all.

    """

    row: Row
    errors: list[float] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    unconverged: int = 0
    message: str = ''
    refused: bool = False

    def note_trial(self, entrant: Entrant, trial: Trial) -> None:
        """Let an entrant run a trial, unless it was refused before."""
        if self.refused:
            return
        try:
            scene = entrant.scene(trial.scene, self.row.dt * trial.step_factor)
            course = entrant.run(scene, trial.start)
        except ParameterError as error:
            self.refused, self.message = True, str(error)
            return
        self.errors.append(trial.error(course))
        self.costs.append(course.seconds / (step_count(scene) * scene.dt))
        self.unconverged += course.unconverged
        self.message = self.message or course.failure

    @property
    def status(self) -> str:
        """Status of all runs, as in `base.Status`, or refused."""
        if self.refused:
            return 'refused'
        if not np.isfinite(self.errors).all():
            return 'diverged'
        return 'max_iterations' if self.unconverged else 'converged'

    def judged(self, doubts: Sequence[float]) -> Row:
        """Return the row with costs and status."""
        if self.refused:
            return replace(self.row, status=self.status, message=self.message)
        return replace(
            self.row,
            status=self.status,
            message=self.message,
            trials=len(self.errors),
            unconverged=self.unconverged,
            reference_error=float(root_mean_square(np.array(doubts))),
            seconds_per_second=undisturbed(self.costs),
        )


def results(
    entered: Sequence[tuple[Entrant, Row]], trials: Iterable[Trial]
) -> tuple[list[Result], list[float]]:
    """Return the results of all entrants in all trials, and the doubts of the trials."""
    found, doubts = [Result(row) for _, row in entered], []
    for trial in trials:
        doubts.append(trial.doubt)
        for result, (entrant, _) in zip(found, entered, strict=True):
            result.note_trial(entrant, trial)
    return found, doubts


def spread_rows(entered: Sequence[tuple[Entrant, Row]], trials: Iterable[Trial]) -> list[Row]:
    """Return rows with the spread of errors over trials."""
    found, doubts = results(entered, trials)
    rows = []
    for result in found:
        row = result.judged(doubts)
        if not result.refused:
            of = spread(result.errors)
            row = replace(row, error_rms=of.rms, rms_low=of.low, rms_high=of.high,
                          error_median=of.median, error_quantile=of.quantile)  # fmt: skip
        rows.append(row)
    return rows


def worst_rows(entered: Sequence[tuple[Entrant, Row]], trials: Iterable[Trial]) -> list[Row]:
    """Return rows with the largest error of all trials."""
    found, doubts = results(entered, trials)
    return [
        row if result.refused else replace(row, error_path=max(result.errors))
        for result in found
        for row in [result.judged(doubts)]
    ]


# ---- the parts of the bench ---------------------------------------------------------------------


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
    return spread_rows(entered, (trial_of(each, paths) for each in family(scene, size)))


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
    return worst_rows(entered, (trial_of(each, paths, factor) for each, factor in nearby))


def trial_of(scene: Scene, paths: ConvergedPaths, step_factor: float = 1.0) -> Trial:
    """Return the trial of a scene, with errors from its converged path."""
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
