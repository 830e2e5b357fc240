"""Blooming of retro-reflectors: light that a scanner's optics scatter beside its beam finds them, too.

A small share of the light goes into a Gaussian cone much wider than the beam. What it sends back from
usual surfaces is lost below the threshold; a retro-reflector, hundreds of times as bright as white, is seen
by it, at its own range and in the direction in which the beam looks: it seems larger than it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....base.rng import daughter_keys
from ....spec import Beam, Scanner
from ...rays.caster import Hits, RayCaster, hit_normals
from ...rays.geometry import SceneGeometry, apply_transform
from ..footprint import frames, sub_rays
from ..one_face import Received
from ..radiometry import RETRO, intensity, reflectance_of
from ..returns import cosines, organs
from ..scanner import Pulses
from ..waveform import LIGHT, find_echoes, pulse_length

RAYS = 100  # of a cone
REACH = 1.7  # half angles within which its rays are


class Halo:
    """Cone of light beside the beams of a scanner, and the retro-reflectors that it may find."""

    def __init__(self, scanner: Scanner, scene: SceneGeometry) -> None:
        self._scanner = scanner
        angle = scanner.receiver.halo_mrad
        self._beam = Beam(divergence_mrad=(angle, angle), subrays=RAYS)
        self._middle, self._radius = _balls(scene)

    @classmethod
    def of(cls, scanner: Scanner, scene: SceneGeometry) -> Halo | None:
        """The halo of a scanner; None where it has none, or nothing is a retro-reflector."""
        if not scanner.receiver.halo or not is_retro(scene).any():
            return None
        return cls(scanner, scene)

    def added(
        self, caster: RayCaster, pulses: Pulses, keys: np.ndarray, found: Received
    ) -> Received:
        """Return echoes of pulses (P,) together with those of their halos.

        Of a direct echo and one of the halo nearer than the pulse is long the stronger one stays, with the
        light of both.
        """
        rows = np.flatnonzero(self._near(pulses))
        if not len(rows):
            return found
        some = Pulses(*(value[rows] for value in vars(pulses).values()))
        beams = frames(some, self._beam, daughter_keys(keys[rows], "halo"))
        more = self._seen(caster, *sub_rays(beams, RAYS))
        if not len(more.echoes.pulse):
            return found
        more = replace(more, echoes=replace(more.echoes, pulse=rows[more.echoes.pulse]))
        if found.bounce is not None:
            more = replace(more, bounce=np.zeros(len(more.way), dtype=found.bounce.dtype))
        both = Received.joined([found, more])
        both = both.select(np.lexsort((both.echoes.distance, both.echoes.pulse)))
        return _together(both, LIGHT * self._scanner.beam.pulse_ns * 1e-9 / 2)

    def _near(self, pulses: Pulses) -> np.ndarray:
        """(P,) bool, which pulses have a retro-reflector within their cone."""
        near = np.zeros(len(pulses), dtype=bool)
        spread = REACH * self._beam.divergence_mrad[0] * 0.5e-3
        for middle, radius in zip(self._middle, self._radius, strict=True):
            away = middle - pulses.origin
            far = np.linalg.norm(away, axis=1)
            along = np.einsum("pi,pi->p", away, pulses.direction)
            beside = np.sqrt(np.maximum(far**2 - along**2, 0))
            near |= (beside <= radius + spread * np.maximum(far, radius)) & (along > -radius)
        return near

    def _seen(self, caster: RayCaster, origin: np.ndarray, way: np.ndarray) -> Received:
        """Return the echoes of rays (P·N, 3) of cones that meet a retro-reflector."""
        scanner, scene = self._scanner, caster.scene
        hits = caster.cast(origin, way, scanner.max_range)
        rows = np.flatnonzero(hits.found & (hits.distance >= scanner.min_range))
        rows = rows[scene.optics_at(hits.instance[rows], hits.triangle[rows])[:, 0] == RETRO]
        met: Hits = hits.select(rows)
        normal, ways = hit_normals(scene, met), way[rows]
        gain = reflectance_of(scene, met, organs(scene, met), scanner.surfaces)
        energy = intensity(
            gain * scanner.receiver.halo / RAYS,
            cosines(normal, ways),
            met.distance,
            scanner.beam.extinction,
        )
        pulse, ray = np.divmod(rows, RAYS)
        sigma = pulse_length(scanner.beam.pulse_ns)
        echoes = find_echoes(pulse, ray, met.distance, energy, sigma)
        chosen = echoes.contact
        return Received(echoes, met.select(chosen), ways[chosen], normal[chosen])


def is_retro(scene: SceneGeometry) -> np.ndarray:
    """(I,) bool, which instances are retro-reflectors, or have a material that is one."""
    found = np.zeros(len(scene), dtype=bool)
    if scene.optics is not None:
        found |= scene.optics[:, 0] == RETRO
    for mesh, slots in enumerate(scene.slot_optics):
        found |= (scene.mesh_index == mesh) & bool((slots[:, 0] == RETRO).any())
    return found


def _balls(scene: SceneGeometry) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3) middles and (K,) radii, metres, of balls around the retro-reflectors."""
    middle, radius = [], []
    for row in np.flatnonzero(is_retro(scene)).tolist():
        mesh = scene.meshes[scene.mesh_index[row]]
        corners = apply_transform(scene.transform[row], mesh.vertices)
        middle.append((corners.min(axis=0) + corners.max(axis=0)) / 2)
        radius.append(float(np.linalg.norm(corners - middle[-1], axis=1).max()))
    return np.array(middle).reshape(-1, 3), np.array(radius)


def _together(found: Received, length: float) -> Received:
    """Return echoes, sorted by pulse and range, of which those of a pulse nearer than a length, metres, are
    one: the strongest, with the light of all."""
    echoes = found.echoes
    apart = (np.diff(echoes.pulse) != 0) | (np.diff(echoes.distance) > length)
    start = np.flatnonzero(np.append(True, apart))
    group = np.cumsum(np.append(True, apart)) - 1
    total = np.add.reduceat(echoes.energy, start)
    order = np.lexsort((echoes.energy, group))
    rows = order[np.append(np.diff(group[order]) != 0, True)]
    kept = found.select(rows)
    return replace(kept, echoes=replace(kept.echoes, energy=total[group[rows]]))
