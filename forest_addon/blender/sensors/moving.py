"""Motion in a Blender scene: what sensors follow, and where each instance is at any time.

An object's X axis is forward and its Z axis up, as the arrows of our sensors show; it is taken as it is
evaluated, with constraints, parents and drivers. A curve counts as its line, whatever its bevel; a curve that
is animated itself counts as an object.

For sensors that look while a scene moves it is read frame by frame. Time 0 is the first frame of its range.
Objects are taken as they are evaluated, with keys, drivers, parents, constraints, simulations and all that
changes their shape. Between frames they are read as often as it takes until what is interpolated is right to
``WITHIN``, and points of what changes its shape to ``BENT``; at most ``HALVINGS`` halvings, fewer where
samples would fill the memory.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ...base.trimesh import TriMesh
from ...sensing.rays.geometry import SceneGeometry
from ...sensing.rays.paths import SceneMotion
from ...sensing.rays.tracks import BENT, AppearingObjects, SceneSample, Tracks
from ...sensing.trajectory import Trajectory, moving
from ...spec import SpecError
from ..read.depsgraph import read_sample
from ..scene.nodes import in_full

HALF = 0.5  # frames before and after, between which a velocity is taken; and those twice as far
ALIKE = 0.1  # share by which both may differ and be of one smooth motion


class SceneFollower:
    """Objects and curves of a Blender scene, see ``trajectory.Follower``."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self._scene = scene

    def curve(self, name: str) -> np.ndarray | None:
        """(K, 3) world points of a curve's first spline, at its own resolution; None of other objects."""
        obj = self._thing(name)
        return curve_points(obj) if _is_line(obj) else None

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
                ways = (-2 * HALF, -HALF, HALF, 2 * HALF)
                behind, a, b, ahead = (self._matrices(name, frames + w)[:, :3, 3] for w in ways)
                near, far = (b - a) * (rate / (2 * HALF)), (ahead - behind) * (rate / (4 * HALF))
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
        obj = self._scene.objects.get(name)
        if obj is not None:
            return obj
        shown = (t.name for t in self._scene.objects if t.type in ("CURVE", "EMPTY"))
        near = ", ".join(sorted(shown)[:8])
        known = f"; curves and empties here: {near}" if near else ""
        raise SpecError("follow", f'there is no object "{name}" in this scene{known}')

    def _matrices(self, name: str, frames: np.ndarray) -> np.ndarray:
        """(K, 4, 4) of an object as it is evaluated at frames (K,)."""
        matrices = []
        for frame in frames.tolist():
            self._scene.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
            depsgraph = bpy.context.evaluated_depsgraph_get()
            obj = self._scene.objects[name].evaluated_get(depsgraph)
            matrices.append(np.array(obj.matrix_world, dtype=np.float64))
        return np.array(matrices).reshape(-1, 4, 4)


class Forecast(SceneFollower):
    """The same for estimates: curves as long, but straight; objects that stay.

    Nothing of Blender's is written or evaluated, which it forbids while it draws.
    """

    def curve(self, name: str) -> np.ndarray | None:
        """(2, 3) points as far apart as a curve's first spline is long; None of other objects."""
        obj = self._thing(name)
        if not _is_line(obj):
            return None
        size = np.cbrt(abs(obj.matrix_world.to_3x3().determinant()))
        length = size * sum(spline.calc_length() for spline in obj.data.splines[:1])
        return np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]])

    def motion(self, name: str, count: int | None = None) -> Trajectory:
        """Poses of an object, ``count`` or as many as it has."""
        self._thing(name)
        first, last, rate = self._range
        frames = np.linspace(first, last, count or last - first + 1)
        return moving((frames - first) / rate, np.tile(np.eye(4), (len(frames), 1, 1)))


def _is_line(obj: bpy.types.Object) -> bool:
    """Return whether an object is a curve that does not move."""
    return obj.type == "CURVE" and obj.animation_data is None


def curve_points(obj: bpy.types.Object) -> np.ndarray:
    """(K, 3) world points of a curve's first spline, at its own resolution; of a closed one the last is the
    first.
    """
    bare = obj.data.copy()
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
    matrix = np.array(obj.matrix_world, dtype=np.float64)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


WITHIN = 1e-5  # metres between an interpolated place and Blender's
HALVINGS = 4  # of a frame
PROBES = 8  # steps looked into
SHARE = 0.3819660113  # of a step, where: turns that halves cannot tell apart differ there
MOST_FRAMES = 20_000
MOST_BYTES = 1_000_000_000  # of samples at whole frames; of those between frames, twice as many


