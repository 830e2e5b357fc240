"""Law of a map of trees: Poisson with hills, groups (Thomas, Matérn) or repulsion (Strauss), by its test.

The intensity is estimated first; if stands that are drawn from it are like the map (L(r) - r within its
global envelope, quadrats likewise), trees stand by chance and nothing more is fitted. Otherwise groups are
fitted where trees keep company and repulsion where they keep apart, over an even ground and over the hills,
and the first law that the same tests accept is taken, fewest numbers first; if none is accepted, the one with
the largest p. More than ``MANY_HILLS`` hills say that trees come in groups, so groups are tried then too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import stream
from ...spec import Forest, Planting
from ..compose import process_of
from ..inputs import Inputs
from ..plan import draw_places
from .goodness import Goodness, examine, law_of
from .intensity import FittedMixture, Window, fit_mixture
from .interaction import fit_clusters, fit_strauss
from .k_function import KFunction, choose_radii, inhomogeneous_k, region_of

LAWS = ("poisson", "thomas", "matern", "strauss")
MANY_HILLS = 5
ACCEPTED = 0.025  # of each of the two tests: a Poisson map is called another in at most 5 %
WEAK = 0.95  # γ of a repulsion that is none
FEWEST_GROUPS = 5.0  # in the window, below which they are hills
WIDEST = 0.25  # spread of a group, in the window's shorter side
RADII = np.linspace(0.1, 1.5, 15)  # of repulsion, in mean distances 1/√λ


@dataclass(frozen=True)
class ChosenLaw:
    """A law of a species' trees.

    name : one of ``LAWS``. estimate : its intensity. planting : what a scene plants by it. goodness : its
    tests; None where there are too few or too many trees to test.
    """

    name: str
    estimate: FittedMixture
    planting: Planting
    goodness: Goodness | None

    @property
    def p_value(self) -> float:
        """The smaller p of its two tests; 0 where nothing can be tested."""
        if self.goodness is None:
            return 0.0
        return min(self.goodness.excess.p_value, self.goodness.quadrat_p_value)


@dataclass(frozen=True)
class MappedSpecies:
    """Trees of one species on a map: points (N, 2), their window, and the field of the scene."""

    name: str
    points: np.ndarray
    window: Window
    field: Forest

    def judge(self, law: str, estimate: FittedMixture, planting: Planting) -> ChosenLaw:
        """Hold the map to stands that this planting draws."""
        process = process_of(planting, self.field, Inputs())

        def simulate(number: int) -> np.ndarray:
            rng = stream(0, "goodness", self.name, number)
            drawn = draw_places(planting, process, rng)
            return drawn[self.window.contains(drawn)]

        goodness = examine(self.points, self.window, law_of(estimate, simulate))
        return ChosenLaw(law, estimate, planting, goodness)

    def k_function(self, estimate: FittedMixture) -> KFunction | None:
        """K about an estimated intensity; None where fewer than two trees can be judged."""
        region = region_of(estimate.at, self.window)
        within = self.points[region.contains(self.points)]
        if len(within) < 2:
            return None
        return inhomogeneous_k(within, estimate.at(within), region, choose_radii(within, region))


def choose_law(
    mapped: MappedSpecies, by_chance: ChosenLaw, hills: FittedMixture, law: str = "auto"
) -> list[ChosenLaw]:
    """The laws that were tried; the one that is taken comes first.

    by_chance : the Poisson law of the estimate with hills. law : "auto", or one of ``LAWS``.

    Raises
    ------
    ValueError : the law asked for cannot be fitted to these trees.
    """
    settled = by_chance.p_value > ACCEPTED and len(hills.peak) <= MANY_HILLS
    if law == "poisson" or (law == "auto" and (settled or by_chance.goodness is None)):
        return [by_chance]
    tried = [] if law in LAWS else [by_chance]
    best = None
    for candidate in _candidates(mapped, hills, by_chance.planting, law):
        tried.append(candidate)
        if candidate.p_value > ACCEPTED:
            best = candidate
            break
    if not tried:
        wanted = "repulsion" if law == "strauss" else "groups"
        raise ValueError(f"its trees show no {wanted} at any distance; leave --law out")
    best = best or max(tried, key=lambda one: one.p_value)
    return [best, *(one for one in tried if one is not best)]


def _candidates(
    mapped: MappedSpecies, hills: FittedMixture, planting: Planting, law: str
) -> Iterator[ChosenLaw]:
    """Groups or repulsion over an even ground, then over the hills."""
    even = fit_mixture(mapped.points, mapped.window, 0)
    plain = replace(planting, base=0.0, gaussians=())
    grounds = [(even, plain)] + ([(hills, planting)] if len(hills.peak) else [])
    for estimate, ground in grounds:
        k = mapped.k_function(estimate)
        if k is None:
            continue
        for kind in ("thomas", "matern"):
            if law not in ("auto", kind) or not (k.l_function > k.radius).any():
                continue
            clusters = fit_clusters(k, kind)
            few = clusters.groups * mapped.window.area < FEWEST_GROUPS
            if law == "auto" and (few or clusters.spread > WIDEST * mapped.window.extent.min()):
                continue
            planted = replace(ground, layout="clusters", clusters=clusters)
            yield mapped.judge(kind, estimate, planted)
        if law in ("auto", "strauss") and (k.l_function < k.radius).any():
            mean = len(mapped.points) / mapped.window.area
            radii = RADII / np.sqrt(mean)
            radii = radii[radii < mapped.window.extent.min() / 4]
            at = estimate.at if len(estimate.peak) else None
            try:
                strauss = fit_strauss(mapped.points, mapped.window, radii, at).strauss
                planted = replace(ground, layout="strauss", strauss=strauss)
                if strauss.gamma < WEAK:
                    yield mapped.judge("strauss", estimate, planted)
            except ValueError:  # no tree clear of the border; a core too wide to be drawn
                continue
