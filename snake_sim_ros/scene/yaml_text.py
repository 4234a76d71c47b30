# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Reading of YAML text, the only place that does, with checks that PyYAML does not make.

YAML may be hostile: a few lines of aliases stand for billions of values, brackets nest without
end, and tags ask for values that their text cannot give. What is read is bounded in its length,
depth and number of values, aliases counted with all they stand for. Only plain values are made:
texts, numbers, truth values, dates, lists, sets and mappings, never objects. Whatever is wrong
becomes one sentence.
"""

from collections import Counter
from pathlib import Path
import re
from typing import Any

import yaml

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.quoting import cut, LONGEST_PATH, LONGEST_REASON, quoted

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


def read_yaml(path: Path) -> Any:
    """
    Return the value that a YAML file describes.

    Raises
    ------
    ParameterError
        If it cannot be read, or as `parse_yaml` raises it; the message names the file.

    """
    try:
        with path.open(encoding='utf-8') as file:
            text = file.read(MOST_CHARACTERS + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise ParameterError(f'no file {cut(str(path), LONGEST_PATH)}') from None
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ParameterError(f'{cut(str(path), LONGEST_PATH)}: {NOT_READABLE}{reason}') from None
    try:
        return parse_yaml(text)
    except ParameterError as error:
        raise ParameterError(f'{cut(str(path), LONGEST_PATH)}: {error}') from None
