"""Wind over a stand as a closed function of place and time: a sum of plane waves that travel with the gusts.

Mean: logarithmic above the trees, U_h exp(-(ζ_h - ζ(z))/(2 β²)) among them, ζ(z) the drag area below z over
the ground's (Massman 1997, Boundary-Layer Meteorol. 83:407), β = u*/U_h = 0.320 - 0.264 exp(-15.1 ζ_h)
(same source): the trees of a stand then take the momentum ρ u*² (1 - exp(-ζ_h/β²)) that the wind loses,
however their leaves are spread. Spectrum of each component: Kaimal's (IEC 61400-1 form), with its peak
where it is found at the tops of trees: 0.15 U_h/h along the wind, 0.45 U_h/h upright (Raupach, Finnigan &
Brunet 1996). Waves travel at 1.8 U_h. Their wave numbers across are drawn from Cauchy laws, whose
characteristic function is Davenport's coherence exp(-c f Δ/U): the expected coherence is exact. Lines lie
close enough that the spectrum of an hour has no gaps where trees answer.

Leaves flutter about their stalks, relative to the branch that bears them. Leaves begin to flutter by
torsional galloping at a wind of a metre or two a second, and then hardly more as it grows (Tadrist et al.
2015, J. Fluids Struct. 56; 2018, J. R. Soc. Interface 15), while branches move ever more. A leaf turns
about its midrib and nods across it; two close tones of its own make it come and go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import child_keys, keyed_normal, keyed_uniform, stream
from ...spec import Wind

LOWEST, HIGHEST = 0.005, 8.0  # Hz
EVEN = (0.1, 2.0)  # Hz, between which lines lie at equal steps
STEPS = (100, 633, 47)  # lines below, within and above: 3 % apart, 0.003 Hz, 3 %
DECAY = 10.0  # c of Davenport's coherence, across and upright
TRAVEL = 1.8  # speed of gusts over that of the wind at the tops
DRAG = 0.2  # of leaves in canopies, by one-sided area (Katul et al. 2004)
SIDE, UP = 0.8, 0.55  # standard deviations across and upright over that along the wind
PEAKS = (0.15, 0.25, 0.45)  # f h / U_h where f S(f) peaks: along, across, upright
DISPLACED, ROUGH = 0.7, 0.1  # zero plane and roughness length over the height of trees


@dataclass(frozen=True)
class WindField:
    """Wind over trees of a height, its waves drawn.

    speed : mean at the tops, m/s. height : of the tops, m. shelter : (Q + 1,) drag area above the edges of Q
    equal layers from the ground to the tops, over the ground's. along : (2,) unit, where it blows to.
    frequency : (K,) Hz. amplitude : (K, 3) m/s of the waves along, across and upright, at the tops.
    phase : (K, 3) radians. across, upright : (K, 3) wave numbers, rad/m.
    """

    speed: float
    height: float
    shelter: np.ndarray
    along: np.ndarray
    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    across: np.ndarray
    upright: np.ndarray

    @classmethod
    def drawn(cls, wind: Wind, height: float, drag_area: np.ndarray, seed: int) -> WindField:
        """Draw the waves of a scene's wind.

        height : of the trees' tops, m. drag_area : (Q,) drag coefficient times area of what stands in each of
        Q equal layers from the ground to the tops, over the ground's area (a drag of ρ times that times U²).
        """
        rng = stream(seed, "wind")
        edge = _edges()
        frequency = edge[:-1] + np.diff(edge) * rng.random(len(edge) - 1)
        sigma = wind.turbulence * wind.speed * np.array([1.0, SIDE, UP])
        spread = DECAY * frequency[:, None] / wind.speed
        waves = rng.random((4, len(frequency), 3))
        turn = np.radians(wind.direction_deg)
        power = kaimal(frequency, np.array(PEAKS) * wind.speed / height) * np.diff(edge)[:, None]
        return cls(
            speed=wind.speed,
            height=height,
            shelter=np.append(np.cumsum(drag_area[::-1])[::-1], 0.0),
            along=np.array([np.cos(turn), np.sin(turn)]),
            frequency=frequency,
            amplitude=sigma * np.sqrt(2 * power),
            phase=2 * np.pi * waves[0],
            across=spread * np.tan(np.pi * (waves[1] - 0.5)),
            upright=spread * np.tan(np.pi * (waves[2] - 0.5)),
        )

    @property
    def friction(self) -> float:
        """Friction velocity over the speed at the tops, β."""
        return 0.320 - 0.264 * float(np.exp(-15.1 * self.shelter[0]))

    def mean(self, z: np.ndarray) -> np.ndarray:
        """(N,) mean speed at heights (N,) above the ground, m/s."""
        share = np.maximum(z, 0.0) / self.height
        over = np.log(np.maximum((share - DISPLACED) / ROUGH, np.e)) / np.log(
            (1 - DISPLACED) / ROUGH
        )
        return self.speed * np.where(share > 1, np.maximum(over, 1.0), np.exp(-self._faded(z)))

    def strength(self, z: np.ndarray) -> np.ndarray:
        """(N,) turbulence at heights over that at the tops; it fades half as fast as the mean."""
        return np.exp(-0.5 * self._faded(z))

    def _faded(self, z: np.ndarray) -> np.ndarray:
        edges = np.linspace(0.0, self.height, len(self.shelter))
        return np.asarray(np.interp(z, edges, self.shelter) / (2 * self.friction**2))

    def waves(self, points: np.ndarray) -> np.ndarray:
        """(N, K, 3) complex amplitudes at points (N, 3) in the world: components along, across and upright.

        The wind at a time t is the real part of their sum with exp(2πi f t).
        """
        waves = np.empty((len(points), len(self.frequency), 3), dtype=np.complex128)
        for part in range(3):
            cos, sin = self._turned(points, part)
            waves[:, :, part].real, waves[:, :, part].imag = cos, sin
        waves *= self.amplitude
        waves *= self.strength(points[:, 2])[:, None, None]
        return waves

    def push(self, points: np.ndarray, lever: np.ndarray) -> np.ndarray:
        """(K, M) complex amplitudes of the sum over points (N, 3) and components of ``waves`` times levers
        (N, M, 3)."""
        lever = lever * self.strength(points[:, 2])[:, None, None]
        total = np.zeros((len(self.frequency), lever.shape[1]), dtype=np.complex128)
        for part in range(3):
            own = np.ascontiguousarray(lever[:, :, part])
            cos, sin = self._turned(points, part)
            total += ((cos.T @ own) + 1j * (sin.T @ own)) * self.amplitude[:, part, None]
        return total

    def _turned(self, points: np.ndarray, part: int) -> tuple[np.ndarray, np.ndarray]:
        """(N, K) cosine and sine of the angle of the waves of a component at points (N, 3).

        Whole turns are taken off in float64; what is left goes through float32: 1e-7 of an amplitude.
        """
        x = points[:, :2] @ self.along
        y = points[:, :2] @ np.array([-self.along[1], self.along[0]])
        number = np.column_stack(
            [self.frequency / (TRAVEL * self.speed), self.across[:, part] / (2 * np.pi)]
        )
        number = np.column_stack([number, self.upright[:, part] / (2 * np.pi)])
        turns = self.phase[:, part] / (2 * np.pi) - np.column_stack([x, y, points[:, 2]]) @ number.T
        turns -= np.rint(turns)
        angle = (2 * np.pi * turns).astype(np.float32)
        return np.cos(angle).astype(np.float64), np.sin(angle).astype(np.float64)

    def at(self, points: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(N, 3) wind at points (N, 3) and times (N,), m/s in the world's axes."""
        turn = np.exp(2j * np.pi * time[:, None] * self.frequency)
        own = np.einsum("nkc,nk->nc", self.waves(points), turn).real
        own[:, 0] += self.mean(points[:, 2])
        x, y = self.along
        return np.stack(
            [own[:, 0] * x - own[:, 1] * y, own[:, 0] * y + own[:, 1] * x, own[:, 2]], axis=1
        )


