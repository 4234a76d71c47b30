# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How well a recording determines the values of a fit, and whether the model explains it.

With derivatives J of the residuals r, both in units of the noise, the covariance of the values is
``s^2 (J^T J)^-1``. s^2 is the mean square of the residuals, but at least 1: no fit is more exact
than the noise that was stated. The bootstrap draws segments anew, and takes one step of least
squares for each draw.

Three tests look for what the model does not explain:

- size: the mean square of a kind of residual against the stated noise;
- constancy: whether all segments ask for the same values. With the score ``g = J^T r`` of every
  segment, ``sum g^T (J^T J)^-1 g / s^2`` has a chi-squared distribution;
- memory: whether residuals depend on those just before, by their correlation over LAGS samples.

What was found becomes text, JSON and the file of a scene here, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri, stdtrit

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.parameters import Array, Scene, scene_to_text, with_settings
from snake_sim_ros.studies.fit import Fit, fit, LEAST_SIZE, OFFSETS, scene_at, SETUP, unknowns_of
from snake_sim_ros.studies.replay import Replay, with_offsets

CONFIDENCE = 0.95
FALSE_ALARM = 0.01  # probability that a right model fails the tests
SIZE_LIMIT = 1.3  # mean square over the stated one up to which noise may be stated wrongly
LEAST = 1e-12  # probability below which a number means nothing
LAGS = 10
RESAMPLES = 2000
UNKNOWN = 0.25  # standard deviation, as a share of the value, from which it is not determined
CHANGE = 0.1  # change of values whose effect is compared with the noise
FAINT = 0.5  # effect of that change, as a share of the noise, below which it hardly matters
LARGE_PART = 0.3  # share of a combination from which a name is said
# What is tried where a recording is not explained: the setup, and what scenes often leave at 0.
SUSPECTS = (
    ('time_offset.joints',),
    ('time_offset.poses',),
    ('robot.command_delay',),
    ('robot.joint_friction',),
    ('marker.x', 'marker.y', 'marker.z'),
    ('frame.roll', 'frame.pitch'),
)
# Share of the largest curvature, and of a coordinate in a direction, that counts as none:
# derivatives by differences are good to 1e-6 or so.
NOTHING = 1e-12
SUGGESTED = 0.3  # share of what is left over from which others than the best are suggested
NOT_EXPLAINED = 'the model does not explain the recording, so intervals do not hold: '


@dataclass(frozen=True)
class Combination:
    """
    A combination of values: how well it is determined, and what it does.

    Attributes
    ----------
    parts : ndarray, shape (p,)
        Relative change of every value; the largest is 1.
    deviation : float
        Standard deviation of such a change.
    effect : float
        Root mean square change of the measured numbers in units of their noise, for a change by
        the share CHANGE.

    """

    parts: Array
    deviation: float
    effect: float


@dataclass(frozen=True)
class Judgement:
    """
    How certain a fit is.

    Attributes
    ----------
    deviation : ndarray, shape (p,)
        Standard deviations of the coordinates.
    interval, bootstrap : ndarray, shape (p, 2)
        95 % confidence intervals of the values, from the curvature and from segments drawn anew.
    correlation : ndarray, shape (p, p)
    singular : ndarray, shape (p,)
        Singular values of J, scaled to relative changes of the values, the largest first.
    combinations : tuple of Combination
        One for each singular value.
    size : dict
        Root mean square over the stated noise, by the kind of residual.
    constancy, memory : float
        Probabilities of such residuals if the model is right.
    failures : tuple of str
        What the model does not explain, a sentence each.

    """

    deviation: Array
    interval: Array
    bootstrap: Array
    correlation: Array
    singular: Array
    combinations: tuple[Combination, ...]
    size: dict[str, float]
    constancy: float
    memory: float
    failures: tuple[str, ...]


