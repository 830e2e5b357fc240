"""Branch templates: a full tree in facets, cut into its trunk and its first-level branches, which are grafted
onto nodes of a grammar (Tanveer et al. 2020a, b).

A first-level branch is a piece of wood that hangs on the trunk, with all that hangs on it, wood and leaves.
Each is brought into one canonical frame: foot at the origin, axis from foot to tip along +X, length 1, and
the side that was up in the tree towards +Z. At a node its axis is turned into the branch's direction and its
upper side as far up as that direction allows, so that leaves keep facing the light. Wood is scaled with the
branch; leaves move with it but keep their own size, because a longer branch bears no larger leaves.

What hard cases come to: two leaves that touch at a point stay two, two that share an edge are one; a
leaf drawn from both sides is one leaf; leaves may touch wood, as they come as facets of their own; shoots
on the trunk shorter than a twentieth of its longest branch, which a grammar would blow up to branches, and
roots are left out; a piece of wood that is modelled inside out is turned.

``fit_grammar`` fits the grammar to a tree, so that what grows from it has its habit: the trunk's first
internode is the trunk below the lowest branch, the contraction along the trunk makes up its length, and
angle, thickness and length of the branches are means over the templates. ``dress`` sets leaves on a tree that
has none, on its outermost branches, as facets like an STL file's: along the outer end of a twig stand
``leaf.nodes`` nodes of ``leaf.per_node`` leaves each, turned from node to node by ``leaf.fan_deg``, the last
at the tip.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from ...base.rng import child_keys, stream, truncated_normal
from ...base.runs import numbered
from ...base.trimesh import LEAF, WOOD, TriMesh, join
from ...spec import Grammar, Jitter, Leaf
from ..lsystem.branching import interpret, string_of
from ..mesh.blades import Blade, lay, leaves_on_nodes
from ..mesh.leaves import CopyStock, Leaves, about_vertical, leaves_apart, measure_leaves
from ..skeleton import branch_feet, find_axes
from .centreline import find_contacts
from .recognise import Recognition, TemplateError, checked_facets, recognise

__all__ = ["BranchTemplate", "TemplateError", "TreeTemplate", "split_tree"]

SHORTEST = 0.05  # of the longest first-level branch; shorter ones are stubs
ROOTS = 0.05  # share of the trunk's length up to which what ends below its foot is a root
BARK_SLOT, LEAF_SLOT = 0, 1  # material slots
MOST_LEAVES_A_FOOT = 3.0
COPIES = 2  # sets of branches at a node; each set has two
STILL = Jitter(length=0, angle_deg=0, twist_deg=0, raise_ratio=0, lean_deg=0, leaf_size=0)
BARE = 0.25  # share of a twig, from its foot, that bears no leaves
KEY = 0x1EAF  # every draw is keyed by twig and leaf below this


@dataclass(frozen=True)
class BranchTemplate:
    """A first-level branch with all it bears, in its canonical frame.

    mesh : wood and leaf triangles; leaf numbers 0 .. L - 1.
    leaves : their truth in the same frame; ``branch`` is the piece of wood within this template that
        bears the leaf, 0 the first-level branch itself, the others from 1 in the order of the file.
    length : metres from foot to tip in the template tree, straight.
    base_radius : metres, at the foot.
    height : where it hangs, as a share of the trunk's length, 0 .. 1.
    angle : radians between its axis and the trunk's direction there.
    """

    mesh: TriMesh
    leaves: Leaves
    length: float
    base_radius: float
    height: float
    angle: float

    @cached_property
    def apart(self) -> tuple[CopyStock, np.ndarray]:
        """Its wood and then its leaves, each seen from where it hangs; (1 + L, 3) where that is: of a leaf
        the corner or edge middle that is nearest to any wood."""
        wood, leaf_mesh, leaf_of_vertex = leaves_apart(self.mesh)
        foot = np.zeros((1 + len(self.leaves), 3))
        if len(self.leaves):
            corners = leaf_mesh.vertices[leaf_mesh.triangles]
            places = np.concatenate([corners, (corners + np.roll(corners, 1, axis=1)) / 2], axis=1)
            owner = np.repeat(1 + leaf_mesh.leaf, places.shape[1])
            places = places.reshape(-1, 3)
            gap = scipy.spatial.cKDTree(wood.vertices).query(places)[0]
            farthest_first = np.argsort(-gap, kind="stable")
            foot[owner[farthest_first]] = places[farthest_first]
        owner = np.append(np.zeros(len(wood.vertices), int), 1 + leaf_of_vertex)
        place = np.concatenate([wood.vertices, leaf_mesh.vertices]) - foot[owner]
        triangles = [wood.triangles, leaf_mesh.triangles + len(wood.vertices)]
        return CopyStock.of(place, owner, np.concatenate(triangles), LEAF, LEAF_SLOT), foot


@dataclass(frozen=True, eq=False)  # one template is another only if it is the same object
class TreeTemplate:
    """A tree taken apart.

    branches : templates of the first-level branches, from the lowest up.
    trunk_length : metres along its centreline.
    trunk_radius : metres, at the foot.
    """

    branches: tuple[BranchTemplate, ...]
    trunk_length: float
    trunk_radius: float


def split_tree(
    wood: np.ndarray, leaves: np.ndarray | None = None, *, height: float = 0.0
) -> TreeTemplate:
    """Split a tree into trunk and branch templates.

    wood, leaves : (T, 3, 3) facets, z up.
    height : metres from the lowest to the highest wood; 0: the facets are in metres.

    Raises
    ------
    TemplateError : the facets are no tree with a trunk and branches.
    """
    wood = checked_facets(wood, "wood")
    tall = float(np.ptp(wood[:, :, 2])) if len(wood) else 0.0
    unit = height / tall if height > 0 and tall > 0 else 1.0
    recognition = recognise(wood * unit, None if leaves is None else np.asarray(leaves) * unit)
    timber = TriMesh.of_part(recognition.wood.vertices, turned_outwards(recognition), WOOD)
    leafy = recognition.leaves
    foliage = TriMesh.of_part(leafy.vertices, leafy.triangles, LEAF, leafy.piece, LEAF_SLOT)
    branches = [_cut(recognition, timber, foliage, *place) for place in _first_level(recognition)]
    return TreeTemplate(
        branches=tuple(branches),
        trunk_length=float(recognition.lines.length()[recognition.trunk]),
        trunk_radius=float(recognition.radius[recognition.trunk]),
    )


def canonical_frame(axis: np.ndarray) -> np.ndarray:
    """(3, 3) rotation whose rows are the canonical X, Y, Z of a branch with this unit axis.

    Z is as far up as the axis allows. Along an upright axis no side is up: Y stays what it is.
    """
    x, y, z = axis
    side = np.array([-y, x, 0.0])
    norm = float(np.linalg.norm(side))
    side = side / norm if norm > 1e-9 else np.array([0.0, 1.0, 0.0])
    u, v, w = side
    return np.array([axis, side, [y * w - z * v, z * u - x * w, x * v - y * u]])


def _first_level(found: Recognition) -> Iterator[tuple[int, float, np.ndarray]]:
    """First-level branches from the lowest up: the piece, the share of the trunk's length at which it hangs,
    and the trunk's direction (3,) there.
    """
    firsts = found.firsts
    foot, tip = found.foot[firsts], found.tip[firsts]
    contact = find_contacts(found.lines, np.array([found.trunk]), foot)
    share, direction = contact.along / found.lines.length()[found.trunk], contact.direction
    if found.foot_end[found.trunk] == 1:
        share, direction = 1.0 - share, -direction

    root = (share < ROOTS) & (tip[:, 2] < found.foot[found.trunk, 2])
    if root.all():
        raise TemplateError(
            "the trunk has roots but no branches; export trunk and branches as separate parts."
        )
    length = np.linalg.norm(tip - foot, axis=1)
    kept = ~root & (length >= SHORTEST * length[~root].max())
    order = np.flatnonzero(kept)[np.argsort(share[kept], kind="stable")]
    return zip(firsts[order].tolist(), share[order].tolist(), direction[order], strict=True)


def _cut(
    found: Recognition,
    timber: TriMesh,
    foliage: TriMesh,
    first: int,
    height: float,
    trunk_direction: np.ndarray,
) -> BranchTemplate:
    """The template of one first-level branch."""
    foot, axis = found.foot[first], found.tip[first] - found.foot[first]
    length = float(np.linalg.norm(axis))
    frame = canonical_frame(axis / length)
    members = found.branch == first
    borne = members[found.bearer]  # (L,)
    parts = [timber.select(members[found.wood.piece]), foliage.select(borne[found.leaves.piece])]
    parts = [replace(one, vertices=(one.vertices - foot) @ frame.T / length) for one in parts]
    parts[1].leaf[:] = (np.cumsum(borne) - 1)[parts[1].leaf]
    mesh = join(parts)
    pieces = np.flatnonzero(members)
    number = np.zeros(len(members), dtype=np.int32)
    number[pieces[pieces != first]] = np.arange(1, len(pieces))
    return BranchTemplate(
        mesh=mesh,
        leaves=measure_leaves(mesh, number[found.bearer[borne]]),
        length=length,
        base_radius=float(found.radius[first]),
        height=height,
        angle=float(np.arccos(np.clip(frame[0] @ trunk_direction, -1.0, 1.0))),
    )


def turned_outwards(found: Recognition) -> np.ndarray:
    """(T, 3) triangles of the wood, those of pieces that face their centreline turned over."""
    wood = found.wood
    outward = found.lines.outward[wood.triangles].mean(axis=1)
    facing = np.einsum("ti,ti->t", wood.area_vectors(), outward)
    inside_out = np.bincount(wood.piece, facing, wood.count) < 0
    return np.where(inside_out[wood.piece, None], wood.triangles[:, ::-1], wood.triangles)


@dataclass(frozen=True)
class GraftSite:
    """Place of a graft: its foot (3,), unit direction (3,) and length in metres."""

    foot: np.ndarray
    direction: np.ndarray
    length: float


def graft(
    branch: BranchTemplate,
    site: GraftSite,
    leaf_spread: float,
    roll: float,
    rng: np.random.Generator,
) -> tuple[TriMesh, Leaves, np.ndarray]:
    """The branch at its site, wood and leaves in one mesh with leaf numbers from 0; their truth, and
    (L, 3) where they hang.

    leaf_spread : relative standard deviation of leaf size.
    roll : radians that the branch is turned about its own axis.

    A longer branch bears more leaves, not larger ones: their number goes with length^1.5, as a crown's leaf
    area between its length and its area. A leaf of the template hangs there not at all, once or several
    times, each further one turned about the vertical at the same foot. Its truth is moved as the leaf is.
    """
    stock, feet = branch.apart
    share = min((site.length / branch.length) ** 1.5, MOST_LEAVES_A_FOOT)
    times = np.floor(share + rng.random(len(branch.leaves))).astype(int)
    source, rank = numbered(times)  # (L,) leaf of the template, and which copy of it
    size = branch.length * (1 + leaf_spread * truncated_normal(rng, len(source)))
    turn = np.where(rank == 0, 0.0, np.pi * rng.uniform(0.4, 1.6, len(source)))
    things = np.append(0, 1 + source)  # the wood, then leaves
    size, turn = np.append(site.length, size), np.append(0.0, turn)
    cos, sin, foot = np.cos(turn), np.sin(turn), feet[things] * site.length

    mesh, vertex, of_vertex, of_triangle = stock.copy(things, np.zeros(len(things), bool))
    mesh.leaf[:] = of_triangle - 1
    wood = mesh.leaf < 0
    mesh.part[wood], mesh.material[wood] = WOOD, BARK_SLOT
    place = stock.place.take(vertex, axis=0)
    place = about_vertical(place, cos.take(of_vertex), sin.take(of_vertex))
    place *= size.take(of_vertex)[:, None]
    place += foot.take(of_vertex, axis=0)

    own, size, cos, sin, foot = branch.leaves, size[1:], cos[1:], sin[1:], foot[1:]
    middle = about_vertical(own.centre[source] - feet[1 + source], cos, sin) * size[:, None]
    c, s = np.cos(roll), np.sin(roll)
    rolled = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    frame = canonical_frame(site.direction).T @ rolled  # columns: images of X, Y, Z
    truth = Leaves(
        centre=(foot + middle) @ frame.T + site.foot,
        normal=about_vertical(own.normal[source], cos, sin) @ frame.T,
        axis=about_vertical(own.axis[source], cos, sin) @ frame.T,
        length=own.length[source] * size,
        width=own.width[source] * size,
        radius=own.radius[source] * size,
        branch=own.branch[source],
    )
    mesh = replace(mesh, vertices=place @ frame.T + site.foot)
    return mesh, truth, foot @ frame.T + site.foot


def fit_grammar(template: TreeTemplate) -> Grammar:
    """The grammar whose trees look most like the one that the template was taken from."""
    branches = template.branches
    generations = int(np.clip(round(len(branches) / (2 * COPIES)), 2, 10))
    total = template.trunk_length
    length = float(np.clip(branches[0].height, 0.02, 0.9)) * total
    grammar = Grammar(
        generations=generations,
        copies=COPIES,
        length=length,
        side_ratio=1.0,
        centre_ratio=_contraction(total / length, generations),
        angle_deg=float(np.rad2deg(np.median([b.angle for b in branches]))),
        radius=template.trunk_radius,
        radius_ratio=float(
            np.clip(np.median([b.base_radius for b in branches]) / template.trunk_radius, 0.05, 1)
        ),
    )
    skeleton = interpret(string_of(grammar), grammar, STILL, stream(0, "habit"))
    axes, own_lengths = find_axes(skeleton), skeleton.length
    reach = float(np.mean([own_lengths[axes.chain(foot)].sum() for foot in branch_feet(skeleton)]))
    wanted = float(np.mean([b.length for b in branches]))
    ratio = float(np.clip(wanted / reach, 0.01, 2.0))
    fitted = replace(grammar, side_ratio=ratio)
    # Four digits: what is fitted is no more exact, and a person will read it.
    digits: dict[str, Any] = {
        name: float(f"{getattr(fitted, name):.4g}")
        for name in ("length", "side_ratio", "centre_ratio", "angle_deg", "radius", "radius_ratio")
    }
    return replace(fitted, **digits)


def _contraction(internodes: float, generations: int) -> float:
    """The ratio c for which 1 + c + ... over all internodes of the trunk is this many first ones."""

    def miss(c: float) -> float:
        return float((c ** np.arange(generations + 1)).sum()) - internodes

    if miss(0.05) >= 0 or miss(1.5) <= 0:
        return 0.05 if miss(0.05) >= 0 else 1.5
    return float(scipy.optimize.brentq(miss, 0.05, 1.5))


def dress(wood: np.ndarray, leaf: Leaf, blade: Blade, unit: float) -> np.ndarray:
    """(T, 3, 3) facets of leaves for the wood's facets (T, 3, 3), in the wood's own units.

    unit : metres per unit of the wood.

    Raises
    ------
    TemplateError : there is no trunk with branches in the wood.
    """
    recognition = recognise(wood)
    bears = np.zeros(len(recognition.parent), dtype=bool)
    bears[recognition.parent[recognition.parent >= 0]] = True
    bears[recognition.trunk] = True
    share = np.linspace(BARE, 1.0, leaf.nodes)
    feet, headings, twigs = [], [], np.flatnonzero(~bears)
    for twig in twigs:
        knots = slice(recognition.lines.first[twig], recognition.lines.first[twig + 1])
        knot, along = recognition.lines.knot[knots], recognition.lines.along[knots]
        backwards = recognition.foot_end[twig] == 1
        place = along[-1] * (1.0 - share if backwards else share)
        feet.append(np.stack([np.interp(place, along, axis) for axis in knot.T], axis=1))
        step = np.diff(knot, axis=0)
        of_step = np.clip(np.searchsorted(along, place, side="right") - 1, 0, len(step) - 1)
        heading = step[of_step] * (-1.0 if backwards else 1.0)
        headings.append(heading / np.linalg.norm(heading, axis=1, keepdims=True))

    keys = child_keys(np.full(len(twigs), KEY, np.uint64), twigs)
    mesh = lay(leaves_on_nodes(leaf, keys, np.array(feet) * unit, np.array(headings), twigs), blade)
    return mesh.vertices[mesh.triangles] / unit
