"""
Seals of CSV files: they tell what the program wrote from what somebody changed.

Every head ends with a seal, a line ``# seal: ...``, and every row with one, in its last column.
A seal is a digest of the lines since the seal before it, and of that seal. So a line that is
changed, added, moved or taken out does not fit, nor does anything after it. Rows that miss at the
end are no such thing: the writing may have been interrupted. Seals are no signatures: they show
what was done by hand, not what a program forges.
"""

from collections.abc import Iterator
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from hashlib import sha256

from snake_sim_ros.scene.checked_records import ParameterError

SEAL = 'seal'  # name of the column, and of the last line of a head
MARK = f'# {SEAL}: '
LENGTH = 12  # hexadecimal digits


@dataclass
class Chain:
    """
    What the next seal depends on.

    Attributes
    ----------
    last : str
        The seal before; empty at the start of a file.
    lines : list of str
        Lines since then, without their ends.

    """

    last: str = ''
    lines: list[str] = field(default_factory=list)

    def seal(self, line: str) -> str:
        """Add a line, and return the seal of it and of those since the last seal."""
        text = '\n'.join([self.last, *self.lines, line])
        self.last, self.lines = sha256(text.encode()).hexdigest()[:LENGTH], []
        return self.last

    def head(self, lines: Sequence[str]) -> Iterator[str]:
        """Yield a head with its seal: lines that begin with #."""
        yield from lines
        self.lines += lines
        yield MARK + self.seal('')

    def columns(self, line: str) -> str:
        """Return the line with the names of columns, which the first row seals."""
        self.lines.append(f'{line},{SEAL}')
        return self.lines[-1]

    def row(self, line: str) -> str:
        """Return a row with its seal."""
        return f'{line},{self.seal(line)}'


def check(lines: Sequence[str]) -> Chain:
    """
    Check all seals of a file, and return what the next one depends on.

    Parameters
    ----------
    lines : sequence of str
        All of a file, without their ends.

    Raises
    ------
    ParameterError
        If a seal does not fit, or none follows a comment; it has the number of the line.

    """
    chain, columns = Chain(), False
    for number, line in enumerate(lines, 1):
        if line.startswith(MARK):
            good = line == MARK + chain.seal('')
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
    """Return the lines of a file without seals, whether they fit or not; any file will do."""
    kept = [line for line in lines if not line.startswith(MARK)]
    columns = next((line for line in kept if not line.startswith('#')), '')
    if columns.rpartition(',')[2] != SEAL:
        return kept
    return [line if line.startswith('#') else line.rpartition(',')[0] for line in kept]


def sealed(lines: Sequence[str]) -> list[str]:
    """Return the lines of a file without seals with seals."""
    chain, found, head, columns = Chain(), list[str](), list[str](), False
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
