"""Branch templates: a full tree in facets, cut into its trunk and its first-level branches (Tanveer et al.
2020a, b).

A first-level branch is a piece of wood that hangs on the trunk, with all that hangs on it, wood and
leaves. Each is brought into one canonical frame, so that it can be set on any node of a grammar: foot at
the origin, axis from foot to tip along +X, length 1, and the side that was up in the tree towards +Z.

What hard cases come to: two leaves that touch at a point stay two, two that share an edge are one; a
leaf drawn from both sides is one leaf; leaves may touch wood, as they come as facets of their own; shoots
on the trunk shorter than a twentieth of its longest branch, which a grammar would blow up to branches, and
roots are counted and left out; a piece of wood that is modelled inside out is turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.trimesh import LEAF, WOOD, TriMesh
from ..mesh.leaves import Leaves, measure_leaves
from ..recognise.recognise import Recognition, TemplateError, checked_facets, recognise
from ..recognise.tubes import find_contacts

__all__ = ["BranchTemplate", "TemplateError", "TreeTemplate", "split_tree"]

SHORTEST = 0.05  # of the longest first-level branch; shorter ones are stubs
ROOTS = 0.05  # share of the trunk's length up to which what ends below its foot is a root
BARK_SLOT, LEAF_SLOT = 0, 1  # material slots


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


@dataclass(frozen=True, eq=False)  # one template is another only if it is the same object
class TreeTemplate:
    """A tree taken apart.

    branches : templates of the first-level branches, from the lowest up.
    trunk : metres, middle of its foot at the origin, z up.
    trunk_length : metres along its centreline.
    trunk_radius : metres, at the foot.
    unit : metres in one unit of the facets.
    wood_components, leaf_count : pieces of wood, trunk and stubs included, and leaves.
    unattached_leaves : leaves in no template: borne by the trunk or by a stub.
    stubs : what hangs on the trunk but is no template, because it is too short or a root.
    """

    branches: tuple[BranchTemplate, ...]
    trunk: TriMesh
    trunk_length: float
    trunk_radius: float
    unit: float
    wood_components: int
    leaf_count: int
    unattached_leaves: int
    stubs: int


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
    found = recognise(wood * unit, None if leaves is None else np.asarray(leaves) * unit)
    timber = _mesh(found.wood.vertices, turned_outwards(found), WOOD)
    foliage = _mesh(found.leaves.vertices, found.leaves.triangles, LEAF, found.leaves.piece)

    firsts, share, direction, stubs = _first_level(found)
    branches = [
        _cut(found, int(firsts[at]), timber, foliage, float(share[at]), direction[at])
        for at in range(len(firsts))
    ]
    trunk = timber.select(found.wood.piece == found.trunk)
    return TreeTemplate(
        branches=tuple(branches),
        trunk=_moved(trunk, found.foot[found.trunk], np.eye(3), 1.0),
        trunk_length=float(found.lines.length()[found.trunk]),
        trunk_radius=float(found.radius[found.trunk]),
        unit=unit,
        wood_components=found.wood.count,
        leaf_count=found.leaves.count,
        unattached_leaves=found.leaves.count - sum(len(branch.leaves) for branch in branches),
        stubs=stubs,
    )


def canonical_frame(axis: np.ndarray) -> np.ndarray:
    """(3, 3) rotation whose rows are the canonical X, Y, Z of a branch with this unit axis.

    Z is as far up as the axis allows. Along an upright axis no side is up: Y stays what it is.
    """
    side = np.cross([0.0, 0.0, 1.0], axis)
    norm = float(np.linalg.norm(side))
    side = side / norm if norm > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.stack([axis, side, np.cross(axis, side)])


def _first_level(found: Recognition) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """First-level branches from the lowest up: (N,) pieces, (N,) the shares of the trunk's length at
    which they hang, (N, 3) its direction there; and how many were left out.
    """
    firsts = found.firsts
    foot, tip = found.foot[firsts], found.tip[firsts]
    contact = find_contacts(found.lines, np.array([found.trunk]), foot)
    share, direction = contact.along / found.lines.length()[found.trunk], contact.direction
    if found.hierarchy.foot_end[found.trunk] == 1:
        share, direction = 1.0 - share, -direction

    root = (share < ROOTS) & (tip[:, 2] < found.foot[found.trunk, 2])
    if root.all():
        raise TemplateError(
            "the trunk has roots but no branches; export trunk and branches as separate parts."
        )
    length = np.linalg.norm(tip - foot, axis=1)
    kept = ~root & (length >= SHORTEST * length[~root].max())
    order = np.flatnonzero(kept)[np.argsort(share[kept], kind="stable")]
    return firsts[order], share[order], direction[order], int(np.count_nonzero(~kept))


def _cut(
    found: Recognition,
    first: int,
    timber: TriMesh,
    foliage: TriMesh,
    height: float,
    trunk_direction: np.ndarray,
) -> BranchTemplate:
    """The template of one first-level branch."""
    foot, axis = found.foot[first], found.tip[first] - found.foot[first]
    length = float(np.linalg.norm(axis))
    frame = canonical_frame(axis / length)
    members = found.branch == first
    borne = members[found.bearer]  # (L,)
    wood = _moved(timber.select(members[found.wood.piece]), foot, frame, length)
    blades = _moved(foliage.select(borne[found.leaves.piece]), foot, frame, length)
    renumbered = (np.cumsum(borne) - 1).astype(np.int32)
    mesh = TriMesh(
        vertices=np.concatenate([wood.vertices, blades.vertices]),
        triangles=np.concatenate([wood.triangles, blades.triangles + np.int32(len(wood.vertices))]),
        part=np.concatenate([wood.part, blades.part]),
        leaf=np.concatenate([wood.leaf, renumbered[blades.leaf]]),
        material=np.concatenate([wood.material, blades.material]),
    )
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


def _mesh(
    vertices: np.ndarray, triangles: np.ndarray, what: int, leaf: np.ndarray | None = None
) -> TriMesh:
    count = len(triangles)
    return TriMesh(
        vertices=vertices,
        triangles=triangles,
        part=np.full(count, what, dtype=np.int8),
        leaf=np.full(count, -1, dtype=np.int32) if leaf is None else leaf,
        material=np.full(count, LEAF_SLOT if what == LEAF else BARK_SLOT, dtype=np.int32),
    )


def _moved(mesh: TriMesh, origin: np.ndarray, frame: np.ndarray, length: float) -> TriMesh:
    """A mesh in a frame: its origin there, its rows the new axes, its unit of length."""
    return TriMesh(
        vertices=(mesh.vertices - origin) @ frame.T / length,
        triangles=mesh.triangles,
        part=mesh.part,
        leaf=mesh.leaf,
        material=mesh.material,
    )
