"""Trees in pieces: a scene whose swaying trees are cut, and rays at pieces that move.

Trees are cut into the pieces of their rig. At the seams both neighbours have the triangles there, so that no
ray slips between them. A window is some pieces at some knots of time, between which each goes straight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ...base.trimesh import OTHER, TriMesh
from .boxes import BoxTree
from .caster import Hits, RayCaster
from .geometry import SceneGeometry, invert_transforms


class Swaying(Protocol):
    """Trees that sway, as ``stand.wind.sway`` has them; named by their number in the stand."""

    @property
    def number(self) -> dict[int, int]: ...

    def moves(self, tree: int) -> bool: ...

    def leaning(self) -> int: ...

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray: ...

    def places(self, tree: int, knot: np.ndarray) -> np.ndarray: ...

    def most(
        self, tree: int, low: np.ndarray, high: np.ndarray, knot: np.ndarray | None = None
    ) -> float: ...


class PieceWindow(Protocol):
    """Some pieces for ``SPAN`` knots."""

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        knot: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """The closest hits of rays (R, 3), (R, 3) unit, at knots (R,) from the window's first one on; hits
        number the window's pieces."""
        ...


MakeWindow = Callable[[np.ndarray, np.ndarray], PieceWindow]  # mesh (P,), places (K, P, 3, 4)
MakeEngine = Callable[[tuple[TriMesh, ...]], MakeWindow]


@dataclass(frozen=True)
class SwayingScene:
    """A scene whose swaying trees are in pieces.

    scene : I instances as they were read, those that sway without a surface, then P pieces at rest.
    count : I. owner : (P,) the instance that each piece is of. tree : (P,) its number in the stand.
    piece : (P,) which of the tree's. triangle : by mesh of ``scene``, the triangles of the whole tree that
    its own are; of pieces alone. read : the scene as it was read. known : by mesh and species, the pieces of
    a tree and their meshes.
    """

    scene: SceneGeometry
    read: SceneGeometry
    count: int
    owner: np.ndarray
    tree: np.ndarray
    piece: np.ndarray
    triangle: tuple[np.ndarray, ...]
    known: dict[tuple[int, int], list[tuple[int, int]]]

    @property
    def still(self) -> SceneGeometry:
        """The scene without what sways, with the same numbers."""
        return _rows(self.scene, np.arange(self.count), len(self.read.meshes) + 1)


def cut(read: SceneGeometry, sway: Swaying, like: SwayingScene | None = None) -> SwayingScene:
    """Cut the trees of a scene that sway into pieces.

    like : a scene of the same meshes, whose pieces are shared.
    """
    number = sway.number
    empty = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), OTHER)
    meshes: list[TriMesh] = [*read.meshes, empty]
    slots, assets, names = _padded(read)
    triangle: list[np.ndarray] = [np.empty(0, np.int64)] * len(meshes)
    known: dict[tuple[int, int], list[tuple[int, int]]] = {}
    if like is not None:
        meshes, triangle, known = list(like.scene.meshes), list(like.triangle), dict(like.known)
        slots, assets, names = (
            list(kept)
            for kept in (like.scene.slot_reflectance, like.scene.asset, like.scene.slot_names)
        )
    owner, tree, piece, mesh_of = [], [], [], []
    index = read.mesh_index.copy()
    for instance in np.flatnonzero(read.tree >= 0).tolist():
        row = number.get(int(read.tree[instance]), -1)
        mesh = int(read.mesh_index[instance])
        if row < 0 or not sway.moves(row) or not len(read.meshes[mesh].triangles):
            continue
        key = (mesh, int(read.species[instance]))
        if key not in known:
            known[key] = []
            for which, rows in _pieces(read.meshes[mesh], sway.pieces(row, read.meshes[mesh])):
                known[key].append((which, len(meshes)))
                meshes.append(_taken(read.meshes[mesh], rows))
                triangle.append(rows)
                for kept in (slots, assets, names):
                    if kept:
                        kept.append(kept[mesh])
        index[instance] = len(read.meshes)
        for which, made in known[key]:
            owner.append(instance)
            tree.append(row)
            piece.append(which)
            mesh_of.append(made)
    every = np.concatenate([np.arange(len(read)), np.array(owner, np.int64)])
    scene = SceneGeometry(
        meshes=tuple(meshes),
        transform=read.transform[every],
        mesh_index=np.concatenate([index, np.array(mesh_of, np.int64)]),
        object_name=read.object_name,
        tree=read.tree[every],
        species=read.species[every],
        object_index=read.object_index[every],
        reflectance=read.reflectance[every],
        slot_reflectance=tuple(slots),
        asset=tuple(assets),
        slot_names=tuple(names),
    )
    owners, trees, pieces = (np.array(values, np.int64) for values in (owner, tree, piece))
    return SwayingScene(scene, read, len(read), owners, trees, pieces, tuple(triangle), known)


