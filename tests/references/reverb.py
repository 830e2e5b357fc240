"""The forest's reverb: by scalar loops, at length, by packets in space.

The forest's impulse response as the formulas say it: one trunk, one frequency, one order at a time.

Plain Python and scalar Bessel functions; nothing is shared with the product but the definitions in
PHYSICS 5.1 to 5.3. Slow: some milliseconds for a trunk and a frequency.
"""

import cmath
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import fft, special

from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.skeleton import Skeleton
from forest_addon.sensing.reverb.bands import roll_off
from forest_addon.sensing.reverb.forest.clutter import Blades, Rods
from forest_addon.sensing.reverb.forest.losses import Losses, loss_per_metre
from forest_addon.sensing.reverb.sums.scattering import TrunkPaths, scattered_spectrum
from forest_addon.spec import Air


def absorption_direct(
    frequency: float, temperature_c: float, humidity: float, pressure_kpa: float
) -> float:
    """ISO 9613-1 in nepers per metre, written down from the standard's own layout (dB, 8.686)."""
    t = temperature_c + 273.15
    pressure = pressure_kpa / 101.325
    exponent = -6.8346 * (273.16 / t) ** 1.261 + 4.6151
    h = humidity * 10**exponent / pressure
    oxygen = pressure * (24 + 4.04e4 * h * (0.02 + h) / (0.391 + h))
    nitrogen = (
        pressure
        * (t / 293.15) ** (-1 / 2)
        * (9 + 280 * h * math.exp(-4.170 * ((t / 293.15) ** (-1 / 3) - 1)))
    )
    if frequency == 0:
        return 0.0
    inner = 0.01275 * math.exp(-2239.1 / t) / (oxygen + frequency**2 / oxygen)
    inner += 0.1068 * math.exp(-3352.0 / t) / (nitrogen + frequency**2 / nitrogen)
    decibels = (
        8.686
        * frequency**2
        * (1.84e-11 / pressure * (t / 293.15) ** 0.5 + (t / 293.15) ** (-5 / 2) * inner)
    )
    return decibels / 8.686


def transfer_direct(frequency: float, angle: float, radius: float, speed: float) -> complex:
    """H under e^{+iωt}, with the phase angle γ by arctangent."""
    if frequency == 0:
        return 0.0
    k = 2 * math.pi * frequency / speed
    total = 0j
    for order in range(int(k * radius + 8 * (k * radius) ** (1 / 3) + 12)):
        tangent = special.jvp(order, k * radius) / special.yvp(order, k * radius)
        gamma = math.atan(tangent) if math.isfinite(tangent) else 0.0
        wave = math.sin(gamma) * cmath.exp(1j * gamma)
        total += (1 if order == 0 else 2) * wave * math.cos(order * angle)
    book = cmath.exp(1j * math.pi / 4) * math.sqrt(2 / (math.pi * k)) * total
    return book.conjugate()


def reverb_spectrum_direct(
    frequency: float,
    source: Sequence[float],
    receiver: Sequence[float],
    trunks: Sequence[tuple[float, float, float]],
    *,
    speed: float,
    air: tuple[float, float, float],
    ground: float,
    strength: float,
    spreading: float,
) -> tuple[complex, complex, complex]:
    """Direct, ground and tree spectrum at one frequency; trunks as (x, y, radius)."""
    loss = absorption_direct(frequency, *air)
    k = 2 * math.pi * frequency / speed

    def along(path: float) -> complex:
        return cmath.exp(-(loss + 1j * k) * path)

    straight = math.dist(source, receiver)
    bounced = math.dist((source[0], source[1], -source[2]), receiver)
    trees = 0j
    for x, y, radius in trunks:
        v1 = (x - source[0], y - source[1])
        v2 = (receiver[0] - x, receiver[1] - y)
        first, second = math.hypot(*v1), math.hypot(*v2)
        cosine = (v1[0] * v2[0] + v1[1] * v2[1]) / (first * second)
        angle = math.acos(max(-1.0, min(1.0, cosine)))
        weight = strength / (first * second**spreading)
        trees += weight * along(first + second) * transfer_direct(frequency, angle, radius, speed)
    return along(straight) / straight, ground * along(bounced) / bounced, trees


# ---------------------------------------------------------------------------------- trunks at length
# The sum over trunks on one grid so fine that nothing that rings wraps around: minutes of transform.


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


