# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Functions that are linked into others, and have no machine code of their own.

Numba optimizes a function with all that it calls and makes machine code of it, and does so again
in every caller, up to the loop over steps. A function that only compiled functions call needs
neither: it is optimized once, within the function that Python calls. That takes a quarter less
time. The inside of Numba is needed for it, but only its libraries of code: `CPUCodeLibrary`.
"""

import ctypes
from typing import Any

from llvmlite.binding import parse_bitcode
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult

LINKED = 'linked'  # kind of such code in the cache, as 'object' and 'bitcode' of Numba
# A function of the interpreter that raises a TypeError, whatever its arguments.
NOT_CALLABLE = ctypes.cast(ctypes.pythonapi.PyErr_BadArgument, ctypes.c_void_p).value or 0


class LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of a function that is linked into others."""

    def _optimize_final_module(self) -> None:
        """Leave the code as it is."""

    def _finalize_final_module(self) -> None:
        """Make no machine code."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return what Python calls: there is no such function, which it says as a TypeError."""
        self._ensure_finalized()
        return NOT_CALLABLE

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


def is_linked(kept: Any) -> bool:
    """Return whether what the cache keeps of a function is the code of a `LinkedLibrary`."""
    return bool(kept[0][1] == LINKED)


def load_linked(context: Any, *kept: Any) -> CompileResult:
    """Return a function as it was compiled, from what the cache keeps of it."""
    result = CompileResult._rebuild(_Loading(context), *kept)
    return result._replace(target_context=context)
