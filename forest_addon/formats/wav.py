"""Sound as WAV, 32-bit float: nothing clips and nothing is scaled."""

from __future__ import annotations

import os

import numpy as np
from scipy.io import wavfile

from .atomic import replacing


def write_wav(path: str | os.PathLike[str], samples: np.ndarray, sample_rate: float) -> None:
    """Write samples (N,) or (N, channels).

    Raises
    ------
    ValueError : a sample rate that is no whole number of hertz, which WAV cannot hold.
    """
    rate = round(sample_rate)
    if abs(rate - sample_rate) > 1e-9:
        raise ValueError(f"a WAV file needs a whole number of hertz, not {sample_rate:g}")
    with replacing(path) as partial:
        wavfile.write(partial, rate, np.ascontiguousarray(samples, dtype=np.float32))
