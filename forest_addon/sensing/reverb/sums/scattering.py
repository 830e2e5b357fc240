"""Sound by way of single trunks: geometry of the paths, and the spectrum they add up to.

Trunks, a source and a receiver go in; out comes Σ_m w_m·e^{-(b+ik)x_m}·H(f, φ_m) with the weight
w = β/(r_s·r_r^α), the path x = r_s + r_r, and the scattering angle φ (Kaneko & Gamper 2021). Every trunk
has its own radius and every frequency is summed, in float64. Only H, which is smooth in frequency once
the delay is taken off, is computed at Chebyshev nodes and interpolated, to 1e-12 of its largest value:
trunks of one octave of radii share the panels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ....acoustics.cylinder import transfer
from ....acoustics.spectrum import Panel, delay_factors, frequency_panels
from ....base.progress import Progress
from ....base.rows import RowTable, distinct
from ....spec import Air
from ..bands import OctaveBand, bands_of, samples_of
from ..forest.losses import Losses, loss_per_metre
from ..trunks import Trunks

Gain = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of frequency and path length
Check = tuple[float, float]  # Hz, and relative error of H there, root mean square over some trunks
PANEL_KA = 3.0  # width of a panel in ka of the octave's thickest trunk
TRUNKS_AT_ONCE = 512
BINS_AT_ONCE = 512
BY_NODES = 5e-5  # tolerance from above which losses are interpolated between nodes


@dataclass(frozen=True)
class TrunkPaths(RowTable):
    """M paths from the source by a trunk to the receiver, in the horizontal plane.

    length : (M,) metres, r_s + r_r. weight : (M,) β/(r_s·r_r^α), amplitude without H and air.
    angle : (M,) radians by which the sound is turned, 0 to π. radius : (M,) metres.
    clamped : (M,) bool, whether the trunk covers the source or the receiver.
    """

    length: np.ndarray
    weight: np.ndarray
    angle: np.ndarray
    radius: np.ndarray
    clamped: np.ndarray

    @property
    def earliest(self) -> np.ndarray:
        """(M,) metres the first sound travels: by the trunk's near face, 2a shorter at most."""
        return self.length - 2.0 * self.radius


def trunk_paths(
    trunks: Trunks,
    source: np.ndarray,
    receiver: np.ndarray,
    strength: float,
    spreading: float,
    gain: np.ndarray | None = None,
    upright: bool = False,
) -> TrunkPaths:
    """Paths by M trunks between a source (2,) and a receiver (2,).

    strength, spreading : β and α.
    gain : (M,) further amplitude of each path; None: 1.
    upright : weights √(x/(r_s·r_r))/x of an endless cylinder and a point source, in place of Kaneko &
        Gamper's.

    A distance to a trunk's axis is at least its radius. The angle comes from both products of the legs,
    which keeps its digits straight ahead and straight back; it is 0 where a leg has no length.
    """
    x, y = np.ascontiguousarray(trunks.position.T)
    x_in, y_in, x_out, y_out = x - source[0], y - source[1], receiver[0] - x, receiver[1] - y
    along = x_in * x_out + y_in * y_out
    across = x_in * y_out - y_in * x_out
    first, second = np.sqrt(x_in**2 + y_in**2), np.sqrt(x_out**2 + y_out**2)
    clamped = np.minimum(first, second) < trunks.radius
    first, second = np.maximum(first, trunks.radius), np.maximum(second, trunks.radius)
    weight = (
        1.0 / np.sqrt((first + second) * first * second)
        if upright
        else strength / (first * second**spreading)
    )
    return TrunkPaths(
        length=first + second,
        weight=weight * (1.0 if gain is None else gain),
        angle=np.arctan2(np.abs(across), along),
        radius=trunks.radius,
        clamped=clamped,
    )


def scattered_spectrum(
    paths: TrunkPaths,
    spacing: float,
    loss: np.ndarray,
    sound_speed: float,
    progress: Progress | None = None,
    gain: Gain | None = None,
    bark: float = 0.0,
    lowest: int = 1,
) -> np.ndarray:
    """(F,) complex spectrum at 0, 1, … F - 1 times ``spacing`` Hz; 0 below the bin ``lowest``.

    loss : (F,) absorption of the air at these frequencies, nepers per metre.
    progress : called as progress(trunks done, all trunks).
    gain : of each path, by frequency and length; None: 1. bark : share that it absorbs head on.
    """

    def alone(nodes: np.ndarray, some: TrunkPaths) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        scattered = transfer(nodes[:, None], some.angle, some.radius, sound_speed, bark)
        yield some.length, some.weight * scattered

    def lost(bins: slice, length: np.ndarray) -> np.ndarray:
        left = np.exp(np.outer(-loss[bins], length))
        frequency = np.arange(bins.start, bins.stop) * spacing
        return left if gain is None else left * gain(frequency[:, None], length)

    return _spectrum(paths, spacing, lowest, len(loss) - 1, sound_speed, alone, lost, progress)


