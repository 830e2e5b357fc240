"""Arithmetic in productions, parsed by hand and computed on arrays: nothing is ever evaluated as Python.

A text becomes a list of steps in reverse Polish order (Dijkstra's shunting yard, no recursion), and each
step works on whole arrays, one value for every occurrence of a symbol. Operators, from the loosest:
``||``, ``&&``, ``== != < <= > >=``, ``+ -``, ``* /``, sign and ``!``, ``^``. Truth is 1 and 0. Angles
of ``sin cos tan`` are degrees, as everywhere in a production.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

Value = float | np.ndarray


class ExpressionError(ValueError):
    """An expression that cannot be read; the text says what and where."""


@dataclass(frozen=True)
class Expression:
    """Steps in reverse Polish order: a number, a name, or an operation with its count of operands."""

    text: str
    steps: tuple[tuple[str, float | str | int], ...]

    @property
    def names(self) -> frozenset[str]:
        """The variables that it uses."""
        return frozenset(str(what) for kind, what in self.steps if kind == "name")

    def __call__(self, values: Mapping[str, Value]) -> Value:
        """Its value where the variables have these values, numbers or arrays of one length.

        Raises
        ------
        ExpressionError : a result is not finite (a division by zero, a root of a negative number).
        """
        stack: list[Value] = []
        with np.errstate(all="ignore"):
            for kind, what in self.steps:
                if kind == "number":
                    stack.append(float(what))
                elif kind == "name":
                    stack.append(values[str(what)])
                else:
                    arity, work = _OPERATIONS[kind]
                    operands = stack[len(stack) - arity :]
                    del stack[len(stack) - arity :]
                    stack.append(work(*operands))
        (result,) = stack
        if not np.isfinite(result).all():
            raise ExpressionError(f'"{self.text}" is not a finite number for some symbol')
        return result


def parse_expression(text: str, names: Collection[str]) -> Expression:  # noqa: C901 (a parser's cases)
    """An expression over these names.

    Raises
    ------
    ExpressionError : it is not arithmetic, or uses a name that is not known.
    """
    steps: list[tuple[str, float | str | int]] = []
    waiting: list[tuple[str, int]] = []  # operators, functions and brackets, with commas seen
    operand_next = True

    def release(above: int) -> None:
        while waiting and waiting[-1][0] not in ("(", "call") and _RANK[waiting[-1][0]] >= above:
            steps.append((waiting.pop()[0], 0))

    for token, kind in _tokens(text):
        if kind == "number" and operand_next:
            steps.append(("number", float(token)))
            operand_next = False
        elif kind == "function" and operand_next:
            waiting += [(token.rstrip("( "), 0), ("call", 0)]
        elif kind == "name" and operand_next:
            if token not in names:
                raise ExpressionError(_unknown(token, text, names))
            steps.append(("name", token))
            operand_next = False
        elif token == "(" and operand_next:
            waiting.append(("(", 0))
        elif token in "+-!" and operand_next:
            waiting.append(({"+": "plus", "-": "minus", "!": "not"}[token], 0))
        elif token in (")", ",") and not operand_next:
            release(0)
            if not waiting or (token == "," and waiting[-1][0] != "call"):
                raise ExpressionError(f'"{text}": "{token}" has no bracket that it belongs to')
            opened, commas = waiting.pop()
            if token == ",":
                waiting.append((opened, commas + 1))
                operand_next = True
            elif opened == "call":
                function = waiting.pop()[0]
                if commas + 1 != _OPERATIONS[function][0]:
                    count = _OPERATIONS[function][0]
                    raise ExpressionError(f'"{text}": {function} takes {count} numbers')
                steps.append((function, 0))
        elif token in _RANK and not operand_next:
            release(_RANK[token] + (token == "^"))  # ^ binds to the right
            waiting.append((token, 0))
            operand_next = True
        else:
            wanted = "a number or a name" if operand_next else "an operator"
            raise ExpressionError(f'"{text}": "{token}" stands where {wanted} is expected')
    if operand_next:
        raise ExpressionError(f'"{text}": a number or a name is missing at the end')
    release(0)
    if waiting:
        raise ExpressionError(f'"{text}": a bracket is not closed')
    return Expression(text, tuple(steps))


def _tokens(text: str) -> list[tuple[str, str]]:
    """(token, kind) of a text; a function comes with its opening bracket."""
    found, at = [], 0
    stripped = text.rstrip()
    while at < len(stripped):
        match = _TOKEN.match(stripped, at)
        if not match or match.lastgroup is None:
            raise ExpressionError(f'"{text}": "{stripped[at:].strip()[:1]}" is not arithmetic')
        token, kind = match.group(match.lastgroup), match.lastgroup
        found.append(({"**": "^", "and": "&&", "or": "||", "not": "!"}.get(token, token), kind))
        at = match.end()
    return found


def _unknown(name: str, text: str, names: Collection[str]) -> str:
    known = [*sorted(names), *_FUNCTIONS]
    near = difflib.get_close_matches(name, known, 1)
    hint = f'did you mean "{near[0]}"? ' if near else ""
    return f'"{text}": "{name}" is not known; {hint}Known: {", ".join(known)}'


_FUNCTIONS: dict[str, tuple[int, Callable[..., Value]]] = {
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
_OPERATIONS: dict[str, tuple[int, Callable[..., Value]]] = _FUNCTIONS | {
    "||": (2, lambda a, b: np.where((a != 0) | (b != 0), 1.0, 0.0)),
    "&&": (2, lambda a, b: np.where((a != 0) & (b != 0), 1.0, 0.0)),
    "==": (2, lambda a, b: np.where(a == b, 1.0, 0.0)),
    "!=": (2, lambda a, b: np.where(a != b, 1.0, 0.0)),
    "<": (2, lambda a, b: np.where(a < b, 1.0, 0.0)),
    "<=": (2, lambda a, b: np.where(a <= b, 1.0, 0.0)),
    ">": (2, lambda a, b: np.where(a > b, 1.0, 0.0)),
    ">=": (2, lambda a, b: np.where(a >= b, 1.0, 0.0)),
    "+": (2, np.add),
    "-": (2, np.subtract),
    "*": (2, np.multiply),
    "/": (2, np.divide),
    "plus": (1, np.positive),
    "minus": (1, np.negative),
    "not": (1, lambda a: np.where(np.equal(a, 0), 1.0, 0.0)),
    "^": (2, np.power),
}
_RANK = {"||": 1, "&&": 2, "==": 3, "!=": 3, "<": 3, "<=": 3, ">": 3, ">=": 3, "+": 4, "-": 4}
_RANK |= {"*": 5, "/": 5, "plus": 6, "minus": 6, "not": 6, "^": 7} | dict.fromkeys(_FUNCTIONS, 8)
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<word>(?:and|or|not)\b)"
    rf"|(?P<function>(?:{'|'.join(_FUNCTIONS)})\s*\()"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>\*\*|&&|\|\||<=|>=|==|!=|[-+*/^<>!(),]))"
)
