"""Audits: a result held against the same computed again by the slow exact way, on a sample of its values.

A sensor says in ``AuditPart``s what its result holds: how many values of a kind there are, and the errors
of those with some numbers, which it computes again or derives from others. ``held`` draws the numbers, one
from each of so many equal stretches, and makes a ``Check`` of what it sees. How many are drawn depends on
the result alone, never on a clock, so that an audit says the same whenever it is made. n values drawn of
many miss an error that is in a share p of them with a chance of at most (1 - p)^n, and never one in two
whole stretches that follow each other.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST = 100  # values of each kind, or all there are
MISSED = 0.05  # chance of missing an error in the share of values that a check says it sees
AT_ONCE = 1 << 18  # values that are looked at together
FIGURE = 1e-9  # of a figure that is computed again


@dataclass(frozen=True)
class AuditPart:
    """Values of one kind in a result, and how to look at some of them again.

    of : how many there are. look : errors (K, N), or (N,), of the values with numbers (N,), ascending;
    infinite where something is missing or is called what it is not. kinds : (what, allowed, unit) of each
    of the K.
    count : how many are drawn; None: all. also : numbers that are looked at besides.
    exact : whether looking is the exact way, whose time tells what the whole result would take.
    """

    of: int
    look: Callable[[np.ndarray], np.ndarray]
    kinds: tuple[tuple[str, float, str], ...]
    count: int | None = None
    also: np.ndarray | None = None
    exact: bool = False

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """Numbers (N,), ascending: one from each of ``count`` equal stretches, and ``also`` others."""
        number = one_of_each(self.of, self.of if self.count is None else self.count, rng)
        return number if self.also is None else np.union1d(number, self.also)


def one_of_each(of: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Numbers (N,) below ``of``, ascending: one from each of ``count`` equal stretches, or all."""
    if count >= of:
        return np.arange(of)
    ends = np.arange(count + 1) * of // count
    return np.asarray(rng.integers(ends[:-1], ends[1:]))


def held(parts: Sequence[AuditPart], rng: np.random.Generator, seconds: float) -> Audit:
    """The audit of a result that took ``seconds``; errors of the same kind in several parts are one check."""
    seen: dict[tuple[str, float, str], list[tuple[np.ndarray, int]]] = {}
    exact = 0.0
    for part in parts:
        if not part.of:
            continue
        begin, number = time.perf_counter(), part.drawn(rng)
        looked = [
            np.atleast_2d(part.look(number[first : first + AT_ONCE]))
            for first in range(0, len(number), AT_ONCE)
        ]
        if part.exact:
            exact += (time.perf_counter() - begin) / len(number) * part.of
        for kind, errors in zip(part.kinds, np.hstack(looked), strict=True):
            seen.setdefault(kind, []).append((errors, part.of))
    checks = [
        Check.on(what, np.concatenate([e for e, _ in each]), sum(n for _, n in each), limit, unit)
        for (what, limit, unit), each in seen.items()
    ]
    return Audit(tuple(checks), seconds, exact)


def figures(told: Mapping[str, Any], right: Mapping[str, Any]) -> AuditPart:
    """Hold what a result tells, whole, against what is ``right``, by name; names that differ are told."""
    errors = np.array([figure_error(told[name], value) for name, value in right.items()])
    wrong = [name for name, error in zip(right, errors, strict=True) if not error <= FIGURE]
    what = "figures computed again" + (f" (wrong: {', '.join(wrong)})" if wrong else "")
    return AuditPart(len(right), errors.__getitem__, ((what, FIGURE, "of each"),))


def figure_error(one: Any, other: Any) -> float:
    """Largest difference of two numbers or arrays; infinite where others are not equal."""
    one, other = np.asarray(one), np.asarray(other)
    if one.shape != other.shape:
        return math.inf
    if "O" in one.dtype.kind + other.dtype.kind or "U" in one.dtype.kind + other.dtype.kind:
        return 0.0 if np.array_equal(one, other) else math.inf
    return float(shares(one, other).max(initial=0.0))


def shares(
    one: np.ndarray, other: np.ndarray, size: float | np.ndarray | None = None
) -> np.ndarray:
    """Differences (...) as shares of ``size``, or of the largest of ``other``; infinite where only one of the
    two is a number, or shapes differ."""
    if one.shape != other.shape:
        return np.full(other.shape, np.inf)
    if size is None:
        size = float(np.abs(other).max(initial=0.0, where=np.isfinite(other))) or 1.0
    with np.errstate(invalid="ignore"):
        apart = np.abs(np.subtract(one, other, dtype=np.result_type(one, other, np.float64))) / size
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    return np.where(same, 0.0, np.where(np.isnan(apart), np.inf, apart))


def share_off(found: np.ndarray, exact: np.ndarray) -> float:
    """L2 norm of a difference, as a share of the exact; 0 of silence."""
    whole = float(np.linalg.norm(exact))
    return float(np.linalg.norm(found - exact)) / whole if whole > 0 else 0.0


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

    @property
    def sees(self) -> float:
        """Share of the values of this kind that, being wrong, are missed with a chance of ``MISSED`` at most;
        0 where all are checked."""
        return 0.0 if self.checked >= self.of else 1.0 - MISSED ** (1.0 / max(self.checked, 1))

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        verdict = "" if self.kept else f", MORE than the {self.allowed:.0e}{unit} allowed"
        some = f"{_percent(self.share)} of {self.of:,}; sees errors in {_percent(self.sees)}"
        some = "all" if self.checked >= self.of else some
        error = f"{self.error:.0e}" if self.error else "0"
        off = f"{error}{unit} off at most" if np.isfinite(self.error) else "WRONG"
        return f"{self.checked:,} {self.what} ({some}), {off}{verdict}"

    def record(self) -> dict[str, float | int | str]:
        """Entries of run.json."""
        said = {name: _written(value) for name, value in vars(self).items()}
        return said | {"share": self.share, "sees": self.sees, "kept": self.kept}


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

    @property
    def brief(self) -> str:
        """The verdict in a few words, by the check that uses most of what it is allowed."""
        worst = self.worst
        if not self.kept:
            return str(worst)
        return f"checked: {worst.error:.0e} {worst.unit} off" if worst.error else "checked: exact"

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
