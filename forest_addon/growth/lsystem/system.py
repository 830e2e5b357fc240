"""L-systems: their strings, their productions, and parallel rewriting, all on arrays.

A string is one byte a symbol, and the numbers of all symbols in one row. A letter is a symbol together with
how many numbers it bears, so ``F`` and ``F(1.5)`` are two letters. A letter without numbers has its
character's code; the others get codes that no character of a grammar has.

Productions are texts in the notation of ABOP and cpfg. ``A(l, w) : l > 0.1 -> !(w)F(l)A(l*r, w) : 1/3``:
predecessor, condition, successor, probability. Of the productions of one letter, those with the same
condition are alternatives; the first condition that holds decides, and where none holds the symbol stays.

Every symbol of a string is replaced at once, generation by generation. Before a derivation starts its length
is predicted: exactly, or as an expectation where chance decides; where conditions decide nothing can be said,
and each generation is measured before it is made. What would not fit is refused with the number. Strings are
worked through in blocks, so a derivation needs little more memory than its last two strings.

Arithmetic in productions, read by Python's parser and computed on arrays; nothing is evaluated as Python.

Of a text's syntax tree only numbers, known names, and the operators and functions of the tables below are
taken; anything else is refused. Each operation works on whole arrays, one value for every occurrence of a
symbol. Operators, from the loosest: ``||``, ``&&``, ``== != < <= > >=``, ``+ -``, ``* /``, sign and ``!``,
``^``. Truth is 1 and 0. Angles of ``sin cos tan`` are degrees, as everywhere in a production.
"""

from __future__ import annotations

