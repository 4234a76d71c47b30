# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How functions are compiled: with Numba, without the interpreter lock, cached on disk."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, update_wrapper
import operator
import os
import platform
from typing import Any, Generic, get_type_hints, overload, ParamSpec, TypeVar

try:
    from llvmlite import ir
    import numba
    from numba.core import cgutils, event, types
    from numba.core.imputils import lower_builtin, lower_constant
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import intrinsic, models, register_model, typeof_impl
except ImportError as error:
    raise ImportError(
        'snake_sim_ros compiles its physics with Numba, which is not installed: '
        'pip install numba, or apt install python3-numba'
    ) from error

import numpy as np

from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.dynamics.linked_code import LinkedCompiler

COMPILES = not numba.config.DISABLE_JIT  # whether anything is compiled, see `compiled`
# Others have no counter of cycles that a program may read: on ARM the instruction may end it.
COUNTS_CYCLES = COMPILES and platform.machine() in ('x86_64', 'AMD64')
OPTIONS = {'nogil': True, '_nrt': False, 'error_model': 'numpy'}  # of every compiled function


if 'NUMBA_SLP_VECTORIZE' not in os.environ:
    # Operations on several numbers in one instruction make steps 5 to 15 percent faster. Each is
    # rounded as before, and none changes places: results are the same to the last bit.
    numba.config.SLP_VECTORIZE = 1


# A function, which keeps its signature, and the parts of one.
F = TypeVar('F', bound=Callable[..., Any])
P = ParamSpec('P')
Result = TypeVar('Result')


def compiled(function: F) -> F:
    """
    Return `function` compiled on its first call, or as it is with NUMBA_DISABLE_JIT=1.

    Every operation is rounded as written. With fast math, a function that was just compiled and
    the same one from the cache differ in their last bits, and a run could not be repeated exactly.
    A function that allocates memory does not compile (_nrt). No entry for callers in C is
    compiled, which would take a tenth of the time.
    """
    return _compiled(function)


def linked(function: F) -> F:
    """
    Return `function` compiled once for all compiled functions that call it; see `compiled`.

    It has no entry from Python: only compiled functions can call it, see `linked_code`. It is for
    what is large and called in several places.
    """
    return _compiled(function, no_cpython_wrapper=True, pipeline_class=LinkedCompiler)


def inlined(function: F) -> F:
    """
    Return `function` compiled into each of its callers, as those that are `linked`.

    A call copies the headers of all array arguments, which often costs more than the work itself.
    """
    return _compiled(
        function, forceinline=True, no_cpython_wrapper=True, pipeline_class=LinkedCompiler
    )


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
        self.implementations: dict[Any, Callable[..., Any]] = {}

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> Result:
        """Call the implementation for the type of the first argument; none is named."""
        result: Result = self.implementations[type(arguments[0])](*arguments)
        return result

    def register(self, cls: type) -> Callable[[F], F]:
        """Return a decorator of the compiled implementation for a class."""

        def add(implementation: F) -> F:
            if COMPILES and not hasattr(implementation, 'py_func'):
                raise TypeError(f'{implementation} must be compiled to be registered')
            self.implementations[cls] = implementation
            return implementation

        return add


class DispatchedType(types.Callable):
    """The type of a `Dispatched` function in compiled code: a call is one of an implementation."""

    def __init__(self, function: Dispatched[..., Any]) -> None:
        self.implementations = function.implementations
        super().__init__(function.name)

    def implementation(self, arguments: Any) -> Any:
        """Return the type of the implementation for arguments of some types."""
        cls = getattr(arguments[0], 'instance_class', type(None))
        if cls not in self.implementations:
            names = ', '.join(known.__name__ for known in self.implementations)
            raise numba.core.errors.TypingError(
                f'{self.name} has no implementation for {arguments[0]}; it has them for {names}'
            )
        return types.Dispatcher(self.implementations[cls])

    def get_call_type(self, context: Any, arguments: Any, keywords: Any) -> Any:
        """Return the signature of a call, see `types.Callable`."""
        return self.implementation(arguments).get_call_type(context, arguments, keywords)

    def get_call_signatures(self) -> Any:
        """Return no signatures that are fixed, see `types.Callable`."""
        return (), True

    def get_impl_key(self, signature: Any) -> Any:
        """Return what the machine code of a call is found by, see `types.Callable`."""
        return self.implementation(signature.args).get_impl_key(signature)


@typeof_impl.register(Dispatched)  # type: ignore[untyped-decorator]
def _type_of_dispatched(function: Dispatched[..., Any], context: Any) -> DispatchedType:
    return DispatchedType(function)


register_model(DispatchedType)(models.OpaqueModel)


@lower_constant(DispatchedType)  # type: ignore[untyped-decorator]
def _constant_of_dispatched(context: Any, builder: Any, kind: Any, function: Any) -> Any:
    return context.get_dummy_value()


def _compiled(function: F, **options: Any) -> F:
    wrapper: F = numba.njit(no_cfunc_wrapper=True, **OPTIONS, **options)(function)
    if COMPILES and code_cache.can_keep(function):
        # As `enable_caching` of the wrapper does with the cache of Numba.
        vars(wrapper)['_cache'] = code_cache.CodeCache(function)
    return wrapper


