"""The trees of a scene in other meshes: finer and coarser tubes, fewer and larger leaves, other engines.

A world comes in; casters over the same instances with other meshes come out, each made once. Only trees
whose wood is all in a skeleton have such a mesh: a template's is what it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from forest_addon.api import Site, World
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.tree import Tree, with_tolerance
from forest_addon.sensing.detail import COARSE, coarse_species
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Rays

MOST = 12_000_000  # triangles of all variants; finer ones are not made
ENGINES = {"embree": "Embree", "bvhtree": "BVHTree"}


@dataclass
class Meshes:
    """Casters of a world in other meshes; ``site`` is what it grew from."""

    site: Site
    world: World
    _casters: dict[object, RayCaster] = field(default_factory=dict)

    @cached_property
    def of_mesh(self) -> dict[int, tuple[int, int]]:
        """The variant that each mesh of the scene is, of trees that grew from skeletons alone."""
        forest, scene = self.world.forest, self.world.observer.geometry
        if forest is None:
            return {}
        rows = {int(tree): row for row, tree in enumerate(forest.stand.id)}
        found = {}
        for instance in np.flatnonzero(scene.tree >= 0).tolist():
            row = rows.get(int(scene.tree[instance]))
            if row is not None:
                key = int(forest.stand.species[row]), int(forest.stand.variant[row])
                if not forest.variants[key].grafted and len(forest.variants[key].skeleton):
                    found[int(scene.mesh_index[instance])] = key
        return found

    @property
    def tolerance(self) -> float:
        """Metres that today's tubes may be off by, the finest of all species; 0 where there are none."""
        forest = self.world.forest
        if forest is None or not self.of_mesh:
            return 0.0
        return min(forest.species[key[0]].detail.tolerance for key in self.of_mesh.values())

    @property
    def leafy(self) -> bool:
        """Return whether any of these trees bears leaves."""
        forest = self.world.forest
        return forest is not None and any(
            len(forest.variants[key].leaves) for key in self.of_mesh.values()
        )

    def tubes(self, times: float) -> RayCaster | None:
        """With tubes that may be off by ``times`` as much; None where that is too much for memory."""
        forest = self.world.forest
        assert forest is not None
        many = sum(len(forest.variants[key].mesh.triangles) for key in self.of_mesh.values())
        if many / min(times, 1.0) ** 0.5 > MOST:
            return None

        def other(key: tuple[int, int]) -> Tree:
            return with_tolerance(
                forest.variants[key], times * forest.species[key[0]].detail.tolerance
            )

        return self._kept(
            ("tubes", times), lambda: {m: other(key) for m, key in self.of_mesh.items()}
        )

    def leaves(self, share: float) -> RayCaster:
        """With a share of today's leaves, enlarged to keep their area."""

        def others() -> dict[int, Tree]:
            plan = self.site.planned()

            def thin(planting: int, variant: int) -> Tree:
                species = self.site.species[planting][0]
                if variant >= COARSE:
                    species = coarse_species(species) or species
                detail = replace(species.detail, leaves=share * species.detail.leaves)
                return plan.tree(planting, variant % COARSE, species.changed(detail=detail))

            return {m: thin(*key) for m, key in self.of_mesh.items()}

        return self._kept(("leaves", share), others)

    def engine(self, name: str) -> RayCaster | None:
        """As it is, by another engine; None where that cannot be used here, or is today's."""
        if self.world.observer.caster.engine == name:
            return None
        if name not in self._casters:
            try:
                made = make_caster(self.world.observer.geometry, Rays(engine=name))
            except ValueError:
                return None
            self._casters[name] = made
        return self._casters[name]

    def _kept(self, key: object, others: object) -> RayCaster:
        if key not in self._casters:
            assert callable(others)
            meshes = list(self.world.observer.geometry.meshes)
            for number, tree in others().items():
                meshes[number] = tree.mesh
            scene: SceneGeometry = replace(self.world.observer.geometry, meshes=tuple(meshes))
            self._casters[key] = make_caster(scene, self.site.scene.rays)
        return self._casters[key]
