"""Light at specular surfaces: reflection, refraction, and how much of it takes which way.

Light is unpolarised on each way: what it meets in between scatters as Lambert's law says, which keeps no
polarisation. ``ratio`` is m = n₂/n₁, the refractive index behind the surface over that before it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import child_keys
from ...base.rows import RowTable
from ...spec import AUTO, POLISHED, USUAL_INDEX, Beam, Polished, Scanner, SpecError, Surfaces
from ..rays.caster import Hits, RayCaster, hit_normals
from ..rays.geometry import SceneGeometry, apply_transform
from .cloud import cosines, organs
from .footprint import frames, places, rays_at
from .passage import FAINT, Contacts, Received, split
from .pattern import Pulses
from .radiometry import RETRO, intensity, reflectance_of
from .waveform import LIGHT, find_echoes, pulse_length

# Of pure water at 25 °C: wavelength, nm, and the imaginary part k of its refractive index (Hale & Querry
# 1973, Appl. Opt. 12, 555, table 1; at 1064, 1450 and 1550 nm, between its rows, Kou, Labrie &
# Chýlek 1993, Appl. Opt. 32, 3531: 14, 3,000 and 1,090 per metre).
WATER_K = np.array(
    [
        [400, 1.86e-9],
        [450, 1.02e-9],
        [500, 1.00e-9],
        [550, 1.96e-9],
        [600, 1.09e-8],
        [650, 1.64e-8],
        [700, 3.35e-8],
        [750, 1.56e-7],
        [800, 1.25e-7],
        [850, 2.93e-7],
        [900, 4.86e-7],
        [925, 1.06e-6],
        [950, 2.93e-6],
        [1000, 2.89e-6],
        [1064, 1.22e-6],
        [1200, 9.89e-6],
        [1400, 1.38e-4],
        [1450, 3.46e-4],
        [1550, 1.34e-4],
        [1600, 8.55e-5],
        [1800, 1.15e-4],
        [2000, 1.10e-3],
    ]
)


def mirrored(way: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(R, 3) unit directions after a mirror with unit normals (R, 3), of either sense."""
    return _unit(way - 2 * np.einsum("rk,rk->r", way, normal)[:, None] * normal)


