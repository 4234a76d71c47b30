# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The table of a study or an optimization as a file, and its journal while runs are under way.

A table is a polars data frame, written as Parquet, or as CSV for other programs. The journal has
rows as they are done, a line of JSON each. A chunk of rows is one write to its end: whatever kills
the process, the rows before are whole, and a line that is not is left out.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
import fcntl
from importlib import import_module
from io import BytesIO
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import write_whole

if TYPE_CHECKING:
    import polars

Result = dict[str, Any]  # of a run, by the names of its columns
SUFFIXES = ('.parquet', '.csv')
PICTURES = ('.png', '.svg', '.pdf')
# Files and folders that are named after a table, with these suffixes in place of its own.
BESIDE = {'best': '.best.yaml', 'front': '.front', 'picture': '.png', 'trajectories': ''}
# Columns that are neither values nor metrics, and their types.
OWN = {
    'row': 'Int64', 'status': 'String', 'failure': 'String', 'unconverged': 'Int64',
    'seconds': 'Float64', 'key': 'String', 'trajectory': 'String',
}  # fmt: skip


def optional(package: str, what: str) -> Any:
    """
    Return a package that only studies need, and not all installations have.

    Parameters
    ----------
    package : str
    what : str
        What needs it, for the message.

    Raises
    ------
    ParameterError
        If it is not installed.

    """
    try:
        return import_module(package)
    except ImportError as error:
        raise ParameterError(f"{what} ({error}): pip install 'snake_sim_ros[studies]'") from None


def library() -> Any:
    """Return polars; see `optional`."""
    return optional('polars', 'studies need polars')


def check_file(path: Path, option: str, suffixes: Sequence[str] = SUFFIXES) -> None:
    """Raise an error unless a file of one of the suffixes can be written to a path."""
    if path.suffix not in suffixes:
        listed = f'{", ".join(suffixes[:-1])} or {suffixes[-1]}' if suffixes[1:] else suffixes[0]
        raise ParameterError(f'{option} must end in {listed}, got {path}')
    if not path.absolute().parent.is_dir():
        raise ParameterError(f'{option}: no folder {path.absolute().parent}')


def beside(table: Path, what: str) -> Path:
    """Return the file or folder beside a table, one of BESIDE."""
    return table.with_suffix(BESIDE[what])


def journal_of(table: Path) -> Path:
    """Return the file of the journal of a table."""
    return table.with_name(f'{table.name}.journal')


class Journal:
    """
    A journal that this process alone writes.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ParameterError
        If another process writes it.

    """

    def __init__(self, path: Path) -> None:
        self.path, self.file = path, path.open('a+b')
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.file.close()
            raise ParameterError(
                f'{path} is being written by another study; name another file with --out'
            ) from None

    def rows(self) -> list[Result]:
        """Return all whole rows; a line that a killed process left unfinished is ended."""
        self.file.seek(0)
        content, rows = self.file.read(), []
        for line in content.splitlines():
            try:
                row = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if isinstance(row, dict):
                rows.append(row)
        if content and not content.endswith(b'\n'):
            self._append(b'\n')
        return rows

    def add(self, rows: Sequence[Result]) -> None:
        """Add rows, all by one write."""
        self._append(''.join(f'{json.dumps(row)}\n' for row in rows).encode())

    def _append(self, content: bytes) -> None:
        self.file.write(content)
        self.file.flush()

    def close(self, *, remove: bool) -> None:
        """Release the journal, and remove it if its rows are in the table."""
        if remove:
            self.path.unlink(missing_ok=True)
        self.file.close()


@contextmanager
def stored(
    out: Path | None,
    found: Callable[[Path], Sequence[Result]],
    table: Callable[[], 'polars.DataFrame | None'],
    *,
    keep_journal: bool,
) -> Iterator[tuple[dict[str, Result], Callable[[Sequence[Result]], object]]]:
    """
    Give the runs that are done by their keys, and what keeps more; write the table at the end.

    Parameters
    ----------
    out : Path or None
        The file of the table, if any.
    found : callable
        ``found(out)`` returns runs in a table that is there, or raises `ParameterError`.
    table : callable
        Returns the table as the context ends, in whatever way; None if there is nothing to write.
    keep_journal : bool
        Whether the journal stays after the table is written.

    """
    library()
    if not out:
        yield {}, lambda chunk: None
        return
    check_file(out, '--out')
    rows = found(out) if out.exists() else []
    journal, is_written = Journal(journal_of(out)), False
    try:
        known = {row['key']: row for row in [*rows, *journal.rows()] if row.get('key')}
        try:
            yield known, journal.add
        finally:
            frame = table()
            if frame is not None:
                write(frame, out)
                is_written = True
    finally:
        journal.close(remove=is_written and not keep_journal)


def frame_of(results: Sequence[Mapping[str, Any]], metrics: Sequence[str]) -> 'polars.DataFrame':
    """Return the table of results in the order of their rows, which all have the same columns."""
    pl = library()
    results = sorted(results, key=lambda result: result['row'])
    columns = {}
    for name in results[0] if results else ('row', *metrics, 'status', 'key'):
        values = [result[name] for result in results]
        kind = 'Float64' if name in metrics else OWN.get(name) or _kind(values)
        if kind == 'String':
            values = [None if value is None else _text(value) for value in values]
        columns[name] = pl.Series(name, values, getattr(pl, kind), strict=False)
    frame: polars.DataFrame = pl.DataFrame(columns)
    return frame


def _kind(values: Sequence[Any]) -> str:
    """Return the type of a column of values that vary; what is not all of a kind is text."""
    kinds = {type(value) for value in values}
    if kinds == {bool}:
        return 'Boolean'
    if kinds == {int}:
        return 'Int64'
    return 'Float64' if kinds <= {int, float} else 'String'


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def write(frame: 'polars.DataFrame', path: Path) -> None:
    """Write a table, whole or not at all."""
    content = BytesIO()
    if path.suffix == '.csv':
        frame.write_csv(content)
    else:
        frame.write_parquet(content)
    write_whole(path, content.getvalue())


def read(path: Path, metrics: Sequence[str]) -> list[Result]:
    """
    Return the rows of the table of a study.

    Raises
    ------
    ParameterError
        If the file is something else.

    """
    pl = library()
    types = {name: getattr(pl, kind) for name, kind in OWN.items()}
    types |= dict.fromkeys(metrics, pl.Float64)
    try:
        if path.suffix == '.csv':
            frame = pl.read_csv(path, schema_overrides=types)
        else:
            frame = pl.read_parquet(path)
    except Exception as error:  # polars raises errors of its own and of the system
        raise ParameterError(
            f'{path} is not a whole table: {str(error).splitlines()[0]}; delete it, or name '
            f'another file'
        ) from None
    if not {'row', 'status', 'key'} <= set(frame.columns):
        raise ParameterError(f'{path} is not the table of a study; name another file')
    rows: list[Result] = frame.with_columns(pl.col(pl.String).fill_null('')).to_dicts()
    return rows
