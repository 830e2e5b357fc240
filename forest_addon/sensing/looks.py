"""Looks of each kind of sensor at trees: from where, how far, and how fine it tells things apart.

A ``SensorLook`` is what ``detail`` asks of a sensor, and what the record of each kind makes of its
settings; there is one class for beams, one for echoes and one for responses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..spec import Choice
from .rays.exact import ExactCaster
from .rays.geometry import alone

if TYPE_CHECKING:
    from ..growth.tree import Tree

TOGETHER = 50  # coarse leaves that must sound as one
LOUDNESS = 0.05  # the energy that coarse leaves may send back more or less, as a share
SHARE = 0.25  # of its leaves that a coarse tree has
SOUND = 340.0  # m/s, rounded: N is a matter of factors
ORIENTATIONS = 500


@dataclass(frozen=True)
class Upright:
    """N trees as upright cylinders.

    place : (N, 2) metres. reach : (N,) radius of the cylinder, m. low, high : (N,) heights of its ends, m.
    """

    place: np.ndarray
    reach: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def distance(self, corners: np.ndarray) -> np.ndarray:
        """(N,) metres, or less, from each tree to the nearest place of a line through corners (P, 3)."""
        aside = np.full(len(self.place), np.inf)
        for a, b in pairwise(corners if len(corners) > 1 else corners[[0, 0]]):
            step = b[:2] - a[:2]
            at = np.clip(((self.place - a[:2]) @ step) / max(float(step @ step), 1e-12), 0, 1)
            aside = np.minimum(aside, np.hypot(*(self.place - a[:2] - at[:, None] * step).T))
        aside = np.maximum(aside - self.reach, 0)
        lowest, highest = corners[:, 2].min(), corners[:, 2].max()
        over = np.maximum(np.maximum(lowest - self.high, self.low - highest), 0)
        return np.asarray(np.hypot(aside, over))


@dataclass(frozen=True)
class Leafy(Upright):
    """The same with the coarse leaves of trees that can have such.

    length : (N,) of the longest coarse leaf, m; 0: it has none. radius : (N,) of the disc of a full leaf, m;
    0 of needles. density : (N,) coarse leaves in a cubic metre of the crown.
    """

    length: np.ndarray
    radius: np.ndarray
    density: np.ndarray


@dataclass(frozen=True)
class SensorLook:
    """A sensor as ``detail`` asks it; this one hears trees wherever they are.

    name : of the sensor. corners : (P, 3) of its trajectory, m; None where it is not known before the sensor
    runs. range : m, beyond which it finds nothing. leaves : whether a leaf may change what it finds.
    exact_wood : whether wood must be known as it is set. slack : m that it may reach beside its trajectory.
    """

    name: str
    corners: np.ndarray | None = None
    range: float = np.inf
    leaves: bool = True
    exact_wood: bool = True
    slack: float = 0.0

    def distance(self, trees: Upright) -> np.ndarray:
        """(N,) metres, or less, to each tree; 0 where the trajectory is not known."""
        if self.corners is None:
            return np.zeros(len(trees.place))
        return np.maximum(trees.distance(self.corners) - self.slack, 0.0)


@dataclass(frozen=True)
class BeamLook(SensorLook):
    """A scanner: ``resolves`` gives (N,) metres that it tells apart at distances (N,), ``widths`` the metres
    across the narrowest that a beam is at one or beyond; 0: a line."""

    resolves: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    widths: Callable[[float], float] = lambda _distance: 0.0

    def blurs(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        """(N,) bool, whether coarse leaves of trees at distances (N,) are as good as all."""
        return np.asarray(self.resolves(away) >= trees.length)

    def why_blurred(self, trees: Leafy, away: np.ndarray, row: int) -> str:
        """The reason in words, of a tree."""
        fine, long = 100 * self.resolves(away)[row], 100 * trees.length[row]
        return f"which tells {fine:.1f} cm apart there; leaves have up to {long:.1f} cm"

    def off_by(self, trees: Leafy, far: np.ndarray, shift: RangeShift) -> Choice:
        """Error of its results by coarse leaves of trees (N,) bool, in its own units; see ``range_shift``."""
        why = (
            f"in nine of ten of {self.name}'s rays that meet one of {far.sum():,} trees with a quarter of "
            f"their leaves, the median beside it; of the rays through their crowns {shift.passing:.1%} pass "
            f"the one and not the other; {shift.rays:,} rays in float64, {shift.confirmed:.0%} of a second "
            "half within the bound"
        )
        key = "range at far leaves"
        return Choice(key, shift.median, shift.most, why, unit="m", sensor=self.name)


@dataclass(frozen=True)
class EchoLook(SensorLook):
    """A sonar; ``beam_width`` is the narrowest full width in radians, ``band`` in Hz."""

    beam_width: float = 0.0
    band: tuple[float, float] = (0.0, 1.0)
    hears_leaves: bool = True

    def blurs(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        """See ``BeamLook``."""
        if not self.hears_leaves:
            return np.ones(len(away), dtype=bool)
        many = self.heard_together(trees, away) >= TOGETHER
        sizes, which = np.unique(np.round(trees.radius, 4), return_inverse=True)
        louder = np.array([loudness(self.band, float(size)) for size in sizes])
        return many & (np.abs(louder - 1) <= LOUDNESS)[which] & (trees.radius > 0)

    def why_blurred(self, trees: Leafy, away: np.ndarray, row: int) -> str:
        """See ``BeamLook``."""
        many = self.heard_together(trees, away)[row]
        louder = loudness(self.band, round(float(trees.radius[row]), 4))
        return f"where {many:.0f} sound as one, {10 * np.log10(louder):+.2f} dB"

    def off_by(self, trees: Leafy, far: np.ndarray, shift: RangeShift) -> Choice:
        """Change of loudness of echoes, by the mean energy of their leaves."""
        sizes = np.unique(np.round(trees.radius[far], 4)).tolist() if self.hears_leaves else []
        louder = [
            abs(10 * np.log10(loudness(self.band, float(size)))) for size in sizes if size > 0
        ]
        most = float(max(louder, default=0.0))
        why = (
            f"in the mean energy that {self.name} hears of {far.sum():,} trees with a quarter of their "
            "leaves, by scattering from discs facing all ways; its single echoes are others"
        )
        key = "level of far leaves"
        return Choice(key, most, most, why, unit="dB", sensor=self.name)

    def heard_together(self, trees: Leafy, away: np.ndarray) -> np.ndarray:
        """(N,) coarse leaves in the beam within half a pulse, at the distances of trees (N,)."""
        low, high = self.band
        deep = SOUND / (2 * max(high - low, 1.0))
        across = np.minimum(away * self.beam_width, 2 * trees.reach)
        return np.asarray(trees.density * np.pi / 4 * across**2 * np.minimum(deep, trees.reach))


TellingLook = BeamLook | EchoLook  # can tell one leaf from another


@cache
def loudness(band: tuple[float, float], radius: float) -> float:
    """Energy that coarse discs send back over that of full ones of this radius, metres, facing all ways."""
    from ..acoustics.disc import backscatter

    t = (np.arange(ORIENTATIONS) + 0.5) / ORIENTATIONS
    angle = np.pi / 2 * t**2  # close together straight on, where a large disc glints
    weight = np.sin(angle) * t
    k = 2 * np.pi * np.linspace(*band, 15) / SOUND

    def energy(a: float) -> float:
        return float((weight * (backscatter((k * a)[:, None], angle) / k[:, None]) ** 2).sum())

    return SHARE * energy(radius / np.sqrt(SHARE)) / max(energy(radius), 1e-300)


def look_at_leaves(sensor: Any) -> SensorLook:
    """The look of a sensor that may tell any two leaves apart, from its place and as far as it reaches."""
    place = getattr(sensor, "position", None)
    return BeamLook(
        name=sensor.name,
        corners=None if place is None else np.array([place], dtype=float),
        range=float(getattr(sensor, "max_range", np.inf)),
        exact_wood=False,
    )


# Coarser leaves of far trees in a sensor's own units: how far a ray's first range moves.
#
# Parallel rays go through a tree with all of its leaves and through its coarse variant, from all sides, in
# float64. What they find apart is what a scanner's ranges there are off by, since each single ray meets
# other leaves: no bound holds for every ray, so that is told which holds for nine in ten, from one half of
# the rays and confirmed by the other.


RAYS = 1000  # of a variant
MOST = 4  # variants that are looked at
CONFIRMED = 0.9  # of the rays that meet a tree both times


@dataclass(frozen=True)
class RangeShift:
    """First ranges of rays through a tree with all leaves and through its coarse variant.

    median, most : metres that these are apart, in the middle and in nine of ten rays that meet both.
    confirmed : share of the other half of the rays for which ``most`` holds. passing : share of rays through
    the crown that pass the one and meet the other. rays : how many met both.
    """

    median: float
    most: float
    confirmed: float
    passing: float
    rays: int


def range_shift(pairs: Sequence[tuple[Tree, Tree]], rng: np.random.Generator) -> RangeShift:
    """Shift of first ranges between full and coarse trees, of at most ``MOST`` pairs drawn at random."""
    drawn = rng.permutation(len(pairs))[:MOST]
    apart, parted, count = [], 0, 0
    for number in drawn.tolist():
        full, coarse = pairs[number]
        origins, ways = _rays(full, rng)
        ours, theirs = (
            ExactCaster(alone(tree.mesh)).cast(origins, ways) for tree in (full, coarse)
        )
        both = ours.found & theirs.found
        apart.append(np.abs(ours.distance[both] - theirs.distance[both]))
        parted += int((ours.found != theirs.found).sum())
        count += int((ours.found | theirs.found).sum())
    off = rng.permutation(np.concatenate([*apart, np.empty(0)]))
    if len(off) < 2:
        return RangeShift(0.0, 0.0, 1.0, 0.0, len(off))
    first, second = np.array_split(off, 2)
    most = float(np.quantile(first, CONFIRMED))
    confirmed = float((second <= most).mean())
    return RangeShift(float(np.median(off)), most, confirmed, parted / max(count, 1), len(off))


def _rays(tree: Tree, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Origins and unit directions (RAYS, 3) of rays to places of random leaves, from all sides."""
    ways = rng.normal(size=(RAYS, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    places = tree.leaves.centre[rng.integers(0, len(tree.leaves), RAYS)]
    size = float(tree.leaves.radius.max(initial=0.0))
    places = places + rng.normal(size=(RAYS, 3)) * 2.0 * size  # beside leaves, not at them
    far = 2.0 * float(np.ptp(tree.mesh.vertices, axis=0).max(initial=1.0))
    return places - far * ways, ways
