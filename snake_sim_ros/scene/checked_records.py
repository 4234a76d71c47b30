# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Records: frozen dataclasses whose fields know their unit and range, and which check their values.

A record is made from nested mappings, as YAML gives them, and is turned back into such mappings.
A value that is not usable is refused with one sentence that names it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import field, fields, is_dataclass
import difflib
from functools import cache
import math
from reprlib import Repr
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints, NamedTuple

import numpy as np

# ---- values in sentences ------------------------------------------------------------------------


LONGEST = 80  # characters of a quoted value
LONGEST_PATH = 250  # characters of the name of a file
LONGEST_REASON = 250  # characters of what a library finds wrong
LOOKED_AT = 10_000  # characters of a text that is cut; each takes memory

_SHORT = Repr()
_SHORT.maxlevel = 3
_SHORT.maxdict = _SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxset = _SHORT.maxfrozenset = 12
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = LONGEST


def quoted(value: Any) -> str:
    """Return a value as text in one line of at most about 80 characters."""
    try:
        text = _SHORT.repr(value)
    except ValueError:  # whole numbers of more digits than Python writes
        return f'a {type(value).__name__} of very many digits'
    except Exception:  # a type that cannot be shown
        return f'a {type(value).__name__}'
    return cut(text)


def cut(text: str, longest: int = LONGEST) -> str:
    """Return a text in one line, with dots in its middle if it is longer than that."""
    if len(text) > LOOKED_AT:
        text = text[: LOOKED_AT // 2] + text[-LOOKED_AT // 2 :]
    line = ' '.join(text.split()) if not text.isprintable() else text
    line = ''.join(each if each.isprintable() else '?' for each in line)
    half = (longest - 3) // 2
    return line if len(line) <= longest else f'{line[:half]}...{line[-half:]}'


# ---- records ------------------------------------------------------------------------------------


KIND_NAMES = {str: 'text', bool: 'true or false', int: 'a whole number', float: 'a number'}
MOST = 1e30  # magnitude of any number, so that products of a few of them are finite
LONGEST_TEXT = 4096  # characters, as many as the name of a file may have


class ParameterError(ValueError):
    """A number, name or file of a scene is not usable; the message says which and why."""


def quantity(
    default: Any,
    unit: str,
    meaning: str,
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """
    Return a dataclass field that knows its unit, its meaning and its admissible values.

    Parameters
    ----------
    default : object
        Default value of the field.
    unit : str
        Unit, such as 'N m/rad'; '1' for a pure number, '' for what is no number.
    meaning : str
        What the value means.
    above, minimum, maximum : float
        Bounds of every number in the value; `above` itself is excluded.
    choices : tuple of str
        Admissible texts; empty for any.

    """
    limits = {'above': float(above), 'minimum': float(minimum), 'maximum': float(maximum)}
    metadata = {'unit': unit, 'meaning': meaning, 'choices': choices, **limits}
    return field(default=default, metadata=metadata)


@cache
def _type_hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


class _Field(NamedTuple):
    """What `CheckedRecord` looks at in a field."""

    name: str
    kind: Any
    kinds: tuple[Any, ...]  # the types it consists of
    has_numbers: bool  # whether it may be a tuple of numbers
    limits: Mapping[str, Any]  # metadata of the field

    def is_usual(self, value: Any) -> bool:
        """Return whether a value needs no conversion and is usable: the way of nearly all."""
        cls, limits = type(value), self.limits
        if cls is tuple:
            return self.has_numbers and all(map(self.is_usual_number, value))
        if cls not in self.kinds:
            return False
        if cls is float or cls is int:
            return self.is_usual_number(value)
        if cls is str:
            choices = limits['choices']
            return value in choices if choices else len(value) <= LONGEST_TEXT
        return True

    def is_usual_number(self, value: Any) -> bool:
        """Return whether a number in a value needs no conversion and is usable."""
        limits = self.limits
        is_number = type(value) is float or (type(value) is int and int in self.kinds)
        return is_number and bool(
            limits['above'] < value
            and -MOST <= value <= MOST
            and limits['minimum'] <= value <= limits['maximum']
        )


@cache
def _fields_of(cls: type) -> tuple[_Field, ...]:
    """Return the fields of a class of records."""
    found = []
    for item in fields(cls):  # type: ignore[arg-type]
        kind = _type_hints(cls)[item.name]
        kinds = get_args(kind) if isinstance(kind, UnionType) else (kind,)
        numbers = tuple[float, ...] in kinds
        found.append(_Field(item.name, kind, kinds, numbers, item.metadata))
    return tuple(found)


def _converted(name: str, value: Any, kind: Any) -> Any:
    """Return `value` as `kind`; numbers are never taken from text or truth values."""
    kinds = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    kinds = tuple(
        each for each in kinds if each is not NoneType
    )  # None itself needs no conversion
    if is_dataclass(kind):
        if isinstance(value, kind):  # type: ignore[arg-type]
            return value
        raise ParameterError(f'{name} must be a mapping of names to values, got {quoted(value)}')
    if isinstance(value, str if str in kinds else bool) and kinds[0] in (str, bool):
        return value
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if int in kinds and number.is_integer():
            return int(value)
        if float in kinds:
            return number
    listed = [each for each in kinds if get_origin(each) is tuple]
    if isinstance(value, (list, tuple, np.ndarray)) and listed:
        kind = get_args(listed[0])[0]
        if is_dataclass(kind):
            return tuple(_record(name, k, entry, kind) for k, entry in enumerate(value))
        return tuple(_converted(name, entry, kind) for entry in value)
    wanted = KIND_NAMES.get(kinds[0], 'numbers')
    if listed and is_dataclass(get_args(listed[0])[0]):
        wanted = 'a list of mappings of names to values'
    raise ParameterError(f'{name} must be {wanted}, got {quoted(value)}')


def _record(name: str, k: int, value: Any, kind: Any) -> Any:
    """Return entry `k` of a list of records, from the record or a mapping."""
    return value if isinstance(value, kind) else from_mapping(kind, value, f'{name}[{k}]')


def _check(name: str, value: Any, limits: Mapping[str, Any]) -> None:
    """Raise an error if a value is not finite, out of range or not among the choices."""
    if isinstance(value, str):
        if limits['choices'] and value not in limits['choices']:
            choices = ', '.join(limits['choices'])
            raise ParameterError(f'{name} must be one of {choices}; got {quoted(value)}')
        if len(value) > LONGEST_TEXT:
            raise ParameterError(
                f'{name} must have at most {LONGEST_TEXT} characters, got {quoted(value)}'
            )
        return
    if not isinstance(value, (int, float)):
        return
    unit = '' if limits['unit'] in ('', '1') else f' {limits["unit"]}'
    if not math.isfinite(value):
        raise ParameterError(f'{name} must be finite, got {value}{unit}')
    if not value > limits['above']:
        raise ParameterError(
            f'{name} must be above {limits["above"]:g}{unit}, got {value:g}{unit}'
        )
    low, high = max(limits['minimum'], -MOST), min(limits['maximum'], MOST)
    if not low <= value <= high:
        bound = f'at least {low:g}' if value < low else f'at most {high:g}'
        raise ParameterError(f'{name} must be {bound}{unit}, got {value:g}{unit}')


class CheckedRecord:
    """The base of all records: every field is checked when the record is made."""

    def __post_init__(self) -> None:
        """
        Convert and check every field.

        Raises
        ------
        ParameterError
            If a value has the wrong type, is not finite or is out of range.

        """
        for item in _fields_of(type(self)):  # type: ignore[arg-type]
            value = getattr(self, item.name)
            if item.is_usual(value):
                continue
            value = _converted(item.name, value, item.kind)
            for number in _leaves(value):
                _check(item.name, number, item.limits)
            object.__setattr__(self, item.name, value)


def _leaves(value: Any) -> Iterator[Any]:
    """Yield the values in nested tuples."""
    if isinstance(value, tuple):
        for entry in value:
            yield from _leaves(entry)
    else:
        yield value


def flat_fields(record: Any, prefix: str = '') -> dict[str, tuple[Any, Mapping[str, Any]]]:
    """Return dotted name -> (value, metadata of the field) of a record and those inside it."""
    flat: dict[str, tuple[Any, Mapping[str, Any]]] = {}
    for item in fields(record):
        value = getattr(record, item.name)
        if is_dataclass(value):
            flat.update(flat_fields(value, f'{prefix}{item.name}.'))
        else:
            flat[prefix + item.name] = (value, item.metadata)
    return flat


def from_mapping(cls: type, mapping: Any, where: str) -> Any:
    """
    Return a record from nested mappings.

    Parameters
    ----------
    cls : type
        Class of the record.
    mapping : mapping
        Names to values; None counts as empty. A key may end in ``_deg``.
    where : str
        Where the mapping comes from, for error messages.

    Raises
    ------
    ParameterError
        If a key is unknown (the message suggests the nearest one) or a value not usable.

    """
    if mapping is None:
        mapping = {}
    if not isinstance(mapping, Mapping):
        raise ParameterError(
            f'{where} must be a mapping of names to values, got {quoted(mapping)}'
        )
    hints = _type_hints(cls)
    values: dict[str, Any] = {}
    for key, value in mapping.items():
        name = key.removesuffix('_deg') if isinstance(key, str) else key
        if name not in hints:
            raise ParameterError(f'{where}: unknown key {quoted(key)}; {nearest(key, hints)}')
        if name in values:
            raise ParameterError(f'{where}: {name} is given twice, as {name} and as {name}_deg')
        if name != key:
            value = _radians(key, value, cls, f'{where}: ')
        elif is_dataclass(hints[name]) and not is_dataclass(value):
            value = from_mapping(hints[name], value, f'{where}: {name}')  # type: ignore[arg-type]
        values[name] = value
    try:
        return cls(**values)
    except ParameterError as error:
        raise ParameterError(f'{where}: {error}') from None


def to_mapping(record: Any) -> dict[str, Any]:
    """Return nested mappings of names to values, the inverse of `from_mapping`."""
    mapping: dict[str, Any] = {}
    for item in fields(record):
        value = getattr(record, item.name)
        mapping[item.name] = plain(value)
    return mapping


def plain(value: Any) -> Any:
    """Return a value as YAML has it: mappings for records, lists for tuples."""
    if is_dataclass(value):
        return to_mapping(value)
    return [plain(entry) for entry in value] if isinstance(value, tuple) else value


def with_values(record: Any, settings: Mapping[str, Any], prefix: str = '') -> Any:
    """
    Return a record with some values replaced, also in the records inside it.

    Parameters
    ----------
    record : CheckedRecord
    settings : mapping
        Dotted names to values. A name may end in ``_deg``.
    prefix : str, optional
        Names that lead to the record, for error messages.

    Raises
    ------
    ParameterError
        If a name is unknown or a value not usable.

    """
    # All fields of a record are arguments of its class.
    names, found = record.__dict__.keys(), dict[str, Any]()
    inside: dict[str, dict[str, Any]] = {}
    for dotted, value in settings.items():
        key, dot, rest = dotted.partition('.')
        name = key.removesuffix('_deg')
        if name not in names:
            raise ParameterError(f'unknown name {quoted(prefix + key)}; {nearest(name, names)}')
        if dot:
            if not is_dataclass(getattr(record, name)):
                raise ParameterError(f'{prefix}{name} is a value, it has no parts')
            inside.setdefault(name, {})[rest] = value
        elif name in found:
            raise ParameterError(f'{prefix}{name} is given twice, as {name} and as {name}_deg')
        else:
            found[name] = value if name == key else _radians(key, value, type(record), prefix)
    for name, values in inside.items():
        part = found.get(name, getattr(record, name))
        if not is_dataclass(part):
            raise ParameterError(
                f'{prefix}{name} must be a mapping of names to values, got {quoted(part)}'
            )
        found[name] = with_values(part, values, f'{prefix}{name}.')
    try:
        return type(record)(**record.__dict__ | found)
    except ParameterError as error:
        raise ParameterError(f'{prefix}{error}') from None


def nearest(name: Any, names: Any) -> str:
    """Return a hint for an unknown name: the nearest known one, or all of them."""
    text = cut(name if isinstance(name, str) else quoted(name))
    close = difflib.get_close_matches(text, list(names), n=1)
    return f'did you mean {close[0]!r}?' if close else f'choose from: {", ".join(sorted(names))}'


def _radians(key: str, value: Any, cls: type, prefix: str) -> Any:
    name = key.removesuffix('_deg')
    unit = {item.name: item.metadata.get('unit', '') for item in fields(cls)}[name]
    if not unit.startswith('rad'):
        raise ParameterError(f'{prefix}{key}: {name} is not an angle')
    if isinstance(value, (list, tuple, np.ndarray)):
        return tuple(math.radians(_converted(key, entry, float)) for entry in value)
    return math.radians(_converted(key, value, float))
