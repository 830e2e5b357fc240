"""Comparisons of a validation: a quantity, as measured and as simulated, each with an interval, and a
verdict."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Interval:
    """A value with the interval that it was measured to; low and high None where nobody knows."""

    value: float
    low: float | None = None
    high: float | None = None

    @staticmethod
    def of(values: np.ndarray, level: float = 0.9) -> Interval:
        """Median of values, and the quantiles that hold ``level`` of them."""
        edge = (1 - level) / 2
        low, middle, high = np.quantile(values, [edge, 0.5, 1 - edge])
        return Interval(float(middle), float(low), float(high))

    def meets(self, other: Interval) -> bool:
        """Return whether the intervals overlap; a value without an interval is a point."""
        mine, theirs = self._ends(), other._ends()
        return mine[0] <= theirs[1] and theirs[0] <= mine[1]

    def _ends(self) -> tuple[float, float]:
        low = self.value if self.low is None else self.low
        return low, self.value if self.high is None else self.high

    def text(self) -> str:
        """As a table shows it."""
        if self.low is None or self.high is None:
            return _number(self.value)
        return f"{_number(self.value)} ({_number(self.low)} to {_number(self.high)})"


@dataclass(frozen=True)
class Picture:
    """A drawn file and the sentence below it."""

    path: Path
    words: str


@dataclass(frozen=True)
class Comparison:
    """One quantity beside its measurement.

    agrees : None where nothing was promised, or nothing was measured.
    before : what was simulated before the model was mended, where it was.
    """

    quantity: str
    unit: str
    measured: Interval | None
    simulated: Interval | None
    agrees: bool | None
    words: str = ""
    before: Interval | None = None
    pictures: tuple[Picture, ...] = ()

    @property
    def verdict(self) -> str:
        """In a word."""
        return {True: "agrees", False: "does not agree", None: "-"}[self.agrees]


def as_record(comparison: Comparison) -> dict:
    """A comparison as JSON keeps it; pictures by the names of their files."""
    record = asdict(comparison)
    record["pictures"] = [
        {"file": picture.path.name, "words": picture.words} for picture in comparison.pictures
    ]
    return record


def from_record(record: dict, folder: Path) -> Comparison:
    """The comparison of a record, its pictures in ``folder``."""
    intervals = {
        name: Interval(**record[name]) if record[name] else None
        for name in ("measured", "simulated", "before")
    }
    pictures = tuple(Picture(folder / p["file"], p["words"]) for p in record["pictures"])
    return Comparison(**(record | intervals | {"pictures": pictures}))


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    if abs(value) < 1e-6:
        return "0"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
