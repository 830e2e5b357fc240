"""Dialects of turtles: the meaning of each symbol as tables of texts, which a user changes without code.

``F(l) = draw(l)`` gives a letter a command and the numbers that it takes, arithmetic over the letter's
own. A symbol without an entry is passed over, as ABOP does with the variables of a grammar.

ABOP: Prusinkiewicz & Lindenmayer, The Algorithmic Beauty of Plants, section 1.5 and appendix C. Turns
are right-handed about the turtle's up (+), left (&) and heading (\\). S: Méndez et al., SIMLIDAR; an
internode of generation n is h0/2^(n-1) long and N·dm/n thick, N being the number of generations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .expression import Expression, ExpressionError, Value, parse_expression
from .word import GrammarError, Notation, Word, split_arguments

SKIP, DRAW, MOVE, TURN, PITCH, ROLL, LEVEL, WIDTH, THIN, LEAF, BRANCH, END, OUTLINE, CLOSE = range(
    14
)
# Command, and the fewest and the most numbers that it takes.
COMMANDS: dict[str, tuple[int, int, int]] = {
    "skip": (SKIP, 0, 0),
    "draw": (DRAW, 1, 2),  # length, diameter
    "move": (MOVE, 1, 1),  # length
    "turn": (TURN, 1, 1),  # degrees about the turtle's up
    "pitch": (PITCH, 1, 1),  # degrees about its left
    "roll": (ROLL, 1, 1),  # degrees about its heading
    "level": (LEVEL, 0, 0),  # roll until left is horizontal
    "width": (WIDTH, 1, 1),  # diameter
    "thin": (THIN, 1, 1),  # factor of the diameter
    "leaf": (LEAF, 0, 2),  # length, width
    "branch": (BRANCH, 0, 0),
    "end": (END, 0, 0),
    "outline": (OUTLINE, 0, 0),  # what is walked until close is the outline of a leaf
    "close": (CLOSE, 0, 0),
}
MOST_NUMBERS = 2


@dataclass(frozen=True)
class Dialect:
    """Dialect of an L-system: the notation of strings and the meaning of their symbols."""

    notation: Notation
    symbols: tuple[str, ...]


ABOP = Dialect(
    Notation(),
    (
        *("F = draw(length)", "F(l) = draw(l)", "f = move(length)", "f(l) = move(l)"),
        *("+ = turn(angle)", "+(a) = turn(a)", "- = turn(-angle)", "-(a) = turn(-a)"),
        *("& = pitch(angle)", "&(a) = pitch(a)", "^ = pitch(-angle)", "^(a) = pitch(-a)"),
        *("\\ = roll(angle)", "\\(a) = roll(a)", "/ = roll(-angle)", "/(a) = roll(-a)"),
        *("| = turn(180)", "$ = level", "! = thin(thinning)", "!(w) = width(w)"),
        *("~ = leaf", "~(l) = leaf(l)", "~(l, w) = leaf(l, w)"),
        *("[ = branch", "] = end", "{ = outline", "} = close"),
    ),
)
S = Dialect(
    Notation(tagged="I"),
    (
        "I(n) = draw(h0 / 2^(n - 1), N * dm / n)",
        *("+ = pitch(angle)", "- = pitch(-angle)", "T = turn(rotation)", "t = turn(-rotation)"),
        *("F = leaf", "[ = branch", "] = end"),
    ),
)
DIALECTS = {"ABOP": ABOP, "S": S}


@dataclass(frozen=True)
class Commands:
    """Commands of the turtle, symbol after symbol, without those that are passed over.

    kind : (C,) int8. number : (C, 2) float64, NaN where a command has none.
    """

    kind: np.ndarray
    number: np.ndarray


@dataclass(frozen=True)
class _Meaning:
    kind: int
    parameters: tuple[str, ...]
    numbers: tuple[Expression, ...]


def read_commands(word: Word, symbols: Sequence[str], known: Mapping[str, float]) -> Commands:
    """The commands of a string.

    symbols : entries of a dialect; of two for the same letter the later counts.
    known : names that entries may use besides a letter's own numbers.

    Raises
    ------
    GrammarError : an entry cannot be read, or a symbol bears more or fewer numbers than any entry takes.
    """
    meanings = _read_meanings(symbols, known)
    first_value = word.first_value()
    kind = np.zeros(len(word), np.int8)
    number = np.full((len(word), MOST_NUMBERS), np.nan)
    for code, (symbol, arity) in word.alphabet.letters().items():
        meaning = meanings.get((symbol, arity))
        if meaning is None:
            takes = sorted(count for other, count in meanings if other == symbol)
            where = np.flatnonzero(word.codes == code)
            if takes and len(where):
                counts = " or ".join(map(str, takes))
                raise GrammarError(f'"{symbol}" takes {counts} numbers, not {arity}')
            continue
        where = np.flatnonzero(word.codes == code)
        kind[where] = meaning.kind
        values: dict[str, Value] = dict(known)
        for rank, name in enumerate(meaning.parameters):
            values[name] = word.values[first_value[where] + rank]
        for rank, expression in enumerate(meaning.numbers):
            number[where, rank] = expression(values)
    kept = kind != SKIP
    return Commands(kind[kept], number[kept])


def _read_meanings(
    symbols: Sequence[str], known: Mapping[str, float]
) -> dict[tuple[str, int], _Meaning]:
    meanings: dict[tuple[str, int], _Meaning] = {}
    for text in symbols:
        try:
            letter, meaning = _read_meaning(text, known)
        except (GrammarError, ExpressionError) as problem:
            raise GrammarError(f'symbol "{text}": {problem}') from None
        meanings[letter] = meaning
    return meanings


def _read_meaning(text: str, known: Mapping[str, float]) -> tuple[tuple[str, int], _Meaning]:
    left, equals, right = text.strip()[1:].partition("=")
    if not equals:
        raise GrammarError('is not like "F(l) = draw(l)"')
    symbol, left = text.strip()[0], left.strip()
    parameters = split_arguments(left, 0)[0] if left else []
    name, opened, _ = right.strip().partition("(")
    numbers = split_arguments(right.strip(), len(name))[0] if opened else []
    if name.strip() not in COMMANDS:
        raise GrammarError(f'"{name.strip()}" is not known; use one of {", ".join(COMMANDS)}')
    kind, fewest, most = COMMANDS[name.strip()]
    if not fewest <= len(numbers) <= most:
        raise GrammarError(f"{name.strip()} takes {fewest} to {most} numbers")
    names = [*known, *parameters]
    expressions = tuple(parse_expression(number, names) for number in numbers)
    return (symbol, len(parameters)), _Meaning(kind, tuple(parameters), expressions)
