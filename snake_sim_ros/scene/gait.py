# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Gaits: waves and tables of joint angles, as records of a scene and as functions of time.

A gait is the sum of a yaw wave, a pitch wave, eqs. (70) and (71), and a table of any shape, which
comes from arrays or from a file. `soft_start`, `at_joint` and `wave` take arrays and, compiled,
numbers.
"""

from collections.abc import Mapping, Sequence
import csv
from dataclasses import dataclass
from functools import lru_cache
import json
import math
from pathlib import Path
import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    from_mapping,
    nearest,
    ParameterError,
    quantity,
    quoted,
)
from snake_sim_ros.scene.files import is_file

Array = NDArray[Any]
Numbers = tuple[float, ...]

BETWEEN = 8  # places between two rows at which the largest angle and rate are looked for
CLOSED = 1e-6  # how well the ends of a table that repeats must agree [rad]
AXES = ('yaw', 'pitch')
COLUMN = re.compile(r'(joint_\d+_(?:yaw|pitch))(_deg)?')
RECORDED = re.compile(r'(joint_\d+_(?:yaw|pitch)) angle \[rad\]()')  # as `run --csv` writes it


@dataclass(frozen=True, kw_only=True)
class Table(CheckedRecord):
    """
    Joint angles over time, with a cubic spline between the rows.

    The spline goes through all rows, with continuous rates and accelerations; if the rates of the
    rows are given, it has those and continuous rates. Before the first row the joints have its
    angles and rate 0. After the last row they hold its angles, or begin again with the first one.

    `Table.of` makes one from arrays.

    Attributes
    ----------
    time : tuple of float, shape (rows,)
        Times since the gait began, increasing [s].
    angle, rate : tuple of tuples of float, shape (rows, 2(n-1))
        Angles [rad] of joint_1_yaw, joint_1_pitch, joint_2_yaw and so on, and their rates [rad/s];
        no rates if the spline determines them.
    repeat : bool
        Whether the table begins again after its last row, which must then be like the first one.

    """

    time: Numbers = quantity((), 's', 'times of the rows since the gait began')
    angle: tuple[Numbers, ...] = quantity((), 'rad', 'rows of angles: joint_1_yaw, joint_1_pitch')
    rate: tuple[Numbers, ...] = quantity((), 'rad/s', 'rows of rates, if they are known')
    repeat: bool = quantity(False, '', 'whether the table begins again after its last row')

    def __post_init__(self) -> None:
        """Check every field, shapes, that time increases and that a repeating table is closed."""
        super().__post_init__()
        if len(self.time) == 1:
            raise ParameterError('a table of joint angles must have 2 rows or more, got 1')
        self._check_rows('angle', self.angle)
        if self.rate:
            self._check_rows('rate', self.rate)
        steps = np.diff(self.time)
        if not (steps > 0.0).all():
            k = int(steps.argmin())
            raise ParameterError(
                f'time must increase from row to row, got {self.time[k + 1]:g} s after '
                f'{self.time[k]:g} s'
            )
        if self.repeat and self.time:
            self._check_ends()

    def __hash__(self) -> int:
        """Return a hash that does not look at all numbers."""
        return hash((len(self.time), self.time[-1:], self.angle[-1:], self.repeat))

    def __bool__(self) -> bool:
        """Return whether there are rows."""
        return bool(self.time)

    @classmethod
    def of(
        cls, time: ArrayLike, angle: ArrayLike, rate: ArrayLike | None = None, *,
        repeat: bool = False,
    ) -> 'Table':  # fmt: skip
        """
        Return a table of arrays.

        Parameters
        ----------
        time : array_like, shape (rows,)
            Times since the gait began, increasing [s].
        angle : array_like, shape (rows, n-1, 2)
            (yaw, pitch) of every joint [rad].
        rate : array_like, shape (rows, n-1, 2), optional
            Their rates [rad/s]. Default: those of a spline through the angles.
        repeat : bool, optional
            Whether the table begins again after its last row.

        Raises
        ------
        ParameterError
            If a shape or a value is not usable.

        """
        rows = _numbers('time', time)
        if rows.ndim != 1:
            raise ParameterError(f'time must have the shape (rows,), got {rows.shape}')
        found = {'angle': _numbers('angle', angle)}
        if rate is not None:
            found['rate'] = _numbers('rate', rate)
        flat: dict[str, Any] = {}
        for name, values in found.items():
            if values.ndim != 3 or values.shape[2] != 2 or len(values) != len(rows):
                raise ParameterError(
                    f'{name} must have the shape (rows, n-1, 2), (yaw, pitch) of every joint at '
                    f'{len(rows)} times, got {values.shape}'
                )
            flat[name] = tuple(map(tuple, values.reshape(len(rows), -1).tolist()))
        return cls(time=tuple(rows.tolist()), repeat=repeat, **flat)

    @property
    def joint_count(self) -> int:
        """Number of cardan joints, n-1; 0 without rows."""
        return len(self.angle[0]) // 2 if self.angle else 0

    def reference(self, time: float | Array) -> tuple[Array, Array]:
        """
        Return joint angles and rates.

        Parameters
        ----------
        time : float or ndarray, shape (m,)
            Time since the gait began [s].

        Returns
        -------
        angle, rate : ndarray, shape (n-1, 2) or (m, n-1, 2)
            (yaw, pitch) [rad], [rad/s].

        """
        t, (first, last) = np.asarray(time, dtype=float), (self.time[0], self.time[-1])
        inside = first + (t - first) % (last - first) if self.repeat else np.clip(t, first, last)
        angle, rate = _spline(self)
        moves = ((t >= first) & (t <= last)) | self.repeat
        shape = (*t.shape, self.joint_count, 2)
        return angle(inside).reshape(shape), (moves[..., None] * rate(inside)).reshape(shape)

    def extremes(self) -> tuple[Array, Array, Array]:
        """Return least and largest angles [rad] and fastest rates [rad/s], shape (n-1, 2) each."""
        rows = np.arange(len(self.time) * BETWEEN - BETWEEN + 1) / BETWEEN
        places = np.interp(rows, np.arange(len(self.time)), self.time)
        angle, rate = (function(places) for function in _spline(self))
        found = angle.min(axis=0), angle.max(axis=0), np.abs(rate).max(axis=0)
        least, largest, fastest = (each.reshape(self.joint_count, 2) for each in found)
        return least, largest, fastest

    def angular_frequency(self) -> float:
        """Return largest rate over largest amplitude, that of a sine wave [rad/s]; 0 at rest."""
        amplitude = float(np.ptp(self.angle, axis=0).max()) / 2
        return float(self.extremes()[2].max()) / amplitude if amplitude else 0.0

    def _check_rows(self, name: str, rows: tuple[Numbers, ...]) -> None:
        """Raise an error unless there is a row for each time, with all joints."""
        if len(rows) != len(self.time):
            raise ParameterError(f'{name} must have {len(self.time)} rows, got {len(rows)}')
        for k, row in enumerate(rows):
            if len(row) != 2 * self.joint_count or not row:
                raise ParameterError(
                    f'{name} must have a yaw and a pitch of every joint in all rows, got '
                    f'{len(row)} numbers in row {k + 1}, {len(self.angle[0])} in row 1 of angle'
                )

    def _check_ends(self) -> None:
        """Raise an error if the last row of a table that repeats is not like the first one."""
        first, last = np.array(self.angle[0]), np.array(self.angle[-1])
        k = int(np.abs(last - first).argmax())
        if abs(last[k] - first[k]) > CLOSED:
            raise ParameterError(
                f'a table that repeats must end as it begins, got {names_of(self.joint_count)[k]} '
                f'{first[k]:g} rad in the first row and {last[k]:g} rad in the last one'
            )


@lru_cache(maxsize=8)
def _spline(table: Table) -> tuple[Any, Any]:
    """Return angle and rate of all joints as functions of time, shape (..., 2(n-1))."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    time, angle = np.array(table.time), np.array(table.angle)
    if table.repeat:
        angle[-1] = angle[0]
    if table.rate:
        spline = CubicHermiteSpline(time, angle, np.array(table.rate))
    else:
        spline = CubicSpline(time, angle, bc_type='periodic' if table.repeat else 'not-a-knot')
    return spline, spline.derivative()


