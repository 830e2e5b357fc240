"""Detail that each sensor of a scene needs of each tree, where ``[accuracy] detail = "auto"``.

``grow_needed`` grows a forest with no more than that:

- No leaves where no sensor meets or hears any: of a scene of reverbs whose model knows no leaves, and of
  variants that all stand beyond the range of every sensor. Nothing that is measured changes.
- Fewer, larger leaves on trees whose leaves no sensor can tell apart: a coarse variant has a quarter of its
  leaves, each twice as long, or a shoot of fewer, wider blades. Gap fraction and projected area stay within
  2 %. A scanner cannot tell leaves apart where what it resolves, the larger of its beam's footprint and of
  the distance between neighbouring pulses, is longer than a coarse leaf. A sonar cannot where so many coarse
  leaves sound together, in the beam within half a pulse, that their sum is as random as before, and where the
  energy that they send back is the same: of N leaves it varies by 1/N of its square more than of many.
- Coarser tubes where nothing but beams of some width look at branches: within a tenth of the narrowest
  footprint w(R)² = d² + (θR)² that meets a tree of that variant, R the distance to the cylinder around the
  tree. A surface is off by that at most, along its normal, and its silhouette by a tenth of a beam.

What must be known exactly, as the phase of sound at wood, is left as it is set. Trunks that a response does
not hear are left out by the response itself (``reverb/weak``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..base.progress import Progress
from ..base.rng import stream
from ..growth.tree import Tree, leaves_left, with_tolerance, without_leaves
from ..spec import Choice, Scene, Species
from ..stand.compose import Inputs
from ..stand.forest import ForestPlan, Grown, GrownForest, Planted, TreesBefore, keys_of
from .kinds import kind_of
from .looks import BeamLook, Leafy, SensorLook, TellingLook, Upright, range_shift

COARSE = 1000  # added to a variant's number; a planting has at most as many
SHARE = 0.25  # of the leaves, and of a shoot's blades, that a coarse variant has
BOUND = 0.05  # on gap fraction and projected area of a coarse variant
OFF = 0.1  # of a footprint that a tube may be off by
WORTH = 1.5  # times the tolerance that is set: less is not worth another mesh
FEWER = 0.9  # of the triangles: nor is one with more

Key = tuple[int, int]  # planting and variant


def grow_needed(
    scene: Scene,
    species: Sequence[Planted],
    progress: Progress | None = None,
    inputs: Inputs | None = None,
    grown: Grown | None = None,
    kept: TreesBefore | None = None,
) -> GrownForest:
    """Grow a forest with no more than the scene's sensors need, where that is left to them; its ``chosen``
    and ``detail`` say what that is.

    grown : gives the tree of a planting and variant, by numbers, of a species, in place of growing it.
    kept : trees that grew before, which are taken where they are the same.
    """
    if scene.accuracy.detail != "auto":
        return ForestPlan.of(scene, species, inputs, grown, kept).grow(progress)
    looks = [kind_of(sensor).look(sensor) for sensor in scene.sensors]
    species, bared = _without_unmet_leaves(species, looks)
    plan = ForestPlan.of(scene, species, inputs, grown, kept)
    forest = _with_coarse(plan, plan.grow(progress), looks)
    if looks:
        forest, beyond = _without_leaves_beyond(forest, looks)
        forest, tubes = _with_coarse_tubes(forest, looks)
        forest = replace(forest, chosen=(*forest.chosen, *bared, *beyond, *tubes))
    return forest


def coarse_species(species: Species) -> Species | None:
    """The species with coarser leaves; None where it has none (its leaves come from a template)."""
    if species.template is not None or not species.leaf.on:
        return None
    return species.changed(detail=species.detail.changed(leaves=species.detail.leaves * SHARE))


def _without_unmet_leaves(
    species: Sequence[Planted], looks: Sequence[SensorLook]
) -> tuple[list[Planted], tuple[Choice, ...]]:
    """Species to grow, without leaves where sensors look and none takes notice of a leaf."""
    if not looks or any(look.leaves for look in looks):
        return list(species), ()
    bare: list[Planted] = [
        (kind.changed(detail=replace(kind.detail, leaves=0.0)), templates)
        for kind, templates in species
    ]
    why = "of anything: no sensor of this scene meets or hears a leaf"
    return bare, (Choice("detail.leaves", 0.0, 0.0, why),)


def _with_coarse(plan: ForestPlan, forest: GrownForest, looks: Sequence[SensorLook]) -> GrownForest:
    """The forest with coarse variants where trees are far, and the decision in sentences."""
    trees = _foliage(forest)
    tell = [look for look in looks if isinstance(look, TellingLook)]
    far, notes = _far(trees, tell)
    stand = replace(
        forest.stand, variant=np.where(far, forest.stand.variant + COARSE, forest.stand.variant)
    )
    variants: dict[Key, Tree] = {}
    for planting, variant in keys_of(stand):
        coarse = coarse_species(forest.species[planting]) if variant >= COARSE else None
        if coarse is None:
            variants[planting, variant] = forest.variants[planting, variant]
        else:
            variants[planting, variant] = plan.tree(planting, variant - COARSE, coarse)
    chosen = _in_their_units(plan, forest, variants, trees, far, tell)
    return replace(forest, stand=stand, variants=variants, detail=notes, chosen=chosen)


def _in_their_units(
    plan: ForestPlan,
    forest: GrownForest,
    variants: dict[Key, Tree],
    trees: Leafy,
    far: np.ndarray,
    looks: Sequence[TellingLook],
) -> tuple[Choice, ...]:
    """Results of sensors that reach far trees, and by how much coarse leaves move them."""
    within = {look.name: far & (look.distance(trees) <= look.range) for look in looks}
    looks = [look for look in looks if within[look.name].any()]
    if not looks:
        return ()
    pairs = [
        (forest.variants[planting, variant - COARSE], tree)
        for (planting, variant), tree in variants.items()
        if variant >= COARSE
    ]
    shift = range_shift(pairs, stream(plan.scene.seed, "detail", "rays"))
    return tuple(look.off_by(trees, within[look.name], shift) for look in looks)


def _far(trees: Leafy, looks: Sequence[TellingLook]) -> tuple[np.ndarray, tuple[str, ...]]:
    """(N,) bool, trees that are far from every sensor, and why; none where no sensor looks, or where one may
    be anywhere.
    """
    far = (trees.length > 0) & bool(looks)
    for look in looks:
        if look.corners is None:
            note = f"{look.name} follows a trajectory that is not known yet, so all trees have all leaves"
            return np.zeros_like(far), (f"Level of detail: {note}.",)
        away = trees.distance(look.corners)
        far &= look.blurs(trees, away) | (away > look.range)
    made = f"{far.sum():,} of {len(far):,} trees have {SHARE:.0%} of their leaves or blades"
    bound = f"larger ones, with gap fraction and projected area within {BOUND:.0%} of all"
    notes = [f"Level of detail: {made}, {bound}."]
    for look in looks if far.any() else ():
        assert look.corners is not None
        away = trees.distance(look.corners)
        nearest = int(np.flatnonzero(far)[np.argmin(away[far])])
        start = f"The nearest of them is {away[nearest]:.1f} m from {look.name}"
        beyond = away[nearest] > look.range
        why = "beyond its range" if beyond else look.why_blurred(trees, away, nearest)
        notes.append(f"{start}, {why}.")
    return far, tuple(notes)


def _without_leaves_beyond(
    forest: GrownForest, looks: Sequence[SensorLook]
) -> tuple[GrownForest, tuple[Choice, ...]]:
    """Variants of which no tree is within the range of a sensor that takes notice of leaves, without any."""
    trees, variants = _uprights(forest), dict(forest.variants)
    reached = np.zeros(len(forest.stand), dtype=bool)
    for look in looks:
        if look.leaves:
            reached |= look.distance(trees) <= look.range
    bared = [
        key
        for key, tree in forest.variants.items()
        if len(tree.leaves) and not reached[_rows(forest, key)].any()
    ]
    if not bared:
        return forest, ()
    for key in bared:
        variants[key] = without_leaves(variants[key])
    count = sum(int(_rows(forest, key).sum()) for key in bared)
    leaves = sum(len(forest.variants[key].leaves) for key in bared)
    why = (
        f"of anything: {count:,} trees of {len(bared):,} variants stand beyond the range of every "
        f"sensor and bear no leaves ({leaves:,} a set of variants)"
    )
    chosen = Choice("detail.leaves", 0.0, 0.0, why)
    return replace(forest, variants=variants), (chosen,)


def _with_coarse_tubes(
    forest: GrownForest, looks: Sequence[SensorLook]
) -> tuple[GrownForest, tuple[Choice, ...]]:
    """Variants whose branches only wide beams meet, with coarser tubes."""
    if any(look.exact_wood for look in looks):
        return forest, ()
    trees, variants, made = _uprights(forest), dict(forest.variants), dict[Key, float]()
    beams = [look for look in looks if isinstance(look, BeamLook)]
    away = [look.distance(trees) for look in beams]
    for key, tree in forest.variants.items():
        tolerance = _tolerance(forest, key, beams, away)
        if tolerance is not None:
            coarse = with_tolerance(tree, tolerance)
            if len(coarse.mesh.triangles) <= FEWER * len(tree.mesh.triangles):
                variants[key], made[key] = coarse, tolerance
    species, chosen = list(forest.species), []
    for planting, label in enumerate(forest.labels):
        own_keys = {key: metres for key, metres in made.items() if key[0] == planting}
        if not own_keys:
            continue
        coarsest = max(own_keys.values())
        detail = replace(species[planting].detail, tolerance=coarsest)
        species[planting] = species[planting].changed(detail=detail)
        before, after = (
            sum(len(of[key].mesh.triangles) for key in own_keys)
            for of in (forest.variants, variants)
        )
        why = (
            f"along the normal of {label}'s branches, a tenth of the narrowest beam that meets them; "
            f"{after:,} triangles in place of {before:,}"
        )
        chosen.append(Choice("detail.tolerance", coarsest, coarsest, why, unit="m"))
    return replace(forest, variants=variants, species=tuple(species)), tuple(chosen)


def _tolerance(
    forest: GrownForest, key: Key, beams: Sequence[BeamLook], away: Sequence[np.ndarray]
) -> float | None:
    """Metres that a variant's tubes may be off by, None where they stay as they are.

    away : (N,) metres from each beam to every tree.
    """
    tree, rows = forest.variants[key], _rows(forest, key)
    if tree.grafted or not len(tree.skeleton):
        return None  # its mesh is a template's
    finest = np.inf
    for look, metres in zip(beams, away, strict=True):
        nearest = float(metres[rows].min(initial=np.inf))
        if nearest <= look.range:
            finest = min(finest, look.widths(nearest))
    if not beams or not np.isfinite(finest):  # no beam gets there
        return None
    tolerance = OFF * finest / float(forest.stand.scale[rows].max(initial=1.0))
    return tolerance if tolerance > WORTH * forest.species[key[0]].detail.tolerance else None


def _rows(forest: GrownForest, key: Key) -> np.ndarray:
    """(N,) which trees are of a variant."""
    return (forest.stand.species == key[0]) & (forest.stand.variant == key[1])


def _each(forest: GrownForest, measure: Callable[[Key, Tree], tuple[float, ...]]) -> np.ndarray:
    """(columns, N) what is measured of variants, for every tree that stands."""
    columns = len(measure(*next(iter(forest.variants.items())))) if forest.variants else 3
    rows = np.zeros((len(forest.stand), columns))
    for key, tree in forest.variants.items():
        rows[_rows(forest, key)] = measure(key, tree)
    return rows.T


def _uprights(forest: GrownForest) -> Upright:
    """The upright cylinders around the trees of a forest."""

    def measure(_key: Key, tree: Tree) -> tuple[float, ...]:
        points = tree.mesh.vertices
        wide = np.hypot(points[:, 0], points[:, 1]).max(initial=0.0)
        low, high = points[:, 2].min(initial=0.0), points[:, 2].max(initial=0.0)
        return float(wide), float(low), float(high)

    scale, place = forest.stand.scale, forest.transforms()[:, :, 3]
    wide, low, high = _each(forest, measure)
    z = place[:, 2]
    return Upright(place[:, :2], wide * scale, z + low * scale, z + high * scale)


def _foliage(forest: GrownForest) -> Leafy:
    """The same with the coarse leaves of trees that can have such."""

    def measure(key: Key, tree: Tree) -> tuple[float, ...]:
        species, leaves = forest.species[key[0]], tree.leaves
        kind = coarse_species(species)
        if kind is None or not len(leaves):
            return 0.0, 0.0, 0.0
        wide = float(np.hypot(*tree.mesh.vertices[:, :2].T).max())
        less = leaves_left(kind) / leaves_left(species)
        volume = np.pi * wide**2 * max(float(np.ptp(leaves.centre[:, 2])), wide)
        longest = float(leaves.length.max()) / np.sqrt(less)
        disc = 0.0 if kind.needles else float((leaves.radius**2).mean())
        return longest, float(np.sqrt(disc)), less * len(leaves) / volume

    scale = forest.stand.scale
    length, radius, density = _each(forest, measure)
    return Leafy(
        **vars(_uprights(forest)),
        length=length * scale,
        radius=radius * scale,
        density=density / scale**3,
    )
