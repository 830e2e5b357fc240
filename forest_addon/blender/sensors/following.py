"""Trajectories of animated objects and curves of a Blender scene, for sensors that follow them.

An object's X axis is forward and its Z axis up, as the arrows of our sensors show; it is taken as it is
evaluated, with constraints, parents and drivers. A curve counts as its line, whatever its bevel; a curve that
is animated itself counts as an object.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...sensing.trajectory import Trajectory, moving
from ...spec import SpecError

HALF = 0.5  # frames before and after, between which a velocity is taken; and those twice as far
ALIKE = 0.1  # share by which both may differ and be of one smooth motion


class SceneFollower:
    """Objects and curves of a Blender scene, see ``trajectory.Follower``."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._scene = scene

    def curve(self, name: str) -> np.ndarray | None:
        """(K, 3) world points of a curve's first spline, at its own resolution; None of other objects."""
        thing = self._thing(name)
        return curve_points(thing) if _is_line(thing) else None

    def motion(self, name: str, count: int | None = None) -> Trajectory:
        """The poses of an object over the scene's frames; what it passes stands as at the present frame.

        count : poses evenly over the frames, with velocities; None: one at every frame.
        """
        self._thing(name)
        scene = self._scene
        now = scene.frame_current + scene.frame_subframe
        first, last, rate = self._range
        try:
            if count is None:
                frames, velocity = np.arange(first, last + 1, dtype=float), None
                matrix = self._matrices(name, frames)
            else:
                frames = np.linspace(first, last, count)
                matrix = self._matrices(name, frames)
                near, far = (
                    (self._places(name, frames + way) - self._places(name, frames - way))
                    * (rate / (2 * way))
                    for way in (HALF, 2 * HALF)
                )
                better = (4 * near - far) / 3  # Richardson; where they part, a motion breaks
                velocity = np.where(np.abs(near - far) <= ALIKE * np.abs(near), better, near)
        finally:
            scene.frame_set(math.floor(now), subframe=now - math.floor(now))
        try:
            return moving((frames - first) / rate, matrix, velocity)
        except ValueError as problem:
            raise SpecError("follow", f'"{name}" {problem}') from None

    @property
    def _range(self) -> tuple[int, int, float]:
        """The first and the last frame, and frames a second."""
        scene = self._scene
        return scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base

    def _thing(self, name: str) -> bpy.types.Object:
        thing = self._scene.objects.get(name)
        if thing is not None:
            return thing
        shown = (t.name for t in self._scene.objects if t.type in ("CURVE", "EMPTY"))
        near = ", ".join(sorted(shown)[:8])
        known = f"; curves and empties here: {near}" if near else ""
        raise SpecError("follow", f'there is no object "{name}" in this scene{known}')

    def _places(self, name: str, frames: np.ndarray) -> np.ndarray:
        return self._matrices(name, frames)[:, :3, 3]

    def _matrices(self, name: str, frames: np.ndarray) -> np.ndarray:
        """(K, 4, 4) of an object as it is evaluated at frames (K,)."""
        found = []
        for frame in frames.tolist():
            self._scene.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
            depsgraph = bpy.context.evaluated_depsgraph_get()
            thing = self._scene.objects[name].evaluated_get(depsgraph)
            found.append(np.array(thing.matrix_world, dtype=np.float64))
        return np.array(found).reshape(-1, 4, 4)


class Forecast(SceneFollower):
    """The same for estimates: curves as long, but straight; objects that stay.

    Nothing of Blender's is written or evaluated, which it forbids while it draws.
    """

    def curve(self, name: str) -> np.ndarray | None:
        """(2, 3) points as far apart as a curve's first spline is long; None of other objects."""
        thing = self._thing(name)
        if not _is_line(thing):
            return None
        size = np.cbrt(abs(thing.matrix_world.to_3x3().determinant()))
        length = size * sum(spline.calc_length() for spline in thing.data.splines[:1])
        return np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]])

    def motion(self, name: str, count: int | None = None) -> Trajectory:
        """As many poses as an object has."""
        self._thing(name)
        first, last, rate = self._range
        frames = np.linspace(first, last, count or last - first + 1)
        return moving((frames - first) / rate, np.tile(np.eye(4), (len(frames), 1, 1)))


def _is_line(thing: bpy.types.Object) -> bool:
    """Return whether an object is a curve that does not move."""
    return thing.type == "CURVE" and thing.animation_data is None


def curve_points(thing: bpy.types.Object) -> np.ndarray:
    """(K, 3) world points of a curve's first spline, at its own resolution; of a closed one the last is the
    first.
    """
    bare = thing.data.copy()
    bare.bevel_depth = bare.extrude = bare.offset = 0.0
    bare.bevel_object = bare.taper_object = None
    bare.bevel_mode = "ROUND"
    for spline in list(bare.splines)[1:]:
        bare.splines.remove(spline)
    probe = bpy.data.objects.new("path", bare)
    try:
        mesh = probe.to_mesh()
        local = np.empty(3 * (len(mesh.vertices) if mesh else 0), dtype=np.float32)
        if len(local):
            mesh.vertices.foreach_get("co", local)
        closed = bool(len(bare.splines)) and bare.splines[0].use_cyclic_u
    finally:
        probe.to_mesh_clear()
        bpy.data.objects.remove(probe)
        bpy.data.curves.remove(bare)
    points = local.reshape(-1, 3).astype(np.float64)
    if closed:
        points = np.concatenate([points, points[:1]])
    matrix = np.array(thing.matrix_world, dtype=np.float64)
    return points @ matrix[:3, :3].T + matrix[:3, 3]
