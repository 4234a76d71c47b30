# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random changes of files: of their bytes, of the values in their YAML, of arrays and messages."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from functools import cache
from io import BytesIO
import json
from random import Random
import struct
from typing import Any

import numpy as np
import yaml

from snake_sim_ros.scene.parameters import Array

# Values that YAML may hold and no scene means, each of which once broke a program somewhere.
HOSTILE = (
    *('2001-99-99', '2024-02-30', '!!int abc', '!!bool maybe', '!!float ""', '!!timestamp x'),
    *('0x_', '0o8', '1:60:60', '1_000', '+', '-', '.', '~', 'null', 'true', 'no', '""', '"\\0"'),
    *('.nan', '.inf', '-.inf', '1e999', '1e-310', '5e-324', '1e30', '-1e30', '1e15', '1e-9', '0'),
    *('-1', '1', '2', '3', '199', '200', '201', '1000000', '1e9', '9223372036854775808'),
    *('9' * 5000, '0x' + 'f' * 5000, '1' + ':59' * 300, '"' + 'a' * 256 + '"', 'x' * 20_000),
    *(
        '[' * 3000,
        '[' * 60 + ']' * 60,
        '{a: ' * 60 + '1' + '}' * 60,
        '[]',
        '{}',
        '[[]]',
        '[[1], 2]',
    ),
    *(
        '&a [*a]',
        '&a {a: *a}',
        '*nothing',
        '<<',
        '{<<: 1}',
        '{<<: [{a: 1}]}',
        '{1: 2}',
        '{[1]: 2}',
    ),
    *('!!set {a}', '!!omap [a: 1]', '!!omap 1', '!!pairs [a]', '!!binary x', '!!binary aGVsbG8='),
    *('!!python/object/apply:os.system ["true"]', '!!python/tuple [1]', '!nonsense 1', '!!str 1'),
    *('aiko', 'nowhere', '../../../etc/passwd', '/dev/zero', '/', '.', 'bdf2', 'auto', 'planar'),
    *('[1, 2, 3]', '[1e-310, .nan]', '{low: 1, high: 0}', '{mean: 0, deviation: -1}', '"\\u2028"'),
    '[&b [1, 1, 1, 1, 1, 1, 1, 1, 1, 1], &c [*b, *b, *b, *b, *b, *b, *b, *b, *b, *b], '
    '&d [*c, *c, *c, *c, *c, *c, *c, *c, *c, *c], &e [*d, *d, *d, *d, *d, *d, *d, *d, *d, *d], '
    '&f [*e, *e, *e, *e, *e, *e, *e, *e, *e, *e], [*f, *f, *f, *f, *f, *f, *f, *f, *f, *f]]',
)
TOKENS = (
    *(text.encode() for text in HOSTILE),
    *(b'\x00', b'\xff', b'\xfe\xff', b'\xef\xbb\xbf', b'\r', b'\n---\n', b'\n...\n', b'\t', b'%'),
    *(b'\x85', b'\xe2\x80\xa8', b'"', b"'", b'|', b'>', b'? ', b': ', b'- ', b'#', b'&a ', b'*a'),
    *(struct.pack('<I', 2**32 - 1), struct.pack('<I', 2**31), struct.pack('<q', -1)),
)
NUMBERS = (
    *(np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e308, -1e308, 5e-324, 1e-310, 0.5, 2.0**53),
    *(1e9, 2.0**31, 2.0**63, -(2.0**63)),
)


class Raw(str):
    """A piece of YAML that is written as it is."""

    __slots__ = ()


def changed_bytes(content: bytes, random: Random) -> bytes:
    """Return bytes of which one to five places were changed."""
    found = bytearray(content)
    for _ in range(random.randint(1, 5)):
        at = random.randrange(len(found) + 1)
        until = min(len(found), at + random.choice((1, 2, 8, 64, 512)))
        kind = random.randrange(8)
        if kind == 0 and at < len(found):
            found[at] ^= 1 << random.randrange(8)
        elif kind == 1:
            found[at:until] = random.randbytes(until - at)
        elif kind == 2:
            del found[at:until]
        elif kind == 3:
            found[at:at] = found[at:until] * random.choice((1, 2, 30))
        elif kind == 4:
            found[at:at] = random.choice(TOKENS)
        elif kind == 5:
            found[at:until] = random.choice(TOKENS)
        elif kind == 6:
            del found[at:]
        else:
            there = random.randrange(len(found) + 1)
            found[at:until] = found[there : there + 64]
    return bytes(found)


