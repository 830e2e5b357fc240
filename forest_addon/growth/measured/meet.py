"""A tree that meets its targets: grown into its crown, by rules, or of template parts.

Whatever grew is pruned of its lower branches, stretched along and across its stem, thickened to its
diameter and given as many leaves as its leaf area takes: the few numbers that matter, in this order. Height,
width and base are measured with the leaves on, and the stretch is repeated until they stand.

Of a tree of template parts, parts are scaled and moved, leaves chosen, added and resized. All wood is scaled
to the height; then heights are taken from (0, base, top) to those wanted, piece by piece linearly, distances
from the stem's axis beyond 1.5 of its radius are drawn out by the quotient of the widths, and what is nearer
by that of the diameters. Leaves keep their shape and inclination: they move with their feet, are left out by
lot or set again beside themselves, turned about the vertical, until their number gives the leaf area, and
take the little that is over in their size. Repeated until all stand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import child_keys, keyed_uniform
from ...base.runs import Runs
from ...base.trimesh import TriMesh, join
from ...spec import SpecError, Species
from ..lsystem.branching import skeleton_of
from ..mesh.blades import Blade, leaf_areas, stalk_of
from ..mesh.leaves import Leaves, about_vertical, corner_leaves, leaves_apart
from ..skeleton import LeafSites, Skeleton, branch_feet, first_level
from .allometry import BREAST, TARGETS, Wanted, crown_base_of, crown_of, dbh_of, leaf_tips, width_of
from .crown import (
    borne,
    colonise,
    leaves_on,
    scaffold_of,
    scaled_to,
    seat_twigs,
    skeleton_of_nodes,
    with_radii,
    with_twigs,
)

MOST_LEAVES = 5_000_000
STRETCHES = 12
BARE = 1.2  # of the crown's width, that wood without leaves may be wide
YOUNG, OLD = 0.15, 0.4  # metres of diameter
POINTED = 0.9  # how full the crown of a seedling is above its widest place; 1 is a cone
ROUNDS = 20
CORE = 1.5  # radii of the stem, within which wood is the stem's
FARTHEST = 4.0  # that parts are stretched or squeezed, against the tree of that height
RAISED = 3.0  # that the base of a crown is moved up; beyond, lower branches are left out
CLOSE = 2e-3  # relative, of what counts as met
SAID = 0.05  # relative, from which on a sentence says that a target is not met


def leaves_needed(species: Species, blade: Blade, area: float) -> int:
    """Number of leaves, or shoots, of a species that make a leaf area.

    Raises
    ------
    SpecError : more than can be grown; says how many.
    """
    length, ratio = species.leaf.length, species.leaf.width_ratio.mean
    square = length.mean**2 + 0.77 * length.sd**2  # a normal cut at two has 0.77 of its variance
    count = area / (blade.share * (1 + stalk_of(species.leaf)) * ratio * square)
    _refuse_many(count, area, species.name)
    return max(1, round(count))


def grow_measured(
    species: Species, wanted: Wanted, blade: Blade, rng: np.random.Generator
) -> tuple[Skeleton, LeafSites, tuple[str, ...]]:
    """A tree without a template that meets its targets, in whichever way its species grows; one sentence for
    each that could not be met.

    Raises
    ------
    SpecError : it would need too many leaves.
    """
    if species.crown is not None:
        return grow_crown(species, wanted, blade, int(rng.integers(2**63)))
    skeleton, sites = skeleton_of(species, rng)
    return fit_grown(species, skeleton, sites, wanted, blade, int(rng.integers(2**63)))


def grow_crown(
    species: Species, wanted: Wanted, blade: Blade, key: int
) -> tuple[Skeleton, LeafSites, tuple[str, ...]]:
    """A tree that fills the envelope of its crown.

    key : 64 bits, the lineage of the tree.
    """
    assert species.crown is not None
    crown = species.crown
    if crown.dome:  # its widest place moves up as its tree grows old
        age = np.clip((wanted.dbh - YOUNG) / (OLD - YOUNG), 0.0, 1.0)
        widest = float(np.clip(crown.widest + crown.dome * age, 0.0, 0.9))
        plan, young = species.architecture, 1.0
        if plan is not None and plan.fork < 1:  # before it divides, it is pointed and widest low
            young = min(wanted.dbh / YOUNG, 1.0)
        top = young * crown.top + (1 - young) * POINTED
        crown = crown.changed(widest=young * widest, top=top)
    tree = np.array([key], np.uint64)
    rng = np.random.Generator(np.random.PCG64(key))
    margin = min(
        0.4 * wanted.crown_width, 2 * (crown.twig.mean * 0.6 + 0.5 * species.leaf.length.mean)
    )
    size = (wanted.height, wanted.crown_base, wanted.crown_width - margin)
    frame = None
    if species.architecture is not None:
        frame = scaffold_of(species.architecture, crown, (*size, wanted.dbh), rng, wanted.aside)
    nodes = colonise(crown, *size, rng, frame, wanted.aside)
    ends = np.ones(len(nodes.parent), dtype=bool)
    ends[nodes.parent[1:]] = False
    tips = borne(nodes.parent, ends)
    bare = skeleton_of_nodes(nodes, tips)
    count = leaves_needed(species, blade, wanted.leaf_area)
    bearers = -(-count // crown.twig_leaves)
    twigs = seat_twigs(crown, bare, tips[1:], bearers, child_keys(tree, "twigs"))
    own = np.bincount(twigs.segment, minlength=len(bare))
    pipes = borne(bare.parent, own)
    drawn = with_twigs(bare, twigs, crown.twig_radius)
    sites = leaves_on(species.leaf, twigs, len(bare), count, species.needles is not None)
    sites = _with_area(sites, blade, wanted.leaf_area)
    drawn, sites = stretched(drawn, sites, wanted)
    drawn = to_breast_height(drawn, wanted.height)
    radius = drawn.radius.copy()
    radius[: len(bare)] = with_radii(
        drawn.select(slice(len(bare))), pipes, crown, wanted.dbh
    ).radius
    wood = replace(drawn, radius=radius)
    return wood, sites if species.leaf.on else LeafSites.none(), ()


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


def fit_grown(
    species: Species, skeleton: Skeleton, sites: LeafSites, wanted: Wanted, blade: Blade, key: int
) -> tuple[Skeleton, LeafSites, tuple[str, ...]]:
    """A tree that rules or ratios have grown, pruned, stretched and thickened to its targets."""
    missed: list[str] = []
    if not len(skeleton):
        return skeleton, sites, ("nothing grew",)
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
    return skeleton, sites, tuple(missed)


def pruned(skeleton: Skeleton, sites: LeafSites, share: float) -> tuple[Skeleton, LeafSites]:
    """Leave out first-level branches that start below this share of the height; the top stays."""
    top, foot = float(skeleton.end[:, 2].max()), branch_feet(skeleton)
    low = np.flatnonzero(skeleton.start[foot, 2] < share * top)
    if not len(low) or len(low) == len(foot):
        return skeleton, sites
    kept = ~np.isin(first_level(skeleton), low)
    number = np.append(np.cumsum(kept) - 1, -1)  # the last for what nothing bears
    stays = np.append(kept, True)[sites.segment]
    sites = sites.select(stays)
    return skeleton.some(kept), replace(sites, segment=number[sites.segment])


def stretched(skeleton: Skeleton, sites: LeafSites, wanted: Wanted) -> tuple[Skeleton, LeafSites]:
    """The tree moved so that its top, its crown's base and its crown's width are where they are wanted.

    A few leaves about the stem do not draw the wood out: it stays within ``BARE`` of the crown's width.
    """
    bearer = sites.segment if len(sites) else np.arange(len(skeleton))
    for _ in range(STRETCHES):
        tips = leaf_tips(sites)
        high = float(np.concatenate([skeleton.end[:, 2], tips[:, 2]]).max())
        # Leaves keep their length: ask the wood for it.
        reach = max(high - wanted.height, -0.5 * high)
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

        start, end, foot = (
            np.column_stack([p[:, :2] * across, _heights(p[:, 2], knots, goals)])
            for p in (skeleton.start, skeleton.end, sites.foot)
        )
        skeleton, sites = replace(skeleton, start=start, end=end), replace(sites, foot=foot)
    return skeleton, sites


def _heights(z: np.ndarray, knots: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Heights (N,) taken from knots to goals, going on beyond the last, and below 0 as they are."""
    slope = (goals[-1] - goals[-2]) / (knots[-1] - knots[-2])
    new = np.interp(z, knots, goals) + slope * np.maximum(z - knots[-1], 0)
    return np.asarray(new + np.minimum(z, 0.0))