class PieceByPiece:
    """Rays at pieces of a window, each piece in its own frame: what any caster can do, and slow.

    meshes : of pieces, at rest. make : what makes a caster of a still scene.
    """

    def __init__(
        self, meshes: tuple[TriMesh, ...], make: Callable[[SceneGeometry], RayCaster]
    ) -> None:
        self._meshes, self._make = meshes, make
        self.boxes = boxes_of(meshes)
        self._casters: dict[int, RayCaster] = {}

    def __call__(self, mesh: np.ndarray, places: np.ndarray) -> PieceWindow:
        return _PieceWindow(self, mesh, places)

    def caster(self, mesh: int) -> RayCaster:
        """A caster of one piece in its own frame."""
        if mesh not in self._casters:
            one = np.zeros(1, np.int64)
            alone = SceneGeometry(
                (self._meshes[mesh],), np.eye(3, 4)[None], one, ("",), one - 1, one - 1
            )
            self._casters[mesh] = self._make(alone)
        return self._casters[mesh]


class _PieceWindow:
    def __init__(self, engine: PieceByPiece, mesh: np.ndarray, places: np.ndarray) -> None:
        self._engine, self._mesh, self._places = engine, mesh, places
        self._boxes = BoxTree(*swept(engine.boxes[mesh], places))

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        knot: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        best = Hits.misses(len(origins))
        ray, piece, _ = self._boxes.pairs(origins.T, ways.T, np.maximum(near, 0.0), far)
        order = np.lexsort((piece, self._mesh[piece]))
        ray, piece = ray[order], piece[order]
        cuts = np.flatnonzero(np.diff(self._mesh[piece], prepend=-1))
        for rows in np.split(np.arange(len(ray)), cuts[1:]):
            if not len(rows):
                continue
            of, which = ray[rows], piece[rows]
            inverse = invert_transforms(placed(self._places, which, knot[of]))
            begin = np.einsum("rij,rj->ri", inverse[:, :, :3], origins[of]) + inverse[:, :, 3]
            along = np.einsum("rij,rj->ri", inverse[:, :, :3], ways[of])
            size = np.linalg.norm(along, axis=1)
            left = None
            if leaving is not None:
                left = leaving.select(of)
                same = left.instance == which
                left = replace(left, instance=np.where(same, 0, -1))
            met = self._engine.caster(int(self._mesh[which[0]])).cast(
                begin, along, far[of] * size, min_distance=near[of] * size, leaving=left
            )
            distance = met.distance / size
            order = np.lexsort((distance, of))
            first = order[np.flatnonzero(np.diff(of[order], prepend=-1))]
            first = first[met.found[first] & (distance[first] < best.distance[of[first]])]
            best.put(of[first], Hits(distance[first], which[first], met.triangle[first]))
        return best


def boxes_of(meshes: tuple[TriMesh, ...]) -> np.ndarray:
    """(M, 2, 3) smallest and largest coordinates of meshes with at least one vertex, in their own frames."""
    ends = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in meshes]
    return np.array(ends).reshape(-1, 2, 3)


def rest_of(cut: SwayingScene, of_tree: list[np.ndarray]) -> list[np.ndarray]:
    """Smallest and largest corners (2, G, 3) of the pieces of each tree, in its own frame."""
    known: dict[tuple[int, int], np.ndarray] = {}
    found = []
    for rows in of_tree:
        if not len(rows):
            continue
        mesh = cut.scene.mesh_index[cut.count + rows]
        key = int(mesh[0]), len(mesh)
        if key not in known:
            known[key] = np.zeros((2, int(cut.piece[rows].max()) + 1, 3))
            boxes = boxes_of(tuple(cut.scene.meshes[m] for m in mesh))
            # A piece without triangles has the corner of another: it adds nothing.
            known[key][:] = boxes[0, 0]
            known[key][:, cut.piece[rows]] = boxes.swapaxes(0, 1)
        found.append(known[key])
    return found