def spectrum_by_nodes(
    paths: TrunkPaths,
    spacing: float,
    lowest: int,
    highest: int,
    losses: Losses,
    progress: Progress | None = None,
) -> np.ndarray:
    """(highest + 1,) the same with losses at the panels' nodes alone: only delays are computed at every bin.

    Each way over the ground with its own delay taken off, losses are as smooth in frequency as H is: their
    singularities lie at 0 Hz and at the air's relaxations, beside panels of two octaves.
    """
    speed = losses.air.speed()

    def by_ground(nodes: np.ndarray, some: TrunkPaths) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        every, loss = nodes[:, None], losses.along(nodes)
        answer = some.weight * transfer(every, some.angle, some.radius, speed, losses.bark)
        answer = answer * losses.of_trunks(every, some.length)  # (Q, M)
        for rise in losses.rises:
            path = some.length + losses.detour(some.length, rise)
            share = losses.share(every, some.length, rise)
            yield path, answer * share * np.exp(-np.outer(loss, path))

    return _spectrum(paths, spacing, lowest, highest, speed, by_ground, None, progress)


def _spectrum(
    paths: TrunkPaths,
    spacing: float,
    lowest: int,
    highest: int,
    speed: float,
    ways: Callable[[np.ndarray, TrunkPaths], Iterator[tuple[np.ndarray, np.ndarray]]],
    at_bins: Callable[[slice, np.ndarray], np.ndarray] | None,
    progress: Progress | None,
) -> np.ndarray:
    """(highest + 1,) sum over paths and their ways.

    ways : metres (M,) and amplitudes (Q, M) at nodes (Q,), of some paths. at_bins : further factors (B, M),
    by the bins and the paths' lengths; None: 1.
    """
    spectrum = np.zeros(highest + 1, np.complex128)
    done = 0
    for some, panels in _together(paths, spacing, speed, lowest, highest):
        for panel in panels:
            for path, scattered in ways(panel.nodes, some):
                for first in range(0, panel.count, BINS_AT_ONCE):
                    shares = panel.weights[first : first + BINS_AT_ONCE]
                    start = panel.first + first
                    bins = slice(start, start + len(shares))
                    carried = delay_factors(start * spacing, spacing, len(shares), path / speed)
                    if at_bins:
                        carried *= at_bins(bins, some.length)
                    # at every bin: half the work of sums at every node
                    heights = (shares @ scattered.view(np.float64)).view(np.complex128)
                    spectrum[bins] += np.einsum("bm,bm->b", carried, heights)
        done += len(some.length)
        if progress:
            progress(done, len(paths.length))
    return spectrum


def _together(
    paths: TrunkPaths, spacing: float, speed: float, lowest: int, highest: int
) -> Iterator[tuple[TrunkPaths, list[Panel]]]:
    """Paths of one octave of radii, a few at a time, with their panels; none of trunks without a width."""
    wide = paths.radius > 0
    octave = np.floor(np.log2(np.where(wide, paths.radius, 1.0)))
    for number in distinct(octave[wide]):
        rows = np.flatnonzero((octave == number) & wide)
        width = PANEL_KA * speed / (2.0 * math.pi * paths.radius[rows].max())
        panels = frequency_panels(highest, spacing, width, lowest)
        for start in range(0, len(rows), TRUNKS_AT_ONCE):
            yield paths.select(rows[start : start + TRUNKS_AT_ONCE]), panels


def direct_sum(
    paths: TrunkPaths,
    rate: float,
    count: int,
    air: Air,
    progress: Progress | None = None,
    losses: Losses | None = None,
    tolerance: float = 0.0,
    bands: tuple[OctaveBand, ...] = (),
) -> np.ndarray:
    """(count,) samples at ``rate`` Hz from every trunk at every frequency, in float64.

    tolerance : that what rings on after the transforms' ends keeps to; 0: 1e-7. bands : none: all.
    """
    if len(paths.length) == 0:
        return np.zeros(count)
    speed = air.speed()
    gain = None if losses is None or losses.passes else losses.gain
    bark = losses.bark if losses else 0.0
    thickest, last = float(paths.radius.max()), float(paths.length.max()) / speed

    bands = bands or bands_of(rate, thickest, speed, tolerance)
    left = len(bands)

    def spectrum(spacing: float, lowest: int, highest: int) -> np.ndarray:
        nonlocal left
        left -= 1
        told = None if left else progress  # the last band is nearly all of the work
        if losses is not None and gain is not None and tolerance > BY_NODES:
            return spectrum_by_nodes(paths, spacing, lowest, highest, losses, told)
        loss = loss_per_metre(np.arange(highest + 1) * spacing, air, losses)
        return scattered_spectrum(paths, spacing, loss, speed, told, gain, bark, lowest)

    first = max(float(paths.earliest.min()) / speed, 1e-9) if tolerance > 0 else 0.0
    return samples_of(spectrum, bands, rate, count, last, first)
