# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How Numba compiles records that functions reach by their address; see `records`."""

import hashlib
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_getattr_generic
from numba.core.types.containers import BaseTuple
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, models, register_model
from numba.np.numpy_support import from_dtype

from snake_sim_ros.dynamics.records import RAISED, RETURNED

WORD = ir.IntType(64)
BYTES = ir.IntType(8).as_pointer()


class RecordType(types.Type):  # type: ignore[misc]
    """
    The type of a record in compiled code: its class, a NamedTuple, and the types of its fields.

    An array has a word for its address and one for each length, any other field one word.
    """

    def __init__(self, cls: Any, kinds: tuple[Any, ...]) -> None:
        self.instance_class, self.kinds = cls, kinds
        sizes = [_size(kind) for kind in kinds]
        self.places = [sum(sizes[:k]) for k in range(len(sizes))]
        self.size = sum(sizes)
        content = ' '.join([cls.__module__, cls.__qualname__, *map(str, kinds)])
        super().__init__(f'{cls.__name__}_{hashlib.sha256(content.encode()).hexdigest()[:12]}')


def _size(kind: Any) -> int:
    """Return the number of words of a field."""
    if isinstance(kind, types.Array):
        return 1 + int(kind.ndim)
    if isinstance(kind, BaseTuple):
        return sum(map(_size, kind.types))
    return int(getattr(kind, 'size', kind is not types.none))


def type_of(kind: Any) -> Any:
    """
    Return the type for one of the kinds of `records.kind_of`.

    A NamedTuple is a record by its address, and a tuple without names one of values.
    """
    if isinstance(kind, str):
        return getattr(types, kind)
    first, *rest = kind
    if not isinstance(first, type):
        return types.Array(from_dtype(first), rest[0], 'C')
    kinds = tuple(map(type_of, rest))
    return BaseTuple.from_types(kinds) if first is tuple else RecordType(first, kinds)


class Arguments(tuple[Any, ...]):
    """The class of the record of all arguments of a function, in their order."""

    _fields = tuple(f'argument_{k}' for k in range(20))


register_model(RecordType)(models.OpaqueModel)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = RecordType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        fields = kind.instance_class._fields
        return kind.kinds[fields.index(name)] if name in fields else None


@lower_getattr_generic(RecordType)  # type: ignore[untyped-decorator]
def _field(context: Any, builder: Any, kind: Any, address: Any, name: str) -> Any:
    k = kind.instance_class._fields.index(name)
    words = builder.bitcast(address, WORD.as_pointer())
    return _value(context, builder, kind.kinds[k], _beyond(builder, words, kind.places[k]))


def _beyond(builder: Any, place: Any, count: int) -> Any:
    """Return the place of a word that comes a number of words later."""
    return builder.gep(place, [WORD(count)], inbounds=True)


def _value(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    """Return the value of some type whose words begin at a place."""
    if isinstance(kind, RecordType):
        return builder.bitcast(place, context.get_value_type(kind))
    if isinstance(kind, types.Array):
        return _array(context, builder, kind, place)
    if isinstance(kind, BaseTuple):
        parts = []
        for part in kind.types:
            parts.append(_value(context, builder, part, place))
            place = _beyond(builder, place, _size(part))
        return context.make_tuple(builder, kind, parts)
    if kind is types.none:
        return context.get_dummy_value()
    model = context.data_model_manager[kind]
    return model.from_data(builder, _word(builder, place, model.get_data_type()))


def _word(builder: Any, place: Any, kind: Any) -> Any:
    """Return a word that never changes, as a value of some type."""
    value = builder.load(builder.bitcast(place, kind.as_pointer()))
    value.set_metadata('invariant.load', builder.module.add_metadata([]))
    return value


def _array(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    """Return the header of an array from its address and lengths."""
    model = context.data_model_manager[kind]
    lengths = [_word(builder, builder.gep(place, [WORD(1 + k)]), WORD) for k in range(kind.ndim)]
    size = WORD(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides, count = [size], WORD(1)
    for length in lengths[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    for length in lengths:
        count = builder.mul(count, length)
    value = ir.Constant(model.get_value_type(), None)
    parts = {
        'data': _word(builder, place, context.get_value_type(model.get_type('data'))),
        'nitems': count,
        'itemsize': size,
        'shape': lengths,
        'strides': strides,
    }
    for name, part in parts.items():
        if isinstance(part, list):
            whole = ir.Constant(ir.ArrayType(WORD, len(part)), ir.Undefined)
            for k, one in enumerate(part):
                whole = builder.insert_value(whole, one, k)
            part = whole
        value = model.set(builder, value, part, name)
    return value


@intrinsic  # type: ignore[untyped-decorator]
def call_code(typing_context: Any, code: Any, address: Any) -> Any:
    """Make a `BoundCall`, see `records.call_code`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), 3 * [BYTES])
        value = cgutils.alloca_once_value(builder, WORD(0))
        raised = cgutils.alloca_once(builder, BYTES)
        places = [builder.bitcast(place, BYTES) for place in (value, raised)]
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        status = builder.call(function, [*places, builder.inttoptr(arguments[1], BYTES)])
        is_end = [builder.icmp_signed('==', status, status.type(end)) for end in RETURNED]
        return builder.select(builder.or_(*is_end), builder.load(value), WORD(RAISED))

    return types.int64(code, address), generate
