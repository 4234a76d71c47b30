# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The journal of a study: rows as they are done, a line of JSON each, until the table is written.

A chunk of rows is one write to the end of the file. Whatever kills the process, the rows before
are whole; a line that is not is left out.
"""

from collections.abc import Sequence
import fcntl
import json
from pathlib import Path
from typing import Any

from snake_sim_ros.scene.checked_records import ParameterError


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
                f'{path} is written by another study now; name another file with --out'
            ) from None

    def rows(self) -> list[dict[str, Any]]:
        """Return all whole rows; a line that a killed process left is ended."""
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

    def add(self, rows: Sequence[dict[str, Any]]) -> None:
        """Add rows, all by one write."""
        self._append(''.join(f'{json.dumps(row)}\n' for row in rows).encode())

    def _append(self, content: bytes) -> None:
        self.file.write(content)
        self.file.flush()

    def close(self, *, remove: bool) -> None:
        """Give the journal free, and remove it if its rows are in the table."""
        if remove:
            self.path.unlink(missing_ok=True)
        self.file.close()
