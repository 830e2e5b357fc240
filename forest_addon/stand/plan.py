"""The plan of a forest: which tree stands where, how large, which variant, turned how.

Every species has its own streams, keyed by its name, so adding a species moves no tree of another. Each
purpose (place, age, turn, size, variant) draws from its own stream in the order of the trees, so tree 7
is the same tree whether 10 or 10,000 are planted.

Hard cores: no two trees nearer than the distance of their pair.

Every tree has an age, a uniform mark. By **Matérn II** (Matérn 1960) a tree goes if an older one stands
too near, whether that one stays or not: every tree is judged alike. **Greedy** (Wahed et al.) keeps the
oldest first, so a tree goes only if an older one that stays is too near: more trees stay, and those that
do depend on each other over longer distances. Neither depends on the order of the trees.

The distance of a pair is that of its two kinds (rows of a matrix), or the sum of their crown radii where
that is larger. Time grows with the number of trees, whatever the distance.

Undergrowth as plantings: what stands and lies between the trees of a measured stand.

Herbs, dwarf shrubs, shrubs, young trees of the stand's own species, litter, stumps and lying stems, by number
a hectare, of conifers and of broadleaves apart: the orders of magnitude of national forest inventories
(deadwood and regeneration) and of vegetation surveys, not of any one stand. A scene that plants one of these
species itself has its undergrowth by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import scipy

from ..base.rng import stream, uniform_at
from ..base.rows import Drawn, blocks
from ..growth.measured.allometry import Kind, band
from ..spec import (
    CODES,
    Distance,
    Forest,
    Normal,
    Planting,
    Scene,
    SpecError,
    Species,
    Targets,
    quoted_with_hints,
)
from .compose import Inputs, TreeList, area_of, corners_of, masks_of, process_of
from .intensity.surface import GroundSurface, IntensityError
from .layouts import (
    MAX_POINTS,
    Integral,
    Process,
    is_cleared,
    orchard,
    sample,
    sample_clusters,
    sample_strauss,
    told_of,
)

MOST_DRAWN = 100_000_000  # trees of a planting whose columns are not kept
NOBODY = Integral(0.0)
OF_PLANTING = ("too_near", "off_ground", "off_field", "expected", "error")


@dataclass(frozen=True)
class Stand:
    """N trees of P plantings. In tiles, columns may be ``Drawn``; ``select`` makes arrays of them.

    position : (N, 3) metres, on the ground. rotation : (N,) radians about the vertical. scale : (N,).
    species : (N,) int64, number of the planting. variant : (N,) int64. id : (N,) int64, from 0.
    number : (N,) int64, of the tree among all that its planting has drawn; below 0: set by hand.
    sink : (N,) metres that a tree's foot goes below its position; known when its variant has grown.
    too_near : (P,) trees that spacing took away. off_ground : (P,) trees where there is no ground.
    off_field : (P,) trees of a list beyond the field.
    expected : (P,) ∫λ, or the number of places of a layout that draws none. error : (P,) of ∫λ.
    area : of the field, m².
    """

    position: np.ndarray
    rotation: np.ndarray
    scale: np.ndarray
    species: np.ndarray
    variant: np.ndarray
    id: np.ndarray
    number: np.ndarray
    sink: np.ndarray
    too_near: np.ndarray
    off_ground: np.ndarray
    off_field: np.ndarray
    expected: np.ndarray
    error: np.ndarray
    area: float

    def __len__(self) -> int:
        return len(self.id)

    @property
    def removed(self) -> int:
        """Trees that spacing took away."""
        return int(self.too_near.sum())

    def counts(self) -> np.ndarray:
        """(P,) trees of each planting."""
        counts = np.zeros(len(self.expected), dtype=np.int64)
        for rows in blocks(len(self)):
            counts += np.bincount(self.species[rows], minlength=len(counts))
        return counts

    def first(self, count: int) -> Stand:
        """The trees of the first so many plantings: a scene's own, without undergrowth."""
        kept = self.select(self.species < count)
        return replace(kept, **{name: getattr(self, name)[:count] for name in OF_PLANTING})

    def select(self, rows: np.ndarray | slice) -> Stand:
        """Trees by row or mask, as they are; figures of plantings stay those of all trees."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        whole = (*OF_PLANTING, "area")
        return Stand(**{k: v if k in whole else v[rows] for k, v in own.items()})

    def density(self) -> np.ndarray:
        """(P,) trees per square metre of the field."""
        return np.asarray(self.counts() / self.area)


def plan_stand(
    seed: int, forest: Forest, plantings: Sequence[Planting], inputs: Inputs | None = None
) -> Stand:
    """Place every species, set it on the ground, merge them, keep the spacing: ``plan_field`` as arrays.

    Raises
    ------
    IntensityError, SpecError : as ``plan_field``.
    """
    return plan_field(seed, forest, plantings, inputs, MAX_POINTS).select(slice(None))


def plan_field(
    seed: int,
    forest: Forest,
    plantings: Sequence[Planting],
    inputs: Inputs | None = None,
    most: int = MOST_DRAWN,
) -> Stand:
    """A stand whose columns are drawn when they are asked for, unless its trees depend on each other.

    most : trees that a planting may draw; of those that depend on each other ``MAX_POINTS``.

    Raises
    ------
    IntensityError : an intensity that cannot be used or scaled, or asks for too many trees; a list that
    cannot be used.
    SpecError : a distance between plantings that there are not.
    """
    inputs = inputs or Inputs()
    names = labels(plantings)
    distance = distances_of(forest, names)
    ground = inputs.ground(forest.terrain.base)
    alone = not (distance.any() or any(p.crown or p.by_hand or p.clearings for p in plantings))
    most = most if alone else MAX_POINTS
    tables = list[_Planted]()
    for number, planting in enumerate(plantings):
        tables.append(_plant(seed, number, names, plantings, forest, inputs, ground, most))
        tables.append(_by_hand(seed, names[number], planting, ground))
    first = np.cumsum([0, *(len(table.number) for table in tables), 0])
    count, by_draw, by_hand = int(first[-1]), tables[::2], tables[1::2]
    off_ground = [a.off_ground + b.off_ground for a, b in zip(by_draw, by_hand, strict=True)]
    of_plantings: dict[str, Any] = {
        "off_ground": np.array(off_ground, dtype=np.int64),
        "off_field": np.array([p.off_field for p in by_draw], dtype=np.int64),
        "expected": np.array([p.expected.value for p in by_draw]),
        "error": np.array([p.expected.error for p in by_draw]),
        "area": area_of(forest),
    }
    tables.append(
        _by_hand(seed, "", Planting(species="", expected=0), ground)
    )  # none, where nothing is planted

    def species_of(rows: np.ndarray) -> np.ndarray:
        return np.repeat(np.arange(len(tables)) // 2, np.diff(np.searchsorted(rows, first)))

    def column(name: str) -> Drawn:
        def make(rows: np.ndarray) -> np.ndarray:
            cut = np.searchsorted(rows, first)
            return np.concatenate(
                [
                    getattr(table, name)[rows[cut[k] : cut[k + 1]] - first[k]]
                    for k, table in enumerate(tables)
                ]
            )

        return Drawn(count, make)

    own = ("position", "rotation", "scale", "variant", "number")
    drawn: dict[str, Any] = {name: column(name) for name in own}
    if alone:
        drawn |= {"species": Drawn(count, species_of), "id": Drawn(count, lambda rows: rows)}
        return Stand(
            **drawn | {"sink": Drawn(count, lambda rows: np.zeros(len(rows)))},
            too_near=np.zeros(len(plantings), dtype=np.int64),
            **of_plantings,
        )
    whole = {name: values[:] for name, values in drawn.items()}
    species, cleared = species_of(np.arange(count)), column("cleared")[:]
    crown = np.array([p.crown for p in plantings], dtype=float)[species] * whole["scale"]
    by_chance, flat = whole["number"] >= 0, whole["position"][:, :2]
    keep = by_chance.copy()
    # Those in clearings take part: where one is taken away, none that it kept away moves up.
    rule = Spacing(distance, species[by_chance], crown[by_chance])
    mark = column("mark")[:][by_chance]
    keep[by_chance] = space(flat[by_chance], mark, rule, forest.spacing_rule)
    keep = (keep | ~by_chance) & apart_from(flat, ~by_chance, Spacing(distance, species, crown))
    gone = ~keep & ~cleared
    keep &= ~cleared
    return Stand(
        **{name: values[keep] for name, values in whole.items()},
        species=species[keep],
        id=np.arange(int(keep.sum())),
        sink=np.zeros(int(keep.sum())),
        too_near=np.bincount(species[gone], minlength=len(plantings)),
        **of_plantings,
    )


def labels(plantings: Sequence[Planting]) -> list[str]:
    """A name of its own for every planting: the species, numbered where one comes twice."""
    names: list[str] = []
    for planting in plantings:
        base = planting.species.replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")
        name, number = base, 1
        while name in names:
            number += 1
            name = f"{base}-{number}"
        names.append(name)
    return names


def distances_of(forest: Forest, names: Sequence[str]) -> np.ndarray:
    """(P, P) distances that trees of two plantings keep, metres.

    Raises
    ------
    SpecError : a distance between plantings that there are not.
    """
    matrix = np.full((max(1, len(names)),) * 2, forest.spacing)
    for number, pair in enumerate(forest.distances):
        for key in ("species", "other"):
            if getattr(pair, key) not in names:
                raise SpecError(
                    f"forest.distances[{number}].{key}",
                    f'"{getattr(pair, key)}" is not planted; use one of {", ".join(names)}',
                )
        a, b = names.index(pair.species), names.index(pair.other)
        matrix[a, b] = matrix[b, a] = pair.distance
    return matrix


@dataclass(frozen=True)
class _Planted:
    """Trees of one planting before spacing, drawn or set by hand, which are older than any other."""

    position: Drawn
    mark: Drawn
    rotation: Drawn
    scale: Drawn
    variant: Drawn
    number: Drawn
    cleared: Drawn
    expected: Integral = NOBODY
    off_ground: int = 0
    off_field: int = 0


def _plant(
    seed: int,
    number: int,
    names: Sequence[str],
    plantings: Sequence[Planting],
    forest: Forest,
    inputs: Inputs,
    ground: GroundSurface,
    most: int,
) -> _Planted:
    planting, label = plantings[number], names[number]
    low, high = planting.scale
    rng = stream(seed, "stand", label, "place")
    given = np.empty((0, 3))  # height, scale and rotation of trees of a list
    if planting.layout in ("poisson", "clusters", "strauss"):
        process = process_of(planting, forest, inputs)
        points, expected = draw_places(planting, process, rng, most), process.total
        on_field = np.ones(len(points), dtype=bool)
    else:
        if planting.layout == "rows":
            points = orchard(planting.rows, *corners_of(forest), rng)
        else:
            points, given = _listed(number, names, plantings, inputs)
        expected = Integral(float(len(points)))
        start, end = corners_of(forest)
        tidy = 1e-9 * float(np.max(end - start))  # a row on the very edge counts
        on_field = ((points >= start - tidy) & (points <= end + tidy)).all(axis=1)
        for mask in masks_of(planting, forest, inputs):
            on_field &= mask.at(points) > 0
    count = len(points)

    def draw(purpose: str, rows: np.ndarray) -> np.ndarray:
        return uniform_at(rows, seed, "stand", label, purpose)

    def told(column: int, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
        if not len(given):
            return values
        return np.where(np.isfinite(given[rows, column]), given[rows, column], values)

    def height(rows: Any) -> np.ndarray:
        return told(0, rows, ground.height(points[rows]))

    on_ground = np.empty(count, dtype=bool)
    for rows in blocks(count):
        on_ground[rows] = np.isfinite(height(rows))
    stands = on_field & on_ground
    numbers = None if stands.all() else np.flatnonzero(stands).astype(np.uint32)

    def column(make: Callable[[np.ndarray], np.ndarray]) -> Drawn:
        if numbers is None:
            return Drawn(count, make)
        return Drawn(len(numbers), lambda rows: make(numbers[rows].astype(np.int64)))

    return _Planted(
        position=column(lambda rows: np.column_stack([points[rows], height(rows)])),
        mark=column(lambda rows: draw("age", rows)),
        rotation=column(lambda rows: told(2, rows, 2 * np.pi * draw("turn", rows))),
        scale=column(lambda rows: told(1, rows, low * (high / low) ** draw("size", rows))),
        variant=column(lambda rows: (draw("variant", rows) * planting.variants).astype(np.int64)),
        number=column(lambda rows: rows),
        cleared=column(lambda rows: is_cleared(points[rows], planting.clearings)),
        expected=expected,
        off_ground=int((on_field & ~on_ground).sum()),
        off_field=int((~on_field).sum()),
    )


def _by_hand(seed: int, label: str, planting: Planting, ground: GroundSurface) -> _Planted:
    """The trees that were set by hand and have ground below them."""
    count = len(planting.by_hand)

    def draw(purpose: str) -> np.ndarray:
        return stream(seed, "stand", label, "hand", purpose).random(count)

    turn, size, variant = (
        told_of(planting, -1 - np.arange(count), name)
        for name in ("rotation_deg", "scale", "variant")
    )
    low, high = planting.scale
    kind = np.where(np.isfinite(variant), variant, np.floor(draw("variant") * planting.variants))
    place = np.array([tree.position for tree in planting.by_hand], dtype=float).reshape(-1, 2)
    height = ground.height(place)
    stands = np.isfinite(height)

    def column(values: np.ndarray) -> Drawn:
        return Drawn(int(stands.sum()), values[stands].__getitem__)

    return _Planted(
        position=column(np.column_stack([place, height])),
        mark=column(np.full(count, -1.0)),
        rotation=column(np.where(np.isfinite(turn), np.deg2rad(turn), 2 * np.pi * draw("turn"))),
        scale=column(np.where(np.isfinite(size), size, low * (high / low) ** draw("size"))),
        variant=column((kind % planting.variants).astype(np.int64)),
        number=column(-1 - np.arange(count)),
        cleared=column(np.zeros(count, dtype=bool)),
        off_ground=int((~stands).sum()),
    )


def draw_places(
    planting: Planting, process: Process, rng: np.random.Generator, most: int = MAX_POINTS
) -> np.ndarray:
    """Places (N, 2) of a random layout."""
    if planting.layout == "clusters":
        return sample_clusters(process, planting.clusters, rng)
    if planting.layout == "strauss":
        return sample_strauss(process, planting.strauss, rng)
    return sample(process, rng, round(process.expected) if planting.exact else None, most)


def _listed(
    number: int, names: Sequence[str], plantings: Sequence[Planting], inputs: Inputs
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) of a planting's list, and (N, 3) height, scale and rotation, NaN where not given."""
    planting = plantings[number]
    source = planting.trees or planting.collection
    listed = inputs.lists.get(source)
    if listed is None:
        raise IntensityError(
            f'{names[number]}: the list of trees "{source}" is not here; a collection needs Blender'
        )
    chosen = chosen_of(number, names, plantings, listed)
    given = np.full((len(chosen), 3), np.nan)
    if listed.position.shape[1] > 2:
        given[:, 0] = listed.position[chosen, 2]
    for column, values in ((1, listed.scale), (2, listed.rotation)):
        if values is not None:
            given[:, column] = values[chosen]
    return listed.position[chosen, :2], given


