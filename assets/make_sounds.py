"""Makes assets/sounds: dry sounds to hear a forest by. Run: python assets/make_sounds.py

clap.wav   a hand clap: 3 ms of noise around 1.2 kHz that dies away, a softer second slap 7 ms later.
click.wav  one raised-cosine pulse of 0.25 ms: short, but no sample of it stands alone.
call.wav   a voice-like call: a harmonic source with a falling pitch through three formants.

All are synthesised here, from a fixed seed, and are in the public domain (CC0).
"""

from pathlib import Path

import numpy as np
from scipy import signal
from scipy.io import wavfile

RATE = 48_000
FOLDER = Path(__file__).with_name("sounds")


def clap() -> np.ndarray:
    rng = np.random.default_rng(1)
    time = np.arange(int(0.08 * RATE)) / RATE
    noise = rng.standard_normal(len(time))
    coloured = signal.sosfilt(
        signal.butter(2, [600, 4000], "bandpass", fs=RATE, output="sos"), noise
    )
    slap = np.exp(-time / 0.003) + 0.4 * np.where(time > 0.007, np.exp(-(time - 0.007) / 0.006), 0)
    return coloured * slap


def click() -> np.ndarray:
    width = int(0.00025 * RATE)
    pulse = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(width) + 0.5) / width)
    return np.concatenate([pulse, np.zeros(RATE // 100)])


def call() -> np.ndarray:
    time = np.arange(int(0.6 * RATE)) / RATE
    pitch = 320.0 - 110.0 * (time / time[-1]) ** 2  # Hz
    phase = 2 * np.pi * np.cumsum(pitch) / RATE
    source = sum(np.sin(n * phase) / n for n in range(1, 24))
    voice = np.zeros_like(source)
    for formant, width, gain in ((700, 110, 1.0), (1150, 140, 0.6), (2600, 200, 0.25)):
        poles = signal.iirpeak(formant, formant / width, fs=RATE)
        voice += gain * signal.lfilter(*poles, source)
    return voice * signal.windows.tukey(len(time), 0.25)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for make in (clap, click, call):
        sound = make()
        whole = np.round(sound / np.abs(sound).max() * 0.9 * 32767).astype(np.int16)
        wavfile.write(FOLDER / f"{make.__name__}.wav", RATE, whole)


if __name__ == "__main__":
    main()
