"""Critical speed of flight through a forest (Karaman & Frazzoli 2012).

Their bird flies v ahead and at most w across, among discs of a Poisson process with density ρ; R is the
radius of disc and bird together. Whether a way without collision exists is one of directed percolation:
above a critical speed there is none that goes on for ever, whatever the bird knows, below it there is one. No
closed form is known; as they do, the phase diagram is found by Monte Carlo. Here the reachable set is
followed exactly but for a grid: from x to x + Δx it grows by wΔx/v to both sides, and discs are taken out.

For fast birds discs are sticks of length 2R across the way, and scaling x by w/v leaves one number,
ρR²v/w: so the critical speed goes as v_c = κ·w/(ρR²).
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from ..inside import poisson_strip

GRID = 0.04  # metres across


def passable(
    position: np.ndarray, reach: np.ndarray, slope: float, length: float, width: float
) -> float:
    """Metres, at most ``length``, that some way gets through discs (N, 2) of radii (N,) without touching.

    slope : w/v. The forest repeats itself across every ``width`` metres; ways start anywhere at x = 0.
    """
    count = max(16, round(width / GRID))
    cell = width / count
    grows = max(1, int(np.ceil(0.05 * slope / cell)))
    step = grows * cell / slope  # along x, in which the set grows by whole cells
    if step > 0.5 * float(reach.min(initial=1.0)):
        step = 0.5 * float(reach.min(initial=1.0))
    grown_by = slope * step / cell
    open_ = np.ones(count, dtype=np.uint8)
    order = np.argsort(position[:, 0])
    x, y, radius = position[order, 0], position[order, 1], reach[order]
    most = float(radius.max(initial=0.0))
    owed = 0.0
    rows = np.searchsorted(x, np.arange(0.0, length + 2 * step, step) - most - step)
    ends = np.searchsorted(x, np.arange(0.0, length + 2 * step, step) + most + step)
    for number in range(int(np.ceil(length / step))):
        at = number * step
        owed += grown_by
        whole = int(owed)
        owed -= whole
        if whole:
            open_ = maximum_filter1d(open_, 2 * whole + 1, mode="wrap")
        for k in range(rows[number], ends[number]):
            off = max(abs(at - x[k]) - step / 2, 0.0)
            if off >= radius[k]:
                continue
            half = np.sqrt(radius[k] ** 2 - off * off)
            first, last = int(np.ceil((y[k] - half) / cell)), int(np.floor((y[k] + half) / cell))
            open_[np.arange(first, last + 1) % count] = 0
        if not open_.any():
            return at
    return length


def chance_of_way(
    rng: np.random.Generator,
    density: float,
    reach: float,
    slope: float,
    length: float,
    forests: int,
    width: float = 40.0,
) -> tuple[int, int]:
    """Number of forests in which a way gets through, and of all that were tried."""
    through = 0
    for _ in range(forests):
        place = poisson_strip(rng, density, length, width)
        got = passable(place, np.full(len(place), reach), slope, length, width)
        through += got >= length
    return through, forests


def critical_slope(
    rng: np.random.Generator,
    density: float,
    reach: float,
    length: float,
    forests: int,
    width: float = 40.0,
) -> float:
    """w/v at which half of the forests have a way through, by bisection over the same forests."""
    places = [poisson_strip(rng, density, length, width) for _ in range(forests)]
    low, high = 1e-3, 4.0
    for _ in range(7):
        middle = np.sqrt(low * high)
        got = [passable(p, np.full(len(p), reach), middle, length, width) >= length for p in places]
        low, high = (low, middle) if np.mean(got) >= 0.5 else (middle, high)
    return float(np.sqrt(low * high))
