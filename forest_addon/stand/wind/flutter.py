"""Flutter of leaves about their stalks, relative to the branch that bears them.

Leaves begin to flutter by torsional galloping at a wind of a metre or two a second, and then hardly more as
it grows (Tadrist et al. 2015, J. Fluids Struct. 56; 2018, J. R. Soc. Interface 15), while branches move
ever more. A leaf turns about its midrib and nods across it; two close tones of its own make it come and go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import daughter_keys, keyed_normal, keyed_uniform

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
        phases = [keyed_uniform(daughter_keys(key, "flutter"), name) for name in "abcd"]
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
