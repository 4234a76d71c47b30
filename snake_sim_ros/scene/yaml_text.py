"""Reading of YAML text, with checks that PyYAML does not make."""

import re
from typing import Any

import yaml

from snake_sim_ros.scene.checked_records import ParameterError


class _Loader(yaml.SafeLoader):
    """A loader that refuses a key written twice and reads 1e-8 as a number."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            keys = [self.construct_object(key, deep) for key, _ in node.value]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise yaml.YAMLError(f'key {twice!r} is written twice')
        return mapping


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
        If it is not YAML, or if a key is written twice.

    """
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise ParameterError(f'not readable as YAML: {reason}') from None
