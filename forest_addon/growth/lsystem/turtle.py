r"""A species' rules to a tree: the string is derived, read with a dialect, walked by the turtle, and pruned.

A dialect is the meaning of each symbol as a table of texts, which a user changes without code.

``F(l) = draw(l)`` gives a letter a command and the numbers that it takes, arithmetic over the letter's
own. A symbol without an entry is passed over, as ABOP does with the variables of a grammar.

ABOP: Prusinkiewicz & Lindenmayer, The Algorithmic Beauty of Plants, section 1.5 and appendix C. Turns
are right-handed about the turtle's up (+), left (&) and heading (\). simlidar: Méndez et al.; an
internode of generation n is h0/2^(n-1) long and N·dm/n thick, N being the number of generations.

What only turns or widens is joined to what follows it within its branch, to a step. A step turns by a fixed
rotation of the turtle's own frame, changes the diameter to diameter·factor + offset, and then does what the
last of its commands says: draw, move, level, bear a leaf, or nothing. A turtle has a fraction of the steps to
walk that its string has symbols.

Brackets say which step comes before each, as the turtle walks, and how far from the root. A bracket that
closes takes the turtle back to where it opened, so commands form a tree, found for the branches of one
bracket depth at once: sorted by depth, the commands of a branch stand together, in order, behind the bracket
that opens it.

All that is equally far from the root is walked at once. A turtle's state is a place, a frame (heading H, left
L, up U, kept as a quaternion), a diameter and the segment drawn last. Each step makes a new state of the one
before it on its path, so the steps of one level of ``paths`` are worked through together, whatever branches
they stand in. Tropism is ABOP's: after each segment the heading turns towards T by e·|H × T|, about H × T
(section 2.1, p. 58).

Méndez et al. prune: a branch whose turtle descends is removed with all that it bears.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ...base.rng import child_keys
from ...base.rows import RowTable
from ...spec import MAX_REACH, Leaf, Rules
from ..draw import draw_normal
from ..skeleton import LeafSites, Skeleton, depths, root_of
from .system import (
    Expression,
    ExpressionError,
    GrammarError,
    Notation,
    System,
    Word,
    parse_expression,
    read_constants,
    read_system,
    rewrite,
    split_arguments,
    written,
)

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
# Tables by kind of command; L, U and H, which it turns about, are x, y and z of the turtle's own frame.
_AXIS = np.array([{PITCH: 1, TURN: 2, ROLL: 3}.get(kind, 0) for kind in range(16)])
_TURNS = _AXIS > 0
_JOINS_ON = np.isin(np.arange(16), (TURN, PITCH, ROLL, WIDTH, THIN, BRANCH))
_STARTS = np.isin(np.arange(16), (BRANCH, END, OUTLINE, CLOSE))  # never joined to what is before
_PARALLEL = 1e-12  # |H × T| below which a heading counts as parallel: no bend, no roll
ROUNDING = 1e-9  # of a segment's length: less than this is not a descent but rounding
MAX_WALKED = 10_000_000  # symbols; a tree needs about 150 bytes a symbol


ABOP = Notation(
    symbols=(
        *("F = draw(length)", "F(l) = draw(l)", "f = move(length)", "f(l) = move(l)"),
        *("+ = turn(angle)", "+(a) = turn(a)", "- = turn(-angle)", "-(a) = turn(-a)"),
        *("& = pitch(angle)", "&(a) = pitch(a)", "^ = pitch(-angle)", "^(a) = pitch(-a)"),
        *("\\ = roll(angle)", "\\(a) = roll(a)", "/ = roll(-angle)", "/(a) = roll(-a)"),
        *("| = turn(180)", "$ = level", "! = thin(thinning)", "!(w) = width(w)"),
        *("~ = leaf", "~(l) = leaf(l)", "~(l, w) = leaf(l, w)"),
        *("[ = branch", "] = end", "{ = outline", "} = close"),
    ),
)
SIMLIDAR = Notation(
    tagged="I",
    symbols=(
        "I(n) = draw(h0 / 2^(n - 1), N * dm / n)",
        *("+ = pitch(angle)", "- = pitch(-angle)", "T = turn(rotation)", "t = turn(-rotation)"),
        *("F = leaf", "[ = branch", "] = end"),
    ),
)
DIALECTS = {"ABOP": ABOP, "simlidar": SIMLIDAR}


Commands = tuple[np.ndarray, np.ndarray]  # kind (C,) int8, number (C, 2) float64, NaN for none


def read_commands(word: Word, symbols: Sequence[str], known: Mapping[str, float]) -> Commands:
    """The commands of a string, symbol after symbol, without those that are passed over.

    symbols : entries of a dialect; of two for the same letter the later counts.
    known : names that entries may use besides a letter's own numbers.

    Raises
    ------
    GrammarError : an entry cannot be read, or a symbol bears more or fewer numbers than any entry takes.
    """
    meanings: dict[tuple[str, int], tuple[int, list[str], list[Expression]]] = {}
    for text in symbols:
        try:
            letter, meaning = _read_meaning(text, tuple(known))
        except (GrammarError, ExpressionError) as problem:
            raise GrammarError(f'symbol "{text}": {problem}') from None
        meanings[letter] = meaning
    first_value = word.first_value()
    kind = np.zeros(len(word), np.int8)
    number = np.full((len(word), MOST_NUMBERS), np.nan)
    for code, (symbol, arity) in word.alphabet.letters().items():
        where = np.flatnonzero(word.codes == code)
        if (symbol, arity) not in meanings:
            takes = sorted(count for other, count in meanings if other == symbol)
            if takes and len(where):
                counts = " or ".join(map(str, takes))
                raise GrammarError(f'"{symbol}" takes {counts} numbers, not {arity}')
            continue
        kind[where], names, expressions = meanings[symbol, arity]
        own = {name: word.values[first_value[where] + rank] for rank, name in enumerate(names)}
        for rank, expression in enumerate(expressions):
            number[where, rank] = expression({**known, **own})
    kept = kind != SKIP
    return kind[kept], number[kept]


@lru_cache(maxsize=256)
def _read_meaning(
    text: str, known: tuple[str, ...]
) -> tuple[tuple[str, int], tuple[int, list[str], list[Expression]]]:
    """The letter of an entry, and its command, the names of its numbers and what the command is given."""
    left, equals, right = text.strip()[1:].partition("=")
    if not equals:
        raise GrammarError('is not like "F(l) = draw(l)"')
    parameters = split_arguments(left.strip(), 0)[0] if left.strip() else []
    name, opened, _ = right.strip().partition("(")
    numbers = split_arguments(right.strip(), len(name))[0] if opened else []
    if name.strip() not in COMMANDS:
        raise GrammarError(f'"{name.strip()}" is not known; use one of {", ".join(COMMANDS)}')
    kind, fewest, most = COMMANDS[name.strip()]
    if not fewest <= len(numbers) <= most:
        raise GrammarError(f"{name.strip()} takes {fewest} to {most} numbers")
    expressions = [parse_expression(number, [*known, *parameters]) for number in numbers]
    return (text.strip()[0], len(parameters)), (kind, parameters, expressions)


@dataclass(frozen=True)
class Steps(RowTable):
    """R steps in the order of the string.

    kind, number : (R,), (R, 2) of the last command of each.
    turn : (R, 4) quaternion. factor, offset : (R,) of the diameter.
    opens, closes : (R,) whether a step starts with an opening bracket, or is a closing one.
    outline : (R,) number of the outermost outline that it stands in, from its opening on, or -1.
    """

    kind: np.ndarray
    number: np.ndarray
    turn: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    opens: np.ndarray
    closes: np.ndarray
    outline: np.ndarray


def join_commands(commands: Commands) -> Steps:
    """The steps of commands.

    Raises
    ------
    GrammarError : an outline closes that was not opened.
    """
    kind, number = commands
    opens = kind == OUTLINE
    depth = np.cumsum(opens.astype(np.int64) - (kind == CLOSE))
    if len(depth) and depth.min() < 0:
        raise GrammarError("an outline closes that was not opened")
    outline = np.where(depth > 0, np.cumsum(opens & (depth == 1)) - 1, -1)
    starts = np.ones(len(kind), bool)
    starts[1:] = ~_JOINS_ON[kind[:-1]] | _STARTS[kind[1:]]
    first = np.flatnonzero(starts)
    length = np.diff(np.append(first, len(kind)))
    last = first + length - 1

    turn = np.zeros((4, len(first)))
    turn[0] = 1.0
    factor, offset = np.ones(len(first)), np.zeros(len(first))
    for rank in range(int(length.max(initial=0))):
        step = np.flatnonzero(length > rank)
        does = kind[first[step] + rank]
        turns = _TURNS[does]
        at = step[turns]
        half = np.deg2rad(number[first[at] + rank, 0]) / 2
        local = np.zeros((4, len(at)))
        local[0] = np.cos(half)
        local[_AXIS[does[turns]], np.arange(len(at))] = np.sin(half)
        turn[:, at] = local if rank == 0 else product(turn[:, at], local)
        for command in (WIDTH, THIN):
            at = step[does == command]
            given = number[first[at] + rank, 0]
            factor[at] = 0.0 if command == WIDTH else factor[at] * given
            offset[at] = given if command == WIDTH else offset[at] * given
    return Steps(
        kind=kind[last],
        number=number[last],
        turn=turn.T,
        factor=factor,
        offset=offset,
        opens=kind[first] == BRANCH,
        closes=kind[first] == END,
        outline=outline[last],
    )


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(4, N) Hamilton products of quaternions."""
    out = np.empty_like(a)
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    return out


