"""Error of single scattering for a stand: some of its trunks, solved exactly.

The trunks with the shortest paths around a source and a receiver go in; at third-octave frequencies the
field that they scatter is computed twice, with every echo between trunks and with each trunk alone
(``acoustics.multiple``), and the difference is what single scattering leaves out.

Both are of cylinders alone in a plane, with a line source: amplitudes fall with 1/√(r_s·r_r), where K
weighs the same paths by β/(r_s·r_r^α). The relative difference is that of the trunks' sound in the plane;
Kaneko & Gamper's weights, β and α, are not part of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ...acoustics.multiple import LARGEST, scattered_field, unknowns
from ...base.progress import Progress
from ...spec import Air
from ..audit import share_off
from .sums.scattering import trunk_paths
from .trunks import Trunks

FREQUENCIES = 1000.0 * 2.0 ** (np.arange(-12, 4) / 3)  # Hz, thirds of an octave from 62.5 to 2000


@dataclass(frozen=True)
class ModelError:
    """Error of single scattering at F frequencies.

    frequency : (F,) Hz; as far up as the systems can be solved.
    every, once : (F,) pressure with multiple and with single scattering, line source in the plane.
    trunks : (M,) numbers of the trunks that were taken.
    left_out : how many near trunks were not, since they overlap a thicker one or cover an end.
    """

    frequency: np.ndarray
    every: np.ndarray
    once: np.ndarray
    trunks: np.ndarray
    left_out: int

    @property
    def relative(self) -> float:
        """L2 norm of the difference over that of the exact field; 0 without trunks."""
        return share_off(self.once, self.every)

    @property
    def level_db(self) -> float:
        """Energy of the exact field over that of single scattering; 0 without trunks."""
        exact, single = np.linalg.norm(self.every), np.linalg.norm(self.once)
        return float(20.0 * np.log10(exact / single)) if single > 0 else 0.0


def model_error(
    trunks: Trunks,
    source: np.ndarray,
    receiver: np.ndarray,
    most: int,
    air: Air,
    frequencies: np.ndarray = FREQUENCIES,
    progress: Progress | None = None,
) -> ModelError:
    """Single against multiple scattering by the ``most`` trunks with the shortest paths.

    source, receiver : (2,) or (3,) metres. progress : called as progress(frequencies done, all).
    """
    ends = np.array([np.asarray(source)[:2], np.asarray(receiver)[:2]])
    taken, left_out = _solvable(trunks, ends, most)
    centre, radius = trunks.position[taken], trunks.radius[taken]
    speed = air.speed()
    fits = [f for f in frequencies.tolist() if unknowns(f, centre, radius, speed) <= LARGEST]
    every, once = [], []
    for done, frequency in enumerate(fits, start=1):
        at = np.array([frequency])
        coupled, alone = scattered_field(at, centre, radius, ends[0], ends[1:], speed)
        every.append(coupled[0, 0])
        once.append(alone[0, 0])
        if progress:
            progress(done, len(fits))
    return ModelError(np.array(fits), np.array(every), np.array(once), taken, left_out)


def _solvable(trunks: Trunks, ends: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Numbers of trunks, nearest first, that overlap neither each other nor an end."""
    paths = trunk_paths(trunks, ends[0], ends[1], 1.0, 0.5)
    near = np.argsort(paths.length, kind="stable")[:most]
    near = near[trunks.radius[near] > 0]
    reach = np.hypot(*(trunks.position[near][:, None] - ends).T).min(axis=0, initial=np.inf)
    dropped = reach <= trunks.radius[near]
    tree = KDTree(trunks.position[near]) if len(near) else None
    for i, j in sorted(tree.query_pairs(2.0 * trunks.radius[near].max())) if tree else ():
        if dropped[i] or dropped[j]:
            continue
        a, b = near[i], near[j]
        apart = np.hypot(*(trunks.position[a] - trunks.position[b]))
        if apart <= trunks.radius[a] + trunks.radius[b]:
            dropped[i if trunks.radius[a] < trunks.radius[b] else j] = True
    return near[~dropped], int(dropped.sum())
