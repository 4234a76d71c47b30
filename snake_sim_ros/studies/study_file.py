# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a study is: a scene, what varies in it, what is measured; as a record and as a file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

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
from snake_sim_ros.studies.keys import physics_version
from snake_sim_ros.studies.metrics import Metric, metrics_of, USUAL_METRICS
from snake_sim_ros.studies.runs import Plan, Row
from snake_sim_ros.studies.variations import check_names, SAMPLINGS, variation_of, Variations

KEEP = ('metrics', 'trajectories')
T = TypeVar('T')


@dataclass(frozen=True, kw_only=True)
class Settings(CheckedRecord):
    """The values of a study that are one number or one word."""

    sampling: str = quantity('grid', '', 'how values are combined into rows', choices=SAMPLINGS)
    samples: int = quantity(0, '1', 'number of rows that are drawn', minimum=0, maximum=10**7)
    seed: int = quantity(0, '1', 'seed of what is drawn', minimum=0)
    rate: float = quantity(20.0, 'Hz', 'samples a second of which metrics are taken', above=0)
    keep: str = quantity('metrics', '', 'what is kept of a run', choices=KEEP)


PARTS = ('scene', 'set', 'vary', 'metrics')  # of a study, besides its settings


@dataclass(frozen=True)
class Study:
    """
    A study.

    Attributes
    ----------
    scene : Scene
        With the values that are set.
    given : frozenset of str
        Names of the values that are set or vary.
    variations : Variations
    metrics : tuple of Metric
    settings : Settings

    """

    scene: Scene
    given: frozenset[str]
    variations: Variations
    metrics: tuple[Metric, ...]
    settings: Settings

    def plan(self, folder: Path | None = None) -> Plan:
        """Return what all runs have in common; trajectories are kept in a folder, if any."""
        rate = self.settings.rate
        return Plan(self.scene, self.given, self.metrics, rate, folder, physics_version())

    def rows(self) -> Iterator[Row]:
        """Yield all rows."""
        for number in range(len(self.variations)):
            yield Row(number, self.variations.row(number))


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
    settings = settings_of(Settings, mapping, PARTS)
    scene, fixed, vary = scene_and_values(mapping, folder)
    variations = Variations(
        {name: variation_of(name, given) for name, given in vary.items()},
        settings.sampling, settings.samples, settings.seed,
    )  # fmt: skip
    metrics = metrics_of(mapping.get('metrics', USUAL_METRICS), folder)
    return Study(scene, frozenset([*fixed, *vary]), variations, metrics, settings)


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
    try:
        scene = with_settings(scene, fixed)
    except ParameterError as error:
        raise ParameterError(f'set: {error}') from None
    vary = mapping_at(mapping, 'vary')
    if not vary:
        raise ParameterError('vary must name a value of the scene, such as friction.longitudinal')
    check_names(scene, list(vary), 'vary')
    plain = {name.removesuffix('_deg') for name in fixed}
    for name in vary:
        if name.removesuffix('_deg') in plain:
            raise ParameterError(f'{name} must be in set or in vary, it is in both')
    return scene, fixed, vary


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
