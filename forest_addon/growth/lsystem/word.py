"""Strings of an L-system as arrays: one byte a symbol, and the numbers of all symbols in one row.

A letter is a symbol together with how many numbers it bears, so ``F`` and ``F(1.5)`` are two letters. A
letter without numbers has its character's code; the others get codes that no character of a grammar has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .expression import Expression, parse_expression

# Codes of letters with numbers: control characters and what lies beyond ASCII.
_FREE = [*range(1, 32), *range(128, 256)]


class GrammarError(ValueError):
    """A grammar that cannot be used; the text says what and where."""


@dataclass(frozen=True)
class Notation:
    """Notation of strings: whether ``(`` opens numbers, and the letters that bear a tag.

    tagged : a letter of these followed by ``n`` is given the generation in which it is made: ``In``
        stands for I(n) and is printed I01, I02, ... (Méndez et al.).
    """

    parametric: bool = True
    tagged: str = ""


@dataclass
class Alphabet:
    """The letters that a grammar uses; grows while it is read."""

    notation: Notation = field(default_factory=Notation)
    codes: dict[tuple[str, int], int] = field(default_factory=dict)

    def code(self, symbol: str, arity: int) -> int:
        """The code of a letter."""
        letter = (symbol, arity)
        if letter not in self.codes:
            if arity == 0:
                self.codes[letter] = ord(symbol)
            else:
                taken = set(self.codes.values())
                free = [code for code in _FREE if code not in taken]
                if not free:
                    raise GrammarError("a grammar can have at most 159 letters with numbers")
                self.codes[letter] = free[0]
        return self.codes[letter]

    def letters(self) -> dict[int, tuple[str, int]]:
        """Symbol and arity by code."""
        return {code: letter for letter, code in self.codes.items()}

    def arity(self) -> np.ndarray:
        """(256,) numbers that each code bears."""
        table = np.zeros(256, np.int64)
        for (_, arity), code in self.codes.items():
            table[code] = arity
        return table


@dataclass(frozen=True)
class Word:
    """A string of S symbols.

    codes : (S,) uint8 letters. values : (V,) float64 their numbers, symbol after symbol.
    """

    codes: np.ndarray
    values: np.ndarray
    alphabet: Alphabet

    def __len__(self) -> int:
        return len(self.codes)

    def first_value(self) -> np.ndarray:
        """(S,) where the numbers of each symbol start in ``values``."""
        arity = self.alphabet.arity()[self.codes]
        return np.asarray(np.cumsum(arity) - arity)

    def text(self) -> str:
        """The string as it is written."""
        if not len(self.values):
            return self.codes.tobytes().decode("latin-1")
        letters, tagged = self.alphabet.letters(), self.alphabet.notation.tagged
        numbers = iter(self.values.tolist())
        parts = []
        for code in self.codes.tolist():
            symbol, arity = letters[code]
            given = [next(numbers) for _ in range(arity)]
            if arity and symbol in tagged:
                symbol += f"{given[0]:02.0f}"
            elif arity:
                symbol += f"({','.join(f'{value:g}' for value in given)})"
            parts.append(symbol)
        return "".join(parts)


Module = tuple[str, tuple[Expression, ...]]


def read_modules(text: str, notation: Notation, names: Sequence[str]) -> list[Module]:
    """Symbols with the expressions that they bear; spaces do not count.

    Raises
    ------
    GrammarError : a bracket of numbers is not closed. ExpressionError : bad arithmetic.
    """
    modules: list[Module] = []
    at = 0
    while at < len(text):
        symbol, at = text[at], at + 1
        if symbol.isspace():
            continue
        if notation.parametric and not " " < symbol <= "~":
            raise GrammarError(f'"{symbol}" cannot be a symbol; use letters and signs of ASCII')
        arguments: list[str] = []
        if symbol in notation.tagged and text[at : at + 1] == "n":
            arguments, at = ["n"], at + 1
        elif notation.parametric and text[at : at + 1] == "(":
            arguments, at = split_arguments(text, at)
        modules.append((symbol, tuple(parse_expression(a, names) for a in arguments)))
    return modules


def split_arguments(text: str, opening: int) -> tuple[list[str], int]:
    """The texts between the bracket at ``opening`` and its partner, and where it goes on."""
    parts, depth, begun = [], 0, opening + 1
    for at in range(opening, len(text)):
        depth += (text[at] == "(") - (text[at] == ")")
        if depth == 0 or (depth == 1 and text[at] == ","):
            parts.append(text[begun:at].strip())
            begun = at + 1
        if depth == 0:
            return parts, at + 1
    raise GrammarError(f'"{text}": the bracket at {opening} is not closed')
