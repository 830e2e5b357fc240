"""The wind that trees sway in."""

from __future__ import annotations

from .base import Settings, param
from .parts import azimuth


class Wind(Settings):
    """The wind that trees sway in; at a speed of 0 they stand still."""

    speed: float = param(
        0.0, unit="m/s", help="mean speed at the height of the trees' tops; 0: none", ge=0, le=30
    )
    direction_deg: float = azimuth(240.0, "where the wind blows to")
    turbulence: float = param(
        0.3,
        help="standard deviation of the speed along the wind over its mean, at the trees' tops",
        ge=0,
        le=0.6,
    )
