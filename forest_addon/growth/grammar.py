"""L-systems: rewrite every symbol of a string at once, on arrays of bytes.

A production replaces a symbol by a string; symbols without one stay. A derivation's length is predicted
exactly before it starts, so one that would not fit is refused with the number and costs nothing.

T20 writes its rule g -> d(g)[g)+g) and its second iteration d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g). Both
follow from axiom ``g)`` and g -> d(g)[g)+g: the branch that ``+`` starts is closed by the bracket of
its mother.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

MAX_SYMBOLS = 50_000_000


@dataclass(frozen=True)
class LSystem:
    """An axiom and one production per rewritten symbol (one ASCII character each)."""

    axiom: str
    productions: Mapping[str, str]


T20 = LSystem(axiom="g)", productions={"g": "d(g)[g)+g"})


def predict_length(system: LSystem, generations: int) -> int:
    """How many symbols the string has after so many generations, exactly."""
    counts = _count(system.axiom)
    for _ in range(generations):
        following: dict[str, int] = {}
        for symbol, count in counts.items():
            for successor, times in _count(system.productions.get(symbol, symbol)).items():
                following[successor] = following.get(successor, 0) + count * times
        counts = following
    return sum(counts.values())


def derive(system: LSystem, generations: int) -> np.ndarray:
    """The string after so many generations, as (S,) uint8 character codes.

    Raises
    ------
    ValueError : the string would be longer than ``MAX_SYMBOLS``; says how long.
    """
    length = predict_length(system, generations)
    if length > MAX_SYMBOLS:
        raise ValueError(
            f"{generations} generations make {length:,} symbols, more than {MAX_SYMBOLS:,}; "
            "use fewer generations"
        )
    successors = [
        np.frombuffer(system.productions.get(chr(code), chr(code)).encode("latin-1"), np.uint8)
        for code in range(256)
    ]
    table = np.concatenate(successors)
    size = np.array([len(s) for s in successors])
    first = np.cumsum(size) - size

    symbols = np.frombuffer(system.axiom.encode("latin-1"), np.uint8)
    for _ in range(generations):
        grown = size[symbols]
        start = np.cumsum(grown) - grown
        # Position of every new symbol within the table: its own rank within the production it is of.
        rank = np.arange(int(grown.sum())) - np.repeat(start, grown)
        symbols = table[np.repeat(first[symbols], grown) + rank]
    return symbols


def to_text(symbols: np.ndarray) -> str:
    """The string that character codes spell."""
    return symbols.tobytes().decode("latin-1")


def _count(text: str) -> dict[str, int]:
    counts: dict[str, int] = {}
    for symbol in text:
        counts[symbol] = counts.get(symbol, 0) + 1
    return counts
