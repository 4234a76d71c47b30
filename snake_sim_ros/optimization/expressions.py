# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Expressions of named numbers, such as ``speed - 0.1 * abs(sideways)``.

They consist of numbers, names, ``+ - * / **``, ``abs``, ``min`` and ``max``, and nothing else:
what a text says is looked up in tables, never run by Python. A result that is no finite number,
such as that of a division by 0, is NaN.
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
Term = Callable[[Numbers], float]
LONGEST = 400  # characters
OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow,
}  # fmt: skip
SIGNS: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
FUNCTIONS: dict[str, Callable[..., Any]] = {'abs': abs, 'min': min, 'max': max}
# Comparisons, each with the sign of left - right where it does not hold.
COMPARISONS: dict[type, tuple[Callable[[float, float], bool], float]] = {
    ast.Lt: (operator.lt, 1.0), ast.LtE: (operator.le, 1.0),
    ast.Gt: (operator.gt, -1.0), ast.GtE: (operator.ge, -1.0),
}  # fmt: skip
PARTS = 'numbers, names, + - * / **, abs, min and max'
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
        ``value(numbers)`` returns it, NaN if it is not finite.

    """

    text: str
    names: frozenset[str]
    value: Term


@dataclass(frozen=True)
class Constraint:
    """
    What must hold between numbers.

    Attributes
    ----------
    text : str
    names : frozenset of str
        Of the numbers on which it depends.
    excess : callable
        ``excess(numbers)`` returns 0 if it holds, or else by how much it does not, as a share of
        the bound unless that is 0; inf if a number is NaN.

    """

    text: str
    names: frozenset[str]
    excess: Term


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
    term = _Reader(text, tuple(known), where)
    value = term.of(body)
    return Expression(text, term.named(), lambda numbers: _finite(value, numbers))


def constraint_of(text: Any, known: Iterable[str], where: str) -> Constraint:
    """
    Return a constraint: ``left <= right`` or with ``<``, ``>=``, ``>``, or several in a row.

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
    term = _Reader(text, tuple(known), where)
    sides = [body.left, *body.comparators]
    terms = [term.of(side) for side in sides]
    parts: list[Term] = []
    for k, kind in enumerate(body.ops):
        if type(kind) not in COMPARISONS:
            raise ParameterError(
                f'{where} must compare by <=, <, >= or >, got {quoted(text)}; for numbers that '
                f'are to be equal say abs(a - b) <= 0.01'
            )
        bound = terms[k] if _is_constant(sides[k]) else terms[k + 1]
        parts.append(_excess(terms[k], terms[k + 1], bound, *COMPARISONS[type(kind)]))
    return Constraint(text, term.named(), lambda numbers: sum(part(numbers) for part in parts))


def _parsed(text: Any, where: str) -> ast.expr:
    """Return the tree of a text."""
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


def _finite(term: Term, numbers: Numbers) -> float:
    """Return the value of a term, NaN if it is not finite."""
    try:
        value = term(numbers)
    except (ArithmeticError, ValueError):
        return math.nan
    return float(value) if not isinstance(value, complex) and math.isfinite(value) else math.nan


def _is_constant(node: ast.expr) -> bool:
    """Return whether nothing is named in a tree but functions."""
    names = {item.id for item in ast.walk(node) if isinstance(item, ast.Name)}
    return names <= FUNCTIONS.keys()


def _excess(
    left: Term, right: Term, bound: Term, holds: Callable[[float, float], bool], sign: float
) -> Term:
    """Return the term that says by how much a comparison does not hold."""

    def excess(numbers: Numbers) -> float:
        a, b = _finite(left, numbers), _finite(right, numbers)
        if holds(a, b):
            return 0.0
        if math.isnan(a) or math.isnan(b):
            return math.inf
        return max(sign * (a - b) / (abs(_finite(bound, numbers)) or 1.0), LEAST_EXCESS)

    return excess


class _Reader:
    """Turns a tree into a term, and notes its names."""

    def __init__(self, text: str, known: tuple[str, ...], where: str) -> None:
        self.text, self.known, self.where = text, known, where
        self.names: set[str] = set()

    def named(self) -> frozenset[str]:
        """Return the names that were found, one at least."""
        if not self.names:
            raise ParameterError(
                f'{self.where} must depend on something, got {quoted(self.text)}; '
                f'choose from: {", ".join(sorted(self.known))}'
            )
        return frozenset(self.names)

    def of(self, node: ast.expr) -> Term:
        """Return the term of a node."""
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return self._number(node)
        if isinstance(node, (ast.Name, ast.Attribute)):
            return self._name(node)
        if isinstance(node, ast.UnaryOp) and type(node.op) in SIGNS:
            sign, term = SIGNS[type(node.op)], self.of(node.operand)
            return lambda numbers: sign(term(numbers))
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            combine, left, right = (
                OPERATORS[type(node.op)],
                self.of(node.left),
                self.of(node.right),
            )
            return lambda numbers: combine(left(numbers), right(numbers))
        if isinstance(node, ast.Call):
            return self._call(node)
        raise ParameterError(
            f'{self.where}: {quoted(ast.unparse(node))} is not possible in {quoted(self.text)}; '
            f'an expression has {PARTS}'
        )

    def _number(self, node: ast.Constant) -> Term:
        try:
            number = float(node.value)  # type: ignore[arg-type]
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ParameterError(f'{self.where}: numbers must be finite, got {quoted(self.text)}')
        return lambda numbers: number

    def _name(self, node: ast.expr) -> Term:
        name = ast.unparse(node)
        if name not in self.known:
            raise ParameterError(
                f'{self.where}: unknown name {quoted(name)}; {nearest(name, self.known)}'
            )
        self.names.add(name)
        return lambda numbers: numbers[name]

    def _call(self, node: ast.Call) -> Term:
        name = ast.unparse(node.func)
        if name not in FUNCTIONS:
            raise ParameterError(
                f'{self.where}: unknown function {quoted(name)}; {nearest(name, FUNCTIONS)}'
            )
        terms, function = [self.of(item) for item in node.args], FUNCTIONS[name]
        if node.keywords or (len(terms) != 1 if name == 'abs' else len(terms) < 2):
            count = 'one number' if name == 'abs' else 'two numbers or more'
            raise ParameterError(
                f'{self.where}: {name} takes {count}, got {quoted(ast.unparse(node))}'
            )

        def value(numbers: Numbers) -> Any:
            found = [term(numbers) for term in terms]
            # min and max of Python depend on the place of a NaN among the others.
            return math.nan if any(item != item for item in found) else function(*found)

        return value
