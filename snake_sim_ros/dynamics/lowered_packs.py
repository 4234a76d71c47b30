# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How Numba compiles packs: a few numbers in one register, see `compilation.pair`."""

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

from snake_sim_ros.dynamics import compilation


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


@intrinsic  # type: ignore[untyped-decorator]
def _time_stamp(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if not compilation.COUNTS_CYCLES:
            return ir.Constant(ir.IntType(64), 0)
        kind = ir.FunctionType(ir.IntType(64), [])
        function = cgutils.get_or_insert_function(builder.module, kind, 'llvm.readcyclecounter')
        return builder.call(function, [])

    return types.int64(), generate


PRIMITIVES = {
    'pair': _pack2,
    'four': _pack4,
    'square_root': _root,
    'choose': _choose,
    'time_stamp': _time_stamp,
}
