# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calls of compiled functions with records, each by its address; see `records`."""

from collections.abc import Callable
import ctypes
from functools import cache
from typing import Any

from snake_sim_ros.dynamics.compilation import COMPILES, Dispatched
from snake_sim_ros.dynamics.records import Block

RETURNED = 0, -2  # what machine code of Numba returns at the end: a value, or None
_nothing = ctypes.c_void_p()  # where it says what it raises


class BoundCall:
    """
    A call of a compiled function with records that stay. The interpreter goes on beside it.

    Parameters
    ----------
    function : callable
        A compiled function. It returns an integer or nothing.
    blocks : Block
        Its arguments.

    """

    def __init__(self, function: Callable[..., Any], *blocks: Block) -> None:
        self.function, self.blocks = function, blocks
        self._value = ctypes.c_int64()
        if COMPILES:
            self._call = _machine_code(function, tuple(block.kind for block in blocks))
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


@cache
def _machine_code(function: Any, kinds: tuple[Any, ...]) -> Callable[..., int]:
    """Return the machine code of a function for records of some types."""
    function.compile(kinds)
    found = function.overloads[kinds]
    address = found.library.get_pointer_to_function(found.fndesc.llvm_func_name)
    pointers = (2 + len(kinds)) * [ctypes.c_void_p]
    return ctypes.CFUNCTYPE(ctypes.c_int32, *pointers)(address)


def compile_call(function: Any, *kinds: Any) -> None:
    """Compile a compiled or `Dispatched` function for a call with arguments of some types."""
    if isinstance(function, Dispatched):
        function = function.implementations[kinds[0].instance_class]
    function.compile(kinds)


class Loop:
    """
    A compiled loop over steps, whose first argument stays.

    Parameters
    ----------
    func : callable
        Compiled ``advance(first, model, work, steps)``.
    first : NamedTuple
        A contact solver of `moreau.advance`, or the arrays of `bdf2.advance`.

    """

    def __init__(self, func: Callable[..., Any], first: Any) -> None:
        self.func, self.first = func, first
        self._model = self._work = None
        self._blocks: tuple[Block, ...] = ()

    def __call__(self, model: Any, work: Any, steps: Any) -> None:
        """Take steps."""
        self.bound(model, work, steps)()

    def bound(self, model: Any, work: Any, steps: Any) -> BoundCall:
        """Return the call that takes steps, as often as it is made."""
        if not (self._model is model and self._work is work):
            self._model, self._work = model, work
            self._blocks = Block(self.first), Block(model), Block(work)
        return BoundCall(self.func, *self._blocks, Block(steps))
