"""The 42 orchards of Méndez et al.'s experiment, as far as the paper says what they are, and as scenes of
ours.

Four numbers of iterations, three diameters d_m, one or four trees, pruned or not, stochastic or not make 96
orchards; which 42 of them S built is not said. Ours change one thing at a time. One stochastic, pruned
tree is the base, and four of them in a row; both at all iterations, which are the eight rows of Méndez et
al.'s Table 3. Then one tree that is not pruned and one that is not stochastic, from 5 iterations on,
because at 4 pruning takes hardly anything. 14 structures, three diameters each.

Two lengths are not given either. The first internode h0 makes crowns as wide as Méndez et al.'s scans are
long: its numbers of beams are all multiples of 601, so a scan has 601 beams (150° by 0.25°) and the drives
past one tree are 1.68 to 1.93 m long. Trees stand 2.1 m apart, which gives the drives past four.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.species import skeleton_of
from forest_addon.growth.tree import grow
from forest_addon.spec import Detail, Scene, Species, Tractor
from forest_addon.spec import Forest as Field
from forest_addon.stand.forest import GrownForest
from forest_addon.stand.plan import Stand

DIAMETERS = (0.005, 0.006, 0.007)  # d_m
ITERATIONS = (4, 5, 6, 7)
DRIVES = (
    930,
    935,
    840,
    965,
)  # scans past one tree: Méndez et al.'s beams by 601, of which all are multiples
STEP, ANGLE_STEP_DEG = 0.002, 0.25
HALF_FAN_DEG = 75.0  # 601 beams of 0.25° are 150°; ours lie about the horizontal
SCANNER = (1.0, 1.0)  # x0 and z0 of S
ROW = 2.5  # x of the trees
SPACING = 2.1
CALIBRATED_ON = 12  # trees for each number of iterations
TOLERANCE = 0.0002  # metres between a branch and its mesh


@dataclass(frozen=True)
class Orchard:
    """One orchard: what its trees are and how many stand in it."""

    iterations: int
    trees: int
    smallest: float  # d_m, metres
    pruned: bool = True
    stochastic: bool = True

    @property
    def in_table_3(self) -> bool:
        """Return whether it has a row in Méndez et al.'s Table 3, by iterations and number of trees."""
        return self.pruned and self.stochastic


def experiment(quick: bool = False) -> list[Orchard]:
    """All orchards, the smallest first; ``quick``: only those of 4 and 5 iterations."""
    iterations = ITERATIONS[:2] if quick else ITERATIONS
    return [
        orchard
        for n in iterations
        for smallest in DIAMETERS
        for orchard in (
            Orchard(n, 1, smallest),
            Orchard(n, 4, smallest),
            *([Orchard(n, 1, smallest, pruned=False)] if n > 4 else []),
            *([Orchard(n, 1, smallest, stochastic=False)] if n > 4 else []),
        )
    ]


@cache
def first_internode() -> float:
    """h0 in metres, to the millimetre, at which crowns are as wide as Méndez et al.'s drives past one tree
    are long.

    The width of a crown grows with h0. It is the mean extent along x and y of stochastic, pruned trees,
    which are always the same: h0 depends on no seed.
    """
    widths = []
    for n in ITERATIONS:
        species = species_of(Orchard(n, 1, 0.006), 1.0)
        for tree in range(CALIBRATED_ON):
            skeleton, _ = skeleton_of(species, stream(0, "simlidar", "calibration", n, tree))
            widths.append(np.ptp(skeleton.end[:, :2], axis=0).mean())
    return round(float(np.mean(DRIVES) * STEP / np.mean(widths)), 3)


def species_of(orchard: Orchard, internode: float) -> Species:
    """The leafless apple tree of an orchard."""
    preset = "apple-stochastic" if orchard.stochastic else "apple-leafless"
    species, _ = load_species(find_species(preset, Path()))
    assert species.rules is not None
    return replace(
        species,
        rules=replace(
            species.rules,
            generations=orchard.iterations,
            constants=(f"h0 = {internode!r}", f"dm = {orchard.smallest!r}"),
            prune_descending=orchard.pruned,
        ),
        leaf=replace(species.leaf, on=False),
        detail=Detail(tolerance=TOLERANCE),
    )


def plant(orchard: Orchard, internode: float, seed: int) -> GrownForest:
    """Grow the trees of an orchard and stand them in a row along y.

    A tree's draws depend on the iterations and its number only: orchards that differ in diameter, in
    pruning or in the number of trees have the same trees.
    """
    species = species_of(orchard, internode)
    kinds = orchard.trees if orchard.stochastic else 1
    variants = {
        (0, k): grow(species, None, stream(seed, "simlidar", "tree", orchard.iterations, k))
        for k in range(kinds)
    }
    number = np.arange(orchard.trees)
    place = np.zeros((orchard.trees, 3))
    place[:, 0], place[:, 1] = ROW, SPACING * number
    stand = Stand(
        position=place,
        rotation=2 * np.pi * stream(seed, "simlidar", "turn").random(orchard.trees),
        scale=np.ones(orchard.trees),
        species=np.zeros(orchard.trees, dtype=np.int64),
        variant=number % kinds,
        id=number,
        number=number,
        sink=np.zeros(orchard.trees),
        too_near=np.zeros(1, dtype=np.int64),
        off_ground=np.zeros(1, dtype=np.int64),
        off_field=np.zeros(1, dtype=np.int64),
        expected=np.array([float(orchard.trees)]),
        error=np.zeros(1),
        area=SPACING**2 * orchard.trees,
    )
    return GrownForest(stand, ("apple",), (species,), variants)


def tractor_for(forest: GrownForest, splits: int, gap: int = 0) -> Tractor:
    """Méndez et al.'s scanner, driving past all of an orchard; its drive is a whole number of centimetres,
    as Méndez et al.'s."""
    low, high = extent_along(forest)
    low, high = np.floor(low * 100) / 100, np.ceil(high * 100) / 100
    slope = np.tan(np.deg2rad(HALF_FAN_DEG))
    x, z = SCANNER
    return Tractor(
        position=(x, float(low), z),
        track=float(high - low) - STEP,
        step=STEP,
        gap=gap,
        angle_step_deg=ANGLE_STEP_DEG,
        reach=float(z / slope),
        top=2 * z,
        splits=splits,
    )


def extent_along(forest: GrownForest) -> tuple[float, float]:
    """Smallest and largest y of all wood above the ground."""
    ends = []
    for tree, matrix in enumerate(forest.transforms()):
        skeleton = forest.variant_of(tree).skeleton
        for points in (skeleton.start, skeleton.end):
            ends.append(points @ matrix[1, :3] + matrix[1, 3])
    along = np.concatenate(ends)
    return float(along.min()), float(along.max())


def scene_of(tractor: Tractor) -> Scene:
    """The settings that the Blender scene of an orchard is built from: the ground, and the scanner."""
    length = max(tractor.track, 1.0)
    field = Field(size=(4.0, length), origin=(0.0, tractor.position[1]), margin=5.0)
    return Scene(name="orchard", forest=field, sensors=(tractor,))