def _edges() -> np.ndarray:
    below, within, above = STEPS
    return np.concatenate(
        [
            np.geomspace(LOWEST, EVEN[0], below + 1),
            np.linspace(*EVEN, within + 1)[1:],
            np.geomspace(EVEN[1], HIGHEST, above + 1)[1:],
        ]
    )


def kaimal(frequency: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """(K, C) Kaimal's spectral density of unit variance, 1/Hz, whose f S(f) peaks at frequencies (C,)."""
    scale = 0.25 / peak  # f S = 4 n / (1 + 6 n)^(5/3) peaks at n = 1/4
    n = frequency[:, None] * scale
    return np.asarray(4 * scale / (1 + 6 * n) ** (5 / 3))


ONSET = 1.5  # m/s
TWIST, NOD = 0.30, 0.15  # radians, standard deviations once it flutters
TONE, SPREAD = 5.0, 0.3  # Hz, and the standard deviation of its logarithm
APART = 0.15  # between the two tones, over the first


@dataclass(frozen=True)
class Flutter:
    """Flutter of N leaves: twist and nod, each of two tones.

    size : (N, 2) radians of each tone of twist and nod. rate : (N, 4) rad/s. phase : (N, 4).
    """

    size: np.ndarray
    rate: np.ndarray
    phase: np.ndarray

    @classmethod
    def of(cls, key: np.ndarray, wind: np.ndarray) -> Flutter:
        """The flutter of leaves with keys (N,) in local mean winds (N,) m/s."""
        share = wind**2 / (ONSET**2 + wind**2)
        tone = TONE * np.exp(SPREAD * keyed_normal(key, "flutter"))
        rates = [tone, tone * (1 + APART), 0.6 * tone, 0.6 * tone * (1 + APART)]
        phases = [keyed_uniform(child_keys(key, "flutter"), name) for name in "abcd"]
        return cls(
            size=np.stack([TWIST * share, NOD * share], axis=1),
            rate=2 * np.pi * np.stack(rates, axis=1),
            phase=2 * np.pi * np.stack(phases, axis=1),
        )

    def angles(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 2) twist and nod at times (N,), radians, and their rates."""
        turn = self.rate * time[:, None] + self.phase
        value = np.sin(turn).reshape(-1, 2, 2).sum(axis=2)
        rate = (self.rate * np.cos(turn)).reshape(-1, 2, 2).sum(axis=2)
        return self.size * value, self.size * rate
