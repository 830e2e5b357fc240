"""A tree recognised in facets: its trunk, what hangs on what, and which wood bears which leaf.

Facets of wood and of leaves go in, in any unit, z up. They are parted into pieces (``pieces``), joined wood
is cut at its forks (``sever``) and a palm's fronds become branches; the wood gets centrelines
(``centreline``) and parents, every leaf its bearer. ``template`` cuts the tree along these lines; a picture
of it can be drawn from them.

A trunk that bears no wood but long leaves is a palm's. Each frond gets a midrib, a thin tube along its
centreline from the trunk's axis to its tip, which is its branch and bears it; so a palm is made of the
same pieces as other trees.

The trunk is, of the pieces at least ``STOUT`` times as thick at an end as the thickest is, the one that
reaches lowest; where several begin at the same level (a bush), the largest. Roots are too thin to be
taken for it, limbs begin too high.

Everything else is hung on it from the inside out, generation by generation. A piece hangs on a parent
when one of its ends reaches the parent's wood; its foot is that end. A piece that tapers clearly has its
foot at the thick end, so a thin tip that happens to touch a neighbour does not hang on it. Earlier
generations come first, so branches of one whorl hang on the trunk and not on each other. What touches
nothing is hung on what fits best, smallest gaps first, then again what touches it: nearer wood is better,
but not if it is much thinner than the foot, nor if the foot points away from it. A stout piece that stands on
the ground beside the trunk without touching it, or whose foot is nearer to the ground than to any wood, is a
stem of its own. Wood is taken as tubes about
centrelines, which also tells that a foot deep inside the trunk touches it.

The parent of a piece that begins deep within another one is plain (``root``). A tip or a flank may touch any
wood; a foot that was drawn from its parent's axis lies near that axis. An end is rooted in a piece where it
is at most half the piece's radius off its axis, the piece is no thinner there than the end, and it is not
where the piece itself begins (there, feet of a whorl lie within one another). Of several, the one whose axis
is nearest in its own radii is the parent; less likely is a thinner end of the piece, and an end of another
one as thin as it, which may be that of another child that begins at the same place. What is rooted nowhere is
left to whatever it touches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rows import lengths
from ...base.runs import firsts
from ...base.vectors import unit, zenith_of
from ..mesh.meshing import tube
from .centreline import Centrelines, Tubes, find_centrelines, find_contacts
from .pieces import Pieces, assemble, join_pieces, part
from .sever import Known, join_stacked, may_fork, sever

LONG = 0.08  # heights of the trunk that a frond is long at least
FEWEST = 3
SLENDER = 0.004  # of a frond's length is its midrib's radius, at the trunk
SIDES = 4
MOST_LEAN = np.deg2rad(60.0)
LOWER = 0.15  # share of the trunk's length, from its foot, that may stand upright for all
FARTHEST_WOOD = 0.25  # heights of the tree between a piece and what it hangs on
LARGEST_LEAF = 0.5  # extents of the wood; what is larger is foliage in one piece, and no leaf
FLOATING = 0.01  # heights between a piece and what it hangs on, above which that is a guess
FLOATING_LEAF = 0.05  # extents of the wood between it and a leaf, likewise
FARTHEST_LEAVES = 0.5  # extents of the wood between it and half of the leaves


def are_fronds(trunk: Centrelines, leaves: Pieces) -> bool:
    """Tell whether the leaves are so long that they are a palm's fronds."""
    if leaves.count < FEWEST:
        return False
    low, high = leaves.boxes()
    long = float(np.median(np.linalg.norm(high - low, axis=1)))
    return long >= LONG * float(trunk.length().max())


