"""Tanveer et al.'s (2020a and 2020b) L-systems, and plain ones: one character a symbol, no numbers, no
chance.

Tanveer et al. (2020a) writes its rule g -> d(g)[g)+g) and its second iteration
d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g). Both follow from axiom ``g)`` and g -> d(g)[g)+g: the branch that ``+``
starts is closed by the bracket of its parent. Tanveer et al.'s (2020b) rules are groups d(d)+d) joined by
``[``, one group a whorl: there each ``+`` has a
``)`` of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...spec import Grammar
from .production import System, read_system
from .rewrite import rewrite
from .word import Notation


@dataclass(frozen=True)
class LSystem:
    """An axiom and one production per rewritten symbol (one character each)."""

    axiom: str
    productions: Mapping[str, str]


T20 = LSystem(axiom="g)", productions={"g": "d(g)[g)+g"})


def whorled(whorls: int) -> LSystem:
    """A20's L-system: a trunk with so many whorls, rewritten once."""
    return LSystem(axiom="g", productions={"g": "[".join(["d(d)+d)"] * whorls)})


def system_of_grammar(grammar: Grammar) -> System:
    """The L-system of a species' grammar, Tanveer et al.'s (2020a or 2020b)."""
    return _system(whorled(grammar.whorls) if grammar.dialect == "A20" else T20)


def string_of(grammar: Grammar) -> np.ndarray:
    """The string of a species' grammar, Tanveer et al.'s (2020a or 2020b), as (S,) uint8 character codes."""
    if grammar.dialect == "A20":
        return derive(whorled(grammar.whorls), min(grammar.generations, 1))
    return derive(T20, grammar.generations)


def derive(system: LSystem, generations: int) -> np.ndarray:
    """The string after so many generations, as (S,) uint8 character codes.

    Raises
    ------
    ValueError : the string would be longer than ``rewrite.MAX_SYMBOLS``; says how long.
    """
    return rewrite(_system(system), generations).codes


def _system(system: LSystem) -> System:
    productions = [f"{symbol} -> {successor}" for symbol, successor in system.productions.items()]
    return read_system(system.axiom, productions, notation=Notation(parametric=False))