def changed_yaml(random: Random, text: str) -> bytes:
    """Return YAML whose values were replaced, doubled, nested, moved, tagged, or made aliases."""
    tree = deepcopy(_parsed(text))
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        places = list(_places(tree))
        if not places:
            break
        holder, key = random.choice(places)
        holder[key] = _changed(random, holder[key], [holder[key] for holder, key in places])
        if isinstance(holder, dict) and random.random() < 0.1:
            holder[Raw(random.choice(HOSTILE))] = holder.pop(key)
    return _written(tree).encode(errors='surrogatepass')


@cache
def _parsed(text: str) -> Any:
    return yaml.safe_load(text)


def _changed(random: Random, value: Any, others: list[Any]) -> Any:
    """Return another value for one in a tree."""
    kind = random.randrange(10)
    if kind < 3:
        return Raw(random.choice(HOSTILE))
    if kind == 3:
        return Raw(repr(random.choice((1, -1)) * 10.0 ** random.uniform(-320, 308)))
    if kind == 4:
        return random.choice((1, -1)) * random.getrandbits(random.choice((3, 8, 16, 70)))
    if kind == 5:
        return [deepcopy(value) for _ in range(random.choice((0, 1, 2, 3, 11, 300)))]
    if kind == 6:
        return deepcopy(random.choice(others))
    if kind == 7:
        return Raw(f'&x{random.randrange(9)} {_written(value)}')
    if kind == 8:
        return Raw(f'*x{random.randrange(9)}')
    tag = random.choice(('int', 'float', 'bool', 'null', 'str', 'seq', 'map', 'set', 'omap'))
    return Raw(f'!!{tag} {_written(value)}')


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Yield all that holds a value in a tree, and where."""
    items: Any = ()
    if isinstance(tree, dict):
        items = tree.items()
    elif isinstance(tree, list):
        items = enumerate(tree)
    for key, value in list(items):
        yield tree, key
        yield from _places(value)


def _written(tree: Any) -> str:
    """Return a tree as YAML in one line."""
    if isinstance(tree, Raw):
        return str(tree)
    if isinstance(tree, dict):
        return '{' + ', '.join(f'{_written(k)}: {_written(v)}' for k, v in tree.items()) + '}'
    if isinstance(tree, list):
        return '[' + ', '.join(map(_written, tree)) + ']'
    return json.dumps(tree, default=str)


def changed_arrays(arrays: Mapping[str, Array], random: Random) -> bytes:
    """Return an npz file with arrays of which some have other values, types or shapes, or none."""
    found = dict(arrays)
    for _ in range(random.choice((1, 1, 2, 3))):
        name = random.choice(list(found))
        array, kind = found[name], random.randrange(8)
        if kind == 0 and len(found) > 1:
            del found[name]
        elif kind == 1:
            kinds = ('U', 'O') if array.dtype.kind in 'USO' else ('S', '?', 'i1', 'f4', 'c16', 'O')
            with np.errstate(invalid='ignore'):
                found[name] = array.astype(random.choice(kinds))
        elif kind == 2:
            found[name] = np.resize(
                array, [random.randrange(4) for _ in range(random.randrange(4))]
            )
        elif kind == 3:
            found[name] = np.zeros(random.choice(((0,), (10**6,), (1,) * 30, (3, 0, 7))))
        elif kind == 4:
            found[name] = random.choice(list(found.values()))
        elif kind == 5 and array.dtype.kind == 'U' and not array.shape:
            text = str(array)
            if random.random() < 0.5:
                found[name] = np.array(changed_bytes(text.encode(), random).decode('latin-1'))
            else:
                found[name] = np.array(changed_yaml(random, text).decode(errors='replace'))
        elif array.dtype.kind in 'fi' and array.size:
            with np.errstate(invalid='ignore', over='ignore'):
                other = array.copy()
                other.flat[random.randrange(array.size)] = np.array(random.choice(NUMBERS)).astype(
                    array.dtype
                )
            found[name] = other
    buffer = BytesIO()
    with np.errstate(invalid='ignore'):
        np.savez_compressed(buffer, **found)  # type: ignore[arg-type]
    return buffer.getvalue()


def changed_message(random: Random, content: bytes) -> bytes:
    """Return a serialized message with other numbers, counts or texts."""
    found, kind = bytearray(content), random.randrange(4)
    at = random.randrange(0, max(len(found) - 8, 1), 4)
    if kind == 0:
        found[at : at + 8] = struct.pack('<d', random.choice(NUMBERS))
    elif kind == 1:
        found[at : at + 4] = struct.pack(
            '<I', random.choice((0, 1, 2, 3, 10**6, 2**31, 2**32 - 1))
        )
    elif kind == 2:
        return changed_bytes(content, random)
    else:
        found[at : at + 8] = struct.pack('<d', random.choice(NUMBERS))
        found[at + 8 : at + 16] = struct.pack('<d', random.choice(NUMBERS))
    return bytes(found)
