"""A forest as arrays: the stand, and one grown tree for every variant that stands in it.

Trees are kept as they grew, before leaves fell: another season of a forest grows none of them anew.

The truth of a forest that its sensors are held against: every tree, every branch, all area by cell.

Tables are in world coordinates. A tree's breast height is 1.3 m above the ground at its foot; its crown's
base has a fiftieth of the leaf area below it, and the crown's width is the mean of its extents from all sides
(``growth.likeness``).

Trees that stand as somebody put them: turned, leaned and stretched at will, with their truth.

The trees are kept as they were grown, at the origin; an affine transform M with linear part A puts each into
the world. A leaf of normal n and area s has there the normal A⁻ᵀn (normalised) and the area s |det A| |A⁻ᵀn|;
its axis is A times its axis. A stem that is stretched by v along the vertical and by h = √(|det A|/v)
across it has its diameter at breast height where it was 1.3/v m up, times h. Lengths, areas and volumes of
wood grow with v and h, (det A)^(2/3) and det A: exact for trees that are turned and scaled alike on
all axes, and volumes always.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..base.kept import LastAsked
from ..base.progress import Progress
from ..base.rng import stream
from ..base.rows import blocks, lengths
from ..base.trimesh import LEAF, is_wood
from ..base.vectors import azimuth_of
from ..growth.likeness import crown_base, crown_width
from ..growth.measured.allometry import BREAST, TARGETS, Kind, Wanted
from ..growth.mesh.blades import Blade
from ..growth.mesh.cells import CellAreas, areas_by_cell, join_areas
from ..growth.mesh.leaves import Leaves
from ..growth.own_tree.habit import Habit
from ..growth.own_tree.template import TreeTemplate
from ..growth.skeleton import Skeleton, diameter_at, equal_radius, find_axes
from ..growth.tree import Tree, aged, fallen, grow, in_season, with_fallen
from ..growth.truth import leaf_angles, tree_truth
from ..spec import Allometry, Choice, Look, Scene, Species
from ..spec.choices import idle, idle_in_scene, idle_in_species
from .compose import Inputs
from .intensity.surface import sink
from .measured import (
    COLUMNS,
    UNITS,
    MeasuredTrees,
    TargetsMet,
    dbh_at,
    found_in,
    in_band,
    listed_measures,
    not_met,
    reached,
    scales_for,
    targets_met,
    with_targets,
)
from .plan import Stand, labels, plan_field, plan_stand

MOST_KEPT = 1_000_000_000  # bytes
Key = tuple[Any, ...]
# Each with what it was made with, which its key tells it by.
TreesBefore = LastAsked[Key, tuple[Tree, object]]


def keep_trees() -> TreesBefore:
    """Trees by all that they grow from (``key_of``): those last asked for, ``MOST_KEPT`` bytes of them."""
    return LastAsked(MOST_KEPT, lambda kept: kept[0].nbytes)


def key_of(
    stream_of: tuple[Any, ...], species: Species, templates: object, wanted: Wanted | None
) -> Key:
    """All that a tree grows from; colours are not among it.

    stream_of : the seed and the words of its random stream.
    """
    # Templates are one object as long as they are the same; a leaf or an allometry is read anew each time.
    shared = isinstance(templates, TreeTemplate | Habit)
    made_of = id(templates) if shared else _content(templates)
    return (stream_of, repr(species.changed(look=Look())), made_of, wanted)


def _content(value: object) -> object:
    """Contents of a value, to compare by: equal for two readings of one file."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if is_dataclass(value):
        return type(value), *(_content(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, dict):
        return tuple((_content(key), _content(one)) for key, one in value.items())
    return tuple(_content(one) for one in value) if isinstance(value, list | tuple) else value


Planted = tuple[Species, TreeTemplate | Habit | Kind | Blade | None]  # and its templates
Grown = Callable[[int, int, Species], Tree]  # of a planting and variant, by numbers
MOST_OF = 0.5  # of the trees that are drawn; where fewer stand, it is said


@dataclass(frozen=True)
class GrownForest:
    """A stand and its trees.

    labels : a name for every planting. species : what each plants.
    variants : grown trees by (planting, variant).
    wanted : (N, 5) what trees were to measure, NaN where nothing was said; None where of none.
    laws : the allometry of each planting with targets. notes : sentences about what a list says in vain.
    chosen : what was left to the scene's sensors, and detail : sentences about it (``sensing/detail``).
    """

    stand: Stand
    labels: tuple[str, ...]
    species: tuple[Species, ...]
    variants: Mapping[tuple[int, int], Tree]
    wanted: np.ndarray | None = None
    laws: tuple[Allometry | None, ...] = ()
    notes: tuple[str, ...] = ()
    chosen: tuple[Choice, ...] = ()
    detail: tuple[str, ...] = ()

    @cached_property
    def truth(self) -> dict[tuple[int, int], dict[str, float]]:
        """Measures of each variant in its own size (``tree_truth``)."""
        return {key: tree_truth(tree) for key, tree in self.variants.items()}

    @property
    def keys(self) -> list[tuple[int, int]]:
        """The planting and variant of each tree."""
        stand = self.stand
        return list(zip(stand.species.tolist(), stand.variant.tolist(), strict=True))

    def variant_of(self, tree: int) -> Tree:
        """The grown tree that stands as tree number ``tree``."""
        return self.variants[int(self.stand.species[tree]), int(self.stand.variant[tree])]

    def heights(self) -> np.ndarray:
        """(N,) metres of every tree."""
        return np.array([self.variants[key].height for key in self.keys]) * self.stand.scale

    def transforms(self) -> np.ndarray:
        """(N, 3, 4) local to world of every tree: turned, scaled, moved, sunk."""
        stand = self.stand
        matrix = np.zeros((len(stand), 3, 4))
        cos, sin = np.cos(stand.rotation) * stand.scale, np.sin(stand.rotation) * stand.scale
        matrix[:, 0, 0], matrix[:, 0, 1] = cos, -sin
        matrix[:, 1, 0], matrix[:, 1, 1] = sin, cos
        matrix[:, 2, 2] = stand.scale
        matrix[:, :, 3] = stand.position
        matrix[:, 2, 3] -= stand.sink
        return matrix


@dataclass(frozen=True)
class ForestPlan:
    """Plan of a forest before anything has grown: places of trees, and which of them are to be grown.

    scene : its settings. species : what each planting plants, with its templates. inputs : rasters, lists
    and terrain. measured : the stand with its variants chosen, and what its trees are to measure.
    grown, kept : as ``of`` takes them.

    A variant's stream is keyed by the name of its planting and its number, so it is the same tree
    whatever else grows.
    """

    scene: Scene
    species: tuple[Planted, ...]
    inputs: Inputs
    measured: MeasuredTrees
    grown: Grown | None = None
    kept: TreesBefore | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        species: Sequence[Planted],
        inputs: Inputs | None = None,
        grown: Grown | None = None,
        kept: TreesBefore | None = None,
    ) -> ForestPlan:
        """Plan the stand of a scene.

        species : what each of ``scene.plantings`` plants, with its templates.
        grown : gives the tree of a planting and variant, by numbers, of a species, in place of growing it.
        kept : trees that grew before, which are taken where they are the same.

        Raises
        ------
        ValueError, SpecError : as ``plan_stand`` and ``with_targets``.
        """
        inputs = inputs or Inputs()
        species = [
            (in_season(aged(kind, planting.age), planting.season), template)
            for (kind, template), planting in zip(species, scene.plantings, strict=True)
        ]
        if scene.accuracy.relief:
            species = [  # a template's wood stays as it is
                (kind.changed(detail=kind.detail.changed(relief=True)), template)
                for kind, template in species
            ]
        targets = [*(p.targets for p in scene.plantings), *(kind.targets for kind, _ in species)]
        plan = plan_field if scene.tiles.size and not any(targets) else plan_stand
        stand = plan(scene.seed, scene.forest, scene.plantings, inputs)
        names = labels(scene.plantings)
        measured = with_targets(scene.seed, stand, scene.plantings, names, species, inputs)
        return cls(scene, tuple(species), inputs, measured, grown, kept)

    def tree(self, planting: int, variant: int, species: Species | None = None) -> Tree:
        """Grow a variant of a planting, by numbers; of a species in place of the planting's own."""
        own, templates = self.species[planting]
        species = species or own
        target = self.measured.variants.get((planting, variant))
        name = labels(self.scene.plantings)[planting]
        if self.grown and target is None:
            tree = self.grown(planting, variant, species)
        else:
            words = (self.scene.seed, "tree", name, variant)
            make = partial(grow, species, templates, wanted=target)
            if self.kept is None:
                tree = make(stream(*words))
            else:
                key = key_of(words, species, templates, target)
                tree, _ = self.kept.once(key, lambda: (make(stream(*words)), templates))
        share = fallen(self.scene.plantings[planting].season)
        return with_fallen(tree, share, stream(self.scene.seed, "tree", name, variant, "fall"))

    def grow(self, progress: Progress | None = None) -> GrownForest:
        """Grow the variants that occur in the stand and sink their feet into the ground."""
        stand = self.measured.stand
        wanted = keys_of(stand)
        variants: dict[tuple[int, int], Tree] = {}
        for done, key in enumerate(wanted):
            variants[key] = self.tree(*key)
            if progress:
                progress(done + 1, len(wanted))
        return GrownForest(
            stand=self.placed(variants),
            labels=tuple(labels(self.scene.plantings)),
            species=tuple(species for species, _ in self.species),
            variants=variants,
            wanted=self.measured.trees if self.measured.variants else None,
            laws=self.measured.laws,
            notes=self.notes(),
        )

    def notes(self) -> tuple[str, ...]:
        """Say what has no effect, and where fewer trees stand than were asked for: none, not all of an exact
        number or a list, or far fewer than were drawn."""
        stand, said = self.measured.stand, list(self.measured.ignored)
        names, counts = labels(self.scene.plantings), stand.counts()
        for number, (name, planting) in enumerate(zip(names, self.scene.plantings, strict=True)):
            said += [f"{name}: {sentence}" for sentence in idle(planting)]
            gone = [
                (stand.too_near, "nearer to others than spacing allows"),
                (stand.off_field, "outside of the field, or of where the planting may stand"),
                (stand.off_ground, "where there is no ground"),
            ]
            whys = [f"{lost[number]:,} are {why}" for lost, why in gone if lost[number]]
            drawn = counts[number] + sum(int(lost[number]) for lost, _ in gone)
            if whys and not (planting.exact or planting.layout == "list" or planting.by_hand):
                if counts[number] < MOST_OF * drawn:
                    said.append(
                        f"{name}: {counts[number]:,} of {drawn:,} trees stand; {', '.join(whys)}"
                    )
            elif whys:
                meant = "exactly so many" if planting.exact else "a list"
                meant = "those drawn and set by hand" if planting.by_hand else meant
                said.append(f"{name}: {counts[number]:,} trees of {meant} stand; {', '.join(whys)}")
        for species, _ in self.species:
            said += [f"{species.name}: {sentence}" for sentence in idle_in_species(species)]
        said += idle_in_scene(self.scene)
        if self.scene.plantings and not len(stand):
            said.append("no tree stands: expect more, or a larger field")
        return tuple(said)

    def placed(self, variants: Mapping[tuple[int, int], Tree]) -> Stand:
        """The stand with every tree in the size that it is to have, its foot in the ground."""
        stand, wanted = self.measured.stand, self.measured.trees
        many, code = codes_of(stand)
        scale, met = stand.scale.copy(), np.isfinite(wanted[:, 0])  # have a diameter to meet
        foot, meets = np.zeros(int(code.max(initial=-1)) + 1), bool(met.any())
        for (planting, variant), tree in variants.items():
            number = planting * many + variant
            if variant >= many or number >= len(foot):
                continue  # none of it stands
            foot[number] = tree.skeleton.radius[:1, 0].sum()
            grown_trees = np.flatnonzero(met & (code == number)) if meets else ()
            if len(grown_trees) and len(tree.skeleton):
                scale[grown_trees] = scales_for(tree.skeleton, wanted[grown_trees, 0])
        foot = foot[code] * scale
        ground = self.inputs.ground(self.scene.forest.terrain.base)
        return replace(stand, scale=scale, sink=sink(ground, stand.position[:, :2], foot))


