"""Parallel rewriting on arrays: every symbol of a string is replaced at once, generation by generation.

Before a derivation starts its length is predicted: exactly, or as an expectation where chance decides;
where conditions decide nothing can be said, and each generation is measured before it is made. What would
not fit is refused with the number. Strings are worked through in blocks, so a derivation needs little
more memory than its last two strings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from .expression import Value
from .production import Production, System
from .word import Word

MAX_SYMBOLS = 50_000_000
MAX_NUMBERS = 60_000_000  # float64 numbers that all symbols of a string bear
BLOCK = 1 << 16  # symbols rewritten at a time: their arrays stay in the cache


@dataclass(frozen=True)
class Prediction:
    """Numbers of symbols and parameters that a derivation ends with, and whether they are certain.

    letters : how many of each symbol, whatever numbers it bears.
    """

    symbols: float  # an int where exact
    numbers: float
    exact: bool
    letters: Mapping[str, float] = field(default_factory=dict)


def predict(system: System, generations: int) -> Prediction:
    """The size after so many generations; under conditions, as if each first one always held."""
    chance = system.stochastic
    counts: dict[int, float] = {}
    for code in system.axiom.codes.tolist():
        counts[code] = counts.get(code, 0) + 1
    contents = {code: _contents(system, code, chance) for code in range(256)}
    for _ in range(generations):
        following: dict[int, float] = {}
        for code, count in counts.items():
            for successor, times in contents[code].items():
                following[successor] = following.get(successor, 0) + count * times
        counts = following
    arity = system.axiom.alphabet.arity().tolist()
    numbers = sum(count * arity[code] for code, count in counts.items())
    letters: dict[str, float] = {}
    for code, count in counts.items():
        symbol = system.axiom.alphabet.letters()[code][0]
        letters[symbol] = letters.get(symbol, 0) + count
    certain = not (chance or system.conditional)
    return Prediction(sum(counts.values()), numbers, certain, letters)


def rewrite(system: System, generations: int, rng: np.random.Generator | None = None) -> Word:
    """The string after so many generations.

    rng : draws where productions have probabilities, one number an occurrence in the order of the string.

    Raises
    ------
    ValueError : more than ``MAX_SYMBOLS``; says how many. ExpressionError : a number is not finite.
    """
    expected = predict(system, generations)
    if not system.conditional:
        _refuse_if_large(expected, generations)
    word = system.axiom
    for generation in range(1, generations + 1):
        word = _step(system, word, generation, generations, rng)
    return word


def _step(
    system: System, word: Word, generation: int, generations: int, rng: np.random.Generator | None
) -> Word:
    known = {**system.constants, "n": float(generation)}
    size = np.array([len(p.codes) for p in system.productions])
    bears = np.array([len(p.expressions) for p in system.productions])
    chosen = np.empty(len(word), np.uint16)
    symbols = numbers = 0
    for begin, block in _blocks(word):
        picked = _choose(system, block, known, rng)
        chosen[begin : begin + len(block)] = picked
        symbols += int(size[picked].sum())
        numbers += int(bears[picked].sum())
    _refuse_if_large(Prediction(symbols, numbers, True), generations, generation)

    table = np.concatenate([p.codes for p in system.productions])
    first = np.cumsum(size) - size
    codes = np.empty(symbols, np.uint8)
    values = np.empty(numbers, np.float64)
    at = at_value = 0
    for begin, block in _blocks(word):
        picked = chosen[begin : begin + len(block)]
        grown = size[picked]
        end = np.cumsum(grown)
        made = int(end[-1])
        # Where each new symbol lies in the table: its production's place plus its own rank there.
        place = np.repeat(first[picked] - (end - grown), grown) + np.arange(made)
        codes[at : at + made] = table[place]
        at += made
        at_value += _compute(system, block, picked, bears, known, values[at_value:])
    return Word(codes, values, word.alphabet)


def _blocks(word: Word) -> Iterator[tuple[int, Word]]:
    """Parts of a string with the numbers that belong to them."""
    arity = word.alphabet.arity()
    at_value = 0
    for begin in range(0, len(word), BLOCK):
        codes = word.codes[begin : begin + BLOCK]
        count = int(arity[codes].sum()) if len(word.values) else 0
        yield begin, Word(codes, word.values[at_value : at_value + count], word.alphabet)
        at_value += count


def _choose(
    system: System, block: Word, known: Mapping[str, float], rng: np.random.Generator | None
) -> np.ndarray:
    """(S,) number of the production that each symbol takes."""
    chosen = system.stay[block.codes]
    draws = np.empty(0)
    by_chance = [c for c, cases in system.cases.items() if any(len(k.chances) > 1 for k in cases)]
    if by_chance:
        if rng is None:
            raise ValueError("a stochastic grammar needs a random stream")
        drawing = np.zeros(256, bool)
        drawing[by_chance] = True
        which = drawing[block.codes]
        draws = np.zeros(len(block))
        draws[which] = rng.random(int(which.sum()))
    first_value = block.first_value() if system.conditional else np.empty(0)
    for code, cases in system.cases.items():
        where = np.flatnonzero(block.codes == code)
        for case in cases:
            if not len(where):
                break
            here = where
            if case.condition is not None:
                names = system.productions[case.productions[0]].parameters
                holds = case.condition(_values(names, block, first_value, where, known))
                true = np.broadcast_to(np.asarray(holds) != 0, where.shape)
                here, where = where[true], where[~true]
            else:
                where = where[:0]
            picked = np.zeros(len(here), np.int64)
            if len(case.chances) > 1:
                # The last bound is left out: rounding must not let a draw fall beyond it.
                bounds = np.cumsum(case.chances)[:-1]
                picked = np.searchsorted(bounds, draws[here], side="right")
            chosen[here] = np.array(case.productions)[picked]
    return chosen


def _compute(
    system: System,
    block: Word,
    picked: np.ndarray,
    bears: np.ndarray,
    known: Mapping[str, float],
    out: np.ndarray,
) -> int:
    """Write the numbers of all new symbols of a block to ``out``; says how many."""
    given = bears[picked]
    total = int(given.sum())
    if not total:
        return 0
    start = np.cumsum(given) - given
    first_value = block.first_value()
    for number in np.flatnonzero(np.bincount(picked, minlength=len(bears)) * bears):
        production: Production = system.productions[number]
        here = np.flatnonzero(picked == number)
        values = _values(production.parameters, block, first_value, here, known)
        for rank, expression in enumerate(production.expressions):
            out[start[here] + rank] = expression(values)
    return total


def _values(
    names: tuple[str, ...],
    block: Word,
    first_value: np.ndarray,
    where: np.ndarray,
    known: Mapping[str, float],
) -> dict[str, Value]:
    """Return the values of names at some symbols of a block."""
    values: dict[str, Value] = dict(known)
    for rank, name in enumerate(names):
        values[name] = block.values[first_value[where] + rank]
    return values


def _contents(system: System, code: int, chance: bool) -> dict[int, float]:
    """Return how often each letter is in what a letter becomes."""
    found: dict[int, float] = {}
    cases = system.cases.get(code)
    numbers = cases[0].productions if cases else (int(system.stay[code]),)
    chances = cases[0].chances if cases else (1.0,)
    for number, likely in zip(numbers, chances, strict=True):
        for made in system.productions[number].codes.tolist():
            found[made] = found.get(made, 0) + (likely if chance else 1)
    return found


def _refuse_if_large(size: Prediction, generations: int, reached: int | None = None) -> None:
    for count, limit, what in (
        (size.symbols, MAX_SYMBOLS, "symbols"),
        (size.numbers, MAX_NUMBERS, "numbers on symbols"),
    ):
        if count > limit:
            which = f"{generations} generations make"
            if reached is not None and reached < generations:
                which = f"generation {reached} of {generations} makes"
            about = "" if size.exact else "about "
            raise ValueError(
                f"{which} {about}{written(count)} {what}, more than {limit:,}; "
                "use fewer generations"
            )


def written(count: float) -> str:
    """A count in words that stay short."""
    if count == math.inf:
        return "more than 1e308"
    if count >= 10**60:
        exponent = math.floor(math.log10(count))
        return f"1e{exponent}"
    return f"{round(count):,}"
