# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whether all methods and all numerical settings have one limit, in random scenes.

A row is a scene: Aiko's links, 2 to 15 of them, from rest, with a random gait and friction on a
flat floor, among pegs, over cells or with folds in which links touch. It has distances of paths,
of the middle link at any time, over ``max(l, L)`` with the length l of its path and L of a link:

- from a run to that with half the step, of `newton` and of `bdf2`, and from one to the other;
- to runs with a tolerance or the compliance ten times smaller or larger;
- from the level `auto` to the spatial one;
- to runs whose gait is ahead by a small phase, with which links move faster by about a tenth of it
  in m/s: how a push grows;
- of runs with an `accuracy`, to the limit.

Where these are not below LIMIT, steps are halved until they are, or down to 1/FINEST s.

Wherever a push of 1e-10 m/s grows beyond GROWTH, the motion is sensitive: rounding decides. In
most others that have no limit to LIMIT, it depends on the past in jumps. A robot that falls
on its spheres takes the impacts in the order in which they land; if microseconds decide which is
first, a push of 1e-6 m/s does not grow, but it may change the order. A step of 1e-5 s is off by
1e-4 m/s in the velocity with which a contact lands. `jump` is what pushes of this size and less do
out of proportion; `verdict` names what was found.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
import math
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.csv_tables import records_of, Table
from snake_sim_ros import ParameterError, Scene, Simulation
from snake_sim_ros.scene.checked_records import from_mapping
from snake_sim_ros.scene.files import write_whole
from snake_sim_ros.scene.parameters import Array, with_settings
from snake_sim_ros.stepping.accuracy import with_accuracy
from snake_sim_ros.stepping.simulation import sample

KINDS = ('flat', 'pegs', 'cells', 'folds')
SEED = 36
DURATION, PERIOD = 1.5, 0.02  # of a run, and between two points of its path [s]
RATES = {  # steps a second, each line twice the one before
    'newton': (16_000, 32_000, 64_000, 128_000),
    'bdf2': (2_000, 4_000, 8_000, 16_000),
}
FINEST = 1_024_000  # of `newton`, up to which rates are doubled while paths are not one
FINE = {'newton': 64_000, 'bdf2': 8_000}  # with which settings and pushes are compared
EXACT = {'level': 'spatial', 'solver.residual_tolerance': 1e-12, 'solver.iteration_limit': 200}
# As above, but for one setting.
SETTINGS = {
    'solver.activation_tolerance': (1e-7, 1e-5),
    'solver.normal_compliance': (1e-5, 1e-3),
    'solver.residual_tolerance': (1e-13, 1e-11),
}
SMALL_PUSH = 1e-9  # change of the phase of the gait [rad]
LARGE_PUSHES = (1e-5, -1e-5, 3e-5, -3e-5, 1e-4, -1e-4, 3e-4, -3e-4, 1e-3, -1e-3)
LIMIT = 1e-4  # largest distance of paths that have one limit
GROWTH = 1e-5  # of a small push, beyond which a motion is sensitive
PROPORTION = 10.0  # change of the path over that of the phase, beyond which it is a jump
JUMP_SHARE = 0.1  # of the distances that are left: size of a jump that explains them
VERDICTS = ('one limit', 'sensitive', 'jumps', 'open', 'not run')
ASKED = (1e-2, 1e-3, 1e-4)
KNOWN_SHARE = 0.25  # of an accuracy: doubt about the limit up to which it is judged


@dataclass(frozen=True)
class Row:
    """A scene; distances are relative, and nan where there is none. See the module."""

    seed: int
    kind: str
    links: int
    path: float  # length of the path of the middle link [m]
    unconverged: int  # of all steps of the runs with usual settings
    newton_16: float  # from 1/16000 to 1/32000 s
    newton_32: float
    newton_64: float
    bdf2_2: float  # from 1/2000 to 1/4000 s
    bdf2_4: float
    bdf2_8: float
    apart_16: float  # from `newton` at 1/16000 s to `bdf2` at 1/2000 s
    apart_32: float
    apart_64: float
    apart_128: float
    settings: float  # the largest of all settings and both methods
    levels: float  # from `auto` to spatial; `bdf2`
    small_push: float  # the largest of both methods
    jump: float  # the largest of all large pushes and both methods; nan if it was not looked for
    accuracy_2: float  # error with accuracy 1e-2
    accuracy_3: float
    accuracy_4: float
    refined: float = math.nan  # as `refined` returns it; nan if steps are small enough
    message: str = ''  # why there are no numbers