def find_paths(opens: np.ndarray, closes: np.ndarray) -> tuple[np.ndarray, ...]:
    """The tree of commands, given which of them (C,) open and which close a bracket.

    Brackets that stay open are closed by the end of the string.

    Returns
    -------
    (P,) commands that are no closing brackets, ascending; (P,) which of the P the turtle does before each,
    -1 where it starts; (P,) number of the pair of brackets that it stands in, 0 outside all, where a bracket
    that opens counts to the branch that it opens; (B,) branch that each branch leaves, -1 for branch 0: a
    parent has a smaller number.

    Raises
    ------
    GrammarError : a bracket closes that was not opened.
    """
    depth = np.cumsum(opens.astype(np.int64) - closes)
    if len(opens) and depth.min() < 0:
        at = int(np.flatnonzero(depth < 0)[0])
        raise GrammarError(f"step {at}: a bracket closes a branch that was not opened")
    command = np.flatnonzero(~closes)
    depth = depth[command]
    count = len(command)

    by_depth = np.argsort(depth, kind="stable")  # then by place in the string
    rank_opens = opens[command][by_depth]
    previous = np.append(-1, by_depth)[:count]  # in sorted order: what stands before

    # A bracket follows the last command that is one level up and further left.
    key = depth[by_depth] * (count + 1) + by_depth
    heads = np.flatnonzero(rank_opens)
    head = by_depth[heads]
    opening = np.searchsorted(key, (depth[head] - 1) * (count + 1) + head) - 1
    outside = (opening < 0) | (depth[by_depth[opening]] != depth[head] - 1)
    previous[heads] = np.where(outside, -1, by_depth[opening])

    before, branch = np.empty((2, count), np.int64)
    before[by_depth], branch[by_depth] = previous, np.cumsum(rank_opens)
    parent = np.append(-1, np.where(outside, 0, branch[previous[heads]]))
    return command, before, branch, parent


