# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The table of a study or an optimization as a file, and the journal of all runs for it.

A table is a polars data frame, written as Parquet, or as CSV for other programs, and never read
again. The journal beside it has runs as they are done, a line of JSON each, whatever table asked
for them. A chunk of runs is one write to its end: whatever kills the process, the runs before are
whole, and a line that is not is left out.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
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

Result = dict[str, Any]  # of a row, by the names of its columns
Run = dict[str, Any]  # a line of the journal: KEPT, and its metrics by their identities
# Columns of a row that are those of its run, besides its metrics, and their types.
KEPT = {'status': str, 'failure': str, 'unconverged': int, 'seconds': float, 'key': str}
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

    def runs(self) -> list[Run]:
        """Return all whole runs; a line that a killed process left unfinished is ended."""
        self.file.seek(0)
        content, runs = self.file.read(), []
        for line in content.splitlines():
            try:
                run = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if _is_run(run):
                runs.append(run)
        if content and not content.endswith(b'\n'):
            self._append(b'\n')
        return runs

    def add(self, runs: Sequence[Run]) -> None:
        """Add runs, all by one write."""
        self._append(''.join(f'{json.dumps(run)}\n' for run in runs).encode())

    def _append(self, content: bytes) -> None:
        self.file.write(content)
        self.file.flush()

    def close(self) -> None:
        """Release the journal."""
        self.file.close()


def _is_run(run: Any) -> bool:
    """Return whether a line of a journal, which may be any JSON, is a run."""
    types = {**KEPT, 'metrics': dict}
    return (
        isinstance(run, dict)
        and all(type(run.get(name)) is kind for name, kind in types.items())
        and all(type(number) is float for number in run['metrics'].values())
    )


def note(known: dict[str, Run], runs: Sequence[Run]) -> None:
    """Add runs to those that are known by their keys; metrics that are known stay."""
    for run in runs:
        old = known[run['key']]['metrics'] if run['key'] in known else {}
        known[run['key']] = run | {'metrics': old | run['metrics']}


@contextmanager
def stored(
    out: Path | None,
    what: str,
    columns: Set[str],
    table: Callable[[], 'polars.DataFrame | None'],
) -> Iterator[tuple[dict[str, Run], Callable[[Sequence[Run]], object]]]:
    """
    Give the runs that are done by their keys, and what keeps more; write the table at the end.

    Parameters
    ----------
    out : Path or None
        The file of the table, if any.
    what, columns : str, container of str
        What the table is, and columns that tell it from others, whose files are not written over.
    table : callable
        Returns the table as the context ends, in whatever way; None if there is nothing to write.

    """
    library()
    if not out:
        yield {}, lambda runs: None
        return
    check_file(out, '--out')
    if out.exists():
        _check_table(out, what, columns)
    journal, known = Journal(journal_of(out)), dict[str, Run]()
    try:
        note(known, journal.runs())
        try:
            yield known, journal.add
        finally:
            frame = table()
            if frame is not None:
                write(frame, out)
    finally:
        journal.close()


def _check_table(path: Path, what: str, columns: Set[str]) -> None:
    """Raise an error if a file is no such table, or has no journal from which it is made anew."""
    pl = library()
    scan = pl.scan_csv if path.suffix == '.csv' else pl.scan_parquet
    try:
        found = scan(path).collect_schema().names()
    except Exception:  # polars raises errors of its own and of the system
        found = []
    if not set(columns) <= set(found):
        raise ParameterError(f'{path} is not {what}; name another file with --out')
    if not journal_of(path).exists():
        raise ParameterError(
            f'{path} would be written over, and its runs are lost: there is no '
            f'{journal_of(path).name} beside it; delete it, or name another file with --out'
        )


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
