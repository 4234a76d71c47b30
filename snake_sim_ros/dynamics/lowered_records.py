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

from snake_sim_ros.dynamics.records import ByAddress, RAISED, RETURNED

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
    return int(getattr(kind, 'size', kind is not types.none))


def type_of(kind: Any) -> Any:
    """Return the type for one of the kinds of `records.kind_of`."""
    match kind:
        case ByAddress(record):
            return RecordType(record[0], tuple(map(_field_type, record[1:])))
        case str():
            return getattr(types, kind)
        case type(), *parts:
            return BaseTuple.from_types(
                tuple(map(type_of, parts)), None if kind[0] is tuple else kind[0]
            )
    return types.Array(from_dtype(kind[0]), kind[1], 'C')


def _field_type(kind: Any) -> Any:
    """Return the type of a field: a record in a record is by its address, too."""
    is_record = isinstance(kind, tuple) and isinstance(kind[0], type)
    return type_of(ByAddress(kind) if is_record else kind)


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
    place = builder.gep(words, [WORD(kind.places[k])], inbounds=True)
    field = kind.kinds[k]
    if isinstance(field, RecordType):
        return builder.bitcast(place, context.get_value_type(field))
    if isinstance(field, types.Array):
        return _array(context, builder, field, place)
    if field is types.none:
        return context.get_dummy_value()
    model = context.data_model_manager[field]
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
def call_code(typing_context: Any, code: Any, blocks: Any) -> Any:
    """
    Call machine code from compiled code, with the addresses of its blocks, a tuple.

    It is that of a `BoundCall`. Its integer is returned, RAISED if it raised an error.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        parts = cgutils.unpack_tuple(builder, arguments[1])
        kind = ir.FunctionType(ir.IntType(32), (2 + len(parts)) * [BYTES])
        value = cgutils.alloca_once_value(builder, WORD(0))
        raised = cgutils.alloca_once(builder, BYTES)
        given = [builder.inttoptr(part, BYTES) for part in parts]
        places = [builder.bitcast(place, BYTES) for place in (value, raised)]
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        status = builder.call(function, [*places, *given])
        is_end = [builder.icmp_signed('==', status, status.type(end)) for end in RETURNED]
        return builder.select(builder.or_(*is_end), builder.load(value), WORD(RAISED))

    return types.int64(code, blocks), generate
