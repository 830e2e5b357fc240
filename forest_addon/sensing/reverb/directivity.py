"""Directivity of a source: amplitude by the angle from its axis and by frequency.

A table goes in, gains come out. Between the angles of the table the amplitude is linear in their cosine,
between its frequencies linear in the logarithm; beyond its frequencies it stays. So a directivity is a
sum of a few products, one factor of the angle and one of the frequency (a singular value decomposition
of the table), and a sum over paths costs that many sums, each with a gain for every path. For omni and
cardioid it is one product, and exact. Phase is that of the axis everywhere.

A measured directivity as CSV: the first column is the angle from the axis, each further one a frequency.

    angle_deg, 250, 1000, 4000
    0,         0,   0,    0
    90,       -1,  -4,   -9
    180,      -3, -10,  -20

Levels are dB re the axis, or re anything else: they are used as they are. ``-inf`` is silence.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import linalg

from ...formats.foreign import guarded
from ...formats.table import read_columns
from ...spec import Reverb, SpecError


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


def directivity_of(reverb: Reverb, folder: Path) -> Directivity:
    """Directivity of a reverb's sources; ``folder`` is where the name of its file starts from.

    Raises
    ------
    SpecError : the file cannot be used, with the reason.
    """
    if reverb.directivity == "measured":
        return read_directivity(folder / reverb.directivity_file)
    return CARDIOID if reverb.directivity == "cardioid" else OMNI


@guarded("a CSV of levels", key="directivity_file")
def read_directivity(path: Path) -> Directivity:
    """Read a CSV of levels by angle and frequency.

    Raises
    ------
    SpecError : it is missing, has a cell that is no number, or does not reach from 0 to 180°.
    """
    try:
        sheet = read_columns(path)
        head, sheet.lowest = [*sheet.columns], -np.inf
        frequency = np.array([float(name.replace(",", ".")) for name in head[1:]])
        levels = sheet.matrix(*head) if head[1:] else np.empty((0, 1))
    except SpecError as problem:
        raise _wrong(path, problem.problem) from None
    except ValueError:
        raise _wrong(path, "its header must name frequencies in Hz, as 125") from None
    if len(levels) < 2 or not len(frequency):
        raise _wrong(path, "needs a header with frequencies and at least two rows of angles")
    angle = levels[:, 0]
    if angle[0] != 0 or angle[-1] != 180 or (np.diff(angle) <= 0).any():
        raise _wrong(path, "its angles must rise from 0 to 180 degrees")
    if frequency[0] <= 0 or (np.diff(frequency) <= 0).any() or not np.isfinite(frequency).all():
        raise _wrong(path, "the frequencies of its header must rise, and be above 0 Hz")
    if not (levels[:, 1:] <= 200).all():
        raise _wrong(path, "its levels must be below 200 dB")
    return Directivity(np.deg2rad(angle), frequency, 10.0 ** (levels[:, 1:] / 20.0))


def _wrong(path: Path, problem: str) -> SpecError:
    return SpecError("directivity_file", f"{path.name}: {problem}")