def grow_forest(
    scene: Scene,
    species: Sequence[Planted],
    progress: Progress | None = None,
    inputs: Inputs | None = None,
) -> GrownForest:
    """Plan a stand and grow its trees in full; what sensors need of them is for ``site`` to decide."""
    return ForestPlan.of(scene, species, inputs).grow(progress)


def keys_of(stand: Stand) -> list[tuple[int, int]]:
    """(planting, variant) of all trees that stand, each once, in order."""
    return list(counts_of(stand))


def counts_of(stand: Stand) -> dict[tuple[int, int], int]:
    """Number of the trees of each (planting, variant) that stands, in order."""
    counts = Counter[tuple[int, int]]()
    for rows in blocks(len(stand)):
        many, code = codes_of(stand, rows)
        counts.update({divmod(k, many): n for k, n in enumerate(np.bincount(code).tolist()) if n})
    return dict(sorted(counts.items()))


def codes_of(stand: Stand, rows: slice = slice(None)) -> tuple[int, np.ndarray]:
    """A number of variants, and (N,) planting times that number plus variant of each tree."""
    variant = stand.variant[rows]
    many = int(variant.max(initial=0)) + 1
    return many, stand.species[rows] * many + variant


def leaf_table(forest: GrownForest) -> dict[str, np.ndarray]:
    """The truth of every leaf of the forest, in world coordinates, one row a leaf.

    ``tree`` and ``leaf`` are the numbers that sensors report; ``branch`` counts the first-level
    branches of the tree.
    """
    tables = []
    for tree, matrix in enumerate(forest.transforms()):
        leaves: Leaves = forest.variant_of(tree).leaves
        scale, count = float(forest.stand.scale[tree]), len(leaves)
        turn = matrix[:, :3] / scale
        tables.append(
            {
                "centre": leaves.centre @ matrix[:, :3].T + matrix[:, 3],
                "normal": leaves.normal @ turn.T,
                "axis": leaves.axis @ turn.T,
                **{n: getattr(leaves, n) * scale for n in ("length", "width", "radius")},
                "branch": leaves.branch,
                "leaf": np.arange(count, dtype=np.int32),
                "tree": np.full(count, forest.stand.id[tree], dtype=np.int32),
                "species": np.full(count, forest.stand.species[tree], dtype=np.int16),
            }
        )
    vectors, numbers = ("centre", "normal", "axis"), ("length", "width", "radius", "branch", "leaf")
    nothing: dict[str, np.ndarray] = {name: np.empty((0, 3)) for name in vectors}
    nothing |= {name: np.empty(0) for name in (*numbers, "tree", "species")}
    return stacked(tables) or nothing


