"""Wind over a stand as a closed function of place and time: a sum of plane waves that travel with the gusts.

Mean: logarithmic above the trees, U_h exp(-a (1 - z/h)) among them, a = c_d LAI / (2 β²) (Inoue 1963;
Harman & Finnigan 2007) with β = u*/U_h = 0.3 (Raupach, Finnigan & Brunet 1996), at most 4. Spectrum of each
component: Kaimal's (IEC 61400-1 form), with its peak where it is found at the tops of trees: 0.15 U_h/h
along the wind, 0.45 U_h/h upright (Raupach et al. 1996). Waves travel at 1.8 U_h. Their wave numbers across
are drawn from Cauchy laws, whose characteristic function is Davenport's coherence exp(-c f Δ/U): the
expected coherence is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import stream
from ...spec import Wind

LINES = 256
LOWEST, HIGHEST = 0.005, 8.0  # Hz
DECAY = 10.0  # c of Davenport's coherence, across and upright
TRAVEL = 1.8  # speed of gusts over that of the wind at the tops
SHEAR = 0.3  # friction velocity over the speed at the tops
DRAG = 0.2  # of leaves in canopies, by one-sided area (Katul et al. 2004)
STEEPEST = 4.0  # exponent within canopies
SIDE, UP = 0.8, 0.55  # standard deviations across and upright over that along the wind
PEAKS = (0.15, 0.25, 0.45)  # f h / U_h where f S(f) peaks: along, across, upright
DISPLACED, ROUGH = 0.7, 0.1  # zero plane and roughness length over the height of trees


@dataclass(frozen=True)
class WindField:
    """Wind over trees of a height, its waves drawn.

    speed : mean at the tops, m/s. height : of the tops, m. fade : the exponent a among the trees.
    along : (2,) unit, where it blows to. frequency : (K,) Hz.
    amplitude : (K, 3) m/s of the waves along, across and upright, at the tops.
    phase : (K, 3) radians. across, upright : (K, 3) wave numbers, rad/m.
    """

    speed: float
    height: float
    fade: float
    along: np.ndarray
    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    across: np.ndarray
    upright: np.ndarray

    @classmethod
    def drawn(cls, wind: Wind, height: float, leaf_area_index: float, seed: int) -> WindField:
        """Draw the waves of a scene's wind.

        height : of the trees' tops, m. leaf_area_index : one-sided m² of leaves on a m² of ground.
        """
        rng = stream(seed, "wind")
        edge = np.geomspace(LOWEST, HIGHEST, LINES + 1)
        frequency = edge[:-1] * (edge[1:] / edge[:-1]) ** rng.random(LINES)
        sigma = wind.turbulence * wind.speed * np.array([1.0, SIDE, UP])
        spread = DECAY * frequency[:, None] / wind.speed
        waves = rng.random((4, LINES, 3))
        turn = np.radians(wind.direction_deg)
        power = kaimal(frequency, np.array(PEAKS) * wind.speed / height) * np.diff(edge)[:, None]
        return cls(
            speed=wind.speed,
            height=height,
            fade=min(STEEPEST, DRAG * leaf_area_index / (2 * SHEAR**2)),
            along=np.array([np.cos(turn), np.sin(turn)]),
            frequency=frequency,
            amplitude=sigma * np.sqrt(2 * power),
            phase=2 * np.pi * waves[0],
            across=spread * np.tan(np.pi * (waves[1] - 0.5)),
            upright=spread * np.tan(np.pi * (waves[2] - 0.5)),
        )

    def mean(self, z: np.ndarray) -> np.ndarray:
        """(N,) mean speed at heights (N,) above the ground, m/s."""
        share = np.maximum(z, 0.0) / self.height
        inside = np.exp(-self.fade * (1 - np.minimum(share, 1.0)))
        over = np.log(np.maximum((share - DISPLACED) / ROUGH, np.e)) / np.log(
            (1 - DISPLACED) / ROUGH
        )
        return self.speed * np.where(share > 1, np.maximum(over, 1.0), inside)

    def strength(self, z: np.ndarray) -> np.ndarray:
        """(N,) turbulence at heights over that at the tops; it fades half as fast as the mean."""
        return np.exp(-0.5 * self.fade * (1 - np.clip(z / self.height, 0.0, 1.0)))

    def waves(self, points: np.ndarray) -> np.ndarray:
        """(N, K, 3) complex amplitudes at points (N, 3) in the world: components along, across and upright.

        The wind at a time t is the real part of their sum with exp(2πi f t).
        """
        x = points[:, :2] @ self.along
        y = points[:, :2] @ np.array([-self.along[1], self.along[0]])
        travel = 2 * np.pi * self.frequency / (TRAVEL * self.speed)
        angle = self.phase - (
            (x[:, None] * travel)[:, :, None]
            + y[:, None, None] * self.across
            + points[:, 2][:, None, None] * self.upright
        )
        own = self.amplitude * self.strength(points[:, 2])[:, None, None]
        return np.asarray(own * np.exp(1j * angle))

    def at(self, points: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(N, 3) wind at points (N, 3) and times (N,), m/s in the world's axes."""
        turn = np.exp(2j * np.pi * time[:, None] * self.frequency)
        own = np.einsum("nkc,nk->nc", self.waves(points), turn).real
        own[:, 0] += self.mean(points[:, 2])
        x, y = self.along
        return np.stack(
            [own[:, 0] * x - own[:, 1] * y, own[:, 0] * y + own[:, 1] * x, own[:, 2]], axis=1
        )


def kaimal(frequency: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """(K, C) Kaimal's spectral density of unit variance, 1/Hz, whose f S(f) peaks at frequencies (C,)."""
    scale = 0.25 / peak  # f S = 4 n / (1 + 6 n)^(5/3) peaks at n = 1/4
    n = frequency[:, None] * scale
    return np.asarray(4 * scale / (1 + 6 * n) ** (5 / 3))
