"""Even steps, without the drift of adding them up."""

from __future__ import annotations

import numpy as np


def steps(low: float, high: float, step: float) -> np.ndarray:
    """From ``low`` to at most ``high``; a last step that rounding would lose is kept."""
    return low + step * np.arange(int(np.floor((high - low) / step + 1e-9)) + 1)
