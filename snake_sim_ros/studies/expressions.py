# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Expressions of named numbers, such as ``speed - 0.1 * abs(sideways)``.

They consist of numbers, names, ``+ - * / **``, ``abs``, ``min`` and ``max``, and nothing else:
their syntax tree is looked up in tables, never run by Python. A result that is no finite number,
such as that of a division by 0, is NaN. asteval 1.0 does not serve: its smallest interpreter opens
files, fills the memory with ``[0] * 10**9``, and knows no names with dots.
"""

import ast
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
import math
import operator
from typing import Any
import warnings

from snake_sim_ros.scene.checked_records import nearest, ParameterError, quoted

Numbers = Mapping[str, float]
Term = Callable[[Numbers], Any]
Value = Callable[[Numbers], float]  # NaN if it is not finite
LONGEST = 400  # characters; Python's parser is recursive
OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow, ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., Any]] = {'abs': abs, 'min': min, 'max': max}
# Comparisons, each with the sign of left - right where it does not hold.
COMPARISONS: dict[type, tuple[Callable[[float, float], bool], float]] = {
    ast.Lt: (operator.lt, 1.0), ast.LtE: (operator.le, 1.0),
    ast.Gt: (operator.gt, -1.0), ast.GtE: (operator.ge, -1.0),
}  # fmt: skip
SYNTAX = 'numbers, names, + - * / **, abs, min and max'
LEAST_EXCESS = 1e-12  # of a strict comparison of equal numbers


@dataclass(frozen=True)
class Expression:
    """
    A number that depends on others.

    Attributes
    ----------
    text : str
    names : frozenset of str
        Of the numbers on which it depends.
    value : callable
        ``value(numbers)`` returns it, NaN if it is not finite. That of a constraint is its excess:
        0 if it holds, otherwise by how much it does not, as a share of the bound unless that is 0;
        inf if a number is NaN.

    """

    text: str
    names: frozenset[str]
    value: Value


def expression_of(text: Any, known: Iterable[str], where: str) -> Expression:
    """
    Return an expression.

    Parameters
    ----------
    text : str
    known : iterable of str
        Names that it may have; it must have one at least.
    where : str
        For messages.

    Raises
    ------
    ParameterError
        If it is something else.

    """
    body = _parsed(text, where)
    if isinstance(body, ast.Compare):
        raise ParameterError(
            f'{where} must be a number such as speed, got the comparison {quoted(text)}; '
            f'what must hold belongs to constraints'
        )
    reader = _Reader(text, tuple(known), where)
    value = _finite(reader.term(body))
    return Expression(text, reader.found(), value)


def constraint_of(text: Any, known: Iterable[str], where: str) -> Expression:
    """
    Return the excess of a constraint: ``left <= right`` or ``<``, ``>=``, ``>``, or several.

    Raises
    ------
    ParameterError
        If it is something else, see `expression_of`.

    """
    body = _parsed(text, where)
    if not isinstance(body, ast.Compare):
        raise ParameterError(
            f'{where} must be a comparison such as speed >= 0.1, got {quoted(text)}'
        )
    reader, parts = _Reader(text, tuple(known), where), list[Value]()
    sides = [body.left, *body.comparators]
    values = [_finite(reader.term(side)) for side in sides]
    for k, kind in enumerate(body.ops):
        if type(kind) not in COMPARISONS:
            raise ParameterError(
                f'{where} must compare by <=, <, >= or >, got {quoted(text)}; for numbers that '
                f'are to be equal say abs(a - b) <= 0.01'
            )
        names = {item.id for item in ast.walk(sides[k]) if isinstance(item, ast.Name)}
        bound = values[k] if names <= FUNCTIONS.keys() else values[k + 1]
        parts.append(_excess(values[k], values[k + 1], bound, *COMPARISONS[type(kind)]))
    return Expression(text, reader.found(), lambda numbers: sum(part(numbers) for part in parts))


def _parsed(text: Any, where: str) -> ast.expr:
    """Return the syntax tree of a text."""
    if not isinstance(text, str) or not text.strip():
        raise ParameterError(f'{where} must be an expression such as speed, got {quoted(text)}')
    if len(text) > LONGEST:
        raise ParameterError(f'{where} must have at most {LONGEST} characters, got {len(text)}')
    try:
        with warnings.catch_warnings():  # of Python, on what is no expression here
            warnings.simplefilter('ignore')
            return ast.parse(text.strip(), mode='eval').body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = getattr(error, 'msg', None) or error
        raise ParameterError(f'{where}: {quoted(text)} is not readable: {reason}') from None


def _finite(term: Term) -> Value:
    """Return the function that gives the value of a term, NaN if it is not finite."""

    def value(numbers: Numbers) -> float:
        try:
            found = term(numbers)
        except (ArithmeticError, ValueError):
            return math.nan
        is_number = not isinstance(found, complex) and math.isfinite(found)
        return float(found) if is_number else math.nan

    return value


def _excess(
    left: Value, right: Value, bound: Value, holds: Callable[[float, float], bool], sign: float
) -> Value:
    """Return the function that says by how much a comparison does not hold."""

    def excess(numbers: Numbers) -> float:
        a, b = left(numbers), right(numbers)
        if holds(a, b):
            return 0.0
        if math.isnan(a) or math.isnan(b):
            return math.inf
        return max(sign * (a - b) / (abs(bound(numbers)) or 1.0), LEAST_EXCESS)

    return excess


class _Reader:
    """Turns syntax trees into terms, and collects their names."""

    def __init__(self, text: str, known: tuple[str, ...], where: str) -> None:
        self.text, self.known, self.where = text, known, where
        self.names: set[str] = set()

    def found(self) -> frozenset[str]:
        """Return the names that were found, one at least."""
        if not self.names:
            raise ParameterError(
                f'{self.where} must depend on something, got {quoted(self.text)}; '
                f'choose from: {", ".join(sorted(self.known))}'
            )
        return frozenset(self.names)

    def term(self, node: ast.expr) -> Term:
        """Return the term of a tree."""
        match node:
            case ast.Constant(value=int() | float() as number) if type(number) is not bool:
                return self._constant(number)
            case ast.Name() | ast.Attribute():
                return self._name(ast.unparse(node))
            case ast.UnaryOp(op=op, operand=operand) if type(op) in OPERATORS:
                return _applied(OPERATORS[type(op)], self.term(operand))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                return _applied(OPERATORS[type(op)], self.term(left), self.term(right))
            case ast.Call():
                return self._call(node)
        raise ParameterError(
            f'{self.where}: {quoted(ast.unparse(node))} is not possible in {quoted(self.text)}; '
            f'an expression has {SYNTAX}'
        )

    def _constant(self, value: float) -> Term:
        try:
            number = float(value)
        except OverflowError:  # of an int
            number = math.inf
        if not math.isfinite(number):
            raise ParameterError(f'{self.where}: numbers must be finite, got {quoted(self.text)}')
        return lambda numbers: number

    def _name(self, name: str) -> Term:
        if name not in self.known:
            raise ParameterError(
                f'{self.where}: unknown name {quoted(name)}; {nearest(name, self.known)}'
            )
        self.names.add(name)
        return operator.itemgetter(name)

    def _call(self, node: ast.Call) -> Term:
        name = ast.unparse(node.func)
        if name not in FUNCTIONS:
            raise ParameterError(
                f'{self.where}: unknown function {quoted(name)}; {nearest(name, FUNCTIONS)}'
            )
        terms = [self.term(item) for item in node.args]
        if node.keywords or (len(terms) != 1 if name == 'abs' else len(terms) < 2):
            count = 'one number' if name == 'abs' else 'two numbers or more'
            raise ParameterError(
                f'{self.where}: {name} takes {count}, got {quoted(ast.unparse(node))}'
            )
        return _applied(FUNCTIONS[name], *terms)


def _applied(function: Callable[..., Any], *terms: Term) -> Term:
    """Return the term of a function of terms; NaN if one is NaN, which min and max may miss."""

    def value(numbers: Numbers) -> Any:
        found = [term(numbers) for term in terms]
        return math.nan if any(item != item for item in found) else function(*found)

    return value