def draw_midribs(
    timber: Pieces, lines: Centrelines, leaves: Pieces
) -> tuple[Pieces, Centrelines, Known]:
    """The trunk and a midrib for each frond, in their order; their lines, and that they hang on it."""
    fronds = find_centrelines(leaves)
    ends = fronds.ends()
    touch = find_contacts(lines, np.array([0]), ends.reshape(-1, 3))
    gap = touch.gap.reshape(-1, 2)
    foot_end = np.argmin(gap, axis=1)
    row = np.arange(leaves.count)
    along = touch.along.reshape(-1, 2)[row, foot_end]
    foot = np.stack([np.interp(along, lines.along, x) for x in lines.knot.T], axis=1)
    thick = touch.radius.reshape(-1, 2)[row, foot_end]
    vertices, triangles, piece, count = [], [], [], 0
    for number in range(leaves.count):
        knots = fronds.knot[fronds.first[number] : fronds.first[number + 1]]
        knots = knots[::-1] if foot_end[number] else knots
        knots = np.concatenate([foot[number : number + 1], knots])
        for _ in range(
            min(len(knots) // 2, 12)
        ):  # they lie now on one half of a frond, now on the other
            knots[1:-1] = (knots[:-2] + 2 * knots[1:-1] + knots[2:]) / 4
        step = np.linalg.norm(np.diff(knots, axis=0), axis=1)
        knots = knots[np.concatenate([[True], step > 1e-9 * step.sum()])]
        radius = SLENDER * float(step.sum()) * np.linspace(1.0, 0.25, len(knots))
        corners, facets = tube(knots, radius, SIDES)
        vertices.append(corners)
        triangles.append(facets.astype(np.int64) + count)
        piece.append(np.full(len(facets), number))
        count += len(corners)
    midribs = assemble(
        np.concatenate(vertices), np.concatenate(triangles), np.concatenate(piece), drawn=0
    )
    whole = join_pieces(timber, midribs)
    known = Known(
        np.concatenate([[-1], np.zeros(leaves.count, dtype=np.int64)]),
        np.concatenate([np.zeros((1, 3)), foot]),
        np.concatenate([[0.0], thick]),
    )
    return whole, find_centrelines(whole), known


class TemplateError(ValueError):
    """Facets that are no tree to take templates from: one sentence with what and what to do.

    places : (N, 3) where, in the units and axes of the facets; none if it is not about a place.
    """

    def __init__(self, sentence: str, places: np.ndarray | None = None) -> None:
        super().__init__(sentence)
        self.places = np.empty((0, 3)) if places is None else np.reshape(places, (-1, 3))


class LeanError(TemplateError):
    """Error: the piece that looks like the trunk lies down; perhaps another axis points up."""


@dataclass(frozen=True)
class Doubt:
    """Doubt about what was recognised: a sentence, and the (N, 3) places where."""

    sentence: str
    places: np.ndarray


@dataclass(frozen=True)
class Recognition:
    """Result of the recognition, in the units of the facets: C pieces of wood and L leaves.

    wood : the pieces of wood; ``wood.piece`` is the piece of each triangle.
    lines : their centrelines.
    trunk : piece.
    parent : (C,) piece that each hangs on, -1 for the trunk and for stems that stand apart from it.
    branch : (C,) first-level branch that each belongs to, itself if it is one or stands apart,
        -1 for the trunk.
    foot_end : (C,) which end of its centreline is the foot, 0 first or 1 last.
    gap : (C,) from its foot to the wood it hangs on, negative inside it; 0 on the ground.
    leaves : the leaves, as pieces; ``leaves.piece`` is the leaf of each triangle.
    bearer : (L,) int64, the piece of wood that bears each leaf.
    doubts : what may be wrong, and where.
    fronds : whether the leaves are a palm's fronds, on midribs that were drawn through them.
    """

    wood: Pieces
    lines: Centrelines
    trunk: int
    parent: np.ndarray
    branch: np.ndarray
    foot_end: np.ndarray
    gap: np.ndarray
    leaves: Pieces
    bearer: np.ndarray
    doubts: tuple[Doubt, ...] = ()
    fronds: bool = False

    @property
    def firsts(self) -> np.ndarray:
        """First-level branches, stems that stand apart from the trunk among them."""
        return np.flatnonzero(self.branch == np.arange(len(self.branch)))

    @property
    def foot(self) -> np.ndarray:
        """(C, 3) middle of the end at which each piece hangs."""
        return self._of_end(self.lines.ends(), self.foot_end)

    @property
    def tip(self) -> np.ndarray:
        """(C, 3) middle of the other end."""
        return self._of_end(self.lines.ends(), 1 - self.foot_end)

    @property
    def radius(self) -> np.ndarray:
        """(C,) radius at the foot."""
        return self._of_end(self.lines.end_radius, self.foot_end)

    @property
    def origin(self) -> np.ndarray:
        """(3,) where the tree stands: the middle of the trunk's foot, as low as the trunk reaches."""
        lowest = self.wood.vertices[self.wood.piece_of_vertex == self.trunk, 2].min()
        return np.array([*self.foot[self.trunk, :2], lowest])

    @property
    def stems(self) -> np.ndarray:
        """Pieces that stand on the ground as the trunk does, itself first: several in a bush."""
        level = LEVEL * np.ptp(self.wood.vertices[:, 2]) + self.radius[self.trunk]
        beside = self.foot[:, 2] <= self.foot[self.trunk, 2] + level
        beside &= (self.parent == self.trunk) | (self.parent < 0)
        beside &= (np.arange(len(beside)) != self.trunk) & (self.tip[:, 2] > self.foot[:, 2])
        beside &= self.radius >= STEM * self.radius[self.trunk]
        return np.concatenate([[self.trunk], np.flatnonzero(beside)])

    @staticmethod
    def _of_end(values: np.ndarray, end: np.ndarray) -> np.ndarray:
        return np.asarray(values[np.arange(len(end)), end])


def recognise(wood: np.ndarray, leaves: np.ndarray | None = None) -> Recognition:
    """Recognise a tree in facets (T, 3, 3) of its wood and of its leaves.

    Raises
    ------
    TemplateError : there is no trunk with branches, or the leaves cannot be told apart.
    """
    bare = leaves is None or not len(leaves)
    foliage = part(np.empty((0, 3, 3))) if bare else _pieces_of(leaves, "leaves")
    timber, lines, known, together = _cut_at_forks(_pieces_of(wood, "wood"))
    fronds = timber.count == 1 and are_fronds(lines, foliage)
    if fronds:
        timber, lines, known = draw_midribs(timber, lines, foliage)
    if timber.count == 1:
        raise TemplateError(
            "the wood is one piece without a fork, so there are no branches to grow from; bring trunk "
            "and branches, joined or as separate parts.",
            lines.ends()[0],
        )
    trunk = find_trunk(timber, lines, known.parent < 0)
    parent, branch, foot_end, gap = find_parents(lines, trunk, root(lines, trunk, known))
    recognition = Recognition(
        wood=timber,
        lines=lines,
        trunk=trunk,
        parent=parent,
        branch=branch,
        foot_end=foot_end,
        gap=gap,
        leaves=foliage,
        bearer=np.empty(0, dtype=np.int64),
    )
    _check_one_tree(recognition)
    doubts = _doubts_about_wood(recognition, together)
    if bare:
        return replace(recognition, doubts=doubts)
    if fronds:
        return replace(recognition, bearer=1 + np.arange(foliage.count), doubts=doubts, fronds=True)
    bearer, gap = find_bearers(lines, foliage)
    _check_leaves(foliage, gap, extent=float(np.ptp(timber.vertices, axis=0).max()))
    far = gap > FLOATING_LEAF * float(np.ptp(timber.vertices, axis=0).max())
    if far.any():
        sentence = f"{np.count_nonzero(far):,} leaves are far from all wood."
        doubts = (*doubts, Doubt(sentence, foliage.middles()[far]))
    return replace(recognition, bearer=bearer, doubts=doubts)


def _cut_at_forks(timber: Pieces) -> tuple[Pieces, Centrelines, Known, np.ndarray]:
    """Pieces none of which forks, their lines, what is known of those that were joined, and (N, 3)
    places where branches have grown into one another.
    """
    lines = None
    joined = np.ones(1, dtype=bool)
    if timber.count > 1:
        lines = find_centrelines(timber)
        whole = join_stacked(timber, lines)
        if whole is not timber:
            timber, lines = whole, find_centrelines(whole)
        joined = may_fork(timber, lines)
    if joined.any():
        pieces, known, together = sever(timber, joined)
        if pieces.count > timber.count:
            return pieces, find_centrelines(pieces), known, together
    lines = find_centrelines(timber) if lines is None else lines
    return timber, lines, Known.nothing(timber.count), np.empty((0, 3))


def checked_facets(facets: np.ndarray | None, what: str) -> np.ndarray:
    """Facets as (T, 3, 3) float64; ``TemplateError`` if they are anything else."""
    corners = np.asarray(facets, dtype=np.float64)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not np.isfinite(corners).all():
        raise TemplateError(f"the facets of the {what} must be finite numbers of shape (T, 3, 3).")
    return corners


def _pieces_of(facets: np.ndarray | None, what: str) -> Pieces:
    pieces = part(checked_facets(facets, what))
    if not pieces.count:
        raise TemplateError(f"there is no facet with an area in the {what}; export the mesh again.")
    return pieces


def _doubts_about_wood(found: Recognition, together: np.ndarray) -> tuple[Doubt, ...]:
    doubts = []
    gap, length = found.gap, found.lines.length()
    floats = gap > np.maximum(FLOATING * float(np.ptp(found.wood.vertices[:, 2])), found.radius)
    if floats.any():
        doubts.append(
            Doubt(
                f"{np.count_nonzero(floats):,} pieces of wood ({length[floats].sum() / length.sum():.1%} of "
                "its length) touch nothing and were hung on what is nearest.",
                found.foot[floats],
            )
        )
    if len(together):
        doubts.append(
            Doubt(
                f"branches have grown into one another at about {len(together):,} places, where one "
                "may be taken for the other.",
                together,
            )
        )
    return tuple(doubts)


def _check_one_tree(found: Recognition) -> None:
    knots = slice(found.lines.first[found.trunk], found.lines.first[found.trunk + 1])
    knot, along = found.lines.knot[knots], found.lines.along[knots]
    low = LOWER * along[-1]
    low = along[-1] - low if found.foot_end[found.trunk] == 1 else low
    lower = np.array([np.interp(low, along, x) for x in knot.T])
    # Of all of it, or of its lower part: it may end as a limb.
    ways = np.stack([found.tip[found.trunk], lower]) - found.foot[found.trunk]
    lean = float(zenith_of(ways).min())
    if lean > MOST_LEAN:
        raise LeanError(
            f"what looks like the trunk leans {np.rad2deg(lean):.0f}° from the z axis; export the tree "
            "with z up, and without ground or other objects.",
            np.stack([found.foot[found.trunk], found.tip[found.trunk]]),
        )
    height = float(np.ptp(found.wood.vertices[:, 2]))
    if found.gap.max() > FARTHEST_WOOD * height:
        raise TemplateError(
            "some of the wood lies far from the rest; export one tree alone, without other objects.",
            found.foot[found.gap > FARTHEST_WOOD * height],
        )


def _check_leaves(leaves: Pieces, gap: np.ndarray, extent: float) -> None:
    if np.median(gap) > FARTHEST_LEAVES * extent:
        raise TemplateError(
            "the leaves lie far from the wood; export both from the same scene, with the same units "
            "and origin.",
            leaves.vertices[:: max(1, len(leaves.vertices) // 20)],
        )
    low, high = leaves.boxes()
    largest = float((high - low).max())
    if largest > LARGEST_LEAF * extent:
        raise TemplateError(
            f"one leaf is {largest / extent:.0%} as large as the tree, so leaves seem to hang together "
            "along edges; separate them before you export them.",
            ((high + low) / 2)[np.argmax((high - low).max(axis=1))],
        )


STOUT = 0.7  # share of the thickest piece's radius that a trunk has at least
LEVEL = 0.02  # share of the tree's height within which pieces begin at the same level
TAPER = 1.3  # an end this many times as thick as the other is the foot
THIN_END = 0.5  # piece lengths of gap that it takes for the thin end to be the foot after all
REACH = 0.5  # radii that an end may stop short of the wood that it touches
FLOAT = 1.25  # where nothing touches, gaps up to this many times the smallest are taken together
THICKER = 1.25  # times the parent's radius, that a foot may be thick
MISFIT = 4.0  # times what a foot is thicker than that, added to its gap
AGAINST = 1.0  # gaps added to one that a foot does not point across, twice where it points away
SHORT = 0.5  # lengths of a floating piece that its parent is long at least
LACK = 0.1  # share of what the parent lacks of that, added to the gap
NEAREST = 8  # balls looked at, of each group
STEM = 0.3  # radii of the trunk that another stem has at least
BESIDE = 0.2  # heights of the tree that it is away at most
TALL = 0.25  # heights of the tree that it reaches up
CLOSER = 1.25  # lengths by which one comes nearer to a tapering surface, at most, for each gone
DEEP = 0.5  # radii of the parent off its axis, at most
NO_THINNER = 0.9  # radii of the end that the parent is thick there at least
TAPERS = 1.05  # ends differ by more than this factor where they tell which of them is the foot
FEET = 1.5  # radii from where a piece begins within which nothing is rooted in it
LESS = 0.25  # added, in radii, to what is less likely
OWN_END = (
    1.1  # than the end, by this factor, a piece is at its own end unless it may be another child
)
BALLS = 12  # balls looked at, of each group


def find_trunk(pieces: Pieces, lines: Centrelines, free: np.ndarray) -> int:
    """The piece that is the trunk, by the rule above, of those (C,) whose parent is not known."""
    z = pieces.vertices[:, 2]
    lowest = np.full(pieces.count, np.inf)
    np.minimum.at(lowest, pieces.piece_of_vertex, z)
    thickest = lines.end_radius.max(axis=1)
    area = np.bincount(pieces.piece, pieces.area, pieces.count)
    stout = free & (thickest >= STOUT * thickest[free].max())
    level = lowest <= lowest[stout].min() + LEVEL * np.ptp(z)
    return int(np.argmax(np.where(stout & level, area * thickest, -1.0)))


def find_parents(lines: Centrelines, trunk: int, known: Known) -> tuple[np.ndarray, ...]:
    """Hang all pieces on the trunk, generation by generation: ``parent``, ``branch``, ``foot_end`` and
    ``gap`` of a recognised tree, (C,) each.
    """
    ends, radius = lines.ends(), lines.end_radius
    count = len(ends)
    thin = radius * TAPER < radius[:, ::-1]
    handicap = np.where(thin, THIN_END * lines.length()[:, None], 0.0) - REACH * radius

    tied = known.parent >= 0
    stems = _stems_apart(lines, trunk, ~tied)
    parent, branch = np.full(count, -1), np.full(count, -1)
    branch[stems] = stems
    hung = np.concatenate([[trunk], stems])
    foot_end = np.zeros(count, dtype=np.int64)
    foot_end[hung] = np.argmin(ends[hung, :, 2], axis=1)
    score, gap = np.full((2, count, 2), np.inf)
    nearest = np.full((count, 2), -1)
    from_foot = np.linalg.norm(ends - known.foot[:, None], axis=2)
    gap[tied] = (from_foot - known.radius[:, None])[tied]
    done = np.zeros(count, dtype=bool)
    done[hung] = True
    waiting = np.flatnonzero(~tied & ~done)
    while len(hung):
        done[hung] = True
        children = np.flatnonzero(tied & ~done & done[known.parent])
        foot_end[children] = np.argmin(from_foot[children], axis=1)
        parent[children] = known.parent[children]
        rank, reach, piece = _best_wood(lines, hung, waiting)
        better = rank < score[waiting]
        score[waiting] = np.where(better, rank, score[waiting])
        gap[waiting] = np.where(better, reach, gap[waiting])
        nearest[waiting] = np.where(better, piece, nearest[waiting])
        best = (score + handicap)[waiting].min(axis=1)
        ready = best <= 0
        if not (ready.any() or len(children)):
            # nothing touches: let what fits best, and what fits about as well, float
            ready = best <= FLOAT * best.min(initial=np.inf)
        touching = waiting[ready]
        foot_end[touching] = np.argmin((score + handicap)[touching], axis=1)
        parent[touching] = nearest[touching, foot_end[touching]]
        waiting = waiting[~ready]
        hung = np.concatenate([children, touching])
        branch[hung] = np.where(parent[hung] == trunk, hung, branch[parent[hung]])
    gap[parent < 0] = 0.0
    return parent, branch, foot_end, gap[np.arange(count), foot_end]


def _best_wood(
    lines: Centrelines, hung: np.ndarray, waiting: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rank the wood that hangs for both ends of W waiting pieces (W, 2): how well the best fits, as a gap
    with all that speaks against it added; the gap itself; and whose wood it is.
    """
    if not len(waiting):
        return np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2), np.int64)
    tubes = Tubes.of(lines, hung)
    ends, stout = lines.ends()[waiting].reshape(-1, 3), lines.end_radius[waiting].reshape(-1, 1)
    cone, aside, part, radius = tubes.beside(ends, NEAREST)
    gap = aside - radius
    rank = gap + MISFIT * np.maximum(stout - THICKER * radius, 0.0)
    row, near = np.nonzero(gap > REACH * stout)  # what floats should point there, and be no longer
    if len(row):
        of = cone[row, near]
        way = tubes.start[of] + part[row, near][:, None] * tubes.vector[of] - ends[row]
        first, last = lines.first[waiting], lines.first[waiting + 1] - 1
        out = np.stack(  # the way on beyond both ends
            [lines.knot[first] - lines.knot[first + 1], lines.knot[last] - lines.knot[last - 1]],
            axis=1,
        )
        out = unit(out).reshape(-1, 3)[row]
        size = np.maximum(np.linalg.norm(way, axis=1), np.finfo(float).tiny)
        turn = 1.0 - np.einsum("ni,ni->n", way, out) / size
        length = lines.length()
        lacks = SHORT * length[waiting[row // 2]] - length[tubes.piece[of]]
        rank[row, near] += AGAINST * turn * gap[row, near] + LACK * np.maximum(lacks, 0.0)
    piece, row = tubes.piece[cone], np.arange(len(rank))
    best = np.argmin(rank, axis=1)
    chosen = piece[row, best]
    gap = np.where(piece == chosen[:, None], gap, np.inf).min(axis=1)
    return rank[row, best].reshape(-1, 2), gap.reshape(-1, 2), chosen.reshape(-1, 2)


def _stems_apart(lines: Centrelines, trunk: int, free: np.ndarray) -> np.ndarray:
    """Pieces that stand on the ground beside the trunk, and their radius away from it.

    One whose foot is missing is nearer to the ground than to any wood.
    """
    ends, radius, rows = lines.ends(), lines.end_radius, np.arange(len(free))
    height = float(np.ptp(ends[:, :, 2]))
    foot = np.argmin(ends[:, :, 2], axis=1)
    low, high = ends[rows, foot, 2], ends[rows, 1 - foot, 2]
    stout = radius[trunk, foot[trunk]]
    apart = free & (low <= low[trunk] + BESIDE * height) & (high - low >= TALL * height)
    apart &= (radius[rows, foot] >= STEM * stout) & (rows != trunk)
    some = np.flatnonzero(apart)
    if not len(some):
        return some
    contacts = find_contacts(lines, np.array([trunk]), ends[some, foot[some]])
    stands = low[some] <= low[trunk] + LEVEL * height + stout
    for row in np.flatnonzero(~stands):
        others, end = np.flatnonzero(rows != some[row]), ends[some[row], foot[some[row]]]
        gap = find_contacts(lines, others, end[None]).gap[0]
        stands[row] = gap > low[some[row]] - low[trunk]
    away = (contacts.gap > radius[some, foot[some]]) & (contacts.gap <= BESIDE * height)
    return some[stands & away]


def find_bearers(lines: Centrelines, leaves: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """(L,) the piece of wood that bears each leaf, and (L,) the gap between them.

    A leaf hangs by the corner or middle of an edge that is nearest to any wood; where it reaches into
    several pieces, on the thinnest. A first look at one ball for each corner leaves those that can be
    the nearest of their leaf; the middle of an edge is at most half its length nearer than its ends.
    """
    tubes = Tubes.of(lines, np.arange(len(lines.first) - 1))
    corner, size = leaves.piece_of_vertex, np.bincount(leaves.piece_of_vertex)
    begins, middle = np.cumsum(size) - size, leaves.middles()
    reach = np.maximum.reduceat(lengths(leaves.vertices - middle[corner]), begins)
    gap, away = tubes.look(
        middle
    )  # which groups of balls can be the nearest to any place of a leaf
    near = away - reach <= np.maximum(gap.min(axis=0) + reach, 0.0)
    gap, away = seen = tubes.look(leaves.vertices, near[:, corner])
    least = np.minimum.reduceat(np.maximum(gap.min(axis=0), 0.0), begins)
    away = away.min(axis=0)  # at least
    close = np.flatnonzero(away <= least[corner])
    at_corners = tubes.contacts(leaves.vertices[close], seen[:, :, close], thinnest=True)
    away[close] = at_corners.gap
    np.minimum.at(least, corner[close], np.maximum(at_corners.gap, 0.0))

    one, other = leaves.edges.T
    half = lengths(leaves.vertices[one] - leaves.vertices[other]) / 2
    may = np.maximum(away[one], away[other]) - CLOSER * half <= least[corner[one]]
    owner, one, other = corner[one[may]], one[may], other[may]
    middles = (leaves.vertices[one] + leaves.vertices[other]) / 2
    seen = tubes.look(middles, near[:, owner])
    may = np.flatnonzero(seen[1].min(axis=0) <= least[owner])
    at_middles = tubes.contacts(middles[may], seen[:, :, may], thinnest=True)

    owner = np.concatenate([corner[close], owner[may]])
    piece, gap, radius = (
        np.concatenate([getattr(at_corners, name), getattr(at_middles, name)])
        for name in ("piece", "gap", "radius")
    )
    gap = np.maximum(gap, 0.0)
    chosen = firsts(np.lexsort((radius, gap, owner)), owner)
    return piece[chosen], gap[chosen]


def root(lines: Centrelines, trunk: int, known: Known) -> Known:
    """Add the parents of pieces that are rooted deep in one to what is known."""
    count = len(lines.first) - 1
    free = np.flatnonzero((known.parent < 0) & (np.arange(count) != trunk))
    if not len(free):
        return known
    tubes = Tubes.of(lines, np.arange(count))
    ends, thick = lines.ends()[free], lines.end_radius[free]
    cone, aside, part, radius = tubes.beside(ends.reshape(-1, 3), BALLS)
    parent = tubes.piece[cone]
    along = tubes.along[cone] + part * tubes.length[cone]
    own = np.repeat(free, 2)[:, None]
    rank = aside / np.maximum(radius, 1e-12)
    fits = (rank <= DEEP) & (parent != own) & (radius >= NO_THINNER * thick.reshape(-1, 1))
    fits &= ~_begins_there(lines, parent, along, radius, TAPERS)
    other = thick[:, ::-1].reshape(-1, 1)
    fits &= thick.reshape(-1, 1) * TAPER >= other
    rank += LESS * (thick.reshape(-1, 1) < other)
    other_child = _begins_there(lines, parent, along, radius, TAPER)
    rank += LESS * (other_child & (radius < OWN_END * thick.reshape(-1, 1)))
    rank[~fits] = np.inf

    width = rank.shape[1]
    rank = rank.reshape(len(free), 2 * width)
    best = np.argmin(rank, axis=1)
    row, holder = 2 * np.arange(len(free)) + best // width, best % width
    sure = np.isfinite(rank[np.arange(len(free)), best])
    row, holder, rooted = row[sure], holder[sure], free[sure]
    chosen = cone[row, holder]
    foot = tubes.start[chosen] + part[row, holder][:, None] * tubes.vector[chosen]
    parents, feet, thickness = known.parent.copy(), known.foot.copy(), known.radius.copy()
    parents[rooted], feet[rooted] = tubes.piece[chosen], foot
    thickness[rooted] = radius[row, holder]
    above = np.where(parents < 0, np.arange(count), parents)
    for _ in range(count.bit_length()):  # so far up that who is not at the top goes round
        above = above[above]
    rings = np.unique(above[parents[above] >= 0])  # pieces that are their own ancestors
    parents[rings] = known.parent[rings]
    return Known(parents, feet, thickness)


def _begins_there(
    lines: Centrelines, parent: np.ndarray, along: np.ndarray, radius: np.ndarray, tapers: float
) -> np.ndarray:
    """Tell whether places along pieces are where these begin: at an end, unless that tapers by this
    factor."""
    length, ends = lines.length()[parent], lines.end_radius[parent]
    first = (along <= FEET * radius) & (ends[..., 0] * tapers > ends[..., 1])
    last = (length - along <= FEET * radius) & (ends[..., 1] * tapers > ends[..., 0])
    return np.asarray(first | last)
