"""Poses of a sonar that moves with something in Blender: an animated object, or along a curve.

An object is sampled evenly over the scene's frames, as it is evaluated: constraints, parents, drivers.
The beam looks along its X axis, up is its Z, as the arrows of our sensors show. A curve is flown from
its start to its end; the beam looks along it and stays level, or as the settings turn it from there.
"""

from __future__ import annotations

import math
from dataclasses import replace

import bpy
import numpy as np

from ...sensing.sonar.poses import Pose, along
from ...spec import Sonar, SpecError


def follow(scene: bpy.types.Scene, sonar: Sonar) -> list[Pose]:
    """The poses along what a sonar follows.

    Raises
    ------
    SpecError : there is no such object, or its curve has no length.
    """
    thing = scene.objects.get(sonar.follow)
    if thing is None:
        raise SpecError(
            "follow", f'there is no object "{sonar.follow}" in the scene; check the name'
        )
    if thing.type == "CURVE":
        return _along_curve(thing, sonar)
    return _over_frames(scene, sonar)


def _over_frames(scene: bpy.types.Scene, sonar: Sonar) -> list[Pose]:
    """Poses of an animated object; its velocity is that of the animation."""
    frames = np.linspace(scene.frame_start, scene.frame_end, sonar.poses)
    now = scene.frame_current_final
    try:
        matrices = np.array([_matrix(scene, sonar.follow, frame) for frame in frames])
        step = 0.5
        ahead, behind = (
            np.array([_matrix(scene, sonar.follow, frame + way)[:3, 3] for frame in frames])
            for way in (step, -step)
        )
    finally:
        scene.frame_set(math.floor(now), subframe=now - math.floor(now))
    rate = scene.render.fps / scene.render.fps_base
    velocity = (ahead - behind) * rate / (2 * step)
    poses = []
    for matrix, towards in zip(matrices, velocity, strict=True):
        forward, up = matrix[:3, 0], matrix[:3, 2]
        forward = forward / np.linalg.norm(forward)
        left = np.cross(up, forward)
        left /= np.linalg.norm(left)
        frame = np.array([forward, left, np.cross(forward, left)])
        poses.append(Pose(matrix[:3, 3].copy(), frame, towards))
    return poses


def _matrix(scene: bpy.types.Scene, name: str, frame: float) -> np.ndarray:
    """(4, 4) of an object as it is evaluated at a frame."""
    scene.frame_set(math.floor(frame), subframe=float(frame - math.floor(frame)))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return np.array(scene.objects[name].evaluated_get(depsgraph).matrix_world)


def _points(curve: bpy.types.Object) -> np.ndarray:
    """(N, 3) points of an evaluated curve in its local space."""
    mesh = curve.to_mesh()
    try:
        points = np.empty(3 * (len(mesh.vertices) if mesh else 0), dtype=np.float32)
        if len(points):
            mesh.vertices.foreach_get("co", points)
    finally:
        curve.to_mesh_clear()
    return points.reshape(-1, 3).astype(np.float64)


def _along_curve(thing: bpy.types.Object, sonar: Sonar) -> list[Pose]:
    """Poses evenly along the first spline of a curve."""
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = _points(evaluated)
    splines = thing.data.splines
    if len(splines) and splines[0].use_cyclic_u and len(points):
        points = np.concatenate([points, points[:1]])
    matrix = np.array(evaluated.matrix_world)
    points = points @ matrix[:3, :3].T + matrix[:3, 3]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if len(points) < 2 or not length[-1] > 0:
        raise SpecError("follow", f'the curve "{thing.name}" has no length; draw it, without bevel')

    closed = splines[0].use_cyclic_u
    place = np.linspace(0.0, length[-1], sonar.poses, endpoint=not closed)
    position = np.stack([np.interp(place, length, axis) for axis in points.T], axis=1)
    small = 1e-3 * length[-1]
    ahead, behind = np.minimum(place + small, length[-1]), np.maximum(place - small, 0.0)
    step = np.stack(
        [np.interp(ahead, length, a) - np.interp(behind, length, a) for a in points.T], axis=1
    )
    azimuth = np.arctan2(step[:, 1], step[:, 0]) + math.radians(sonar.azimuth_deg)
    elevation = np.arctan2(step[:, 2], np.hypot(step[:, 0], step[:, 1]))
    elevation = np.clip(elevation + math.radians(sonar.elevation_deg), -math.pi / 2, math.pi / 2)
    way = step / np.linalg.norm(step, axis=1, keepdims=True)
    poses = along(position, azimuth, elevation)
    return [replace(pose, velocity=sonar.speed * v) for pose, v in zip(poses, way, strict=True)]