def walk(
    commands: Commands,
    diameter: float,
    tropism: tuple[float, float, float] = (0.0, 0.0, -1.0),
    elasticity: float = 0.0,
    prune_descending: bool = False,
) -> tuple[Skeleton, LeafSites]:
    """Walk a turtle from the origin along +Z, its left towards +X: its segments, in the order of the string,
    and its leaves, length and width NaN where the string says none; in its own unit.

    tropism : direction that segments bend to; its length counts, as in ABOP. elasticity : radians.
    prune_descending : leave out brackets in which a segment ends lower than it starts.

    Raises
    ------
    GrammarError : brackets do not match, or a diameter is negative.
    """
    steps = join_commands(commands)
    command, before, branch, parent = find_paths(steps.opens, steps.closes)
    steps = steps.select(command)  # without closing brackets
    kind, number, outline = steps.kind, steps.number, steps.outline
    drawn = (kind == DRAW) & (outline < 0)
    skeleton, turn, place, last = _states(
        steps, drawn, before, branch, diameter, np.asarray(tropism, np.float64), elasticity
    )
    bears = (kind == LEAF) & (outline < 0)
    outlines, begins = np.unique(outline, return_index=True)
    bears[begins[outlines >= 0]] = True
    leaf = np.flatnonzero(bears)
    leaves = LeafSites(
        foot=place[leaf],
        direction=_heading(turn[:, leaf]).T,
        up=_up(turn[:, leaf]).T,
        length=np.where(kind[leaf] == LEAF, number[leaf, 0], np.nan),
        width=np.where(kind[leaf] == LEAF, number[leaf, 1], np.nan),
        segment=last[leaf],
    )
    _measure_outlines(leaves, leaf, outline, place)
    if prune_descending:
        rise = skeleton.end[:, 2] - skeleton.start[:, 2]
        removed = np.zeros(len(parent), bool)
        removed[branch[drawn][rise < -ROUNDING * skeleton.length]] = True
        removed = removed[root_of(np.where(removed, -1, parent))]  # and all that these bear
        kept = ~removed[branch[drawn]]
        # What a kept segment hangs on is kept too: it stands in the same branch or in one below.
        number = np.append(np.cumsum(kept) - 1, -1)
        leaves = leaves.select(~removed[branch[leaf]])
        leaves, skeleton = replace(leaves, segment=number[leaves.segment]), skeleton.some(kept)
    return skeleton, leaves


