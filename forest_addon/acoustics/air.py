"""Atmospheric absorption of sound after ISO 9613-1.

Frequency and the state of the air go in, the attenuation coefficient comes out, in dB/m or in nepers
per metre. Three terms: classical loss (viscosity, heat conduction) and the vibrational relaxation of
oxygen and of nitrogen, whose relaxation frequencies follow from the molar share of water vapour
(ISO 9613-1:1993, equations 3 to 5 and B.1 to B.3). One function for the sonar and for the reverb.

The standard states 10 % for 0.05 to 5 % of vapour, 253 to 323 K, up to 200 kPa and a frequency over
pressure of 4e-4 to 10 Hz/Pa (1 MHz at sea level); beyond, the formulas are extrapolated.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

DB_PER_NEPER = 20.0 / math.log(10.0)  # 20·log10(e); the standard prints it rounded, 8.686
_REFERENCE_KELVIN = 293.15
_TRIPLE_POINT_KELVIN = 273.16
_REFERENCE_KPA = 101.325


def absorption(
    frequency: ArrayLike,
    temperature_c: ArrayLike = 20.0,
    humidity: ArrayLike = 50.0,
    pressure_kpa: ArrayLike = 101.325,
) -> np.ndarray:
    """Return the attenuation of a pure tone in nepers per metre; the arguments broadcast.

    A pressure falls as exp(-absorption·distance); ``DB_PER_NEPER`` makes dB/m of it.

    frequency : Hz, 0 gives 0; complex: the analytic continuation.
    temperature_c : °C.
    humidity : relative humidity in %, from 0 (dry air, the formulas' limit) to 100.
    pressure_kpa : kPa.

    Raises
    ------
    ValueError : humidity outside 0 to 100, pressure or absolute temperature not above 0.
    """
    squared = np.square(np.asarray(frequency) * 1.0)
    kelvin = np.asarray(temperature_c, dtype=np.float64) + 273.15
    warmth = kelvin / _REFERENCE_KELVIN
    pressure = np.asarray(pressure_kpa, dtype=np.float64) / _REFERENCE_KPA
    wetness = np.asarray(humidity, dtype=np.float64)
    if np.any(kelvin <= 0) or np.any(pressure <= 0):
        raise ValueError("the air needs a temperature above -273.15 °C and a pressure above 0")
    if np.any(wetness < 0) or np.any(wetness > 100):
        raise ValueError("the relative humidity must be from 0 to 100 %")

    oxygen, nitrogen = relaxation(temperature_c, humidity, pressure_kpa)
    classical = 1.84e-11 / pressure * np.sqrt(warmth)
    relaxing = 0.01275 * np.exp(-2239.1 / kelvin) * oxygen / (oxygen**2 + squared)
    relaxing = relaxing + 0.1068 * np.exp(-3352.0 / kelvin) * nitrogen / (nitrogen**2 + squared)
    return squared * (classical + warmth**-2.5 * relaxing)  # Np/m, (5)


def relaxation(
    temperature_c: ArrayLike = 20.0, humidity: ArrayLike = 50.0, pressure_kpa: ArrayLike = 101.325
) -> tuple[np.ndarray, np.ndarray]:
    """Relaxation frequencies of oxygen and of nitrogen, Hz; the arguments broadcast."""
    kelvin = np.asarray(temperature_c, dtype=np.float64) + 273.15
    warmth = kelvin / _REFERENCE_KELVIN
    pressure = np.asarray(pressure_kpa, dtype=np.float64) / _REFERENCE_KPA
    saturation = 10.0 ** (-6.8346 * (_TRIPLE_POINT_KELVIN / kelvin) ** 1.261 + 4.6151)  # (B.3)
    vapour = np.asarray(humidity, np.float64) * saturation / pressure  # molar share in %, (B.1)
    oxygen = pressure * (24.0 + 4.04e4 * vapour * (0.02 + vapour) / (0.391 + vapour))  # (3)
    nitrogen = pressure * warmth**-0.5  # (4)
    nitrogen = nitrogen * (9.0 + 280.0 * vapour * np.exp(-4.170 * (warmth ** (-1 / 3) - 1.0)))
    return oxygen, nitrogen
