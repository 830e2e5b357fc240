"""Passage of a ray: the first surface, and where leaves let light through, those behind.

A leaf of transmittance τ passes a whole ray with probability τ, as if it had holes that are the same on
the way back; or it passes a share τ of the light, there and back again, so that what is behind n leaves
sends back τ²ⁿ. The first is unbiased with one ray a leaf, the second needs no chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.rng import daughter_keys, keyed_uniform
from ...base.rows import RowTable
from ...base.trimesh import LEAF
from ...spec import Scanner, Surfaces
from ..rays.bundles import NOTHING, Faces
from ..rays.caster import Hits, RayCaster, hit_normals
from ..rays.geometry import SceneGeometry
from .cloud import organs
from .footprint import SHORT, BeamFrames, places, reach
from .pattern import Pulses
from .radiometry import reflectance_of
from .waveform import WaveformEchoes, pulse_length

FAINT = 1e-6  # share of the light below which a ray is not followed further


@dataclass(frozen=True)
class SightLines(RowTable):
    """Lines on which C contacts are seen in a scene with mirrors, glass or water (``specular``).

    origin : (C, 3) where the ray would start if it had not been turned. way : (C, 3) how it arrives.
    bounce : (C,) int8, how it went there.
    """

    origin: np.ndarray
    way: np.ndarray
    bounce: np.ndarray


@dataclass(frozen=True)
class Contacts(RowTable):
    """C surfaces that send light back, those of one ray from the nearest on.

    ray : (C,) number of the ray. hits : what it met. organ : (C,) int8 part of the tree.
    light : (C,) share of the ray's light that gets there and back.
    sight : where rays may be turned, the lines of the C contacts; None where all are the rays' own.
    """

    ray: np.ndarray
    hits: Hits
    organ: np.ndarray
    light: np.ndarray
    sight: SightLines | None = None


def meet(
    caster: RayCaster,
    origins: np.ndarray,
    directions: np.ndarray,
    max_distance: float,
    surfaces: Surfaces,
    keys: np.ndarray,
    time: np.ndarray | None = None,
) -> Contacts:
    """Follow rays (R, 3), (R, 3) until their light is spent or they leave the scene.

    keys : (R,) uint64 keys of the rays, for chances. time : (R,) s, for a caster of a scene that moves.
    """
    ray = np.arange(len(origins))
    light = np.ones(len(origins))
    when: dict[str, Any] = {} if time is None else {"time": time}
    hits = caster.cast(origins, directions, max_distance, **when)
    found: list[Contacts] = []
    while True:
        met = np.flatnonzero(hits.found)
        ray, light, hits = ray[met], light[met], hits.select(met)
        organ = organs(caster.scene, hits)
        sends, goes_on, kept = split(organ, light, surfaces, keys[ray], len(found))
        found.append(Contacts(ray[sends], hits.select(sends), organ[sends], light[sends]))
        if not len(goes_on):
            break
        ray, light, behind = ray[goes_on], light[goes_on] * kept, hits.select(goes_on)
        hits = caster.cast(
            origins[ray],
            directions[ray],
            max_distance,
            min_distance=behind.distance,
            leaving=behind,
            **{name: every[ray] for name, every in when.items()},
        )
    return Contacts.joined(found)


def split(
    organ: np.ndarray, light: np.ndarray, surfaces: Surfaces, keys: np.ndarray, before: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return rows that send light back, rows of rays that go on, and the share of their light that does.

    before : how many surfaces these rays have met before.
    """
    share = surfaces.leaf_transmittance
    rows = np.arange(len(organ))
    if share == 0:
        return rows, rows[:0], 0.0
    leaf = organ == LEAF
    if surfaces.passing == "share":
        return rows, rows[leaf & (light * share**2 > FAINT)], share**2
    through = leaf & (keyed_uniform(daughter_keys(keys, before), "leaf") < share)
    return rows[~through], rows[through], 1.0


# Beams that meet one face with all their rays, as most do in a scene of walls and ground.
#
# Nothing is traced or sorted for them. With the plane n·(p - f) = 0 of the face, the ray at (x, y) of a
# beam (``footprint``) is at its distance
#
#     t = n·(f - origin - x·exit_x - y·exit_y) / n·w · |w|,   w = axis + x·turn_x + y·turn_y
#
# so that six numbers of a beam give all its ranges and angles of incidence. They lie within
# ``footprint.SHORT`` of the pulse's length, so the echo has one crest (``waveform``): Newton's method from
# the mean of the ranges, moved by their third moment. It is what ``waveform`` finds of the same rays, but for
# rounding (1e-11 m).


AT_ONCE = 1024  # beams: what is in work stays in the cache
FINE = 1e-14  # of the distance: a step of Newton's method that is rounding
TRIES = 8


