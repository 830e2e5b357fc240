"""Level of steady noise by distance in a forest: what impulse responses hold, summed over time.

Expected energies of a stand (direct sound and ground as waves, trunks once and again, branches and leaves) by
distance, in octaves; beside them levels of steady white noise that two recorders measured at 1 to 100 m in an
alpine conifer forest (Haupert, Sebe & Sueur 2022), less their background, over what spreading and air take.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import trapezoid

from forest_addon.acoustics.air import absorption
from forest_addon.sensing.reverb.forest.transport import Sent
from forest_addon.spec import Air

from .expected import expected_energy
from .sources import MONITOR
from .stands import Path as SoundPath
from .stands import PlausibleStand

ALPINE = Air(temperature_c=15.0, humidity=60.0, pressure_kpa=88.0)
NEAREST = 10.0  # m, where levels are 0 dB
BANDS = np.array([1000.0, 2000.0, 4000.0, 8000.0])
HEARD = 3.0  # dB over the background, below which a level is not read
LAST, PACKETS = 6.0, 3000  # s of sound; packets an octave


@dataclass(frozen=True)
class Range:
    """distance (D,) m; excess (B, D) dB over spreading and air, 0 at NEAREST; NaN: not heard."""

    distance: np.ndarray
    excess: np.ndarray


def read_range(path: Path) -> Range:
    """Read what a recorder measured."""
    with np.load(path) as file:
        frequency = 1000.0 * file["frequency"]
        signal, background = file["signal_psd_mean"], file["background_psd_mean"]
        distance = file["distance_m"]
    excess = np.full((len(BANDS), len(distance)), np.nan)
    for row, band in enumerate(BANDS):
        rows = (frequency >= band / np.sqrt(2.0)) & (frequency < band * np.sqrt(2.0))
        whole, noise = signal[rows].sum(axis=0), background[rows].sum(axis=0)
        heard = whole > noise * 10.0 ** (HEARD / 10.0)
        level = 10.0 * np.log10(np.where(heard, whole - noise, np.nan))
        lost = 20.0 * np.log10(distance) + 8.686 * _air(band) * distance
        excess[row] = -(level + lost)
    return Range(distance, excess - excess[:, distance == NEAREST])


def range_of(stand: PlausibleStand, distance: np.ndarray, height: float = 1.5) -> Range:
    """Compute the same of a stand."""
    levels = np.array([_levels(stand, float(r), height) for r in distance]).T
    lost = 20.0 * np.log10(distance) + 8.686 * _air(BANDS)[:, None] * distance
    excess = -(levels + lost)
    return Range(distance, excess - excess[:, distance == NEAREST])


def _towards_the_transect(frequency: float) -> Sent:
    """Return the energy that the loudspeaker sends by ways, re that along x."""
    return lambda way: MONITOR.around(way[:, 0], frequency) ** 2


def _air(band: np.ndarray | float) -> np.ndarray:
    return absorption(np.asarray(band), ALPINE.temperature_c, ALPINE.humidity, ALPINE.pressure_kpa)


def _levels(stand: PlausibleStand, distance: float, height: float) -> np.ndarray:
    """(B,) dB of all energy, re the source's at 1 m."""
    path = SoundPath(distance, height, 32e3, ALPINE)
    found = expected_energy(stand, path, BANDS, LAST, PACKETS, _towards_the_transect)
    whole = found.direct + trapezoid(found.scattered, found.length, axis=1)
    return np.asarray(10.0 * np.log10(whole))
