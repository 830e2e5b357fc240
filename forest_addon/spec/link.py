"""Threshold of a LiDAR receiver as its hardware states it: energy sent, aperture, photons needed."""

from __future__ import annotations

from typing import ClassVar

from .base import Settings, SpecError, param


class LinkBudget(Settings):
    """Threshold of detection by the light of a pulse, in place of a reflectance at a range."""

    TITLE: ClassVar[str] = "Link Budget"
    energy: float = param(
        0.0,
        unit="µJ",
        help="light of a pulse where it leaves; 0: the faintest reflectance is the threshold",
        ge=0,
        le=1e6,
    )
    aperture: float = param(0.0, unit="m", help="diameter of the receiving optics", ge=0, le=10)
    efficiency: float = param(
        0.5, help="share of the light in the aperture that reaches the detector", gt=0, le=1
    )
    photons: float = param(
        300.0, help="photons at the detector that an echo needs to be seen", gt=0, le=1e12
    )

    def check(self) -> None:
        if bool(self.energy) != bool(self.aperture):
            raise SpecError(
                "aperture" if self.energy else "energy",
                "is missing; a link budget needs energy and aperture",
            )