def chosen_of(
    number: int, names: Sequence[str], plantings: Sequence[Planting], listed: TreeList
) -> np.ndarray:
    """Trees (M,) of a list that are of a planting.

    Raises
    ------
    IntensityError : a tree of the list that cannot stand; a species that nobody plants.
    """
    planting = plantings[number]
    source = planting.trees or planting.collection
    bad = ~np.isfinite(listed.position).all(axis=1)
    if listed.scale is not None:
        bad |= listed.scale <= 0
    if bad.any():
        raise IntensityError(
            f"{source}: tree {int(np.argmax(bad)) + 1} has no finite position or no positive scale"
        )
    if listed.species is None:
        return np.arange(len(listed))
    every = [*dict.fromkeys([*names, *(p.species for p in plantings)])]
    unknown = sorted(set(listed.species) - set(every))
    if unknown:
        are = "is" if len(unknown) == 1 else "are"
        raise IntensityError(
            f"{source}: the species {quoted_with_hints(unknown, [*every, *CODES])} {are} not planted; use "
            f"one of {', '.join(every)}, or plant what is missing"
        )
    return np.flatnonzero(np.isin(np.array(listed.species), [names[number], planting.species]))


PORTION = 2_000_000  # pairs at once, about
FIRST_BATCH = 2048  # oldest trees that greedy spacing looks at together; every batch doubles


