"""Trunks that are so much louder than the rest of a record that a fast sum's error of them is heard there.

A fast sum's error of a trunk is a share of that trunk's sound, and is spread over the whole record. Near
trunks, or all early ones where much is lost on the way, are many times as loud as the record's faint end:
they are summed one by one.
"""

from __future__ import annotations

import numpy as np

from ....spec import Air
from ..forest.losses import Losses, loss_per_metre
from .contract import FAINTEST_TENTH
from .scattering import TrunkPaths

BANDS = (125.0, 1000.0, 4000.0)  # Hz at which loudness is estimated
LOUDER = 10.0  # times a tenth of the record that all of the others are together
MOST_SINGLE, MOST = 400, 20_000  # trunks that are summed one by one; among so many


def loud_trunks(
    paths: TrunkPaths, rate: float, count: int, air: Air, losses: Losses | None
) -> np.ndarray:
    """(M,) bool."""
    found = np.zeros(len(paths.length), bool)
    if not 1 < len(found) <= MOST:
        return found
    band = np.array([f for f in BANDS if f < 0.4 * rate])
    loss = loss_per_metre(band, air, losses)
    if losses is not None:
        loss = loss + 0.5 * losses.removed(band)
    size = np.outer(2.0 * np.pi * band / air.speed(), paths.radius)
    lost = np.exp(-2.0 * np.outer(loss, paths.length))
    energy = np.square(paths.weight) * paths.radius * np.minimum(size, 1.0) ** 3 * lost
    energy = (energy * band[:, None]).sum(axis=0)
    tenth = np.floor(10.0 * paths.earliest / air.speed() * rate / count).astype(np.int64)
    within = (tenth >= 0) & (tenth < 10)
    of_tenth = np.bincount(tenth[within], energy[within], minlength=10)
    heard = of_tenth > FAINTEST_TENTH**2 * of_tenth.sum()
    if not heard.any():
        return found
    order = np.argsort(-energy, kind="stable")
    left = np.cumsum(energy[order][::-1])[::-1]  # of this and all fainter ones
    needed = int((left > LOUDER**2 * of_tenth[heard].min()).sum())
    found[order[: min(needed, MOST_SINGLE)]] = True
    return found
