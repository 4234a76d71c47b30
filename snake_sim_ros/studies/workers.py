# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Who does the runs of a study: threads of this process, other processes, or a Dask cluster.

All of them are executors of `concurrent.futures`. Compiled code releases the GIL: threads run in
parallel, and share one compiler and its code.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    CancelledError,
    Executor,
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
import math
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from typing import Any, ClassVar, TypeVar

from snake_sim_ros.dynamics.code_cache import Shelf
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.studies.runs import (
    empty_result,
    known_result,
    never,
    Plan,
    Row,
    run_chunk,
    run_of,
)
from snake_sim_ros.studies.table import note, optional, Result, Run

CHUNK_SECONDS = 1.0  # time that a chunk of runs is to take
GROWTH = 4  # a chunk has at most so many times the runs of the one before
WAITING = 2  # chunks for each worker, one under way and one that waits
LOCAL = 'local'  # in place of the address of a scheduler: a cluster on this machine
CONNECT_SECONDS = 20  # for which the scheduler may not answer
WORKER_SECONDS = 5  # for which a cluster may have no worker
GONE = 'the scheduler has gone; the rows that are done are kept: start the study again'
PoolT = TypeVar('PoolT', bound=Executor)


@dataclass(frozen=True)
class Workers:
    """
    Workers that take chunks of runs.

    Attributes
    ----------
    submit : callable
        ``submit(plan, rows)`` returns the future of `run_chunk`.
    capacity : callable
        Returns the number of runs at a time.
    deaths : tuple of type
        Errors that say that a run killed its workers, again and again.

    """

    submit: Callable[[Plan, Sequence[Row]], 'Future[list[Result]]']
    capacity: Callable[[], int]
    deaths: tuple[type[BaseException], ...] = ()


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def closing_pool(pool: PoolT, stop: Callable[[], object] = never) -> Iterator[PoolT]:
    """Give an executor, and end it; after an error or an interruption at once, by `stop`."""
    try:
        yield pool
    except BaseException:
        stop()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def threads(count: int | None = None) -> Iterator[Workers]:
    """Run in threads of this process, as many as there are cores if no number is given."""
    number, stop = count or core_count(), threading.Event()
    with closing_pool(ThreadPoolExecutor(number), stop.set) as pool:
        yield Workers(lambda plan, rows: pool.submit(run_chunk, plan, rows, stop.is_set),
                      lambda: number)  # fmt: skip


@contextmanager
def processes(count: int | None = None) -> Iterator[Workers]:
    """Run in processes of this machine, as many as there are cores if no number is given."""
    number = count or core_count()
    # New interpreters: a process that was copied from one with threads may wait for ever.
    context = multiprocessing.get_context('spawn')
    stop = context.Event()
    pool = ProcessPoolExecutor(number, context, _prepare_process, (list(sys.path), stop))
    with closing_pool(pool, stop.set):
        yield Workers(lambda plan, rows: pool.submit(run_in_process, plan, rows), lambda: number)