def refracted(
    way: np.ndarray, normal: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions behind a surface by Snell's law, and cosines of the angles before and behind it.

    Returns
    -------
    (R, 3) unit directions, (R,) and (R,) cosines, the last NaN (and the direction too) where all is
    reflected.
    """
    along = np.einsum("rk,rk->r", way, normal)
    before = np.minimum(np.abs(along), 1.0)
    across = way - along[:, None] * normal
    sine = np.einsum("rk,rk->r", across, across) / ratio**2
    with np.errstate(invalid="ignore"):
        behind = np.sqrt(1 - sine)
    to = np.where(along < 0, -1.0, 1.0)
    turned = across / ratio[:, None] + (to * behind)[:, None] * normal
    return _unit(turned), before, behind


def reflectances(
    before: np.ndarray, behind: np.ndarray, ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shares (R,) of light polarised across and in the plane of incidence that are reflected (Fresnel's
    equations: Born & Wolf 1999, 1.5.2); 1 where ``behind`` is NaN.
    """
    across = (before - ratio * behind) / (before + ratio * behind)
    within = (ratio * before - behind) / (ratio * before + behind)
    return (
        np.where(np.isnan(behind), 1.0, across**2),
        np.where(np.isnan(behind), 1.0, within**2),
    )


def surface_reflectance(before: np.ndarray, behind: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """(R,) share of unpolarised light that one surface reflects; the rest passes."""
    across, within = reflectances(before, behind, ratio)
    return (across + within) / 2


def pane_reflectance(before: np.ndarray, behind: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """(R,) share of unpolarised light that a clear pane reflects, all its inner reflections added as
    powers: 2ρ/(1 + ρ) of each polarisation (Born & Wolf 1999, 7.6, without interference)."""
    across, within = (2 * share / (1 + share) for share in reflectances(before, behind, ratio))
    return (across + within) / 2


def spread(
    first: np.ndarray,
    second: np.ndarray,
    before: np.ndarray,
    behind: np.ndarray,
    ratio: np.ndarray,
) -> np.ndarray:
    """(R,) m², area over which a unit solid angle of a target's light has spread at the scanner, ``first``
    metres before a flat surface, when the target is ``second`` metres behind it.

    m²·Ls·Lt, with the distances of the images across and in the plane of incidence, Ls = d₁ + d₂/m and
    Lt = (cos t/cos i)·(d₁ + d₂·cos²i/(m·cos²t)): the beam's own widths by Snell's law, turned about by
    reciprocity of the throughput n²·dA·dω. In one medium (m = 1) it is (d₁ + d₂)².
    """
    across = first + second / ratio
    within = behind / before * (first + second * before**2 / (ratio * behind**2))
    return ratio**2 * across * within


def absorption_of_water(wavelength_nm: float) -> float:
    """1/m, absorption 4π·k/λ of pure water, k between the lines of ``WATER_K`` by its logarithm and beyond
    them as at the nearest."""
    wavelengths, known = WATER_K.T.copy()
    k = np.exp(np.interp(wavelength_nm, wavelengths, np.log(known)))
    return float(4 * np.pi * k / (wavelength_nm * 1e-9))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.sqrt(np.einsum("rk,rk->r", vectors, vectors))[:, None]


# Bounces: rays that a mirror, a pane or a surface of water turns, and what they meet after that.
#
# A ray goes straight through panes, each with its losses there and back, to the first surface that sends
# its light elsewhere. There it is turned once, as the mirror or the law of refraction says, and meets one
# surface more; light comes back on the same way. The scanner knows nothing of the turn: the echo stands on
# its own beam, at the range that the time of flight says, d₁ + d₂ behind a mirror and d₁ + m·d₂ behind
# water of m times the refractive index of what the scanner is in. A second mirror, pane or water that a
# turned ray meets turns nothing more; such rays are counted.


MIRROR, GLASS, WATER = range(3)  # a retro-reflector turns no ray
DIRECT, REFLECTED, THROUGH, REFRACTED = range(4)  # how light of a return went: ``Cloud.bounce``


@dataclass(frozen=True)
class SpecularScene:
    """A scene whose specular surfaces are known.

    scene : that one. extinction : 1/m of the air. water : 1/m of water that does not say its own.
    """

    scene: SceneGeometry
    extinction: float
    water: float

    @classmethod
    def of(cls, scene: SceneGeometry, scanner: Scanner) -> SpecularScene | None:
        """Find what is specular in a scene, for a scanner that follows bounces; None where nothing is.

        Raises
        ------
        SpecError : what an object or material says of itself cannot be.
        """
        said = [] if scene.optics is None else [scene.optics]
        said += scene.slot_optics
        if not scanner.bounces or not any((rows[:, 0] < RETRO).any() for rows in said):
            return None
        for number, rows in enumerate(said):
            _check(scene, rows, number - (scene.optics is not None))
        beam = scanner.beam
        return cls(scene, beam.extinction, absorption_of_water(beam.wavelength_nm))

    def at(self, hits: Hits) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Kind (R,) of what was hit, NaN where it is not specular; index, share of a mirror, extinction."""
        kind, index, share, extinction = self.scene.optics_at(hits.instance, hits.triangle).T
        kind = np.where(kind == RETRO, np.nan, kind)
        own = np.array([USUAL_INDEX[name] for name in POLISHED])
        usual = np.append(own, 1.0)[np.where(np.isnan(kind), -1, kind).astype(int)]
        return (
            kind,
            np.where(_is_said(index), index, usual),
            np.where(np.isnan(share), Polished().mirror, share),
            np.where(_is_said(extinction), extinction, self.water),
        )


@dataclass(frozen=True)
class Turned(RowTable):
    """T rays that start anew where they were turned.

    ray : (T,) number of the ray. bounce : (T,) int8, ``REFLECTED`` or ``REFRACTED``. left : what they leave.
    origin, way : (T, 3). light : (T,) share that gets there and back. ratio : (T,) index behind over before.
    before, behind : (T,) cosines. extinction : (T,) 1/m on their way.
    """

    ray: np.ndarray
    bounce: np.ndarray
    left: Hits
    origin: np.ndarray
    way: np.ndarray
    light: np.ndarray
    ratio: np.ndarray
    before: np.ndarray
    behind: np.ndarray
    extinction: np.ndarray


def follow(
    caster: RayCaster,
    specular: SpecularScene,
    rays: tuple[np.ndarray, np.ndarray],
    max_distance: float,
    surfaces: Surfaces,
    keys: np.ndarray,
) -> tuple[Contacts, int]:
    """Follow rays (R, 3), (R, 3) as ``passage.meet`` does, and those that are turned to what they meet next.

    keys : (R,) uint64 keys of the rays, for chances.

    Returns
    -------
    contacts, whose distances are ranges that the scanner measures; and the number of turned rays that met a
    second specular surface.
    """
    count = len(rays[0])
    walk = caster, specular, surfaces
    contacts, turns, _ = _straight(*walk, *rays, np.full(count, max_distance), keys)
    if not turns:
        return contacts, 0
    turned = Turned.joined(turns)
    gone, ratio = turned.left.distance, turned.ratio
    straight, _, ended = _straight(
        *walk,
        turned.origin,
        turned.way,
        (max_distance - gone) / ratio,
        child_keys(child_keys(keys[turned.ray], "bounce"), turned.bounce),
        turned.left,
    )
    # Contacts of turned rays as the scanner sees them, with the light that reaches it
    turn = turned.select(straight.ray)
    first, second = turn.left.distance, straight.hits.distance
    seen = first + turn.ratio * second
    area = spread(first, second, turn.before, turn.behind, turn.ratio)
    air = 2 * specular.extinction * (seen - first)  # that ``intensity`` will take of the second way
    light = straight.light * turn.light * seen**2 / area
    light *= np.exp(air - 2 * turn.extinction * second)
    met = turn.origin + second[:, None] * turn.way
    return Contacts.joined(
        [
            contacts,
            Contacts(
                turn.ray,
                replace(straight.hits, distance=seen),
                straight.organ,
                light,
                met - seen[:, None] * turn.way,
                turn.way,
                turn.bounce,
            ),
        ]
    ), ended


def _straight(
    caster: RayCaster,
    specular: SpecularScene,
    surfaces: Surfaces,
    origins: np.ndarray,
    ways: np.ndarray,
    limit: np.ndarray,
    keys: np.ndarray,
    left: Hits | None = None,
) -> tuple[Contacts, list[Turned], int]:
    """Follow rays to what ends them: what sends light back, where rays are turned, and how many of those
    that were turned before meet a specular surface again.

    limit : (R,) metres. left : what turned rays leave; they are not turned again.
    """
    scene = caster.scene
    ray, light = np.arange(len(origins)), np.ones(len(origins))
    bounce = np.zeros(len(origins), dtype=np.int8)
    hits = caster.cast(origins, ways, limit, leaving=left)
    contacts: list[Contacts] = []
    turned: list[Turned] = []
    ended = np.zeros(len(origins), dtype=bool)
    while True:
        met = np.flatnonzero(hits.found)
        ray, light, bounce, hits = ray[met], light[met], bounce[met], hits.select(met)
        organ = organs(scene, hits)
        optics = specular.at(hits)
        plain = np.flatnonzero(np.isnan(optics[0]))
        sends, passes, kept = split(
            organ[plain], light[plain], surfaces, keys[ray[plain]], len(contacts)
        )
        bare = np.flatnonzero(~np.isnan(optics[0]))
        dust = scene.reflectance_at(hits.instance[bare], hits.triangle[bare], 0.0)
        sends = np.sort(np.append(plain[sends], bare[dust > 0]))
        line = ray[sends]
        sent = hits.select(sends), organ[sends], light[sends]
        contacts.append(Contacts(line, *sent, origins[line], ways[line], bounce[sends]))
        through = np.zeros(len(ray))
        through[plain[passes]] = kept
        if len(bare):
            some = tuple(value[bare] for value in optics)
            own = ray[bare], light[bare] * (1 - dust) ** 2, hits.select(bare)
            passed, turns = _at_specular(caster, specular, own, origins[own[0]], ways[own[0]], some)
            through[bare] = (1 - dust) ** 2 * passed
            bounce[bare[some[0] == GLASS]] = THROUGH
            ended[own[0]] = True
            turned += turns if left is None else []
        on = np.flatnonzero((through > 0) & (light * through > FAINT))
        if not len(on):
            again = int(ended.sum()) if left is not None else 0
            return Contacts.joined(contacts), turned, again
        ray, light, bounce = ray[on], light[on] * through[on], bounce[on]
        behind = hits.select(on)
        hits = caster.cast(
            origins[ray],
            ways[ray],
            limit[ray],
            min_distance=behind.distance,
            leaving=behind,
        )


def _at_specular(
    caster: RayCaster,
    specular: SpecularScene,
    met: tuple[np.ndarray, np.ndarray, Hits],
    origins: np.ndarray,
    ways: np.ndarray,
    optics: tuple[np.ndarray, ...],
) -> tuple[np.ndarray, list[Turned]]:
    """Shares (B,) of light there and back that go straight on, and the rays that are turned.

    met : number of the rays, their light, and the specular surfaces that they met.
    """
    ray, light, hits = met
    kind, index, share, extinction = optics
    normal = hit_normals(caster.scene, hits)
    inwards = np.einsum("bk,bk->b", ways, normal) < 0
    ratio = np.where((kind == WATER) & ~inwards, 1 / index, index)
    bent, before, behind = refracted(ways, normal, ratio)
    back = np.select(
        [kind == MIRROR, kind == GLASS],
        [share, pane_reflectance(before, behind, ratio)],
        surface_reflectance(before, behind, ratio),
    )
    same, air = np.ones(len(ray)), np.full(len(ray), specular.extinction)
    under = np.where(inwards, extinction, 0.0)
    point = origins + hits.distance[:, None] * ways
    ways_of = (
        (REFLECTED, back, mirrored(ways, normal), same, before, air),
        (REFRACTED, 1 - back, bent, ratio, behind, under),
    )
    turned = []
    for bounce, part, way, m, beyond, lost in ways_of:
        goes = light * part**2 > FAINT
        if bounce == REFRACTED:
            goes &= kind == WATER
        rows = np.flatnonzero(goes)
        of = np.full(len(rows), bounce, dtype=np.int8)
        turned.append(
            Turned(
                ray[rows],
                of,
                hits.select(rows),
                point[rows],
                way[rows],
                (light * part**2)[rows],
                m[rows],
                before[rows],
                beyond[rows],
                lost[rows],
            )
        )
    return np.where(kind == GLASS, (1 - back) ** 2, 0.0), turned


def _is_said(values: np.ndarray) -> np.ndarray:
    """(N,) bool: neither left out nor left to "auto"."""
    return ~np.isnan(values) & (values != AUTO)


def _check(scene: SceneGeometry, rows: np.ndarray, mesh: int) -> None:
    """Refuse what cannot be. mesh : number of the mesh whose materials said it, -1: objects did."""
    for row in np.flatnonzero(np.isfinite(rows[:, 0])).tolist():
        kind, *numbers = rows[row].tolist()
        if mesh < 0:
            name = f'object "{scene.object_name[scene.object_index[row]]}"'
        else:
            names = scene.slot_names[mesh] if scene.slot_names else ()
            name = f'material "{names[row]}"' if row < len(names) else f"a material of mesh {mesh}"
        if kind < 0:
            known = ", ".join(POLISHED)
            raise SpecError("forest_optics", f"of {name} is none of {known}; use one of these")
        last = "gain" if kind == RETRO else "extinction"
        said = zip(("index", "mirror", last), numbers, strict=True)
        try:
            Polished(**{key: value for key, value in said if not np.isnan(value)})
        except SpecError as problem:
            raise SpecError(f"forest_{problem.key}", f"of {name}: {problem.problem}") from None


# Blooming of retro-reflectors: light that a scanner's optics scatter beside its beam finds them, too.
#
# A small share of the light goes into a Gaussian cone much wider than the beam. What it sends back from
# usual surfaces is lost below the threshold; a retro-reflector, hundreds of times as bright as white, is
# seen by it, at its own range and in the direction in which the beam looks: it seems larger than it is.


RAYS = 100  # of a cone
REACH = 1.7  # half angles within which its rays are


class Halo:
    """Cone of light beside the beams of a scanner, and the retro-reflectors that it may find."""

    def __init__(self, scanner: Scanner, scene: SceneGeometry) -> None:
        self._scanner = scanner
        angle = scanner.receiver.halo_mrad
        self._beam = Beam(divergence_mrad=(angle, angle), subrays=RAYS)
        # (K, 3) middles and (K,) radii, metres, of balls around the retro-reflectors
        middle, radius = [], []
        for row in np.flatnonzero(is_retro(scene)).tolist():
            mesh = scene.meshes[scene.mesh_index[row]]
            corners = apply_transform(scene.transform[row], mesh.vertices)
            middle.append((corners.min(axis=0) + corners.max(axis=0)) / 2)
            radius.append(float(np.linalg.norm(corners - middle[-1], axis=1).max()))
        self._middle, self._radius = np.array(middle).reshape(-1, 3), np.array(radius)

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
        beams = frames(some, self._beam, child_keys(keys[rows], "halo"))
        more = self._seen(caster, *rays_at(beams, places(RAYS)))
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
        sigma = pulse_length(scanner.beam.pulse_ns)
        echoes = find_echoes(rows, RAYS, met.distance, energy, sigma)
        chosen = echoes.contact
        return Received(echoes, met.select(chosen), ways[chosen], normal[chosen])


def is_retro(scene: SceneGeometry) -> np.ndarray:
    """(I,) bool, which instances are retro-reflectors, or have a material that is one."""
    retro = np.zeros(len(scene), dtype=bool)
    if scene.optics is not None:
        retro |= scene.optics[:, 0] == RETRO
    for mesh, slots in enumerate(scene.slot_optics):
        retro |= (scene.mesh_index == mesh) & bool((slots[:, 0] == RETRO).any())
    return retro


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
