# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""All runs of a study, and its table."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, TYPE_CHECKING

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.studies import table
from snake_sim_ros.studies.journal import Journal, journal_of
from snake_sim_ros.studies.metrics import USUAL_METRICS
from snake_sim_ros.studies.runs import (
    empty_result,
    FINAL,
    key_of_run,
    Plan,
    Row,
    scene_of,
    trajectory_file,
)
from snake_sim_ros.studies.study_file import Study, study_from
from snake_sim_ros.studies.workers import results_of, threads, Workers

if TYPE_CHECKING:
    import polars

Result = dict[str, Any]
Observe = Callable[[Sequence[Result], bool], object]
# Columns of a row that is not run again, besides its metrics.
KEPT = ('status', 'failure', 'unconverged', 'seconds', 'key')


def study(
    scene: Scene | str | Path,
    vary: Mapping[str, Any],
    metrics: Sequence[str | Callable[..., Any]] = USUAL_METRICS,
    *,
    out: str | Path | None = None,
    trajectories: str | Path | None = None,
    workers: AbstractContextManager[Workers] | None = None,
    observe: Observe | None = None,
    **settings: Any,
) -> 'polars.DataFrame':
    """
    Run a scene with many values, and return what is measured.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, a YAML file, or the name of one in config/.
    vary : mapping
        Dotted names of values of the scene to lists, ranges or distributions; see docs/studies.md.
    metrics : sequence, optional
        Names of `metrics.METRICS`, and functions of a `Trajectory`.
    out : str or Path, optional
        Parquet or CSV file of the table. Rows that it has already are not run again.
    trajectories : str or Path, optional
        Folder for an npz file of every run.
    workers : context manager of Workers, optional
        ``workers.threads(2)``, ``workers.processes(2)`` or ``workers.cluster(address)``. Default:
        threads on all cores.
    observe : callable, optional
        ``observe(results, is_new)`` is called with rows as they are done: their columns by name,
        and whether they were run now, not found in the file.
    **settings
        `set`, `sampling`, `samples`, `seed`, `rate`, as in the file of a study.

    Returns
    -------
    polars.DataFrame
        A row for each run, in the order of the rows.

    Raises
    ------
    ParameterError
        If anything given is not usable.

    """
    given = study_from({'scene': scene, 'vary': vary, 'metrics': metrics, **settings})
    return run_study(
        given, Path(out) if out else None, Path(trajectories) if trajectories else None,
        workers, observe,
    )  # fmt: skip


def run_study(
    given: Study,
    out: Path | None = None,
    folder: Path | None = None,
    workers: AbstractContextManager[Workers] | None = None,
    observe: Observe | None = None,
) -> 'polars.DataFrame':
    """
    Do the runs of a study that are not done, and return its table; see `study`.

    After an interruption or an error the rows that are done are in the file.
    """
    table.library()
    plan, names, results = (
        given.plan(folder),
        [item.name for item in given.metrics],
        list[Result](),
    )
    with _store(out, names, results) as (known, keep):
        missing: list[Row] = []
        for row in given.rows():
            result = known_result(plan, row, known) if known else None
            if result:
                results.append(result)
            else:
                missing.append(row)
        if observe:
            observe(results, False)
        with workers or threads() as pool:
            for chunk in results_of(plan, missing, pool):
                keep(chunk)
                results += chunk
                if observe:
                    observe(chunk, True)
    return table.frame_of(results, names)


@contextmanager
def _store(
    out: Path | None, names: Sequence[str], results: Sequence[Result]
) -> Iterator[tuple[Mapping[str, Result], Callable[[Sequence[Result]], object]]]:
    """
    Give the rows of a file by their keys, and what keeps more of them; write the table at the end.

    Parameters
    ----------
    out : Path or None
        The file, if any.
    names : sequence of str
        Names of the metrics.
    results : sequence of dict
        The rows for the table, complete when the context ends.

    """
    if not out:
        yield {}, lambda chunk: None
        return
    table.check_path(out)
    journal, is_written = Journal(journal_of(out)), False
    try:
        found = table.read(out, names) if out.exists() else []
        known = {row['key']: row for row in [*found, *journal.rows()]}
        try:
            yield known, journal.add
        finally:
            if results:
                table.write(table.frame_of(results, names), out)
                is_written = True
    finally:
        journal.close(remove=is_written)


def known_result(plan: Plan, row: Row, known: Mapping[str, Result]) -> Result | None:
    """Return the result of a row that is done already, or None."""
    try:
        key = key_of_run(plan, scene_of(plan, row.values))
    except ParameterError:
        return None
    old, names = known.get(key), [metric.name for metric in plan.metrics]
    if old is None or old['status'] not in FINAL or not set(names) <= old.keys():
        return None
    result = empty_result(plan, row)
    if path := trajectory_file(plan, key):
        if not path.is_file():
            return None
        result['trajectory'] = path.name
    return result | {name: old[name] for name in (*names, *KEPT)}
