"""Arrays that a forest needs in Blender, made ahead, beside the window.

A variant says what it measures, has a picture, and in a large forest a stand-in for views: a second of
work for a few trees, during which a window would stand still if it were done as the forest is built.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from ...base.progress import Progress
from ...base.trimesh import TriMesh
from ...growth.mesh.stand_in import Level, level_for, stand_in
from ...growth.truth import wood_of_tree
from ...stand.forest import GrownForest
from .assets import AssetPortrait, portray
from .standing import fingerprint

Variant = tuple[int, int]  # number of the planting, and of the variant in it
DRAWABLE = 5_000_000  # triangles of all stand-ins of a forest together, which a graphics card draws at once


@dataclass(frozen=True)
class ReadyForest:
    """Shapes, pictures and stand-ins of variants, as far as they were made ahead.

    drawable : triangles that all stand-ins of a forest may have together.
    """

    shapes: dict[Variant, str] = field(default_factory=dict)
    portraits: dict[Variant, AssetPortrait] = field(default_factory=dict)
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

    def portrait(self, forest: GrownForest, key: Variant) -> AssetPortrait:
        """The picture of a variant."""
        if key in self.portraits:
            return self.portraits[key]
        species, label = forest.species[key[0]], forest.labels[key[0]]
        return portray(species, label, forest.variants[key].mesh)

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
    """Make ahead what the variants of a forest need; touches no Blender.

    known : shapes that stand in the scene already, of which nothing is made anew.
    """
    ready = ReadyForest(drawable=drawable)
    for number, (key, tree) in enumerate(forest.variants.items()):
        tell(number, len(forest.variants))
        shape = ready.shapes[key] = fingerprint(tree.mesh)
        if as_points and ready.rough_shape(forest, key) not in known:
            ready.stand_ins[key] = ready.stand_in(forest, key)
        if shape in known:
            continue
        wood_of_tree(tree)  # it is kept with the tree
        ready.portraits[key] = ready.portrait(forest, key)
    return ready