def variant_leaf_table(forest: GrownForest) -> dict[str, np.ndarray]:
    """The truth of every leaf of every variant, in the space of its tree; ``species`` and ``variant`` say
    of which. With the places, turns and scales of the trees it is that of the whole forest.
    """
    grown = list(forest.variants.items())
    counts = [len(tree.leaves) for _, tree in grown]
    leaves = Leaves.joined([Leaves.none(), *(tree.leaves for _, tree in grown)])
    names = ("centre", "normal", "axis", "length", "width", "radius", "branch")
    columns = {name: getattr(leaves, name) for name in names}
    columns["leaf"] = np.concatenate([np.arange(count) for count in counts] or [np.empty(0, int)])
    for place, name in enumerate(("species", "variant")):
        columns[name] = np.repeat(np.array([key[place] for key, _ in grown], dtype=int), counts)
    return columns


def leaf_count(forest: GrownForest) -> int:
    """Number of leaves that all trees bear together."""
    of_variant = {key: len(tree.leaves) for key, tree in forest.variants.items()}
    return sum(of_variant[key] for key in forest.keys)


def angle_table(parts: Iterable[GrownForest]) -> dict[str, np.ndarray]:
    """Leaf-angle distribution of each planting, all its trees together: density per radian of the angle
    between leaf normal and vertical, by leaf area, in bins of equal width from 0 to 90°.

    parts : of one forest, which together are all of it.
    """
    weights: dict[str, np.ndarray] = {}
    variants: dict[tuple[int, int], Tree] = {}
    for part in parts:
        variants |= part.variants
        for planting, label in enumerate(part.labels):
            rows = np.flatnonzero(part.stand.species == planting)
            # Leaves count by area: all trees of a variant together weigh Σ scale².
            before = weights.get(label, np.zeros(0))
            which = np.append(np.arange(len(before)), part.stand.variant[rows])
            weights[label] = np.bincount(which, [*before, *part.stand.scale[rows] ** 2])
    columns: dict[str, np.ndarray] = {}
    for planting, (label, weight) in enumerate(weights.items()):
        used = np.flatnonzero(weight)
        grown = [variants[planting, int(variant)].leaves for variant in used]
        sizes = np.repeat(np.sqrt(weight[used]), [len(leaves) for leaves in grown])
        leaves = Leaves.joined([Leaves.none(), *grown])
        edges, density = leaf_angles(replace(leaves, radius=leaves.radius * sizes))
        columns |= {"from_deg": np.rad2deg(edges[:-1]), "to_deg": np.rad2deg(edges[1:])}
        columns[f"{label}_per_rad"] = density
    return columns