def _states(
    steps: Steps,
    drawn: np.ndarray,
    after: np.ndarray,
    branch: np.ndarray,
    diameter: float,
    tropism: np.ndarray,
    elasticity: float,
) -> tuple[Skeleton, np.ndarray, np.ndarray, np.ndarray]:
    """The segments; and, of the turtle after each of P steps, the quaternion (4, P) from its frame to the
    world, its place (P, 3), and the segment (P,) drawn last.

    after : (P,) the step that each one follows. Level by level, in arrays sorted by level; place 0 is the
        turtle before all steps.
    """
    count, depth = len(steps.kind), depths(after)
    by_level = np.argsort(depth, kind="stable")
    slot = np.zeros(count + 1, np.int64)  # where each step's state is; the last is "none before"
    slot[by_level] = np.arange(1, count + 1)
    before, branch = slot[after[by_level]], branch[by_level]
    own = (np.cumsum(drawn) - 1)[by_level]  # number of the segment that a step draws
    kind, number, draws = steps.kind[by_level], steps.number[by_level], drawn[by_level]
    local, factor, offset = steps.turn[by_level].T, steps.factor[by_level], steps.offset[by_level]

    reach = np.where((kind == DRAW) | (kind == MOVE), number[:, 0], 0.0)
    levels_left = kind == LEVEL
    bends = draws & (reach != 0) & (elasticity != 0)

    turn, place = np.zeros((4, count + 1)), np.zeros((3, count + 1))
    turn[0, 0] = 1.0
    width = np.full(count + 1, diameter)
    last, parent, last_branch, generation = np.full((4, count + 1), -1)
    order = np.zeros(count + 1, np.int64)

    ends = np.searchsorted(depth[by_level], np.arange(int(depth.max(initial=-1)) + 2))
    for begin, end in pairwise(ends.tolist()):
        here, new, old = slice(begin, end), slice(begin + 1, end + 1), before[begin:end]
        turned = product(turn.take(old, axis=1), local[:, here])
        rolls = np.flatnonzero(levels_left[here])
        if len(rolls):
            turned[:, rolls] = _level(turned[:, rolls])
        place[:, new] = place.take(old, axis=1) + reach[here] * _heading(turned)
        bent = np.flatnonzero(bends[here])
        if len(bent):
            turned[:, bent] = _bend(turned[:, bent], tropism, elasticity)
        turn[:, new] = turned
        width[new] = width[old] * factor[here] + offset[here]

        draw, parent[new] = draws[here], last[old]
        last[new] = np.where(draw, own[here], last[old])
        leaves_axis = (last[old] >= 0) & (last_branch[old] != branch[here])
        order[new] = order[old] + (draw & leaves_axis)
        generation[new] = generation[old] + draw
        last_branch[new] = np.where(draw, branch[here], last_branch[old])

    if (width[1:] < 0).any():
        raise GrammarError("a diameter is negative; make it 0 or larger")
    back, place = slot[:count], np.ascontiguousarray(place.T)
    row = back[drawn]
    given = number[row - 1, 1]
    radius = np.where(np.isnan(given), width[row], given) / 2
    skeleton = Skeleton(
        start=place[slot[after[drawn]]],
        end=place[row],
        radius=np.stack([radius, radius], axis=1),
        parent=parent[row],
        order=order[row],
        generation=generation[row],
    )
    return skeleton, turn[:, back], place[back], last[back]


def _heading(q: np.ndarray) -> np.ndarray:
    """(3, N) the image of the turtle's z; the norm is divided out, so rounding cannot build up."""
    w, x, y, z = q
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    image = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), ww - xx - yy + zz])
    return np.asarray(image / (ww + xx + yy + zz))


def _up(q: np.ndarray) -> np.ndarray:
    """(3, N) the image of its y."""
    w, x, y, z = q
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    image = np.stack([2 * (x * y - w * z), ww - xx + yy - zz, 2 * (y * z + w * x)])
    return np.asarray(image / (ww + xx + yy + zz))


