"""Sensors in a Blender scene: read the evaluated depsgraph once, then look and listen in it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import bpy
import numpy as np

from ...base.rng import stream
from ...sensing.audit import Audit
from ...sensing.choice import choose
from ...sensing.lidar import scan as lidar
from ...sensing.lidar import tractor
from ...sensing.lidar.audit import audit_drive, audit_scan
from ...sensing.lidar.cloud import Cloud
from ...sensing.lidar.trajectory import Path as Track
from ...sensing.rays.caster import RayCaster
from ...sensing.rays.inside import tree_around
from ...sensing.rays.precision import rounding_warning
from ...sensing.reverb import ends
from ...sensing.reverb import response as reverb
from ...sensing.reverb.audit import audit_response
from ...sensing.reverb.directivity_file import directivity_of
from ...sensing.reverb.forest.canopy import canopy_of
from ...sensing.reverb.forest.losses import Stand
from ...sensing.reverb.forest.surroundings import BARE, Canopy, surroundings
from ...sensing.reverb.sums.fast_scattering import Expansions
from ...sensing.reverb.trunks import slices
from ...sensing.reverb.trunks.trunk_cuts import TrunkCuts
from ...sensing.sonar import flight
from ...sensing.sonar import ping as sonar
from ...sensing.sonar.audit import audit_echoes
from ...sensing.sonar.equipment_files import equip, find, read_route
from ...sensing.sonar.poses import Pose
from ...spec import Mobile, Rays, Reverb, Scanner, Scene, Sensor, Sonar, Tractor
from ...stand.placed import PlacedTrees
from ...stand.stems import plant_stems
from ..rays.casters import make_caster
from ..read.depsgraph import read_scene
from ..read.kept import kept
from ..scene.asset_truth import placed_trees
from ..scene.nodes import in_full
from .motion import follow
from .platform import path_of_object

Progress = Callable[[int, int], None]
ENDS = {"SPEAKER", "EMPTY", "CAMERA"}  # what can be a source or a receiver
Way = list[Pose] | Track | None
Finding = tractor.TractorScan | Cloud | sonar.Echo | flight.Flight | reverb.ImpulseResponse


class Observer:
    """An evaluated scene as arrays, with the casters and scatterers that sensors need, made once."""

    def __init__(
        self,
        depsgraph: bpy.types.Depsgraph,
        rays: Rays | None = None,
        expansions: Expansions | None = None,
    ) -> None:
        with in_full(depsgraph):
            self.geometry = read_scene(depsgraph)
        self.warning = rounding_warning(self.geometry)  # what a user should know, in a sentence
        self.places = {
            thing.name: tuple(thing.matrix_world.translation)
            for thing in depsgraph.objects
            if thing.type in ENDS
        }
        self._rays = rays or Rays()
        self.expansions = Expansions() if expansions is None else expansions
        self._cut: dict[float, TrunkCuts] = {}

    @classmethod
    def of(
        cls, depsgraph: bpy.types.Depsgraph, rays: Rays, expansions: Expansions | None = None
    ) -> Observer:
        """The observer of before, with all it has made, as long as nothing changes."""
        return kept(depsgraph, cls, rays, expansions)

    @cached_property
    def names(self) -> list[str]:
        """The object that each instance comes from, by its name."""
        names = self.geometry.object_name
        return [names[number] for number in self.geometry.object_index.tolist()]

    @cached_property
    def caster(self) -> RayCaster:
        """Rays that meet everything."""
        return make_caster(self.geometry, self._rays)

    @cached_property
    def wood(self) -> RayCaster:
        """Rays that pass leaves: lines of sight of sound."""
        return make_caster(self.geometry.solid(), self._rays)

    @cached_property
    def targets(self) -> sonar.Targets:
        """Everything that sounds back to a sonar."""
        return sonar.Targets(self.geometry)

    @cached_property
    def placed_trees(self) -> PlacedTrees:
        """Trees from asset libraries, with the truth that came along."""
        return placed_trees(self.geometry)

    def trunks(self, sensor: Reverb) -> slices.Trunks:
        """Trunks of the scene where the sound of the first channel passes them."""
        source, receiver = ends.ends_of(sensor, self.places).pairs[0]
        return self._cuts(sensor.min_radius).between(source, receiver)

    def _cuts(self, min_radius: float) -> TrunkCuts:
        return self._cut.setdefault(min_radius, TrunkCuts(self.geometry, min_radius))

    def observe(
        self,
        sensor: Sensor,
        settings: Scene,
        progress: Progress | None = None,
        folder: Path = Path(),
        way: Way = None,
    ) -> Finding:
        """Run one sensor of a scene; with its ``way`` given, this touches no Blender data.

        folder : that files named in the settings are relative to.

        Raises
        ------
        ValueError : settings that this scene cannot serve; says what to change.
        """
        sensor, _ = choose(sensor)
        way = self.way(sensor, folder) if way is None else way
        if isinstance(sensor, Tractor):
            return tractor.drive(sensor, self.caster, progress)
        if isinstance(sensor, Scanner):
            return lidar.scan(sensor, self.caster, settings.seed, way, progress)
        if isinstance(sensor, Sonar):
            return self._listen(sensor, settings, progress, folder, way)
        return self._clap(sensor, settings, progress, folder)

    def warnings(self, sensor: Sensor, way: Way = None) -> tuple[str, ...]:
        """What a user would not want of where a sensor stands, in sentences: inside of a tree."""
        if isinstance(sensor, Reverb):
            pairs = np.concatenate(ends.ends_of(sensor, self.places).pairs)
            points = np.unique(pairs, axis=0)
        elif isinstance(sensor, Sonar) and isinstance(way, list):
            points = np.array([pose.position for pose in way])
        elif isinstance(way, Track):
            points = way.position[:1]  # where it starts
        elif isinstance(sensor, Mobile) and sensor.poses:
            points = np.array([sensor.poses[0].position])
        elif hasattr(sensor, "position"):
            points = np.array([sensor.position])
        else:
            return ()
        trees = tree_around(self.wood, points)
        return tuple(
            f"{sensor.name} stands inside tree {tree}, at "
            f"({', '.join(f'{v:g}' for v in points[trees == tree][0])}) m; move it out of the wood"
            for tree in np.unique(trees[trees >= 0]).tolist()
        )

    def audit(
        self,
        sensor: Sensor,
        settings: Scene,
        found: Finding,
        seconds: float,
        folder: Path = Path(),
        way: Way = None,
    ) -> Audit | None:
        """A random sample of a finding, computed again by the exact way; None where audits are off.

        seconds : that the finding took; the audit takes ``settings.accuracy.audit`` of it.
        """
        if settings.accuracy.audit == 0:
            return None
        sensor, _ = choose(sensor)
        way = self.way(sensor, folder) if way is None else way
        begin = time.perf_counter()
        made = self._audit(sensor, settings, found, seconds, folder, way)
        return replace(made, audit_seconds=time.perf_counter() - begin)

    def _audit(
        self,
        sensor: Sensor,
        settings: Scene,
        found: Finding,
        seconds: float,
        folder: Path,
        way: Way,
    ) -> Audit:
        share = settings.accuracy.audit
        rng = stream(settings.seed, "audit", sensor.name)
        if isinstance(sensor, Tractor):
            return audit_drive(sensor, self.caster, rng, seconds, share)
        if isinstance(sensor, Scanner):
            work = lidar.Scan(sensor, self.caster, settings.seed, way)
            return audit_scan(work, rng, seconds, share)
        if isinstance(sensor, Sonar):
            echoes = found.echoes if isinstance(found, flight.Flight) else (found,)
            casters = self.wood, self.caster if "extinction" in sensor.shading else None
            equipment = equip(sensor, folder)
            return audit_echoes(
                echoes, self.targets, sensor, settings.air, *casters, equipment, rng, seconds, share
            )
        between = ends.ends_of(sensor, self.places)
        pair = between.pairs[0]
        trunks = self.trunks_between(sensor, settings, between)(*pair)
        return audit_response(
            found,
            trunks,
            *pair,
            sensor,
            settings.air,
            self.expansions,
            rng,
            seconds,
            share,
            self._around(trunks, sensor, settings),
        )

    def _clap(
        self, sensor: Reverb, settings: Scene, progress: Progress | None, folder: Path
    ) -> reverb.ImpulseResponse:
        """Impulse responses between all ends."""
        between = ends.ends_of(sensor, self.places)
        return reverb.impulse_response(
            self.trunks_between(sensor, settings, between),
            sensor,
            settings.air,
            ends=between,
            directivity=directivity_of(sensor, folder),
            wood=self.wood,
            rng=stream(settings.seed, "reverb", sensor.name, "continuation"),
            field=(settings.forest.origin, settings.forest.size),
            expansions=self.expansions,
            progress=progress,
            canopy=self._canopy(sensor, settings),
            key=(settings.seed, "reverb", sensor.name),
            all_trunks=settings.accuracy.detail == "full",
        )

    def _around(self, trunks: slices.Trunks, sensor: Reverb, settings: Scene) -> Stand | None:
        """The stand that paths lose to, of a model ``forest``."""
        if sensor.model != "forest":
            return None
        field = (settings.forest.origin, settings.forest.size)
        return surroundings(trunks, sensor, field, self._canopy(sensor, settings)).stand

    def _canopy(self, sensor: Reverb, settings: Scene) -> Canopy:
        """Leaves and tops, as a model ``forest`` needs them."""
        if sensor.model != "forest":
            return BARE
        source, receiver = ends.ends_of(sensor, self.places).pairs[0]
        area = float(np.prod(settings.forest.size))
        return canopy_of(self.geometry, (float(source[2]), float(receiver[2])), area)

    def trunks_between(
        self, sensor: Reverb, settings: Scene, between: ends.Ends
    ) -> reverb.TrunksBetween:
        """Trunks of the scene, by source and receiver, and those that are stems only."""
        position, radius = plant_stems(settings.seed, settings.forest, settings.stems)
        stems = slices.Trunks(position, radius, np.full(len(radius), -1)).clear_of(
            between.on_ground
        )
        cuts = self._cuts(sensor.min_radius)
        return lambda source, receiver: cuts.between(source, receiver).joined(stems)

    @staticmethod
    def way(sensor: Sensor, folder: Path = Path()) -> Way:
        """Where a moving sensor goes, sampled from Blender's scene or read from a file; None: it stays.

        Raises
        ------
        ValueError : what it should follow, or the file of its route, is not there or cannot be used.
        """
        scene = bpy.context.scene
        if isinstance(sensor, Mobile):
            return path_of_object(scene, sensor)
        if isinstance(sensor, Sonar) and sensor.route:
            return read_route(find(sensor.route, folder, "route"), sensor.speed)
        if isinstance(sensor, Sonar) and sensor.follow:
            return follow(scene, sensor)
        return None

    def _listen(
        self,
        sensor: Sonar,
        settings: Scene,
        progress: Progress | None,
        folder: Path,
        poses: list[Pose] | None,
    ) -> sonar.Echo | flight.Flight:
        """One ping, or one from every pose of a route."""
        given = {
            "equipment": equip(sensor, folder),
            "everything": self.caster if "extinction" in sensor.shading else None,
        }
        wood = self.wood if "trunks" in sensor.shading else None
        if poses is None:
            return sonar.ping(self.targets, sensor, settings.air, wood, progress, **given)
        return flight.fly(self.targets, sensor, settings.air, poses, wood, progress, **given)
