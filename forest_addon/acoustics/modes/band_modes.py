"""Functions over one band of wavenumbers that many echoes are sums of: modes, at Chebyshev points."""

from __future__ import annotations

import numpy as np

from .. import chebyshev

RANKS = (3, 4, 6, 9, 12, 15, 18, 21, 24, 27, 30, 33, 36, 39, 42, 45, 50, 56, 64, 72)
KEPT = 6  # tables, and sets of wavenumbers in each


class BandModes:
    """Modes between two wavenumbers (1/m).

    wavenumber : (K,) Chebyshev points of the band. modes : (K, R), orthonormal, the largest first. ranks :
    how many of them may be used.
    """

    modes: np.ndarray
    ranks: tuple[int, ...]

    def __init__(self, ends: tuple[float, float], count: int) -> None:
        self._ends, self.count = ends, count
        middle, half = (ends[0] + ends[1]) / 2, (ends[1] - ends[0]) / 2
        self.wavenumber = middle + half * chebyshev.points(count)
        self._at: dict[bytes, np.ndarray] = {}

    def keep(self, modes: np.ndarray) -> None:
        """Take modes (K, R) as those of the band."""
        self.modes = modes
        most = modes.shape[1]
        self.ranks = (*(rank for rank in RANKS if rank < most), most)

    def at(self, wavenumber: np.ndarray, rank: int) -> np.ndarray:
        """(R, Q) the first modes at wavenumbers (Q,) of the band."""
        key = np.asarray(wavenumber, np.float64).tobytes()
        if key not in self._at:
            low, high = self._ends
            place = (2.0 * wavenumber - low - high) / (high - low)
            if len(self._at) >= KEPT:
                self._at.clear()
            self._at[key] = self.modes.T @ chebyshev.lagrange(self.count, place)
        return self._at[key][:rank]