import ast
import difflib
import math
import re
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

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
        """Value of the expression for these values of its variables, numbers or arrays of one length.

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


# Codes of letters with numbers: control characters and what lies beyond ASCII.
_FREE = [*range(1, 32), *range(128, 256)]
MAX_SYMBOLS = 50_000_000
MAX_NUMBERS = 60_000_000  # float64 numbers that all symbols of a string bear
BLOCK = 1 << 16  # symbols rewritten at a time: their arrays stay in the cache


class GrammarError(ValueError):
    """A grammar that cannot be used; the text says what and where."""


@dataclass(frozen=True)
class Notation:
    """Notation of strings: whether ``(`` opens numbers, the letters that bear a tag, and what letters mean.

    tagged : a letter of these followed by ``n`` is given the generation in which it is made: ``In``
        stands for I(n) and is printed I01, I02, ... (Méndez et al.).
    symbols : commands of the turtle, as ``F(l) = draw(l)``; none where it does not walk.
    """

    parametric: bool = True
    tagged: str = ""
    symbols: tuple[str, ...] = ()


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


@dataclass(frozen=True)
class Production:
    """One successor: its letters and the numbers that they bear, all in one row.

    parameters : names of the predecessor's numbers. text, condition, chance : as it was written.
    """

    parameters: tuple[str, ...]
    codes: np.ndarray
    expressions: tuple[Expression, ...]
    text: str = ""
    condition: str = ""
    chance: float | None = None


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
        """True where a symbol's numbers can decide what becomes of it."""
        return any(case.condition for cases in self.cases.values() for case in cases)

    @property
    def stochastic(self) -> bool:
        """True where chance can decide it."""
        return any(len(case.chances) > 1 for cases in self.cases.values() for case in cases)


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
    alphabet, known = Alphabet(notation or Notation()), {**(constants or {})}
    known.setdefault("n", 0.0)
    rules: dict[int, list[Production]] = {}
    place = "axiom"
    try:
        modules = read_modules(axiom, alphabet.notation, list(known))
        codes = [alphabet.code(symbol, len(given)) for symbol, given in modules]
        values = [float(number(known)) for _, given in modules for number in given]
        for text in productions:
            place = f'production "{text}"'
            code, rule = _read_production(text, alphabet, known)
            rules.setdefault(code, []).append(rule)
    except (ExpressionError, GrammarError) as problem:
        raise GrammarError(f"{place}: {problem}") from None
    start = Word(np.array(codes, np.uint8), np.array(values, np.float64), alphabet)

    every: list[Production] = []
    cases: dict[int, list[Case]] = {code: [] for code in rules}
    for code, written_ones in rules.items():
        for condition in dict.fromkeys(rule.condition for rule in written_ones):
            alike = [rule for rule in written_ones if rule.condition == condition]
            numbers = tuple(range(len(every), len(every) + len(alike)))
            every += alike
            holds = None
            if condition:
                holds = parse_expression(condition, [*known, *alike[0].parameters])
                # The names of a condition are those of its first production.
                if any(rule.parameters != alike[0].parameters for rule in alike):
                    raise GrammarError(
                        f'production "{alike[-1].text}": give its numbers the names that '
                        f'"{alike[0].text}" gives them'
                    )
            cases[code].append(Case(holds, numbers, _chances(alike)))

    stay, letters = np.arange(256) + len(every), alphabet.letters()
    for code in range(256):
        names = tuple(f"#{k}" for k in range(letters.get(code, ("", 0))[1]))
        same = tuple(Expression(name, name) for name in names)
        every.append(Production(names, np.array([code], np.uint8), same))
    return System(start, every, stay, cases, known)


def _read_production(
    text: str, alphabet: Alphabet, known: Mapping[str, float]
) -> tuple[int, Production]:
    """The code of a production's predecessor, and the production."""
    left, arrow, right = text.partition("->")
    if not arrow:
        raise GrammarError('has no "->"')
    predecessor, _, condition = left.partition(":")
    successor, _, chance = right.partition(":")
    symbol, parameters = _read_predecessor(predecessor.strip(), alphabet.notation, known)
    names = [*known, *parameters]
    modules = read_modules(successor, alphabet.notation, names)
    codes = [alphabet.code(letter, len(given)) for letter, given in modules]
    if condition.strip():
        parse_expression(condition, names)
    likely = float(parse_expression(chance, [])({})) if chance.strip() else None
    if likely is not None and not 0 < likely <= 1:
        raise GrammarError(f"its probability {likely:g} must be larger than 0 and at most 1")
    expressions = tuple(number for _, given in modules for number in given)
    rule = Production(
        tuple(parameters), np.array(codes, np.uint8), expressions, text, condition.strip(), likely
    )
    return alphabet.code(symbol, len(parameters)), rule


def _read_predecessor(
    text: str, notation: Notation, known: Mapping[str, float]
) -> tuple[str, list[str]]:
    if not text:
        raise GrammarError('has no symbol before "->"')
    symbol, rest, parameters = text[0], text[1:].strip(), list[str]()
    if symbol in notation.tagged and rest == "n":
        raise GrammarError(f'write "{symbol}(name)", not "{text}", before the "->"')
    if rest:
        end = 0
        if rest.startswith("(") and notation.parametric:
            parameters, end = split_arguments(rest, 0)
        if not end or rest[end:].strip():
            raise GrammarError(f'"{text}" is more than one symbol')
    for name in parameters:
        if not name.isidentifier():
            raise GrammarError(f'"{name}" is not a name')
        if name in known or name == "N" or parameters.count(name) > 1:
            raise GrammarError(f'the name "{name}" is taken; use another')
    return symbol, parameters


def _chances(alike: list[Production]) -> tuple[float, ...]:
    given = [rule.chance for rule in alike]
    if len(alike) > 1 and None in given:
        raise GrammarError(
            f'production "{alike[given.index(None)].text}": has a rival of the same predecessor and '
            "condition; give both a probability"
        )
    chances = [1.0 if chance is None else chance for chance in given]
    total = sum(chances)
    if abs(total - 1) > 1e-3:
        raise GrammarError(
            f'production "{alike[0].text}": probabilities of its predecessor add up to '
            f"{total:g}; make it 1"
        )
    return tuple(chance / total for chance in chances)


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
    chance, alphabet = system.stochastic, system.axiom.alphabet
    contents: dict[int, dict[int, float]] = {code: defaultdict(int) for code in alphabet.letters()}
    for code, letters_of in contents.items():  # what a letter becomes
        cases = system.cases.get(code)
        first = cases[0] if cases else Case(None, (int(system.stay[code]),), (1.0,))
        for number, likely in zip(first.productions, first.chances, strict=True):
            for made in system.productions[number].codes.tolist():
                letters_of[made] += likely if chance else 1
    counts: dict[int, float] = dict(Counter(system.axiom.codes.tolist()))
    for _ in range(generations):
        following: dict[int, float] = defaultdict(int)
        for code, count in counts.items():
            for successor, times in contents[code].items():
                following[successor] += count * times
        counts = following
    letters: dict[str, float] = defaultdict(int)
    numbers: float = 0
    for code, count in counts.items():
        symbol, arity = alphabet.letters()[code]
        letters[symbol] += count
        numbers += count * arity
    certain = not (chance or system.conditional)
    return Prediction(sum(counts.values()), numbers, certain, dict(letters))


def rewrite(
    system: System,
    generations: int,
    rng: np.random.Generator | None = None,
    most: int = MAX_SYMBOLS,
) -> Word:
    """The string after so many generations.

    rng : draws where productions have probabilities, one number an occurrence in the order of the string.

    Raises
    ------
    ValueError : more than ``most`` symbols; says how many. ExpressionError : a number is not finite.
    """
    if not system.conditional:
        _refuse_if_large(predict(system, generations), most, generations)
    word = system.axiom
    for generation in range(1, generations + 1):
        word = _step(system, word, generation, generations, rng, most)
    return word


def _step(
    system: System,
    word: Word,
    generation: int,
    generations: int,
    rng: np.random.Generator | None,
    most: int,
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
    _refuse_if_large(Prediction(symbols, numbers, True), most, generations, generation)

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


def _refuse_if_large(
    size: Prediction, most: int, generations: int, reached: int | None = None
) -> None:
    for count, limit, what in (
        (size.symbols, most, "symbols"),
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
