# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A study: a scene, what varies in it, what is measured; as a record, as a file, and its runs.

What its file has in common with that of an optimization is read here for both.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TYPE_CHECKING, TypeVar

from snake_sim_ros.scene.checked_records import (
    CheckedRecord,
    from_mapping,
    nearest,
    ParameterError,
    quantity,
    quoted,
)
from snake_sim_ros.scene.files import CONFIG, is_file, read_yaml
from snake_sim_ros.scene.parameters import load_scene, Scene, with_settings
from snake_sim_ros.studies import table
from snake_sim_ros.studies.expressions import Expression, expression_of
from snake_sim_ros.studies.metrics import Metric, metrics_of, USUAL_METRICS
from snake_sim_ros.studies.runs import Plan, Row
from snake_sim_ros.studies.table import Result
from snake_sim_ros.studies.variations import (
    check_names,
    is_number,
    Listed,
    SAMPLINGS,
    variation_of,
    Variations,
)
from snake_sim_ros.studies.workers import results_of, threads, Workers

if TYPE_CHECKING:
    import polars

KEEP = ('metrics', 'trajectories')
STUDY_KEYS = ('scene', 'set', 'vary', 'follow', 'metrics')  # of a study, besides its settings
TABLE_COLUMNS = {'row', 'status', 'key'}  # besides values and metrics
Observe = Callable[[Sequence[Result], bool], object]
T = TypeVar('T')


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """The values of studies and optimizations that are one number."""

    seed: int = quantity(0, '1', 'seed of all random numbers', minimum=0)
    rate: float = quantity(
        20.0, 'Hz', 'samples per second from which metrics are computed', above=0
    )
    time_limit: float = quantity(
        0.0, 's', 'wall time after which a run is ended (0 = unlimited)', minimum=0
    )


@dataclass(frozen=True, kw_only=True)
class StudySettings(Settings):
    """The values of a study that are one number or one word."""

    sampling: str = quantity('grid', '', 'how values are combined into rows', choices=SAMPLINGS)
    samples: int = quantity(0, '1', 'number of rows that are drawn', minimum=0, maximum=10**7)
    keep: str = quantity('metrics', '', 'what is kept of a run', choices=KEEP)


@dataclass(frozen=True)
class Study:
    """
    A study.

    Attributes
    ----------
    scene : Scene
        With the values that are set.
    given : frozenset of str
        Names of the values that are set, vary or follow.
    variations : Variations
    follow : dict
        Dotted name of a value -> its expression of those that vary.
    metrics : tuple of Metric
    settings : StudySettings

    """

    scene: Scene
    given: frozenset[str]
    variations: Variations
    follow: Mapping[str, Expression]
    metrics: tuple[Metric, ...]
    settings: StudySettings

    def plan(self, folder: Path | None = None) -> Plan:
        """Return what all runs have in common; trajectories are kept in a folder, if any."""
        settings = self.settings
        return Plan(
            self.scene, self.given, self.metrics, settings.rate, folder, settings.time_limit
        )  # fmt: skip

    def rows(self) -> Iterator[Row]:
        """Yield all rows."""
        for number in range(len(self.variations)):
            yield Row(number, with_followers(self.variations.row(number), self.follow))


def load_study(path: Path) -> Study:
    """
    Read a study from a YAML file.

    Parameters
    ----------
    path : Path
        Its scene and the modules of its metrics are searched in the same folder first.

    Raises
    ------
    ParameterError
        If the file is missing, or if anything in it is not usable.

    """
    return loaded(path, study_from)


def loaded(path: Path, make: Callable[[Any, Path], T]) -> T:
    """
    Return what is made of the contents of a YAML file and its folder; errors name the file.

    Raises
    ------
    ParameterError
        If the file is missing or not readable, or if `make` raises it.

    """
    mapping = read_yaml(path)
    try:
        return make(mapping, path.absolute().parent)
    except ParameterError as error:
        raise ParameterError(f'{path.name}: {error}') from None


def study_from(mapping: Any, folder: Path | None = None) -> Study:
    """
    Return a study from what its file says.

    Parameters
    ----------
    mapping : mapping
        ``scene``, ``vary``, and what else docs/studies.md lists.
    folder : Path, optional
        Where its scene and modules are searched first.

    Raises
    ------
    ParameterError
        If anything in it is not usable.

    """
    settings = settings_of(StudySettings, mapping, STUDY_KEYS)
    scene, fixed, vary = scene_and_values(mapping, folder)
    variations = Variations(
        {name: variation_of(name, given) for name, given in vary.items()},
        settings.sampling, settings.samples, settings.seed,
    )  # fmt: skip
    follow = followers_of(mapping, vary, fixed, scene)
    for name, item in follow.items():
        for other in sorted(item.names):
            variation = variations.of[other]
            if isinstance(variation, Listed) and not all(map(is_number, variation.values)):
                raise ParameterError(
                    f'follow: {name} depends on {other}, whose values must be numbers'
                )
    metrics = metrics_of(mapping.get('metrics', USUAL_METRICS), folder)
    given = frozenset([*fixed, *vary, *follow])
    return Study(scene, given, variations, follow, metrics, settings)