COLUMNS = [item.name for item in fields(Row)]
DISTANCES = {
    'newton_16': '`newton`, 1/16000 from 1/32000 s',
    'newton_32': '`newton`, 1/32000 from 1/64000 s',
    'newton_64': '`newton`, 1/64000 from 1/128000 s',
    'bdf2_2': '`bdf2`, 1/2000 from 1/4000 s',
    'bdf2_4': '`bdf2`, 1/4000 from 1/8000 s',
    'bdf2_8': '`bdf2`, 1/8000 from 1/16000 s',
    'apart_16': '`newton` 1/16000 from `bdf2` 1/2000 s',
    'apart_128': '`newton` 1/128000 from `bdf2` 1/16000 s',
    'settings': 'tolerances and compliance x0.1 and x10',
    'levels': '`auto` from spatial',
    'small_push': 'a push of 1e-10 m/s',
}


def limit_scene(seed: int) -> Scene:
    """Return a random scene; its kind is that of the seed modulo four."""
    rng = np.random.default_rng([SEED, seed])
    kind = KINDS[seed % len(KINDS)]
    n = int(rng.integers(8, 16)) if kind == 'folds' else int(rng.integers(2, 16))
    along, across = np.exp(rng.uniform(np.log(0.02), np.log(1.5), 2))
    frequency = rng.uniform(0.8, 3.0)
    yaw = {
        'amplitude': rng.uniform(0.1, 0.7),
        'angular_frequency': frequency,
        'phase_lag': rng.uniform(-1.2, 1.2),
        'phase': rng.uniform(0.0, 2 * math.pi),
    }
    gait: dict[str, Any] = {'yaw': yaw, 'soft_start': float(rng.choice([0.5, 1.0]))}
    if rng.random() < 0.5:
        gait['pitch'] = {
            'amplitude': rng.uniform(0.02, 0.25),
            'angular_frequency': frequency * float(rng.choice([1.0, 2.0])),
            'phase_lag': rng.uniform(-1.2, 1.2),
            'phase': rng.uniform(0.0, 2 * math.pi),
        }
    scene: dict[str, Any] = {
        'robot': {'link_count': n},
        'friction': {'longitudinal': along, 'transversal': rng.choice([along, across])},
        'gait': gait,
        'duration': DURATION,
    }
    span, radius = 0.122 * n, 0.0525
    if kind == 'pegs':
        count, peg = int(rng.integers(3, 9)), rng.uniform(0.01, 0.04)
        beside = radius + peg + rng.uniform(0.002, 0.04, count)
        scene['pegs'] = {
            'x': rng.uniform(-0.6, 0.6, count) * span,
            'y': beside * rng.choice([-1, 1], count),
            'radius': peg,
            'friction': rng.uniform(0.0, 0.5),
        }
    elif kind == 'cells':
        cell = rng.uniform(0.15, 0.4)
        count = 2 * math.ceil(0.6 * span / cell) + 1
        corner = cell * (rng.uniform(0.0, 1.0, 2) - 0.5 * count - 0.5)
        scene['ground'] = {
            'heights': rng.uniform(0.0, 0.02, (count, count)),
            'cell': cell,
            'origin': corner,
        }
    elif kind == 'folds':
        scene['robot']['joint_limit'] = 1.5
        yaw |= {
            'amplitude': rng.uniform(2.2, 2.9) * math.pi / n,
            'phase_lag': rng.uniform(-0.1, 0.1),
            'phase': rng.choice([0.0, math.pi]) + rng.uniform(-0.2, 0.2) + math.pi / 4,
        }
        scene |= {'self_contact': True, 'self_contact_friction': rng.uniform(0.0, 0.5)}
    found: Scene = from_mapping(Scene, _plain(scene), 'scene')
    return found