@contextmanager
def cluster(address: str, count: int | None = None) -> Iterator[Workers]:
    """
    Run on a Dask cluster.

    Parameters
    ----------
    address : str
        Of the scheduler, such as 'tcp://10.0.0.1:8786', or LOCAL for processes of this machine.
    count : int, optional
        Number of processes of LOCAL, default: that of the cores.

    Raises
    ------
    ParameterError
        If Dask is not installed, no scheduler answers, or there is no worker for WORKER_SECONDS.

    """
    distributed = optional('distributed', 'a cluster needs Dask')
    deaths = (distributed.scheduler.KilledWorker,)
    local = None
    if address == LOCAL:
        local = distributed.LocalCluster(
            n_workers=count or core_count(), threads_per_worker=1, dashboard_address=None
        )
    try:
        client = distributed.Client(local or address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        raise ParameterError(
            f'no Dask scheduler answers at {address}: {error}; start one with dask scheduler'
        ) from None
    pool = client.get_executor(pure=False)

    def submit(plan: Plan, rows: Sequence[Row]) -> 'Future[list[Result]]':
        future: Future[list[Result]] = pool.submit(
            run_on_cluster, distributed.protocol.pickle.dumps(plan), rows
        )
        return future

    def capacity() -> int:
        try:
            client.wait_for_workers(1, timeout=WORKER_SECONDS)
            return max(1, sum(map(int, client.nthreads().values())))
        except TimeoutError:
            raise ParameterError(
                f'the Dask cluster at {address} has had no worker for {WORKER_SECONDS} s: start '
                f'one with dask worker {address}'
            ) from None
        except (OSError, ValueError):  # ValueError: the client has closed itself
            raise ParameterError(GONE) from None

    try:
        yield Workers(submit, capacity, deaths)
    finally:
        client.close()
        if local:
            local.close()


def run_on_cluster(plan: bytes, rows: Sequence[Row]) -> list[Result]:
    """
    Return the results of a chunk; workers of one machine compile for each other.

    The plan is pickled: a module that is missing is an error of this call, not of the connection.
    """
    Shelf.shares_work = True
    return run_chunk(pickle.loads(plan), rows)


class _Process:
    """What a process of `processes` was given at its start."""

    stopped: ClassVar[Callable[[], bool]] = staticmethod(never)


def _prepare_process(path: list[str], stop: Any) -> None:
    """Leave Ctrl-C to the process that started this one, whose modules this one finds."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.path[:] = path
    Shelf.shares_work = True
    _Process.stopped = stop.is_set


def run_in_process(plan: Plan, rows: Sequence[Row]) -> list[Result]:
    """Return the results of a chunk, in a process of `processes`."""
    return run_chunk(plan, rows, _Process.stopped)


def results_of(
    plan: Plan,
    rows: Iterable[Row],
    workers: Workers,
    known: dict[str, Run],
    keep: Callable[[Sequence[Run]], object],
) -> Iterator[tuple[list[Result], bool]]:
    """
    Yield the results of rows in chunks, and whether they were run now: first those that are known.

    Parameters
    ----------
    plan : Plan
    rows : iterable of Row
    workers : Workers
    known : dict
        Runs by their keys, which are not done again; what is run is added.
    keep : callable
        Called with new runs; what was refused at once has none.

    Raises
    ------
    ParameterError
        If the workers are gone, or cannot run the plan.

    """
    found, missing = list[Result](), list[Row]()
    for row in rows:
        result = known_result(plan, row, known) if known else None
        if result:
            found.append(result)
        else:
            missing.append(row)
    yield found, False
    for chunk in _run(plan, missing, workers):
        runs = [run_of(plan, result) for result in chunk if result['key']]
        keep(runs)
        note(known, runs)
        yield chunk, True


def _run(plan: Plan, rows: Sequence[Row], workers: Workers) -> Iterator[list[Result]]:
    """Yield the results of rows in chunks that take CHUNK_SECONDS, as they are done."""
    waiting: dict[Future[list[Result]], Sequence[Row]] = {}
    begun, size = 0, 1
    while begun < len(rows) or waiting:
        count = workers.capacity()
        while begun < len(rows) and len(waiting) < WAITING * count:
            size = min(size, math.ceil((len(rows) - begun) / (WAITING * count)))
            chunk = rows[begun : begun + size]
            waiting[workers.submit(plan, chunk)] = chunk
            begun += size
        # Now and then it is looked whether there are workers.
        for future in wait(waiting, WORKER_SECONDS, FIRST_COMPLETED).done:
            chunk = waiting.pop(future)
            results = _result(future, plan, chunk, workers)
            seconds = sum(result['seconds'] for result in results)
            fitting = int(CHUNK_SECONDS * len(results) / max(seconds, 1e-9))
            size = max(1, min(GROWTH * max(size, len(results)), fitting))
            yield results


def _result(
    future: 'Future[list[Result]]', plan: Plan, rows: Sequence[Row], workers: Workers
) -> list[Result]:
    """Return the results of a chunk, or rows that say that its workers died."""
    try:
        return future.result()
    except workers.deaths as error:
        failure = {'failure': f'workers died in this chunk of runs: {error}'}
        return [empty_result(plan, row) | failure for row in rows]
    except BrokenProcessPool:
        raise ParameterError(
            'a process of the study was killed; the rows that are done are kept: start it again'
        ) from None
    except CancelledError:
        raise ParameterError(GONE) from None
    except ModuleNotFoundError as error:
        raise ParameterError(
            f'a worker of the cluster has no module {error.name}, which a metric of the study '
            f'needs: name its folder in PYTHONPATH of all workers'
        ) from None