class _Teller(event.Listener):  # type: ignore[misc]
    def __init__(self, tell: Callable[[str], object]) -> None:
        self.tell = tell

    def on_start(self, started: Any) -> None:
        function = started.data['dispatcher']
        try:
            self.tell(function.py_func.__name__)
        except BaseException:
            if isinstance(function._cache, code_cache.CodeCache):
                function._cache.unlock()  # another process may compile it
            raise

    def on_end(self, ended: Any) -> None:
        pass


@contextmanager
def watched(tell: Callable[[str], object]) -> Iterator[None]:
    """
    Report the name of every function that is not in the cache, before it is compiled.

    It is not compiled if `tell` raises an error.
    """
    with event.install_listener('numba:compile', _Teller(tell)):
        yield


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


class PackType(types.Type):
    """The type of a few numbers in one register, on which operations act at once; see `pair`."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f'Pack{width}')


@register_model(PackType)
class _PackModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.DoubleType(), kind.width))


def _packed(context: Any, builder: Any, values: Any, kinds: Any) -> Any:
    """Return numbers, converted from their types, as one vector."""
    vector = ir.Constant(ir.VectorType(ir.DoubleType(), len(values)), ir.Undefined)
    for k, (value, kind) in enumerate(zip(values, kinds, strict=True)):
        number = context.cast(builder, value, kind, types.float64)
        vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), k))
    return vector


@intrinsic  # type: ignore[untyped-decorator]
def _pack2(typing_context: Any, a: Any, b: Any) -> Any:
    return PackType(2)(a, b), _pack_numbers


@intrinsic  # type: ignore[untyped-decorator]
def _pack4(typing_context: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    return PackType(4)(a, b, c, d), _pack_numbers


def _pack_numbers(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return _packed(context, builder, arguments, signature.args)


@intrinsic  # type: ignore[untyped-decorator]
def _root(typing_context: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(arguments[0].type, [arguments[0].type])
        name = f'llvm.sqrt.v{x.width}f64'
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)

    return x(x), generate


@intrinsic  # type: ignore[untyped-decorator]
def _choose(typing_context: Any, a: Any, b: Any, x: Any, y: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        is_greater = builder.fcmp_ordered('>', *arguments[:2])
        return builder.select(is_greater, *arguments[2:])

    return a(a, b, x, y), generate


@infer_global(operator.add)
@infer_global(operator.sub)
@infer_global(operator.mul)
@infer_global(operator.truediv)
class _PackOperation(AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, keywords: Any) -> Any:
        packs = [kind for kind in arguments if isinstance(kind, PackType)]
        if packs and all(isinstance(kind, (PackType, types.Float)) for kind in arguments):
            return signature(packs[0], *arguments)
        return None


def _lower_operation(symbol: Any, name: str) -> None:
    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        both = (
            value
            if isinstance(kind, PackType)
            else _packed(
                context, builder, signature.return_type.width * [value],
                signature.return_type.width * [kind],
            )
            for value, kind in zip(arguments, signature.args, strict=True)
        )  # fmt: skip
        return getattr(builder, name)(*both)

    for kinds in ((PackType, PackType), (types.Float, PackType), (PackType, types.Float)):
        lower_builtin(symbol, *kinds)(lower)


_lower_operation(operator.add, 'fadd')
_lower_operation(operator.sub, 'fsub')
_lower_operation(operator.mul, 'fmul')
_lower_operation(operator.truediv, 'fdiv')


@infer_global(operator.getitem)
class _PackLane(AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, keywords: Any) -> Any:
        if isinstance(arguments[0], PackType) and isinstance(arguments[1], types.Integer):
            return signature(types.float64, arguments[0], types.int64)
        return None


@lower_builtin(operator.getitem, PackType, types.Integer)  # type: ignore[untyped-decorator]
def _lower_lane(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.extract_element(*arguments)


def _array(*numbers: float) -> Any:
    return np.array(numbers)


def _choice(a: Any, b: Any, x: Any, y: Any) -> Any:
    return np.where(a > b, x, y)


# A few numbers in one register of the processor, on which operations act at once; `x[k]` is one of
# them. `choose(a, b, x, y)` is x where a > b, and y elsewhere. Where nothing is compiled they are
# arrays.
Pack = Any
Packs = tuple[Pack, Pack, Pack, Pack, Pack, Pack]  # components of two or four twists or wrenches
pair = _pack2 if COMPILES else _array
four = _pack4 if COMPILES else _array
square_root = _root if COMPILES else np.sqrt
choose = _choose if COMPILES else _choice


@intrinsic  # type: ignore[untyped-decorator]
def _time_stamp(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if not COUNTS_CYCLES:
            return ir.Constant(ir.IntType(64), 0)
        kind = ir.FunctionType(ir.IntType(64), [])
        function = cgutils.get_or_insert_function(builder.module, kind, 'llvm.readcyclecounter')
        return builder.call(function, [])

    return types.int64(), generate


@compiled
def cycle_counter() -> int:
    """Return the counter of an x86_64 processor; 0 elsewhere, or if nothing is compiled."""
    return _time_stamp() if COMPILES else 0
