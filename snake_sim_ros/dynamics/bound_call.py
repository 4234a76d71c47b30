# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Calls of a compiled function with arguments that stay.

At every call from Python, the headers of all arrays in the arguments are read, some 200 for a time
step. That takes longer than the step. A `BoundCall` keeps what was read, so that a call passes one
address.
"""

from collections.abc import Callable
from typing import Any

import numba
from numba.core import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic
from numba.extending import models
from numba.extending import NativeValue
from numba.extending import register_model
from numba.extending import typeof_impl
from numba.extending import unbox
import numpy as np

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.compilation import COMPILES

HEAD = 64  # bytes before the arguments; the address of the function is in the first of them


class BoundCallType(types.Type):  # type: ignore[misc]
    """The type of a `BoundCall` in compiled code: the types of its arguments."""

    def __init__(self, arguments: Any) -> None:
        self.arguments = arguments
        super().__init__(f'BoundCall({arguments})')


class BoundCall:
    """
    A call of a compiled function that returns nothing, with arguments that stay.

    Compiled functions make it by ``call(bound)``; `last_argument` gives them the last argument.

    Parameters
    ----------
    function : callable
        A compiled function.
    arguments : object
        Its arguments: numbers, arrays, and named tuples of them. What is in the arrays may change.

    """

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self.function, self.arguments = function, arguments
        if COMPILES:
            kinds = numba.typeof(arguments)
            self._numba_type_ = BoundCallType(kinds)
            target = cpu_target.target_context
            size = target.get_abi_sizeof(target.get_data_type(kinds))
            self.memory = np.zeros((HEAD + size) // 8 + 1)
            self.address = self.memory.ctypes.data
            self.memory[:1].view(np.uint64)[0] = _address_of(function, tuple(kinds))
            _fill(self, arguments)


def _address_of(function: Any, kinds: tuple[Any, ...]) -> int:
    """Return the address of the machine code of a function for arguments of some types."""
    function.compile(kinds)
    found = function.overloads[kinds]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


@typeof_impl.register(BoundCall)  # type: ignore[untyped-decorator]
def _type_of_bound_call(bound: BoundCall, context: Any) -> BoundCallType:
    return bound._numba_type_


register_model(BoundCallType)(models.OpaqueModel)


@unbox(BoundCallType)  # type: ignore[untyped-decorator]
def _unbox_bound_call(kind: Any, bound: Any, context: Any) -> Any:
    number = context.pyapi.object_getattr_string(bound, 'address')
    address = context.pyapi.long_as_voidptr(number)
    context.pyapi.decref(number)
    return NativeValue(address)


def _place(context: Any, builder: Any, bound: Any, kind: Any) -> tuple[Any, Any]:
    """Return the data model of the arguments of a bound call, and a pointer to them."""
    model = context.data_model_manager[kind.arguments]
    byte = builder.gep(bound, [context.get_constant(types.intp, HEAD)])
    return model, builder.bitcast(byte, model.get_data_type().as_pointer())


@intrinsic  # type: ignore[untyped-decorator]
def _keep(typing_context: Any, bound: Any, arguments: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        model, place = _place(context, builder, values[0], bound)
        builder.store(model.as_data(builder, values[1]), place)
        return context.get_dummy_value()

    return types.none(bound, bound.arguments), generate


@intrinsic  # type: ignore[untyped-decorator]
def _call(typing_context: Any, bound: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        model, place = _place(context, builder, values[0], bound)
        kept = model.from_data(builder, builder.load(place))
        kinds = list(bound.arguments)
        arguments = [builder.extract_value(kept, k) for k in range(len(kinds))]
        convention = context.call_conv
        kind = convention.get_function_type(types.none, kinds)
        head = builder.bitcast(values[0], kind.as_pointer().as_pointer())
        status, _ = convention.call_function(
            builder, builder.load(head), types.none, kinds, arguments
        )
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.none(bound), generate


@intrinsic  # type: ignore[untyped-decorator]
def _last_argument(typing_context: Any, bound: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        _, place = _place(context, builder, values[0], bound)
        last = len(bound.arguments) - 1
        pointer = builder.gep(
            place, [context.get_constant(types.int32, k) for k in (0, last)], inbounds=True
        )
        return context.data_model_manager[bound.arguments[last]].from_data(
            builder, builder.load(pointer)
        )

    return bound.arguments[-1](bound), generate


def _call_plainly(bound: BoundCall) -> None:
    bound.function(*bound.arguments)


def _last_plainly(bound: BoundCall) -> Any:
    return bound.arguments[-1]


call = _call if COMPILES else _call_plainly
last_argument = _last_argument if COMPILES else _last_plainly


@compiled
def _fill(bound, arguments):
    """Keep the arguments in the memory of a bound call."""
    _keep(bound, arguments)
