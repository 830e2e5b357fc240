"""The scene as the sensors see it: unique meshes in local space, and where each instance stands.

``blender/depsgraph`` fills it from the evaluated scene. Meshes stay local and transforms float64, so
that a forest costs the memory of its variants and a hit can be refined to float64 far from the origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ...base.trimesh import TriMesh
from .boxes import morton

OF_INSTANCES = (
    *("transform", "mesh_index", "tree", "species", "object_index", "reflectance", "optics"),
)
OF_MESHES = ("slot_reflectance", "asset", "slot_names", "slot_optics")
PIECES = 64  # boxes that a mesh is bounded by
COARSE = 15  # bits of a place along the curve of 30 that do not matter: what is left is sorted by its digits
BOXES = 1_000_000  # of all its instances together, so that memory stays small


@dataclass(frozen=True)
class SceneGeometry:
    """I instances of unique meshes.

    meshes : unique meshes, each in its local space.
    transform : (I, 3, 4) float64, local to world.
    mesh_index : (I,) int64, which of ``meshes``.
    object_name : names of the objects that the instances come from.
    tree : (I,) int64, tree id, -1 where the instance is no tree.
    species : (I,) int64, species number, -1 where the instance is no tree.
    object_index : (I,) int64, which of ``object_name``; left out: each instance has a name of its own.
    reflectance : (I,) of the object, NaN where it says nothing; left out: nowhere.
    slot_reflectance : for each mesh (S,) of its material slots, NaN likewise; left out: nowhere.
    asset : for each mesh which tree of a library it is, empty for others; left out: none is.
    slot_names : for each mesh the names of its materials, empty where a slot is; left out: unknown.
    crowd : for each mesh how many instances the forest has of which this scene is a part, so that both have
        the same boxes; left out: those that are here.
    extent : (2, 3) lowest and highest corner of what else that forest has; left out: nothing.
    optics : (I, 4) of the object what makes it a mirror, glass or water: number of the kind
        (``spec.POLISHED``, -1 an unknown word), refractive index, share that a mirror sends on, extinction
        (of a retro-reflector its gain), NaN where it says nothing; left out: nowhere.
    slot_optics : for each mesh (S, 4) of its material slots, likewise.
    """

    meshes: tuple[TriMesh, ...]
    transform: np.ndarray
    mesh_index: np.ndarray
    object_name: tuple[str, ...]
    tree: np.ndarray
    species: np.ndarray
    object_index: np.ndarray = None  # type: ignore[assignment]  # filled in by __post_init__
    reflectance: np.ndarray = None  # type: ignore[assignment]
    slot_reflectance: tuple[np.ndarray, ...] = ()
    asset: tuple[str, ...] = ()
    slot_names: tuple[tuple[str, ...], ...] = ()
    crowd: tuple[int, ...] = ()
    extent: np.ndarray | None = None
    optics: np.ndarray | None = None
    slot_optics: tuple[np.ndarray, ...] = ()

    def __post_init__(self) -> None:
        if self.object_index is None:
            object.__setattr__(self, "object_index", np.arange(len(self), dtype=np.int64))
        if self.reflectance is None:
            object.__setattr__(self, "reflectance", np.full(len(self), np.nan))

    def __len__(self) -> int:
        return len(self.mesh_index)

    @cached_property
    def starts(self) -> np.ndarray:
        """(M,) number of each mesh's first triangle, where all stand one after the other."""
        return np.cumsum([0, *(len(mesh.triangles) for mesh in self.meshes)])[:-1]

    @cached_property
    def part(self) -> np.ndarray:
        """(T,) int8 parts of the triangles of all meshes."""
        return np.concatenate([np.empty(0, np.int8), *(mesh.part for mesh in self.meshes)])

    @cached_property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[np.ndarray]]:
        """Arrays of each instance's mesh where they are: (I,) addresses of its triangles, int32, and of its
        points; (I,) bool, whether these are float32, else float64; and what is there."""
        whole = [np.ascontiguousarray(mesh.triangles, np.int32) for mesh in self.meshes]
        points = [np.ascontiguousarray(mesh.points) for mesh in self.meshes]
        single = np.array([of.dtype == np.float32 for of in points], dtype=bool)
        triangles, places = (
            np.array([each.ctypes.data for each in arrays], np.uintp) for arrays in (whole, points)
        )
        index = self.mesh_index
        return triangles[index], places[index], single[index], [*whole, *points]

    def corners(self, instance: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(R, 3, 3) corners of triangles (R,) of instances (R,), each in its mesh's own space, m."""
        corners = np.empty((len(instance), 3, 3))
        mesh_of = self.mesh_index[instance]
        order = np.argsort(mesh_of, kind="stable")
        cuts = np.flatnonzero(np.diff(mesh_of[order], prepend=-1))
        for rows in np.split(order, cuts)[1:]:
            mesh = self.meshes[mesh_of[rows[0]]]
            corners[rows] = mesh.points.take(mesh.triangles.take(triangle[rows], 0), 0)
        return corners

    def reflectance_at(
        self, instance: np.ndarray, triangle: np.ndarray, otherwise: float
    ) -> np.ndarray:
        """(R,) reflectance of what was hit: of its material, else of its object, else ``otherwise``."""
        reflectance = np.append(self.reflectance, np.nan).take(instance)  # a miss is -1
        if self._of_material is not None:
            first = np.append(self.starts[self.mesh_index], 0)
            own = self._of_material.take(first.take(instance) + triangle)
            reflectance = np.where(np.isnan(own) | (instance < 0), reflectance, own)
        return np.where(np.isnan(reflectance), otherwise, reflectance)

    @cached_property
    def _of_material(self) -> np.ndarray | None:
        """(T,) reflectance that materials say of all triangles; None where none says any."""
        says = any(np.isfinite(slots).any() for slots in self.slot_reflectance)
        if not says or not len(self.part):
            return None
        said = np.full(len(self.part), np.nan)
        for mesh, slots, first in zip(self.meshes, self.slot_reflectance, self.starts, strict=True):
            if len(slots):
                own = slots[np.clip(mesh.material, 0, len(slots) - 1)]
                said[first : first + len(own)] = own
        return said

    def optics_at(self, instance: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(R, 4) what makes that which was hit a mirror, glass or water: of its material, else of its
        object; NaN where neither says so."""
        optics = np.full((len(instance), 4), np.nan)
        if self.optics is not None:
            optics = self.optics[instance].copy()
            optics[instance < 0] = np.nan
        mesh_of = np.append(self.mesh_index, -1)[instance]
        for index, slots in enumerate(self.slot_optics):
            if np.isfinite(slots).any():
                rows = np.flatnonzero(mesh_of == index)
                slot = self.meshes[index].material[triangle[rows]]
                own = slots[np.clip(slot, 0, len(slots) - 1)]
                optics[rows] = np.where(np.isnan(own[:, :1]), optics[rows], own)
        return optics

    def take(self, rows: np.ndarray, **others: np.ndarray) -> SceneGeometry:
        """The scene of some instances (R,), by number. others : of these what is said anew."""
        kept = {
            name: value[rows] for name in OF_INSTANCES if (value := getattr(self, name)) is not None
        }
        return replace(self, **{**kept, **others})  # type: ignore[arg-type]

    def with_meshes(self, meshes: Sequence[TriMesh], like: Sequence[int]) -> SceneGeometry:
        """The scene with more meshes behind its own; each is said to be what one of these, ``like``, is."""
        more: dict[str, Any] = {
            name: (*kept, *(kept[number] for number in like))
            for name in OF_MESHES
            if (kept := getattr(self, name))
        }
        return replace(self, meshes=(*self.meshes, *meshes), crowd=(), **more)

    def solid(self) -> SceneGeometry:
        """The same scene without leaves: what blocks a sound, or a line of sight."""
        return replace(self, meshes=tuple(mesh.solid for mesh in self.meshes))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(I, 3) smallest and (I, 3) largest world coordinates of each instance; NaN where empty.

        They are those of some boxes around pieces of the mesh: one around all of it would grow by half
        when it is turned.
        """
        low = np.full((len(self), 3), np.nan)
        high = low.copy()
        order = np.argsort(self.mesh_index, kind="stable")
        cuts = np.searchsorted(self.mesh_index[order], np.arange(len(self.meshes) + 1))
        many = self.crowd or np.diff(cuts).tolist()
        for number, (first, last) in enumerate(pairwise(cuts.tolist())):
            rows = order[first:last]
            if not len(rows):
                continue
            each = int(np.clip(BOXES // many[number], 1, PIECES))
            least, most = boxes_of(self.meshes[number], each)
            if not len(least):
                continue
            linear, shift = self.transform[rows, :, :3], self.transform[rows, None, :, 3]
            centre = np.einsum("nij,kj->nki", linear, (least + most) / 2) + shift
            extent = np.einsum("nij,kj->nki", np.abs(linear), (most - least) / 2)
            low[rows], high[rows] = (centre - extent).min(axis=1), (centre + extent).max(axis=1)
        return low, high


def alone(mesh: TriMesh) -> SceneGeometry:
    """A scene of one mesh, in its own frame."""
    one = np.zeros(1, np.int64)
    return SceneGeometry((mesh,), np.eye(3, 4)[None], one, ("",), one - 1, one - 1)


def boxes_of(mesh: TriMesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3), (K, 3) boxes around at most ``count`` groups of vertices that lie near each other.

    They are kept with the mesh, which many scenes may share.
    """
    kept: dict[int, tuple[np.ndarray, np.ndarray]] = vars(mesh).setdefault("_boxes", {})
    if count in kept:
        return kept[count]
    used = mesh.vertices
    counts = np.zeros(len(used), dtype=bool)
    counts[mesh.triangles.ravel()] = True
    counts &= np.isfinite(used.sum(axis=1))
    used = used if counts.all() else used[counts]
    kept[count] = used, used
    if len(used):
        first = np.unique(np.linspace(0, len(used), count, endpoint=False).astype(np.int64))
        used = used[np.argsort((morton(used) >> COARSE).astype(np.uint16), kind="stable")]
        kept[count] = np.minimum.reduceat(used, first), np.maximum.reduceat(used, first)
    return kept[count]


def apply_transform(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (P, 3) through one (3, 4) transform."""
    return points @ transform[:, :3].T + transform[:, 3]


def invert_transforms(transform: np.ndarray) -> np.ndarray:
    """World-to-local (I, 3, 4); NaN for a singular transform, whose instance has no volume."""
    linear = transform[:, :, :3]
    size = np.abs(linear).max(axis=(1, 2), initial=0.0)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        regular = np.abs(np.linalg.det(linear / size[:, None, None])) > 1e-18
    inverse = np.full_like(transform, np.nan)
    inverse[regular, :, :3] = np.linalg.inv(linear[regular])
    inverse[regular, :, 3] = -np.einsum(
        "nij,nj->ni", inverse[regular, :, :3], transform[regular, :, 3]
    )
    return inverse


# Precision of a scene's places: Blender keeps coordinates in float32.
#
# Beyond 8 km from the origin neighbouring float32 numbers are a millimetre apart and more (at UTM northings
# half a metre), so what stands there has been moved by up to half of that before anything is sensed.


VISIBLE_STEP = 1e-3  # metres between numbers, from which a user should know


def rounding_warning(scene: SceneGeometry) -> str:
    """A sentence on what stands too far from the origin, and what to do; empty where nothing does."""
    if not len(scene):
        return ""
    local = np.array([np.abs(mesh.vertices).max(initial=0.0) for mesh in scene.meshes])
    far = np.abs(scene.transform[:, :, 3]).max(axis=1)
    far = np.nan_to_num(np.maximum(far, local[scene.mesh_index]), posinf=0.0)
    worst = int(np.argmax(far))
    step = float(np.spacing(np.float32(far[worst])))
    if step < VISIBLE_STEP:
        return ""
    name = scene.object_name[scene.object_index[worst]]
    return (
        f'"{name}" is {far[worst] / 1000:,.0f} km from the origin, where coordinates in Blender have steps '
        f"of {step:.2g} m: places are off by up to {step / 2:.2g} m. Move the scene near the origin and "
        "give the distance as the offset, which is added to what is written"
    )
