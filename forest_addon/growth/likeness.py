"""Likeness of grown trees to the one that they are to be like: means, spreads, distributions, profiles.

A number is compared by its mean over the siblings, in per cent of the template's and in standard
deviations of the siblings. Samples, such as all insertion angles, are pooled and compared by the distance
of Kolmogorov and Smirnov and by that of the earth mover (the area between both distributions, in their own
unit). Profiles are compared by their overlap, Σ min(p, q).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import wasserstein_distance

from .portrait import Portrait

MOST_DIFFERENCE, LEAST_OVERLAP, MOST_SPREADS = 0.10, 0.85, 2.0  # the goals


@dataclass(frozen=True)
class Number:
    """One number of the template and of its siblings.

    spread : standard deviation over the siblings. room : a difference that is none, whatever the per cent.
    """

    name: str
    template: float
    mean: float
    spread: float
    room: float = 0.0

    @property
    def difference(self) -> float:
        """Of the mean from the template, over the template."""
        return (self.mean - self.template) / abs(self.template) if self.template else 0.0

    @property
    def spreads(self) -> float:
        """Of the template from the mean, in standard deviations of the siblings."""
        return abs(self.mean - self.template) / self.spread if self.spread else 0.0

    @property
    def good(self) -> bool:
        """Return whether the goals are met; decibels are compared by what they differ."""
        apart = abs(self.mean - self.template)
        near = apart <= max(MOST_DIFFERENCE * abs(self.template), self.room)
        if self.name.endswith("dB"):
            near = apart <= 1.0
        return near and (self.spreads <= MOST_SPREADS or abs(self.difference) < 0.01)


@dataclass(frozen=True)
class Sample:
    """A distribution: distance of Kolmogorov and Smirnov, and of the earth mover; both means."""

    name: str
    template: float
    mean: float
    kolmogorov: float
    mover: float


@dataclass(frozen=True)
class Profile:
    """The overlap of the siblings' mean profile with the template's, and that of one sibling in the mean."""

    name: str
    overlap: float
    single: float

    @property
    def good(self) -> bool:
        """Return whether the goal is met."""
        return self.overlap >= LEAST_OVERLAP


@dataclass(frozen=True)
class Likeness:
    """All comparisons of siblings with their template."""

    numbers: tuple[Number, ...]
    samples: tuple[Sample, ...]
    profiles: tuple[Profile, ...]

    @property
    def missed(self) -> list[str]:
        """Names of what is outside the goals."""
        numbers = [row.name for row in self.numbers if not row.good]
        return numbers + [row.name for row in self.profiles if not row.good]


def compare(template: Portrait, siblings: Sequence[Portrait]) -> Likeness:
    """Compare siblings with the tree they are to be like."""
    numbers = []
    for name, value in template.numbers.items():
        found = np.array([one.numbers.get(name, 0.0) for one in siblings])
        room = 0.02 * template.numbers["height, m"] if name == "crown base, m" else 0.0
        numbers.append(Number(name, value, float(found.mean()), float(found.std(ddof=1)), room))
    samples = []
    for name, values in template.samples.items():
        pooled = np.concatenate([one.samples.get(name, np.empty(0)) for one in siblings])
        if len(values) and len(pooled):
            samples.append(
                Sample(
                    name,
                    float(values.mean()),
                    float(pooled.mean()),
                    kolmogorov(values, pooled),
                    float(wasserstein_distance(values, pooled)),
                )
            )
    profiles = []
    for name, values in template.profiles.items():
        each = np.array([one.profiles[name] for one in siblings])
        profiles.append(
            Profile(
                name,
                float(np.minimum(values, each.mean(axis=0)).sum()),
                float(np.minimum(values, each).sum(axis=1).mean()),
            )
        )
    return Likeness(tuple(numbers), tuple(samples), tuple(profiles))


def kolmogorov(one: np.ndarray, other: np.ndarray) -> float:
    """The largest distance between two empirical distributions."""
    places = np.sort(np.concatenate([one, other]))
    low = np.searchsorted(np.sort(one), places, side="right") / len(one)
    high = np.searchsorted(np.sort(other), places, side="right") / len(other)
    return float(np.abs(low - high).max())
