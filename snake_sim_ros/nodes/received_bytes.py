# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Messages as the bytes that the middleware delivers, of which some are damaged.

The middleware prints some lines for each message that it cannot read, however many come. Therefore
nodes take bytes, and look at the lengths in them before a message is read.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
import struct
from typing import Any

from rclpy.serialization import deserialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractSequence,
    AbstractString,
    Array,
    BasicType,
)

ENCAPSULATION = 4  # bytes before the body, which name its encoding
ENCODINGS = {b'\x00\x01': '<', b'\x00\x00': '>'}  # CDR, and its order of bytes
LENGTH = 4  # bytes of the length of a list or of a text
NUMBERS = {order: struct.Struct(f'{order}I').unpack_from for order in ENCODINGS.values()}
SIZES = {
    **dict.fromkeys(('boolean', 'octet', 'char', 'int8', 'uint8'), 1),
    **dict.fromkeys(('int16', 'uint16', 'wchar'), 2),
    **dict.fromkeys(('int32', 'uint32', 'float'), 4),
    **dict.fromkeys(('int64', 'uint64', 'double'), 8),
}

# Takes data, a place in it and the order of bytes; returns the place after a field.
Skip = Callable[[bytes, int, str], int]


class DamagedMessage(ValueError):
    """The bytes of a message are not those of its type, or too many for the memory."""


def message_from(data: bytes, kind: Any) -> Any:
    """
    Return the message that some bytes are.

    Parameters
    ----------
    data : bytes
        As a subscription with ``raw=True`` delivers them.
    kind : type
        Of the message.

    Raises
    ------
    DamagedMessage

    """
    order = ENCODINGS.get(bytes(data[:2]))
    try:
        if order is None or _skip_message(kind)(data[ENCAPSULATION:], 0, order) < 0:
            raise DamagedMessage
        return deserialize_message(data, kind)
    except MemoryError:
        raise DamagedMessage(f'there is no memory for a message of {len(data)} bytes') from None
    except (DamagedMessage, struct.error, RuntimeError, UnicodeDecodeError):
        raise DamagedMessage(
            f'a message of {len(data)} bytes is damaged: they are not those of a {kind.__name__}'
        ) from None


def reader(
    kind: Any, take: Callable[[Any], object], refuse: Callable[[DamagedMessage], object]
) -> Callable[[bytes], None]:
    """Return a callback for a subscription with ``raw=True``; it passes on what it reads."""

    def read(data: bytes) -> None:
        try:
            message = message_from(data, kind)
        except DamagedMessage as error:
            refuse(error)
        else:
            take(message)

    return read


@cache
def _skip_message(kind: Any) -> Skip:
    parts = [_skip(field) for field in kind.SLOT_TYPES]

    def skip(data: bytes, place: int, order: str) -> int:
        for part in parts:
            place = part(data, place, order)
        return place

    return skip


def _skip(field: Any) -> Skip:
    """Return a function that skips a field of some type."""
    if isinstance(field, BasicType):
        return lambda data, place, order: _after(data, place, SIZES[field.typename], 1)
    if isinstance(field, AbstractString):
        return _skip_text
    if isinstance(field, AbstractNestedType):
        return _skip_items(field)
    module = import_module('.'.join(field.namespaces))
    return _skip_message(getattr(module, field.name))


def _skip_text(data: bytes, place: int, order: str) -> int:
    return _skip_texts(data, place, order, 1)


def _skip_texts(data: bytes, place: int, order: str, count: int) -> int:
    """Skip some texts, such as the many names of joints, without a call for each."""
    read, end = NUMBERS[order], len(data)
    for _ in range(count):
        place = (place + LENGTH - 1) & -LENGTH
        place += LENGTH + read(data, place)[0]
        if place > end:
            raise DamagedMessage
    return place


def _skip_items(field: Any) -> Skip:
    """Return a function that skips an array or a list."""
    item, size = field.value_type, 0
    each = _skip(item)
    if isinstance(item, BasicType):
        size = SIZES[item.typename]

    def skip(data: bytes, place: int, order: str) -> int:
        if isinstance(field, Array):
            count = field.size
        else:
            assert isinstance(field, AbstractSequence)
            place, count = _length(data, place, order)
        if size:
            return _after(data, place, size, count)
        if count > len(data) - place:  # The shortest item is a byte.
            raise DamagedMessage
        if isinstance(item, AbstractString):
            return _skip_texts(data, place, order, count)
        for _ in range(count):
            place = each(data, place, order)
        return place

    return skip


def _length(data: bytes, place: int, order: str) -> tuple[int, int]:
    """Return the place after a length, and the length."""
    place = -(-place // LENGTH) * LENGTH
    return place + LENGTH, NUMBERS[order](data, place)[0]


def _after(data: bytes, place: int, size: int, repeat: int) -> int:
    """Return the place after some numbers of one size, or raise if there are fewer."""
    if not repeat:
        return place
    place = -(-place // size) * size + size * repeat
    if place > len(data):
        raise DamagedMessage
    return place