def names_of(joint_count: int) -> list[str]:
    """Return the names of the columns of a table: joint_1_yaw, joint_1_pitch and so on."""
    return [f'joint_{j + 1}_{axis}' for j in range(joint_count) for axis in AXES]


@dataclass(frozen=True, kw_only=True)
class Wave(CheckedRecord):
    """A wave of joint references from joint to joint, eqs. (70), (71)."""

    amplitude: float = quantity(0.0, 'rad', 'amplitude A')
    angular_frequency: float = quantity(0.0, 'rad/s', 'angular frequency omega')
    phase_lag: float = quantity(0.0, 'rad', 'phase lag delta from one joint to the next')
    phase: float = quantity(0.0, 'rad', 'phase delta_0 of the first joint')
    offset: float = quantity(0.0, 'rad', 'offset psi')
    gradient: float = quantity(
        0.0,
        '1',
        'gradient gamma: the first joint has 1 - gamma times the amplitude, the last 1 + gamma',
        minimum=-1,
        maximum=1,
    )

    @property
    def largest(self) -> float:
        """Largest amplitude of a joint [rad]."""
        return abs(self.amplitude) * (1.0 + abs(self.gradient))


def amplitudes(wave: Wave, joint_count: int) -> Array:
    """Return the amplitude of a wave at every joint, linear along the robot, (n-1,) [rad]."""
    return at_joint(wave.amplitude, wave.gradient, np.arange(joint_count), joint_count)


