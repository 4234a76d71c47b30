# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Trials: what was tried how often, and what went wrong, as rows of a CSV file and of a page.

A part of an attack is a module of this room with a function `trials(seconds, seed)`. It yields a
`Trial` for each subject it attacks and takes about the time it is given.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
import time
from typing import Protocol, TypeVar

from snake_sim_benchmarks.comparison.csv_tables import records_of, Table
from snake_sim_ros.scene.files import write_whole

Subject = TypeVar('Subject')


@dataclass(frozen=True)
class Trial:
    """
    What an attack on one subject came to.

    Attributes
    ----------
    part : str
        Module of this room that made it, such as 'files'.
    subject : str
        What was attacked, such as 'scene' or 'sim, 20 publishers'.
    unit : str
        What was counted, such as 'files', 'messages', 'steps'.
    tried : int
        How many of them.
    violations : int
        How many of them broke a promise.
    seconds : float
        Wall time of all of them.
    longest : float
        Longest time that one of them took, or that an answer took [s]; nan if it was not measured.
    memory : float
        Growth of the resident memory, or its peak where files are read [MB]; nan if it was not
        measured.
    figures : str
        Further figures in words, such as 'unconverged 0, penetration 4e-07 m'.
    first : str
        The first violation in one sentence, enough to try it again; empty if there is none.

    """

    part: str
    subject: str
    unit: str
    tried: int
    violations: int
    seconds: float
    longest: float = float('nan')
    memory: float = float('nan')
    figures: str = ''
    first: str = ''


COLUMNS = tuple(field.name for field in fields(Trial))


class Part(Protocol):
    """A module that attacks something."""

    def trials(self, seconds: float, seed: int) -> Iterator[Trial]:
        """Attack for about some seconds; the same seed tries the same things."""
        ...


def shares(subjects: Sequence[Subject], seconds: float) -> Iterator[tuple[Subject, float]]:
    """Yield each subject with its share of some seconds; what one leaves goes to later ones."""
    end = time.perf_counter() + seconds
    for k, subject in enumerate(subjects):
        yield subject, (end - time.perf_counter()) / (len(subjects) - k)


def page(rows: Iterable[Trial]) -> Iterator[str]:
    """Yield the lines of a Markdown table of trials."""
    yield '| part | subject | tried | violations | longest | memory | figures |'
    yield '|---|---|---|---|---|---|---|'
    for row in rows:
        longest = '' if row.longest != row.longest else f'{row.longest:.3g} s'
        memory = '' if row.memory != row.memory else f'{row.memory:.1f} MB'
        yield (
            f'| {row.part} | {row.subject} | {row.tried:,} {row.unit} | {row.violations} '
            f'| {longest} | {memory} | {row.figures} |'
        )


def draw_trials(table: Table, folder: Path) -> list[Path]:
    """Write the table of a CSV file of trials as Markdown, named after its kind; return it."""
    kind = table.header['table']
    path = folder / f'{kind}.md'
    write_whole(path, '\n'.join(page(records_of(table, kind, Trial))) + '\n')
    return [path]
