"""Radiometry: the LiDAR equation for surfaces that scatter as Lambert's law says.

An energy E sent into a beam gives back to an aperture of diameter D from a surface at range R

    E·η·(D²/4)·I,   I = ρ·|cos θ|·exp(-2·α·R)/R²

with reflectance ρ, angle of incidence θ, extinction of the air α, and efficiency of the optics η (Wagner
2010, ISPRS J. 65, 505, eq. 4, for a target that fills the beam). ``I``, in 1/m², is what a scan calls
intensity: the share of what a white surface would send back that faces the scanner at 1 m in clear air.
A pulse of several sub-rays adds theirs up, each with its share of the energy.
"""

from __future__ import annotations

import numpy as np
import scipy

from ... import kernels
from ...base.rng import child_keys, keyed_normal, keyed_uniform
from ...base.trimesh import DEAD, GROUND, LEAF, OTHER, WOOD
from ...spec import POLISHED, Noise, Polished, Scanner, SpecError, Surfaces
from ..rays.caster import Hits
from ..rays.geometry import SceneGeometry
from .cloud import cosines

RETRO = POLISHED.index("retro")
PLANCK, LIGHT_SPEED = 6.62607015e-34, 299_792_458.0  # J·s, m/s


def intensity(
    reflectance: np.ndarray, cos_incidence: np.ndarray, distance: np.ndarray, extinction: float
) -> np.ndarray:
    """(R,) 1/m², the I of the equation above; distances in metres, extinction in 1/m."""
    with np.errstate(divide="ignore"):
        back: np.ndarray = reflectance * np.abs(cos_incidence) / distance**2
    return back * np.exp(-2 * extinction * distance) if extinction else back


def light_back(
    ray: np.ndarray,
    share: np.ndarray,
    light: tuple[np.ndarray, np.ndarray],
    distance: np.ndarray,
    normal: np.ndarray,
    way: np.ndarray,
    extinction: float,
    nearest: float,
) -> np.ndarray:
    """(C,) 1/m², what contacts add to the I of their pulses; 0 of those nearer than ``nearest``, metres.

    ray : (C,) numbers of rays, from pulse to pulse. share : (S,) of a pulse's light in each of its rays.
    light : reflectances (C,), and shares (C,) of a ray's light that get there and back.
    normal, way : (C, 3) unit vectors of surfaces and rays.
    """
    library = kernels.library()
    if library is None:
        energy = light[0] * light[1] * share[ray % len(share)]
        energy = intensity(energy, cosines(normal, way), distance, extinction)
        return np.where((energy > 0) & (distance >= nearest), energy, 0.0)
    energy = np.empty(len(ray))
    given = (np.ascontiguousarray(one) for one in (*light, distance, normal, way))
    library.light_back(len(ray), ray, len(share), share, *given, extinction, nearest, energy)
    return energy


def detection_limit(scanner: Scanner) -> float:
    """The intensity, 1/m², below which nothing is seen: of the faintest surface at the largest range, or that
    whose light is as many photons as the link budget asks for."""
    link = scanner.link
    if link.energy:
        photon = PLANCK * LIGHT_SPEED / (scanner.beam.wavelength_nm * 1e-9)
        return link.photons * photon / float(received_energy(scanner, np.array(1.0)))
    return float(
        intensity(
            np.array(scanner.faintest),
            np.array(1.0),
            np.array(scanner.max_range),
            scanner.beam.extinction,
        )
    )


def received_energy(scanner: Scanner, light: np.ndarray) -> np.ndarray:
    """(R,) joules at the detector of intensities (R,), 1/m², by the scanner's link budget."""
    link = scanner.link
    gain = link.energy * 1e-6 * link.efficiency * link.aperture**2 / 4
    return np.asarray(gain * light)


