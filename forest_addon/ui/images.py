"""Results as images for the Image Editor, drawn with numpy: Blender lacks matplotlib unless we bring it.

A sound is its level over time above its spectrogram, both 80 dB deep; a tractor's scan is its matrix of
distances, as the scanner saw it. Rows run from the bottom up, as Blender's images do.
"""

from __future__ import annotations

import bpy
import numpy as np
from scipy import signal

WIDE, HIGH = 1024, 320  # pixels of one strip
DEPTH_DB = 80.0
PAPER = np.array([0.07, 0.08, 0.09])
INK = np.array([0.55, 0.75, 0.35])
# From silence to the loudest.
SCALE = np.array(
    [[0.02, 0.02, 0.05], [0.2, 0.1, 0.4], [0.7, 0.2, 0.35], [0.98, 0.6, 0.2], [1, 1, 0.8]]
)


def show(name: str, picture: np.ndarray) -> bpy.types.Image:
    """A picture (H, W, 3) as the Blender image of this name, packed into the file."""
    high, wide, _ = picture.shape
    image = bpy.data.images.get(name)
    if image is not None and tuple(image.size) != (wide, high):
        bpy.data.images.remove(image)
        image = None
    image = image or bpy.data.images.new(name, wide, high)
    pixels = np.ones((high, wide, 4), dtype=np.float32)
    pixels[..., :3] = picture
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    image.pack()
    return image


def sound_picture(samples: np.ndarray, sample_rate: float) -> np.ndarray:
    """(2 HIGH, WIDE, 3): the spectrogram below, the level above; up to the last audible sample."""
    loud = np.abs(samples)
    floor = (loud.max(initial=0.0) or 1.0) * 10.0 ** (-DEPTH_DB / 20.0)
    audible = np.flatnonzero(loud > floor)
    part = samples[: int(audible[-1]) + 1] if len(audible) else samples
    return np.concatenate([_spectrogram(part, sample_rate), _level(np.abs(part), floor)])


def scan_picture(distance: np.ndarray, longest: float) -> np.ndarray:
    """(M, N, 3) of a matrix of distances (N scans, M angles): near is bright, an escaped beam is dark."""
    share = np.where(np.isfinite(distance), 1.0 - 0.85 * np.minimum(distance / longest, 1.0), 0.0)
    return _coloured(share.T[:, :: max(1, len(share) // (4 * WIDE))])


def _level(size: np.ndarray, floor: float) -> np.ndarray:
    column = np.linspace(0, len(size), WIDE, endpoint=False).astype(int)
    largest = np.maximum.reduceat(size, column) if len(size) else np.zeros(WIDE)
    height = np.log(np.maximum(largest / floor, 1.0)) / np.log(10.0 ** (DEPTH_DB / 20.0))
    row = (np.arange(HIGH) + 0.5)[:, None] / HIGH
    return np.where((row < height)[..., None], INK, PAPER)


def _spectrogram(samples: np.ndarray, sample_rate: float) -> np.ndarray:
    window = max(16, min(512, len(samples) // 16))
    if len(samples) < window:
        return np.broadcast_to(SCALE[0], (HIGH, WIDE, 3))
    hop = max(1, (len(samples) - window) // WIDE)
    transform = signal.ShortTimeFFT(signal.windows.hann(window), hop, sample_rate, mfft=4 * window)
    power = np.abs(transform.stft(samples)) ** 2  # (frequencies, times)
    level = 10.0 * np.log10(np.maximum(power / (power.max() or 1.0), 1e-30))
    heard = np.flatnonzero((level > -DEPTH_DB).any(axis=1))
    low, high = (heard[0], heard[-1] + 1) if len(heard) else (0, len(level))
    rows = np.linspace(low, high - 1, HIGH).astype(int)
    columns = np.linspace(0, level.shape[1] - 1, WIDE).astype(int)
    return _coloured(1.0 + level[np.ix_(rows, columns)] / DEPTH_DB)


def _coloured(share: np.ndarray) -> np.ndarray:
    """(..., 3) colours of values 0 to 1."""
    place = np.linspace(0.0, 1.0, len(SCALE))
    clipped = np.clip(share, 0.0, 1.0)
    return np.stack([np.interp(clipped, place, SCALE[:, k]) for k in range(3)], axis=-1)
