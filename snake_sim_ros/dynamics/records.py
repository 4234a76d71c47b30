# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Machine code that Python calls, and records that it reaches by their address.

Numba passes a NamedTuple by value. That of a model or a workspace holds the headers of up to 200
arrays, which every call copies, and which the compiler carries through all functions. Here a
record is a block of words in memory, and an argument is one address. What is in a block does not
change as long as it lives, so that the compiler may read a word once for a whole loop. What is in
the arrays may change.
"""

from collections.abc import Callable
import ctypes
from functools import cache
from importlib import import_module
import struct
from typing import Any

from llvmlite import binding
import numpy as np

from snake_sim_ros.dynamics.compilation import (
    begin_to_compile,
    COMPILER,
    COMPILES,
    decorated,
    F,
    Function,
    Primitive,
)
from snake_sim_ros.scene.parameters import Array

RETURNED = 0, -2  # what machine code of Numba returns at the end: a value, or None
RAISED = -(2**62)  # in place of the integer of a call that raised an error
WORDS = {'float64': 'd', 'int64': 'q', 'boolean': 'q', 'none': ''}  # as of `struct`
WORD = 8  # bytes
_raised = ctypes.c_void_p()
NOTHING = ctypes.addressof(_raised)  # where machine code says what it raises
Call = Callable[[int, int, Any], int]  # of addresses for value and error, and a record
CALL: Any = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)


def kind_of(value: Any, words: list[Any]) -> Any:
    """
    Append the words of a value, and return what its type in compiled code is found by.

    It is a name for a number or None, (dtype, dimensions) for an array, and the class and the
    kinds of the fields for a tuple. The words of an array are its address and its shape.
    """
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError(
                f'arrays for machine code must be C-contiguous, got strides {value.strides}'
            )
        words.append(address_of(value))
        words.extend(value.shape)
        return value.dtype, value.ndim
    if isinstance(value, tuple):
        return type(value), *[kind_of(part, words) for part in value]
    if value is None:
        return 'none'
    words.append(value)
    if isinstance(value, float):
        return 'float64'
    return 'boolean' if isinstance(value, (bool, np.bool_)) else 'int64'


def address_of(array: Array) -> int:
    """Return where the numbers of an array are."""
    buffer: Any = array
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(buffer))  # sooner than the next
    except (BufferError, TypeError, ValueError):  # an array that is read-only or empty
        address: int = array.__array_interface__['data'][0]
        return address


@cache
def layout_of(kinds: tuple[Any, ...]) -> struct.Struct:
    """Return the layout of the words of some kinds, and a last word, since there may be none."""
    return struct.Struct(''.join(map(_format_of, kinds)) + 'q')


def _format_of(kind: Any) -> str:
    if isinstance(kind, str):
        return WORDS[kind]
    if isinstance(kind[0], np.dtype):
        return (1 + kind[1]) * 'q'
    return ''.join(map(_format_of, kind[1:]))


def text_of(kind: Any) -> str:
    """Return a kind as text, the same in every process."""
    if isinstance(kind, tuple):
        return f'({" ".join(map(text_of, kind))})'
    return f'{kind.__module__}.{kind.__qualname__}' if isinstance(kind, type) else str(kind)


def modules_of(kind: Any) -> set[str]:
    """Return the modules of all classes of tuples in a kind."""
    if isinstance(kind, tuple):
        return set().union(*map(modules_of, kind))
    return {kind.__module__} if isinstance(kind, type) and kind is not tuple else set()


class Block:
    """
    The words of a record, for compiled functions; where nothing is compiled, only the record.

    Parameters
    ----------
    record : NamedTuple
        Numbers, None, C-contiguous arrays, and such records.

    Attributes
    ----------
    record : NamedTuple
    kind : tuple or None
        Its class and the kinds of its fields, see `kind_of`; None where nothing is compiled.
    words : bytes

    """

    def __init__(self, record: Any) -> None:
        self.record = record
        self.kind: Any = None
        if COMPILES:
            words: list[Any] = []
            self.kind = kind_of(record, words)
            self.words = layout_of((self.kind,)).pack(*words, 0)[:-WORD]


class Entry(Function):
    """A function whose machine code Python calls, without the compiler if it is on disk."""

    def __init__(self, function: Callable[..., Any], kind: str) -> None:
        super().__init__(function, kind)
        self.codes: dict[tuple[Any, ...], int] = {}  # addresses of the machine code
        self._calls: dict[tuple[Any, ...], tuple[struct.Struct, Call]] = {}
        self._last: dict[int, tuple[Any, Any, list[Any]]] = {}  # by place, see `_read`
        self._gives: Any = function.__annotations__.get('return')
        self._result: Any = ctypes.c_double if self._gives is float else ctypes.c_int64

    def code_for(self, kinds: tuple[Any, ...]) -> int:
        """Return the address of the machine code for arguments of some kinds."""
        if kinds not in self.codes:
            shelf, path = self.shelf, self.shelf.path(text_of(kinds), modules_of(kinds))
            content = shelf.load(path)
            if content is None:
                begin_to_compile(self)
                content = import_module(COMPILER).machine_code(self, kinds)
                shelf.save(path, content)
            self.codes[kinds] = loaded(content)
        return self.codes[kinds]

    def __call__(self, *arguments: Any) -> Any:
        """Call the machine code with numbers, C-contiguous arrays, and tuples of them."""
        words: list[Any] = []
        kinds = tuple([self._read(k, part, words) for k, part in enumerate(arguments)])
        if kinds not in self._calls:
            self._calls[kinds] = layout_of(kinds), CALL(self.code_for(kinds))
        layout, call = self._calls[kinds]
        value = self._result()
        check(self, call(ctypes.addressof(value), NOTHING, layout.pack(*words, 0)))
        if self._gives is None:
            return None
        return bool(value.value) if self._gives is bool else value.value

    def _read(self, k: int, argument: Any, words: list[Any]) -> Any:
        """Append the words of argument k; return its kind. A record that stays is read once."""
        if type(argument) in (np.ndarray, tuple) or not isinstance(argument, tuple):
            return kind_of(argument, words)
        last = self._last.get(k)
        if not (last and last[0] is argument):
            found: list[Any] = []
            last = self._last[k] = argument, kind_of(argument, found), found
        words.extend(last[2])
        return last[1]


def entry(function: F) -> F:
    """
    Return `function` compiled for calls from Python, without Numba once its code is on disk.

    See `compilation.compiled`. Its arguments are numbers, C-contiguous arrays, None, and tuples of
    these; it returns a number or nothing. Machine code takes all arguments as one record.
    """
    return decorated(function, 'entry', Entry)


def check(function: Any, status: int) -> None:
    """Raise an error if machine code did."""
    if status not in RETURNED:
        raise RuntimeError(f'{function.__name__} raised an error, status {status}')


_engines: list[Any] = []  # that hold the machine code of this process


def loaded(content: bytes) -> int:
    """Return the address of a function, from what `compiler.machine_code` made of it."""
    name, _, code = content.partition(b'\0')
    if not _engines:
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(''), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    address: int = engine.get_function_address(name.decode())
    return address


class BoundCall:
    """
    A call of a compiled function with records that stay. It releases the GIL.

    Parameters
    ----------
    function : callable
        An `entry`. It returns an integer or nothing.
    blocks : Block
        Its arguments.

    Attributes
    ----------
    code, address : int
        Addresses of the machine code, and of the record of all arguments; 0 where nothing is
        compiled.

    """

    code = address = 0

    def __init__(self, function: Any, *blocks: Block) -> None:
        self.function, self.blocks = function, blocks
        self._value = ctypes.c_int64()
        if COMPILES:
            self.code = function.code_for(tuple(block.kind for block in blocks))
            self._call = CALL(self.code)
            # One word more: there is a record without fields.
            words = b''.join([*(block.words for block in blocks), bytes(WORD)])
            self._words = ctypes.create_string_buffer(words, len(words))
            self.address = ctypes.addressof(self._words)
            self._where = ctypes.addressof(self._value)

    def __call__(self) -> int:
        """Call the function; return its integer, 0 if it returns nothing."""
        if not COMPILES:
            return self.function(*(block.record for block in self.blocks)) or 0
        check(self.function, self._call(self._where, NOTHING, self._words))
        return self._value.value


# `call_code(code, address)` makes a `BoundCall` from compiled code, by its addresses. The integer
# of the function is returned, RAISED if it raised an error.
call_code: Any = Primitive('call_code')


@entry
def call_each(calls: Array, rows: Array, values: Array) -> None:
    """
    Make calls one after the other.

    Parameters
    ----------
    calls : ndarray of int64, shape (m, 2)
        Addresses of each `BoundCall`.
    rows : ndarray of int64, shape (k,)
        Which of them are made.
    values : ndarray of int64, shape (m,)
        Filled with the integers that are returned; see `call_code`.

    """
    for i in rows:
        values[i] = call_code(calls[i, 0], calls[i, 1])


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
        return BoundCall(self.func, *self.blocks(model, work), Block(steps))

    def blocks(self, model: Any, work: Any) -> list[Block]:
        """Return the records that stay, as machine code takes them."""
        kept = {id(block.record): block for block in self._blocks}
        records = self.first, model, work
        self._blocks = [kept.get(id(record)) or Block(record) for record in records]
        return self._blocks