def _with_area(sites: LeafSites, blade: Blade, area: float) -> LeafSites:
    """Leaves resized by the little that their number leaves over."""
    own_area = float(leaf_areas(sites, blade).sum())
    size = np.sqrt(area / own_area) if own_area > 0 else 1.0
    return replace(sites, length=sites.length * size, width=sites.width * size)


def _as_many(sites: LeafSites, skeleton: Skeleton, count: int, key: int) -> LeafSites:
    """Choose ``count`` leaves: some are left out, or others are set beside them along the same axis."""
    have = len(sites)
    pick, again, own = _picked(have, count, key)
    chosen = sites.select(pick)
    if again.any():
        share = keyed_uniform(own, "leaf place")[again, None]
        on = chosen.segment[again]
        start, end = skeleton.start[on], skeleton.end[on]
        along = start + share * (end - start)
        chosen.foot[again] = np.where((on >= 0)[:, None], along, chosen.foot[again])
        turn = 2 * np.pi * keyed_uniform(own, "leaf turn")[again]
        cos, sin = np.cos(turn), np.sin(turn)
        for vectors in (chosen.direction, chosen.up):
            vectors[again] = about_vertical(vectors[again], cos, sin)
    return chosen


def _picked(have: int, count: int, key: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Choose so many of the leaves that there are: some are left out by lot, or set again.

    Returns the leaf (count,) that each stands for, whether that stands there already, and their keys.
    """
    keys = child_keys(np.full(have, key, np.uint64), np.arange(have))
    rank = np.argsort(keyed_uniform(keys, "leaf chosen"))
    pick = np.sort(np.concatenate([*[np.arange(have)] * (count // have), rank[: count % have]]))
    again = np.concatenate([[False], pick[1:] == pick[:-1]])
    return pick, again, child_keys(np.full(count, key, np.uint64), np.arange(count))


def _refuse_many(count: float, area: float, where: str) -> None:
    if count > MOST_LEAVES:
        raise SpecError(
            where,
            f"{area:.4g} m² of leaves would be {count:.2g} leaves, more than {MOST_LEAVES:,}; "
            "use larger leaves or a smaller leaf_area",
        )


@dataclass(frozen=True)
class Parts:
    """A tree as it is grown of template parts; foot : (L, 3) where each leaf hangs."""

    mesh: TriMesh
    leaves: Leaves
    foot: np.ndarray
    skeleton: Skeleton


def reshaped(parts: Parts, wanted: Wanted, key: int, where: str) -> tuple[Parts, tuple[str, ...]]:
    """The tree with its targets met as far as they can be, and sentences about what could not be.

    key : 64 bits, the lineage of its leaves. where : names the species.

    Raises
    ------
    SpecError : it would need too many leaves.
    """
    missed = []
    if len(parts.leaves):
        parts = _with_leaf_area(parts, wanted.leaf_area, key, where)
    else:
        missed.append("it bears no leaves, so leaf_area cannot be met")
    parts = _stretched(parts, wanted)
    measured = measures_of(parts)
    for name, value in measured.items():
        target = getattr(wanted, name)
        if name == "dbh" and not value:
            missed.append("its stem does not pass 1.3 m, so dbh cannot be met")
        elif abs(value - target) > SAID * target and (name != "leaf_area" or value):
            missed.append(
                f"parts of its template would be stretched or squeezed more than {FARTHEST:g} times, so "
                f"{name} cannot be met"
            )
    return parts, tuple(missed)


def lowest_kept(foot: np.ndarray, leaf: np.ndarray, top: float, wanted: Wanted) -> float:
    """Metres: branches of a tree that start lower are left out, so that its crown can begin where wanted.

    foot : (B,) where each branch starts. leaf : (B,) its lowest leaf. top : of the tree. What is left must be
    raised to ``RAISED`` times the height of its leaves at most; the uppermost branch stays.
    """
    needed = wanted.crown_base / wanted.height * top / RAISED
    order = np.argsort(foot, kind="stable")
    lowest = np.minimum.accumulate(leaf[order][::-1])[::-1]  # of this branch and all above it
    enough = np.flatnonzero(lowest >= needed)
    return float(foot[order[enough[0] if len(enough) else -1]])


def measures_of(parts: Parts) -> dict[str, float]:
    """Measures of the tree by the names of ``TARGETS``."""
    width, base = crown_of(parts.skeleton, parts.leaves, grafted=True)
    values = (
        dbh_of(parts.skeleton),
        float(parts.mesh.vertices[:, 2].max(initial=0.0)),
        width,
        base,
        float(np.pi * (parts.leaves.radius**2).sum()),
    )
    return dict(zip(TARGETS, values, strict=True))


def _with_leaf_area(parts: Parts, area: float, key: int, where: str) -> Parts:
    """Meet a leaf area: leaves are left out, or set again, turned about their feet."""
    leaves, foot = parts.leaves, parts.foot
    areas = np.pi * leaves.radius**2
    have = len(leaves)
    count = max(1, round(have * area / float(areas.sum()))) if areas.sum() > 0 else have
    _refuse_many(count, area, where)
    pick, again, own = _picked(have, count, key)
    angle = np.where(again, 2 * np.pi * keyed_uniform(own, "leaf turn"), 0.0)
    cos, sin = np.cos(angle), np.sin(angle)
    total = float(areas[pick].sum())
    size = np.sqrt(area / total) if total > 0 else 1.0
    rest, blades, of = leaves_apart(parts.mesh)
    row, of_vertex, moved = Runs.of(of, have).copy(pick)
    face, of_face, _ = Runs.of(blades.leaf, have).copy(pick)
    at = foot[pick]
    turned = about_vertical(blades.vertices[row] - at[of_vertex], cos[of_vertex], sin[of_vertex])
    chosen = TriMesh(
        vertices=at[of_vertex] + size * turned,
        triangles=(blades.triangles[face] + moved[of_face][:, None]).astype(np.int32),
        part=blades.part[face],
        leaf=of_face.astype(np.int32),
        material=blades.material[face],
        uv=None if blades.uv is None else blades.uv[face],
        order=None if blades.order is None else blades.order[face],
    )
    made = Leaves(
        centre=at + size * about_vertical(leaves.centre[pick] - at, cos, sin),
        normal=about_vertical(leaves.normal[pick], cos, sin),
        axis=about_vertical(leaves.axis[pick], cos, sin),
        length=leaves.length[pick] * size,
        width=leaves.width[pick] * size,
        radius=leaves.radius[pick] * size,
        branch=leaves.branch[pick],
    )
    return replace(parts, mesh=join([rest, chosen]), leaves=made, foot=at)


def _stretched(parts: Parts, wanted: Wanted) -> Parts:
    """Wood moved until height, base, width and diameter are those wanted, leaves with their feet."""
    height = measures_of(parts)["height"]
    parts = _moved(parts, lambda p: p * (wanted.height / height), wanted.height / height)
    across = down = up = 1.0
    for _ in range(ROUNDS):
        measured = measures_of(parts)
        off = [abs(measured[name] / getattr(wanted, name) - 1) for name in TARGETS[1:4]]
        thick = wanted.dbh / measured["dbh"] if measured["dbh"] else 1.0
        if max(off) < CLOSE / 10 and abs(thick - 1) < 1e-7:
            break
        wide = wanted.crown_width / measured["crown_width"] if measured["crown_width"] else 1.0
        wide = float(np.clip(wide * across, 1 / FARTHEST, FARTHEST)) / across
        top = float(parts.skeleton.end[:, 2].max())
        goal = top + wanted.height - measured["height"]
        base = measured["crown_base"]
        knots, goals = np.array([0.0, top]), np.array([0.0, goal])
        if 1e-3 < base < top - 1e-3 and wanted.crown_base < goal:
            low = float(np.clip(wanted.crown_base / base * down, 1 / FARTHEST, FARTHEST)) / down
            high = (goal - low * base) / (top - base)
            high = float(np.clip(high * up, 1 / FARTHEST, FARTHEST)) / up
            down, up = down * low, up * high
            knots = np.array([0.0, base, top])
            goals = np.array([0.0, low * base, low * base + high * (top - base)])
        still = abs(wide - 1) < 1e-6 and np.allclose(goals, knots, rtol=1e-6)
        if still and abs(thick - 1) < 1e-7:
            break  # as far as parts may be stretched
        across *= wide
        parts = _drawn_out(parts, knots, goals, wide, thick)
    return parts


def _drawn_out(
    parts: Parts, knots: np.ndarray, goals: np.ndarray, wide: float, thick: float
) -> Parts:
    """Heights from knots to goals; the stem thicker, the crown wider."""
    wood = parts.skeleton
    trunk = np.flatnonzero(wood.order == 0)
    nodes = np.concatenate([wood.start[trunk], wood.end[trunk]])
    radius = np.concatenate([wood.radius[trunk, 0], wood.radius[trunk, 1]])
    rise = np.argsort(nodes[:, 2], kind="stable")
    z, middle, core = nodes[rise, 2], nodes[rise, :2], CORE * radius[rise]

    def move(p: np.ndarray) -> np.ndarray:
        height = p[:, 2]
        axis = np.column_stack([np.interp(height, z, middle[:, k]) for k in range(2)])
        away = p[:, :2] - axis
        r = np.linalg.norm(away, axis=1)
        inner = np.minimum(r, np.interp(height, z, core))
        factor = (thick * inner + wide * (r - inner)) / np.maximum(r, 1e-12)
        return np.column_stack([axis + away * factor[:, None], _heights(height, knots, goals)])

    return _moved(parts, move, np.where(wood.order == 0, thick, 1.0))


def _moved(
    parts: Parts, move: Callable[[np.ndarray], np.ndarray], girth: float | np.ndarray
) -> Parts:
    """Wood through a map of points, leaves with their feet, radii by factors of segments."""
    mesh, wood = parts.mesh, parts.skeleton
    of_vertex = corner_leaves(mesh)
    foot = move(parts.foot) if len(parts.foot) else parts.foot
    shift = foot - parts.foot
    vertices = np.empty_like(mesh.vertices)
    bare = of_vertex < 0
    vertices[bare] = move(mesh.vertices[bare])
    vertices[~bare] = mesh.vertices[~bare] + shift[of_vertex[~bare]]
    leaves = replace(parts.leaves, centre=parts.leaves.centre + shift)
    radius = wood.radius * np.broadcast_to(girth, len(wood))[:, None]
    skeleton = replace(wood, start=move(wood.start), end=move(wood.end), radius=radius)
    return replace(
        parts, mesh=replace(mesh, vertices=vertices), leaves=leaves, foot=foot, skeleton=skeleton
    )
