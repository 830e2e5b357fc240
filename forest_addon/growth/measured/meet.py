"""A tree that meets its targets: grown into its crown, or grown by rules and then fitted.

Whatever grew is pruned of its lower branches, stretched along and across its stem, thickened to its
diameter and given as many leaves as its leaf area takes: the few numbers that matter, in this order. Height,
width and base are measured with the leaves on, and the stretch is repeated until they stand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import daughter_keys, keyed_uniform
from ...spec import Crown, SpecError, Species
from ..mesh.axes import first_level
from ..mesh.blades import Blade, leaf_areas
from ..mesh.foliage import stalk_of
from ..skeleton import LeafSites, Skeleton
from ..species import skeleton_of
from .colonise import colonise
from .measure import BREAST, crown_base_of, dbh_of, leaf_tips, width_of
from .pipes import borne, scaled_to, skeleton_of_nodes, with_radii
from .scaffold import scaffold_of
from .twigs import leaves_on, seat_twigs, with_twigs
from .wanted import Wanted

MOST_LEAVES = 5_000_000
ROUNDS = 12
BARE = 1.2  # of the crown's width, that wood without leaves may be wide
YOUNG, OLD = 0.15, 0.4  # metres of diameter


@dataclass(frozen=True)
class Met:
    """A tree's wood and leaves, and what could not be met: one sentence each."""

    skeleton: Skeleton
    sites: LeafSites
    missed: tuple[str, ...] = ()


def leaves_needed(species: Species, blade: Blade, area: float) -> int:
    """Return how many leaves, or shoots, of a species make a leaf area.

    Raises
    ------
    SpecError : more than can be grown; says how many.
    """
    length, ratio = species.leaf.length, species.leaf.width_ratio.mean
    square = length.mean**2 + 0.77 * length.sd**2  # a normal cut at two has 0.77 of its variance
    count = area / (blade.share * (1 + stalk_of(species.leaf)) * ratio * square)
    if count > MOST_LEAVES:
        raise SpecError(
            species.name,
            f"{area:.4g} m² of leaves would be {count:.2g} leaves, more than {MOST_LEAVES:,}; "
            "use larger leaves or a smaller leaf_area",
        )
    return max(1, round(count))


def grow_measured(species: Species, wanted: Wanted, blade: Blade, rng: np.random.Generator) -> Met:
    """A tree without a template that meets its targets, in whichever way its species grows.

    Raises
    ------
    SpecError : it would need too many leaves.
    """
    if species.crown is not None:
        return grow_crown(species, wanted, blade, int(rng.integers(2**63)))
    skeleton, sites = skeleton_of(species, rng)
    return fit_grown(species, skeleton, sites, wanted, blade, int(rng.integers(2**63)))


