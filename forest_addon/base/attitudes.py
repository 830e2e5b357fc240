"""Rotations one after the other, many at once.

``Rotation.__mul__`` of scipy takes a microsecond a pair, thirty times as long as its arithmetic, and a scan
from a moving platform composes two for each pulse. Here the same sums are made column by column, to the
same bits.
"""

from __future__ import annotations

import numpy as np
import scipy


def composed(
    first: scipy.spatial.transform.Rotation, second: scipy.spatial.transform.Rotation
) -> scipy.spatial.transform.Rotation:
    """The product ``first * second``, which turns by ``second``, then by ``first``; one of them may be
    single, for all of the other."""
    p, q = (np.atleast_2d(one.as_quat()) for one in (first, second))
    (p0, p1, p2, p3), (q0, q1, q2, q3) = p.T, q.T
    product = np.empty((max(len(p), len(q)), 4))
    product[:, 0] = p3 * q0 + q3 * p0 + (p1 * q2 - p2 * q1)
    product[:, 1] = p3 * q1 + q3 * p1 + (p2 * q0 - p0 * q2)
    product[:, 2] = p3 * q2 + q3 * p2 + (p0 * q1 - p1 * q0)
    product[:, 3] = p3 * q3 - p0 * q0 - p1 * q1 - p2 * q2
    return scipy.spatial.transform.Rotation.from_quat(product)


class Turning:
    """The shortest turns from each of K attitudes to the next (slerp, as scipy's ``Slerp``).

    time : (K,) s. attitude : K rotations, at least two.

    Raises
    ------
    ValueError : times that do not rise.
    """

    def __init__(self, time: np.ndarray, attitude: scipy.spatial.transform.Rotation) -> None:
        if not (np.diff(time) > 0).all():
            raise ValueError("the times of attitudes must rise")
        self._time, self._from = time, attitude[:-1]
        self._turn = composed(self._from.inv(), attitude[1:]).as_rotvec()

    def at(self, time: np.ndarray) -> scipy.spatial.transform.Rotation:
        """P attitudes at times (P,) from the first to the last."""
        row = np.maximum(np.searchsorted(self._time, time) - 1, 0)
        share = (time - self._time[row]) / np.diff(self._time)[row]
        return composed(
            self._from[row],
            scipy.spatial.transform.Rotation.from_rotvec(self._turn[row] * share[:, None]),
        )