def _plain(value: Any) -> Any:
    """Return NumPy's numbers as those of YAML, with six digits."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, tuple | np.ndarray | list):
        return tuple(_plain(item) for item in value)
    return value if isinstance(value, str | bool | int) else float(f'{float(value):.6g}')


class Paths:
    """The paths of the middle link in runs of a scene, (m, 3) [m], and unconverged steps."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.unconverged = scene, 0
        self._known: dict[tuple[str, int], Array] = {}

    def of(self, method: str, rate: int) -> Array:
        """Return the path with usual settings."""
        if (method, rate) not in self._known:
            path, unconverged = self.run({'method': method, 'dt': 1 / rate})
            self._known[method, rate] = path
            self.unconverged += unconverged
        return self._known[method, rate]

    def run(self, settings: dict[str, Any], accuracy: float = 0.0) -> tuple[Array, int]:
        """Return a path and the number of unconverged steps, with some settings."""
        if accuracy:
            scene = with_accuracy(self.scene, accuracy, PERIOD)
        else:
            scene = with_settings(self.scene, {**EXACT, **settings})
        found = sample(Simulation(scene), round(PERIOD / scene.dt), round(DURATION / PERIOD))
        if found.report.failure:
            raise ParameterError(found.report.failure)
        return found.path, found.report.unconverged

    @property
    def best(self) -> Array:
        """The path that is nearest to the limit: of the smallest steps of `bdf2` so far."""
        rates = [rate for method, rate in self._known if method == 'bdf2']
        return self.of('bdf2', max([RATES['bdf2'][-1], *rates]))

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.best, axis=0), axis=1).sum())

    def distance(self, path: Array, other: Array) -> float:
        """Return the distance of two paths, over the length of the path or that of a link."""
        link = float(self.scene.robot.per_link('link_length').mean())
        apart = np.linalg.norm(path - other, axis=1).max()
        return float(apart / max(self.length, link))

    def changed(self, settings: dict[str, Any], rates: dict[str, int] = FINE) -> float:
        """Return the distance of runs with settings from those without; the largest."""
        return max(
            self.distance(
                self.of(method, rate),
                self.run({'method': method, 'dt': 1 / rate, **settings})[0],
            )
            for method, rate in rates.items()
        )

    def ahead(self, phase: float) -> float:
        """Return the distance of runs whose gait is ahead by a phase [rad]; the largest."""
        gait = self.scene.gait
        return self.changed(
            {f'gait.{name}.phase': getattr(gait, name).phase + phase for name in ('yaw', 'pitch')}
        )


def measured(seed: int) -> Row:
    """Return the row of a scene."""
    scene = limit_scene(seed)
    paths, n = Paths(scene), scene.robot.link_count
    try:
        found = distances(paths)
    except ParameterError as error:
        empty: dict[str, Any] = dict.fromkeys(COLUMNS[5:-1], math.nan)
        return Row(seed, KINDS[seed % len(KINDS)], n, 0.0, 0, **(empty | {'message': str(error)}))
    numbers: dict[str, Any] = dict(found)
    return Row(seed, KINDS[seed % len(KINDS)], n, paths.length, paths.unconverged, **numbers)


def distances(paths: Paths) -> dict[str, float]:
    """Return the columns of a row with distances."""
    found = {}
    for method, rates in RATES.items():
        for rate, finer in pairwise(rates):
            apart = paths.distance(paths.of(method, rate), paths.of(method, finer))
            found[f'{method}_{rate // 1000}'] = apart
    for newton, bdf2 in zip(RATES['newton'], RATES['bdf2'], strict=True):
        apart = paths.distance(paths.of('newton', newton), paths.of('bdf2', bdf2))
        found[f'apart_{newton // 1000}'] = apart
    found['settings'] = changed_by_settings(paths, FINE)
    auto, _ = paths.run({'method': 'bdf2', 'dt': 1 / RATES['bdf2'][-1], 'level': 'auto'})
    found['levels'] = paths.distance(auto, paths.best)
    found['small_push'] = paths.ahead(SMALL_PUSH)
    settled = max(found['apart_128'], found['bdf2_8'], found['settings']) < LIMIT
    insensitive = not settled and found['small_push'] <= GROWTH
    found['refined'] = refined(paths) if insensitive else math.nan
    for accuracy in ASKED:  # once the best path is known
        path, _ = paths.run({}, accuracy)
        found[accuracy_column(accuracy)] = paths.distance(path, paths.best)
    settled = settled or found['refined'] < LIMIT
    found['jump'] = math.nan if settled else largest_jump(paths)
    return found


def changed_by_settings(paths: Paths, rates: dict[str, int]) -> float:
    """Return the largest distance of a run with one other setting, with some rates."""
    return max(
        paths.changed({name: value}, rates)
        for name, values in SETTINGS.items()
        for value in values
    )