def grow_crown(species: Species, wanted: Wanted, blade: Blade, key: int) -> Met:
    """A tree that fills the envelope of its crown.

    key : 64 bits, the lineage of the tree.
    """
    assert species.crown is not None
    crown = _aged(species.crown, wanted.dbh)
    tree = np.array([key], np.uint64)
    rng = np.random.Generator(np.random.PCG64(key))
    margin = min(
        0.4 * wanted.crown_width, 2 * (crown.twig.mean * 0.6 + 0.5 * species.leaf.length.mean)
    )
    size = (wanted.height, wanted.crown_base, wanted.crown_width - margin)
    frame = None
    if species.architecture is not None:
        made = scaffold_of(species.architecture, crown, (*size, wanted.dbh), rng)
        frame = made.nodes, made.bearing
    nodes = colonise(crown, *size, rng, frame)
    ends = np.ones(len(nodes.parent), dtype=bool)
    ends[nodes.parent[1:]] = False
    tips = borne(nodes.parent, ends)
    bare = skeleton_of_nodes(nodes, tips)
    count = leaves_needed(species, blade, wanted.leaf_area)
    bearers = -(-count // crown.twig_leaves)
    twigs = seat_twigs(crown, bare, tips[1:], bearers, daughter_keys(tree, "twigs"))
    own = np.bincount(twigs.segment, minlength=len(bare))
    pipes = borne(bare.parent, own)
    drawn = with_twigs(bare, twigs, crown.twig_radius)
    sites = leaves_on(species.leaf, twigs, len(bare), count, species.needles is not None)
    sites = _with_area(sites, blade, wanted.leaf_area)
    drawn, sites = stretched(drawn, sites, wanted)
    drawn = to_breast_height(drawn, wanted.height)
    radius = drawn.radius.copy()
    radius[: len(bare)] = with_radii(_first(drawn, len(bare)), pipes, crown, wanted.dbh).radius
    wood = replace(drawn, radius=radius)
    return Met(wood, sites if species.leaf.on else LeafSites.none())


def _aged(crown: Crown, dbh: float) -> Crown:
    """The crown of a stem of this diameter: its widest place moves up as its tree grows old."""
    if not crown.dome:
        return crown
    age = np.clip((dbh - YOUNG) / (OLD - YOUNG), 0.0, 1.0)
    return crown.changed(widest=float(np.clip(crown.widest + crown.dome * age, 0.0, 0.9)))


def to_breast_height(skeleton: Skeleton, height: float) -> Skeleton:
    """The tree with a stem that passes 1.3 m: of a seedling only leaves may reach higher, and without a stem
    there it has no diameter.
    """
    stem = np.flatnonzero(skeleton.order == 0)
    top = stem[np.argmax(skeleton.end[stem, 2])]
    if skeleton.end[top, 2] > BREAST or height <= BREAST:
        return skeleton
    tip = skeleton.end[top].copy()
    tip[2] = BREAST + min(0.01, (height - BREAST) / 2)
    start, end = skeleton.start.copy(), skeleton.end.copy()
    start[(skeleton.parent == top) & (start == end[top]).all(axis=1)] = tip
    end[top] = tip
    return replace(skeleton, start=start, end=end)


def _first(skeleton: Skeleton, count: int) -> Skeleton:
    """The first segments of a skeleton."""
    names = ("start", "end", "radius", "parent", "order", "generation")
    return Skeleton(**{name: getattr(skeleton, name)[:count] for name in names})


def fit_grown(
    species: Species, skeleton: Skeleton, sites: LeafSites, wanted: Wanted, blade: Blade, key: int
) -> Met:
    """A tree that rules or ratios have grown, pruned, stretched and thickened to its targets."""
    missed: list[str] = []
    if not len(skeleton):
        return Met(skeleton, sites, ("nothing grew",))
    skeleton, sites = pruned(skeleton, sites, wanted.crown_base / wanted.height)
    if len(sites):
        count = leaves_needed(species, blade, wanted.leaf_area)
        sites = _as_many(sites, skeleton, count, key)
        sites = _with_area(sites, blade, wanted.leaf_area)
    else:
        missed.append("it bears no leaves, so leaf_area cannot be met")
    skeleton, sites = stretched(skeleton, sites, wanted)
    skeleton = scaled_to(skeleton, wanted.dbh)
    if abs(dbh_of(skeleton) - wanted.dbh) > 1e-3:
        missed.append("its stem does not pass 1.3 m, so dbh cannot be met")
    return Met(skeleton, sites, tuple(missed))


def pruned(skeleton: Skeleton, sites: LeafSites, share: float) -> tuple[Skeleton, LeafSites]:
    """Without the first-level branches that start below this share of the height; the top stays."""
    level = first_level(skeleton)
    top = float(skeleton.end[:, 2].max())
    parent = np.maximum(skeleton.parent, 0)
    foot = np.flatnonzero((level >= 0) & ((level != level[parent]) | (skeleton.parent < 0)))
    low = foot[skeleton.start[foot, 2] < share * top]
    if not len(low) or len(low) == len(foot):
        return skeleton, sites
    kept = ~np.isin(level, level[low])
    number = np.cumsum(kept) - 1
    names = ("start", "end", "radius", "order", "generation")
    mother = skeleton.parent[kept]
    wood = Skeleton(
        **{name: getattr(skeleton, name)[kept] for name in names},
        parent=np.where(mother < 0, -1, number[np.maximum(mother, 0)]),
    )
    stays = (sites.segment < 0) | kept[np.maximum(sites.segment, 0)]
    segment = np.where(sites.segment < 0, -1, number[np.maximum(sites.segment, 0)])[stays]
    rest = {n: getattr(sites, n)[stays] for n in ("foot", "direction", "up", "length", "width")}
    return wood, LeafSites(**rest, segment=segment)


def stretched(skeleton: Skeleton, sites: LeafSites, wanted: Wanted) -> tuple[Skeleton, LeafSites]:
    """The tree moved so that its top, its crown's base and its crown's width are where they are wanted.

    A few leaves about the stem do not draw the wood out: it stays within ``BARE`` of the crown's width.
    """
    bearer = sites.segment if len(sites) else np.arange(len(skeleton))
    for _ in range(ROUNDS):
        tips = leaf_tips(sites)
        high = float(np.concatenate([skeleton.end[:, 2], tips[:, 2]]).max())
        reach = max(
            high - wanted.height, -0.5 * high
        )  # leaves keep their length: ask the wood for it
        base = crown_base_of(skeleton, bearer)
        leafy = tips if len(tips) else skeleton.end
        width = width_of(leafy)
        across = wanted.crown_width / width if width > 0 else 1.0
        if across > 1.0001:
            across = min(across, BARE * wanted.crown_width / max(width_of(skeleton.end), 1e-9))
        if abs(reach) < 1e-4 and abs(base - wanted.crown_base) < 1e-4 and abs(across - 1) < 1e-4:
            break
        across = float(np.clip(across, 0.05, 20))
        top = float(skeleton.end[:, 2].max())
        knots = np.array([0.0, base, top])
        goals = np.array([0.0, wanted.crown_base, top - reach])
        if base <= 1e-6 or base >= top - 1e-6:
            knots, goals = knots[[0, 2]], goals[[0, 2]]

        way = (knots, goals, across)
        start, end = _moved(skeleton.start, *way), _moved(skeleton.end, *way)
        skeleton, sites = (
            replace(skeleton, start=start, end=end),
            replace(sites, foot=_moved(sites.foot, *way)),
        )
    return skeleton, sites


def _moved(p: np.ndarray, knots: np.ndarray, goals: np.ndarray, across: float) -> np.ndarray:
    """Points (N, 3) with heights taken from knots to goals, going on beyond the last, and drawn aside."""
    slope = (goals[-1] - goals[-2]) / (knots[-1] - knots[-2])
    z = np.interp(p[:, 2], knots, goals) + slope * np.maximum(p[:, 2] - knots[-1], 0)
    return np.column_stack([p[:, :2] * across, z + np.minimum(p[:, 2], 0.0)])


def _with_area(sites: LeafSites, blade: Blade, area: float) -> LeafSites:
    """Leaves resized by the little that their number leaves over."""
    found = float(leaf_areas(sites, blade).sum())
    size = np.sqrt(area / found) if found > 0 else 1.0
    return replace(sites, length=sites.length * size, width=sites.width * size)


def _as_many(sites: LeafSites, skeleton: Skeleton, count: int, key: int) -> LeafSites:
    """So many leaves: some left out, or others set beside them along what bears them."""
    have = len(sites)
    keys = daughter_keys(np.full(have, key, np.uint64), np.arange(have))
    rank = np.argsort(keyed_uniform(keys, "leaf chosen"))
    pick = np.concatenate([np.arange(have)] * (count // have) + [rank[: count % have]])
    pick = np.sort(pick)
    again = np.concatenate([[False], pick[1:] == pick[:-1]])
    chosen = {
        name: getattr(sites, name)[pick]
        for name in ("foot", "direction", "up", "length", "width", "segment")
    }
    if again.any():
        own = daughter_keys(np.full(count, key, np.uint64), np.arange(count))
        share = keyed_uniform(own, "leaf place")[again, None]
        on = chosen["segment"][again]
        start, end = skeleton.start[on], skeleton.end[on]
        chosen["foot"][again] = np.where(
            (on >= 0)[:, None], start + share * (end - start), chosen["foot"][again]
        )
        turn = 2 * np.pi * keyed_uniform(own, "leaf turn")[again]
        for name in ("direction", "up"):
            x, y, z = chosen[name][again].T
            chosen[name][again] = np.column_stack(
                [np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z]
            )
    return LeafSites(**chosen)
