"""A Blender scene that moves while it is sensed: where each instance is at any time, read frame by frame.

Time 0 is the first frame of the scene's range, as for what sensors follow. Objects are taken as they are
evaluated, with keys, drivers, parents, constraints and simulations. Between frames places are read as often
as it takes until what is interpolated is right to ``WITHIN``, at most ``HALVINGS`` halvings, fewer where
places would fill the memory. What changes its
shape is taken as it stands at the present frame, and named.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import bpy
import numpy as np

from ...sensing.rays.caster import RayCaster
from ...sensing.rays.geometry import SceneGeometry
from ...sensing.rays.moving import MovingCaster, RigidPath
from ...spec import SpecError
from ..read.depsgraph import read_places
from ..scene.nodes import in_full

WITHIN = 1e-5  # metres between an interpolated place and Blender's
HALVINGS = 4  # of a frame
MOST_FRAMES = 20_000
MOST_BYTES = 1_000_000_000  # of places at whole frames; of those between frames, twice as many
STANDS = 1e-7  # metres, and parts of a turn, that single precision may shake


def moving_caster(
    scene: SceneGeometry, seconds: float, make: Callable[[SceneGeometry], RayCaster]
) -> MovingCaster:
    """A caster of a scene whose instances are where Blender has them at each ray's time.

    scene : as it is evaluated at the present frame. seconds : that are looked at, from the first frame on.
    make : what makes a caster of a still scene.

    Raises
    ------
    SpecError : too many frames, or objects in them; objects appear or vanish meanwhile.
    """
    place = bpy.context.scene
    rate = place.render.fps / place.render.fps_base
    count = max(1, math.ceil(seconds * rate - 1e-9))
    if count > MOST_FRAMES:
        raise SpecError(
            "motion",
            f"lasts {count:,} frames of the scene; scan for at most {MOST_FRAMES / rate:g} s of it",
        )
    if (count + 1) * scene.transform.nbytes > MOST_BYTES:
        most = max(1, MOST_BYTES // scene.transform.nbytes - 1)
        raise SpecError(
            "motion",
            f"lasts {count:,} frames of a scene with {len(scene):,} objects, more than are kept; scan for at "
            f"most {most / rate:.3g} s of it",
        )
    now = place.frame_current_final
    reader = _PlacesInTime(scene, place.frame_start)
    try:
        frames = np.arange(count + 1, dtype=float)
        found = reader.at(frames)
        moves = _moves(found, scene)
        off = 0.0
        for _ in range(HALVINGS if moves.any() else 0):
            middle = (frames[:-1] + frames[1:]) / 2
            between = reader.at(middle)
            off = _off(frames / rate, found, middle / rate, between, moves, reader.reach)
            frames, found = _merged(frames, found, middle, between)
            moves = _moves(found, scene)
            if off < WITHIN or found.nbytes > MOST_BYTES:
                break
    finally:
        place.frame_set(math.floor(now), subframe=now - math.floor(now))
    time = frames / rate
    paths = {int(n): RigidPath(time, found[:, n]) for n in np.flatnonzero(moves)}
    return MovingCaster(scene, paths, make, off, tuple(sorted(reader.frozen)))


def seconds_of(place: bpy.types.Scene) -> float:
    """Seconds from the first frame of a scene's range to the present one."""
    rate = place.render.fps / place.render.fps_base
    return float((place.frame_current_final - place.frame_start) / rate)


class _PlacesInTime:
    """Transforms of a scene's instances at frames, counted from the first one of its range."""

    def __init__(self, scene: SceneGeometry, first: int) -> None:
        self._scene, self._first = scene, first
        size = [float(np.linalg.norm(np.abs(mesh.vertices).max(axis=0))) for mesh in scene.meshes]
        self.reach = np.array(size)[scene.mesh_index] if size else np.zeros(0)
        self._shape: dict[str, np.ndarray] | None = None
        self.frozen: set[str] = set()

    def at(self, frames: np.ndarray) -> np.ndarray:
        """(K, I, 3, 4) at frames (K,)."""
        place = bpy.context.scene
        found = np.empty((len(frames), len(self._scene), 3, 4))
        for row, frame in enumerate((self._first + frames).tolist()):
            place.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
            depsgraph = bpy.context.evaluated_depsgraph_get()
            with in_full(depsgraph):
                transform, names = read_places(depsgraph)
                if frame.is_integer():  # at every sample it would be a third of the reading
                    self._look_at_shapes(depsgraph)
            if len(transform) != len(self._scene) or names != self._scene.object_name:
                raise SpecError(
                    "motion",
                    f"objects appear or vanish by frame {frame:g}; keep them in the scene, or scan a part of "
                    "the time",
                )
            found[row] = transform
        return found

    def _look_at_shapes(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note what changes its shape: whose box, in its own space, is another one."""
        shape = {
            thing.name: np.array([corner[:] for corner in thing.bound_box])
            for thing in depsgraph.objects
            if thing.type in ("MESH", "CURVE", "SURFACE", "META", "FONT")
        }
        if self._shape is None:
            self._shape = shape
            return
        for name, box in shape.items():
            known = self._shape.get(name)
            if known is not None and np.abs(known - box).max(initial=0.0) > STANDS * (
                1 + np.abs(box).max()
            ):
                self.frozen.add(name)


def _moves(found: np.ndarray, scene: SceneGeometry) -> np.ndarray:
    """(I,) bool, instances that are not always where the scene says."""
    if not len(scene):
        return np.zeros(0, bool)
    apart = np.abs(found - scene.transform[None]).max(axis=(0, 2, 3))
    return np.asarray(apart > STANDS * (1 + np.abs(scene.transform).max(axis=(1, 2))))


def _off(
    time: np.ndarray,
    found: np.ndarray,
    middle: np.ndarray,
    between: np.ndarray,
    moves: np.ndarray,
    reach: np.ndarray,
) -> float:
    """Metres at most by which what is interpolated between samples is not where Blender has it."""
    worst = 0.0
    for number in np.flatnonzero(moves).tolist():
        apart = RigidPath(time, found[:, number]).at(middle) - between[:, number]
        far = np.linalg.norm(apart[:, :, 3], axis=1)
        turned = np.linalg.norm(apart[:, :, :3], ord=2, axis=(1, 2)) * reach[number]
        worst = max(worst, float((far + turned).max(initial=0.0)))
    return worst


def _merged(
    frames: np.ndarray, found: np.ndarray, middle: np.ndarray, between: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Samples and those between them, in order."""
    every = np.concatenate([frames, middle])
    order = np.argsort(every)
    return every[order], np.concatenate([found, between])[order]