def at_joint(amplitude: float, gradient: float, joint: Array, joint_count: int) -> Array:
    """Return the same at joints of some numbers, from 0 [rad]."""
    along = 2.0 * joint / max(1, joint_count - 1) - 1.0
    return amplitude * (1.0 + gradient * along)


@dataclass(frozen=True, kw_only=True)
class Gait(CheckedRecord):
    """The sum of a yaw wave, a pitch wave and a table, and the time over which it fades in."""

    yaw: Wave = Wave()
    pitch: Wave = Wave()
    soft_start: float = quantity(0.0, 's', 'time T_s over which both waves fade in', minimum=0)
    table: Table = Table()


# ---- tables in scenes and files -----------------------------------------------------------------


def table_from(source: Any, folder: Path, robot: Any) -> Table:
    """
    Return the table that a scene names or holds.

    Parameters
    ----------
    source : Table, str, Path or mapping
        A file, a mapping with `file` and `repeat`, or the fields of a table, also as JSON.
    folder : Path
        Where files are that have no absolute path.
    joint_count : int
        Number of cardan joints of the robot, n-1.

    Raises
    ------
    ParameterError
        If there is no such file, or what is in it is not usable.

    """
    if isinstance(source, Table):
        return source
    if isinstance(source, str) and source.startswith('{'):
        try:
            source = json.loads(source)
        except (ValueError, RecursionError) as error:
            raise ParameterError(f'gait.table is not readable as JSON: {error}') from None
    if isinstance(source, (str, Path)):
        source = {'file': source}
    if not isinstance(source, Mapping) or 'file' not in source:
        table: Table = from_mapping(Table, source, 'gait.table')
        return table
    for key in source:
        if key not in ('file', 'repeat'):
            raise ParameterError(
                f'gait.table: unknown key {quoted(key)}; {nearest(key, ["repeat"])}'
            )
    path = folder / str(source['file'])
    if not is_file(path):
        raise ParameterError(f'gait.table: no file {path}')
    columns = _recorded(path, robot) if path.suffix == '.npz' else _columns(path, robot)
    repeat = source.get('repeat', False)
    try:
        return Table.of(*columns, repeat=repeat)
    except ParameterError as error:
        raise ParameterError(f'{path.name}: {error}') from None


