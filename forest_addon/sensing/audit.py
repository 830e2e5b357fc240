"""What an audit says: a random sample of a result, computed again by the slow exact way.

A sensor's own audit (``lidar/audit``, ``sonar/audit``, ``reverb/audit``) hands over batches of errors in a
seeded order; batches are taken until they have cost their share of the time that the result took, at
least one. So the sample does not depend on what it will find.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Audit:
    """How far a result is from the exact one.

    what : what was compared, and with what. checked : how many values. error, rms : largest and root mean
    square difference, in ``unit``. allowed : the largest that was asked for. seconds : the fast way took for
    the whole result. exact_seconds : the exact way would take for it, estimated from the sample.
    audit_seconds : the audit itself took.
    """

    what: str
    checked: int
    error: float
    rms: float
    allowed: float
    seconds: float
    exact_seconds: float
    unit: str = ""
    audit_seconds: float = 0.0

    @property
    def kept(self) -> bool:
        """Whether the largest error is within what was asked for; one that is not a number is not."""
        return self.error <= self.allowed

    @property
    def times(self) -> float:
        """How many times as fast the result was made as the exact way would."""
        return self.exact_seconds / self.seconds if self.seconds > 0 else math.inf

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        verdict = "" if self.kept else f", MORE than the {self.allowed:.0e}{unit} allowed"
        faster = f"; about {self.times:,.3g} times as fast" if self.times > 1 else ""
        return (
            f"{self.what}: {self.checked:,} checked, {self.error:.0e}{unit} off at most"
            f"{verdict}{faster}"
        )

    def record(self) -> dict[str, float | int | str]:
        """What stands in run.json."""
        return {
            "what": self.what,
            "checked": self.checked,
            "error": self.error,
            "rms": self.rms,
            "allowed": self.allowed,
            "unit": self.unit,
            "seconds": self.seconds,
            "exact_seconds": self.exact_seconds,
            "audit_seconds": self.audit_seconds,
            "share": self.audit_seconds / self.seconds if self.seconds > 0 else 0.0,
        }


@dataclass(frozen=True)
class Sampled:
    """Errors (N,) of a sample, and the seconds that one of its values took the exact way."""

    errors: np.ndarray
    seconds_each: float

    @property
    def largest(self) -> float:
        """NaN where any is."""
        return float(self.errors.max(initial=0.0))

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.errors**2))) if len(self.errors) else 0.0


def sample(batches: Iterable[np.ndarray], seconds: float) -> Sampled:
    """Take batches of errors until they have cost ``seconds``, at least one."""
    begin = time.process_time()
    taken: list[np.ndarray] = []
    for errors in batches:
        taken.append(np.asarray(errors, dtype=np.float64))
        if time.process_time() - begin >= seconds:
            break
    found = np.concatenate(taken) if taken else np.empty(0)
    spent = time.process_time() - begin
    return Sampled(found, spent / max(len(found), 1))
