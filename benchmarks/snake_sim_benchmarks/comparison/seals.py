# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Seals of CSV files, which distinguish the text of the program from changes by hand.

Every head ends with a seal, a line ``# seal: ...``, and every row has a seal in its last column. A
seal is a digest of the lines since the previous seal, and of that seal. If a line is changed,
added, moved or removed, its seal and all later seals do not fit. Rows that are missing at the end
are not detected, since writing may have been interrupted. Seals are not signatures: they show
changes by hand, but not the forgery of a program.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from hashlib import sha256

from snake_sim_ros.scene.checked_records import ParameterError

SEAL_NAME = 'seal'  # name of the column, and of the last line of a head
SEAL_LINE = f'# {SEAL_NAME}: '
SEAL_LENGTH = 12  # hexadecimal digits


@dataclass
class SealChain:
    """
    The text on which the next seal depends.

    Attributes
    ----------
    last : str
        The previous seal; empty at the start of a file.
    lines : list of str
        Lines since that seal, without line ends.

    """

    last: str = ''
    lines: list[str] = field(default_factory=list)

    def seal(self, line: str) -> str:
        """Add a line, and return the seal of all lines since the previous seal."""
        text = '\n'.join([self.last, *self.lines, line])
        self.last, self.lines = sha256(text.encode()).hexdigest()[:SEAL_LENGTH], []
        return self.last

    def head(self, lines: Sequence[str]) -> Iterator[str]:
        """Yield the lines of a head, which begin with #, and its seal."""
        yield from lines
        self.lines += lines
        yield SEAL_LINE + self.seal('')

    def columns(self, line: str) -> str:
        """Return the line with the names of columns, which the first row seals."""
        self.lines.append(f'{line},{SEAL_NAME}')
        return self.lines[-1]

    def row(self, line: str) -> str:
        """Return a row with its seal."""
        return f'{line},{self.seal(line)}'


def check(lines: Sequence[str]) -> SealChain:
    """
    Check all seals of a file, and return the chain for its next seal.

    Parameters
    ----------
    lines : sequence of str
        All lines of a file, without line ends.

    Raises
    ------
    ParameterError
        If a seal does not fit, or if comments have no seal. The message has the line number.

    """
    chain, columns = SealChain(), False
    for number, line in enumerate(lines, 1):
        if line.startswith(SEAL_LINE):
            good = line == SEAL_LINE + chain.seal('')
        elif line.startswith('#') or not columns:
            columns |= not line.startswith('#')
            chain.lines.append(line)
            continue
        else:
            good = line == chain.row(line.rpartition(',')[0])
        if not good:
            raise ParameterError(_sentence(number))
    if any(line.startswith('#') for line in chain.lines):
        raise ParameterError(_sentence(len(lines)))
    return chain


def _sentence(number: int) -> str:
    return (
        f'the seal of line {number} does not fit: this line, or one since the seal before it, was '
        'changed, added or taken out by hand; measure anew, or mark the file as one of unknown '
        'provenance with snake-sim seal'
    )


def unsealed(lines: Sequence[str]) -> list[str]:
    """Return the lines of any file without seals, whether these fit or not."""
    kept = [line for line in lines if not line.startswith(SEAL_LINE)]
    columns = next((line for line in kept if not line.startswith('#')), '')
    if columns.rpartition(',')[2] != SEAL_NAME:
        return kept
    return [line if line.startswith('#') else line.rpartition(',')[0] for line in kept]


def sealed(lines: Sequence[str]) -> list[str]:
    """Return the lines of a file that has no seals, with seals."""
    chain, found, head, columns = SealChain(), list[str](), list[str](), False
    for line in lines:
        if line.startswith('#'):
            head.append(line)
            continue
        if head:
            found += chain.head(head)
            head = []
        found.append(chain.row(line) if columns else chain.columns(line))
        columns = True
    return found
