"""A forest as arrays: the stand, and one grown tree for every variant that stands in it.

Trees are kept as they grew, before leaves fell: another season of a forest grows none of them anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..base.progress import Progress
from ..base.rng import stream
from ..growth.measured.allometry import TARGETS, Kind, Wanted
from ..growth.mesh.blades import Blade
from ..growth.mesh.leaves import Leaves
from ..growth.own_tree.habit import Habit
from ..growth.own_tree.template import TreeTemplate
from ..growth.tree import Tree, aged, fallen, grow, in_season, with_fallen
from ..growth.truth import leaf_angles, tree_truth
from ..spec import Allometry, Choice, Look, Scene, Species
from ..spec.choices import idle, idle_in_scene, idle_in_species
from .compose import Inputs
from .intensity.surface import sink
from .measured import (
    MeasuredTrees,
    TargetsMet,
    dbh_at,
    found_in,
    in_band,
    not_met,
    scales_for,
    targets_met,
    with_targets,
)
from .plan import Stand, labels, plan_stand

MOST_KEPT = 500_000_000  # bytes
Key = tuple[Any, ...]


class TreesBeforeFall:
    """Trees of the forest that grew last, by all that they grew from, ``MOST_KEPT`` bytes of them."""

    def __init__(self) -> None:
        self._trees: dict[Key, tuple[Tree, object]] = {}
        self._asked: set[Key] = set()
        self._bytes = 0

    def tree(self, key: Key, templates: object, make: Callable[[], Tree]) -> Tree:
        """Return the tree of a key (``key_of``), made where it is not kept.

        templates : what the key was made with; they live as long as the tree.
        """
        self._asked.add(key)
        if key in self._trees:
            return self._trees[key][0]
        tree = make()
        if self._bytes + tree.nbytes <= MOST_KEPT:
            self._trees[key] = tree, templates
            self._bytes += tree.nbytes
        return tree

    def forget_others(self) -> None:
        """Forget trees that nobody asked for since this was called last."""
        self._trees = {key: kept for key, kept in self._trees.items() if key in self._asked}
        self._bytes = sum(tree.nbytes for tree, _ in self._trees.values())
        self._asked = set()


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
    """Return what a value says, to compare by: equal for two readings of one file."""
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
        own = {key: tree.height for key, tree in self.variants.items()}
        return np.array([own[key] for key in self.keys]) * self.stand.scale

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
    kept: TreesBeforeFall | None = None

    @classmethod
    def of(
        cls,
        scene: Scene,
        species: Sequence[Planted],
        inputs: Inputs | None = None,
        grown: Grown | None = None,
        kept: TreesBeforeFall | None = None,
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
        stand = plan_stand(scene.seed, scene.forest, scene.plantings, inputs)
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
                tree = self.kept.tree(key, templates, lambda: make(stream(*words)))
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
        scale, foot = stand.scale.copy(), np.zeros(len(stand))
        for (planting, variant), tree in variants.items():
            mine = (stand.species == planting) & (stand.variant == variant)
            met = mine & np.isfinite(wanted[:, 0])  # those that have a diameter to meet
            if met.any() and len(tree.skeleton):
                scale[met] = scales_for(tree.skeleton, wanted[met, 0])
            foot[mine] = float(tree.skeleton.radius[:1, 0].sum()) * scale[mine]
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
    return sorted({(int(s), int(v)) for s, v in zip(stand.species, stand.variant, strict=True)})


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
    """Return how many leaves all trees bear together."""
    of_variant = {key: len(tree.leaves) for key, tree in forest.variants.items()}
    return sum(of_variant[key] for key in forest.keys)


def angle_table(forest: GrownForest) -> dict[str, np.ndarray]:
    """Leaf-angle distribution of each planting, all its trees together: density per radian of the angle
    between leaf normal and vertical, by leaf area, in bins of equal width from 0 to 90°.
    """
    stand = forest.stand
    columns: dict[str, np.ndarray] = {}
    for planting, label in enumerate(forest.labels):
        rows = np.flatnonzero(stand.species == planting)
        used, which = np.unique(stand.variant[rows], return_inverse=True)
        grown = [forest.variants[planting, int(variant)].leaves for variant in used]
        # Leaves count by area: all trees of a variant together weigh Σ scale².
        weight = np.bincount(which, stand.scale[rows] ** 2, minlength=len(used))
        sizes = np.repeat(np.sqrt(weight), [len(leaves) for leaves in grown])
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
        mine = (stand.species == planting) & (stand.variant == variant)
        dbh[mine] = dbh_at(grown.skeleton, stand.scale[mine])
        foot[mine] = float(grown.skeleton.radius[:1, 0].sum()) * stand.scale[mine]

    def scaled(name: str, power: int) -> dict[str, list[object]]:
        values = np.array([truth[key][name] for key in keys], dtype=float)
        return {name: list((values * stand.scale**power).tolist())}

    table: dict[str, list[object]] = {
        "tree": stand.id.tolist(),
        "species": [forest.species[planting].name for planting, _ in keys],
        "planting": [forest.labels[planting] for planting, _ in keys],
        "variant": stand.variant.tolist(),
        **{f"{axis}_m": stand.position[:, k].tolist() for k, axis in enumerate("xyz")},
        "rotation_rad": stand.rotation.tolist(),
        "scale": list(stand.scale.tolist()),
        **scaled("height_m", 1),
        "dbh_m": list(dbh.tolist()),
        **scaled("crown_width_m", 1),
        **scaled("crown_base_m", 1),
        "foot_radius_m": list(foot.tolist()),
        "leaves": [int(truth[key]["leaves"]) for key in keys],
        **scaled("leaf_area_m2", 2),
        **scaled("wood_volume_m3", 3),
        **scaled("wood_area_m2", 2),
        **scaled("projected_wood_m2", 2),
    }
    if forest.wanted is not None:
        for column, name in enumerate(TARGETS):
            unit = "m2" if name == "leaf_area" else "m"
            values = forest.wanted[:, column]
            table[f"target_{name}_{unit}"] = ["" if np.isnan(v) else float(v) for v in values]
        found = found_in(table)
        table["in_band"] = _in_band(forest, found)
        table["not_met"] = list(not_met(forest.wanted, found))
    return table


def _in_band(forest: GrownForest, found: np.ndarray) -> list[object]:
    """One value a tree: 1 where all that it measures is as measured trees are, 0 where not, or empty."""
    told: list[object] = [""] * len(found)
    for planting, law in enumerate(forest.laws):
        rows = np.flatnonzero(forest.stand.species == planting) if law is not None else ()
        if law is not None and len(rows):
            inside = in_band(law, found[rows]).all(axis=1)
            for row, value in zip(rows, inside.tolist(), strict=True):
                told[row] = int(value)
    return told


def met_targets(forest: GrownForest) -> list[TargetsMet]:
    """Counts for each planting with targets: wanted, reached, in the measured band, and what could not be."""
    if forest.wanted is None:
        return []
    missed = [forest.variant_of(row).missed for row in range(len(forest.stand))]
    stand = forest.stand
    return targets_met(
        tree_table(forest), stand.species, forest.labels, forest.wanted, forest.laws, missed
    )


def stacked(tables: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Tables of the same columns, one below the other; no columns of none."""
    names = tables[0] if tables else ()
    return {name: np.concatenate([table[name] for table in tables]) for name in names}
