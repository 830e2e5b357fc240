"""Sensors in a Blender scene: read the evaluated depsgraph once, then look and listen in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import bpy

from ..rng import stream
from ..sensing import lidar, reverb, slices, sonar
from ..sensing.fast_scattering import Expansions
from ..spec import Reverb, Scene, Sensor, Sonar, Terrestrial, Tractor
from .bvh import BvhCaster
from .depsgraph import read_scene

Progress = Callable[[int, int], None]
Finding = lidar.TractorScan | lidar.Cloud | sonar.Echo | reverb.ImpulseResponse


class Observer:
    """An evaluated scene as arrays, with the casters and scatterers that sensors need, made once."""

    def __init__(
        self, depsgraph: bpy.types.Depsgraph, expansions: Expansions | None = None
    ) -> None:
        self.geometry = read_scene(depsgraph)
        self.expansions = Expansions() if expansions is None else expansions

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
        """Trunks where the height between source and receiver cuts them."""
        height = (sensor.source[2] + sensor.receiver[2]) / 2
        return slices.trunks_at_height(self.geometry, height, sensor.min_radius)

    def observe(self, sensor: Sensor, settings: Scene, progress: Progress | None = None) -> Finding:
        """Run one sensor of a scene.

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
        return reverb.impulse_response(
            self.trunks(sensor),
            sensor,
            settings.air,
            wood=self.wood,
            rng=stream(settings.seed, "reverb", sensor.name, "continuation"),
            field=(settings.forest.origin, settings.forest.size),
            expansions=self.expansions,
            progress=progress,
        )
