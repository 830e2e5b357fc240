"""A value that was left to "auto", as it was chosen: with a bound on the error it makes and the reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from .base import AUTO


@dataclass(frozen=True)
class Choice:
    """A value that was left to "auto". bound : on the error that it makes, as a share, or in ``unit``, that
    of the value. why : in words.

    asked : what was set, where that was not "auto" but can only be had otherwise.
    sensor : name of the one whose results it concerns; empty: all.
    """

    key: str
    value: float
    bound: float
    why: str
    asked: float | str = AUTO
    unit: str = ""
    sensor: str = ""

    def __str__(self) -> str:
        if self.asked != AUTO:
            return f"{self.key} {self.asked:.0e} is kept {self.why}."
        unit = f" {self.unit}" if self.unit else ""
        value = f"{self.value:.1e}{unit}" if self.value else "none"
        bound = f"off by at most {self.bound:.1e}{unit}" if self.bound else "no change"
        return f"{self.key} was left to auto: {value}, {bound} {self.why}."

    def record(self) -> dict[str, float | str]:
        """Return what stands in run.json."""
        return asdict(self)
