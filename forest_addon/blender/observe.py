"""Sensors in a Blender scene: read the evaluated depsgraph once, then look and listen in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import bpy

from ..formats.sonar_files import equip, find, read_route
from ..rng import stream
from ..sensing import flight, lidar, reverb, slices, sonar
from ..sensing.poses import Pose
from ..spec import Reverb, Scene, Sensor, Sonar, Terrestrial, Tractor
from .bvh import BvhCaster
from .depsgraph import read_scene
from .motion import follow

Progress = Callable[[int, int], None]
Finding = lidar.TractorScan | lidar.Cloud | sonar.Echo | flight.Flight | reverb.ImpulseResponse


class Observer:
    """An evaluated scene as arrays, with the casters and scatterers that sensors need, made once."""

    def __init__(self, depsgraph: bpy.types.Depsgraph) -> None:
        self.geometry = read_scene(depsgraph)

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

    @cached_property
    def targets(self) -> sonar.Targets:
        """Everything that sounds back to a sonar."""
        return sonar.Targets(self.geometry)

    def trunks(self, sensor: Reverb) -> slices.Trunks:
        """Trunks where the height between source and receiver cuts them."""
        height = (sensor.source[2] + sensor.receiver[2]) / 2
        return slices.trunks_at_height(self.geometry, height, sensor.min_radius)

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
            return self._listen(sensor, settings, progress, folder)
        return reverb.impulse_response(
            self.trunks(sensor),
            sensor,
            settings.air,
            wood=self.wood,
            rng=stream(settings.seed, "reverb", sensor.name, "continuation"),
            field=(settings.forest.origin, settings.forest.size),
            progress=progress,
        )

    def _listen(
        self, sensor: Sonar, settings: Scene, progress: Progress | None, folder: Path
    ) -> sonar.Echo | flight.Flight:
        """One ping, or one from every pose of a route."""
        given = {
            "equipment": equip(sensor, folder),
            "everything": self.caster if "extinction" in sensor.shading else None,
        }
        wood = self.wood if "trunks" in sensor.shading else None
        poses = self._poses(sensor, folder)
        if poses is None:
            return sonar.ping(self.targets, sensor, settings.air, wood, progress, **given)
        return flight.fly(self.targets, sensor, settings.air, poses, wood, progress, **given)

    def _poses(self, sensor: Sonar, folder: Path) -> list[Pose] | None:
        if sensor.route:
            return read_route(find(sensor.route, folder, "route"), sensor.speed)
        return follow(bpy.context.scene, sensor) if sensor.follow else None
