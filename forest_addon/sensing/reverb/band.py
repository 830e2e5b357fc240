"""The smooth end of the band of every impulse response, and how far it spreads an arrival."""

from __future__ import annotations

import numpy as np
from scipy import special

SPREAD = 256  # samples; so far does the roll-off spread an arrival, to 1e-8 of its peak


def roll_off(share: np.ndarray) -> np.ndarray:
    """Gain at a share of the sampling rate: 1 up to 0.45, a Gaussian step down to 0 at 0.5.

    A band that ends at once gives every arrival that is not on a sample tails of 1/t.
    """
    step = 0.5 * special.erfc((share - 0.475) / 0.025 * 4.0)  # 8e-9 from 0 and 1 at the ends
    return np.where(share <= 0.45, 1.0, np.where(share >= 0.5, 0.0, step))
