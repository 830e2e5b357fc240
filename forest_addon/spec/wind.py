"""The wind in which trees sway."""

from __future__ import annotations

from .base import Settings, param


class Wind(Settings):
    """The wind in which trees sway while LiDARs and sonars look; each tree its own way, by the seed."""

    speed: float = param(
        0.0,
        unit="m/s",
        help="mean speed at the height of the trees' tops; 0: trees stand still",
        ge=0,
        le=30,
    )
    direction_deg: float = param(
        240.0, unit="deg", help="where it blows to, from +X towards +Y", ge=-360, le=360
    )
    turbulence: float = param(
        0.3, help="standard deviation of the speed along the wind, over the mean", ge=0, le=0.6
    )
