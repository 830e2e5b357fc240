"""Trunks that are heard above all others of a record, and those that nothing of it would miss.

A fast sum's error of a trunk is a share of that trunk's sound, and is spread over the whole record. Near
trunks, or all early ones where much is lost on the way, are many times as loud as the record's faint end:
they are summed one by one. Far ones, at frequencies that are lost on the way, are not heard at all.
Energies are those of trunks that stand at random, w²·a·min(ka, 1)³·e^{-2b(f)x}.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .contract import FAINTEST_TENTH
from .scattering import TrunkPaths

BANDS = (125.0, 1000.0, 4000.0)  # Hz at which loudness is estimated
LOUDER = 10.0  # times a tenth of the record that all of the others are together
MOST_SINGLE, MOST = 400, 20_000  # trunks that are summed one by one; among so many
UNHEARD, MOST_UNHEARD = 1e-2, 1e-6  # of the tolerance, of the sound: 40 dB are left for the ground
OCTAVES = 20.0 * 2.0 ** np.arange(0, 13, 0.5)  # Hz at which all sound is known

Loss = Callable[[np.ndarray], np.ndarray]  # nepers of amplitude per metre at frequencies (F,)


def energies(paths: TrunkPaths, frequency: np.ndarray, loss: Loss, speed: float) -> np.ndarray:
    """(F, M) expected energy of each trunk's sound at frequencies (F,), but for a factor."""
    size = np.outer(2.0 * np.pi / speed * frequency, paths.radius)
    lost = np.exp(-2.0 * np.outer(loss(frequency), paths.length))
    return np.asarray(np.square(paths.weight) * paths.radius * np.minimum(size, 1.0) ** 3 * lost)


def whole_energy(paths: TrunkPaths, loss: Loss, speed: float) -> np.ndarray:
    """(F,) energy of all trunks at OCTAVES."""
    return np.array(
        [energies(paths, OCTAVES[n : n + 1], loss, speed).sum() for n in range(len(OCTAVES))]
    )


def unheard(
    some: TrunkPaths,
    ends: tuple[float, float],
    whole: np.ndarray,
    loss: Loss,
    speed: float,
    tolerance: float,
) -> bool:
    """Return whether nothing between two frequencies in Hz would miss some trunks.

    They are fainter there than UNHEARD of the tolerance of all trunks (``whole_energy``), and of their own
    sound where it is loudest: neither an octave nor a part of the record changes by more than that.
    """
    share = min(UNHEARD * tolerance, MOST_UNHEARD) ** 2
    here = np.array(ends)
    found = energies(some, here, loss, speed).sum(axis=1)
    every = np.interp(np.log(here), np.log(OCTAVES), np.log(whole + 1e-300))
    if (found > share * np.exp(every)).any():
        return False
    band = np.array(BANDS)
    own = (energies(some, band, loss, speed).sum(axis=1) * band).max()
    return bool((found * here <= share * own).all())


def loud_trunks(paths: TrunkPaths, rate: float, count: int, loss: Loss, speed: float) -> np.ndarray:
    """(M,) bool."""
    found = np.zeros(len(paths.length), bool)
    if not 1 < len(found) <= MOST:
        return found
    band = np.array([f for f in BANDS if f < 0.4 * rate])
    energy = (energies(paths, band, loss, speed) * band[:, None]).sum(axis=0)
    tenth = np.floor(10.0 * paths.earliest / speed * rate / count).astype(np.int64)
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