# -------------------------------------------------------------------------------- transport in space
# Transport in space by packets whose ways through a volume are measured: no estimation towards a point.
# ``in_layer`` is held against the product, ``in_ball`` against waves. Nothing is shared with the product.


def in_layer(
    trunk_rate: float,
    draw_turn: Callable[[np.random.Generator, int], np.ndarray],
    rate: float,
    height: float,
    source: np.ndarray,
    ring: tuple[float, float],
    heights: tuple[float, float],
    edges: np.ndarray,
    packets: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(X,) energy density a metre of path that isotropic scatterers turned at least once.

    Trunks turn about the vertical, by ``trunk_rate`` a metre of level way; isotropic scatterers fill the
    layer at ``rate``; the ground is hard, what leaves by the top is gone. Measured in a ring.
    """
    step = 0.25
    place = np.tile(np.asarray(source, float), (packets, 1))
    sine, turn = rng.uniform(-1, 1, packets), rng.uniform(0, 2 * math.pi, packets)
    met = np.zeros(packets, bool)
    found, travelled = np.zeros(len(edges) - 1), 0.0
    while travelled < edges[-1] and len(place):
        level = np.sqrt(1 - sine**2)
        place += step * np.column_stack([level * np.cos(turn), level * np.sin(turn), sine])
        travelled += step
        under = place[:, 2] < 0
        place[under, 2] *= -1
        sine[under] *= -1
        kept = place[:, 2] < height
        place, sine, turn, met = place[kept], sine[kept], turn[kept], met[kept]
        r = np.hypot(*(place[:, :2] - source[:2]).T)
        inside = met & (r > ring[0]) & (r < ring[1])
        inside &= (place[:, 2] > heights[0]) & (place[:, 2] < heights[1])
        column = int(np.searchsorted(edges, travelled - step / 2, side="right")) - 1
        if 0 <= column < len(found):
            found[column] += inside.sum() * step
        by_trunk = rng.random(len(place)) < 1 - np.exp(-trunk_rate * step * np.sqrt(1 - sine**2))
        turn[by_trunk] += draw_turn(rng, int(by_trunk.sum()))
        spread = rng.random(len(place)) < 1 - np.exp(-rate * step)
        sine[spread] = rng.uniform(-1, 1, int(spread.sum()))
        turn[spread] = rng.uniform(0, 2 * math.pi, int(spread.sum()))
        met |= spread
    volume = math.pi * (ring[1] ** 2 - ring[0] ** 2) * (heights[1] - heights[0])
    return found * 4 * math.pi / packets / volume / np.diff(edges)


# ---------------------------------------------------------------------------------- clutter of truth
# Branches and leaves of a tree as sound meets them, from its skeleton and leaves rather than its mesh.


def rods_of_skeleton(skeleton: Skeleton) -> Rods:
    """All wood but the trunk."""
    rows = skeleton.order > 0
    way = skeleton.end[rows] - skeleton.start[rows]
    length = np.linalg.norm(way, axis=1)
    return Rods(
        length,
        skeleton.radius[rows].mean(axis=1),
        0.5 * (skeleton.start[rows] + skeleton.end[rows])[:, 2],
        np.abs(way[:, 2]) / np.maximum(length, 1e-12),
    )


def blades_of_leaves(leaves: Leaves) -> Blades:
    """Of a tree's truth."""
    return Blades(np.pi * leaves.radius**2, leaves.radius, leaves.centre[:, 2], 0.0 * leaves.radius)


# ---------------------------------------------------------------------------------------------- rods
# A straight tapered stem as a skeleton, for closed forms of beams.


def rod(
    foot: float, tip: float, height: float = 20.0, count: int = 40, lean: float = 0.0
) -> Skeleton:
    """``count`` segments from the origin, of linear taper; lean : radians from the vertical to +X."""
    along = np.linspace(0.0, height, count + 1)
    way = np.array([np.sin(lean), 0.0, np.cos(lean)])
    points = along[:, None] * way
    radius = np.interp(along, [0.0, height], [foot, tip])
    return Skeleton(
        points[:-1],
        points[1:],
        np.column_stack([radius[:-1], radius[1:]]),
        np.arange(count) - 1,
        np.zeros(count, np.int64),
        np.arange(count),
    )