def refined(paths: Paths) -> float:
    """
    Return the largest distance that judges a limit, with steps halved until it is below LIMIT.

    It is that of both methods, that of `bdf2` from twice its step, and that of other settings.
    """
    rates = {method: each[-1] for method, each in RATES.items()}
    apart = math.inf
    while apart >= LIMIT and rates['newton'] < FINEST:
        rates = {method: 2 * rate for method, rate in rates.items()}
        best = paths.of('bdf2', rates['bdf2'])
        others = paths.of('newton', rates['newton']), paths.of('bdf2', rates['bdf2'] // 2)
        apart = max(paths.distance(other, best) for other in others)
        if apart < LIMIT:
            apart = max(apart, changed_by_settings(paths, rates))
    return apart


def largest_jump(paths: Paths) -> float:
    """Return the largest change of the path by a large push that is out of proportion, or 0."""
    changes = ((paths.ahead(push), abs(push)) for push in LARGE_PUSHES)
    return max(change if change > PROPORTION * push else 0.0 for change, push in changes)


def doubt(row: Row) -> float:
    """Return the distance of two methods with their smallest steps, and from larger steps."""
    return max(row.apart_128, row.bdf2_8) if math.isnan(row.refined) else row.refined


def verdict(row: Row) -> str:
    """Return what became of the limit of a scene: one of VERDICTS."""
    if row.message:
        return 'not run'
    apart = max(doubt(row), row.settings) if math.isnan(row.refined) else row.refined
    if apart < LIMIT:
        return 'one limit'
    if row.small_push > GROWTH:
        return 'sensitive'
    if row.jump > max(LIMIT, JUMP_SHARE * apart):
        return 'jumps'
    return 'open'


def limits_table(rows: Sequence[Row]) -> str:
    """Return tables in Markdown: what became of the limits, and errors with an accuracy."""
    lines = ['| scenes | ' + ' | '.join((*KINDS, 'all')) + ' |', '|---' * 6 + '|']
    for name in VERDICTS:
        found = [row for row in rows if verdict(row) == name]
        counts = [sum(row.kind == kind for row in found) for kind in KINDS]
        lines.append(f'| {name} | ' + ' | '.join(map(str, (*counts, len(found)))) + ' |')
    lines += [
        '',
        '| distance, median and 90 % of scenes | one limit | sensitive | jumps | open |',
        '|---' * 5 + '|',
    ]
    for column in DISTANCES:
        cells = []
        for name in VERDICTS[:-1]:
            values = [getattr(row, column) for row in rows if verdict(row) == name]
            low, high = np.quantile(values, (0.5, 0.9)) if values else (0.0, 0.0)
            cells.append(f'{low:.1e}, {high:.1e}' if values else '')
        lines.append(f'| {DISTANCES[column]} | ' + ' | '.join(cells) + ' |')
    lines += [
        '',
        '| accuracy | scenes judged | missed | largest error over it | median |',
        '|---' * 5 + '|',
    ]
    for accuracy in ASKED:
        errors = np.array(accuracy_errors(rows, accuracy))
        cells = [f'{accuracy:.0e}', str(len(errors)), str(int((errors > 1).sum()))]
        cells += [f'{errors.max():.2f}', f'{np.median(errors):.2f}'] if len(errors) else ['', '']
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines) + '\n'


def accuracy_errors(rows: Sequence[Row], accuracy: float) -> list[float]:
    """Return errors over an accuracy, of scenes whose limits are known to KNOWN_SHARE of it."""
    column = accuracy_column(accuracy)
    return [
        getattr(row, column) / accuracy
        for row in rows
        if not row.message and doubt(row) <= KNOWN_SHARE * accuracy
    ]


def accuracy_column(accuracy: float) -> str:
    """Return the name of the column with errors with an accuracy."""
    return f'accuracy_{round(-math.log10(accuracy))}'


def draw_limits(table: Table, folder: Path) -> list[Path]:
    """
    Write the tables in Markdown, and return their file.

    Raises
    ------
    ParameterError
        If the table is not one of limits, or has no rows.

    """
    rows = records_of(table, 'limits', Row)
    if not rows:
        raise ParameterError('no limit to show: the file has no rows')
    path = folder / 'limits.md'
    write_whole(path, limits_table(rows))
    return [path]
