"""Bounces: rays that a mirror, a pane or a surface of water turns, and what they meet after that.

A ray goes straight through panes, each with its losses there and back, to the first surface that sends its
light elsewhere. There it is turned once, as the mirror or the law of refraction says, and meets one surface
more; light comes back on the same way. The scanner knows nothing of the turn: the echo stands on its own
beam, at the range that the time of flight says, d₁ + d₂ behind a mirror and d₁ + m·d₂ behind water of m
times the refractive index of what the scanner is in. A second mirror, pane or water that a turned ray meets
turns nothing more; such rays are counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ....base.rng import daughter_keys
from ....base.rows import RowTable
from ....spec import AUTO, POLISHED, USUAL_INDEX, Polished, Scanner, SpecError, Surfaces
from ...rays.caster import Hits, RayCaster, hit_normals
from ...rays.geometry import SceneGeometry
from ..passage import FAINT, Contacts, SightLines, split
from ..radiometry import RETRO
from ..returns import organs
from .fresnel import (
    absorption_of_water,
    mirrored,
    pane_reflectance,
    refracted,
    spread,
    surface_reflectance,
)

MIRROR, GLASS, WATER = range(3)  # a retro-reflector turns no ray
DIRECT, REFLECTED, THROUGH, REFRACTED = range(4)  # how light of a return went: ``Cloud.bounce``


@dataclass(frozen=True)
class PolishedScene:
    """A scene whose polished surfaces are known.

    scene : that one. extinction : 1/m of the air. water : 1/m of water that does not say its own.
    """

    scene: SceneGeometry
    extinction: float
    water: float

    @classmethod
    def of(cls, scene: SceneGeometry, scanner: Scanner) -> PolishedScene | None:
        """Find what is polished in a scene, for a scanner that follows bounces; None where nothing is.

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
        """Of what was hit (R,): kind, NaN where it is not polished; index, share of a mirror, extinction."""
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


@dataclass(frozen=True)
class StraightWays:
    """Straight ways of rays: what sends light back, rays by number that a polished surface ends or turns,
    and where they were turned."""

    contacts: list[Contacts]
    turned: list[Turned]
    ended: int


