"""Dry sounds that a forest is heard with: a hand clap, a bat's call slowed down as echoes are, or a WAV file.

The clap is noise through a resonance of the cupped hands with the envelope t exp(-t/τ); peak and length are
as Repp (1987) found them for a clap with hollow palms. The call is a falling sweep as ``sonar.calls`` makes
it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.rng import stream
from ..formats.wav import read_wav
from ..sensing.sonar.calls import synthesise
from ..spec import Sonar

DRY = ("clap", "call", "file")
PEAK_DB = -1.0  # of the largest sample that is heard
CLAP_RATE = 48_000.0
RISE = 0.0015  # s to the clap's loudest
CLAP_LENGTH = 0.03  # s
RESONANCE, QUALITY = 1300.0, 1.5  # Hz, of the air between the hands
CALL = replace(Sonar(), call="fm", band=(25e3, 80e3), call_duration=0.004)


def dry_sound(dry: str, file: Path | None = None) -> tuple[np.ndarray, float]:
    """(M,) samples, of a file also (M, D), and their rate in Hz.

    Raises
    ------
    SpecError : the file cannot be used.
    """
    if dry == "file":
        return read_wav(file or Path())
    if dry == "call":
        call = synthesise(CALL)
        return call.samples, call.sample_rate / CALL.time_expansion
    from scipy.signal import iirpeak, lfilter

    time = np.arange(round(CLAP_LENGTH * CLAP_RATE)) / CLAP_RATE
    noise = stream(0, "clap").standard_normal(len(time))
    burst = lfilter(*iirpeak(RESONANCE, QUALITY, CLAP_RATE), noise)
    clap = burst * (time / RISE) * np.exp(1.0 - time / RISE)
    loudest = float(np.abs(clap).max())
    assert math.isfinite(loudest)
    return np.asarray(clap / loudest), CLAP_RATE
