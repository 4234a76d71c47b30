# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
CSV files of measurements: a head that says what was measured where, then a row for each run.

A head consists of lines ``# name: value``, which readers of CSV skip with ``comment='#'``. A file
that is continued later gets another head above its new rows, so that nobody has a reason to edit a
head. Together with git, the head says where a file comes from.
"""

from collections.abc import Iterable, Mapping, Sequence
import csv
from dataclasses import asdict, dataclass, fields, MISSING
from datetime import datetime, timezone
from hashlib import sha256
import importlib.metadata
import io
import math
from pathlib import Path
import platform
import subprocess
from typing import Any

import snake_sim_ros
from snake_sim_ros import __version__, ParameterError
from snake_sim_ros.scene.files import write_whole

PACKAGE = Path(snake_sim_ros.__file__).parent
LABORATORY = Path(__file__).resolve().parents[1]
LIBRARIES = ('numpy', 'scipy', 'numba', 'mujoco-core', 'drake')
HEAD_OF_ALL_ROWS = ('table', 'processor', 'settings')  # equal in all heads
HEAD_OF_SOURCES = ('commit', 'sources')  # equal as well, unless other sources are allowed


def provenance(table: str) -> dict[str, str]:
    """Return the head of a measurement: kind of table, sources, processor, versions, date."""
    versions = {name: _version(name) for name in LIBRARIES}
    return {
        'table': table,
        'commit': _commit(),
        'sources': _sources(),
        'processor': _processor(),
        'python': platform.python_version(),
        **{name: version for name, version in versions.items() if version},
        'date': _now(),
    }


def _now() -> str:
    return datetime.now(timezone.utc).strftime('%Y-%m-%d %H:%M UTC')


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ''


def _commit() -> str:
    """Return the last commit of the sources, with a mark if they were changed, or the version."""
    sources = [str(PACKAGE), str((PACKAGE / 'config').resolve()), str(LABORATORY)]
    commit = _git('log', '-1', '--format=%h', '--abbrev=12', '--', *sources)
    if not commit:
        return f'version {__version__}'
    return commit + ' and changes' * bool(_git('status', '--porcelain', '--', *sources))


def _sources() -> str:
    """Return a digest of the sources, which also distinguishes changes since a commit."""
    digest = sha256()
    for folder in (PACKAGE, LABORATORY):
        for path in sorted([*folder.rglob('*.py'), *folder.glob('config/*')]):
            content = sha256(path.read_bytes()).hexdigest()
            digest.update(f'{path.relative_to(folder.parent)} {content}\n'.encode())
    return digest.hexdigest()[:12]


def _git(*arguments: str) -> str:
    command = ['git', '-C', str(PACKAGE), *arguments]
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
        Name -> value of the comment lines; all values in their order if heads differ.
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
        If there is no such file, or if it has no head or no columns.

    """
    lines, heads, _ = _read(path)
    names = list(dict.fromkeys(name for head in heads for name in head))
    header = {
        name: ' and '.join(dict.fromkeys(head[name] for head in heads if name in head))
        for name in names
    }
    reader = csv.DictReader(line for line in lines if not line.startswith('#'))
    return Table(header, [row for row in reader if None not in row.values() and None not in row])


def _read(path: Path) -> tuple[list[str], list[dict[str, str]], list[str]]:
    """Return the complete lines of a file, its heads, and its columns."""
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: not readable as CSV: {error}') from None
    lines = text.split('\n')[:-1]  # without a row that was cut short
    heads: list[dict[str, str]] = []
    for line in lines:
        if not line.startswith('#'):
            continue
        name, _, value = (part.strip() for part in line[1:].partition(':'))
        if name == 'table':
            heads.append({})
        if not heads:
            break
        heads[-1][name] = value
    if not heads:
        raise ParameterError(
            f'{path}: the first line must say what it is, such as "# table: bench"; '
            f'got {text.splitlines()[0][:60] if text else "an empty file"!r}'
        )
    columns = next((line for line in lines if not line.startswith('#')), '')
    if not columns:
        raise ParameterError(f'{path}: a line with the names of columns must follow the header')
    return lines, heads, columns.split(',')


