# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The compiler of `compilation.Function`: Numba, without the interpreter lock.

Numba optimizes a function with all that it calls and makes machine code of it, and does so again
in every caller, up to the loop over steps. A function that other compiled functions call needs
neither: it is optimized once, within the function that Python calls. That takes a quarter less
time. The inside of Numba is needed for it, but only its libraries of code: `CPUCodeLibrary`.
"""

from functools import cache
import os
import pickle
from typing import Any

from llvmlite.binding import parse_bitcode, set_option

try:
    import numba
except ImportError as error:
    raise ImportError(
        'snake_sim_ros compiles its physics with Numba, which is not installed: '
        'pip install numba, or apt install python3-numba'
    ) from error

from numba.core import event, types
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.imputils import lower_constant
from numba.core.registry import cpu_target
from numba.core.serialize import dumps
from numba.extending import models, register_model, typeof_impl

from snake_sim_ros.dynamics import lowered_packs
from snake_sim_ros.dynamics.code_cache import processor_name, Shelf
from snake_sim_ros.dynamics.compilation import begin_to_compile, Dispatched, Function, Primitive
from snake_sim_ros.dynamics.lowered_records import Arguments, call_code, type_of

OPTIONS = {'nogil': True, '_nrt': False, 'error_model': 'numpy', 'no_cfunc_wrapper': True}
FROM_PYTHON = ' from Python'  # beside the types of the arguments
_functions: dict[Any, Function] = {}  # by what is compiled
PRIMITIVES = {**lowered_packs.PRIMITIVES, 'call_code': call_code}

# Loops over a few numbers are unrolled, those over links and contacts are not. With more of it, as
# by default at this level, the loops among obstacles take half as long again to compile, and steps
# are no faster. LLVM takes this for all that the process compiles.
for limit in ('threshold=220', 'runtime=false', 'allow-peeling=false'):
    set_option('snake_sim_ros', f'-unroll-{limit}')
if processor_name():
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = processor_name(), ''
if 'NUMBA_SLP_VECTORIZE' not in os.environ:
    # Operations on several numbers in one instruction make steps 5 to 15 percent faster. Each is
    # rounded as before, and none changes places: results are the same to the last bit.
    numba.config.SLP_VECTORIZE = 1


@cache
def dispatcher_of(function: Function) -> Any:
    """Return a function as other compiled functions call it, always the same for one."""
    # An option that is not set here is that of the function for which this one is compiled.
    options = {**OPTIONS, 'forceinline': function.kind == 'inlined'}
    compile_linked = numba.njit(no_cpython_wrapper=True, pipeline_class=LinkedCompiler, **options)
    return with_cache(function, compile_linked(function.py_func))


@cache
def python_dispatcher_of(function: Function) -> Any:
    """Return a function as Python calls it, with machine code of its own."""
    return with_cache(function, numba.njit(**OPTIONS)(function.py_func), FROM_PYTHON)


def with_cache(function: Function, dispatcher: Any, use: str = '') -> Any:
    """Give a dispatcher the `CodeCache` of a function; its `enable_caching` gives Numba's."""
    _functions[function.py_func] = function
    if function.kind != 'entry' and function.shelf.can_keep:
        vars(dispatcher)['_cache'] = CodeCache(function.shelf, use)
    return dispatcher


def machine_code(function: Function, kinds: tuple[Any, ...]) -> bytes:
    """Return the name and the machine code of a function for some kinds, see `records`."""
    fields = ', '.join(f'record.{name}' for name in Arguments._fields[: len(kinds)])
    call = eval(f'lambda record: function({fields})', {'function': function})
    call.__name__ = function.py_func.__name__
    dispatcher = numba.njit(no_cpython_wrapper=True, **OPTIONS)(call)
    dispatcher.compile((type_of((Arguments, *kinds)),))
    (found,) = dispatcher.overloads.values()
    name: str = found.fndesc.llvm_func_name
    return name.encode() + b'\0' + bytes(found.library._get_compiled_object())


# ---- what Numba does not know of itself ---------------------------------------------------------


