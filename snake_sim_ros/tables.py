"""
CSV files of measurements: a header that says what was measured where, then one row per run.

The header is a few lines ``# name: value``; with ``comment='#'`` any reader of CSV skips them.
"""

from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
import csv
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import fields
from datetime import datetime
from datetime import timezone
import importlib.metadata
import math
from pathlib import Path
import platform
import subprocess
from typing import Any

from snake_sim_ros import __version__
from snake_sim_ros.records import ParameterError

LIBRARIES = ('numpy', 'scipy', 'numba', 'mujoco')
SAME = ('table', 'commit', 'processor', 'settings')  # of all rows of a file


def provenance(table: str) -> dict[str, str]:
    """Return what identifies a measurement: kind of table, commit, processor, versions, date."""
    versions = {name: _version(name) for name in LIBRARIES}
    return {
        'table': table,
        'commit': _commit(),
        'processor': _processor(),
        'python': platform.python_version(),
        **{name: version for name, version in versions.items() if version},
        'date': datetime.now(timezone.utc).strftime('%Y-%m-%d %H:%M UTC'),
    }


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ''


def _commit() -> str:
    """Return the last commit of the sources, marked if changed since; else the version."""
    package = Path(__file__).resolve().parent
    sources = [str(package), str((package / 'config').resolve())]
    commit = _git('log', '-1', '--format=%h', '--abbrev=12', '--', *sources)
    if not commit:
        return f'version {__version__}'
    return commit + ' and changes' * bool(_git('status', '--porcelain', '--', *sources))


def _git(*arguments: str) -> str:
    command = ['git', '-C', str(Path(__file__).resolve().parent), *arguments]
    try:
        finished = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return ''
    return finished.stdout.strip()


def _processor() -> str:
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(':')[2].strip() for line in text.splitlines() if 'model name' in line]
    return names[0] if names else platform.machine()


@dataclass(frozen=True)
class Table:
    """
    A CSV file.

    Attributes
    ----------
    header : dict
        Name -> value of the comment lines.
    rows : list of dict
        Column -> text.

    """

    header: dict[str, str]
    rows: list[dict[str, str]]


def read_table(path: Path) -> Table:
    """
    Read a file that TableWriter wrote.

    Raises
    ------
    ParameterError
        If there is no such file, or it has no header or no columns.

    """
    try:
        lines = path.read_text(encoding='utf-8').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: not readable as CSV: {error}') from None
    comments = [line[1:].partition(':') for line in lines if line.startswith('#')]
    header = {name.strip(): value.strip() for name, _, value in comments}
    if 'table' not in header:
        raise ParameterError(
            f'{path}: the first line must say what it is, such as "# table: bench"; '
            f'got {lines[0][:60] if lines else "an empty file"!r}'
        )
    reader = csv.DictReader(line for line in lines if not line.startswith('#'))
    if not reader.fieldnames:
        raise ParameterError(f'{path}: a line with the names of columns must follow the header')
    rows = [row for row in reader if None not in row.values() and None not in row]
    return Table(header, rows)


def records_of(table: Table, kind: str, cls: type[Any]) -> list[Any]:
    """
    Return the rows of a table as records, with numbers for their texts.

    Parameters
    ----------
    table : Table
    kind : str
        What the header must say that it is.
    cls : type
        A dataclass with fields str, float, int, or one of these or None. A float that is empty
        is nan, if it cannot be None.

    Raises
    ------
    ParameterError
        If the table is of another kind, or has other columns, or a number is none.

    """
    if table.header.get('table') != kind:
        raise ParameterError(f'table must be {kind!r}, got {table.header.get("table")!r}')
    kinds = {item.name: item.type for item in fields(cls)}
    found = []
    for texts in table.rows:
        if set(texts) != set(kinds):
            differ = ', '.join(sorted(set(kinds) ^ set(texts)))
            raise ParameterError(f'columns must be those of {kind}; these differ: {differ}')
        found.append(
            cls(**{name: _value(name, text, kinds[name]) for name, text in texts.items()})
        )
    return found


def _value(name: str, text: str, kind: Any) -> Any:
    if kind is str:
        return text
    if not text and kind is not int:
        return math.nan if kind is float else None
    try:
        return int(text) if kind in (int, int | None) else float(text)
    except ValueError:
        raise ParameterError(f'{name} must be a number, got {text!r}') from None


def is_empty(value: Any) -> bool:
    """Return whether a value is written as an empty cell: nothing, or no finite number."""
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def plain(record: Any) -> dict[str, Any]:
    """Return a dataclass as a row that `TableWriter.append` takes; what is_empty is None."""
    return {name: None if is_empty(value) else value for name, value in asdict(record).items()}


class TableWriter:
    """
    A CSV file that grows row by row; one that is there already is gone on with.

    Parameters
    ----------
    path : Path
    table : str
        Kind of table, as in the header.
    columns : iterable of str
    settings : sequence of str, optional
        What all rows have in common beside what is in their columns, such as ``['dt=0.001']``.

    Attributes
    ----------
    rows : list of dict
        Rows that the file had, column -> text.

    Raises
    ------
    ParameterError
        If the folder does not exist, or the file holds rows of another kind, of other columns, of
        another commit, processor or settings, or is no table at all: it is left as it is.

    """

    def __init__(
        self, path: Path, table: str, columns: Iterable[str], settings: Sequence[str] = ()
    ) -> None:
        self.path, self.columns = path, list(columns)
        self.rows: list[dict[str, str]] = []
        header = provenance(table)
        if settings:
            header['settings'] = ' '.join(' '.join(settings).split())
        if not path.absolute().parent.is_dir():
            raise ParameterError(f'no folder {path.absolute().parent} for {path.name}')
        if not path.exists() or path.stat().st_size == 0:
            lines = [f'# {name}: {value}\n' for name, value in header.items()]
            path.write_text(''.join(lines) + ','.join(self.columns) + '\n', encoding='utf-8')
            return
        there = read_table(path)
        for name in SAME:
            old, new = there.header.get(name, ''), header.get(name, '')
            if old != new:
                raise ParameterError(
                    f'{path} holds rows of {name} {old!r}, these would be of {new!r}: '
                    'name another file, or remove that one'
                )
        if there.rows and list(there.rows[0]) != self.columns:
            raise ParameterError(
                f'{path} has other columns: name another file, or remove that one'
            )
        _drop_a_row_cut_short(path)
        self.rows = read_table(path).rows

    def append(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add rows; None is empty, a float is written so that reading gives the same number."""
        with self.path.open('a', encoding='utf-8', newline='') as file:
            writer = csv.DictWriter(file, self.columns, lineterminator='\n')
            writer.writerows(rows)


def _drop_a_row_cut_short(path: Path) -> None:
    """End a file after its last whole line, if writing was interrupted in one."""
    text = path.read_text(encoding='utf-8')
    whole = text[: text.rfind('\n') + 1]
    if whole != text:
        path.write_text(whole, encoding='utf-8')
