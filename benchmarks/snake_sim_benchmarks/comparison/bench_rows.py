# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rows of the bench: their columns, how files are read, and the entries that make rows."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
import math
from typing import Any

from snake_sim_benchmarks.comparison.csv_tables import is_empty, records_of, Table
from snake_sim_ros import ParameterError


@dataclass(frozen=True, kw_only=True)
class Row:
    """
    A run, identified by the columns of KEY, with its results; nan or None means no value.

    Times are wall times, and errors are the largest at any time. `error_path` and the other errors
    of paths are relative to the distance of the middle link from start to end. In the parts
    `ensemble`, `cycle`, `robust` and `accuracy`, `seconds_per_second` is the processor time of one
    thread in one compiled call, the 10 % quantile of trials. The error of a `cycle` is that at its
    end, and `error_path` of `robust` is the largest of its trials.
    """

    part: str
    case: str
    method: str
    level: str = ''
    setting: str = ''
    dt: float = math.nan  # s; mean step of a method that chooses it
    tolerance: float = math.nan  # of a method that chooses its steps, or at which a solver stops
    n: int | None = None
    duration: float = math.nan  # s
    status: str = ''
    error_path: float = math.nan
    error_rms: float = math.nan  # over trials, with the ends of its bootstrap interval
    rms_low: float = math.nan
    rms_high: float = math.nan
    error_median: float = math.nan  # over trials
    error_quantile: float = math.nan  # 90 % of trials are better
    trials: int | None = None
    path_difference: float = math.nan  # from the path of newton at the same step
    error_angle: float = math.nan  # rad
    error_heading: float = math.nan  # rad
    reference_error: float = math.nan  # how far the converged solution is from converged
    error_limit: float = math.nan
    model_error: float = math.nan
    energy_error: float = math.nan
    seconds: float = math.nan
    seconds_per_second: float = math.nan
    median_us: float = math.nan
    p99_us: float = math.nan
    calibration_us: float = math.nan  # of a fixed amount of arithmetic, timed beside the run
    compile_seconds: float = math.nan
    steps: int | None = None
    planar_steps: int | None = None
    iterations: int | None = None
    iterations_max: int | None = None
    fallbacks: int | None = None
    unconverged: int | None = None
    residual_max: float = math.nan  # m/s
    penetration_max: float = math.nan  # m
    penetration_end: float = math.nan  # m, largest of the last second
    joint_gap_max: float = math.nan  # m
    joint_twist_max: float = math.nan
    memory_begin: int | None = None  # resident, of the process [B]
    memory_end: int | None = None
    message: str = ''


COLUMNS = tuple(item.name for item in fields(Row))
KEY = ('part', 'case', 'method', 'level', 'setting', 'dt', 'tolerance', 'n', 'duration')


@dataclass(frozen=True)
class Entry:
    """
    A run that makes one row or several.

    Attributes
    ----------
    keys : tuple of Row
        Rows of which only the keys are filled.
    run : callable
        Returns the rows. There may be more than in `keys`, made by the same run.
    guess : float
        Expected wall time, for the progress bar [s].

    """

    keys: tuple[Row, ...]
    run: Callable[[], list[Row]]
    guess: float

    def is_in(self, done: set[tuple[str, ...]]) -> bool:
        """Return whether all rows of this entry are among these keys."""
        return done.issuperset(key(asdict(row)) for row in self.keys)


def key(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the key of a row, with the tolerance of a method that chooses its steps, not dt."""
    texts = {name: '' if is_empty(row[name]) else str(row[name]) for name in KEY}
    if texts['tolerance']:
        texts['dt'] = ''
    return tuple(texts.values())


def outcome(entry: Entry) -> list[Row]:
    """Run an entry; an exception makes a row as well, except an interruption from the keyboard."""
    try:
        return entry.run()
    except Exception as error:  # the bench goes on, the row says what happened
        status = 'refused' if isinstance(error, ParameterError) else 'error'
        message = ' '.join(f'{type(error).__name__}: {error}'.split())
        return [replace(row, status=status, message=message) for row in entry.keys]


def line(row: Row) -> str:
    """Return a row as one short line, which shows the progress."""
    what = [row.part, row.case, row.method, row.level, row.setting]
    if row.part == 'accuracy':
        what.append(f'{row.tolerance:g}')
    elif row.dt > 0.0:
        what.append(f'dt {row.dt:.2g} s')
    if row.n:
        what.append(f'n = {row.n}')
    if row.part == 'iterations' and row.iterations:
        what.append(f'{row.iterations} iterations to {row.residual_max:.1e} m/s')
    if row.median_us > 0.0:
        what.append(f'{row.median_us:.2f} us')
    if math.isfinite(row.path_difference):
        what.append(f'{row.path_difference:.1e} from newton, {row.unconverged} unconverged')
    if row.part == 'soak' and row.steps:
        what.append(f'{row.steps} steps, {row.penetration_end:.1e} m deep')
    if math.isfinite(row.error_path):
        what.append(f'{100 * row.error_path:.3g} %')
    if math.isfinite(row.error_rms):
        what.append(f'{100 * row.error_rms:.3g} % ({100 * row.rms_low:.3g} to '
                    f'{100 * row.rms_high:.3g} %)')  # fmt: skip
    if row.part in ('ensemble', 'cycle', 'robust', 'accuracy') and row.seconds_per_second > 0.0:
        what.append(f'{1 / row.seconds_per_second:.0f}x')
    return ' | '.join(part for part in [*what, row.status, row.message] if part)


def rows_of(table: Table) -> list[Row]:
    """
    Return the rows of a file with numbers for their texts.

    Raises
    ------
    ParameterError
        See `csv_tables.records_of`.

    """
    return records_of(table, 'bench', Row)