def _level(q: np.ndarray) -> np.ndarray:
    """Rolled about the heading until left is horizontal, V × H; a vertical heading keeps its roll."""
    heading, up = _heading(q), _up(q)
    left = np.cross(up, heading, axis=0)
    wanted = np.stack([-heading[1], heading[0], np.zeros(q.shape[1])])
    length = np.hypot(wanted[0], wanted[1])
    # left -> cos·left + sin·up, right-handed about the heading
    angle = np.arctan2((up * wanted).sum(axis=0), (left * wanted).sum(axis=0))
    half = np.where(length > 1e-9, angle, 0.0) / 2
    zero = np.zeros_like(half)
    return product(q, np.stack([np.cos(half), zero, zero, np.sin(half)]))


def _bend(q: np.ndarray, tropism: np.ndarray, elasticity: float) -> np.ndarray:
    """Turned towards the tropism by elasticity·|H × T|; a heading along it, or against it, stays."""
    axis = np.cross(_heading(q), tropism, axis=0)
    size = np.sqrt((axis * axis).sum(axis=0))
    half = elasticity * size / 2
    axis = axis / np.maximum(size, _PARALLEL)
    return product(np.concatenate([np.cos(half)[None], np.sin(half) * axis]), q)


def _measure_outlines(
    leaves: LeafSites, leaf: np.ndarray, outline: np.ndarray, place: np.ndarray
) -> None:
    """Fill in length and width of leaves that were walked: their extents along and across."""
    walked = np.flatnonzero(outline[leaf] >= 0)
    if not len(walked):
        return
    row = np.full(int(outline.max()) + 1, -1)
    row[outline[leaf[walked]]] = walked
    inside = np.flatnonzero(outline >= 0)
    owner = row[outline[inside]]
    offset = place[inside] - leaves.foot[owner]
    left = np.cross(leaves.up, leaves.direction)
    for out, axis in ((leaves.length, leaves.direction), (leaves.width, left)):
        along = np.einsum("ni,ni->n", offset, axis[owner])
        low, high = np.zeros((2, len(leaf)))
        np.minimum.at(low, owner, along)
        np.maximum.at(high, owner, along)
        out[walked] = (high - low)[walked]


@lru_cache(maxsize=16)
def system_of(rules: Rules) -> System:
    """The L-system that rules describe; read once for all trees of a species.

    Raises
    ------
    GrammarError : they cannot be read; says where.
    """
    constants = {"N": float(rules.generations), **read_constants(rules.constants)}
    return read_system(rules.axiom, rules.productions, constants, DIALECTS[rules.dialect])


def grow_ruled(
    rules: Rules, leaf: Leaf, key: int, rng: np.random.Generator
) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree in metres.

    key : lineage of the tree, from which sizes of leaves are drawn. rng : draws of the productions.
    """
    word = rewrite(system_of(rules), rules.generations, rng, MAX_WALKED)
    skeleton, leaves = walk(
        _commands(rules, word),
        rules.diameter,
        rules.tropism,
        rules.elasticity,
        rules.prune_descending,
    )
    scaled = replace(
        skeleton,
        start=skeleton.start * rules.scale,
        end=skeleton.end * rules.scale,
        radius=skeleton.radius * rules.scale,
    )
    reach = float(np.abs(scaled.end).max(initial=0.0))
    if reach > MAX_REACH:
        raise ValueError(
            f"branches reach {written(reach)} m from the foot, more than {MAX_REACH:g} m; "
            "use a smaller scale, smaller ratios or fewer generations"
        )
    if not leaf.on:
        return scaled, LeafSites.none()
    # Length and width of a leaf are what the string says, else drawn.
    keys = child_keys(np.full(len(leaves), key, np.uint64), np.arange(len(leaves)))
    drawn = draw_normal(leaf.length, keys, "leaf length")
    length = np.where(np.isnan(leaves.length), drawn, leaves.length * rules.scale)
    ratio = draw_normal(leaf.width_ratio, keys, "leaf width")
    width = np.where(np.isnan(leaves.width), length * ratio, leaves.width * rules.scale)
    return scaled, replace(leaves, foot=leaves.foot * rules.scale, length=length, width=width)


def check_rules(rules: Rules) -> None:
    """Read all of the rules without growing anything.

    Raises
    ------
    GrammarError, ExpressionError : they cannot be read; says where.
    """
    _commands(rules, system_of(rules).axiom)


def _commands(rules: Rules, word: Word) -> Commands:
    known = {
        "length": rules.length,
        "angle": rules.angle_deg,
        "rotation": rules.rotation_deg,
        "thinning": rules.thinning,
        "N": float(rules.generations),
        **read_constants(rules.constants),
    }
    return read_commands(word, (*DIALECTS[rules.dialect].symbols, *rules.symbols), known)
