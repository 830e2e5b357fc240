"""Undergrowth as plantings: what stands and lies between the trees of a measured stand.

Herbs, dwarf shrubs, shrubs, young trees of the stand's own species, litter, stumps and lying stems, by number
a hectare, of conifers and of broadleaves apart: the orders of magnitude of national forest inventories
(deadwood and regeneration) and of vegetation surveys, not of any one stand. A scene that plants one of these
species itself has its undergrowth by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..growth.measured.allometry import Kind, band
from ..spec import Distance, Normal, Planting, Scene, Species, Targets
from .plan import labels

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
    found = [
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
            found.append(Planting(species=name, density=density, variants=FEWEST, targets=young))
    return tuple(found)


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