def refuse_surplus(scene: SceneGeometry, surfaces: Surfaces) -> None:
    """Refuse surfaces that reflect more light than arrives, whatever their object or material says.

    Raises
    ------
    SpecError : one does; says which object and what to change.
    """
    objects = () if scene.optics is None else (scene.optics,)
    for optics in (*objects, *scene.slot_optics):
        dim = optics[(optics[:, 0] == RETRO) & (optics[:, 3] < 1), 3]
        if len(dim):
            raise SpecError(
                "forest_gain",
                f"of a retro-reflector is {dim[0]:g}: it sends back at least as much as white, so "
                "give 1 or more",
            )
    for number, mesh in enumerate(scene.meshes):
        rows = np.flatnonzero(scene.mesh_index == number)
        slots = scene.slot_reflectance[number] if scene.slot_reflectance else np.full(1, np.nan)
        said = np.concatenate([slots, scene.reflectance[rows]])
        if not ((said < 0) | (said + surfaces.leaf_transmittance > 1)).any():
            continue  # whichever triangles they are of
        leaf = mesh.part == LEAF
        own = slots[np.clip(mesh.material, 0, len(slots) - 1)]
        for passes, here in ((0.0, ~leaf), (surfaces.leaf_transmittance, leaf)):
            said = np.concatenate([own[here], scene.reflectance[rows] if here.any() else []])
            wrong = said[(said < 0) | (said + passes > 1)]
            if not len(rows) or not len(wrong):
                continue
            name = scene.object_name[scene.object_index[rows[0]]]
            also = f" beside leaf_transmittance = {passes:g}" if passes else ""
            raise SpecError(
                "forest_reflectance",
                f'"{name}", or a material of it, says {wrong[0]:g}{also}: a share of the light must be '
                f"from 0 to {1 - passes:g}; change it on the object or the material",
            )


def reflectance_of(
    scene: SceneGeometry, hits: Hits, organ: np.ndarray, surfaces: Surfaces
) -> np.ndarray:
    """(R,) reflectances: what material or object say, else what the part is; gains of retro-reflectors."""
    of_part = np.zeros(128)
    of_part[[OTHER, WOOD, LEAF, GROUND, DEAD]] = (
        surfaces.other,
        surfaces.wood,
        surfaces.leaf,
        surfaces.ground,
        surfaces.wood,
    )
    reflectance = scene.reflectance_at(hits.instance, hits.triangle, of_part[organ])
    if scene.optics is None and not scene.slot_optics:
        return reflectance
    kind, *_, gain = scene.optics_at(hits.instance, hits.triangle).T
    bright = np.clip(np.where(np.isnan(gain), Polished().gain, gain), 1, None)
    return np.where(kind == RETRO, bright, reflectance)


# Noise of a scanner, drawn for each return by its key: seed, scan, pulse, return.
#
# No draw depends on another, so a scan has the same bytes in any chunks and after any interruption.


STEEPEST = 1e3  # tan of the angle of incidence; a surface seen edge on has no end of it


def range_error(
    noise: Noise, distance: np.ndarray, cos_incidence: np.ndarray, keys: np.ndarray
) -> np.ndarray:
    """(E,) metres to add to ranges: normal, of variance a² + (b·R)² + (c·tan θ)²."""
    if not (noise.range_sd or noise.range_ppm or noise.incidence_sd):
        return np.zeros(len(distance))
    cos_incidence = np.nan_to_num(cos_incidence, nan=1.0)  # of what met nothing
    tangent = np.sqrt(np.maximum(1 - cos_incidence**2, 0)) / np.maximum(cos_incidence, 1 / STEEPEST)
    variance = (
        noise.range_sd**2
        + (noise.range_ppm * 1e-6 * distance) ** 2
        + (noise.incidence_sd * tangent) ** 2
    )
    return np.sqrt(variance) * keyed_normal(keys, "range")


def registration(
    noise: Noise, key: np.ndarray, time: np.ndarray
) -> tuple[scipy.spatial.transform.Rotation, np.ndarray]:
    """Rotations and shifts (P, 3), metres, by which pulses sent at times (P,) s of a scan with this key (1,)
    are joined amiss; one for all where the error does not change.

    Errors that change are drawn every ``registration_s``; between, both neighbours weigh as cosine and sine
    of a quarter turn, so that the spread is the same at every time.
    """
    keys, shares = [key], [np.ones(1)]
    if noise.registration_s:
        knot, part = np.divmod(time / noise.registration_s, 1.0)
        keys = [child_keys(key, knot.astype(np.int64) + k) for k in (0, 1)]
        shares = [np.cos(np.pi / 2 * part), np.sin(np.pi / 2 * part)]
    turn, shift = (
        np.stack(
            [
                sum(
                    share * keyed_normal(keyed, f"registration {what} {axis}")
                    for share, keyed in zip(shares, keys, strict=True)
                )
                for axis in "xyz"
            ],
            axis=1,
        )
        for what in ("turn", "shift")
    )
    turns = scipy.spatial.transform.Rotation.from_rotvec(np.deg2rad(noise.registration_deg) * turn)
    return turns, noise.registration_sd * shift


def survives_drop_out(noise: Noise, keys: np.ndarray) -> np.ndarray:
    """(E,) bool: returns that are not lost."""
    if noise.drop_out == 0:
        return np.ones(len(keys), dtype=bool)
    return keyed_uniform(keys, "drop-out") >= noise.drop_out
