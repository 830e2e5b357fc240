"""The sum over trunks on one grid so fine that nothing that rings wraps around: minutes of transform."""

from __future__ import annotations

import numpy as np
from scipy import fft

from forest_addon.sensing.reverb.band import roll_off
from forest_addon.sensing.reverb.forest.losses import Losses, loss_per_metre
from forest_addon.sensing.reverb.sums.scattering import TrunkPaths, scattered_spectrum
from forest_addon.spec import Air


def sum_at_length(
    paths: TrunkPaths,
    rate: float,
    count: int,
    air: Air,
    losses: Losses | None = None,
    seconds: float = 600.0,
) -> np.ndarray:
    """(count,) samples of a transform of so many seconds."""
    size = int(fft.next_fast_len(int(seconds * rate), real=True))
    frequency = np.arange(size // 2 + 1) * (rate / size)
    loss = loss_per_metre(frequency, air, losses)
    gain = None if losses is None or losses.passes else losses.gain
    bark = losses.bark if losses else 0.0
    spectrum = scattered_spectrum(paths, rate / size, loss, air.speed(), None, gain, bark)
    samples: np.ndarray = fft.irfft(spectrum * roll_off(frequency / rate), size)
    return samples[:count]
