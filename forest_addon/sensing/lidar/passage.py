"""Passage of a ray: the first surface, and where leaves let light through, those behind.

A leaf of transmittance τ passes a whole ray with probability τ, as if it had holes that are the same on
the way back; or it passes a share τ of the light, there and back again, so that what is behind n leaves
sends back τ²ⁿ. The first is unbiased with one ray a leaf, the second needs no chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import child_keys, keyed_uniform
from ...base.rows import RowTable
from ...base.trimesh import LEAF
from ...spec import Surfaces
from ..rays.caster import Hits, RayCaster
from .cloud import organs
from .waveform import WaveformEchoes

FAINT = 1e-6  # share of the light below which a ray is not followed further


@dataclass(frozen=True)
class Contacts(RowTable):
    """C surfaces that send light back, those of one ray from the nearest on, and rays that met nothing.

    ray : (C,) number of the ray. hits : what it met. organ : (C,) int8 part of the tree.
    light : (C,) share of the ray's light that gets there and back.
    origin : (C, 3) where the ray starts, or would if nothing had turned it. way : (C, 3) how it arrives.
    bounce : where mirrors, glass or water are (``specular``), (C,) int8, how it went there.
    """

    ray: np.ndarray
    hits: Hits
    organ: np.ndarray
    light: np.ndarray
    origin: np.ndarray
    way: np.ndarray
    bounce: np.ndarray | None = None


def meet(
    caster: RayCaster,
    origins: np.ndarray,
    directions: np.ndarray,
    max_distance: float,
    surfaces: Surfaces,
    keys: np.ndarray,
    time: np.ndarray,
) -> Contacts:
    """Follow rays (R, 3), (R, 3) until their light is spent or they leave the scene.

    keys : (R,) uint64 keys of the rays, for chances. time : (R,) s, of the rays.
    """
    ray = np.arange(len(origins))
    light = np.ones(len(origins))
    hits = caster.cast(origins, directions, max_distance, time=time)
    if not surfaces.leaf_transmittance:
        return Contacts(ray, hits, organs(caster.scene, hits), light, origins, directions)
    contacts: list[Contacts] = []
    while True:
        met = np.flatnonzero(hits.found)
        ray, light, hits = ray[met], light[met], hits.select(met)
        organ = organs(caster.scene, hits)
        sends, goes_on, kept = split(organ, light, surfaces, keys[ray], len(contacts))
        own = ray[sends]
        sent = hits.select(sends), organ[sends], light[sends]
        contacts.append(Contacts(own, *sent, origins[own], directions[own]))
        if not len(goes_on):
            break
        ray, light, behind = ray[goes_on], light[goes_on] * kept, hits.select(goes_on)
        hits = caster.cast(
            origins[ray],
            directions[ray],
            max_distance,
            min_distance=behind.distance,
            leaving=behind,
            time=time[ray],
        )
    return Contacts.joined(contacts)


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
    through = leaf & (keyed_uniform(child_keys(keys, before), "leaf") < share)
    return rows[~through], rows[through], 1.0


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
