"""A tree of template parts brought to its targets: parts scaled and moved, leaves chosen, added and resized.

All wood is scaled to the height; then heights are taken from (0, base, top) to those wanted, piece by piece
linearly, distances from the stem's axis beyond 1.5 of its radius are drawn out by the quotient of the
widths, and what is nearer by that of the diameters. Leaves keep their shape and inclination: they move with
their feet, are left out by lot or set again beside themselves, turned about the vertical, until their number
gives the leaf area, and take the little that is over in their size. Repeated until all stand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import daughter_keys, keyed_uniform
from ...base.runs import Runs
from ...base.trimesh import TriMesh
from ...spec import SpecError
from ..mesh.leaves import Leaves
from ..skeleton import Skeleton
from .measure import dbh_of, lowest_branch, width_of
from .wanted import TARGETS, Wanted

ROUNDS = 20
MOST_LEAVES = 5_000_000
CORE = 1.5  # radii of the stem, within which wood is the stem's
FARTHEST = 4.0  # that parts are stretched or squeezed, against the tree of that height
RAISED = 3.0  # that the base of a crown is moved up; beyond, lower branches are left out
CLOSE = 2e-3  # relative, of what counts as met
SAID = 0.05  # relative, from which on a sentence says that a target is not met


@dataclass(frozen=True)
class Parts:
    """A tree as it is grown of template parts; foot : (L, 3) where each leaf hangs.

    grafted : whether the skeleton is trunk and first-level axes only.
    """

    mesh: TriMesh
    leaves: Leaves
    foot: np.ndarray
    skeleton: Skeleton
    grafted: bool


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
    found = measures_of(parts)
    for name, value in found.items():
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
    """Return what the tree measures, by the names of ``TARGETS``."""
    leaves, wood = parts.leaves, parts.skeleton
    reach = 0.5 * leaves.length[:, None] * leaves.axis
    ends = np.concatenate([leaves.centre - reach, leaves.centre + reach])
    if not len(leaves):
        base = 0.0
    elif parts.grafted:
        base = float(leaves.centre[:, 2].min())
    else:
        base = lowest_branch(wood, leaves.branch)
    values = (
        dbh_of(wood),
        float(parts.mesh.vertices[:, 2].max(initial=0.0)),
        width_of(ends if len(leaves) else wood.end),
        base,
        float(np.pi * (leaves.radius**2).sum()),
    )
    return dict(zip(TARGETS, values, strict=True))


def _with_leaf_area(parts: Parts, area: float, key: int, where: str) -> Parts:
    """As many leaves as make a leaf area: some left out, or set again, turned about their feet."""
    leaves, foot = parts.leaves, parts.foot
    found = np.pi * leaves.radius**2
    have = len(leaves)
    count = max(1, round(have * area / float(found.sum()))) if found.sum() > 0 else have
    if count > MOST_LEAVES:
        raise SpecError(
            where,
            f"{area:.4g} m² of leaves would be {count:.2g} leaves, more than {MOST_LEAVES:,}; "
            "use larger leaves or a smaller leaf_area",
        )
    keys = daughter_keys(np.full(have, key, np.uint64), np.arange(have))
    rank = np.argsort(keyed_uniform(keys, "leaf chosen"))
    pick = np.sort(np.concatenate([*[np.arange(have)] * (count // have), rank[: count % have]]))
    again = np.concatenate([[False], pick[1:] == pick[:-1]])
    own = daughter_keys(np.full(count, key, np.uint64), np.arange(count))
    angle = np.where(again, 2 * np.pi * keyed_uniform(own, "leaf turn"), 0.0)
    total = float(found[pick].sum())
    size = np.sqrt(area / total) if total > 0 else 1.0
    mesh, vertex, of_vertex = _copied(parts.mesh, have, pick)
    turned = _about_vertical(parts.mesh.vertices[vertex] - foot[pick][of_vertex], angle[of_vertex])
    wood = len(mesh.vertices) - len(vertex)
    mesh.vertices[wood:] = foot[pick][of_vertex] + size * turned
    made = Leaves(
        centre=foot[pick] + size * _about_vertical(leaves.centre[pick] - foot[pick], angle),
        normal=_about_vertical(leaves.normal[pick], angle),
        axis=_about_vertical(leaves.axis[pick], angle),
        length=leaves.length[pick] * size,
        width=leaves.width[pick] * size,
        radius=leaves.radius[pick] * size,
        branch=leaves.branch[pick],
    )
    return replace(parts, mesh=mesh, leaves=made, foot=foot[pick])


def _copied(mesh: TriMesh, count: int, pick: np.ndarray) -> tuple[TriMesh, np.ndarray, np.ndarray]:
    """Wood, then the picked leaves, whose vertices are still to be placed; the vertex (V,) of the mesh that
    each of a leaf is, and (V,) which of the picked it belongs to.
    """
    is_leaf = mesh.leaf >= 0
    wood = mesh.select(~is_leaf)
    triangle = np.flatnonzero(is_leaf)
    triangle = triangle[np.argsort(mesh.leaf[triangle], kind="stable")]
    owner = np.full(len(mesh.vertices), -1)
    owner[mesh.triangles[triangle]] = mesh.leaf[triangle][:, None]
    vertex = np.flatnonzero(owner >= 0)
    vertex = vertex[np.argsort(owner[vertex], kind="stable")]
    place = np.empty(len(mesh.vertices), np.int64)
    place[vertex] = np.arange(len(vertex))
    row, of_vertex, moved = Runs.of(owner[vertex], count).copy(pick)
    face, of_face, _ = Runs.of(mesh.leaf[triangle], count).copy(pick)
    of_mesh = triangle[face]
    corners = place[mesh.triangles[of_mesh]] + moved[of_face][:, None] + len(wood.vertices)
    places = np.concatenate([wood.vertices, np.empty((len(row), 3))])

    def joined(name: str) -> np.ndarray | None:
        mine, theirs = getattr(wood, name), getattr(mesh, name)
        return None if theirs is None else np.concatenate([mine, theirs[of_mesh]])

    made = TriMesh(
        vertices=places,
        triangles=np.concatenate([wood.triangles, corners.astype(np.int32)]),
        part=np.concatenate([wood.part, mesh.part[of_mesh]]),
        leaf=np.concatenate([wood.leaf, of_face.astype(np.int32)]),
        material=np.concatenate([wood.material, mesh.material[of_mesh]]),
        uv=joined("uv"),
        order=joined("order"),
    )
    return made, vertex[row], of_vertex


def _stretched(parts: Parts, wanted: Wanted) -> Parts:
    """Wood moved until height, base, width and diameter are those wanted, leaves with their feet."""
    height = measures_of(parts)["height"]
    parts = _moved(parts, lambda p: p * (wanted.height / height), wanted.height / height)
    across = down = up = 1.0
    for _ in range(ROUNDS):
        found = measures_of(parts)
        off = [abs(found[name] / getattr(wanted, name) - 1) for name in TARGETS[1:4]]
        thick = wanted.dbh / found["dbh"] if found["dbh"] else 1.0
        if max(off) < CLOSE / 10 and abs(thick - 1) < 1e-7:
            break
        wide = wanted.crown_width / found["crown_width"] if found["crown_width"] else 1.0
        wide = float(np.clip(wide * across, 1 / FARTHEST, FARTHEST)) / across
        top = float(parts.skeleton.end[:, 2].max())
        goal = top + wanted.height - found["height"]
        base = found["crown_base"]
        knots, goals = np.array([0.0, top]), np.array([0.0, goal])
        if 1e-3 < base < top - 1e-3 and wanted.crown_base < goal:
            low = _limited(wanted.crown_base / base, down)
            high = _limited((goal - low * base) / (top - base), up)
            down, up = down * low, up * high
            knots = np.array([0.0, base, top])
            goals = np.array([0.0, low * base, low * base + high * (top - base)])
        still = abs(wide - 1) < 1e-6 and np.allclose(goals, knots, rtol=1e-6)
        if still and abs(thick - 1) < 1e-7:
            break  # as far as parts may be stretched
        across *= wide
        parts = _drawn_out(parts, knots, goals, wide, thick)
    return parts


def _limited(factor: float, so_far: float) -> float:
    return float(np.clip(factor * so_far, 1 / FARTHEST, FARTHEST)) / so_far


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
    slope = (goals[-1] - goals[-2]) / (knots[-1] - knots[-2])

    def move(p: np.ndarray) -> np.ndarray:
        height = p[:, 2]
        axis = np.column_stack([np.interp(height, z, middle[:, k]) for k in range(2)])
        away = p[:, :2] - axis
        r = np.linalg.norm(away, axis=1)
        inner = np.minimum(r, np.interp(height, z, core))
        factor = (thick * inner + wide * (r - inner)) / np.maximum(r, 1e-12)
        new = np.interp(height, knots, goals) + slope * np.maximum(height - knots[-1], 0)
        new += np.minimum(height, 0.0)
        return np.column_stack([axis + away * factor[:, None], new])

    return _moved(parts, move, np.where(wood.order == 0, thick, 1.0))


def _moved(
    parts: Parts, move: Callable[[np.ndarray], np.ndarray], girth: float | np.ndarray
) -> Parts:
    """Wood through a map of points, leaves with their feet, radii by factors of segments."""
    mesh, wood = parts.mesh, parts.skeleton
    of_vertex = np.full(len(mesh.vertices), -1)
    is_leaf = mesh.leaf >= 0
    of_vertex[mesh.triangles[is_leaf]] = mesh.leaf[is_leaf][:, None]
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


def _about_vertical(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) turned by angles (N,)."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = vectors.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, z])
