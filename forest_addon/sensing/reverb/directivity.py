"""Directivity of a source: amplitude by the angle from its axis and by frequency.

A table goes in, gains come out. Between the angles of the table the amplitude is linear in their cosine,
between its frequencies linear in the logarithm; beyond its frequencies it stays. So a directivity is a
sum of a few products, one factor of the angle and one of the frequency (a singular value decomposition
of the table), and a sum over paths costs that many sums, each with a gain for every path. For omni and
cardioid it is one product, and exact. Phase is that of the axis everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg


@dataclass(frozen=True)
class Directivity:
    """angle : (A,) radians from the axis, rising from 0 to π. frequency : (F,) Hz, rising.
    gain : (A, F) amplitude.
    """

    angle: np.ndarray
    frequency: np.ndarray
    gain: np.ndarray

    def at(self, cosine: float, frequency: np.ndarray) -> np.ndarray:
        """Gains at (N,) Hz towards one direction, by the cosine of its angle from the axis."""
        row = np.array([self._by_angle(np.array([cosine]), column)[0] for column in self.gain.T])
        return self._by_frequency(frequency, row)

    def around(self, cosine: np.ndarray, frequency: float) -> np.ndarray:
        """Gains at one frequency towards directions, by the cosines (N,) of their angles from the axis."""
        row = np.array([self._by_frequency(np.array([frequency]), one)[0] for one in self.gain])
        return self._by_angle(cosine, row)

    def terms(self, tolerance: float) -> list[Term]:
        """The products that make up the table, to an error relative to its norm."""
        left, size, right = linalg.svd(self.gain, full_matrices=False)
        rest = np.sqrt(np.cumsum(size[::-1] ** 2)[::-1])
        count = int(np.count_nonzero(rest > tolerance * rest[0]))
        return [Term(self, left[:, n] * size[n], right[n]) for n in range(max(1, count))]

    def _by_angle(self, cosine: np.ndarray, column: np.ndarray) -> np.ndarray:
        return np.interp(cosine, np.cos(self.angle[::-1]), column[::-1])

    def _by_frequency(self, frequency: np.ndarray, row: np.ndarray) -> np.ndarray:
        if len(row) == 1:
            return np.full(len(frequency), row[0])
        low = self.frequency[0]
        return np.interp(np.log(np.maximum(frequency, low)), np.log(self.frequency), row)


@dataclass(frozen=True)
class Term:
    """One product: ``of_angle`` (A,) times ``of_frequency`` (F,), at the table's places."""

    table: Directivity
    of_angle: np.ndarray
    of_frequency: np.ndarray

    @property
    def flat(self) -> bool:
        """Return whether the gain is the same at all frequencies."""
        return bool(np.all(self.of_frequency == self.of_frequency[0]))

    def gains(self, cosine: np.ndarray) -> np.ndarray:
        """(M,) factors of directions, by the cosines of their angles from the axis."""
        return self.table._by_angle(cosine, self.of_angle)

    def spectrum(self, frequency: np.ndarray) -> np.ndarray:
        """(N,) factors at frequencies."""
        return self.table._by_frequency(frequency, self.of_frequency)


def _pattern(front: float, back: float) -> Directivity:
    return Directivity(np.array([0.0, np.pi]), np.array([1.0]), np.array([[front], [back]]))


OMNI = _pattern(1.0, 1.0)
CARDIOID = _pattern(1.0, 0.0)  # (1 + cos θ)/2