def tree_table(forest: GrownForest) -> dict[str, list[object]]:
    """One row a tree: place, turn, size, height, crown, trunk, leaves and wood, metres.

    Of trees that were to measure something also what: ``target_dbh_m`` and so on; ``in_band``, 1 where all
    of it is as measured trees have it; ``not_met``, the names of targets that are not reached.
    """
    stand, truth, keys = forest.stand, forest.truth, forest.keys
    dbh, foot = np.zeros((2, len(stand)))
    for (planting, variant), grown in forest.variants.items():
        same = (stand.species == planting) & (stand.variant == variant)
        dbh[same] = dbh_at(grown.skeleton, stand.scale[same])
        foot[same] = float(grown.skeleton.radius[:1, 0].sum()) * stand.scale[same]

    table: dict[str, list[object]] = {
        "tree": stand.id.tolist(),
        "species": [forest.species[planting].name for planting, _ in keys],
        "planting": [forest.labels[planting] for planting, _ in keys],
        "variant": stand.variant.tolist(),
        **{f"{axis}_m": stand.position[:, k].tolist() for k, axis in enumerate("xyz")},
        "rotation_rad": stand.rotation.tolist(),
        "scale": list(stand.scale.tolist()),
    }
    factor = {name: stand.scale**power for name, power in POWERS.items()}
    told = [truth[key] for key in keys]
    own = {"dbh_m": dbh.tolist(), "foot_radius_m": foot.tolist()}
    table |= _measures(told, factor, own | {"leaves": [int(row["leaves"]) for row in told]})
    if forest.wanted is not None:
        for column, name in enumerate(TARGETS):
            values = forest.wanted[:, column].tolist()
            table[f"target_{COLUMNS[name]}"] = ["" if np.isnan(v) else v for v in values]
        measured = found_in(table)
        band = np.full(len(measured), "", dtype=object)
        for planting, law in enumerate(forest.laws):
            rows = np.flatnonzero(stand.species == planting)
            if law is not None:
                band[rows] = in_band(law, measured[rows]).all(axis=1).astype(int)
        table["in_band"] = band.tolist()
        table["not_met"] = list(not_met(forest.wanted, measured))
    return table


