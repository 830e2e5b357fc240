"""Sound as WAV, written as 32-bit float: nothing clips and nothing is scaled."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np

from ..spec import SpecError
from .atomic import replacing
from .foreign import guarded


def write_wav(path: str | os.PathLike[str], samples: np.ndarray, sample_rate: float) -> None:
    """Write samples (N,) or (N, channels).

    Raises
    ------
    ValueError : a sample rate that is no whole number of hertz, which WAV cannot hold.
    """
    from scipy.io import wavfile  # here: many runs have no sound

    rate = round(sample_rate)
    if abs(rate - sample_rate) > 1e-9:
        raise ValueError(f"a WAV file needs a whole number of hertz, not {sample_rate:g}")
    with replacing(path) as partial:
        wavfile.write(partial, rate, np.ascontiguousarray(samples, dtype=np.float32))


@guarded("a WAV file")
def read_wav(path: Path) -> tuple[np.ndarray, float]:
    """Samples (N,) or (N, channels) float64, whole numbers from -1 to 1, and the rate in hertz.

    Raises
    ------
    SpecError : the file is missing, is no WAV that can be read, is empty, or holds NaN or infinity.
    """
    from scipy.io import wavfile

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks that hold no sound
        warnings.filterwarnings("error", "Reached EOF", wavfile.WavFileWarning)
        rate, samples = wavfile.read(path)
    if rate <= 0 or not samples.size:
        raise SpecError(
            str(path), "holds no sound, or says that it has 0 samples a second; save it again"
        )
    if samples.dtype.kind in "ui":  # bytes count from 128
        middle, half = 128.0 * (samples.dtype.kind == "u"), 2.0 ** (8 * samples.dtype.itemsize - 1)
        return (samples - middle) / half, float(rate)
    if not np.isfinite(samples).all():
        raise SpecError(str(path), "holds NaN or infinity; repair it first")
    return samples.astype(np.float64), float(rate)
