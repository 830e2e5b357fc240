"""The air that sound travels through."""

from __future__ import annotations

import math

from .base import Settings, param


class Air(Settings):
    """The air that sound travels through."""

    temperature_c: float = param(20.0, unit="°C", help="temperature", ge=-40, le=50)
    humidity: float = param(50.0, unit="%", help="relative humidity", gt=0, le=100)
    pressure_kpa: float = param(101.325, unit="kPa", help="pressure", ge=20, le=120)
    sound_speed: float | None = param(
        None,
        unit="m/s",
        help="speed of sound; left out: 343.2·√(T/293.15 K) of ISO 9613-1",
        ge=250,
        le=450,
    )

    def speed(self) -> float:
        """Speed of sound in m/s."""
        if self.sound_speed is not None:
            return self.sound_speed
        return 343.2 * math.sqrt((self.temperature_c + 273.15) / 293.15)
