"""Sensors in a Blender scene: read the evaluated depsgraph once, then look and listen in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import bpy

from ..rng import stream
from ..sensing import lidar, reverb, slices, sonar, tractor
from ..sensing.cloud import Cloud
from ..sensing.rays import RayCaster
from ..spec import Mobile, Rays, Reverb, Scanner, Scene, Sensor, Sonar, Tractor
from .casters import make_caster
from .depsgraph import read_scene
from .kept import kept
from .nodes import in_full
from .platform import path_of_object

Progress = Callable[[int, int], None]
Finding = tractor.TractorScan | Cloud | sonar.Echo | reverb.ImpulseResponse


class Observer:
    """An evaluated scene as arrays, with the casters and scatterers that sensors need, made once."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, rays: Rays | None = None) -> None:
        with in_full(depsgraph):
            self.geometry = read_scene(depsgraph)
        self._rays = rays or Rays()

    @classmethod
    def of(cls, depsgraph: bpy.types.Depsgraph, rays: Rays) -> Observer:
        """The observer of before, with all it has made, as long as nothing changes."""
        return kept(depsgraph, cls, rays)

    @cached_property
    def caster(self) -> RayCaster:
        """Rays that meet everything."""
        return make_caster(self.geometry, self._rays)

    @cached_property
    def wood(self) -> RayCaster:
        """Rays that pass leaves: lines of sight of sound."""
        return make_caster(self.geometry.solid(), self._rays)

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
            return tractor.drive(sensor, self.caster, progress)
        if isinstance(sensor, Scanner):
            path = path_of_object(bpy.context.scene, sensor) if isinstance(sensor, Mobile) else None
            return lidar.scan(sensor, self.caster, settings.seed, path, progress)
        if isinstance(sensor, Sonar):
            return sonar.ping(self.discs, sensor, settings.air, self.wood, progress)
        return reverb.impulse_response(
            self.trunks(sensor),
            sensor,
            settings.air,
            wood=self.wood,
            rng=stream(settings.seed, "reverb", sensor.name, "continuation"),
            field=(settings.forest.origin, settings.forest.size),
            progress=progress,
        )
