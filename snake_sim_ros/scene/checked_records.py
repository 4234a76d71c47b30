# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Records: frozen dataclasses whose fields know their unit and range, and which check their values.

A record is made from nested mappings, as YAML gives them, and is turned back into such mappings.
An invalid value is refused with one sentence that names it, what was received, what would be right
and, for a misspelt name, the nearest one.

Own code because neither library has these sentences: msgspec checks nothing in constructors, and
names no received value; pydantic takes 0.5 s to import and cannot bound `float | tuple`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
import difflib
from functools import cache
import math
from reprlib import Repr
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

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
    """A number, name or file of a scene is invalid; the message says which and why."""


def quantity(
    default: Any,
    unit: str,
    meaning: str,
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
    longest: int = LONGEST_TEXT,
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
    longest : int
        Most characters of a text.

    """
    limits = {'above': float(above), 'minimum': float(minimum), 'maximum': float(maximum)}
    metadata = {'unit': unit, 'meaning': meaning, 'choices': choices, 'longest': longest}
    metadata |= limits
    return field(default=default, metadata=metadata)


@cache
def _type_hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


@cache
def _fields_of(cls: type) -> tuple[tuple[str, Any, Any, tuple[float, float, float] | None], ...]:
    """Return name, type, limits and, of a float, (above, at least, at most) of the fields."""
    hints, found = _type_hints(cls), []
    for item in fields(cls):
        limits, bounds = item.metadata, None
        if hints[item.name] is float and limits:
            bounds = limits['above'], max(limits['minimum'], -MOST), min(limits['maximum'], MOST)
        found.append((item.name, hints[item.name], limits, bounds))
    return tuple(found)


@cache
def _kinds_of(kind: Any) -> tuple[Any, ...]:
    """Return the types that a union consists of."""
    return get_args(kind) if isinstance(kind, UnionType) else (kind,)


def _checked(name: str, value: Any, kind: Any, limits: Mapping[str, Any] | None = None) -> Any:
    """Return `value` as `kind`, within limits; text and truth values never become numbers."""
    kinds = _kinds_of(kind)
    if value is None and NoneType in kinds:
        return None
    if isinstance(value, bool) and bool in kinds:
        return value
    if isinstance(value, str) and str in kinds:
        return _checked_text(name, value, limits)
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if int in kinds and number.is_integer():
            return _checked_number(name, int(value), limits)
        if float in kinds:
            return _checked_number(name, number, limits)
    wanted = KIND_NAMES.get(kinds[0], 'numbers')
    if is_dataclass(kind):
        if isinstance(value, kind):  # type: ignore[arg-type]
            return value
        if kind is NamedRecord:
            return NamedRecord.of(value, name)
        wanted = 'a mapping of names to values'
    for listed in (each for each in kinds if get_origin(each) is tuple):
        entry = get_args(listed)[0]
        if type(value) is tuple and entry is float and _are_floats(value, limits):
            return value
        if isinstance(value, (list, tuple, np.ndarray)):
            if not is_dataclass(entry):
                return tuple(_checked(name, each, entry, limits) for each in value)
            return tuple(
                each if isinstance(each, entry) else from_mapping(entry, each, f'{name}[{k}]')  # type: ignore[arg-type]
                for k, each in enumerate(value)
            )
        if is_dataclass(entry):
            wanted = 'a list of mappings of names to values'
    raise ParameterError(f'{name} must be {wanted}, got {quoted(value)}')


def _are_floats(values: tuple[Any, ...], limits: Mapping[str, Any] | None) -> bool:
    """Return whether all values are floats within limits: fast path of tables of 100 000."""
    if {*map(type, values)} != {float} or limits is None or not math.isfinite(sum(values)):
        return False
    smallest, largest = min(values), max(values)
    return bool(
        limits['above'] < smallest
        and max(limits['minimum'], -MOST) <= smallest
        and largest <= min(limits['maximum'], MOST)
    )


def _checked_text(name: str, value: str, limits: Mapping[str, Any] | None) -> str:
    """Return a text that is among the choices and not too long."""
    choices = limits['choices'] if limits else ()
    if choices and value not in choices:
        raise ParameterError(f'{name} must be one of {", ".join(choices)}; got {quoted(value)}')
    longest = limits['longest'] if limits else LONGEST_TEXT
    if len(value) > longest:
        raise ParameterError(f'{name} must have at most {longest} characters, got {quoted(value)}')
    return value


def _checked_number(name: str, value: Any, limits: Mapping[str, Any] | None) -> Any:
    """Return a number that is finite and in range."""
    if limits is None:
        return value
    low, high = max(limits['minimum'], -MOST), min(limits['maximum'], MOST)
    if value > limits['above'] and low <= value <= high:
        return value
    unit = '' if limits['unit'] in ('', '1') else f' {limits["unit"]}'
    if not math.isfinite(value):
        raise ParameterError(f'{name} must be finite, got {value}{unit}')
    if not value > limits['above']:
        bound = f'above {limits["above"]:g}'
    else:
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
        given = vars(self)
        for name, kind, limits, bounds in _fields_of(type(self)):  # type: ignore[arg-type]
            value = given[name]
            if bounds:  # nearly all are right: records are made thousands of times
                if type(value) is float and bounds[0] < value and bounds[1] <= value <= bounds[2]:
                    continue
            elif type(value) is kind and isinstance(value, CheckedRecord):
                continue
            checked = _checked(name, value, kind, limits)
            if checked is not value:
                object.__setattr__(self, name, checked)


FURTHER = quantity(0.0, '', 'what the name makes of it').metadata


@dataclass(frozen=True, kw_only=True)
class NamedRecord(CheckedRecord):
    """
    What is chosen by name, with further values whose names only those know who have that name.

    In mappings the values stand beside the name, and a text alone is the name.

    Attributes
    ----------
    name : str
    values : tuple of (str, value)
        Numbers, texts, truth values, or tuples of them.

    """

    name: str = quantity('', '', 'name of the choice')
    values: tuple[tuple[str, Any], ...] = ()

    def __post_init__(self) -> None:
        """Check name and values."""
        object.__setattr__(self, 'name', _checked('name', self.name, str))
        found = {name: _further(name, value) for name, value in self.values}
        object.__setattr__(self, 'values', tuple(found.items()))
        if found and not self.name:
            raise ParameterError(f'{next(iter(found))} needs a name beside it')

    def __bool__(self) -> bool:
        """Return whether something is chosen."""
        return bool(self.name)

    @staticmethod
    def of(given: Any, where: str) -> 'NamedRecord':
        """Return a record from a name, or from a mapping with `name` and the values."""
        given = {'name': given} if isinstance(given, str) else given
        if not isinstance(given, Mapping):
            raise ParameterError(
                f'{where} must be a name, or a mapping with a name, got {quoted(given)}'
            )
        values = {key: value for key, value in given.items() if key != 'name'}
        try:
            return NamedRecord(name=given.get('name', ''), values=tuple(values.items()))
        except ParameterError as error:
            raise ParameterError(f'{where}: {error}') from None

    def mapping(self) -> dict[str, Any]:
        """Return the mapping of which `of` makes the record."""
        return {'name': self.name} | {name: plain(value) for name, value in self.values}

    def changed(self, settings: Mapping[str, Any], where: str) -> 'NamedRecord':
        """Return the record with some values replaced; with another name it has no others."""
        given = {} if settings.get('name', self.name) != self.name else dict(self.values)
        return NamedRecord.of({'name': self.name, **given, **settings}, where)


def _further(name: Any, value: Any) -> Any:
    """Return a value of a `NamedRecord`."""
    if not (isinstance(name, str) and name.isidentifier()):
        raise ParameterError(f'names of values must be words, got {quoted(name)}')
    if isinstance(value, (list, tuple, np.ndarray)):
        return tuple(_further(name, each) for each in value)
    if isinstance(value, (bool, str, int)):
        return _checked(name, value, bool | int | str, FURTHER)
    return _checked(name, value, float, FURTHER)


def flat_fields(record: Any, prefix: str = '') -> dict[str, tuple[Any, Mapping[str, Any]]]:
    """Return dotted name -> (value, metadata of the field) of a record and those inside it."""
    flat: dict[str, tuple[Any, Mapping[str, Any]]] = {}
    if isinstance(record, NamedRecord):
        named = type(record).__dataclass_fields__['name'].metadata
        flat = {f'{prefix}{name}': (value, FURTHER) for name, value in record.values}
        return {f'{prefix}name': (record.name, named), **flat}
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
    if cls is NamedRecord:
        return NamedRecord.of(mapping, where)
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
    if isinstance(record, NamedRecord):
        return record.mapping()
    return {item.name: plain(getattr(record, item.name)) for item in fields(record)}


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
    if isinstance(record, NamedRecord):
        return record.changed(settings, prefix.removesuffix('.'))
    given, found = values_of(record), dict[str, Any]()
    names = given.keys()
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
        return type(record)(**given | found)
    except ParameterError as error:
        raise ParameterError(f'{prefix}{error}') from None


def values_of(record: Any) -> dict[str, Any]:
    """Return the values of a record by name, as its class takes them."""
    return {item.name: getattr(record, item.name) for item in fields(record)}


def check_components(name: str, value: tuple[float, ...], count: int) -> None:
    """Raise an error if a point or vector has not `count` components."""
    if len(value) != count:
        raise ParameterError(f'{name} must have {count} components, got {len(value)}')


def scaled(value: Any, factor: float) -> Any:
    """Return a number of a record, or all numbers of a list in it, times a factor."""
    if isinstance(value, tuple):
        return tuple(scaled(entry, factor) for entry in value)
    return value * factor


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
        return tuple(math.radians(_checked(key, entry, float)) for entry in value)
    return math.radians(_checked(key, value, float))
