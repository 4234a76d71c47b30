# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Records that compiled functions reach by their address, and calls of functions with them.

Numba passes a NamedTuple by value. That of a model or a workspace holds the headers of up to 200
arrays, which every call copies, and which the compiler carries through all functions. Here a
record is a block of words in memory, and an argument is one address. What is in a block does not
change as long as it lives, so that the compiler may read a word once for a whole loop. What is in
the arrays may change.
"""

from collections.abc import Callable
import ctypes
from functools import cache
import hashlib
import struct
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, models, register_model
from numba.np.numpy_support import from_dtype
import numpy as np

from snake_sim_ros.dynamics.compilation import compiled, COMPILES
from snake_sim_ros.scene.parameters import Array

WORD = ir.IntType(64)
BYTES = ir.IntType(8).as_pointer()
RETURNED = 0, -2  # what machine code of Numba returns at the end: a value, or None
RAISED = -(2**62)  # in place of the integer of a call that raised an error
_nothing = ctypes.c_void_p()  # where it says what it raises


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
        self.format = ''.join(map(_format, kinds))
        content = ' '.join([cls.__module__, cls.__qualname__, *map(str, kinds)])
        super().__init__(f'{cls.__name__}_{hashlib.sha256(content.encode()).hexdigest()[:12]}')


def _size(kind: Any) -> int:
    """Return the number of words of a field."""
    if isinstance(kind, types.Array):
        return 1 + int(kind.ndim)
    return int(getattr(kind, 'size', kind is not types.none))


def _format(kind: Any) -> str:
    """Return the words of a field, as of `struct`."""
    if isinstance(kind, RecordType):
        return kind.format
    return 'd' if kind is types.float64 else _size(kind) * 'q'


@cache
def _type_of(key: Any) -> Any:
    """Return the type for what `_read` returns."""
    if not isinstance(key, tuple):
        return key
    first, *rest = key
    if isinstance(first, np.dtype):
        return types.Array(from_dtype(first), rest[0], 'C')
    return RecordType(first, tuple(map(_type_of, rest)))


def _read(value: Any, words: list[Any]) -> Any:
    """Append the words of a value, and return what its type is found by."""
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError(
                f'arrays of a record must be C-contiguous, got strides {value.strides}'
            )
        words.append(value.__array_interface__['data'][0])  # `ctypes.data` takes a us
        words.extend(value.shape)
        return value.dtype, value.ndim
    if isinstance(value, tuple):
        return type(value), *[_read(part, words) for part in value]
    if value is None:
        return types.none
    words.append(value)
    if isinstance(value, float):
        return types.float64
    return types.boolean if isinstance(value, (bool, np.bool_)) else types.int64


class Block:
    """
    A record in memory, for compiled functions; where nothing is compiled, only the record.

    Parameters
    ----------
    record : NamedTuple
        Numbers, None, C-contiguous arrays, and such records.

    Attributes
    ----------
    record : NamedTuple
    kind : RecordType
    address : int

    """

    def __init__(self, record: Any) -> None:
        self.record = record
        if not COMPILES:
            return
        words: list[Any] = []
        self.kind = _type_of(_read(record, words))
        # One word more: there is a record without fields, and no array of an empty buffer.
        self._words = np.frombuffer(struct.pack(self.kind.format + 'q', *words, 0), np.int64)
        self.address = self._words.ctypes.data


def type_of(value: Any) -> Any:
    """Return the type of a value in compiled code, that of a record by its address."""
    return _type_of(_read(value, []))


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


class BoundCall:
    """
    A call of a compiled function with records that stay. It releases the GIL.

    Parameters
    ----------
    function : callable
        A compiled function. It returns an integer or nothing.
    blocks : Block
        Its arguments.

    Attributes
    ----------
    code : int
        Address of the machine code; 0 where nothing is compiled.

    """

    code = 0

    def __init__(self, function: Callable[..., Any], *blocks: Block) -> None:
        self.function, self.blocks = function, blocks
        self._value = ctypes.c_int64()
        if COMPILES:
            self._call = _machine_code(function, tuple(block.kind for block in blocks))
            self.code = _address(self._call)
            self._addresses = (
                ctypes.addressof(self._value),
                ctypes.addressof(_nothing),
                *(block.address for block in blocks),
            )

    def __call__(self) -> int:
        """Call the function; return its integer, 0 if it returns nothing."""
        if not COMPILES:
            return self.function(*(block.record for block in self.blocks)) or 0
        status = self._call(*self._addresses)
        if status not in RETURNED:
            raise RuntimeError(f'{self.function.__name__} raised an error, status {status}')
        return self._value.value


def _address(call: Any) -> int:
    """Return the address of machine code."""
    return int(ctypes.cast(call, ctypes.c_void_p).value or 0)


@cache
def _machine_code(function: Any, kinds: tuple[Any, ...]) -> Callable[..., int]:
    """Return the machine code of a function for records of some types."""
    function.compile(kinds)
    found = function.overloads[kinds]
    address = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
    pointers = (2 + len(kinds)) * [ctypes.c_void_p]
    return ctypes.CFUNCTYPE(ctypes.c_int32, *pointers)(address)


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


@compiled
def call_each(calls: Array, rows: Array, values: Array) -> None:
    """
    Make calls with one block each, one after the other.

    Parameters
    ----------
    calls : ndarray of int64, shape (m, 2)
        Addresses of the machine code and of its block; see `BoundCall`.
    rows : ndarray of int64, shape (k,)
        Which of them are made.
    values : ndarray of int64, shape (m,)
        Filled with the integers that are returned; see `call_code`.

    """
    for i in rows:
        values[i] = call_code(calls[i, 0], (calls[i, 1],))


class Loop:
    """
    A compiled loop over steps, whose first argument stays.

    Parameters
    ----------
    func : callable
        Compiled ``advance(first, model, work, steps)``, as `stepping.steps.advance`.
    first : NamedTuple
        The integrator: its type chooses the step.

    """

    def __init__(self, func: Callable[..., Any], first: Any) -> None:
        self.func, self.first = func, first
        self._blocks: list[Block] = []

    def __call__(self, model: Any, work: Any, steps: Any) -> None:
        """Take steps."""
        self.bound(model, work, steps)()

    def bound(self, model: Any, work: Any, steps: Any) -> BoundCall:
        """Return the call that takes steps, as often as it is made."""
        kept = {id(block.record): block for block in self._blocks}
        records = self.first, model, work
        self._blocks = [kept.get(id(record)) or Block(record) for record in records]
        return BoundCall(self.func, *self._blocks, Block(steps))
