# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The worlds of a simulation, by the services of simulation_interfaces: scenes, named or in files.

A resource is the name of a scene of the package or a file, as a path or as ``file://...``: a YAML
file of a scene, or a URDF.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote

from snake_sim_ros.nodes import standard
from snake_sim_ros.nodes.standard import answered, Refused
from snake_sim_ros.scene.checked_records import cut, ParameterError, quoted
from snake_sim_ros.scene.files import files_of_package, find_file, read_mapping
from snake_sim_ros.scene.parameters import load_scene, Scene

STEPPING = 'steps are taken: cancel the goal of ~/simulate_steps first'
FORMATS = ('', '.yaml', '.yml', '.urdf')  # suffixes of files
KEYS = {item.name for item in fields(Scene)}


class Loadable(Protocol):
    """A node that can continue with another scene."""

    world: str  # file of the scene; empty: none is loaded
    between: Callable[[], None] | None  # what is done between messages while time stands still

    def load_world(self, source: str, scene: Scene) -> None:
        """Continue with another scene, paused; raise ParameterError if the node cannot run it."""

    def unload_world(self) -> None:
        """Let simulated time wait for another scene."""


class Worlds:
    """
    What is answered to requests on worlds.

    Parameters
    ----------
    node : Loadable
    loaded : callable
        Called when another world was loaded.

    Attributes
    ----------
    answers : mapping
        Services by the names of their types -> what answers them.

    """

    def __init__(self, node: Loadable, loaded: Callable[[], None]) -> None:
        self._node, self._loaded = node, loaded
        self.answers: Mapping[str, standard.Answer] = {
            'GetCurrentWorld': self._on_current,
            'GetAvailableWorlds': self._on_available,
            'LoadWorld': self._on_load,
            'UnloadWorld': self._on_unload,
        }

    def _on_current(self, _: Any, response: Any) -> Any:
        if not self._node.world:
            return answered(response, type(response).NO_WORLD_LOADED, standard.NO_WORLD)
        fill_world(response.world, Path(self._node.world))
        return answered(response, standard.messages.Result.RESULT_OK)

    def _on_available(self, request: Any, response: Any) -> Any:
        codes = standard.messages.Result
        if request.filter.tags:
            return answered(response, codes.RESULT_FEATURE_UNSUPPORTED, 'scenes have no tags')
        files = [find_file(name, Path()) for name in files_of_package(robots=False)]
        failed = []
        for source in request.additional_sources:
            found = scenes_in(path_of(source))
            files += found
            if not found:
                failed.append(f'no scenes in {quoted(cut(source))}')
        why = '; '.join(failed)
        if failed and not request.continue_on_error:
            return answered(response, codes.RESULT_NOT_FOUND, why)
        for file in files:
            response.worlds.append(standard.messages.WorldResource())
            fill_world(response.worlds[-1], file.resolve())
        return answered(response, codes.RESULT_OK, why)

    def _on_load(self, request: Any, response: Any) -> Any:
        codes, resource = standard.messages.Result, request.world_resource
        try:
            self._check_steps()
            source, scene = scene_of(resource, type(response))
            self._node.load_world(source, scene)
        except Refused as error:
            return answered(response, error.code, str(error))
        except ParameterError as error:
            return answered(response, codes.RESULT_OPERATION_FAILED, str(error))
        self._loaded()
        fill_world(response.world, Path(self._node.world))
        return answered(response, codes.RESULT_OK)

    def _on_unload(self, _: Any, response: Any) -> Any:
        if not self._node.world:
            return answered(response, type(response).NO_WORLD_LOADED, standard.NO_WORLD)
        try:
            self._check_steps()
        except Refused as error:
            return answered(response, error.code, str(error))
        self._node.unload_world()
        return answered(response, standard.messages.Result.RESULT_OK)

    def _check_steps(self) -> None:
        """Raise Refused while a goal takes steps."""
        if self._node.between:
            raise Refused(standard.messages.Result.RESULT_OPERATION_FAILED, STEPPING)


def path_of(uri: str) -> str:
    """Return the path or the name that a URI is; empty if it is one of another kind."""
    scheme, _, path = uri.rpartition('://')
    return {'': path, 'file': unquote(path)}.get(scheme, '')


def scenes_in(source: str) -> list[Path]:
    """Return the files of scenes in a folder, or the one that is a file itself."""
    path = Path(source)
    try:
        files = sorted(path.iterdir()) if source and path.is_dir() else [path]
        return [file for file in files if file.is_file() and is_scene(file)]
    except OSError:  # such as a folder of others, or a name that is too long
        return []


def is_scene(file: Path) -> bool:
    """Return whether a file may be a scene: a URDF, or YAML with the keys of scenes."""
    if file.suffix == '.urdf':
        return True
    if file.suffix not in FORMATS[1:]:
        return False
    try:
        return {str(key).removesuffix('_deg') for key in read_mapping(file)} <= KEYS
    except ParameterError:
        return False


def scene_of(resource: Any, codes: Any) -> tuple[str, Scene]:
    """Return name or file of a resource, and its scene; raise Refused if it is none."""
    uri, source = resource.uri, path_of(resource.uri)
    if not uri and resource.resource_string:
        raise Refused(codes.UNSUPPORTED_FORMAT, 'resource_string must be empty: uri is needed')
    if not uri:
        raise Refused(codes.NO_RESOURCE, 'uri must be a scene: its name, its file or file://...')
    if not source or Path(source).suffix not in FORMATS:
        raise Refused(
            codes.UNSUPPORTED_FORMAT,
            f'uri must be a scene, as a YAML file or a URDF, got {quoted(cut(uri))}',
        )
    try:
        find_file(source, Path())
    except ParameterError as error:
        raise Refused(standard.messages.Result.RESULT_NOT_FOUND, str(error)) from None
    try:
        return source, load_scene(source)
    except ParameterError as error:
        raise Refused(codes.RESOURCE_PARSE_ERROR, str(error)) from None


def fill_world(world: Any, file: Path) -> None:
    """Fill a WorldResource with the scene of a file."""
    world.name, world.world_resource.uri = file.stem, file.as_uri()
    world.description = 'scene of snake_sim_ros: robot, friction, obstacles and gait'