POWERS = {  # of a tree's scale, with which measures go
    **dict.fromkeys(("height_m", "crown_width_m", "crown_base_m"), 1),
    **dict.fromkeys(("leaf_area_m2", "wood_area_m2", "projected_wood_m2"), 2),
    "wood_volume_m3": 3,
}
MEASURED = (  # columns, in this order
    *("height_m", "dbh_m", "crown_width_m", "crown_base_m", "foot_radius_m"),
    *("leaves", "leaf_area_m2", "wood_volume_m3", "wood_area_m2", "projected_wood_m2"),
)


def _measures(
    truth: Sequence[Mapping[str, float]], factor: Mapping[str, np.ndarray], own: dict[str, list]
) -> dict[str, list[object]]:
    """Columns of what N trees measure: their own, and those of ``tree_truth`` by factors (N,)."""
    for name, by in factor.items():
        values = np.array([row.get(name, np.nan) for row in truth], dtype=float)
        own = {name: (values * by).tolist(), **own}
    return {name: own[name] for name in MEASURED}


def met_targets(forest: GrownForest) -> list[TargetsMet]:
    """Counts for each planting with targets: wanted, reached, in the measured band, and what could not be."""
    if forest.wanted is None:
        return []
    missed = [forest.variant_of(row).missed for row in range(len(forest.stand))]
    stand = forest.stand
    return targets_met(
        tree_table(forest), stand.species, forest.labels, forest.wanted, forest.laws, missed
    )


def missed_measures(forest: GrownForest, scene: Scene, inputs: Inputs) -> Iterator[str]:
    """Sentences on trees of lists that do not measure what their list gives."""
    stand, names, plantings = forest.stand, forest.labels, scene.plantings
    for number in range(len(plantings)):
        listed = listed_measures(number, names, plantings, inputs)
        if forest.wanted is None or not len(listed):
            continue
        rows = np.flatnonzero((stand.species == number) & (stand.number >= 0))
        told, found = listed[stand.number[rows]], found_in(tree_table(forest))[rows]
        off = np.where(
            np.isnan(forest.wanted[rows]) | reached(told, found),  # without targets, or met
            0.0,
            np.nan_to_num(np.abs(found / told - 1)),
        )
        if off.any():
            worst, column = divmod(int(off.argmax()), len(TARGETS))
            yield (
                f"{names[number]}: {off.any(axis=1).sum():,} of the {len(rows):,} trees of its list do not "
                f"meet their measures, at worst a {TARGETS[column]} of {found[worst, column]:.3g} in place "
                f"of {told[worst, column]:.3g} {UNITS[TARGETS[column]]}; trees.csv says which (not_met), "
                "more variants come nearer"
            )


