# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Functions that are compiled, and what Python needs to call them.

The compiler is Numba, which takes longer to import than all else together. It is imported when
something is compiled, by `compiler`; what was compiled before is loaded without it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, update_wrapper
from importlib import import_module
import platform
from typing import Any, Generic, get_type_hints, overload, ParamSpec, TypeVar

import numpy as np

from snake_sim_ros.dynamics.code_cache import DISABLED, Shelf

COMPILES = not DISABLED  # whether anything is compiled
# Others have no counter of cycles that a program may read: on ARM the instruction may end it.
COUNTS_CYCLES = COMPILES and platform.machine() in ('x86_64', 'AMD64')
COMPILER = 'snake_sim_ros.dynamics.compiler'


# A function, which keeps its signature, and the parts of one.
F = TypeVar('F', bound=Callable[..., Any])
P = ParamSpec('P')
Result = TypeVar('Result')


class Function:
    """
    A function that is compiled for the types of its arguments, when it is called.

    Attributes
    ----------
    py_func : callable
        What is compiled.
    kind : str
        The decorator that made it.
    shelf : Shelf
        Its machine code on disk.

    """

    def __init__(self, function: Callable[..., Any], kind: str) -> None:
        update_wrapper(self, function)
        self.py_func, self.kind, self.shelf = function, kind, Shelf(function)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call it by Numba, which compiles it for any types."""
        if self.kind != 'compiled':
            raise TypeError(f'{self.py_func.__name__} is called by compiled functions only')
        return import_module(COMPILER).python_dispatcher_of(self)(*arguments, **named)


def compiled(function: F) -> F:
    """
    Return `function` compiled on its first call, or as it is with NUMBA_DISABLE_JIT=1.

    Every operation is rounded as written. With fast math, a function that was just compiled and
    the same one from the cache differ in their last bits, and a run could not be repeated exactly.
    A function that allocates memory does not compile. What a run calls from Python is an `entry`
    instead, see `records`: this kind of call imports the compiler.
    """
    return decorated(function, 'compiled')


def inlined(function: F) -> F:
    """
    Return `function` compiled into each of its callers, as only compiled functions are.

    A call copies the headers of all array arguments, which often costs more than the work itself.
    """
    return decorated(function, 'inlined')


def decorated(function: F, kind: str, cls: type[Function] = Function) -> F:
    """Return a `Function` in place of one of Python, if anything is compiled."""
    made: Any = cls(function, kind) if COMPILES else function
    return made


class Dispatched(Generic[P, Result]):
    """
    A function like those of `functools.singledispatch` that compiled functions can call, too.

    The type of the first argument, a class of NamedTuple, chooses the implementation: a compiled
    function that was given to ``register(cls)``.

    By this, one loop over steps serves all methods. The cache on disk cannot hold compiled
    functions that are arguments of others or come from a closure, because they differ in each
    process. It does distinguish types. Loops that differ in more than a type, as those of methods
    with one and with two steps do, are separate functions at the top of a module.
    """

    def __init__(self, function: Callable[P, Result]) -> None:
        update_wrapper(self, function)
        self.name = f'{function.__module__}.{function.__qualname__}'
        self.implementations: dict[Any, Any] = {}

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> Result:
        """Call the implementation for the type of the first argument; none is named."""
        result: Result = self.implementations[type(arguments[0])](*arguments)
        return result

    def register(self, cls: type) -> Callable[[F], F]:
        """Return a decorator of the compiled implementation for a class."""

        def add(implementation: F) -> F:
            if COMPILES and not isinstance(implementation, Function):
                raise TypeError(f'{implementation} must be compiled to be registered')
            self.implementations[cls] = implementation
            return implementation

        return add


_tellers: list[Callable[[str], object]] = []


@contextmanager
def watched(tell: Callable[[str], object]) -> Iterator[None]:
    """
    Report the name of every function that is not in the cache, before it is compiled.

    It is not compiled if `tell` raises an error.
    """
    _tellers.append(tell)
    try:
        yield
    finally:
        _tellers.remove(tell)


def begin_to_compile(function: Function) -> None:
    """Report the name of a function; if that raises an error, another process may compile it."""
    try:
        for tell in _tellers:
            tell(function.py_func.__name__)
    except BaseException:
        function.shelf.unlock()
        raise


Record = TypeVar('Record')


class Table(Generic[Record]):
    """
    Records whose fields are attributes, as compiled functions see an array of them.

    Where nothing is compiled they are an object of this class, because Python takes microseconds
    to reach a field of a np.recarray.
    """

    def __init__(self, records: Any) -> None:
        self.records = records.view(np.recarray)
        for name in records.dtype.names:
            column = records[name]
            setattr(self, name, column if column.dtype.names is None else Table(column))

    def __len__(self) -> int:
        """Return the number of records."""
        return len(self.records)

    @overload
    def __getitem__(self, key: str) -> Any: ...

    @overload
    def __getitem__(self, key: int) -> Record: ...

    def __getitem__(self, key: Any) -> Any:
        """Return the field of a name, or the record of a number."""
        return self.records[key]


@cache
def record_type(fields: type) -> np.dtype[Any]:
    """
    Return the type of records from a class that lists their fields.

    A field is a number, or another such class. Where the class is that of the columns of a table,
    a field is ``Annotated[Array, kind, *shape]``, with kind and shape of what a record has of it.
    """
    columns = []
    for name, hint in get_type_hints(fields, include_extras=True).items():
        kind, *shape = getattr(hint, '__metadata__', (hint,))
        item = kind if kind in (int, float) else record_type(kind)
        columns.append((name, item, tuple(shape)))
    return np.dtype(columns)


def record_array(count: int, fields: type) -> Any:
    """
    Return a `Table` of zero records with the `fields` of `record_type`, as compiled code takes it.

    It is not a np.recarray, because compiled functions look up the type of a recarray at every
    call from Python, which takes 10 us.
    """
    records = np.zeros(count, record_type(fields))
    return records if COMPILES else Table(records)


class Primitive:
    """An operation of compiled code that Python does not have; `compiler` knows it by its name."""

    def __init__(self, name: str) -> None:
        self.name = name


def _array(*numbers: float) -> Any:
    return np.array(numbers)


def _choice(a: Any, b: Any, x: Any, y: Any) -> Any:
    return np.where(a > b, x, y)


# A few numbers in one register of the processor, on which operations act at once; `x[k]` is one of
# them. `choose(a, b, x, y)` is x where a > b, and y elsewhere. Where nothing is compiled they are
# arrays.
Pack = Any
Packs = tuple[Pack, Pack, Pack, Pack, Pack, Pack]  # components of two or four twists or wrenches
pair: Any = Primitive('pair') if COMPILES else _array
four: Any = Primitive('four') if COMPILES else _array
square_root: Any = Primitive('square_root') if COMPILES else np.sqrt
choose: Any = Primitive('choose') if COMPILES else _choice
_time_stamp: Any = Primitive('time_stamp')


@compiled
def cycle_counter() -> int:
    """Return the counter of an x86_64 processor; 0 elsewhere, or if nothing is compiled."""
    return _time_stamp() if COMPILES else 0
