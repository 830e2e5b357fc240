"""Arrays that a forest needs in Blender, made beside the window, which would stand still else.

Before a forest is built: fingerprints of its variants, and in a large forest their stand-ins for views. Once
it stands: the measures and the picture of each variant that is new, more work than growing them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from ...base.progress import Progress
from ...base.trimesh import TriMesh
from ...growth.mesh.stand_in import Level, level_for, stand_in
from ...growth.truth import tree_truth
from ...stand.forest import GrownForest
from .assets import ToldVariant, Variant, portray
from .placing import fingerprint

DRAWABLE = 5_000_000  # triangles of all stand-ins of a forest together, which a graphics card draws at once


@dataclass(frozen=True)
class ReadyForest:
    """Shapes and stand-ins of variants, as far as they were made ahead.

    drawable : triangles that all stand-ins of a forest may have together.
    """

    shapes: dict[Variant, str] = field(default_factory=dict)
    stand_ins: dict[Variant, TriMesh] = field(default_factory=dict)
    drawable: int = DRAWABLE

    def level(self, forest: GrownForest) -> Level:
        """Level at which stand-ins show the trees of a forest."""
        return level_for(len(forest.stand), self.drawable)

    def shape(self, forest: GrownForest, key: Variant) -> str:
        """The fingerprint of a variant's mesh."""
        if key not in self.shapes:
            self.shapes[key] = fingerprint(forest.variants[key].mesh)
        return self.shapes[key]

    def stand_in(self, forest: GrownForest, key: Variant) -> TriMesh:
        """The few triangles that views show of a variant."""
        if key in self.stand_ins:
            return self.stand_ins[key]
        tree = forest.variants[key]
        return stand_in(tree.mesh, tree.skeleton, self.level(forest))

    def rough_shape(self, forest: GrownForest, key: Variant) -> str:
        """The fingerprint of a variant's stand-in."""
        return f"{self.shape(forest, key)} {self.level(forest).most}"


def make_ready(
    forest: GrownForest,
    known: Collection[str],
    as_points: bool,
    tell: Progress,
    drawable: int = DRAWABLE,
) -> ReadyForest:
    """Make ahead what the variants of a forest need to stand; touches no Blender.

    known : shapes that stand in the scene already, of which nothing is made anew.
    """
    ready = ReadyForest(drawable=drawable)
    for number, (key, tree) in enumerate(forest.variants.items()):
        tell(number, len(forest.variants))
        ready.shapes[key] = fingerprint(tree.mesh)
        if as_points and ready.rough_shape(forest, key) not in known:
            ready.stand_ins[key] = ready.stand_in(forest, key)
    return ready


def tell_of(
    forest: GrownForest, wanted: Sequence[Variant], tell: Progress | None = None
) -> dict[Variant, ToldVariant]:
    """Measure variants of a forest and draw their pictures; touches no Blender."""
    told = {}
    for number, key in enumerate(wanted):
        if tell:
            tell(number, len(wanted))
        planting, tree = key[0], forest.variants[key]
        portrait = portray(forest.species[planting], forest.labels[planting], tree.mesh)
        told[key] = ToldVariant(tree_truth(tree), portrait)
    return told
