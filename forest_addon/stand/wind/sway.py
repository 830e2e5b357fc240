"""Sway of a whole stand: the motion that sensors and the view ask for, tree by tree.

A variant is reduced to its modes once, a tree's answer to the wind is found when it is first asked for. All
of it follows from the scene's settings and seed, so every process finds the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property

import numpy as np

from ...base.rng import child_keys, first_key
from ...base.trimesh import TriMesh
from ...growth.sway.beams import GreenWood, wood_of_species
from ...growth.sway.shape import (
    Anchors,
    SwayRig,
    SwayShape,
    corner_leaves,
    piece_of_triangles,
    rig_of,
    shape_of,
)
from ...growth.tree import Tree
from ...spec import Species, Wind
from ..forest import GrownForest
from .field import DRAG, NOD, TWIST, Flutter, WindField
from .response import KNOTS, WOOD_DRAG, SwayResponse, response_of

LAYERS = 40  # from the ground to the tops
SLICES = 100  # of a variant's height


def drag_area_of(
    forest: GrownForest, height: float, wood_of: Callable[[tuple[int, int]], GreenWood]
) -> np.ndarray:
    """(LAYERS,) drag coefficient times area in equal layers up to a height in m, over the ground's area.

    wood_of : the wood of a variant, by planting and number. What stands above the height counts in the top
    layer.
    """
    stand, found = forest.stand, np.zeros(LAYERS)
    if not len(stand) or stand.area <= 0:
        return found
    for key, tree in forest.variants.items():
        mine = (stand.species == key[0]) & (stand.variant == key[1])
        place, area = drag_slices(tree, wood_of(key).one_sided)
        layer = np.outer(stand.scale[mine], place) / height * LAYERS
        rows = np.clip(layer.astype(np.int64), 0, LAYERS - 1)
        own = np.outer(stand.scale[mine] ** 2, area)
        found += np.bincount(rows.ravel(), own.ravel(), minlength=LAYERS)
    return found / stand.area


def drag_slices(tree: Tree, one_sided: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights (SLICES,) in m of a variant and its drag coefficient times area (SLICES,) there, m².

    one_sided : m² of one side of its leaves in a m² of leaf area.
    """
    skeleton, leaves = tree.skeleton, tree.leaves
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    wood = 0.5 * WOOD_DRAG * length * skeleton.radius.sum(axis=1)
    leaf = DRAG * one_sided * np.pi * leaves.radius**2
    z = np.concatenate([(skeleton.start + skeleton.end)[:, 2] / 2, leaves.centre[:, 2]])
    top = max(float(z.max(initial=0.0)), 1e-6)
    row = np.clip((z / top * SLICES).astype(np.int64), 0, SLICES - 1)
    area = np.bincount(row, np.concatenate([wood, leaf]), minlength=SLICES)
    return (np.arange(SLICES) + 0.5) / SLICES * top, area


FEW = 65_536  # points at a time
SIGMAS = (
    6.0  # of a mode beyond its mean, that it exceeds less than once in a hundred million moments
)
LOWEST = 1.0  # metres of height for which wind is told
LEAN = 0.2  # of a tree's height: a top that is farther off no longer moves by small motions