@dataclass(frozen=True)
class Received(RowTable):
    """E echoes, and of each what stands for it: its hit, the way of that ray and the normal there, (E, 3).

    bounce : (E,) int8 how that ray went (``specular``); None where all go straight.
    """

    echoes: WaveformEchoes
    hits: Hits
    way: np.ndarray
    normal: np.ndarray
    bounce: np.ndarray | None = None

    def of(self, pulse: np.ndarray) -> Received:
        """The same echoes, of pulses with other numbers."""
        return replace(self, echoes=replace(self.echoes, pulse=pulse[self.echoes.pulse]))

    @classmethod
    def by_pulse(cls, parts: Sequence[Received]) -> Received:
        """Several, of other pulses each, in the order of their pulses."""
        found = cls.joined(parts)
        return found.select(np.argsort(found.echoes.pulse, kind="stable"))


@dataclass(frozen=True)
class Planes(RowTable):
    """F faces, as a beam on one of them sees it.

    instance, triangle : (F,) which they are. organ : (F,) int8. reflectance : (F,). normal : (F, 3) unit
    vectors. foot : (F, 3) a corner, in the world.
    """

    instance: np.ndarray
    triangle: np.ndarray
    organ: np.ndarray
    reflectance: np.ndarray
    normal: np.ndarray
    foot: np.ndarray

    @classmethod
    def of(
        cls, scene: SceneGeometry, scanner: Scanner, instance: np.ndarray, triangle: np.ndarray
    ) -> Planes:
        """Triangles (F,) of instances (F,)."""
        hits = Hits(np.zeros(len(instance)), instance, triangle)
        organ = organs(scene, hits)
        return cls(
            instance=instance,
            triangle=triangle,
            organ=organ,
            reflectance=reflectance_of(scene, hits, organ, scanner.surfaces),
            normal=hit_normals(scene, hits),
            foot=_feet(scene, hits),
        )

    @classmethod
    def of_faces(cls, scene: SceneGeometry, scanner: Scanner, faces: Faces) -> Planes:
        """All faces of a scene."""
        return cls.of(scene, scanner, faces.instance, faces.triangle)


