"""Arithmetic in productions, read by Python's parser and computed on arrays; nothing is evaluated as Python.

Of a text's syntax tree only numbers, known names, and the operators and functions of the tables below are
taken; anything else is refused. Each operation works on whole arrays, one value for every occurrence of a
symbol. Operators, from the loosest: ``||``, ``&&``, ``== != < <= > >=``, ``+ -``, ``* /``, sign and ``!``,
``^``. Truth is 1 and 0. Angles of ``sin cos tan`` are degrees, as everywhere in a production.
"""

from __future__ import annotations

import ast
import difflib
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

Value = float | np.ndarray
Work = Callable[..., Value]
Tree = (
    float | str | tuple[Work, tuple["Tree", ...]]
)  # a number, a name, or an operation on operands


class ExpressionError(ValueError):
    """An expression that cannot be read; the text says what and where."""


@dataclass(frozen=True)
class Expression:
    """An expression as it was written, and as a tree of operations."""

    text: str
    tree: Tree

    def __call__(self, values: Mapping[str, Value]) -> Value:
        """Its value where the variables have these values, numbers or arrays of one length.

        Raises
        ------
        ExpressionError : a result is not finite (a division by zero, a root of a negative number).
        """
        with np.errstate(all="ignore"):
            result = _value(self.tree, values)
        if not np.isfinite(result).all():
            raise ExpressionError(f'"{self.text}" is not a finite number for some symbol')
        return result


def parse_expression(text: str, names: Collection[str]) -> Expression:
    """An expression over these names.

    Raises
    ------
    ExpressionError : it is not arithmetic, or uses a name that is not known.
    """
    if strange := re.search(r"[#~@\\\"']", text):
        raise ExpressionError(f'"{text}": "{strange[0]}" is not arithmetic')
    python = " ".join(text.split())
    for pattern, sign in _SPELLINGS:
        python = re.sub(pattern, sign, python)
    try:
        with warnings.catch_warnings(action="ignore"):  # of numbers and words that touch
            return Expression(text, _read(ast.parse(python.strip(), mode="eval").body, names, text))
    except SyntaxError as problem:
        raise ExpressionError(f'"{text}" is not arithmetic: {problem.msg}') from None
    except (RecursionError, MemoryError, OverflowError):
        raise ExpressionError(f'"{text[:40]}" ... is too deep or too large') from None


def _read(node: ast.expr, names: Collection[str], text: str) -> Tree:
    """The operations that a syntax tree stands for."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        if node.id not in names:
            raise ExpressionError(_unknown(node.id, text, names))
        return node.id
    works: list[Work | None] = []
    parts: list[ast.expr] = []
    if isinstance(node, ast.BinOp):
        works, parts = [_OPERATORS.get(type(node.op))], [node.left, node.right]
    elif isinstance(node, ast.BoolOp):
        works, parts = [_OPERATORS.get(type(node.op))] * (len(node.values) - 1), node.values
    elif isinstance(node, ast.Compare):
        works, parts = [_OPERATORS.get(type(op)) for op in node.ops], [node.left, *node.comparators]
    if parts and all(works):
        tree, *rest = (_read(part, names, text) for part in parts)
        for work, right in zip(works, rest, strict=True):
            tree = (work, (tree, right))  # type: ignore[assignment]  # none is None
        return tree
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)], (_read(node.operand, names, text),)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise ExpressionError(_unknown(node.func.id, text, names))
        count, work = FUNCTIONS[node.func.id]
        if len(node.args) != count:
            raise ExpressionError(f'"{text}": {node.func.id} takes {count} numbers')
        return work, tuple(_read(part, names, text) for part in node.args)
    raise ExpressionError(f'"{text}": "{ast.unparse(node)}" is not arithmetic')


def _value(tree: Tree, values: Mapping[str, Value]) -> Value:
    if isinstance(tree, tuple):
        work, operands = tree
        return work(*(_value(operand, values) for operand in operands))
    return values[tree] if isinstance(tree, str) else tree


def _unknown(name: str, text: str, names: Collection[str]) -> str:
    known = [*sorted(names), *FUNCTIONS]
    near = difflib.get_close_matches(name, known, 1)
    hint = f'did you mean "{near[0]}"? ' if near else ""
    return f'"{text}": "{name}" is not known; {hint}Known: {", ".join(known)}'


FUNCTIONS: dict[str, tuple[int, Work]] = {
    "abs": (1, np.abs),
    "sqrt": (1, np.sqrt),
    "exp": (1, np.exp),
    "log": (1, np.log),
    "floor": (1, np.floor),
    "ceil": (1, np.ceil),
    "sin": (1, lambda a: np.sin(np.deg2rad(a))),
    "cos": (1, lambda a: np.cos(np.deg2rad(a))),
    "tan": (1, lambda a: np.tan(np.deg2rad(a))),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
}
_OPERATORS: dict[type, Work] = {
    ast.Or: lambda a, b: np.where((a != 0) | (b != 0), 1.0, 0.0),
    ast.And: lambda a, b: np.where((a != 0) & (b != 0), 1.0, 0.0),
    ast.Eq: lambda a, b: np.where(a == b, 1.0, 0.0),
    ast.NotEq: lambda a, b: np.where(a != b, 1.0, 0.0),
    ast.Lt: lambda a, b: np.where(a < b, 1.0, 0.0),
    ast.LtE: lambda a, b: np.where(a <= b, 1.0, 0.0),
    ast.Gt: lambda a, b: np.where(a > b, 1.0, 0.0),
    ast.GtE: lambda a, b: np.where(a >= b, 1.0, 0.0),
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.UAdd: np.positive,
    ast.USub: np.negative,
    ast.Invert: lambda a: np.where(np.equal(a, 0), 1.0, 0.0),
    ast.Pow: np.power,
}
# Signs of productions and Python's; "not" binds as tightly as a sign, which Python's own does not.
_SPELLINGS = (
    (r"&&", " and "),
    (r"\|\|", " or "),
    (r"\^", "**"),
    (r"!(?!=)|\bnot\b", " ~"),
)