def table_to_text(table: Table) -> str:
    """Return a table as JSON, which `table_from` reads a hundred times as fast as YAML."""
    fields = {'time': table.time, 'angle': table.angle, 'rate': table.rate}
    return json.dumps({**fields, 'repeat': table.repeat})


def _recorded(path: Path, robot: Any) -> tuple[Array, Array]:
    """Return times and joint angles of an npz file, as `snake-sim run --out` writes it."""
    try:
        with np.load(path) as file:
            time, angle = file['time'], file['joint_angle']
    except Exception:  # broken data makes NumPy, zipfile and zlib raise whatever they like
        raise ParameterError(
            f'{path} must be an npz file with the arrays time and joint_angle, as snake-sim run '
            f'--out writes it'
        ) from None
    is_columns = angle.ndim == 2 and angle.shape[1] == len(robot.axis_names)
    return time, robot.by_joint(angle, 0.0) if is_columns else angle


def _columns(path: Path, robot: Any) -> tuple[Array, Array]:
    """Return times and joint angles of a CSV file; joints without a column stay at 0."""
    try:
        header, *rows = list(csv.reader(path.read_text(encoding='utf-8-sig').splitlines())) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f'{path} cannot be read as CSV: {error}') from None
    header = [name.strip() for name in header]
    names = list(robot.axis_names)
    places = _places(path.name, header, names)
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    values = np.zeros((len(rows), 1 + len(names)))
    for k, row in enumerate(rows):
        if len(row) != len(header):
            raise ParameterError(
                f'{path.name}: row {k + 1} must have {len(header)} cells, as the header has, '
                f'got {len(row)}'
            )
        for column, (place, scale) in places.items():
            try:
                values[k, place] = scale * float(row[column])
            except ValueError:
                raise ParameterError(
                    f'{path.name}: {header[column]} in row {k + 1} must be a number, got '
                    f'{row[column]!r}'
                ) from None
    return values[:, 0], robot.by_joint(values[:, 1:], 0.0)


def _places(file: str, header: Sequence[str], names: list[str]) -> dict[int, tuple[int, float]]:
    """Return column of a file -> column of the table and factor to SI units."""
    is_recorded = any(RECORDED.fullmatch(name) for name in header)
    places: dict[int, tuple[int, float]] = {}
    for column, name in enumerate(header):
        found = (RECORDED if is_recorded else COLUMN).fullmatch(name)
        if name in ('time', 'time [s]'):
            places[column] = 0, 1.0
        elif found and found[1] in names:
            scale = math.pi / 180 if found[2] else 1.0
            places[column] = 1 + names.index(found[1]), scale
        elif found or not is_recorded:
            raise ParameterError(
                f'{file}: unknown column {name!r}; the columns are time and '
                f'{" to ".join(names[:1] + names[-1:])}, with _deg for degrees'
            )
    used = [place for place, _ in places.values()]
    if 0 not in used:
        raise ParameterError(f'{file}: no column time; the header must be time, joint_1_yaw, ...')
    twice = [place for place in used if used.count(place) > 1]
    if twice:
        raise ParameterError(f'{file}: {["time", *names][twice[0]]} is given in two columns')
    return places


