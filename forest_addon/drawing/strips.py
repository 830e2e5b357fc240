"""Pictures of results drawn with numpy, as Blender has no plotting library: strips of pixels above one
another that share the axis across. Whoever shows them puts axes around the strips and says their texts, which
are ``keep``-ed, in the user's language.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..base.labels import LEVELS, MEASURES
from ..base.words import keep
from ..spec import Scene
from ..stand.compose import Inputs, corners_of, process_of
from ..stand.plan import Stand
from .palette import rgb, species_colour

WIDE, HIGH = 1100, 300  # pixels of one strip
MAP_HIGH = 900  # pixels of a map, at most
MANY = 20_000  # trees from which on each is a pixel
DEPTH_DB = 80.0
PAPER = np.array([0.07, 0.08, 0.09])
INK = np.array([0.55, 0.75, 0.35])
CURVE = np.array([1.0, 0.65, 0.25])
CLEARING, MEADOW = (
    np.array([0.984, 0.988, 0.98]),
    np.array([0.68, 0.795, 0.575]),
)  # least, most intensity
LEVEL, MEASURE = (np.array(scale) ** (1 / 2.2) for scale in (LEVELS, MEASURES))  # on the screen


@dataclass(frozen=True)
class Axis:
    """Axis along an edge of a plot: the values at its ends, and their quantity. log : by their logarithm."""

    low: float
    high: float
    label: str
    log: bool = False


@dataclass(frozen=True)
class Strip:
    """pixels : (H, W, 3) of 0 to 1, the lowest row first. up : their vertical axis. values : what their
    colours are, None where these are no scale. colours : (K, 3) of the values, evenly apart on their axis."""

    title: str
    pixels: np.ndarray
    up: Axis
    values: Axis | None = None
    colours: np.ndarray = field(default_factory=lambda: LEVEL)


@dataclass(frozen=True)
class Plot:
    """strips : from the lowest up, equally wide. across : their common axis. caption : in a few words."""

    strips: tuple[Strip, ...]
    across: Axis
    caption: str


def sound_plot(samples: np.ndarray, sample_rate: float, decay: bool = False) -> Plot:
    """Level and spectrogram of a signal (N,), up to its last audible sample.

    decay : draw the energy decay curve over the level.
    """
    loud = np.abs(samples)
    floor = (loud.max(initial=0.0) or 1.0) * 10.0 ** (-DEPTH_DB / 20.0)
    audible = np.flatnonzero(loud > floor)
    part = samples[: int(audible[-1]) + 1] if len(audible) else samples
    level = _level(np.abs(part), floor)
    title = keep("Level")
    if decay and len(audible):
        from ..sensing.reverb import metrics

        fallen = metrics.energy_decay_db(samples)[: len(part)]  # dB re the top, drawn as a line
        shown = fallen[np.linspace(0, len(fallen) - 1, WIDE).astype(int)]
        row = np.maximum((1.0 + shown / DEPTH_DB) * (HIGH - 1), 0.0).astype(int)
        before = np.concatenate([row[:1], row[:-1]])
        for column, (a, b) in enumerate(zip(before, row, strict=True)):
            level[max(min(a, b) - 1, 0) : max(a, b) + 2, column] = CURVE
        title = keep("Level and energy decay curve")
    spectrogram, low, high = _spectrogram(part, sample_rate)
    milliseconds = 1e3 * len(part) / sample_rate
    return Plot(
        (
            Strip(
                keep("Spectrogram"),
                spectrogram,
                Axis(low / 1e3, high / 1e3, "kHz"),
                Axis(-DEPTH_DB, 0.0, "dB"),
            ),
            Strip(title, level, Axis(-DEPTH_DB, 0.0, "dB")),
        ),
        Axis(0.0, milliseconds, "ms"),
        f"{milliseconds:.0f} ms, {DEPTH_DB:.0f} dB",
    )


def from_above(position: np.ndarray) -> Plot:
    """The highest point of each square cell; cells are as small as the points are dense."""
    low, high = position.min(axis=0), position.max(axis=0)
    extent = np.maximum((high - low)[:2], 1e-3)
    cell = max(*extent / WIDE, float(np.sqrt(extent.prod() / len(position))))
    shape = np.maximum(1, np.ceil((high - low)[:2] / cell)).astype(int)
    column, row = np.minimum(((position[:, :2] - low[:2]) / cell).astype(int), shape - 1).T
    height = np.full((shape[1], shape[0]), -np.inf)
    np.maximum.at(height, (row, column), position[:, 2])
    share = (height - low[2]) / (high[2] - low[2] or 1.0)
    cells = np.where(np.isfinite(height)[..., None], _coloured(share), PAPER)
    enlarged = max(1, WIDE // max(height.shape))
    pixels = cells.repeat(enlarged, axis=0).repeat(enlarged, axis=1)
    return Plot(
        (
            Strip(
                keep("Height of the points"),
                pixels,
                Axis(float(low[1]), float(high[1]), "y (m)"),
                Axis(float(low[2]), float(high[2]), "m"),
                MEASURE,
            ),
        ),
        Axis(float(low[0]), float(high[0]), "x (m)"),
        keep(
            "{length:.0f} m by {width:.0f} m, from above",
            length=high[0] - low[0],
            width=high[1] - low[1],
        ),
    )


def stand_map(stand: Stand, settings: Scene, inputs: Inputs) -> Plot:
    """Trees from above in the colours of their species, as wide as their crowns, on their intensity."""
    low, high = corners_of(settings.forest)
    scale = float(min(WIDE / (high - low)[0], MAP_HIGH / (high - low)[1]))  # pixels a metre
    columns, rows = np.maximum(((high - low) * scale).astype(int), 8)
    intensity = _intensity(settings, inputs, (rows, columns))
    pixels = CLEARING + (intensity / (intensity.max() or 1.0))[..., None] * (MEADOW - CLEARING)
    _set_trees(pixels, stand, settings, low, scale)
    title = (
        f"{settings.name}: {len(stand):,} {'tree' if len(stand) == 1 else 'trees'} "
        f"on {stand.area / 1e4:,.3g} ha"
    )
    most = float(intensity.max())
    strip = Strip(
        title,
        pixels,
        Axis(float(low[1]), float(high[1]), "y (m)"),
        Axis(0.0, most, keep("trees/ha")) if most > 0 else None,
        np.array([CLEARING, MEADOW]),
    )
    return Plot((strip,), Axis(float(low[0]), float(high[0]), "x (m)"), "")


def _intensity(settings: Scene, inputs: Inputs, shape: tuple[int, int]) -> np.ndarray:
    """Sum of all intensities, trees per hectare, in (rows, columns) over the field, south first."""
    low, high = corners_of(settings.forest)
    y, x = (
        low[k] + (np.arange(n) + 0.5) * (high - low)[k] / n
        for k, n in zip((1, 0), shape, strict=True)
    )
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    drawn = [p for p in settings.plantings if p.layout == "poisson"]
    total = np.zeros(len(points))
    for planting in drawn:
        total += process_of(planting, settings.forest, inputs).at(points)
    return 1e4 * total.reshape(shape)


def _set_trees(
    pixels: np.ndarray, stand: Stand, settings: Scene, low: np.ndarray, scale: float
) -> None:
    """Paint each tree as a disc: its crown where that is known, else a size that fits the number of trees."""
    if not len(stand):
        return
    rows, columns, _ = pixels.shape
    kinds = np.array([rgb(species_colour(k)) for k in range(stand.species.max() + 1)])
    colours = kinds[stand.species]
    column, row = ((stand.position[:, :2] - low) * scale).T
    if len(stand) > MANY:
        at = np.clip(row.astype(int), 0, rows - 1), np.clip(column.astype(int), 0, columns - 1)
        pixels[at] = colours
        return
    crown = np.array([p.crown for p in settings.plantings])[stand.species] * stand.scale
    usual = 0.15 * np.sqrt(stand.area / len(stand)) * stand.scale
    radius = np.clip(scale * np.where(crown > 0, crown, usual), 1.0, 0.05 * columns)
    for x, y, reach, colour in zip(column, row, radius, colours, strict=True):
        left, foot = max(int(x - reach), 0), max(int(y - reach), 0)
        part = pixels[foot : max(int(y + reach) + 2, 0), left : max(int(x + reach) + 2, 0)]
        up, across = np.ogrid[foot : foot + part.shape[0], left : left + part.shape[1]]
        away = np.sqrt((up + 0.5 - y) ** 2 + (across + 0.5 - x) ** 2)
        part += 0.85 * np.clip(reach + 0.5 - away, 0.0, 1.0)[..., None] * (colour - part)


def by_distance(title: str, distance: np.ndarray, up: Axis) -> Strip:
    """Distances (H, W) coloured by their logarithm, enlarged or thinned to the size of two strips."""
    high, wide = distance.shape
    rows = (np.arange(2 * HIGH) * high) // (2 * HIGH)
    there = distance[np.ix_(rows, (np.arange(WIDE) * wide) // WIDE)]
    known = np.isfinite(there)
    if not known.any():
        return Strip(title, np.broadcast_to(PAPER, (*there.shape, 3)), up)
    ends = np.maximum(np.percentile(there[known], (1, 100)), 1e-3)
    near, far = np.log(ends)
    away = (np.log(np.where(known, np.maximum(there, 1e-3), 1.0)) - near) / ((far - near) or 1.0)
    pixels = np.where(known[..., None], _coloured(1.0 - away), PAPER)
    values = Axis(float(ends[0]), float(ends[1]), "m", log=True) if far > near else None
    return Strip(title, pixels, up, values, MEASURE[::-1])


def _level(size: np.ndarray, floor: float) -> np.ndarray:
    column = np.linspace(0, len(size), WIDE, endpoint=False).astype(int)
    largest = np.maximum.reduceat(size, column) if len(size) else np.zeros(WIDE)
    height = np.log(np.maximum(largest / floor, 1.0)) / np.log(10.0 ** (DEPTH_DB / 20.0))
    row = (np.arange(HIGH) + 0.5)[:, None] / HIGH
    return np.where((row < height)[..., None], INK, PAPER)


def _spectrogram(samples: np.ndarray, sample_rate: float) -> tuple[np.ndarray, float, float]:
    """Pixels of a strip, and the lowest and highest frequency in it (Hz): as far as there is sound."""
    from scipy import signal

    window = max(16, min(512, len(samples) // 16))
    if len(samples) < window:
        return np.broadcast_to(LEVEL[0], (HIGH, WIDE, 3)), 0.0, sample_rate / 2
    hop = max(1, (len(samples) - window) // WIDE)
    transform = signal.ShortTimeFFT(signal.windows.hann(window), hop, sample_rate, mfft=4 * window)
    first = transform.p_min  # the times of its columns are those of the signal, without overhang
    power = np.abs(transform.stft(samples)[:, -first : -first + 1 + (len(samples) - 1) // hop]) ** 2
    level = 10.0 * np.log10(np.maximum(power / (power.max() or 1.0), 1e-30))
    heard = np.flatnonzero((level > -DEPTH_DB).any(axis=1))
    low, high = (heard[0], heard[-1]) if len(heard) else (0, len(level) - 1)
    rows = np.linspace(low, high, HIGH).astype(int)
    columns = np.linspace(0, level.shape[1] - 1, WIDE).astype(int)
    colours = _coloured(1.0 + level[np.ix_(rows, columns)] / DEPTH_DB, LEVEL)
    return colours, float(transform.f[low]), float(transform.f[high])


def _coloured(share: np.ndarray, scale: np.ndarray = MEASURE) -> np.ndarray:
    """(..., 3) colours of values 0 to 1."""
    place = np.linspace(0.0, 1.0, len(scale))
    clipped = np.clip(share, 0.0, 1.0)
    return np.stack([np.interp(clipped, place, scale[:, k]) for k in range(3)], axis=-1)
