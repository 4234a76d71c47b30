# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages from and to YAML, as the `ros2` command line reads and prints them."""

from array import array
from collections.abc import Callable, Iterable
from importlib import import_module
import math
import re
import sys
from typing import Any

import numpy as np
import yaml

from snake_sim_ros.nodes.graph.client import GraphError
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.files import NOT_READABLE, parse_yaml

NUMBERS = 'float', 'double'


def interface(name: str, kind: str) -> Any:
    """
    Return the class of a message or service.

    Parameters
    ----------
    name : str
        ``package/msg/Name`` or ``package/Name``.
    kind : str
        msg or srv.

    Raises
    ------
    GraphError
        If there is none of this name.

    """
    what = {'msg': 'message', 'srv': 'service'}[kind]
    parts = name.split('/')
    if len(parts) == 3 and parts[1] != kind:
        raise GraphError(f'The passed type is not a {what}: {name}')
    try:
        package, short = parts[0], parts[-1]
        if not 2 <= len(parts) <= 3 or not all(part.isidentifier() for part in parts):
            raise ValueError
        found = getattr(import_module(f'{package}.{kind}'), short)
    except (AttributeError, ImportError, ValueError):
        example = 'sensor_msgs/msg/JointState' if kind == 'msg' else 'std_srvs/srv/Trigger'
        raise GraphError(
            f'The passed {what} type is invalid: {name} is not installed, or not written as '
            f'in {example}'
        ) from None
    return found


# ---- to YAML ------------------------------------------------------------------------------------


def as_yaml(message: Any, longest: int | None, flow_style: bool) -> str:
    """
    Return a message as YAML.

    Parameters
    ----------
    message : message
    longest : int, optional
        Elements of an array or a text that are shown; default: all.
    flow_style : bool
        On one line.

    """
    return yaml.dump(
        _plain(message, longest),
        sort_keys=False,
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow_style,
    )


def _plain(value: Any, longest: int | None) -> Any:
    """Return a value as what YAML knows."""
    if is_message(value):
        return {
            name: _plain(getattr(value, name), longest)
            for name in value.get_fields_and_field_types()
        }
    if isinstance(value, bytes):
        value = value.decode('latin-1')
    if isinstance(value, str):
        return value if longest is None or len(value) <= longest else f'{value[:longest]}...'
    if isinstance(value, (list, tuple, array, np.ndarray)):
        items = [_plain(item, longest) for item in value[:longest]]
        return items if len(items) == len(value) else [*items, '...']
    return value.item() if isinstance(value, np.generic) else value


def is_message(value: Any) -> bool:
    """Return whether a value has fields."""
    return hasattr(value, 'get_fields_and_field_types')


def field_of(message: Any, path: str) -> Any:
    """
    Return a field of a message.

    Parameters
    ----------
    message : message
    path : str
        Names with dots between them.

    Raises
    ------
    GraphError
        If there is none.

    """
    for name in filter(None, path.split('.')):
        known = list(message.get_fields_and_field_types()) if is_message(message) else []
        if name not in known:
            has = (
                f'the fields here are {", ".join(known)}' if known else 'there are no fields here'
            )
            raise GraphError(f"Invalid field '{path}': there is no {name}, {has}")
        message = getattr(message, name)
    return message


# ---- from YAML ----------------------------------------------------------------------------------


def filled(message: Any, text: str) -> Any:
    """
    Return a message with the values of a YAML text.

    Raises
    ------
    GraphError
        If the text is no YAML, or does not fit the message.

    """
    try:
        values = parse_yaml(text)
    except ParameterError as error:
        reason = str(error).removeprefix(NOT_READABLE)
        raise GraphError(f'The passed value is no YAML: {reason}, got {quoted(text)}') from None
    if not isinstance(values, dict):
        raise GraphError(
            f'The passed value needs to be a dictionary in YAML format, such as '
            f'"{_example(message)}", got {quoted(text)}'
        )
    try:
        _fill(message, values)
    except (TypeError, ValueError, OverflowError) as error:
        raise GraphError(f'Failed to populate field: {error}') from None
    return message


def _example(message: Any) -> str:
    name = next(iter(message.get_fields_and_field_types()), '')
    value = getattr(message, name, None)
    shown = '{}' if is_message(value) else as_yaml(value, 3, True).removesuffix('...\n').strip()
    return f'{{{name}: {shown}}}'


def _fill(message: Any, values: Any, path: str = '') -> None:
    if not isinstance(values, dict):
        raise ValueError(f'{path} must be a mapping, such as {_example(message)}, got {values!r}')
    kinds = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in kinds:
            inside = f'{path} has' if path else 'it has'
            known = ', '.join(kinds) or 'none'
            raise ValueError(f'there is no field {name}, the fields that {inside} are: {known}')
        where = f'{path}.{name}' if path else str(name)
        setattr(message, name, _converted(kinds[name], getattr(message, name), value, where))


def _converted(kind: str, current: Any, value: Any, path: str) -> Any:
    """Return a value as a field of a kind takes it; a wrong type would arrive as garbage."""
    several = re.fullmatch(r'sequence<(.+?)(?:, (\d+))?>|(.+)\[(\d+)\]', kind)
    if several:
        return _elements(several, value, path)
    if '/' in kind:
        message = current if current is not None else _new(kind)
        _fill(message, value, path)
        return message
    if kind.startswith(('string', 'wstring')):
        return value if isinstance(value, str) else str(value)
    if kind == 'boolean':
        if not isinstance(value, (bool, int)) or value not in (0, 1):
            raise ValueError(f'{path} must be true or false, got {quoted(value)}')
        return bool(value)
    if kind in NUMBERS:
        return _number(float, value, f'{path} must be a number')
    low, high = bounds(kind)
    number = _number(int, value, f'{path} must be a whole number')
    if not low <= number <= high:
        raise ValueError(f'{path} must be {low} to {high}, got {number}')
    return bytes([number]) if kind == 'octet' else number


def _elements(several: re.Match[str], value: Any, path: str) -> Any:
    """Return the elements of an array or sequence."""
    kind, count, limit = several[1] or several[3], several[4], several[2]
    if not isinstance(value, Iterable) or isinstance(value, (str, dict)):
        raise ValueError(f'{path} must be a list, got {quoted(value)}')
    items = [_converted(kind, None, item, f'{path}[{k}]') for k, item in enumerate(value)]
    if count and len(items) != int(count):
        raise ValueError(f'{path} must have {count} elements, got {len(items)}')
    if limit and len(items) > int(limit):
        raise ValueError(f'{path} must have at most {limit} elements, got {len(items)}')
    return np.array(items) if count and kind in NUMBERS else items


def _new(kind: str) -> Any:
    package, _, name = kind.partition('/')
    return getattr(import_module(f'{package}.msg'), name)()


def bounds(kind: str) -> tuple[int, int]:
    """Return the least and the largest number of a kind of whole numbers."""
    found = re.fullmatch(r'(u?)int(\d+)', kind)
    if not found:
        return 0, 255  # octet and char
    bits = int(found[2])
    return (0, 2**bits - 1) if found[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def _number(make: Callable[[Any], Any], value: Any, must: str) -> Any:
    """Return a number; YAML takes 1e-3, which has no point, for a text."""
    if not isinstance(value, bool):
        try:
            number = float(value) if make is float else value
            if make is float or (isinstance(value, (int, float)) and math.isfinite(value)):
                if make is float or number == int(number):
                    return make(number)
        except (TypeError, ValueError):
            pass
    raise ValueError(f'{must}, got {quoted(value)}')
