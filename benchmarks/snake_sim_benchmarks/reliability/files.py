# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hostile files: whatever a file holds, it is read, or refused in one sentence, soon and with little.

Files of every kind that commands and nodes read are changed at random, byte by byte and value by
value; see `mutations`. The changes come from `random` with a seed, not from a coverage-guided
fuzzer: readers are slow compared with the noting of branches, and a number names each file again.
"""

from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
import time
from types import TracebackType

from snake_sim_benchmarks.reliability.file_corpus import Change, corpus
from snake_sim_benchmarks.reliability.file_readers import Answer, READERS, serve
from snake_sim_benchmarks.reliability.trials import Trial

LONGEST = 5.0  # time of the processor that a file may take [s]
PATIENCE = 60.0  # wall time after which a reader counts as hanging, on a busy machine [s]
MOST_MEMORY = 500.0  # by which a reader may grow [MB]
# Shares of the time: nodes take long to make, and their files are parsed by ROS.
SHARES = {'parameters.yaml': 0.5, 'study.journal': 0.3, 'table.csv': 0.5, 'scene.yaml': 2.0}


class Reader:
    """
    A process that reads files, and a new one in its place when it is exhausted.

    Use it as a context.

    Parameters
    ----------
    name : str
        Name of the files, a key of READERS.
    folder : Path
        Where a good one is, from which it learns how much memory is usual.

    """

    def __init__(self, name: str, folder: Path) -> None:
        self.path = folder / name
        self._good = self.path.read_bytes()
        self._begin()

    def _begin(self) -> None:
        context = get_context('spawn')
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self._usual = 0.0
        answer = self._answer(self._good)
        if not answer.was_read:
            raise AssertionError(f'{self.path.name} is to be read, got {answer}')
        self._usual = answer.memory

    def answer(self, content: bytes) -> Answer:
        """Return what comes of a file, with the growth of the memory in place of its peak."""
        answer = self._answer(content)
        if not answer.wrong and answer.seconds > LONGEST:
            answer = answer._replace(wrong=f'it took {answer.seconds:.1f} s')
        if not answer.wrong and answer.memory > MOST_MEMORY:
            answer = answer._replace(wrong=f'it took {answer.memory:.0f} MB')
        if not self._process.is_alive() or answer.memory > MOST_MEMORY / 2:
            self._end()
            self._begin()
        return answer

    def _answer(self, content: bytes) -> Answer:
        self.path.write_bytes(content)
        begin = time.perf_counter()
        try:
            self._connection.send(str(self.path))
            if self._connection.poll(PATIENCE):
                answer: Answer = self._connection.recv()
                return answer._replace(memory=answer.memory - self._usual)
            wrong = f'no answer for {PATIENCE:g} s'
        except (EOFError, ConnectionError):
            self._process.join()
            wrong = f'the reader died with exit code {self._process.exitcode}'
        self._end()
        return Answer(wrong, False, time.perf_counter() - begin, 0.0)

    def _end(self) -> None:
        self._process.kill()
        self._process.join()
        self._connection.close()

    def __enter__(self) -> 'Reader':
        """Return the reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process."""
        self._end()


def content_of(name: str, seed: int, number: int, changes: list[Change]) -> bytes:
    """Return the content of a hostile file, which its name, a seed and a number determine."""
    random = Random(f'{name} {seed} {number}')
    return random.choice(changes)(random)


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Yield a trial for each kind of files; see `trials.Part`."""
    with TemporaryDirectory() as folder:
        found = corpus(Path(folder))
        whole = sum(SHARES.get(name, 1.0) for name in READERS)
        for name in READERS:
            share = seconds * SHARES.get(name, 1.0) / whole
            yield _trial(name, Path(folder), share, seed, found[name])


def _trial(name: str, folder: Path, seconds: float, seed: int, changes: list[Change]) -> Trial:
    """Return the trial of the files of a kind that were read in some time."""
    tried = violations = was_read = 0
    longest, memory, first = 0.0, 0.0, ''
    with Reader(name, folder) as reader:
        begin = time.perf_counter()
        while not tried or time.perf_counter() - begin < seconds:
            answer = reader.answer(content_of(name, seed, tried, changes))
            if answer.wrong:
                violations += 1
                first = first or f'{name}, seed {seed}, number {tried}: {answer.wrong}'
            tried, was_read = tried + 1, was_read + answer.was_read
            longest, memory = max(longest, answer.seconds), max(memory, answer.memory)
        passed = time.perf_counter() - begin
    return Trial(
        part='files',
        subject=name,
        unit='files',
        tried=tried,
        violations=violations,
        seconds=passed,
        longest=longest,
        memory=memory,
        figures=f'{was_read} usable, all others refused in a sentence'
        if not violations
        else f'{was_read} usable',
        first=first,
    )
