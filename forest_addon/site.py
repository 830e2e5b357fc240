"""The door to a forest: settings, inputs and species in, a grown forest out; without Blender.

A ``ForestSite`` holds all that a forest is made of. ``read`` takes it from files, ``blender/read/inputs``
adds what objects of a Blender scene say, ``plan`` says where trees stand, and ``grow`` decides how much of
each tree the scene's sensors need (once, ``sensing/detail``) and grows that. The API, the panel,
datasets, flights and the commands all come this way, so the same settings and seed are the same forest to the
bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from .base.progress import Progress
from .growth.library import check_known, find_species, load_species
from .growth.tree import Tree
from .sensing.detail import grow_needed
from .sensing.kinds import kind_of
from .sensing.looks import TellingLook
from .spec import AUTO, Scene, SpecError
from .stand.compose import Inputs
from .stand.files import read_inputs
from .stand.forest import ForestPlan, Grown, GrownForest, Planted, TreesBefore
from .stand.intensity.surface import GroundSurface, roughened
from .stand.plan import Stand, plan_stand, with_undergrowth

ROUGH = 0.1  # metres, of ground with undergrowth
Load = Callable[[str, Path], Planted]


def load_planted(name: str, folder: Path) -> Planted:
    """A species by the name that a planting gives it, with its templates.

    Raises
    ------
    SpecError : there is no such species, or it cannot be used.
    """
    return load_species(find_species(name, folder))


def check_species(scene: Scene, folder: Path) -> None:
    """Check that every species that a scene plants is there, without reading any.

    Raises
    ------
    SpecError : some are not; names all of them, each with the nearest that is.
    """
    plantings = enumerate(scene.plantings)
    check_known({f"plantings[{number}].species": p.species for number, p in plantings}, folder)


def _planted(number: int, name: str, folder: Path, load: Load) -> Planted:
    try:
        return load(name, folder)
    except SpecError as problem:
        if problem.key != "species":  # what is wrong in its file
            raise
        raise SpecError(f"plantings[{number}].species", problem.problem) from None


@dataclass(frozen=True)
class ForestSite:
    """All that a forest is made of; nothing has grown.

    scene : its settings. folder : that relative paths in them start from. species : what each planting
    plants, with its templates. inputs : rasters, lists, allometries and terrain.
    """

    scene: Scene
    folder: Path = Path()
    species: Sequence[Planted] = ()
    inputs: Inputs = field(default_factory=Inputs)

    @classmethod
    def read(cls, scene: Scene, folder: str | Path = ".", load: Load = load_planted) -> Self:
        """Read the species and the files that a scene names; undergrowth becomes plantings behind its own.

        load : gives a species by its name and the folder.

        Raises
        ------
        SpecError : a species or a file is missing or cannot be used.
        """
        folder = Path(folder)
        if load is load_planted:
            check_species(scene, folder)  # all that are wrong, not the first
        species = tuple(
            _planted(number, planting.species, folder, load)
            for number, planting in enumerate(scene.plantings)
        )
        looks = [kind_of(sensor).look(sensor) for sensor in scene.sensors]
        looked_at = any(isinstance(look, TellingLook) for look in looks)
        own = len(scene.plantings)
        scene, species = with_undergrowth(
            scene, species, looked_at, lambda name: load(name, folder)
        )
        if len(species) > own and scene.forest.terrain.roughness == AUTO:
            floor = scene.forest.terrain.changed(roughness=ROUGH)
            scene = scene.changed(forest=scene.forest.changed(terrain=floor))
        return cls(scene, folder, species, read_inputs(scene, folder)).roughened()

    def roughened(self) -> Self:
        """Roughen the ground as the scene says.

        Raises
        ------
        SpecError : the ground is a surface of triangles.
        """
        forest = self.scene.forest
        if forest.terrain.roughness <= 0 or forest.terrain.object:
            return self
        rough = roughened(self.ground, forest, forest.terrain.roughness, self.scene.seed)
        return replace(self, inputs=replace(self.inputs, terrain=rough))

    @property
    def ground(self) -> GroundSurface:
        """The terrain, flat where none was given."""
        return self.inputs.ground(self.scene.forest.terrain.base)

    def plan(self) -> Stand:
        """Plan of where trees stand, before any has grown: sizes and variants of trees with targets come
        later."""
        scene = self.scene
        return plan_stand(scene.seed, scene.forest, scene.plantings, self.inputs)

    def grow(
        self,
        progress: Progress | None = None,
        grown: Grown | None = None,
        kept: TreesBefore | None = None,
    ) -> GrownForest:
        """Plan the stand and grow its trees, as far as the scene's sensors need them.

        progress : called as progress(done, total). grown : gives the tree of a planting and variant, by
        numbers, of a species, in place of growing it; of trees without targets of their own. kept : trees
        that grew before, which are taken where they are the same.

        Raises
        ------
        SpecError : an intensity or a list that cannot be used; targets that contradict each other.
        """
        return grow_needed(self.scene, self.species, progress, self.inputs, grown, kept)

    def planned(self) -> ForestPlan:
        """The stand with variants and targets of its trees; grows single trees in full."""
        return ForestPlan.of(self.scene, self.species, self.inputs)

    def every_variant(self, forest: GrownForest) -> dict[tuple[int, int], Tree]:
        """The variants of a forest that grew here in full, with those that could stand and do not."""
        plan, variants = self.planned(), dict(forest.variants)
        for number, planting in enumerate(self.scene.plantings):
            for variant in range(planting.variants):
                if (number, variant) not in variants:
                    variants[number, variant] = plan.tree(number, variant)
        return dict(sorted(variants.items()))
