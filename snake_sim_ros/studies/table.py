# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The table of a study as a file: Parquet, or CSV for other programs.

polars writes and reads both, sorts and selects, and needs no other package; a table is one of its
data frames.
"""

from collections.abc import Mapping, Sequence
from io import BytesIO
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import write_whole

if TYPE_CHECKING:
    import polars

SUFFIXES = ('.parquet', '.csv')
# Columns that are neither values nor metrics, and their types.
OWN = {
    'row': 'Int64', 'status': 'String', 'failure': 'String', 'unconverged': 'Int64',
    'seconds': 'Float64', 'key': 'String', 'trajectory': 'String',
}  # fmt: skip


def library() -> Any:
    """
    Return polars.

    Raises
    ------
    ParameterError
        If it is not installed.

    """
    try:
        import polars
    except ImportError as error:
        raise ParameterError(
            f"studies need polars ({error}): pip install 'snake_sim_ros[studies]'"
        ) from None
    return polars


def check_path(path: Path) -> None:
    """Raise an error unless a table can be written to a path."""
    if path.suffix not in SUFFIXES:
        raise ParameterError(f'--out must end in {" or ".join(SUFFIXES)}, got {path}')
    if not path.absolute().parent.is_dir():
        raise ParameterError(f'--out: no folder {path.absolute().parent}')
    library()


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


def read(path: Path, metrics: Sequence[str]) -> list[dict[str, Any]]:
    """
    Return the rows of a table that `write` wrote.

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
    rows: list[dict[str, Any]] = frame.with_columns(pl.col(pl.String).fill_null('')).to_dicts()
    return rows
