# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of scenes and robots: where they are found, and how they are read."""

import difflib
from pathlib import Path
from typing import Any

from snake_sim_ros.scene.about import PACKAGE
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.quoting import cut, LONGEST_PATH, quoted
from snake_sim_ros.scene.yaml_text import read_yaml

CONFIG = PACKAGE / 'config'
OF_ROBOT = 'link_count'  # a key that every robot of the package has, and no scene


def is_file(path: Path) -> bool:
    """
    Return whether a path is that of a file.

    Raises
    ------
    ParameterError
        If it cannot be the name of a file, as one of 300 characters cannot.

    """
    try:
        return path.is_file()
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ParameterError(f'{cut(path.name)} cannot be the name of a file: {reason}') from None


def find_file(source: str | Path, folder: Path, robot_of: str = '') -> Path:
    """
    Return a file in a folder or, if the source is only a name, one of the package.

    Parameters
    ----------
    source : str or Path
    folder : Path
    robot_of : str, optional
        Where the source is named as a robot, such as the scene; without that it is a scene.

    Raises
    ------
    ParameterError
        If there is no such file.

    """
    if not isinstance(source, (str, Path)):
        raise ParameterError(
            f'a scene must be a Scene, a YAML file or the name of a scene, got {quoted(source)}'
        )
    names = [Path(source), Path(f'{source}.yaml')]
    packaged = [CONFIG / name for name in names if name.name == str(name)]
    for candidate in [folder / name for name in names] + packaged:
        if is_file(candidate):
            return candidate
    where, what = (f'{robot_of}: robot: ', 'robots') if robot_of else ('', 'scenes')
    known = files_of_package(robots=bool(robot_of))
    close = difflib.get_close_matches(cut(str(source)), known, n=1)
    hint = f'did you mean {close[0]!r}? ' if close else ''
    raise ParameterError(
        f'{where}no file {cut(str(source), LONGEST_PATH)}; {hint}the {what} that come with the '
        f'package: {", ".join(known)}'
    )


def files_of_package(*, robots: bool) -> list[str]:
    """Return the names of the scenes, or of the robots, that come with the package."""
    return sorted(
        path.stem for path in CONFIG.glob('*.yaml') if (OF_ROBOT in read_mapping(path)) == robots
    )


def read_mapping(path: Path) -> dict[str, Any]:
    """Return what a YAML file holds; raise an error if it is no mapping."""
    mapping = read_yaml(path)
    if not isinstance(mapping, dict):
        raise ParameterError(
            f'{path}: must be a mapping of names to values, got {quoted(mapping)}'
        )
    return mapping