def _text(lines: Iterable[str]) -> str:
    return ''.join(f'{line}\n' for line in lines)


def records_of(table: Table, kind: str, cls: type[Any]) -> list[Any]:
    """
    Return the rows of a table as records, with numbers for their texts.

    Parameters
    ----------
    table : Table
    kind : str
        Kind of table that the header must have.
    cls : type
        A dataclass with fields str, float, int, or one of these or None. A float that is empty
        is nan, if it cannot be None.

    Raises
    ------
    ParameterError
        If the table is of another kind or has other columns, or if a text is not a number. Columns
        for fields with a default may be missing, since older files do not have all of them.

    """
    if table.header.get('table') != kind:
        raise ParameterError(f'table must be {kind!r}, got {table.header.get("table")!r}')
    kinds = {item.name: item.type for item in fields(cls)}
    needed = {item.name for item in fields(cls) if item.default is MISSING}
    found = []
    for texts in table.rows:
        if not needed <= set(texts) <= set(kinds):
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
    """Return whether a value is written as an empty cell: None, or a float that is not finite."""
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def plain(record: Any) -> dict[str, Any]:
    """Return a dataclass as a row for `TableWriter.append`; empty values become None."""
    return {name: None if is_empty(value) else value for name, value in asdict(record).items()}


class TableWriter:
    """
    A CSV file that grows row by row; an existing file is continued.

    Parameters
    ----------
    path : Path
    table : str
        Kind of table, as in the head.
    columns : iterable of str
    settings : sequence of str, optional
        Settings that all rows share and that are in no column, such as ``['dt=0.001']``.
    other_sources : bool, optional
        Whether a file may be continued whose rows are of other sources. The new rows have a head
        of their own.

    Attributes
    ----------
    rows : list of dict
        The rows that the file had before, column -> text.

    Raises
    ------
    ParameterError
        If the folder does not exist, or the file holds rows of another kind, of other columns, of
        other sources, of another processor or other settings, or if it is no table. The file is
        then not changed.

    """

    def __init__(
        self,
        path: Path,
        table: str,
        columns: Iterable[str],
        settings: Sequence[str] = (),
        *,
        other_sources: bool = False,
    ) -> None:
        self.path, self.columns = path, list(columns)
        self.rows: list[dict[str, str]] = []
        header = provenance(table)
        if settings:
            header['settings'] = ' '.join(' '.join(settings).split())
        if not path.absolute().parent.is_dir():
            raise ParameterError(f'no folder {path.absolute().parent} for {path.name}')
        head = [f'# {name}: {value}' for name, value in header.items()]
        if not path.exists() or path.stat().st_size == 0:
            self._head = list[str]()
            write_whole(path, _text([*head, ','.join(self.columns)]))
            return
        self.rows = read_table(path).rows
        lines, heads, found = _read(path)
        for name in HEAD_OF_ALL_ROWS + HEAD_OF_SOURCES * (not other_sources):
            for old in (there.get(name, '') for there in heads):
                if old != header.get(name, ''):
                    raise ParameterError(
                        f'{path} holds rows of {name} {old!r}, these would be of '
                        f'{header.get(name, "")!r}: name another file, or remove that one'
                        + ', or go on with --other-sources'
                        * (name in HEAD_OF_SOURCES)
                    )
        if found != self.columns:
            raise ParameterError(
                f'{path} has other columns: name another file, or remove that one'
            )
        self._head = head  # written above the first new row
        write_whole(path, _text(lines))  # without a row that was cut short

    def append(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add rows; None is written as empty, floats so that reading gives the same numbers."""
        lines = [self._line(row) for row in rows]
        if lines:
            lines, self._head = [*self._head, *lines], []
        with self.path.open('a', encoding='utf-8', newline='') as file:
            file.write(_text(lines))

    def _line(self, row: Mapping[str, Any]) -> str:
        """Return a row as text; line breaks, which would end the row, become blanks."""
        text = io.StringIO()
        csv.DictWriter(text, self.columns, lineterminator='').writerow(row)
        return text.getvalue().replace('\r', ' ').replace('\n', ' ')