def stacked(tables: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Tables of the same columns, one below the other; no columns of none."""
    names = tables[0] if tables else ()
    return {name: np.concatenate([table[name] for table in tables]) for name in names}


PARTS = ("leaf", "wood")  # columns of the areas by cell


def inventory(forest: GrownForest) -> dict[str, list[object]]:
    """One row a tree: what ``tree_table`` says, and what a forester measures on it, metres."""
    table = tree_table(forest)
    grown = forest.variants.items()
    base = {key: crown_base(tree.skeleton, tree.leaves, tree.height) for key, tree in grown}
    width = {key: crown_width(tree.skeleton, tree.leaves) for key, tree in grown}
    stand, keys = forest.stand, forest.keys
    rows = list(zip(keys, stand.sink.tolist(), stand.scale.tolist(), strict=True))
    more: dict[str, list[object]] = {
        "dbh_m": [
            diameter_at(forest.variants[key].skeleton, (BREAST + deep) / size) * size
            for key, deep, size in rows
        ],
        "crown_base_m": [base[key] * size - deep for key, deep, size in rows],
        "crown_width_m": [width[key] * size for key, _, size in rows],
        "all_branches": [int(not forest.variants[key].grafted) for key in keys],
    }
    height = [
        forest.variants[key].height * size - deep for key, deep, size in rows
    ]  # above the ground
    return table | {"height_m": height} | more


def cylinder_table(forest: GrownForest) -> dict[str, np.ndarray]:
    """One row a branch segment of every tree, columns as aRchi and rTwig name those of a TreeQSM model.

    Cylinders are counted from 1 within their tree; a parent or an extension of 0 is none. Of trees that are
    grafted from templates, trunk and first-level branches only (``all_branches`` of the inventory is 0).
    """
    tables = []
    tied = {key: _tied(tree.skeleton) for key, tree in forest.variants.items()}
    stand = forest.stand
    for number, (key, matrix) in enumerate(zip(forest.keys, forest.transforms(), strict=True)):
        wood, size = forest.variants[key].skeleton, float(stand.scale[number])
        start, end = (ends @ matrix[:, :3].T + matrix[:, 3] for ends in (wood.start, wood.end))
        length, radius = wood.length * size, equal_radius(wood.radius) * size
        tables.append(
            cylinder_columns(
                int(stand.id[number]), tied[key], (start, end), wood.radius * size, radius, length
            )
        )
    return stacked(tables)


def areas_of_trees(forest: GrownForest, edge: float) -> Iterator[CellAreas]:
    """Areas of leaf (one side) and wood in the cells of a grid, m², tree after tree."""
    variants = {key: _faces(tree) for key, tree in forest.variants.items()}
    sizes = forest.stand.scale.tolist()
    for key, matrix, size in zip(forest.keys, forest.transforms(), sizes, strict=True):
        columns, triangles, wood, area = variants[key]
        place = matrix[:, :3] @ columns
        place += matrix[:, 3:]
        yield areas_by_cell(place.T, triangles, wood, len(PARTS), edge, area * size**2)


def _faces(tree: Tree) -> tuple[np.ndarray, ...]:
    """Vertices (3, V), and of triangles of leaves and wood: corners, which of ``PARTS``, m² in the tree's own
    size.
    """
    mesh, part = tree.mesh, tree.mesh.part
    ours = (part == LEAF) | is_wood(part)
    mesh = mesh if ours.all() else mesh.select(ours)
    columns, triangles = np.ascontiguousarray(mesh.vertices.T), np.asfortranarray(mesh.triangles)
    wood, area = is_wood(mesh.part).astype(np.int64), lengths(mesh.area_vectors())
    return columns, triangles, wood, area


def voxel_arrays(forest: GrownForest, edge: float) -> dict[str, np.ndarray]:
    """Densities of leaf and wood area in cubic cells, m²/m³, and which trees are in each.

    ``cell`` (K, 3) int32 times ``edge`` is a cell's lowest corner. ``tree_cell`` and ``tree`` (M,) are
    pairs: in which of the K cells is which tree.
    """
    of_trees = list(areas_of_trees(forest, edge))
    whole = join_areas(of_trees, len(PARTS))
    low = whole.cell.min(axis=0, initial=0)
    size = tuple((whole.cell.max(axis=0, initial=0) - low + 1).tolist())

    def key(cell: np.ndarray) -> np.ndarray:
        return np.asarray(np.ravel_multi_index(tuple((cell - low).T), size))

    order, keys = np.argsort(key(whole.cell)), np.sort(key(whole.cell))
    cells = [order[np.searchsorted(keys, key(one.cell))] for one in of_trees]
    trees = [np.full(len(c), t, np.int32) for c, t in zip(cells, forest.stand.id, strict=True)]
    none = np.empty(0, np.int32)
    return {
        "edge": np.array(edge),
        "cell": whole.cell.astype(np.int32),
        **{f"{name}_area_density": whole.area[:, k] / edge**3 for k, name in enumerate(PARTS)},
        "tree_cell": np.concatenate([*cells, none]).astype(np.int32),
        "tree": np.concatenate([*trees, none]),
    }


@dataclass(frozen=True)
class PlacedVariant:
    """A tree as it was grown, without its mesh.

    name : of the asset. truth : by name and unit, as ``growth.truth.tree_truth`` says it.
    grafted : whether its skeleton holds trunk and first-level branches only.
    """

    name: str
    species: str
    skeleton: Skeleton
    leaves: Leaves
    truth: Mapping[str, float]
    grafted: bool = False


@dataclass(frozen=True)
class PlacedTrees:
    """N trees in the world.

    grown : of each kind. index : (N,) which of them. transform : (N, 3, 4) local to world.
    tree, species : (N,) numbers that sensors report. object_name : (N) whom each belongs to.
    """

    grown: tuple[PlacedVariant, ...]
    index: np.ndarray
    transform: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    object_name: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.index)

    def row_of(self, tree: int) -> int | None:
        """Row of the tree of this number."""
        rows = np.flatnonzero(self.tree == tree)
        return int(rows[0]) if len(rows) else None


NOBODY = np.empty(0, np.int64)
NONE = PlacedTrees((), NOBODY, np.empty((0, 3, 4)), NOBODY, NOBODY, ())


def placed_table(trees: PlacedTrees) -> dict[str, list[object]]:
    """One row a tree, the columns of ``tree_table``; ``planting`` is the object's name."""
    linear = trees.transform[:, :, :3]
    volume = np.abs(np.linalg.det(linear)) if len(trees) else np.empty(0)
    along = np.linalg.norm(linear[:, :, 2], axis=1)
    across = np.sqrt(volume / np.maximum(along, 1e-300))
    rows = [trees.grown[k] for k in trees.index.tolist()]

    sizes = zip(rows, along[:, None], across[:, None], strict=True)
    dbh = np.array([float(dbh_at(row.skeleton, *size)[0]) for row, *size in sizes])
    foot = np.array([float(row.skeleton.radius[:1, 0].sum()) for row in rows])
    area = [
        float(np.pi * (_leaves_in(row.leaves, m)["radius"] ** 2).sum())
        for row, m in zip(rows, trees.transform, strict=True)
    ]
    factor = {
        **dict.fromkeys(("height_m", "crown_base_m"), along),
        **dict.fromkeys(("wood_area_m2", "projected_wood_m2"), np.cbrt(volume) ** 2),
        "wood_volume_m3": volume,
        "crown_width_m": across,
    }
    table: dict[str, list[object]] = {
        "tree": trees.tree.tolist(),
        "species": [row.species for row in rows],
        "planting": list(trees.object_name),
        "variant": trees.index.tolist(),
        **{f"{axis}_m": trees.transform[:, k, 3].tolist() for k, axis in enumerate("xyz")},
        "rotation_rad": azimuth_of(linear[:, :, 0]).tolist(),
        "scale": np.cbrt(volume).tolist(),
    }
    own = {"dbh_m": dbh.tolist(), "foot_radius_m": (foot * across).tolist(), "leaf_area_m2": area}
    own |= {"leaves": [len(row.leaves) for row in rows]}
    return table | _measures([row.truth for row in rows], factor, own)


def placed_leaves(trees: PlacedTrees) -> dict[str, np.ndarray]:
    """Every leaf in the world, the columns of ``leaf_table``."""
    tables = []
    for row, (index, matrix) in enumerate(zip(trees.index.tolist(), trees.transform, strict=True)):
        leaves = trees.grown[index].leaves
        count = len(leaves)
        own = {
            **_leaves_in(leaves, matrix),
            "branch": leaves.branch,
            "leaf": np.arange(count, dtype=np.int32),
            "tree": np.full(count, trees.tree[row], dtype=np.int32),
            "species": np.full(count, trees.species[row], dtype=np.int16),
        }
        tables.append(own)
    return stacked(tables)


def placed_skeleton(grown: PlacedVariant, matrix: np.ndarray) -> dict[str, np.ndarray]:
    """The segments of a tree in the world, as ``api.World.skeleton`` gives them; radii grow with √(area)
    across each segment: (|det A| / |A u|)^½ for a segment along u.
    """
    wood, linear = grown.skeleton, matrix[:, :3]
    way = wood.end - wood.start
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-300)
    stretch = np.linalg.norm(way @ linear.T, axis=1) / length
    wide = np.sqrt(abs(np.linalg.det(linear)) / np.maximum(stretch, 1e-300))
    return {
        "start": wood.start @ linear.T + matrix[:, 3],
        "end": wood.end @ linear.T + matrix[:, 3],
        "radius": wood.radius * wide[:, None],
        "parent": wood.parent,
        "order": wood.order,
        "generation": wood.generation,
        "dead": wood.is_dead,
    }