def follow(
    caster: RayCaster,
    polished: PolishedScene,
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
    second polished surface.
    """
    count = len(rays[0])
    walk = _Walk(caster, polished, surfaces)
    first = walk.straight(*rays, np.full(count, max_distance), keys)
    contacts = Contacts.joined(first.contacts)
    if not first.turned:
        return contacts, 0
    turned = Turned.joined(first.turned)
    gone, ratio = turned.left.distance, turned.ratio
    second = walk.straight(
        turned.origin,
        turned.way,
        (max_distance - gone) / ratio,
        daughter_keys(daughter_keys(keys[turned.ray], "bounce"), turned.bounce),
        turned.left,
    )
    found = Contacts.joined(second.contacts)
    return Contacts.joined([contacts, _as_seen(found, turned, polished)]), second.ended


def alike_bounces(contacts: Contacts, counts: np.ndarray, solid: np.ndarray) -> list[np.ndarray]:
    """Rows ``solid`` of contacts ``counts`` in parts with at most one contact of a ray, all of one kind of
    bounce: what lies on one surface as the scanner sees it."""
    assert contacts.sight is not None
    ray, bounce = contacts.ray[counts[solid]], contacts.sight.bounce[counts[solid]]
    order = np.lexsort((ray, bounce))
    new = np.append(True, (np.diff(ray[order]) != 0) | (np.diff(bounce[order]) != 0))
    first = order[new[: len(order)]]
    return [np.sort(solid[first[bounce[first] == kind]]) for kind in np.unique(bounce[first])]


def _as_seen(found: Contacts, turned: Turned, polished: PolishedScene) -> Contacts:
    """Contacts of turned rays as the scanner sees them, with the light that reaches it."""
    turn = turned.select(found.ray)
    first, second = turn.left.distance, found.hits.distance
    seen = first + turn.ratio * second
    area = spread(first, second, turn.before, turn.behind, turn.ratio)
    air = 2 * polished.extinction * (seen - first)  # that ``intensity`` will take of the second way
    light = found.light * turn.light * seen**2 / area
    light *= np.exp(air - 2 * turn.extinction * second)
    met = turn.origin + second[:, None] * turn.way
    return Contacts(
        turn.ray,
        replace(found.hits, distance=seen),
        found.organ,
        light,
        SightLines(met - seen[:, None] * turn.way, turn.way, turn.bounce),
    )


class _Walk:
    """Straight ways of rays through leaves and panes."""

    def __init__(self, caster: RayCaster, polished: PolishedScene, surfaces: Surfaces) -> None:
        self._caster, self._polished, self._surfaces = caster, polished, surfaces

    def straight(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        limit: np.ndarray,
        keys: np.ndarray,
        left: Hits | None = None,
    ) -> StraightWays:
        """Follow rays to what ends them. limit : (R,) metres. left : what turned rays leave; they are not
        turned again."""
        scene = self._caster.scene
        ray, light = np.arange(len(origins)), np.ones(len(origins))
        bounce = np.zeros(len(origins), dtype=np.int8)
        hits = self._caster.cast(origins, ways, limit, leaving=left)
        found: list[Contacts] = []
        turned: list[Turned] = []
        ended = np.zeros(len(origins), dtype=bool)
        while True:
            met = np.flatnonzero(hits.found)
            ray, light, bounce, hits = ray[met], light[met], bounce[met], hits.select(met)
            organ = organs(scene, hits)
            optics = self._polished.at(hits)
            plain = np.flatnonzero(np.isnan(optics[0]))
            sends, passes, kept = split(
                organ[plain], light[plain], self._surfaces, keys[ray[plain]], len(found)
            )
            bare = np.flatnonzero(~np.isnan(optics[0]))
            dust = scene.reflectance_at(hits.instance[bare], hits.triangle[bare], 0.0)
            sends = np.sort(np.append(plain[sends], bare[dust > 0]))
            sight = SightLines(origins[ray[sends]], ways[ray[sends]], bounce[sends])
            found.append(
                Contacts(ray[sends], hits.select(sends), organ[sends], light[sends], sight)
            )
            through = np.zeros(len(ray))
            through[plain[passes]] = kept
            if len(bare):
                some = tuple(value[bare] for value in optics)
                own = ray[bare], light[bare] * (1 - dust) ** 2, hits.select(bare)
                passed, turns = self._polish(own, origins[own[0]], ways[own[0]], some)
                through[bare] = (1 - dust) ** 2 * passed
                bounce[bare[some[0] == GLASS]] = THROUGH
                ended[own[0]] = True
                turned += turns if left is None else []
            on = np.flatnonzero((through > 0) & (light * through > FAINT))
            if not len(on):
                return StraightWays(found, turned, int(ended.sum()) if left is not None else 0)
            ray, light, bounce = ray[on], light[on] * through[on], bounce[on]
            behind = hits.select(on)
            hits = self._caster.cast(
                origins[ray],
                ways[ray],
                limit[ray],
                min_distance=behind.distance,
                leaving=behind,
            )

    def _polish(
        self,
        met: tuple[np.ndarray, np.ndarray, Hits],
        origins: np.ndarray,
        ways: np.ndarray,
        optics: tuple[np.ndarray, ...],
    ) -> tuple[np.ndarray, list[Turned]]:
        """Shares (B,) of light there and back that go straight on, and the rays that are turned.

        met : number of the rays, their light, and the polished surfaces that they met.
        """
        ray, light, hits = met
        kind, index, share, extinction = optics
        normal = hit_normals(self._caster.scene, hits)
        inwards = np.einsum("bk,bk->b", ways, normal) < 0
        ratio = np.where((kind == WATER) & ~inwards, 1 / index, index)
        bent, before, behind = refracted(ways, normal, ratio)
        back = np.select(
            [kind == MIRROR, kind == GLASS],
            [share, pane_reflectance(before, behind, ratio)],
            surface_reflectance(before, behind, ratio),
        )
        same, air = np.ones(len(ray)), np.full(len(ray), self._polished.extinction)
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
    said: np.ndarray = ~np.isnan(values) & (values != AUTO)
    return said


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
