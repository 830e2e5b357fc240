"""The way of a moving scanner: an animated object's poses, frame by frame, or a curve's line.

An object's X axis is forward and its Z axis up. A curve is followed at an even speed from its start,
whatever its bevel; a curve that is animated itself counts as an object.
"""

from __future__ import annotations

import bpy
import numpy as np
from scipy.spatial.transform import Rotation

from ...sensing.lidar.trajectory import Path, path_along
from ...spec import Mobile, SpecError


def path_of_object(scene: bpy.types.Scene, scanner: Mobile) -> Path | None:
    """The way of the object that a scanner follows; None where it follows none.

    Raises
    ------
    SpecError : there is no such object, or it goes nowhere.
    """
    if not scanner.follow:
        return None
    thing = scene.objects.get(scanner.follow)
    if thing is None:
        near = ", ".join(sorted(t.name for t in scene.objects if t.type in ("CURVE", "EMPTY"))[:8])
        known = f"; curves and empties here: {near}" if near else ""
        raise SpecError("follow", f'there is no object "{scanner.follow}" in this scene{known}')
    if thing.type == "CURVE" and thing.animation_data is None:
        points = curve_points(thing)
        try:
            return path_along(points, scanner.speed)
        except ValueError:
            raise SpecError("follow", f'the curve "{thing.name}" has no length') from None
    return animated_path(scene, thing)


def curve_points(thing: bpy.types.Object) -> np.ndarray:
    """(K, 3) world points of the first spline of a curve, at its own resolution."""
    bare = thing.data.copy()
    bare.bevel_depth = bare.extrude = bare.offset = 0.0
    bare.bevel_object = bare.taper_object = None
    bare.bevel_mode = "ROUND"
    for spline in list(bare.splines)[1:]:
        bare.splines.remove(spline)
    probe = bpy.data.objects.new("path", bare)
    try:
        mesh = probe.to_mesh()
        local = np.empty(3 * len(mesh.vertices), dtype=np.float32)
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


def animated_path(scene: bpy.types.Scene, thing: bpy.types.Object) -> Path:
    """The poses of an object at every frame of the scene; what it passes stands as at the present frame.

    Raises
    ------
    SpecError : its scale is zero, so that it has no direction.
    """
    now, part_of_frame = scene.frame_current, scene.frame_subframe
    frames = range(scene.frame_start, scene.frame_end + 1)
    matrices = []
    try:
        for frame in frames:
            scene.frame_set(frame)
            depsgraph = bpy.context.evaluated_depsgraph_get()
            matrices.append(np.array(thing.evaluated_get(depsgraph).matrix_world, dtype=np.float64))
    finally:
        scene.frame_set(now, subframe=part_of_frame)
    matrix = np.array(matrices)
    if np.any(np.abs(np.linalg.det(matrix[:, :3, :3])) < 1e-12):
        raise SpecError("follow", f'"{thing.name}" has a scale of zero; give it a size')
    forward = matrix[:, :3, 0] / np.linalg.norm(matrix[:, :3, 0], axis=1, keepdims=True)
    left = np.cross(matrix[:, :3, 2], forward)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    axes = np.stack([forward, left, np.cross(forward, left)], axis=2)
    rate = scene.render.fps / scene.render.fps_base
    return Path(np.arange(len(frames)) / rate, matrix[:, :3, 3], Rotation.from_matrix(axes))