def _leaves_in(leaves: Leaves, matrix: np.ndarray) -> dict[str, np.ndarray]:
    """Place and size of leaves through a transform (3, 4)."""
    linear = matrix[:, :3]
    volume = float(np.linalg.det(linear))
    cofactor = volume * np.linalg.inv(linear).T if volume else np.zeros((3, 3))
    area = leaves.normal @ cofactor.T  # of a unit area of the leaf, as a vector
    grows = np.linalg.norm(area, axis=1)
    axis = leaves.axis @ linear.T
    long = np.linalg.norm(axis, axis=1)
    return {
        "centre": leaves.centre @ linear.T + matrix[:, 3],
        "normal": area / np.maximum(grows, 1e-300)[:, None] * (1.0 if volume >= 0 else -1.0),
        "axis": axis / np.maximum(long, 1e-300)[:, None],
        "length": leaves.length * long,
        "width": leaves.width * grows / np.maximum(long, 1e-300),
        "radius": leaves.radius * np.sqrt(grows),
    }


def placed_cylinders(trees: PlacedTrees) -> dict[str, np.ndarray]:
    """One row a branch segment of every tree, the columns of ``cylinder_table``."""
    tables = []
    for row, (index, matrix) in enumerate(zip(trees.index.tolist(), trees.transform, strict=True)):
        grown = trees.grown[index]
        own, world = _tied(grown.skeleton), placed_skeleton(grown, matrix)
        ends, radii = (world["start"], world["end"]), world["radius"]
        length = np.linalg.norm(ends[1] - ends[0], axis=1)
        tables.append(
            cylinder_columns(int(trees.tree[row]), own, ends, radii, equal_radius(radii), length)
        )
    return stacked(tables)


