"""Multiple scattering averaged over stands, exact, against the sums that stand in for it.

A disc of trunks at random, a few sources and many receivers in it; in a band of frequencies the exact field
(``acoustics.multiple``) and that of single scattering are computed, turned into energy by path length, and
averaged over pairs and stands. Beside them: single scattering with extinction, and transport.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from forest_addon.acoustics.extinction import cross_sections
from forest_addon.acoustics.multiple import scattered_fields
from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.forest.transport import Density, PhaseFunction, transported

SPEED = 343.0
BAND = 0.5  # width over the middle of the band of frequencies
CELL = 0.25  # m, of the density
PACKETS = 40_000
WAYS = (
    "single",
    "single, energy extinction",
    "single, coherent extinction",
    "transport",
    "transport without shadow",
)


@dataclass(frozen=True)
class Ensemble:
    """Trunks of one radius in a disc of ``extent`` metres radius; ends ``distance`` apart; ka mid-band."""

    trunks: int
    radius: float
    extent: float
    ka: float
    distance: float = 4.0
    stands: int = 3
    sources: int = 4
    receivers: int = 12

    @property
    def density(self) -> float:
        """Trunks per m²."""
        return self.trunks / (math.pi * self.extent**2)

    @property
    def frequency(self) -> float:
        """Hz, the middle of the band."""
        return self.ka * SPEED / (2.0 * math.pi * self.radius)


@dataclass(frozen=True)
class JudgedSum:
    """By path length (X + 1,) edges in metres: the exact energy, and of each way its level above it in dB.

    spread : (X,) dB, standard deviation of the exact mean over stands and sources.
    """

    edges: np.ndarray
    exact: np.ndarray
    spread: np.ndarray
    level: dict[str, np.ndarray]


def judge(case: Ensemble, edges: np.ndarray, seed: int = 1) -> JudgedSum:
    """Run an ensemble. edges : (X + 1,) metres of path, the last within the disc's echoes."""
    period = 2.5 * float(edges[-1])  # m, after which sound would come again
    step = SPEED / period
    half = max(8, int(0.5 * BAND * case.frequency / step))
    frequency = case.frequency + step * np.arange(-half, half + 1)
    window = np.hanning(len(frequency) + 2)[1:-1]
    every, once = [], []
    for number in range(case.stands):
        rng = stream(seed, "ensemble", case.trunks, number)
        sources, receivers = _ends(case, rng)
        centre = _stand(case, rng, np.concatenate([sources, receivers.reshape(-1, 2)]))
        radius = np.full(len(centre), case.radius)
        orders = math.ceil(case.ka * (1 + BAND / 2) + 2.3 * case.ka ** (1 / 3) + 1)
        fields = [
            scattered_fields(f, centre, radius, sources, receivers.reshape(-1, 2), SPEED, orders)
            for f in frequency.tolist()
        ]
        for kept, found in zip((every, once), zip(*fields, strict=True), strict=True):
            spectra = np.array(found).reshape(len(frequency), case.sources, case.sources, -1)
            own = np.einsum("fssr->fsr", spectra)  # each source hears its own circle
            kept.append(_by_length(own * window[:, None, None], window, step, edges))
    exact, single = (np.concatenate(part) for part in (every, once))  # (stands·S, X)
    mean = exact.mean(axis=0)
    spread = exact.std(axis=0) / math.sqrt(len(exact)) / mean
    level = {name: 10.0 * np.log10(part / mean) for name, part in _ways(case, edges, single, seed)}
    return JudgedSum(edges, mean, 10.0 * np.log10(1.0 + spread), level)


def _ways(
    case: Ensemble, edges: np.ndarray, single: np.ndarray, seed: int
) -> list[tuple[str, np.ndarray]]:
    middle = 0.5 * (edges[1:] + edges[:-1])
    once = single.mean(axis=0)
    widths = cross_sections(np.array([case.ka]))
    lost = [
        np.exp(-case.density * case.radius * width * middle)
        for width in (widths.energy[0], widths.extinction[0])
    ]
    found = [(WAYS[0], once), (WAYS[1], once * lost[0]), (WAYS[2], once * lost[1])]
    density = _disc(case)
    for name, way in ((WAYS[3], "coherent"), (WAYS[4], "energy")):
        phase = PhaseFunction.of(case.frequency, np.array([case.radius]), SPEED, 0.0, way)
        total = np.zeros(len(middle))
        for number in range(case.sources):
            rng = stream(seed, "ensemble", "packets", number)
            turn = 2.0 * math.pi * number / case.sources
            source = 0.3 * case.extent * np.array([math.cos(turn), math.sin(turn)])
            for side in (1.0, -1.0):
                receiver = source + side * case.distance * np.array([0.6, 0.8])
                energy = transported(phase, density, source, receiver, edges, PACKETS // 4, rng)
                total += energy.once + energy.again
        found.append((name, total * middle / (2.0 * case.sources)))  # in the plane: 2πP
    return found


def _disc(case: Ensemble) -> Density:
    side = math.ceil(2.0 * case.extent / CELL)
    place = (np.arange(side) + 0.5) * CELL - case.extent
    inside = np.hypot(*np.meshgrid(place, place, indexing="ij")) <= case.extent
    return Density(case.density * inside, (-case.extent, -case.extent), (CELL, CELL), 0.0)


def _ends(case: Ensemble, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(S, 2) sources, and (S, R, 2) receivers around each."""
    turn = 2.0 * math.pi * (np.arange(case.sources) + rng.random()) / case.sources
    sources = 0.3 * case.extent * np.column_stack([np.cos(turn), np.sin(turn)])
    around = 2.0 * math.pi * (np.arange(case.receivers) + rng.random()) / case.receivers
    circle = case.distance * np.column_stack([np.cos(around), np.sin(around)])
    return sources, sources[:, None] + circle


def _stand(case: Ensemble, rng: np.random.Generator, clear: np.ndarray) -> np.ndarray:
    """(N, 2) trunks at random, none over another or over an end."""
    placed: list[np.ndarray] = []
    while len(placed) < case.trunks:
        place = rng.uniform(-case.extent, case.extent, 2)
        if np.hypot(*place) > case.extent or np.hypot(*(clear - place).T).min() < 1.2 * case.radius:
            continue
        if placed and np.hypot(*(np.array(placed) - place).T).min() < 2.05 * case.radius:
            continue
        placed.append(place)
    return np.array(placed)


def _by_length(
    spectra: np.ndarray, window: np.ndarray, step: float, edges: np.ndarray
) -> np.ndarray:
    """(S, X) energy a metre of path: an arrival 1/√r gives 1/r in all."""
    size = 4 * len(window)
    length = np.arange(size) * (SPEED / step / size)
    whole = float((np.abs(np.fft.ifft(window, size)) ** 2).sum()) * (length[1] - length[0])
    energy = np.abs(np.fft.ifft(spectra, size, axis=0)) ** 2 / whole  # (T, S, R)
    mean = energy.mean(axis=2)
    rows = np.searchsorted(edges, length, side="right") - 1
    found = np.array([mean[rows == n].mean(axis=0) for n in range(len(edges) - 1)])
    return found.T