def settings_of(cls: type[T], mapping: Any, parts: Sequence[str]) -> T:
    """
    Return the settings of a study, a record of `cls`, from what its file says.

    Raises
    ------
    ParameterError
        If the study is no mapping, has a key that is neither a field of `cls` nor one of `parts`,
        or has no scene or nothing that varies, or if a value is not usable.

    """
    if not isinstance(mapping, Mapping):
        raise ParameterError(
            f'a study must be a mapping of names to values, got {quoted(mapping)}'
        )
    names = [item.name for item in fields(cls)]  # type: ignore[arg-type]
    for key in mapping:
        if key not in (*parts, *names):
            raise ParameterError(f'unknown key {quoted(key)}; {nearest(key, (*parts, *names))}')
    for key in ('scene', 'vary'):
        if key not in mapping:
            raise ParameterError(f'a study must have {key}')
    found: T = from_mapping(cls, {key: mapping[key] for key in names if key in mapping}, 'study')
    return found


def scene_and_values(
    mapping: Mapping[str, Any], folder: Path | None
) -> tuple[Scene, Mapping[str, Any], Mapping[str, Any]]:
    """
    Return the scene of a study, the values that are set in it, and what `vary` says.

    Raises
    ------
    ParameterError
        If there is no such scene, or no such value in it.

    """
    scene, fixed = _scene(mapping['scene'], folder), mapping_at(mapping, 'set')
    check_names(scene, list(fixed), 'set')
    scene = scene_with(scene, fixed, 'set')
    vary = mapping_at(mapping, 'vary')
    if not vary:
        raise ParameterError('vary must name a value of the scene, such as friction.longitudinal')
    check_names(scene, list(vary), 'vary')
    plain = {name.removesuffix('_deg') for name in fixed}
    for name in vary:
        if name.removesuffix('_deg') in plain:
            raise ParameterError(f'{name} must be in set or in vary, it is in both')
    return scene, fixed, vary


def followers_of(
    mapping: Mapping[str, Any], vary: Iterable[str], fixed: Iterable[str], scene: Scene
) -> dict[str, Expression]:
    """
    Return the values that follow from those that vary, by their expressions.

    Raises
    ------
    ParameterError
        If there is no such value, if it is set or varies as well, or if it is no expression.

    """
    given, vary = mapping_at(mapping, 'follow'), tuple(vary)
    check_names(scene, list(given), 'follow')
    taken = {name.removesuffix('_deg') for name in (*vary, *fixed)}
    for name in given:
        if name.removesuffix('_deg') in taken:
            raise ParameterError(f'follow: {name} must not be in set or in vary as well')
    return {name: expression_of(text, vary, f'follow: {name}') for name, text in given.items()}


def with_followers(values: Mapping[str, Any], follow: Mapping[str, Expression]) -> dict[str, Any]:
    """Return values, and those that follow from them."""
    return {**values, **{name: item.value(values) for name, item in follow.items()}}


def scene_with(scene: Scene, values: Mapping[str, Any], where: str) -> Scene:
    """Return a scene with other values; errors begin with where these are from."""
    try:
        return with_settings(scene, values)
    except ParameterError as error:
        raise ParameterError(f'{where}: {error}') from None


def _scene(source: Any, folder: Path | None) -> Scene:
    """Return a scene, or that of a file, in a folder first."""
    if isinstance(source, Scene):
        return source
    if not isinstance(source, (str, Path)) or not str(source):
        raise ParameterError(
            f'scene must be a file or a name such as sidewinding, got {quoted(source)}'
        )
    if folder:
        for name in (str(source), f'{source}.yaml'):
            if is_file(folder / name) and not is_file(CONFIG / name):
                return load_scene(folder / name)
    return load_scene(source)


def mapping_at(mapping: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return the mapping under a key, empty if there is none; refuse what is no mapping."""
    given = mapping.get(name, {})
    if not isinstance(given, Mapping):
        raise ParameterError(f'{name} must be a mapping of names to values, got {quoted(given)}')
    return given


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
        Parquet or CSV file of the table. The journal beside it has the runs that are done, which
        are not run again.
    trajectories : str or Path, optional
        Folder for an npz file of every run.
    workers : context manager of Workers, optional
        ``workers.threads(2)``, ``workers.processes(2)`` or ``workers.cluster(address)``. Default:
        threads on all cores.
    observe : callable, optional
        ``observe(results, is_new)`` is called with rows as they are done: their columns by name,
        and whether they were run now, not found in the file.
    **settings
        `set`, `follow`, `sampling`, `samples`, `seed`, `rate`, `time_limit`, as in the file of a
        study.

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

    After an interruption or an error the rows that are done are in the file. The journal beside
    it has all runs for it, also those of other rows, and those that an interruption kept out of
    the table.
    """
    names, results = [item.name for item in given.metrics], list[Result]()

    def frame() -> 'polars.DataFrame | None':
        return table.frame_of(results, names) if results else None

    with (
        table.stored(out, 'the table of a study', TABLE_COLUMNS, frame) as (known, keep),
        workers or threads() as pool,
    ):
        for chunk, is_new in results_of(given.plan(folder), given.rows(), pool, known, keep):
            results += chunk
            if observe:
                observe(chunk, is_new)
    return table.frame_of(results, names)