def _tied(skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Columns (S,) that say how the cylinders of a tree hang together, counted from 1; 0 is none."""
    axes = find_axes(skeleton)
    return {
        "cyl_ID": np.arange(1, len(skeleton) + 1),
        "parent_ID": skeleton.parent + 1,
        "extension_ID": axes.onward + 1,
        "axis_ID": axes.of_segment + 1,
        "branching_order": skeleton.order,
    }


def cylinder_columns(
    tree: int,
    own: dict[str, np.ndarray],
    ends: tuple[np.ndarray, np.ndarray],
    radii: np.ndarray,
    radius: np.ndarray,
    length: np.ndarray,
) -> dict[str, np.ndarray]:
    """Columns (S,) of the cylinders of a tree in the world, by the names of ``cylinder_table``.

    own : as ``_tied`` tells. ends : (S, 3) each, m. radii : (S, 2) at both ends, and radius (S,) of equal
    volume, m. length : (S,) m.
    """
    return {
        "tree": np.full(len(length), tree),
        **own,
        **{f"start{axis}": ends[0][:, k] for k, axis in enumerate("XYZ")},
        **{f"end{axis}": ends[1][:, k] for k, axis in enumerate("XYZ")},
        "radius_cyl": radius,
        "radius_start": radii[:, 0],
        "radius_end": radii[:, 1],
        "length": length,
        "volume": np.pi * radius**2 * length,
    }
