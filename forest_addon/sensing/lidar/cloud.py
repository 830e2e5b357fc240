"""Labels of what rays met: organ, leaf, tree, species, and the angle of incidence.

A caster says which triangle of which instance a ray hit; ``label`` reads from the scene what that is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.rows import RowTable
from ..rays.caster import Hits, hit_normals
from ..rays.geometry import SceneGeometry
from .waveform import Waveforms

ESCAPED = -1  # organ of a beam that meets nothing


@dataclass(frozen=True)
class Returns(RowTable):
    """Hits of R rays with their labels; where a ray met nothing: inf, NaN or -1.

    distance : (R,) metres. normal : (R, 3) unit normal of the triangle, as it was made, in the world.
    cos_incidence : (R,) |cos| between ray and surface normal.
    organ : (R,) int8, ``trimesh.PART_NAMES`` or ``ESCAPED``. leaf, tree, species, instance : (R,).
    triangle : (R,) int32, which one of the instance's mesh.
    """

    distance: np.ndarray
    normal: np.ndarray
    cos_incidence: np.ndarray
    organ: np.ndarray
    leaf: np.ndarray
    tree: np.ndarray
    species: np.ndarray
    instance: np.ndarray
    triangle: np.ndarray


def label(
    scene: SceneGeometry, hits: Hits, directions: np.ndarray, normal: np.ndarray | None = None
) -> Returns:
    """Labels of hits: organ, leaf, tree, species, and the angle of incidence of unit directions (R, 3).

    normal : (R, 3) normals of the triangles, where they are known already.
    """
    normal = hit_normals(scene, hits) if normal is None else normal
    of_tree = np.append(scene.tree, -1)  # a miss has instance -1
    of_species = np.append(scene.species, -1)
    return Returns(
        distance=hits.distance,
        normal=normal,
        cos_incidence=cosines(normal, directions),
        organ=organs(scene, hits),
        leaf=_leaves(scene, hits),
        tree=of_tree[hits.instance],
        species=of_species[hits.instance],
        instance=hits.instance,
        triangle=hits.triangle.astype(np.int32, copy=False),
    )


def cosines(normal: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(R,) |cos| between unit vectors (R, 3)."""
    n, d = normal, directions
    return np.abs(n[:, 0] * d[:, 0] + n[:, 1] * d[:, 1] + n[:, 2] * d[:, 2])


def organs(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R,) int8 parts of what was hit, ``ESCAPED`` where nothing was."""
    if not len(scene.part):
        return np.full(len(hits.found), ESCAPED, dtype=np.int8)
    first = np.append(scene.starts[scene.mesh_index], 0)  # a miss has instance and triangle -1
    part = scene.part.take(first.take(hits.instance) + hits.triangle)
    return np.where(hits.found, part, np.int8(ESCAPED))


def _leaves(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R,) int32 leaf numbers of what was hit, -1 where it is no leaf."""
    values = np.full(len(hits.distance), -1, dtype=np.int32)
    met = np.flatnonzero(hits.found)
    mesh_of = scene.mesh_index[hits.instance[met]]
    for number in np.flatnonzero(np.bincount(mesh_of)):
        rows = met[mesh_of == number]
        values[rows] = scene.meshes[number].leaf[hits.triangle[rows]]
    return values


# A point cloud: what a scanner gives back, with its labels and its truth.


@dataclass(frozen=True)
class Lost:
    """Pulses from number ``first`` to before ``stop`` that could not be measured, and why."""

    first: int
    stop: int
    why: str

    def __str__(self) -> str:
        last = self.stop - 1
        which = f"pulse {last}" if last == self.first else f"pulses {self.first} to {last}"
        return f"{which} ({self.why})"


@dataclass(frozen=True)
class Cloud(RowTable):
    """P returns of ``pulses`` pulses, sorted by pulse and then by range.

    position : (P, 3) metres, at the measured range on the axis of the beam.
    pulse : (P,) number of the pulse. time : (P,) seconds at which it was sent.
    number, count : (P,) uint8, which return of its pulse, from 1, and of how many.
    azimuth, elevation : (P,) radians, of the axis of the beam. scan_angle : (P,) radians, elevation of a
        scanner on a tripod, angle from nadir of one that moves, right positive.
    intensity : (P,) energy that came back, as a share of a white Lambert surface's at 1 m.
    width : (P,) seconds, standard deviation of the echo; 0 where a pulse has no length.
    true_range : (P,) metres, the range without noise.
    returns : measured range, surface and labels of the P returns.
    velocity, rest : of a scan in a scene that moves, (P, 3) m/s of what was met, and (P, 3) metres where that
        point is when the scene stands as at the frame of the scan; None of a still scene.
    bounce : of a scanner that follows bounces, (P,) int8: 0 direct, 1 by reflection: a ghost where nothing
        stands, 2 straight through glass, 3 refracted; None of others.
    waves : of a scanner that records waveforms, those of its pulses, in counts.
    unfollowed : rays that were turned and met a second mirror, glass or water.
    lost : those of the ``pulses`` on which the program failed; a fault of ours, to be reported.
    """

    position: np.ndarray
    pulse: np.ndarray
    time: np.ndarray
    number: np.ndarray
    count: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    scan_angle: np.ndarray
    intensity: np.ndarray
    width: np.ndarray
    true_range: np.ndarray
    returns: Returns
    pulses: int
    engine: str
    lost: tuple[Lost, ...] = ()
    velocity: np.ndarray | None = None
    rest: np.ndarray | None = None
    bounce: np.ndarray | None = None
    unfollowed: int = 0
    waves: Waveforms | None = None


def join(clouds: Sequence[Cloud]) -> Cloud:
    """One cloud of the pieces of a scan, in order; at least one piece."""
    return dataclasses.replace(
        Cloud.joined(clouds),
        pulses=sum(cloud.pulses for cloud in clouds),
        unfollowed=sum(cloud.unfollowed for cloud in clouds),
        lost=together([lost for cloud in clouds for lost in cloud.lost]),
    )


def together(lost: Sequence[Lost]) -> tuple[Lost, ...]:
    """Lost pulses in order, those that follow each other for the same reason as one."""
    joined: list[Lost] = []
    for one in lost:
        if joined and (joined[-1].stop, joined[-1].why) == (one.first, one.why):
            one = Lost(joined.pop().first, one.stop, one.why)
        joined.append(one)
    return tuple(joined)
