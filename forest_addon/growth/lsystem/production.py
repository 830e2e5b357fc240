"""Productions as texts, in the notation of ABOP and cpfg, to tables that the rewriter reads.

``A(l, w) : l > 0.1 -> !(w)F(l)A(l*r, w) : 1/3``: predecessor, condition, successor, probability. Of the
productions of one letter, those with the same condition are alternatives; the first condition that holds
decides, and where none holds the symbol stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .expression import Expression, ExpressionError, parse_expression
from .word import Alphabet, GrammarError, Notation, Word, read_modules, split_arguments


@dataclass(frozen=True)
class Production:
    """One successor: its letters and the numbers that they bear, all in one row.

    parameters : names of the predecessor's numbers.
    """

    parameters: tuple[str, ...]
    codes: np.ndarray
    expressions: tuple[Expression, ...]


@dataclass(frozen=True)
class Case:
    """Alternatives where a condition holds: numbers of productions, and how likely each is."""

    condition: Expression | None
    productions: tuple[int, ...]
    chances: tuple[float, ...]


@dataclass(frozen=True)
class System:
    """An L-system ready to rewrite.

    stay : (256,) number of the production by which a letter stays what it is.
    cases : by code; a letter without cases stays.
    """

    axiom: Word
    productions: list[Production]
    stay: np.ndarray
    cases: dict[int, list[Case]]
    constants: dict[str, float]

    @property
    def conditional(self) -> bool:
        """Return whether a symbol's numbers can decide what becomes of it."""
        return any(case.condition for cases in self.cases.values() for case in cases)

    @property
    def stochastic(self) -> bool:
        """Return whether chance can."""
        return any(len(case.chances) > 1 for cases in self.cases.values() for case in cases)


@dataclass
class _Rule:
    """A production as it was written."""

    text: str
    condition: str
    chance: float | None
    production: Production


@dataclass
class _Reader:
    alphabet: Alphabet
    constants: dict[str, float]
    rules: dict[int, list[_Rule]] = field(default_factory=dict)


def read_constants(texts: Sequence[str]) -> dict[str, float]:
    """Named numbers, each ``name = arithmetic`` over those before it.

    Raises
    ------
    GrammarError : no ``=``, a bad or taken name. ExpressionError : bad arithmetic.
    """
    known: dict[str, float] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name.isidentifier():
            raise GrammarError(f'constant "{text}" is not like "name = number"')
        if name in known or name in ("n", "N"):
            raise GrammarError(f'constant "{name}" is taken; use another name')
        known[name] = float(parse_expression(value, known)(known))
    return known


def read_system(
    axiom: str,
    productions: Sequence[str],
    constants: Mapping[str, float] | None = None,
    notation: Notation | None = None,
) -> System:
    """An L-system from its texts.

    Raises
    ------
    GrammarError : what cannot be read, with the production that it is in.
    """
    reader = _Reader(Alphabet(notation or Notation()), dict(constants or {}))
    reader.constants.setdefault("n", 0.0)
    try:
        start = _read_word(axiom, reader)
    except (ExpressionError, GrammarError) as problem:
        raise GrammarError(f"axiom: {problem}") from None
    for text in productions:
        try:
            _read_production(text, reader)
        except (ExpressionError, GrammarError) as problem:
            raise GrammarError(f'production "{text}": {problem}') from None
    return _tabulate(start, reader)


def _read_word(text: str, reader: _Reader) -> Word:
    modules = read_modules(text, reader.alphabet.notation, list(reader.constants))
    codes = [reader.alphabet.code(symbol, len(given)) for symbol, given in modules]
    values = [float(number(reader.constants)) for _, given in modules for number in given]
    return Word(np.array(codes, np.uint8), np.array(values, np.float64), reader.alphabet)


