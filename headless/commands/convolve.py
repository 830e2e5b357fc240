"""``python -m headless convolve``: a dry sound, heard in the forest."""

from __future__ import annotations

import argparse

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.formats.wav import read_wav, write_wav
from forest_addon.sensing.reverb.auralise import auralise, normalised


def run(chosen: argparse.Namespace, say: Say = print) -> None:
    """Convolve a dry sound with an impulse response and write what is heard.

    Raises
    ------
    SpecError : a file that cannot be used.
    """
    normalise = chosen.normalise  # dB re full scale; None: as it is, even above 1
    echoes, rate = read_wav(chosen.response)
    sound, dry_rate = read_wav(chosen.dry)
    heard = auralise(echoes, sound, rate, dry_rate)
    if dry_rate != rate:
        say(f"{chosen.dry.name} is resampled from {dry_rate:g} to {rate:g} Hz.")
    if normalise is not None and heard.any():
        heard, gain = normalised(heard, normalise)
        say(f"Normalised by {gain:+.1f} dB: the largest sample is at {normalise:g} dB.")
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    write_wav(chosen.out, heard, rate)
    peak = float(np.abs(heard).max())
    level = f"largest sample {20 * np.log10(peak):.1f} dB" if peak > 0 else "silence"
    say(
        f"Wrote {chosen.out}: {heard.shape[1]} channel(s), {len(heard) / rate:.2f} s, {level} re full scale."
    )
    if peak > 1:
        say("Players of 16-bit sound would clip it; --normalise -1 brings it down.")
