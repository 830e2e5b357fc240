"""Audits: parts of a result, held against the same computed again by the slow exact way.

A sensor's own audit (``lidar/audit``, ``sonar/audit``, ``reverb/audit``) makes a ``Check`` of each kind of
thing that its result holds. A check takes batches of errors in a seeded order, until they have cost their
share of the time that the result took and are ``LEAST``, or until patience ends. So the sample does not
depend on what it will find.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

LEAST = 100  # values of each kind
PATIENCE = 0.1  # s that a check may take beyond its share, to see as many


@dataclass(frozen=True)
class Check:
    """One kind of thing in a result.

    what : what was compared, and with what. checked, of : how many values, and how many the result has.
    error, rms : largest and root mean square difference, in ``unit``; infinite where something is missing
    or is called what it is not. allowed : the largest that was asked for.
    """

    what: str
    checked: int
    of: int
    error: float
    rms: float
    allowed: float
    unit: str = ""

    @classmethod
    def on(cls, what: str, errors: np.ndarray, of: int, allowed: float, unit: str = "") -> Check:
        """Check of errors (N,)."""
        errors = np.asarray(errors, dtype=np.float64)
        rms = float(np.sqrt(np.mean(errors**2))) if len(errors) else 0.0
        return cls(
            what, len(errors), of, float(errors.max(initial=0.0)), rms, allowed, unit
        )  # NaN where any is

    @property
    def kept(self) -> bool:
        """Return whether the largest error is within what was asked for; one that is not a number is not."""
        return self.error <= self.allowed

    @property
    def share(self) -> float:
        """Share of all that the result has of this kind that was checked."""
        return min(self.checked / self.of, 1.0) if self.of else 1.0

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        verdict = "" if self.kept else f", MORE than the {self.allowed:.0e}{unit} allowed"
        some = "all" if self.checked >= self.of else f"{_percent(self.share)} of {self.of:,}"
        error = f"{self.error:.0e}" if self.error else "0"
        off = f"{error}{unit} off at most" if np.isfinite(self.error) else "WRONG"
        return f"{self.checked:,} {self.what} ({some}), {off}{verdict}"

    def record(self) -> dict[str, float | int | str]:
        """Entries of run.json."""
        said = {name: _written(value) for name, value in vars(self).items()}
        return said | {"share": self.share, "kept": self.kept}


@dataclass(frozen=True)
class Audit:
    """Distance of a result from the exact one, kind by kind.

    checks : of each kind of thing in it, at least one. seconds : the fast way took for the whole result.
    exact_seconds : the exact way would take for it, estimated from the sample. audit_seconds : the audit
    itself took.
    """

    checks: tuple[Check, ...]
    seconds: float
    exact_seconds: float
    audit_seconds: float = 0.0

    @property
    def worst(self) -> Check:
        """The check that uses most of what it is allowed."""
        return max(self.checks, key=_used)

    @property
    def kept(self) -> bool:
        """Return whether every check is."""
        return all(check.kept for check in self.checks)

    @property
    def checked(self) -> int:
        """Number of values checked, of all kinds."""
        return sum(check.checked for check in self.checks)

    @property
    def error(self) -> float:
        """Largest error of the worst check, in its ``unit``."""
        return self.worst.error

    @property
    def allowed(self) -> float:
        """Error allowed by the worst check."""
        return self.worst.allowed

    @property
    def unit(self) -> str:
        """Unit of the worst check."""
        return self.worst.unit

    @property
    def times(self) -> float:
        """Ratio of the time that the exact way would take to that of the result."""
        return self.exact_seconds / self.seconds if self.seconds > 0 else math.inf

    def __str__(self) -> str:
        times = float(f"{self.times:.3g}")
        said = f"{times:,.0f}" if times >= 100 else f"{times:g}"
        faster = f"; about {said} times as fast as the exact way"
        return "; ".join(map(str, self.checks)) + (faster if self.times > 1 else "")

    def record(self) -> dict[str, object]:
        """Entries of run.json."""
        return {
            "kept": self.kept,
            "checked": self.checked,
            "error": _written(self.error),
            "allowed": self.allowed,
            "unit": self.unit,
            "checks": [check.record() for check in self.checks],
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


def sample(
    batches: Iterable[np.ndarray], seconds: float, least: int = 0, patience: float = PATIENCE
) -> Sampled:
    """Take batches of errors until they have cost ``seconds``, at least one.

    least : values that are wanted, even if they cost more; at most ``patience`` s are spent on that.
    """
    begin = time.perf_counter()
    taken: list[np.ndarray] = []
    count = 0
    for errors in batches:
        taken.append(np.asarray(errors, dtype=np.float64))
        count += len(taken[-1])
        spent = time.perf_counter() - begin
        if spent >= (seconds if count >= least else max(seconds, patience)):
            break
    found = np.concatenate(taken) if taken else np.empty(0)
    spent = time.perf_counter() - begin
    return Sampled(found, spent / max(len(found), 1))


def joined(checks: Sequence[Check | None]) -> tuple[Check, ...]:
    """Those there are."""
    return tuple(check for check in checks if check is not None)


def _written(value: float | int | str) -> float | int | str:
    """A number as a file of numbers has it, which knows none that is not finite."""
    return value if isinstance(value, str) or math.isfinite(value) else str(value)


def _used(check: Check) -> float:
    """Share of what is allowed; infinite where it is not kept and the error is no number."""
    if not check.kept and not np.isfinite(check.error):
        return math.inf
    return check.error / check.allowed if check.allowed else (math.inf if check.error else 0.0)


def _percent(share: float) -> str:
    return "<0.1 %" if share < 0.001 else f"{100 * share:.{0 if share >= 0.1 else 1}f} %"