class ForestSway:
    """Motion of the trees of a grown forest in the wind.

    field : the wind. like : of a forest of the same variants, whose modes are shared. Trees without a
    skeleton, and dead wood that lies or stands as a stump, do not move.
    """

    def __init__(
        self, forest: GrownForest, wind: Wind, seed: int, like: ForestSway | None = None
    ) -> None:
        self._forest = forest
        self._seed = seed
        heights = forest.heights()
        top = float(np.quantile(heights, 0.9)) if len(heights) else LOWEST
        top = max(top, LOWEST)
        shelter = drag_area_of(forest, top, lambda key: wood_of_species(forest.species[key[0]]))
        self.field = WindField.drawn(wind, top, shelter, seed)
        self._shapes: dict[tuple[int, int], SwayShape | None] = {}
        self._anchors: dict[tuple[int, int], Anchors] = {}
        self._responses: dict[int, SwayResponse | None] = {}
        self._rigs: dict[tuple[int, int], SwayRig | None] = {}
        if like is not None and like._forest.variants is forest.variants:
            self._shapes, self._anchors, self._rigs = like._shapes, like._anchors, like._rigs
        self._knots, self._turned = np.empty(0), np.empty((0, 0))
        self._moment: tuple[float, np.ndarray] = np.nan, np.empty(0)

    @property
    def number(self) -> dict[int, int]:
        """The place in the stand of each tree, by the number that sensors report."""
        return {int(tree): row for row, tree in enumerate(self._forest.stand.id)}

    def shape(self, tree: int) -> SwayShape | None:
        """The modes of a tree's variant, None of what does not move."""
        key = self._key(tree)
        if key not in self._shapes:
            grown, species = self._forest.variants[key], self._forest.species[key[0]]
            self._shapes[key] = _shape(grown, species)
        return self._shapes[key]

    def response(self, tree: int) -> SwayResponse | None:
        """The answer of a tree to the wind, None of what does not move."""
        if tree not in self._responses:
            shape, stand = self.shape(tree), self._forest.stand
            place = stand.position[tree] - [0.0, 0.0, stand.sink[tree]]
            turn, scale = float(stand.rotation[tree]), float(stand.scale[tree])
            ground = float(stand.position[tree, 2])
            self._responses[tree] = (
                None
                if shape is None
                else response_of(shape, self.field, place, turn, scale, ground)
            )
        return self._responses[tree]

    def moves(self, tree: int) -> bool:
        """Return whether a tree sways: it has a skeleton and does not lie dead."""
        return self.shape(tree) is not None

    def rig(self, tree: int) -> SwayRig | None:
        """The pieces of a tree's variant that move as one, None of what does not move."""
        key = self._key(tree)
        if key not in self._rigs:
            shape = self.shape(tree)
            self._rigs[key] = None if shape is None else rig_of(shape)
        return self._rigs[key]

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray:
        """(T,) the piece that each triangle of the mesh of a tree's variant is of; the tree must move."""
        shape, rig = self.shape(tree), self.rig(tree)
        assert shape is not None
        assert rig is not None
        return piece_of_triangles(shape, rig, mesh)

    def places(self, tree: int, knot: np.ndarray) -> np.ndarray:
        """(K, G, 3, 4) where the pieces of a tree are at knots (K,), whole numbers of 1/32 s.

        They are maps from rest in the variant's own frame and size. Between knots pieces go straight.
        """
        rig = self.rig(tree)
        assert rig is not None
        return rig.places(self.amplitudes(tree, knot))

    def amplitudes(self, tree: int, knot: np.ndarray) -> np.ndarray:
        """(K, M) amplitudes of a tree's modes at knots (K,), over the tree's size."""
        response = self.response(tree)
        assert response is not None
        knot = np.asarray(knot)
        if not np.array_equal(knot, self._knots):  # the same for all trees of a moment
            self._knots = knot.copy()
            self._turned = np.exp(1j * (knot / KNOTS)[:, None] * response.rate)
        amplitude = response.mean + (self._turned @ response.waves.T).real
        return np.asarray(amplitude / float(self._forest.stand.scale[tree]))

    def rest(self, tree: int) -> TriMesh:
        """The mesh of a tree's variant at rest, in its own frame."""
        return self._forest.variant_of(tree).mesh

    def variant(self, tree: int) -> tuple[int, int]:
        """The planting and the variant that a tree is of."""
        return self._key(tree)

    def moment(self, tree: int, time: float) -> tuple[np.ndarray, np.ndarray]:
        """(G, 3, 4) where the pieces of a tree are at a time, s, and (G, 3, 4) how fast that changes, 1/s;
        as ``places``, without knots."""
        rig, response = self.rig(tree), self.response(tree)
        assert rig is not None
        assert response is not None
        scale = float(self._forest.stand.scale[tree])
        if time != self._moment[0]:  # the same for all trees of a moment
            self._moment = time, np.exp(1j * time * response.rate)
        turned = self._moment[1] * response.waves
        amplitude = (response.mean + turned.sum(axis=1).real)[None]
        rate = -(turned * response.rate).sum(axis=1).imag[None]
        return rig.places(amplitude / scale)[0], rig.shifts(rate / scale)[0]

    def pieces_at(self, tree: int, points: np.ndarray, leaf: np.ndarray) -> np.ndarray:
        """(N,) the piece that points (N, 3) of a tree's variant are on; leaf : (N,) its leaf, -1 wood."""
        rig = self.rig(tree)
        assert rig is not None
        return np.asarray(rig.of_member[self.anchors_of(tree, points, leaf).bone])

    def flutter(
        self, tree: int, leaf: np.ndarray, time: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Foot (N, 3) of leaves of a tree, and by how much they turn about it at a time: vectors (N, 3) in
        radians and their rates, in the variant's frame. Needles do not flutter.
        """
        shape = self.shape(tree)
        assert shape is not None
        species = self._forest.species[self._key(tree)[0]]
        if species.needles is not None or not len(shape.seats.segment):
            none = np.zeros((len(leaf), 3))
            return none, none, none
        seats = np.minimum(leaf, len(shape.seats.segment) - 1)
        value, rate = self._turns(tree, seats, np.full(len(leaf), time))
        return shape.seats.foot[seats], value, rate

    def most(
        self, tree: int, low: np.ndarray, high: np.ndarray, knot: np.ndarray | None = None
    ) -> float:
        """Metres in the variant's size that no point of a tree's pieces, in boxes from (G, 3) to (G, 3), is
        off its rest at knots (K,) and between them; left out: ever, all waves in phase."""
        rig, response = self.rig(tree), self.response(tree)
        assert rig is not None
        assert response is not None
        middle, half = (low + high) / 2, (high - low) / 2
        off = np.abs(np.einsum("gmij,gj->gmi", rig.maps[..., :3], middle) + rig.maps[..., 3])
        off += np.einsum("gmij,gj->gmi", np.abs(rig.maps[..., :3]), half)
        if knot is None:
            amplitude = np.abs(response.mean) + np.abs(response.waves).sum(axis=1)
            amplitude /= float(self._forest.stand.scale[tree])
        else:
            amplitude = np.abs(self.amplitudes(tree, knot)).max(axis=0)
        return float(np.linalg.norm(np.einsum("m,gmi->gi", amplitude, off), axis=1).max())

    def anchors(self, tree: int) -> Anchors:
        """Anchors of the mesh vertices of a tree's variant, in the order of ``Tree.mesh.vertices``."""
        key = self._key(tree)
        if key not in self._anchors:
            mesh = self._forest.variants[key].mesh
            self._anchors[key] = self.anchors_of(tree, mesh.vertices, corner_leaves(mesh))
        return self._anchors[key]

    def anchors_of(self, tree: int, points: np.ndarray, leaf: np.ndarray) -> Anchors:
        """Anchors of points (N, 3) of a tree's variant in its own frame; leaf : (N,) its leaf, -1 wood."""
        shape = self.shape(tree)
        return _still(len(points)) if shape is None else shape.anchors_of(points, leaf)

    def displacement(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(N, 3) metres that points of trees (N,) are off their rest at times (N,), in the world's axes."""
        return self._moved(tree, at, time, 0)

    def velocity(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(N, 3) metres a second of points of trees (N,) at times (N,), in the world's axes."""
        return self._moved(tree, at, time, 1)

    def reach(self, tree: np.ndarray) -> np.ndarray:
        """(N,) metres that points of trees stay within, of six standard deviations of every mode."""
        known = {int(t): self._reach(int(t)) for t in np.unique(tree)}
        return np.array([known[int(t)] for t in tree])

    def leaning(self) -> int:
        """Count the trees asked until now whose tops lean by more than ``LEAN`` of their height, or that are
        held where they would bend farther than small rotations tell."""
        heights, found = self._forest.heights(), 0
        for tree, response in self._responses.items():
            shape = self.shape(tree)
            if shape is not None and response is not None:
                off = np.einsum("nmi,m->ni", shape.modes.shape[:, :, :3], response.mean)
                found += (
                    response.held or float(np.linalg.norm(off, axis=1).max()) > LEAN * heights[tree]
                )
        return found

    def _key(self, tree: int) -> tuple[int, int]:
        stand = self._forest.stand
        return int(stand.species[tree]), int(stand.variant[tree])

    def _reach(self, tree: int) -> float:
        shape, response = self.shape(tree), self.response(tree)
        if shape is None or response is None:
            return 0.0
        most = np.abs(response.mean) + np.minimum(
            SIGMAS * response.spread(), np.abs(response.waves).sum(axis=1)
        )
        arm = float(np.abs(self.anchors(tree).arm).max(initial=0.0))
        ends = np.concatenate(shape.ends)
        far = np.linalg.norm(ends[:, :, :3], axis=2) + arm * np.linalg.norm(ends[:, :, 3:], axis=2)
        leaf = float(np.linalg.norm(self.anchors(tree).reach, axis=1).max(initial=0.0))
        scale = float(self._forest.stand.scale[tree])
        return float((far @ most).max()) + 2 * (TWIST + NOD) * leaf * scale

    def _moved(self, tree: np.ndarray, at: Anchors, time: np.ndarray, order: int) -> np.ndarray:
        found = np.zeros((len(tree), 3))
        for number, rows in _by_tree(tree):
            shape, response = self.shape(number), self.response(number)
            if shape is None or response is None:
                continue
            for first in range(0, len(rows), FEW):
                few = rows[first : first + FEW]
                found[few] = self._of_one(number, at.select(few), np.asarray(time)[few], order)
        return found

    def _of_one(self, tree: int, at: Anchors, time: np.ndarray, order: int) -> np.ndarray:
        shape, response = self.shape(tree), self.response(tree)
        assert shape is not None
        assert response is not None
        stand = self._forest.stand
        amplitude = response.amplitudes(time)[order]
        low, high = self._tables(self._key(tree))
        both = low[at.bone]
        both += at.along[:, None, None] * (high - low)[at.bone]
        six = np.einsum("nm,nmi->ni", amplitude, both)
        moved = six[:, :3] + np.cross(six[:, 3:], at.arm)
        leafy = np.flatnonzero(at.leaf >= 0)
        if len(leafy):
            moved[leafy] += self._fluttered(tree, at.select(leafy), time[leafy], order)
        cos, sin = np.cos(stand.rotation[tree]), np.sin(stand.rotation[tree])
        x, y, z = moved.T
        return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)

    def _tables(self, key: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        shape = self._shapes[key]
        assert shape is not None
        kept: dict[str, tuple[np.ndarray, np.ndarray]] = vars(shape)
        if "_tables" not in kept:
            kept["_tables"] = shape.ends
        return kept["_tables"]

    def _fluttered(self, tree: int, at: Anchors, time: np.ndarray, order: int) -> np.ndarray:
        """(N, 3) displacement or velocity of points of leaves about their feet, in the variant's axes."""
        if self._forest.species[self._key(tree)[0]].needles is not None:
            return np.zeros((len(at), 3))
        scale = float(self._forest.stand.scale[tree])
        return scale * np.cross(self._turns(tree, at.leaf, time)[order], at.reach)

    def _turns(
        self, tree: int, leaf: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) vectors that leaves turn by about their feet at times (N,), radians, and their rates."""
        shape, stand = self.shape(tree), self._forest.stand
        assert shape is not None
        seats = shape.seats
        tree_key = child_keys(self._first, np.array([tree]))
        key = child_keys(np.broadcast_to(tree_key, leaf.shape), leaf)
        wind = self.field.mean(float(stand.scale[tree]) * seats.foot[leaf, 2])
        along, normal = seats.axis[leaf], seats.normal[leaf]
        across = np.cross(along, normal)
        value, rate = (
            angle[:, :1] * along + angle[:, 1:] * across
            for angle in Flutter.of(key, wind).angles(time)
        )
        return value, rate

    @cached_property
    def _first(self) -> np.ndarray:
        return first_key(self._seed, "flutter")


def sway_of(
    forest: GrownForest, wind: Wind, seed: int, like: ForestSway | None = None
) -> ForestSway | None:
    """The motion of a forest in a scene's wind; None without wind or trees. like : see ``ForestSway``."""
    return ForestSway(forest, wind, seed, like) if wind.speed > 0 and len(forest.stand) else None


def _shape(tree: Tree, species: Species) -> SwayShape | None:
    if species.dead or not len(tree.skeleton) or tree.skeleton.radius.max() <= 0:
        return None
    if len(tree.skeleton) < 2:
        return None
    return shape_of(tree.skeleton, tree.leaves, wood_of_species(species))


def _still(count: int) -> Anchors:
    none = np.zeros(count, np.int32)
    return Anchors(
        none,
        np.zeros(count, np.float32),
        np.zeros((count, 3), np.float32),
        none - 1,
        np.zeros((count, 3), np.float32),
    )


def _by_tree(tree: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each tree with the rows that name it."""
    tree = np.asarray(tree)
    order = np.argsort(tree, kind="stable")
    found, first = np.unique(tree[order], return_index=True)
    yield from zip(found.tolist(), np.split(order, first[1:]), strict=True)
