"""The contract of the echo sum: every kind of echo, drawn scenes, tolerances and losses, against the direct
sum in double precision; and the estimate of the error against the error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from references.discs import HardDisc

from forest_addon.acoustics.disc_table import LAST, table_error, tabulated
from forest_addon.acoustics.nonuniform import sum_delayed
from forest_addon.sensing.sonar.facets import RimStrength
from forest_addon.sensing.sonar.leaves import DiscStrength, EdgeStrength
from forest_addon.sensing.sonar.scatterers import Strength
from forest_addon.sensing.sonar.wood import CylinderStrength
from forest_addon.spec import Air

AIR, SPEED = Air(), 343.0
pytestmark = pytest.mark.usefixtures("computed_by")
KINDS = ("paper", "piston", "exact", "edge", "wood", "rims")
QUIET = {"cull": 0.0, "shading": "none", "near_limit": 1e-3}
ROUGH = 5.0  # times what a table is said to be off by, that it is not smooth by


@dataclass(frozen=True)
class Drawn:
    """Echoes of one kind at distances (M,) m in air that takes loss·f² nepers a metre.

    where : "spread", at "one place" where their errors are in phase, or "equal" as well.
    """

    strength: Strength
    distance: np.ndarray
    loss: float
    start: float
    width: float
    count: int
    tolerance: float
    where: str

    @classmethod
    def random(cls, kind: str, seed: int) -> Drawn:
        rng = np.random.default_rng(seed)
        count = int(np.exp(rng.uniform(np.log(150), np.log(2000))))
        where = str(rng.choice(["spread", "spread", "one place", "equal"]))
        angle = np.arccos(rng.uniform(0, 1, count)) * rng.choice([1.0, 1.0, 0.1])
        largest = rng.choice([0.01, 0.05, 0.12])
        radius = np.exp(rng.uniform(np.log(1e-3), np.log(largest), count))
        distance = rng.uniform(0.5, rng.choice([2.0, 10.0, 30.0]), count)
        if where != "spread":
            distance[:] = distance[0]
        if where == "equal":
            angle[:], radius[:] = angle[0], radius[0]
        one = np.ones(count)
        strength: Strength
        if kind == "edge":
            strength = EdgeStrength(radius, angle, one, radius * np.cos(angle))
        elif kind == "wood":
            sine, cosine = np.sin(angle), np.cos(angle)
            whole = np.zeros((2, count), np.int8)
            strength = CylinderStrength(3.0 * radius, 0.5 * radius, sine, cosine, one, *whole)
        elif kind == "rims":
            weight = rng.normal(size=count) if where == "spread" else one
            strength = RimStrength(0.1 * weight, radius * np.sin(angle))
        else:
            strength = DiscStrength(radius, angle, one, kind)
        return cls(
            strength,
            distance,
            float(rng.choice([0.0, 0.0, 1e-10, 1e-9, 3e-9])),  # in air 1e-11 to 1e-10
            float(rng.uniform(15e3, 80e3)),
            float(np.exp(rng.uniform(np.log(300), np.log(60e3)))),
            int(rng.integers(450, 1500)),
            float(10.0 ** -rng.uniform(2, 8)),
            where,
        )

    def gain(self, frequency: np.ndarray, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(Q, M) of distance and air."""
        away = self.distance[rows]
        return np.exp(-2.0 * self.loss * np.outer(frequency**2, away)) / away**2

    def amplitude(self, frequency: np.ndarray) -> np.ndarray:
        """(Q, M) of all."""
        k = 2.0 * np.pi * frequency / SPEED
        return self.strength.amplitude(k) * self.gain(frequency)

    def sum(self) -> tuple[np.ndarray, float]:
        """Spectrum and estimate of its error by the fast sum, as a ping has them."""
        low, high = self.start, self.start + self.width
        ends = 2.0 * np.pi * low / SPEED, 2.0 * np.pi * high / SPEED
        lost = self.loss * (high**2 - low**2) / (np.pi * self.width) * self.distance
        loud = self.strength.bound(*ends) * self.gain(np.array([low]))[0]
        parts = self.strength.parts(*ends)
        rows = parts.rows

        def amplitude(frequency: np.ndarray, some: np.ndarray) -> np.ndarray:
            k = 2.0 * np.pi * frequency / SPEED
            return parts.strength.select(some).amplitude(k) * self.gain(frequency, rows[some])

        found = sum_delayed(
            amplitude,
            (2.0 * self.distance[rows] + parts.offset) / SPEED,
            low,
            self.width / (self.count - 1),
            self.count,
            tolerance=self.tolerance,
            reach=parts.strength.reach(ends[0]) / SPEED + lost[rows],
            loudness=loud[rows] * parts.share,
        )
        return found.spectrum, found.error * found.size

    def compared(self, seed: int) -> tuple[float, float, float]:
        """Error of the fast sum and its estimate, and what tables are rough by, all of Σ max|A|."""
        spectrum, told = self.sum()
        some = np.random.default_rng(seed).integers(0, self.count, 40)
        some = np.append(some, [0, self.count - 1])
        frequency = self.start + self.width / (self.count - 1) * some
        turns = np.outer(frequency, 2.0 * self.distance / SPEED)
        carrier = np.exp(-2j * np.pi * np.remainder(turns, 1.0))
        exact = (self.amplitude(frequency) * carrier).sum(axis=1)
        band = np.linspace(self.start, self.start + self.width, 33)
        size = float(np.abs(self.amplitude(band)).max(axis=0).sum())
        rough, off = 0.0, self.strength.error(2.0 * np.pi * band[-1] / SPEED)
        if off is not None:
            rough = ROUGH * float(self.gain(band[:1])[0] @ off)
        return float(np.abs(spectrum[some] - exact).max()) / size, told / size, rough / size


def drawn(kind: str, count: int) -> Iterator[tuple[Drawn, float, float, float]]:
    """Scenes of one kind with what ``compared`` found."""
    for seed in range(count):
        scene = Drawn.random(kind, 1000 * KINDS.index(kind) + seed)
        yield scene, *scene.compared(seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_sum_keeps_its_tolerance_and_knows_its_error(kind: str) -> None:
    sharp = []
    for scene, error, told, rough in drawn(kind, 16):
        assert error <= max(scene.tolerance, rough)
        assert told >= error - 1e-10  # rounding of the carriers
        if scene.where == "spread" and error > 1e-9:
            sharp.append(told / error)
    assert np.median(sharp) < 15.0


def test_error_of_the_table_is_bounded() -> None:
    rng = np.random.default_rng(2)
    for ka in [*np.exp(rng.uniform(np.log(0.01), np.log(LAST), 25)), 0.99 * LAST]:
        angle = np.concatenate(
            [rng.uniform(0, np.pi / 2, 300), rng.uniform(0, min(1.5, 9 / ka), 99)]
        )
        off = np.abs(HardDisc(float(ka)).backscatter(angle) - tabulated(np.full(399, ka), angle))
        assert (off / ka <= table_error(np.full(399, ka), angle)).all()