def read_motion(
    scene: SceneGeometry, seconds: float, begin: float = 0.0
) -> tuple[SceneGeometry, SceneMotion]:
    """The scene with the instances that it has besides at other times, and how they move.

    scene : as it is evaluated at the present frame. seconds : that are looked at, from ``begin`` s after the
    first frame on.

    Raises
    ------
    SpecError : too many frames, or too much in them; objects that are not there now are meanwhile.
    """
    place = bpy.context.scene
    rate = place.render.fps / place.render.fps_base
    first = math.floor(begin * rate + 1e-9)
    count = max(1, math.ceil((begin + seconds) * rate - 1e-9) - first)
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
    with _SceneInTime(place) as reader:
        frames = first + np.arange(count + 1, dtype=float)
        samples = reader.at(frames)
        now = reader.now()
        tracks = _tracks(scene, now, frames / rate, samples)
        off, bent = 0.0, 0.0
        steps = 1  # of a frame
        moves = tracks.moves or max(_probed(scene, now, frames / rate, samples, reader, rate)) > 0
        while moves and steps < 2**HALVINGS:
            coarse, steps = tracks, 2 * steps
            middle = (frames[:-1] + frames[1:]) / 2
            between = reader.at(middle)
            off, bent = tracks.off(middle / rate, between)
            frames = np.linspace(first, first + count, 2 * len(middle) + 1)
            pairs = zip(samples[:-1], between, strict=True)
            samples = [*(one for pair in pairs for one in pair), samples[-1]]
            tracks = _tracks(scene, now, frames / rate, samples)
            if sum(sample.nbytes for sample in samples) > MOST_BYTES:
                break
            if off < WITHIN and bent < BENT and not tracks.breaks(steps):
                off, bent = _probed(scene, now, frames / rate, samples, reader, rate)
                if off < WITHIN and bent < BENT:
                    break
        else:
            if moves:  # samples are now close enough to tell a jump from what is fast
                tracks = _tracks(scene, now, frames / rate, samples, jumps=True)
                both = tracks.joined[::2] & tracks.joined[1::2]
                off, bent = coarse.off(middle / rate, between, both)
                off_by = _probed(scene, now, frames / rate, samples, reader, rate, tracks)
                off, bent = max(off, off_by[0]), max(bent, off_by[1])
    return tracks.motion(off, bent, steps)


def _probed(
    scene: SceneGeometry,
    now: SceneSample,
    time: np.ndarray,
    samples: list[SceneSample],
    reader: _SceneInTime,
    rate: float,
    finest: Tracks | None = None,
) -> tuple[float, float]:
    """Metres by which places and points are off in some of the steps, aside of their middle.

    finest : of all samples; what jumps in them does not count.
    """
    off, bent = 0.0, 0.0
    for first in np.unique(np.linspace(0, len(time) - 2, PROBES).astype(int)).tolist():
        ends = slice(first, first + 2)
        when = time[first] + SHARE * np.diff(time[ends])
        pair = _tracks(scene, now, time[ends], samples[ends])
        steady = None if finest is None else finest.joined[[first]]
        pair_off = pair.off(when, reader.at(when * rate), steady)
        off, bent = max(off, pair_off[0]), max(bent, pair_off[1])
    return off, bent


def _tracks(
    scene: SceneGeometry,
    now: SceneSample,
    time: np.ndarray,
    samples: list[SceneSample],
    jumps: bool = False,
) -> Tracks:
    try:
        return Tracks(scene, now, time, samples, jumps)
    except AppearingObjects as found:
        some = ", ".join(f'"{name}"' for name in found.names[:3])
        raise SpecError(
            "motion",
            f"{some} appear during the scan and are not there at the present frame; go to a frame where all "
            "are shown, or scan a part of the time",
        ) from None


def seconds_of(place: bpy.types.Scene) -> float:
    """Seconds from the first frame of a scene's range to the present one."""
    rate = place.render.fps / place.render.fps_base
    return float((place.frame_current + place.frame_subframe - place.frame_start) / rate)


class _SceneInTime:
    """Samples of a scene at frames, counted from the first one of its range; it ends at the present frame."""

    def __init__(self, place: bpy.types.Scene) -> None:
        self._place = place  # its frame_current_final would be one that is mapped in time already
        self._frame = place.frame_current + place.frame_subframe
        self._changing: set[str] = set()
        self._known: dict[str, TriMesh] = {}

    def __enter__(self) -> _SceneInTime:
        bpy.app.handlers.frame_change_post.append(self._note)
        return self

    def __exit__(self, *_: object) -> None:
        bpy.app.handlers.frame_change_post.remove(self._note)
        self._go(self._frame)

    def at(self, frames: np.ndarray) -> list[SceneSample]:
        """Samples at frames (K,)."""
        taken: list[SceneSample] = []
        full = 0
        for frame in (self._place.frame_start + frames).tolist():
            self._go(frame)
            taken.append(self._read())
            full += taken[-1].nbytes
            if full > MOST_BYTES:
                raise SpecError(
                    "motion",
                    f"fills the memory by frame {frame:g}, as what changes its shape is kept for every "
                    "frame; scan for a shorter time, or apply its modifiers",
                )
        return taken

    def now(self) -> SceneSample:
        """A sample of the present frame."""
        self._go(self._frame)
        return self._read()

    def _go(self, frame: float) -> None:
        self._place.frame_set(math.floor(frame), subframe=frame - math.floor(frame))

    def _read(self) -> SceneSample:
        depsgraph = bpy.context.evaluated_depsgraph_get()
        with in_full(depsgraph):
            return read_sample(depsgraph, self._changing, self._known)

    def _note(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Note whose shape Blender has made anew for a frame."""
        for update in depsgraph.updates:
            if update.is_updated_geometry and isinstance(update.id, bpy.types.Object):
                self._changing.add(update.id.name_full)
