"""Pistons, wood and rims as waves of few modes, against their own formulas in double precision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from forest_addon.acoustics.modes.line_modes import LineModes
from forest_addon.sensing.sonar.bands import BandGrid
from forest_addon.sensing.sonar.facets import RimStrength
from forest_addon.sensing.sonar.leaves import DiscStrength
from forest_addon.sensing.sonar.poses import posed
from forest_addon.sensing.sonar.scatterers import LEAF, Strength
from forest_addon.sensing.sonar.search import SearchGroup
from forest_addon.sensing.sonar.station import AirLoss, Equipment, Station
from forest_addon.sensing.sonar.summation import sum_echoes
from forest_addon.sensing.sonar.wood import CylinderStrength
from forest_addon.spec import Air, Sonar

AIR = Air()
BAND = (730.0, 1460.0)
KINDS = ("piston", "wood", "rims")


def strength(kind: str, count: int, seed: int = 3) -> Strength:
    """Of all sizes and angles; a tenth of them where sound meets them squarely."""
    rng = np.random.default_rng(seed)
    if kind == "piston":
        angle = np.arccos(rng.uniform(0, 1, count))
        angle[: count // 10] *= 0.1
        return DiscStrength(rng.uniform(0.003, 0.06, count), angle, np.ones(count), "piston")
    if kind == "rims":
        slope = rng.uniform(-0.03, 0.03, count)
        slope[: count // 10] *= 0.01
        return RimStrength(rng.uniform(-0.1, 0.1, count), slope)
    cosine = rng.uniform(-1, 1, count)
    cosine[: count // 10] *= 0.01
    radius = np.exp(rng.uniform(np.log(3e-4), np.log(0.2), count))
    nearness = rng.uniform(0.9, 1, count)
    return CylinderStrength(
        rng.uniform(0.005, 0.1, count), radius, np.sqrt(1 - cosine**2), cosine, nearness
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_waves_add_up_to_echoes(kind: str) -> None:
    """And what is left out, and how loud echoes are at least, is as is said."""
    some, k = strength(kind, 900), np.linspace(*BAND, 161)
    made = some.modal(*BAND, 1e-3, AirLoss(AIR, False))
    assert made is not None
    assert isinstance(made.table, LineModes)
    assert len(made.rows) == 900
    known = np.abs(some.amplitude(k)).max(axis=0)
    assert made.loudest is not None
    loudest = made.loudest.max(axis=1)
    assert (loudest <= known * (1 + 1e-9)).all()
    assert loudest.sum() > 0.6 * known.sum()
    loud = np.abs(made.factor)
    left, _ = made.table.left_out(made.places, loud)
    laid = float((loud * made.table.loudest(made.places)[:, 0]).sum())
    for level, rank in enumerate(made.table.ranks):
        shares = made.table.shares(made.places, rank)
        wave = (shares @ made.table.at(k, rank)).T * made.factor
        wave *= np.exp(-1j * np.outer(k, made.offset))
        found = np.zeros((900, len(k)), complex)
        np.add.at(found, made.owner, wave.T)
        off = np.abs(found.T - some.amplitude(k)).max(axis=0).sum()
        assert off <= left[level] + made.share * laid
    assert off < 2e-4 * known.sum()


class Standing:
    """Scatterers at given places with a given strength."""

    kind = LEAF

    def __init__(self, some: Strength, centre: np.ndarray) -> None:
        self.strength, self.centre = some, centre

    def seen(self, point: np.ndarray) -> Strength:
        return self.strength

    def select(self, rows: np.ndarray) -> Standing:
        return Standing(self.strength.select(rows), self.centre[rows])


@pytest.mark.medium
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("where", ["one echo", "spread"])
def test_the_sum_in_air_keeps_its_bound(kind: str, tolerance: float, where: str) -> None:
    """Absorption is that of the way to a scatterer's middle, though its waves come sooner and later."""
    count, rng = 520, np.random.default_rng(5)
    some = strength(kind, count)
    if where == "one echo":  # all errors add up
        some = some.select(np.full(count, 7))
    way = np.array([1.0, 0, 0]) + rng.normal(size=(count, 3)) * 0.2
    reach = rng.uniform(1.0, 3.0, count) if where == "spread" else np.full(count, 1.5)
    centre = way * (reach / np.linalg.norm(way, axis=1))[:, None]
    sonar = Sonar(
        band=(40e3, 80e3), beam="omni", position=(0, 0, 0), tolerance=tolerance, wood=True
    )
    station = Station(sonar, AIR, posed(sonar), Equipment.of(sonar))
    paths, one = station.paths(centre), np.ones(count)
    none = np.zeros(count, np.int64)
    group = SearchGroup(Standing(some, centre), none, paths, one, one, np.empty((count, 0)))
    grid = BandGrid(40e3, 50.0, 801, 5_000, 5_000, (40e3, 80e3))
    fast = sum_echoes([group], station, grid, tolerance)
    slow = sum_echoes([group], station, grid, 0.0)
    off = float(np.abs(fast.spectrum - slow.spectrum).max())
    assert 0 < off <= fast.error_bound * fast.size[0]
    assert fast.error_bound <= tolerance
    assert 0.3 * slow.size[0] < fast.size[0] <= slow.size[0] * (1 + 1e-6)
    loss = station.band_loss
    assert some.modal(*station.wavenumbers, tolerance, loss) is not None
    assert replace(loss, absorbs=False)(np.array(BAND)).max() == 0