def judge(found: Fit, seed: int = 0) -> Judgement:
    """
    Return how certain a fit is.

    Parameters
    ----------
    found : Fit
    seed : int, optional
        Of the bootstrap.

    """
    scores = [
        (J.T @ J, J.T @ r.flat()) for J, r in zip(found.jacobians, found.residuals, strict=True)
    ]
    curvature = np.array([A for A, _ in scores])
    score = -np.array([g for _, g in scores])  # the Jacobian is that of measured minus simulated
    A = curvature.sum(axis=0)
    inverse, lost = _inverse(A, _units(found))
    scale = max(1.0, _mean_square(found))
    covariance = scale * inverse
    deviation = np.where(lost, np.inf, np.sqrt(np.diag(covariance)))
    bounds = deviation[:, None] * ndtri([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    resampled = _bootstrap(curvature, score, seed)
    resampled[lost] = -np.inf, np.inf
    singular, combinations = _combinations(found, A, scale)
    size = _sizes(found)
    constancy, memory = _constancy(curvature, score, scale), _memory(found)
    with np.errstate(invalid='ignore', divide='ignore'):
        correlation = covariance / np.outer(deviation, deviation)
    return Judgement(
        deviation, _values_at(found, bounds), _values_at(found, resampled), correlation, singular,
        combinations, size, constancy, memory, _failures(found, size, constancy, memory),
    )  # fmt: skip


def _units(found: Fit) -> Array:
    """Return the changes of the coordinates that are compared with each other, (p,)."""
    return np.array([
        1.0 if unknown.is_positive else max(abs(value), LEAST_SIZE)
        for unknown, value in zip(found.unknowns, found.values, strict=True)
    ])  # fmt: skip


def _inverse(A: Array, unit: Array) -> tuple[Array, Array]:
    """
    Return the inverse of a curvature (p, p), and which coordinates it does not determine, (p,).

    The pseudoinverse has no variance along directions that change nothing, as if they were known.
    """
    squares, parts = np.linalg.eigh(A * np.outer(unit, unit))
    known = squares > NOTHING * squares.max(initial=0.0)
    lost = (parts[:, ~known] ** 2).sum(axis=1) > NOTHING
    half = unit[:, None] * parts[:, known] / np.sqrt(squares[known])
    return half @ half.T, lost


def _values_at(found: Fit, offsets: Array) -> Array:
    """Return values at coordinates some offsets away, shape (p, 2)."""
    return np.array([
        [unknown.value(float(x + offset)) for offset in row]
        for unknown, x, row in zip(found.unknowns, found.x, offsets, strict=True)
    ])  # fmt: skip


def _bootstrap(curvature: Array, score: Array, seed: int) -> Array:
    """Return the offsets of the interval of coordinates from segments drawn anew, (p, 2)."""
    count, random = len(score), np.random.default_rng(seed)
    weights = random.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES)
    drawn = np.einsum('bs,sij->bij', weights, curvature)
    asked = np.einsum('bs,si->bi', weights, score - score.mean(axis=0))
    steps = np.einsum('bij,bj->bi', np.linalg.pinv(drawn, hermitian=True), asked)
    ends = np.array([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    # Few segments say little about their spread: as for a mean, by Student's distribution.
    wider = stdtrit(count - 1, ends[1]) / ndtri(ends[1])
    wider *= np.sqrt(count / (count - 1))
    return np.asarray(wider * np.quantile(steps, ends, axis=0).T)


def _combinations(found: Fit, A: Array, scale: float) -> tuple[Array, tuple[Combination, ...]]:
    """Return singular values and combinations, the best determined one first."""
    unit = _units(found)
    squares, parts = np.linalg.eigh(A * np.outer(unit, unit))
    singular = np.sqrt(np.maximum(squares, 0.0))[::-1]
    count = sum(len(item.flat()) for item in found.residuals)
    combinations = []
    for value, part in zip(singular, parts.T[::-1], strict=True):
        largest = part[np.abs(part).argmax()]
        deviation = float(np.sqrt(scale) * abs(largest) / max(value, 1e-300))
        effect = float(CHANGE * value / abs(largest) / np.sqrt(count))
        combinations.append(Combination(part / largest, deviation, effect))
    return singular, tuple(combinations)


def _sizes(found: Fit) -> dict[str, float]:
    """Return root mean squares of residuals by their kind."""
    poses = np.concatenate([item.poses.reshape(-1, 6) for item in found.residuals])
    joints = np.concatenate([item.joints.ravel() for item in found.residuals])
    kinds = {'positions': poses[:, :3], 'orientations': poses[:, 3:], 'joint angles': joints}
    return {name: float(np.sqrt(np.nanmean(values**2))) for name, values in kinds.items()}


def _constancy(curvature: Array, score: Array, scale: float) -> float:
    """Return the probability that segments which ask for the same values differ so much."""
    inverse = np.linalg.pinv(curvature, rcond=1e-9, hermitian=True)
    statistic = np.einsum('si,sij,sj->', score, inverse, score) / scale
    freedom = sum(np.linalg.matrix_rank(A, tol=1e-9 * np.trace(A), hermitian=True)
                  for A in curvature) - score.shape[1]  # fmt: skip
    return float(chdtrc(freedom, statistic)) if freedom > 0 else np.nan


def _memory(found: Fit) -> float:
    """Return the probability that independent residuals are correlated in time so much."""
    total = weight = 0.0
    for item in found.residuals:
        for values in (item.poses.reshape(len(item.poses), -1), item.joints):
            r = values.reshape(len(values), -1)
            known = ~np.isnan(r)
            r = np.where(known, r, 0.0)
            for lag in range(1, min(LAGS, len(r) - 1) + 1):
                total += float((r[:-lag] * r[lag:]).sum())
                weight += float((known[:-lag] & known[lag:]).sum())
    mean_square = max(1.0, float(np.mean([np.square(i.flat()).mean() for i in found.residuals])))
    return float(ndtr(-total / mean_square / np.sqrt(max(weight, 1.0))))


def _failures(
    found: Fit, size: dict[str, float], constancy: float, memory: float
) -> tuple[str, ...]:
    """Return what the model does not explain."""
    failures = [
        f'{name} are off by {value:.3g} times the stated noise'
        for name, value in size.items()
        if value**2 > SIZE_LIMIT
    ]
    if constancy < FALSE_ALARM / 2:
        failures.append(
            f'parts of the recording ask for different values (probability '
            f'{_small(constancy)} if they were the same)'
        )
    if memory < FALSE_ALARM / 2:
        failures.append(
            f'the residuals are not noise, since they depend on the samples before (probability '
            f'{_small(memory)} if they did not)'
        )
    return tuple(failures)


def what_is_suggested(
    found: Fit,
    threads: int | None = None,
    progress: Callable[[int, float], object] | None = None,
) -> tuple[str, ...]:
    """
    Return a sentence for what would explain what a fit does not, the best one first.

    Each of SUSPECTS becomes free alone, besides the values that are, and all are fitted again.

    Parameters
    ----------
    found : Fit
    threads, progress : optional
        As of `fit`.

    """
    free = [unknown.name for unknown in found.unknowns]
    taken = {name for unknown in found.unknowns for name in unknown.names}
    before, tried = _mean_square(found), list[tuple[float, list[str], Fit]]()
    noise = 1.0 if before > 1.0 else 0.0  # which may be less than stated
    for suspects in SUSPECTS:
        names = [name for name in suspects if name not in taken]
        try:
            again = _refitted(found, free, names, threads, progress) if names else None
        except ParameterError:  # a robot without such a number, or no motion with it
            continue
        if again:
            share = (before - _mean_square(again)) / (before - noise)
            tried.append((min(share, 1.0), names, again))
    tried.sort(key=lambda item: -item[0])
    return tuple(
        f'--free {" ".join(names)} removes {100 * share:.0f} % of what is left over, with '
        + ', '.join(
            f'{name} at {value:.2g} {unknown.unit}'
            for name, unknown, value in zip(
                names, again.unknowns[len(free) :], again.values[len(free) :], strict=True
            )
        )
        for k, (share, names, again) in enumerate(tried)
        if k == 0 or share > SUGGESTED
    )


def _refitted(
    found: Fit,
    free: list[str],
    names: list[str],
    threads: int | None,
    progress: Callable[[int, float], object] | None,
) -> Fit:
    """Return the fit with more values free, from where it ended."""
    last, setup = found.replay, found.setup
    given = setup if last.margin else None
    replay = Replay(last.given, found.scene, last.settings, last.law, given)
    if set(names) & {*OFFSETS}:
        streams = {SETUP[name][0] for name in (*free, *names) if name in OFFSETS}
        replay = with_offsets(replay, streams)
        setup = setup._replace(joints=replay.setup.joints, poses=replay.setup.poses)
    unknowns = unknowns_of(found.scene, [*free, *names], setup)
    return fit(replay, unknowns, threads=threads, progress=progress)


def _mean_square(found: Fit) -> float:
    """Return the mean square of the residuals in units of the noise, 1 where they are noise."""
    squares = sum(float((item.flat() ** 2).sum()) for item in found.residuals)
    return squares / max(found.freedom, 1)


def _small(probability: float) -> str:
    """Return a small probability as text."""
    return f'{probability:.1g}' if probability > LEAST else f'below {LEAST:g}'


def what_is_not_determined(found: Fit, judgement: Judgement) -> list[str]:
    """Return a sentence for each combination of values that the recording hardly determines."""
    sentences = []
    for item in judgement.combinations:
        names = [
            unknown.name
            for unknown, part in zip(found.unknowns, item.parts, strict=True)
            if abs(part) > LARGE_PART
        ]
        signs = {np.sign(part) for part in item.parts if abs(part) > LARGE_PART}
        what = names[0]
        if len(names) > 1:
            what = f'a common change of {", ".join(names[:-1])} and {names[-1]}'
            what += '' if len(signs) == 1 else ' in opposite directions'
        if item.deviation > UNKNOWN:
            sentences.append(
                f'the recording does not determine {what}: its standard deviation is '
                f'{100 * item.deviation:.3g} %'
            )
        elif item.effect < FAINT:
            sentences.append(
                f'{what} hardly matters: {100 * CHANGE:g} % change the motion by '
                f'{100 * item.effect:.2g} % of the noise; it is known to '
                f'{100 * item.deviation:.2g} % only if the model is right in the smallest detail'
            )
    return sentences


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
    scene = scene_at(scene, found.unknowns, found.x)
    delay = round(scene.robot.command_delay / scene.dt) * scene.dt  # as steps can have it
    text = scene_to_text(with_settings(scene, {'robot.command_delay': delay}))
    write_whole(path, f'# Found by snake-sim fit in {source.name}: {numbers}\n{text}')


def lines(found: Fit, judgement: Judgement, *, forced: bool = False) -> list[str]:
    """Return what was found in lines of text; intervals that do not hold only if forced."""
    found_lines = []
    rows = zip(
        found.unknowns, found.values, judgement.deviation, judgement.interval,
        judgement.bootstrap, strict=True,
    )  # fmt: skip
    for unknown, value, deviation, (low, high), drawn in rows:
        unit = '' if unknown.unit == '1' else f' {unknown.unit}'
        found_lines.append(f'{unknown.name}: {value:.5g}{unit}')
        if np.isinf(deviation):
            found_lines[-1] += ', not determined'
        elif forced or not judgement.failures:
            found_lines[-1] += (
                f', 95 % within {low:.5g} to {high:.5g} '
                f'(bootstrap {drawn[0]:.5g} to {drawn[1]:.5g})'
            )
    names = [unknown.name for unknown in found.unknowns]
    if len(names) > 1:
        width = max(map(len, names))
        found_lines += ['correlation', *(
            f'  {name:{width}} ' + ' '.join(f'{number:7.3f}' for number in row)
            for name, row in zip(names, judgement.correlation, strict=True)
        )]  # fmt: skip
    sizes = ', '.join(f'{name} {value:.3g}' for name, value in judgement.size.items())
    verdict = 'the model explains the recording: the residuals are noise'
    if judgement.failures:
        verdict = NOT_EXPLAINED + '; '.join(judgement.failures)
    return [
        *found_lines,
        *(f'{name} is at a bound' for name in found.at_bound),
        *what_is_not_determined(found, judgement),
        f'residuals in units of the stated noise: {sizes}',
        verdict,
    ]


def summary(found: Fit, judgement: Judgement, *, forced: bool = False) -> dict[str, Any]:
    """Return what was found as JSON has it; intervals that do not hold are None if not forced."""
    holds = forced or not judgement.failures
    rows = zip(
        found.unknowns, found.values, judgement.deviation, judgement.interval,
        judgement.bootstrap, strict=True,
    )  # fmt: skip
    values = {
        unknown.name: {
            'value': value,
            'start': unknown.start,
            'deviation': float(deviation * (value if unknown.is_positive else 1.0))
            if holds and np.isfinite(deviation)
            else None,
            'interval': interval.tolist() if holds and np.isfinite(deviation) else None,
            'bootstrap': drawn.tolist() if holds and np.isfinite(deviation) else None,
        }
        for unknown, value, deviation, interval, drawn in rows
    }
    return {
        'values': values,
        'correlation': np.nan_to_num(judgement.correlation).tolist(),
        'singular_values': judgement.singular.tolist(),
        'not_told': what_is_not_determined(found, judgement),
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