def _numbers(name: str, values: ArrayLike) -> Array:
    """Return an array of floats; raise an error if it is something else."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise ParameterError(
            f'{name} must be an array of numbers, got {type(values).__name__}'
        ) from None


# ---- references ---------------------------------------------------------------------------------


def reference(gait: Gait, time: float | Array, joint_count: int) -> tuple[Array, Array]:
    """
    Return joint reference angles and rates, eqs. (70), (71).

    ``alpha_i = s(t) (A_i sin(omega t + (i - 1) delta + delta_0) + psi)`` for joints i = 1 to n-1,
    yaw and pitch alike, with the soft start s of `soft_start` and the `amplitudes` A_i. A negative
    phase lag delta sends the wave from link 1 to link n. The table of a gait is added to its waves
    before they fade in.

    Parameters
    ----------
    gait : Gait
    time : float or ndarray, shape (m,)
        Time since the gait began [s].
    joint_count : int
        Number of cardan joints, n-1.

    Returns
    -------
    angle, rate : ndarray, shape (n-1, 2) or (m, n-1, 2)
        Reference (yaw, pitch) [rad] and its time derivative [rad/s].

    """
    t = np.asarray(time, dtype=float)[..., None]
    fade = soft_start(t, gait.soft_start) if t.min(initial=math.inf) < gait.soft_start else None
    angle, rate = np.zeros((2, *t.shape[:-1], joint_count, 2))
    for axis, numbers in enumerate((gait.yaw, gait.pitch)):
        if numbers.amplitude != 0.0 or numbers.offset != 0.0:
            each = numbers.angular_frequency, numbers.phase, numbers.offset
            along = _along_robot(numbers, joint_count)
            angle[..., axis], rate[..., axis] = wave(each, fade, t, along)
    if gait.table:
        of_table, rate_of_table = gait.table.reference(t[..., 0])
        if fade:
            s, s_dot = (value[..., None] for value in fade)
            of_table, rate_of_table = s * of_table, s * rate_of_table + s_dot * of_table
        angle += of_table
        rate += rate_of_table
    return angle, rate


def soft_start(time: Array, duration: float) -> tuple[Array, Array]:
    """
    Return the fade-in s = 3x^2 - 2x^3, x = t/T_s up to 1, and its rate [1/s].

    Assumption: the paper mentions a soft start without its formula; this one and its rate are
    continuous.

    Parameters
    ----------
    time : ndarray
        Time since the gait began [s].
    duration : float
        T_s [s]; with 0 there is no soft start.

    """
    if duration == 0.0:
        return 1.0 + 0.0 * time, 0.0 * time
    x = np.minimum(np.maximum(time / duration, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) / duration


def wave(
    numbers: tuple[float, float, float], fade: tuple[Array, Array] | None, t: Array,
    along: tuple[Array, Array],
) -> tuple[Array, Array]:  # fmt: skip
    """
    Return angle [rad] and rate [rad/s] of one wave that fades in.

    Parameters
    ----------
    numbers : tuple of float
        Angular frequency, phase and offset of a `Wave`.
    fade : tuple of ndarray or None
        As `soft_start` returns it, None without one.
    t : ndarray
        Time since the gait began [s].
    along : tuple of ndarray
        What `of_joint` returns for the joints.

    """
    (omega, phase, offset), (s_joint, c_joint) = numbers, along
    # sin and cos of a sum: of each time and of each joint once, not of all pairs.
    sine, cosine = np.sin(omega * t + phase), np.cos(omega * t + phase)
    angle = sine * c_joint + (cosine * s_joint + offset)
    if fade is None:
        return angle, (omega * cosine) * c_joint - (omega * sine) * s_joint
    s, s_dot = fade
    rate = (s * omega * cosine) * c_joint - (s * omega * sine) * s_joint
    return s * angle, rate + s_dot * angle


def of_joint(amplitude: Array, lag: Array) -> tuple[Array, Array]:
    """Return A_i sin((i - 1) delta) and A_i cos((i - 1) delta) of joints with a lag [rad]."""
    return amplitude * np.sin(lag), amplitude * np.cos(lag)


@lru_cache(maxsize=8)
def _along_robot(wave: Wave, joint_count: int) -> tuple[Array, Array]:
    """Return the same of all joints, (n-1,)."""
    return of_joint(amplitudes(wave, joint_count), np.arange(joint_count) * wave.phase_lag)
