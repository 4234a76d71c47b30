# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Files: reading of YAML, scenes and robots by their names, and files that are written as a whole.

YAML text is read here only, with checks that PyYAML does not make. It may be hostile: a few lines
of aliases stand for billions of values, brackets nest without end, and tags ask for values that
their text cannot give. Length, depth and number of values are bounded, aliases counted with all
they stand for. Only plain values are made: texts, numbers, truth values, dates, lists, sets and
mappings, never objects. Whatever is wrong becomes one sentence.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
import difflib
from io import BytesIO
import os
from pathlib import Path
import re
from secrets import token_hex
import shutil
from typing import Any

import yaml

from snake_sim_ros.scene import PACKAGE
from snake_sim_ros.scene.checked_records import (
    cut,
    LONGEST_PATH,
    LONGEST_REASON,
    ParameterError,
    quoted,
)

# ---- YAML, within bounds ------------------------------------------------------------------------


# A ground of 300 times 300 cells has 90 000 values and 2 MB.
MOST_CHARACTERS = 2_500_000
MOST_VALUES = 100_000
MOST_KEYS = 1000  # of one mapping
DEEPEST = 30  # mappings and lists in each other
LONGEST_NUMBER = 400  # characters of a number or a date; a float with all its digits has 330
NOT_READABLE = 'not readable as YAML: '  # how the sentences of `parse_yaml` begin
NUMBERS = ('int', 'float', 'timestamp', 'bool', 'null')


class _Loader(yaml.SafeLoader):
    """A loader with bounds, that refuses a key written twice and reads 1e-8 as a number."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = self._values = 0
        self._sizes: dict[str, int] = {}  # of what each anchor stands for

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; count it, or all that the alias stands for."""
        event = self.peek_event()
        anchor: str | None = getattr(event, 'anchor', None)
        is_alias = isinstance(event, yaml.AliasEvent)
        if is_alias and anchor in self.anchors and anchor not in self._sizes:
            raise yaml.YAMLError(f'the alias {quoted(anchor)} is inside what it stands for')
        before = self._values
        self._values += self._sizes.get(str(anchor), 1) if is_alias else 1
        self._depth += 1
        if self._values > MOST_VALUES:
            raise yaml.YAMLError(f'it has more than {MOST_VALUES} values, with those of aliases')
        if self._depth > DEEPEST:
            raise yaml.YAMLError(f'it has more than {DEEPEST} levels of lists and mappings')
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        if anchor is not None and not is_alias:
            self._sizes[anchor] = self._values - before
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        if isinstance(node, yaml.MappingNode) and len(node.value) > MOST_KEYS:
            raise yaml.YAMLError(f'a mapping has more than {MOST_KEYS} keys')
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            keys = Counter(self.construct_object(key, deep) for key, _ in node.value)
            twice = next(key for key in keys if keys[key] > 1)
            raise yaml.YAMLError(f'key {quoted(twice)} is written twice')
        return mapping

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Return the value of a node; a text that does not fit its tag is refused."""
        kind = node.tag.rpartition(':')[2]
        if kind in NUMBERS and isinstance(node, yaml.ScalarNode):
            if len(node.value) > LONGEST_NUMBER:
                raise yaml.YAMLError(
                    f'a number has at most {LONGEST_NUMBER} characters, got {quoted(node.value)}'
                )
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise yaml.YAMLError(f'{quoted(node.value)} is no {cut(kind)}') from None


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$'),
    list('-+.0123456789'),
)


def parse_yaml(text: str) -> Any:
    """
    Return the value that a YAML text describes.

    Raises
    ------
    ParameterError
        If it is not YAML, is too long, too deep or has too many values, or if a key is written
        twice.

    """
    if len(text) > MOST_CHARACTERS:
        raise ParameterError(
            f'{NOT_READABLE}it has more than {MOST_CHARACTERS} characters, {len(text)}'
        )
    try:
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, RecursionError) as error:
        reason = cut(' '.join(str(error).split()), LONGEST_REASON)
        raise ParameterError(f'{NOT_READABLE}{reason}') from None


def read_text(path: Path) -> str:
    """
    Return the text of a file, up to a character more than a file may have.

    Raises
    ------
    ParameterError
        If it cannot be read; the message names the file.

    """
    try:
        with path.open(encoding='utf-8') as file:
            return file.read(MOST_CHARACTERS + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise ParameterError(f'no file {cut(str(path), LONGEST_PATH)}') from None
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ParameterError(f'{cut(str(path), LONGEST_PATH)}: {NOT_READABLE}{reason}') from None


def read_yaml(path: Path) -> Any:
    """
    Return the value that a YAML file describes.

    Raises
    ------
    ParameterError
        If it cannot be read, or as `parse_yaml` raises it; the message names the file.

    """
    text = read_text(path)
    try:
        return parse_yaml(text)
    except ParameterError as error:
        raise ParameterError(f'{cut(str(path), LONGEST_PATH)}: {error}') from None


# ---- files of scenes and robots -----------------------------------------------------------------


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


# ---- writing ------------------------------------------------------------------------------------


LONGEST_STEM = 40  # characters of a name that the file beside it keeps


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Yield a path to write to, whose file takes the place of another one once it is on the disk.

    If writing fails, what was there before stays, and nothing else is left. A link stays a link,
    and what is not a file, such as a terminal or a pipe, is written as it is.

    Parameters
    ----------
    path : Path
        The file to write.

    Yields
    ------
    Path
        A new name beside the file, with its suffix and ``.part`` before it.

    Raises
    ------
    OSError
        If the system refuses to write; the error names `path`.

    """
    place = path.resolve()
    in_place = place.exists() and not place.is_file()
    name = f'{place.stem[:LONGEST_STEM]}.{token_hex(4)}.part{place.suffix}'
    part = place if in_place else place.with_name(name)
    try:
        yield part
        if not in_place:
            _keep(part, place)
    except OSError as error:
        raise OSError(f'{path} cannot be written: {error.strerror or error}') from None
    finally:
        if not in_place:
            part.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a text, in UTF-8, or bytes as a file, see `whole_file`."""
    with whole_file(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


def write_figure(figure: Any, path: Path, **how: Any) -> None:
    """
    Write a figure of matplotlib as a file, see `whole_file`.

    It is drawn in memory, because what draws PDF does not pass on errors of the system.

    Parameters
    ----------
    figure : Figure
    path : Path
        Its suffix selects the format.
    **how
        Other arguments of `Figure.savefig`.

    """
    content = BytesIO()
    figure.savefig(content, format=path.suffix[1:], **how)
    write_whole(path, content.getvalue())


def _keep(part: Path, place: Path) -> None:
    """Give a file, once it is on the disk, the place and the permissions of another one."""
    with part.open('rb') as file:
        os.fsync(file.fileno())
    if place.exists():
        shutil.copymode(place, part)
    os.replace(part, place)
