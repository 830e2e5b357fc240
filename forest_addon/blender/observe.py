"""Sensors in a Blender scene: read the evaluated depsgraph once, then look and listen in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import bpy
import numpy as np

from ..formats.directivity_file import directivity_of
from ..rng import stream
from ..sensing import ends, lidar, reverb, slices, sonar
from ..sensing.fast_scattering import Expansions
from ..sensing.trunk_cuts import TrunkCuts
from ..spec import Reverb, Scene, Sensor, Sonar, Terrestrial, Tractor
from ..stand.stems import plant_stems
from .bvh import BvhCaster
from .depsgraph import read_scene

Progress = Callable[[int, int], None]
ENDS = {"SPEAKER", "EMPTY", "CAMERA"}  # what can be a source or a receiver
Finding = lidar.TractorScan | lidar.Cloud | sonar.Echo | reverb.ImpulseResponse


class Observer:
    """An evaluated scene as arrays, with the casters and scatterers that sensors need, made once."""

    def __init__(
        self, depsgraph: bpy.types.Depsgraph, expansions: Expansions | None = None
    ) -> None:
        self.geometry = read_scene(depsgraph)
        self.places = {
            thing.name: tuple(thing.matrix_world.translation)
            for thing in depsgraph.objects
            if thing.type in ENDS
        }
        self.expansions = Expansions() if expansions is None else expansions
        self._cut: dict[float, TrunkCuts] = {}

    @cached_property
    def caster(self) -> BvhCaster:
        """Rays that meet everything."""
        return BvhCaster(self.geometry)

    @cached_property
    def wood(self) -> BvhCaster:
        """Rays that pass leaves: lines of sight of sound."""
        return BvhCaster(self.geometry.solid())

    @cached_property
    def discs(self) -> sonar.LeafDiscs:
        """Every leaf as a disc."""
        return sonar.leaf_discs(self.geometry)

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
    ) -> Finding:
        """Run one sensor of a scene.

        folder : that files named in the settings are relative to.

        Raises
        ------
        ValueError : settings that this scene cannot serve; says what to change.
        """
        if isinstance(sensor, Tractor):
            return lidar.drive(sensor, self.caster, progress)
        if isinstance(sensor, Terrestrial):
            return lidar.sweep(sensor, self.caster, progress)
        if isinstance(sensor, Sonar):
            return sonar.ping(self.discs, sensor, settings.air, self.wood, progress)
        return self._clap(sensor, settings, progress, folder)

    def _clap(
        self, sensor: Reverb, settings: Scene, progress: Progress | None, folder: Path
    ) -> reverb.ImpulseResponse:
        """Impulse responses between all ends, by trunks of the scene and by those that are stems only."""
        between = ends.ends_of(sensor, self.places)
        position, radius = plant_stems(settings.seed, settings.forest, settings.stems)
        stems = slices.Trunks(position, radius, np.full(len(radius), -1)).clear_of(
            between.on_ground
        )
        cuts = self._cuts(sensor.min_radius)
        return reverb.impulse_response(
            lambda source, receiver: cuts.between(source, receiver).joined(stems),
            sensor,
            settings.air,
            ends=between,
            directivity=directivity_of(sensor, folder),
            wood=self.wood,
            rng=stream(settings.seed, "reverb", sensor.name, "continuation"),
            field=(settings.forest.origin, settings.forest.size),
            expansions=self.expansions,
            progress=progress,
        )