def seen(
    faces: Faces, pulses: Pulses, scanner: Scanner
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of pulses whose beams may meet something, rows among these of beams that meet one face, and that
    face of each."""
    met = faces.met(pulses.origin, pulses.direction, *reach(scanner.beam))
    some = np.flatnonzero(met != NOTHING)
    known = np.flatnonzero(met[some] >= 0)
    return some, known, met[some[known]]


def on_one_face(contacts: Contacts, beams: int, subrays: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the beams whose rays all met the same triangle first, and of each its first contact."""
    ray, hits = contacts.ray, contacts.hits
    none = np.empty(0, np.int64)
    if len(ray) < subrays:
        return none, none
    first = np.flatnonzero(ray[: 1 - subrays] % subrays == 0)
    first = first[ray[first + subrays - 1] == ray[first] + subrays - 1]
    every = np.arange(subrays)
    for value in (ray - np.arange(len(ray)), hits.instance, hits.triangle):
        first = first[(value[first[:, None] + every] == value[first, None]).all(axis=1)]
    beam, rows = np.unique(ray[first] // subrays, return_index=True)
    return beam[beam < beams], first[rows[beam < beams]]


def alone(
    scene: SceneGeometry, scanner: Scanner, beams: BeamFrames, contacts: Contacts
) -> tuple[Received, Contacts]:
    """Return the echoes of those beams (P,) all of whose rays met one face, and the contacts of the others.

    A beam without light has no echo, and its contacts, which have none either, may be among the others'.
    """
    count = scanner.beam.subrays
    beam, first = on_one_face(contacts, len(beams.axis), count)
    hits = contacts.hits.select(first)
    planes = Planes.of(scene, scanner, hits.instance, hits.triangle)
    found, sure = received(scanner, beams.select(beam), planes, np.arange(len(beam)))
    if not len(sure):
        return found, contacts
    known = np.zeros(len(beams.axis), dtype=bool)
    known[beam[sure]] = True
    return found.of(beam), contacts.select(~known[contacts.ray // count])


def received(
    scanner: Scanner, beams: BeamFrames, planes: Planes, face: np.ndarray
) -> tuple[Received, np.ndarray]:
    """Return the echoes of beams (P,) that meet with all their rays the face (P,), a row of the planes.

    Returns
    -------
    the echoes, of pulses 0 to P - 1; and the rows of the pulses that this holds for. It does not for leaves,
    near the limits of range, and where a footprint is long.
    """
    normal = planes.normal[face]
    scalars = scalars_of(beams, planes.foot[face], normal)
    reflectance = planes.reflectance[face]
    found = np.full((4, len(face)), np.nan)  # distance of the first ray; crest, energy, width
    for first in range(0, len(face), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        found[:, part] = _echoes(scalars[:, part], reflectance[part], scanner)
    sure = np.flatnonzero((planes.organ[face] != LEAF) & np.isfinite(found.sum(axis=0)))
    lit = sure[found[2, sure] > 0]
    x, y = places(scanner.beam.subrays)[0]
    way = beams.axis[lit] + x * beams.turn_x[lit] + y * beams.turn_y[lit]
    way /= np.sqrt(_dot(way, way))[:, None]
    nearest, crest, energy, width = found[:, lit]
    echoes = WaveformEchoes(lit, crest, energy, width, lit)
    met = face[lit]
    seen = Hits(nearest, planes.instance[met], planes.triangle[met], normal[lit])
    return Received(echoes, seen, way, normal[lit]), sure


def scalars_of(beams: BeamFrames, foot: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(6, P) heights of feet (P, 3) above beams, along unit normals (P, 3), and what ``exit_x``, ``exit_y``,
    the axis, ``turn_x`` and ``turn_y`` rise."""
    exits = [np.zeros(len(normal))] * 2
    if beams.exit_x.any() or beams.exit_y.any():
        exits = [_dot(beams.exit_x, normal), _dot(beams.exit_y, normal)]
    return np.stack(
        [
            _dot(foot - beams.origin, normal),
            *exits,
            _dot(beams.axis, normal),
            _dot(beams.turn_x, normal),
            _dot(beams.turn_y, normal),
        ]
    )


def _echoes(scalars: np.ndarray, reflectance: np.ndarray, scanner: Scanner) -> np.ndarray:
    """(4, B) distance of the first ray, crest, energy and width of beams; NaN where there is more to it."""
    beam, sigma = scanner.beam, pulse_length(scanner.beam.pulse_ns)
    x, y = places(beam.subrays).T[:, :, None]
    height, exit_x, exit_y, facing, turn_x, turn_y = scalars
    along, across = np.array(beam.divergence_mrad) * 0.5e-3
    with np.errstate(all="ignore"):
        if along != across:
            return np.full((4, len(reflectance)), np.nan)
        length = np.sqrt(1 + along**2 * (x**2 + y**2))  # of axis + x·turn_x + y·turn_y
        lean = facing + x * turn_x
        lean += y * turn_y
        lean /= length
        if exit_x.any() or exit_y.any():
            distance = height - x * exit_x
            distance -= y * exit_y
            distance /= lean
        else:
            distance = height / lean
        near, far = distance.min(axis=0), distance.max(axis=0)
        whole = (near >= scanner.min_range) & (far <= scanner.max_range) & (near > 0)
        whole &= far - near <= SHORT * sigma
        energy = np.abs(lean, out=lean)
        energy /= distance
        energy /= distance
        if beam.extinction:
            energy *= np.exp(-2 * beam.extinction * distance)
        total = energy.sum(axis=0)
        whole &= 2 * energy[0] > 1.000001 * energy.max(axis=0)
        share = np.divide(energy, total, out=energy)
        first = distance[0].copy()
        away = np.subtract(distance, first, out=distance)
        mean = (share * away).sum(axis=0)
        away -= mean
        weight = share * away
        weight *= away
        variance = weight.sum(axis=0)
        weight *= away
        crest = _crest(share, away, -weight.sum(axis=0) / (2 * sigma**2), sigma, first)
        found = np.stack(
            [
                first,
                first + mean + crest,
                total * (reflectance / beam.subrays),
                np.sqrt(sigma**2 + variance),
            ]
        )
    found[:, ~whole] = np.nan
    return found


def _crest(
    share: np.ndarray, away: np.ndarray, start: np.ndarray, sigma: float, distance: np.ndarray
) -> np.ndarray:
    """(B,) crests of Gaussians of shares (N, B) at places (N, B), all near 0; NaN where none is found."""
    crest, open_ = start.copy(), np.arange(len(start))
    for _ in range(TRIES):
        here = away - crest[open_]
        weight = share * np.exp(here**2 * (-0.5 / sigma**2))
        total = weight.sum(axis=0)
        weight *= here
        slope = weight.sum(axis=0) / total
        weight *= here
        bend = (weight.sum(axis=0) / total - slope**2) / sigma**2 - 1
        step = slope / bend
        crest[open_] -= step
        going = ~(np.abs(step) <= FINE * distance)
        if not going.any():
            return crest
        open_, distance = open_[going], distance[going]
        share, away = share[:, going], away[:, going]
    crest[open_] = np.nan
    return crest


def _feet(scene: SceneGeometry, hits: Hits) -> np.ndarray:
    """(R, 3) a corner of each triangle, in the world."""
    feet = np.empty((len(hits.instance), 3))
    mesh_of = scene.mesh_index[hits.instance]
    for index in np.flatnonzero(np.bincount(mesh_of)).tolist():
        rows = np.flatnonzero(mesh_of == index)
        mesh, place = scene.meshes[index], scene.transform[hits.instance[rows]]
        corner = mesh.vertices[mesh.triangles[hits.triangle[rows], 0]]
        feet[rows] = np.einsum("rij,rj->ri", place[:, :, :3], corner) + place[:, :, 3]
    return feet


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(P,) of vectors (P, 3)."""
    product: np.ndarray = np.einsum("pk,pk->p", a, b)
    return product
