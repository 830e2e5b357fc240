"""Poisson forests without Blender: endless upright trunks, which level rays and flyers meet in closed form.

A ray that is level meets a trunk of radius R at the first root of |p + td| = R; a flyer of radius r meets it
at that of R + r. All rays of one origin are held against the trunks within reach of it, in float64. A sonar
hears them as cylinders.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from types import SimpleNamespace

import numpy as np
from scipy.spatial import cKDTree

from ..base.rng import stream
from ..base.trimesh import WOOD, TriMesh
from ..growth.mesh.meshing import tube
from ..sensing.rays.caster import Hits, unit_columns
from ..sensing.rays.geometry import SceneGeometry
from ..sensing.sonar.targets import EchoTargets
from ..spec import Flight, Forest, Scene, SpecError
from .obstacles import REACH, Solid, first_within

HEIGHT = 3.0  # metres of a trunk, where nothing else is said
SIDES, RINGS = 16, 4  # of its mesh: corners around, rings along
BEYOND = 20.0  # metres of forest behind the aim
DENSEST = 5.0  # trees/m²
TRUNK, BODY = 0.20, 0.15  # metres, radii
SIDEWAYS = 2.0  # m/s


class PlaneTrunks:
    """Trunks at places (N, 2) with radii (N,): what rays meet (``RayCaster``), and what stops a flyer
    (``MeshObstacles``).
    """

    engine = "stems"
    moves = False

    def __init__(self, position: np.ndarray, radius: np.ndarray) -> None:
        self.position, self.radius = position, radius
        self._thickest = float(radius.max(initial=0.0))
        self._tree = cKDTree(position) if len(position) else None

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float = np.inf,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The nearest trunk of each ray; of rays that follow each other from one origin, together."""
        hits = Hits.misses(len(origins))
        if self._tree is None or not len(origins):
            return hits
        way = unit_columns(np.asarray(directions).T)[:2].T
        starts = np.flatnonzero(np.append(True, (np.diff(origins, axis=0) != 0).any(axis=1)))
        reach = max_distance + self._thickest
        near = self._tree.query_ball_point(origins[starts, :2], reach)
        for first, last, rows in zip(
            starts, np.append(starts[1:], len(origins)), near, strict=True
        ):
            if not rows:
                continue
            away = origins[first, :2] - self.position[rows]
            share = first_within(away, way[first:last, None], self.radius[rows])
            first_met = share.argmin(axis=1)
            nearest = share[np.arange(last - first), first_met]
            met = nearest <= max_distance
            hits.distance[first:last][met] = nearest[met]
            hits.instance[first:last][met] = np.asarray(rows)[first_met[met]]
            hits.triangle[first:last][met] = 0
        return hits

    def at(self, _time: float) -> PlaneTrunks:
        """Return them as they stand at a time: always alike."""
        return self

    def room(self, place: np.ndarray, _wanted: np.ndarray | float = 0.0) -> np.ndarray:
        """(N,) metres around places (N, 3) in which surely nothing stands."""
        if self._tree is None:
            return np.full(len(place), REACH)
        nearest, _ = self._tree.query(place[:, :2])
        return np.clip(nearest - self._thickest, 0.0, REACH)

    def touch(self, start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        """(M,) shares of ways (M, 3) to (M, 3) at which spheres first touch; ``inf``: never."""
        share = np.full(len(start), np.inf)
        if self._tree is None:
            return share
        way = (end - start)[:, :2]
        reach = (np.hypot(*way.T) / 2 + radius + self._thickest) * (1 + 1e-9)
        near = self._tree.query_ball_point((start[:, :2] + end[:, :2]) / 2, reach)
        for row, rows in enumerate(near):
            if rows:
                away = start[row, :2] - self.position[rows]
                thick = self.radius[rows] + radius
                met = first_within(away, way[row], thick)
                inside = np.hypot(*away.T) <= thick
                share[row] = np.where(inside, 0.0, np.where(met <= 1.0, met, np.inf)).min()
        return share

    def encloses(self, place: np.ndarray) -> bool:
        """Return whether a place (3,) is inside of a trunk."""
        return bool((np.hypot(*(self.position - place[:2]).T) < self.radius).any())


class StemWorld:
    """A forest of trunks that flyers fly in.

    low, high : (2,) of the field, metres. height : metres of the trunks that sound and pictures meet.
    gusts : the wind that carries flyers: there is none.
    """

    gusts = None

    def __init__(
        self,
        position: np.ndarray,
        radius: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        height: float = HEIGHT,
    ) -> None:
        self._height = height
        self.field = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        self.caster = self.wood = self.obstacles = PlaneTrunks(position, radius)

    @cached_property
    def geometry(self) -> SceneGeometry:
        """Trunks as instances of a tube, as pictures and the sonar have them."""
        place, radius = self.obstacles.position, self.obstacles.radius
        transform = np.zeros((len(radius), 3, 4))
        transform[:, 0, 0] = transform[:, 1, 1] = radius / TRUNK
        transform[:, 2, 2], transform[:, :2, 3] = self._height / HEIGHT, place
        none = np.zeros(len(radius), dtype=np.int64)
        return SceneGeometry((_tube(),), transform, none, ("trunk",), none, none, none)

    @cached_property
    def targets(self) -> EchoTargets:
        """Targets that sound back."""
        return EchoTargets(self.geometry, _measured())

    @property
    def stock(self) -> SimpleNamespace:
        """Triangles that stop a flyer in each mesh, for pictures."""
        return SimpleNamespace(solids=[Solid(_tube(), 0.0)])

    def ground(self, place: np.ndarray) -> np.ndarray:
        """(N,) height 0."""
        return np.zeros(len(place))


@cache
def _tube() -> TriMesh:
    """A tube of which trunks are instances, thinner or thicker."""
    axis = np.column_stack([np.zeros((RINGS, 2)), np.linspace(0.0, HEIGHT, RINGS)])
    vertices, triangles = tube(axis, np.full(RINGS, TRUNK), SIDES)
    return TriMesh.of_part(vertices, triangles, WOOD)


@cache
def _measured() -> EchoTargets:
    """Targets that keep what the sonar measures of a tube."""
    return EchoTargets(StemWorld(np.zeros((1, 2)), np.ones(1), np.zeros(2), np.ones(2)).geometry)


@dataclass
class StemForests:
    """Poisson forests of trunks, one for each seed, for a ``FlightEnv`` in place of a scene.

    flight : of who flies along X. density : trees/m². trunk : metres, their radius. width : metres across.
    height : metres of the trunks that sound and pictures meet.
    """

    flight: Flight
    density: float = 0.1
    trunk: float = TRUNK
    width: float = 60.0
    height: float = HEIGHT

    @property
    def settings(self) -> Scene:
        """Return them as a scene says its own."""
        length = self.flight.distance
        return Scene(flight=self.flight, forest=Forest(size=(length, self.width)))

    def surroundings(self, seed: int) -> StemWorld:
        """The forest of a seed, which goes on for 20 m beyond the aim."""
        rng = stream(seed, "flight", "stems")
        length = self.flight.distance
        place = poisson_strip(rng, self.density, length + BEYOND, self.width)
        size = np.array([length, self.width])
        return StemWorld(place, np.full(len(place), self.trunk), np.zeros(2), size, self.height)


def poisson_forests(density: float, speed: float, distance: float) -> StemForests:
    """Forests that Karaman & Frazzoli's bird flies through: ``speed`` m/s ahead, at most 2 m/s across.

    density : trees/m², with trunks of 20 cm radius; its own is 15 cm. distance : metres.

    Raises
    ------
    SpecError : one that is out of range.
    """
    if not 0 <= density <= DENSEST:
        raise SpecError("density", f"{density} is out of range; use 0 to {DENSEST} trees/m²")
    flight = Flight(
        body="bird",
        speed=speed,
        sideways=SIDEWAYS,
        radius=BODY,
        aim="heading",
        distance=distance,
        step=0.1,
        steps=10_000,
        start_low=(0.0, 0.25),
        start_high=(0.0, 0.75),
        clearance=1.0,
    )
    return StemForests(flight, density)


def poisson_strip(
    rng: np.random.Generator, density: float, length: float, width: float
) -> np.ndarray:
    """(N, 2) places of a Poisson process from x = 0 to ``length`` and y = 0 to ``width``."""
    count = rng.poisson(density * length * width)
    return rng.uniform((0.0, 0.0), (length, width), (count, 2))