@dataclass(frozen=True)
class Spacing:
    """Spacing of trees.

    distance : (K, K) metres between kinds, symmetric.
    kind : (N,) int64, row of each tree. crown : (N,) radius of each tree's crown, metres; 0: no matter.
    """

    distance: np.ndarray
    kind: np.ndarray
    crown: np.ndarray

    def between(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(M,) distance that trees ``a`` and ``b`` (M,) keep."""
        crowns = np.where(
            (self.crown[a] > 0) & (self.crown[b] > 0), self.crown[a] + self.crown[b], 0
        )
        return np.maximum(self.distance[self.kind[a], self.kind[b]], crowns)

    def reach(self) -> float:
        """The largest distance that any two trees keep."""
        used = np.unique(self.kind)
        largest = self.distance[np.ix_(used, used)].max(initial=0.0)
        return float(max(largest, 2 * self.crown.max(initial=0.0)))


def space(
    points: np.ndarray,
    mark: np.ndarray,
    spacing: Spacing,
    rule: str,
) -> np.ndarray:
    """(N,) bool, which trees stay, by the rule ``matern`` or ``greedy``.

    points : (N, 2) metres. mark : (N,) ages, smaller is older; of two alike the first is older.
    """
    if spacing.reach() <= 0 or len(points) < 2:
        return np.ones(len(points), dtype=bool)
    age = np.empty(len(mark), dtype=np.int64)
    age[np.argsort(mark, kind="stable")] = np.arange(len(mark))
    return {"matern": matern_ii, "greedy": greedy}[rule](points, age, spacing)


def apart_from(points: np.ndarray, fixed: np.ndarray, spacing: Spacing) -> np.ndarray:
    """(N,) bool, which trees are fixed (N,), or have no fixed one too near."""
    apart, every = np.ones(len(points), dtype=bool), np.arange(len(points))
    if spacing.reach() > 0 and fixed.any():
        for tree, _ in _rivals(points, every, np.flatnonzero(fixed), ~fixed, spacing):
            apart[tree] = False
    return apart


def matern_ii(points: np.ndarray, age: np.ndarray, spacing: Spacing) -> np.ndarray:
    """(N,) bool, which trees stay: those with no older tree too near. age : (N,) ranks, 0 the oldest."""
    keep = _oldest_of_bins(points, age, spacing)
    judged = np.flatnonzero(keep)
    for tree, _ in _rivals(points, judged, np.arange(len(points)), age, spacing):
        keep[tree] = False
    return keep


def greedy(points: np.ndarray, age: np.ndarray, spacing: Spacing) -> np.ndarray:
    """(N,) bool, which trees stay: from the oldest on, those with no tree too near that stays.

    age : (N,) ranks, 0 the oldest.
    """
    by_age, keep = np.argsort(age), np.zeros(len(points), dtype=bool)
    kept, start = np.empty(0, dtype=np.int64), 0
    while start < len(points):
        batch = by_age[start : start + max(FIRST_BATCH, start)]
        start += len(batch)
        free = np.ones(len(points), dtype=bool)
        if len(kept):
            for tree, _ in _rivals(points, batch, kept, age, spacing):
                free[tree] = False
        stay = _settle(points, batch[free[batch]], age, spacing)
        keep[stay] = True
        kept = np.concatenate([kept, stay])
    return keep


def _settle(points: np.ndarray, trees: np.ndarray, age: np.ndarray, spacing: Spacing) -> np.ndarray:
    """The ``trees`` that stay by greedy removal among themselves, from old to young.

    In rounds: who has no older rival left stays, and the rivals of those that stay go.
    """
    if len(trees) < 2:
        return trees
    rank = np.empty(len(points), dtype=np.int64)
    rank[trees] = np.arange(len(trees))
    pairs = zip(*_rivals(points, trees, trees, age, spacing), strict=True)
    young, old = (rank[np.concatenate(side)] for side in pairs)
    undecided, stays = np.ones(len(trees), dtype=bool), np.zeros(len(trees), dtype=bool)
    while undecided.any():
        oldest = undecided.copy()
        oldest[young] = False
        stays |= oldest
        undecided &= ~oldest
        undecided[young[oldest[old]]] = False
        open_pairs = undecided[old] & undecided[young]
        old, young = old[open_pairs], young[open_pairs]
    return trees[stays]


def _rivals(
    points: np.ndarray, of: np.ndarray, among: np.ndarray, age: np.ndarray, spacing: Spacing
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Trees ``of`` (Q,), each with an older one ``among`` (M,) that is too near, in portions. age : (N,)."""
    tree, reach = scipy.spatial.cKDTree(points[among]), spacing.reach() * (1 + 1e-9)
    queries = points[of]
    some = queries[:: max(1, len(queries) // 1000)]
    most = tree.query_ball_point(some, reach, return_length=True).max(initial=0)
    portion = max(PORTION // int(most + 1), 1)
    for first in range(0, len(queries), portion):
        part = scipy.spatial.cKDTree(queries[first : first + portion])
        pairs = part.sparse_distance_matrix(tree, reach, output_type="ndarray")
        one, other = of[first + pairs["i"]], among[pairs["j"]]
        older = age[other] < age[one]
        one, other = one[older], other[older]
        near = np.hypot(*(points[one] - points[other]).T) < spacing.between(one, other)
        yield one[near], other[near]


def _oldest_of_bins(points: np.ndarray, age: np.ndarray, spacing: Spacing) -> np.ndarray:
    """(N,) bool, trees that are the oldest of their kind within a bin so small that all of a kind in it
    are too near each other. No other can stay, so however close they are there is little to judge.
    """
    oldest = np.ones(len(points), dtype=bool)
    low, span = points.min(axis=0), np.ptp(points, axis=0).max()
    for kind in np.unique(spacing.kind):
        of_kind = np.flatnonzero(spacing.kind == kind)
        side = max(spacing.distance[kind, kind], 2 * spacing.crown[of_kind].min()) / 1.5
        if side <= span * 1e-9:
            continue
        column, row = np.floor((points[of_kind] - low) / side).astype(np.int64).T
        home = row * (int(span / side) + 2) + column
        order = np.lexsort((age[of_kind], home))
        first = np.append(True, np.diff(home[order]) != 0)
        oldest[of_kind[order[~first]]] = False
    return oldest


HECTARE = 1e4  # m²
PLANTS = {  # species: number a hectare under conifers and under broadleaves, sparse and dense
    "bilberry": ((6000, 24000), (800, 3000)),
    "grass": ((5000, 12000), (5000, 14000)),
    "fern": ((150, 1500), (500, 3000)),
    "shrub": ((250, 1200), (350, 1500)),
    "litter": ((800, 2000), (1500, 4000)),
    "stump": ((120, 250), (80, 200)),
    "log": ((80, 250), (60, 200)),
}
LOW = ("bilberry", "grass", "fern", "litter")  # where a scanner may stand
YOUNG = (350, 1500)  # young trees a hectare, sparse and dense
VARIANTS = {"shrub": 6, "bilberry": 6, "stump": 4, "log": 6}
FEWEST = 4  # variants of others
YOUNGEST = (0.02, 0.03, 0.04, 0.05)  # m of diameter: the first with which all pass 1.3 m
SCALE = {"shrub": (0.6, 1.4), "log": (0.6, 1.5), "stump": (0.6, 1.4)}


def is_measured(species: Species) -> bool:
    """Tell whether trees of a species have the architecture and the measures of real ones."""
    return species.targets is not None and species.architecture is not None


def density_of(scene: Scene, species: Sequence[Species], looked_at: bool) -> str:
    """The undergrowth of a scene: as it says; on "auto" sparse where something looks at measured trees.

    species : of each planting. looked_at : whether a sensor meets leaves and wood one by one.
    """
    said = scene.forest.undergrowth
    if any(planting.species in PLANTS for planting in scene.plantings):
        return "none"  # by hand
    if said != "auto":
        return said
    return "sparse" if looked_at and any(map(is_measured, species)) else "none"


def undergrowth_of(
    scene: Scene, planted: Sequence[tuple[Species, object]], looked_at: bool
) -> tuple[Planting, ...]:
    """The plantings that clothe the ground of a scene; none where none are wanted.

    planted : species of each planting of the scene, and what it is grown from.
    """
    said = density_of(scene, [kind for kind, _ in planted], looked_at)
    if said == "none" or not planted:
        return ()
    column = ("sparse", "dense").index(said)
    trees = [row for row in range(len(planted)) if is_measured(planted[row][0])]
    needles = sum(planted[row][0].needles is not None for row in trees or range(len(planted)))
    kind = 0 if needles * 2 >= len(trees or planted) else 1
    plantings = [
        Planting(
            species=name,
            density=numbers[kind][column] / HECTARE,
            variants=VARIANTS.get(name, FEWEST),
            scale=SCALE.get(name, (0.7, 1.3)),
        )
        for name, numbers in PLANTS.items()
    ]
    own = dict.fromkeys(scene.plantings[row].species for row in trees)
    for name in own:
        row = next(row for row in trees if scene.plantings[row].species == name)
        young = _young(planted[row])
        if young is not None:
            density = YOUNG[column] / HECTARE / len(own)
            plantings.append(
                Planting(species=name, density=density, variants=FEWEST, targets=young)
            )
    return tuple(plantings)


def _young(planted: tuple[Species, object]) -> Targets | None:
    """Choose what young trees of a species measure; None where its law tells nothing of such small ones."""
    species, kind = planted
    law = kind.allometry if isinstance(kind, Kind) else None
    assert species.targets is not None
    if law is None:
        return None
    low = np.array(YOUNGEST)
    height = band(law, low)[0, :, 0]
    passed = np.flatnonzero(height > 1.3)
    if not len(passed):
        return None
    least = float(low[passed[0]])
    dbh = Normal(mean=1.4 * least, sd=0.5 * least, low=least, high=max(0.068, 1.1 * least))
    return Targets(allometry=species.targets.allometry, dbh=dbh)


def with_undergrowth(
    scene: Scene,
    planted: Sequence[tuple[Species, object]],
    looked_at: bool,
    load: Callable[[str], tuple[Species, object]],
) -> tuple[Scene, tuple[tuple[Species, object], ...]]:
    """The scene with the plantings of its undergrowth behind its own, and the species of all.

    load : a species by the name that a planting gives it.
    """
    more = undergrowth_of(scene, planted, looked_at)
    if not more:
        return scene, tuple(planted)
    known = {p.species: kind for p, kind in zip(scene.plantings, planted, strict=True)}
    plantings = (*scene.plantings, *more)
    names = labels(plantings)
    own = len(scene.plantings)
    apart = tuple(
        Distance(species=name, other=other, distance=0.0)
        for row, name in enumerate(names[own:], own)
        for other in names[: row + 1]
    )  # the distance that trees keep is not theirs
    forest = scene.forest.changed(
        undergrowth="none",
        distances=(*scene.forest.distances, *(apart if scene.forest.spacing else ())),
    )
    clothed = scene.changed(plantings=plantings, forest=forest)
    return clothed, (*planted, *(known.get(p.species) or load(p.species) for p in more))