@typeof_impl.register(Function)  # type: ignore[untyped-decorator]
def _type_of_function(function: Function, context: Any) -> Any:
    return types.Dispatcher(dispatcher_of(function))


@typeof_impl.register(Primitive)  # type: ignore[untyped-decorator]
def _type_of_primitive(primitive: Primitive, context: Any) -> Any:
    return cpu_target.typing_context.resolve_value_type(PRIMITIVES[primitive.name])


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
        return types.Dispatcher(dispatcher_of(self.implementations[cls]))

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


class _Teller(event.Listener):  # type: ignore[misc]
    """Reports functions that are compiled within others; entries report themselves."""

    def on_start(self, started: Any) -> None:
        function = _functions.get(started.data['dispatcher'].py_func)
        if function and function.kind != 'entry':
            begin_to_compile(function)

    def on_end(self, ended: Any) -> None:
        """Do nothing."""


event.register('numba:compile', _Teller())


# ---- the cache of what entries are made of ------------------------------------------------------


def modules_of(kind: Any) -> set[str]:
    """Return the modules of all classes of tuples in a type of Numba."""
    inner = (*getattr(kind, 'kinds', ()), *getattr(kind, 'types', ()))
    here = {kind.instance_class.__module__} if hasattr(kind, 'instance_class') else set()
    return here.union(*map(modules_of, inner))


class CodeCache(_Cache):  # type: ignore[misc]
    """The cache of a function on its `Shelf`, with what Numba needs to link it into others."""

    def __init__(self, shelf: Shelf, use: str) -> None:
        self.shelf, self.use = shelf, use

    @property
    def cache_path(self) -> str:
        """The folder, see `numba.core.caching`."""
        return self.shelf.room

    def enable(self) -> None:
        """Do nothing: it is a cache from the beginning."""

    disable = flush = enable

    def _path(self, signature: Any) -> Any:
        return self.shelf.path(f'{signature}{self.use}', set().union(*map(modules_of, signature)))

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the code for some types of arguments, or None: this process compiles it."""
        content = self.shelf.load(self._path(signature))
        if content is None:
            return None
        kept = pickle.loads(content)
        load = load_linked if kept[0][1] == LINKED else CompileResult._rebuild
        return load(context, *kept)

    def save_overload(self, signature: Any, result: CompileResult) -> None:
        """Save the code for some types of arguments, if it can be written."""
        # The text of a function, which is of no use, names a folder.
        kept = ['' if isinstance(part, str) else part for part in result._reduce()]
        self.shelf.save(self._path(signature), dumps(tuple(kept)))


LINKED = 'linked'  # kind of such code in the cache, as 'object' and 'bitcode' of Numba


class LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of a function that is linked into others."""

    def _optimize_final_module(self) -> None:
        """Leave the code as it is."""

    def _finalize_final_module(self) -> None:
        """Make no machine code."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return no address: `compilation.Function` refuses calls from Python."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """What sets the environment of a function: here there is none to set."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing, see `codegen`."""

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return what the cache keeps."""
        return self.name, LINKED, self._get_module_for_linking().as_bitcode()


class LinkedCompiler(Compiler):  # type: ignore[misc]
    """Compiles a function into a `LinkedLibrary`."""

    def _compile_bytecode(self) -> CompileResult:
        state = self.state
        state.library = LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super()._compile_bytecode()


class _Loading:
    """The target context of Numba that makes a `LinkedLibrary` of what the cache keeps."""

    def __init__(self, context: Any) -> None:
        self.context, self.typing_context = context, context.typing_context

    def codegen(self) -> '_Loading':
        return self

    def unserialize_library(self, kept: tuple[str, str, bytes]) -> LinkedLibrary:
        library = LinkedLibrary(self.context.codegen(), kept[0])
        library._shared_module = parse_bitcode(kept[2])
        library._finalized = True
        return library

    def get_executable(self, *arguments: Any) -> Any:
        return self.context.get_executable(*arguments)


def load_linked(context: Any, *kept: Any) -> CompileResult:
    """Return a function as it was compiled, from what the cache keeps of it."""
    result = CompileResult._rebuild(_Loading(context), *kept)
    return result._replace(target_context=context)