def with_runs(cut: SwayingScene, still: SceneGeometry) -> SceneGeometry:
    """The scene in pieces, and behind them the instances that a moving scene has at other times."""
    more = np.arange(cut.count, len(still))
    if not len(more):
        return cut.scene
    scene, first = cut.scene, len(cut.read.meshes) + 1
    mesh = still.mesh_index[more]
    mesh = np.where(mesh < first, mesh, mesh - first + len(scene.meshes))
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(scene, name), getattr(still, name)[more]])
        for name in ("transform", "tree", "species", "object_index", "reflectance")
    }
    listed: dict[str, Any] = {
        name: (*kept, *getattr(still, name)[first:])
        for name in ("meshes", "slot_reflectance", "asset", "slot_names")
        if (kept := getattr(scene, name))
    }
    return replace(scene, mesh_index=np.concatenate([scene.mesh_index, mesh]), **joined, **listed)


def swept(boxes: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates (P, 3) that pieces in boxes (P, 2, 3) have at places (K, P, 3, 4).

    Between knots every point goes straight, so it stays in the box of both.
    """
    middle, half = boxes.mean(axis=1), (boxes[:, 1] - boxes[:, 0]) / 2
    centre = np.einsum("kpij,pj->kpi", places[..., :3], middle) + places[..., 3]
    out = np.einsum("kpij,pj->kpi", np.abs(places[..., :3]), half)
    return (centre - out).min(axis=0), (centre + out).max(axis=0)


def placed(places: np.ndarray, piece: np.ndarray, knot: np.ndarray) -> np.ndarray:
    """(R, 3, 4) of pieces (R,) at knots (R,) between those of places (K, P, 3, 4)."""
    step = np.clip(knot.astype(np.int64), 0, len(places) - 2)
    low, high = places[step, piece], places[step + 1, piece]
    return np.asarray(low + (knot - step)[:, None, None] * (high - low))


def parted(mesh: TriMesh, piece: np.ndarray) -> list[tuple[int, TriMesh]]:
    """Cut a tree into its pieces, with the triangles at their seams; piece : (T,) of each triangle."""
    return [(which, _taken(mesh, rows)) for which, rows in _pieces(mesh, piece)]


def _pieces(mesh: TriMesh, piece: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Each piece with its triangles, and with those of others that share a vertex with them."""
    corner = mesh.triangles.astype(np.int64)
    count = int(piece.max()) + 1
    pair = np.unique((corner * count + piece[:, None]).ravel())
    vertex, of = np.divmod(pair, count)
    first = np.searchsorted(vertex, np.arange(len(mesh.vertices) + 1))
    many = np.diff(first) > 1
    seam = np.flatnonzero(many[corner].any(axis=1))
    rows, where = [np.arange(len(piece))], [piece]
    for side in range(3):
        at = corner[seam, side]
        held = first[at + 1] - first[at]
        flat = np.arange(held.sum()) + np.repeat(first[at] - np.cumsum(held) + held, held)
        rows.append(np.repeat(seam, held))
        where.append(of[flat])
    both = np.unique(np.concatenate(where) * len(piece) + np.concatenate(rows))
    which, row = np.divmod(both, len(piece))
    cuts = np.flatnonzero(np.diff(which, prepend=-1))
    return [(int(which[c]), part) for c, part in zip(cuts, np.split(row, cuts[1:]), strict=True)]


def _taken(mesh: TriMesh, rows: np.ndarray) -> TriMesh:
    keep = np.zeros(len(mesh.triangles), dtype=bool)
    keep[rows] = True
    return mesh.select(keep)


def _padded(read: SceneGeometry) -> tuple[list, list, list]:
    """Return what a scene says of its meshes, with something for the empty one."""
    slots = [*read.slot_reflectance, np.array([np.nan])] if read.slot_reflectance else []
    return (
        slots,
        [*read.asset, ""] if read.asset else [],
        [*read.slot_names, ()] if read.slot_names else [],
    )


def _rows(scene: SceneGeometry, rows: np.ndarray, meshes: int) -> SceneGeometry:
    return replace(
        scene,
        meshes=scene.meshes[:meshes],
        transform=scene.transform[rows],
        mesh_index=scene.mesh_index[rows],
        tree=scene.tree[rows],
        species=scene.species[rows],
        object_index=scene.object_index[rows],
        reflectance=scene.reflectance[rows],
        slot_reflectance=scene.slot_reflectance[:meshes],
        asset=scene.asset[:meshes],
        slot_names=scene.slot_names[:meshes],
    )