def _read_production(text: str, reader: _Reader) -> None:
    left, arrow, right = text.partition("->")
    if not arrow:
        raise GrammarError('has no "->"')
    predecessor, _, condition = left.partition(":")
    successor, _, chance = right.partition(":")
    symbol, parameters = _read_predecessor(predecessor.strip(), reader)
    names = [*reader.constants, *parameters]
    modules = read_modules(successor, reader.alphabet.notation, names)
    production = Production(
        parameters=tuple(parameters),
        codes=np.array([reader.alphabet.code(s, len(given)) for s, given in modules], np.uint8),
        expressions=tuple(number for _, given in modules for number in given),
    )
    if condition.strip():
        parse_expression(condition, names)
    likely = float(parse_expression(chance, [])({})) if chance.strip() else None
    if likely is not None and not 0 < likely <= 1:
        raise GrammarError(f"its probability {likely:g} must be larger than 0 and at most 1")
    rules = reader.rules.setdefault(reader.alphabet.code(symbol, len(parameters)), [])
    rules.append(_Rule(text, condition.strip(), likely, production))


def _read_predecessor(text: str, reader: _Reader) -> tuple[str, list[str]]:
    if not text:
        raise GrammarError('has no symbol before "->"')
    symbol, rest = text[0], text[1:].strip()
    parameters: list[str] = []
    if symbol in reader.alphabet.notation.tagged and rest == "n":
        raise GrammarError(f'write "{symbol}(name)", not "{text}", before the "->"')
    if rest:
        if not rest.startswith("(") or not reader.alphabet.notation.parametric:
            raise GrammarError(f'"{text}" is more than one symbol')
        parameters, end = split_arguments(rest, 0)
        if rest[end:].strip():
            raise GrammarError(f'"{text}" is more than one symbol')
    for name in parameters:
        if not name.isidentifier():
            raise GrammarError(f'"{name}" is not a name')
        if name in reader.constants or name == "N" or parameters.count(name) > 1:
            raise GrammarError(f'the name "{name}" is taken; use another')
    return symbol, parameters


def _tabulate(axiom: Word, reader: _Reader) -> System:
    productions: list[Production] = []
    cases: dict[int, list[Case]] = {}
    for code, rules in reader.rules.items():
        cases[code] = []
        for condition in dict.fromkeys(rule.condition for rule in rules):
            alike = [rule for rule in rules if rule.condition == condition]
            first = len(productions)
            productions += [rule.production for rule in alike]
            holds = None
            if condition:
                names = [*reader.constants, *alike[0].production.parameters]
                holds = parse_expression(condition, names)
                # The names of a condition are those of its first production.
                if any(r.production.parameters != alike[0].production.parameters for r in alike):
                    raise GrammarError(
                        f'production "{alike[-1].text}": give its numbers the names that '
                        f'"{alike[0].text}" gives them'
                    )
            numbers = tuple(range(first, len(productions)))
            cases[code].append(Case(holds, numbers, _chances(alike)))

    stay = np.zeros(256, np.int64)
    letters = reader.alphabet.letters()
    for code in range(256):
        symbol_arity = letters.get(code, ("", 0))[1]
        names_ = tuple(f"#{k}" for k in range(symbol_arity))
        stay[code] = len(productions)
        productions.append(
            Production(
                names_,
                np.array([code], np.uint8),
                tuple(Expression(name, (("name", name),)) for name in names_),
            )
        )
    return System(axiom, productions, stay, cases, reader.constants)


def _chances(alike: list[_Rule]) -> tuple[float, ...]:
    given = [rule.chance for rule in alike]
    if len(alike) > 1 and None in given:
        raise GrammarError(
            f'production "{alike[given.index(None)].text}": has a rival of the same predecessor and '
            "condition; give both a probability"
        )
    chances = [1.0 if chance is None else chance for chance in given]
    if abs(sum(chances) - 1) > 1e-3:
        raise GrammarError(
            f'production "{alike[0].text}": probabilities of its predecessor add up to '
            f"{sum(chances):g}; make it 1"
        )
    total = sum(chances)
    return tuple(chance / total for chance in chances)
