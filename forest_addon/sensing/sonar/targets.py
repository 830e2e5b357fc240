"""Everything in a scene that sounds back, and which of it a sonar must look at.

Meshes are measured once a kind, in local space (``Population``); a scene of thousands of trees costs the
memory of its variants. A ``Sonar`` asks for candidates: instances whose bounding spheres come within
its range and beam, of these the blocks, each with a bound on all that it can add. Only the rows of blocks
that are opened are moved into the world.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...base.rows import RowTable, distinct, lengths
from ...base.trimesh import LEAF as LEAF_PART, TriMesh
from ...spec import Sonar
from ..rays.geometry import SceneGeometry
from .facets import FacetPopulation
from .leaves import FoliageDiscs, LeafDiscs, LeafPopulation, similarity
from .scatterers import Population, Scatterers, Sight, Views
from .windy import EchoMotion, EchoWind
from .wood import WoodPopulation

KINDS = ("leaves", "wood", "facets")


@dataclass(frozen=True)
class _Stand:
    """A population and its I instances: numbers in the scene, transforms, stretch, bounding spheres."""

    population: Population
    instance: np.ndarray
    transform: np.ndarray
    stretch: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


@dataclass(frozen=True)
class Candidates(RowTable):
    """P blocks of instances that a sonar may hear.

    stand, member, block : (P,) which. centre : (P, 3). radius : (P,). count : (P,) scatterers in each.
    nearest : (P,) metres. strength : (P,) bound on Σ|f| over the band.
    """

    stand: np.ndarray
    member: np.ndarray
    block: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    count: np.ndarray
    nearest: np.ndarray
    strength: np.ndarray


class EchoTargets:
    """Targets of a sonar in a scene.

    like : targets of a scene with the same meshes, whose measures are shared. wind : how its trees sway,
    motion : and how all else moves; None: they stand still.
    """

    def __init__(
        self,
        scene: SceneGeometry,
        like: EchoTargets | None = None,
        wind: EchoWind | None = None,
        motion: EchoMotion | None = None,
    ) -> None:
        self.scene = scene
        self._wind, self._motion, self._time = wind, motion, 0.0
        self._made: dict[tuple[str, str, int], Population] = {} if like is None else like._made
        self._foliage: dict[int, FoliageDiscs] = {} if like is None else like._foliage
        # Shapes of one moment are measured for that alone.
        self._fleeting: dict[tuple[str, str, int], Population] = {}
        self._stands: dict[tuple[bool, bool, bool, str], list[_Stand]] = {}
        self._stretch: np.ndarray | None = None

    def at(self, time: float) -> EchoTargets:
        """The targets as they are at a time, s; these where nothing moves."""
        if self._motion is not None:
            scene = self._motion.scene_at(time)
            other = EchoTargets(scene, self, self._wind, self._motion)
        elif self._wind is None:
            return self
        else:
            other = copy(self)
        other._time = time
        return other

    @classmethod
    def of_discs(cls, discs: LeafDiscs) -> EchoTargets:
        """Leaves that are measured already, as one instance."""
        nothing = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), LEAF_PART)
        one = np.zeros(1, dtype=np.int64)
        made = cls(
            SceneGeometry((nothing,), np.eye(3, 4)[None], one, ("leaves",), one - 1, one - 1)
        )
        made._foliage[0] = FoliageDiscs.of_discs(discs)
        return made

    def stands(self, sonar: Sonar) -> list[_Stand]:
        """Populations with something in them, of the kinds that the sonar hears, made once."""
        key = (sonar.leaves, sonar.wood, sonar.facets, sonar.leaf_model)
        if key not in self._stands:
            kinds = [kind for kind in KINDS if getattr(sonar, kind)]
            self._stands[key] = [
                stand
                for index in distinct(self.scene.mesh_index)
                for kind in kinds
                if (stand := self._stand(kind, int(index), sonar.leaf_model)) is not None
            ]
        return self._stands[key]

    def total(self, sonar: Sonar, kind: str | None = None) -> int:
        """Number of scatterers, of one kind or of all; wood and facets before they are
        cut."""
        return sum(
            len(stand.population) * len(stand.instance)
            for stand in self.stands(sonar)
            if kind in (None, stand.population.kind)
        )

    def candidates(
        self, sonar: Sonar, point: np.ndarray, lowest: float, highest: float
    ) -> tuple[Candidates, int]:
        """Blocks that reach into the sonar's range, and how many scatterers lie wholly beyond.

        point : (3,) where the sonar is. lowest, highest : wavenumbers of the band.
        """
        whole, none, far = np.empty(0, np.int64), np.empty((3, 0)), 0
        found = [Candidates(whole, whole, whole, none.T, none[0], whole, none[0], none[0])]
        for number, stand in enumerate(self.stands(sonar)):
            blocks = stand.population.blocks
            away = np.linalg.norm(stand.centre - point, axis=1) - stand.radius
            # No tree goes farther off its rest than it is large.
            drift, turn = self._astray(stand, ~(away > sonar.max_range + 2 * stand.radius))
            near = np.flatnonzero(~(away - drift > sonar.max_range))
            far += (len(stand.instance) - len(near)) * len(stand.population)
            linear = stand.transform[near, :, :3]
            towards = blocks.centre @ linear.transpose(0, 2, 1)  # (I, B, 3)
            towards += (stand.transform[near, :, 3] - point)[:, None]
            radius = stand.stretch[near, :1] * blocks.radius + drift[near, None]
            distance = np.sqrt(np.einsum("ibk,ibk->ib", towards, towards))
            inside = ~(distance - radius > sonar.max_range)
            far += int((~inside @ blocks.count).sum())
            member, block = np.nonzero(inside)
            towards, radius, distance = towards[inside], radius[inside], distance[inside]
            nearest = np.maximum(np.nan_to_num(distance - radius), sonar.near_limit)
            with np.errstate(invalid="ignore", divide="ignore"):
                spread = np.where(
                    distance > radius, np.arcsin(np.minimum(radius / distance, 1)), np.pi
                )
                local = np.einsum("pk,pka->pa", towards, linear[member])
                local /= lengths(local)[:, None]
            spread += turn[near][member]
            views = Views(block, stand.stretch[near][member], nearest, local, spread)
            strength = stand.population.ceiling(views, lowest, highest)
            strength[~np.isfinite(distance - radius)] = np.inf
            found.append(
                Candidates(
                    np.full(len(member), number),
                    near[member],
                    block,
                    towards + point,
                    radius,
                    blocks.count[block],
                    nearest,
                    strength,
                )
            )
        return Candidates.joined(found), far

    def scatterers(
        self, sonar: Sonar, some: Candidates, sight: Sight
    ) -> list[tuple[Scatterers, np.ndarray, np.ndarray]]:
        """The scatterers of opened candidates, one set a class, each with its instance (M,) and motion (M,
        6):
        velocity, m/s, and where it is at rest, m; (M, 0) where nothing moves."""
        opened: dict[type, tuple[list[Scatterers], list[np.ndarray], list[np.ndarray]]] = {}
        order = np.lexsort((some.block, some.member, some.stand))
        stand, member, block = some.stand[order], some.member[order], some.block[order]
        starts = np.flatnonzero(
            (np.diff(stand, prepend=-1) != 0) | (np.diff(member, prepend=-1) != 0)
        )
        for first, last in pairwise([*starts, len(stand)] if len(starts) else []):
            chosen = self.stands(sonar)[stand[first]]
            bounds = chosen.population.blocks.first
            begin, end = bounds[block[first:last]], bounds[block[first:last] + 1]
            ends = np.cumsum(end - begin)
            rows = np.arange(ends[-1]) + np.repeat(end - ends, end - begin)
            which = member[first]
            for made, motion in self._placed(chosen, which, rows, sight):
                sets, instances, motions = opened.setdefault(type(made), ([], [], []))
                sets.append(made)
                instances.append(np.full(len(made), self._known(chosen.instance[which])))
                motions.append(motion)
        return [
            (type(sets[0]).joined(sets), np.concatenate(instances), np.concatenate(motions))
            for sets, instances, motions in opened.values()
        ]

    def still_leaves(
        self, sonar: Sonar, some: Candidates
    ) -> tuple[list[tuple[Any, ...]], Candidates]:
        """The kernel's arguments for opened candidates of leaves, mesh by mesh, and all others; none where
        something moves or is squeezed."""
        stands = self.stands(sonar)
        leaves = {
            number: stand.population
            for number, stand in enumerate(stands)
            if isinstance(stand.population, LeafPopulation)
        }
        of_leaves, runs = np.isin(some.stand, list(leaves)), []
        for number, population in leaves.items():
            blocks = some.select(some.stand == number)
            order = np.lexsort((blocks.block, blocks.member))
            member, block = blocks.member[order], blocks.block[order]
            first, transform = population.blocks.first, stands[number].transform[member]
            scale = similarity(transform[:, :, :3])
            if np.isnan(scale).any() or self._wind is not None or self._motion is not None:
                return [], some
            given = (
                first[block],
                first[block + 1],
                transform,
                scale,
                stands[number].instance[member],
            )
            runs.append((len(order), *given, *population.table))
        return runs, some.select(~of_leaves)

    def _placed(
        self, stand: _Stand, which: int, rows: np.ndarray, sight: Sight
    ) -> Iterator[tuple[Scatterers, np.ndarray]]:
        """Rows of a population as an instance has them in the world, with their motion."""
        instance, transform = int(stand.instance[which]), stand.transform[which]
        wind, motion, population = self._wind, self._motion, stand.population
        if wind is not None and wind.tree[self._known(instance)] >= 0:
            yield from wind.scatterers(population, rows, instance, transform, sight, self._time)
            return
        for made in population.scatterers(transform, rows, sight):
            if motion is not None:
                yield made, np.hstack(motion.motion(instance, transform, made, self._time))
            elif wind is None:
                yield made, np.empty((len(made), 0))
            else:
                yield made, np.hstack([np.zeros_like(made.centre), made.centre])

    def _known(self, instance: Any) -> Any:
        """The numbers that instances have in the scene as it was read."""
        return instance if self._motion is None else self._motion.known(instance)

    def _astray(self, stand: _Stand, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(I,) metres and radians that nothing of instances is farther from, or more turned than, at rest; 0
        of those that are not near (I,), bool."""
        drift, turn = np.zeros(len(stand.instance)), np.zeros(len(stand.instance))
        if self._wind is not None:
            sways = self._wind.tree[self._known(stand.instance)] >= 0
            for row in np.flatnonzero(sways & near).tolist():
                moment = self._wind.moment(int(stand.instance[row]), self._time)
                drift[row], turn[row] = stand.stretch[row, 0] * moment.drift, moment.turn
        return drift, turn

    def _stand(self, kind: str, index: int, model: str) -> _Stand | None:
        population = self._population(kind, index, model)
        if not len(population):
            return None
        if self._stretch is None:
            finite = np.nan_to_num(self.scene.transform[:, :, :3], posinf=0.0, neginf=0.0)
            self._stretch = np.linalg.svd(finite, compute_uv=False)
        instance = np.flatnonzero(self.scene.mesh_index == index)
        transform = self.scene.transform[instance]
        blocks = population.blocks
        middle = (blocks.centre.min(axis=0) + blocks.centre.max(axis=0)) / 2
        reach = (np.linalg.norm(blocks.centre - middle, axis=1) + blocks.radius).max()
        centre = np.einsum("iab,b->ia", transform[:, :, :3], middle) + transform[:, :, 3]
        stretch = self._stretch[instance]
        return _Stand(population, instance, transform, stretch, centre, stretch[:, 0] * reach)

    def _population(self, kind: str, index: int, model: str) -> Population:
        key = (kind, model if kind == "leaves" else "", index)
        fleeting = self._motion is not None and index >= self._motion.measured
        kept = self._fleeting if fleeting else self._made
        if key not in kept:
            mesh = self.scene.meshes[index]
            if kind == "leaves":
                foliage = {} if fleeting else self._foliage
                if index not in foliage:
                    foliage[index] = FoliageDiscs(mesh)
                kept[key] = LeafPopulation(foliage[index], model)
            elif kind == "wood":
                kept[key] = WoodPopulation(mesh)
            else:
                kept[key] = FacetPopulation(mesh)
        return kept[key]
