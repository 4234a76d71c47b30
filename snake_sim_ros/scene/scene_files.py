"""Files of scenes and robots: where they are found, and how they are read."""

import difflib
from pathlib import Path
from typing import Any

from snake_sim_ros import PACKAGE
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.yaml_text import parse_yaml

CONFIG = PACKAGE / 'config'


def find_file(source: str | Path, folder: Path) -> Path:
    """Return a file in a folder or, if the source is only a name, one of the package."""
    if not isinstance(source, (str, Path)):
        raise ParameterError(
            f'a scene must be a Scene, a YAML file or the name of a scene, got {source!r}'
        )
    names = [Path(source), Path(f'{source}.yaml')]
    packaged = [CONFIG / name for name in names if name.name == str(name)]
    for candidate in [folder / name for name in names] + packaged:
        if candidate.is_file():
            return candidate
    scenes = sorted(path.stem for path in CONFIG.glob('*.yaml'))
    close = difflib.get_close_matches(str(source), scenes, n=1)
    hint = f'did you mean {close[0]!r}? ' if close else ''
    raise ParameterError(
        f'no file {source}; {hint}the scenes that come with the package: {", ".join(scenes)}'
    )


def read_mapping(path: Path) -> dict[str, Any]:
    """Return what a YAML file holds; raise an error if it is no mapping."""
    try:
        mapping = parse_yaml(path.read_text(encoding='utf-8'))
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None
    except (OSError, UnicodeDecodeError) as error:
        raise ParameterError(f'{path}: not readable as YAML: {error}') from None
    if not isinstance(mapping, dict):
        raise ParameterError(f'{path}: must be a mapping of names to values, got {mapping!r}')
    return mapping
