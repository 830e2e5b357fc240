"""Echoes as waves that tables of few modes hold: rims of pistons, and what is smeared along a segment.

A piston well off its normal sounds from two places of its rim, whose waves depend on a·sinβ alone but for a
factor (``sonar/leaves``); nearer its normal the whole does. A segment that sound meets at an angle is
F(k)·sinc(kL), L = ℓ·|cosψ|: its two ends,

    sinc(kL) = e^{ikL}/(2ikL) - e^{-ikL}/(2ikL),

or, where the ends are less than a wave apart and would cancel, a few places between them, by Gauss's rule
for sinc(kL) = ½∫e^{ikLt}dt over -1 <= t <= 1. In either way a wave is F, or F/ik, at a delay of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..disc import jinc
from ..hankel import SMALLEST, hankel
from .band_modes import KEPT
from .disc_modes import FEW, LEAST, QUARTERS
from .line_modes import BandLoss, LineModes, LinePlaces, ModeLine, Values, least
from .mode_sum import ModalEchoes

COARSEST = 3e-5  # tolerance from which on tables of a band are used
MODAL = 512  # echoes from which on modes are worth their table
NODES = 24  # of a band, that resolve what turns little
RESOLVED = 1.2  # of these, for each radian over half the band
TURN = 0.1  # radians from row to row at most
APART = 0.02  # from row to row, of the smallest rim
POINTS = 4  # of Gauss's rule, at most
RULE = 0.02  # of the tolerance, that its errors may take
MIDDLES = (np.arange(QUARTERS) + 0.5) / QUARTERS
EVERYWHERE = (np.arange(QUARTERS * FEW) + 0.5) / (QUARTERS * FEW)


def rims_apart(across: np.ndarray, lowest: float, highest: float) -> np.ndarray:
    """(M,) bool: pistons with a·sinβ ``across`` whose rims sound from two places between two wavenumbers,
    and somewhere in phase."""
    apart: np.ndarray = across > _nearest_rim(lowest, highest)
    return apart


def _nearest_rim(lowest: float, highest: float) -> float:
    return max(SMALLEST / (2.0 * lowest), math.pi / (2.0 * (highest - lowest)))


@dataclass(frozen=True)
class _Pistons:
    """Table of waves of pistons (lines: near rim, far rim, whole), and the least sizes of the whole by
    a·sinβ in cells of ``step`` m."""

    modes: LineModes
    step: float
    sizes: np.ndarray


@lru_cache(maxsize=KEPT)
def _pistons(lowest: float, highest: float, top: int, loss: BandLoss) -> _Pistons:
    """Up to a·sinβ of 2^(top/2) metres."""
    largest, rim = 2.0 ** (top / 2), _nearest_rim(lowest, highest)
    inner, step = min(rim, largest), TURN / (2.0 * highest)

    def whole(k: np.ndarray, across: np.ndarray) -> np.ndarray:
        wave: np.ndarray = 0.5j * k * jinc(2.0 * k * across)
        return wave

    def near(k: np.ndarray, across: np.ndarray) -> np.ndarray:
        wave: np.ndarray = 0.25j * hankel(2.0 * k * across) / across
        return wave

    def far(k: np.ndarray, across: np.ndarray) -> np.ndarray:
        return -np.conj(near(k, across))

    lines = [ModeLine(whole, 0.0, inner, step)]
    if largest > rim:
        warp = 100.0 / rim  # nearly in proportion to the rim
        lines += [ModeLine(wave, rim, largest, APART, warp) for wave in (near, far)]
    turned = (highest - lowest) * inner  # 2k·across over half the band
    modes = LineModes(lines, (lowest, highest), math.ceil(NODES + RESOLVED * turned), loss)
    k = lowest + (highest - lowest) * EVERYWHERE
    sizes = least(whole, k, step * np.arange(math.ceil(largest / step) + 2))
    return _Pistons(modes, step, LEAST * sizes.reshape(-1, QUARTERS, FEW).max(axis=2))


def piston_waves(
    radius: np.ndarray,
    incidence: np.ndarray,
    nearness: np.ndarray,
    lowest: float,
    highest: float,
    loss: BandLoss,
) -> ModalEchoes:
    """All of some pistons, (M,) metres and radians, as waves between two wavenumbers."""
    across = radius * np.sin(incidence)
    scale = radius**2 * np.cos(incidence) * nearness
    top = math.floor(2.0 * math.log2(float(radius.max()))) + 1
    known = _pistons(lowest, highest, top, loss)
    apart = rims_apart(across, lowest, highest)
    whole, rims = np.flatnonzero(~apart), np.flatnonzero(apart)
    places = [known.modes.places(0, across[whole])]
    if len(rims):
        near = known.modes.places(1, across[rims])
        places += [near, known.modes.beside(near, 1, 2)]
    owner = np.concatenate([whole, rims, rims])
    offset = np.concatenate([np.zeros(len(whole)), -2.0 * across[rims], 2.0 * across[rims]])
    loudest = known.sizes.take((across / known.step).astype(np.int32), axis=0)
    loudest *= scale[:, None]
    every = np.arange(len(radius))
    return ModalEchoes(
        every, known.modes, LinePlaces.joined(places), owner, scale[owner], offset, loudest
    )


@dataclass(frozen=True)
class Smeared:
    """Table of F/ik and F of families (lines 2n and 2n + 1), and the least |Σ F| in the middles of quarters
    of the band, in cells of the length by ``place``."""

    modes: LineModes
    place: Callable[[np.ndarray], np.ndarray]
    sizes: np.ndarray


def smeared(
    families: Sequence[ModeLine],
    whole: ModeLine,
    ends: tuple[float, float],
    nodes: int,
    loss: BandLoss,
) -> Smeared:
    """The table of families between two wavenumbers that add up to the ``whole``."""
    lines = []
    for family in families:
        beside = family.beside and _over_ik(family.beside)
        lines += [replace(family, values=_over_ik(family.values), beside=beside), family]
    k = ends[0] + (ends[1] - ends[0]) * MIDDLES
    count = math.ceil(float(whole.place(np.array(whole.high)))) + 2
    sizes = least(whole.values, k, whole.length(np.arange(count)))
    return Smeared(LineModes(lines, ends, nodes, loss), whole.place, LEAST * sizes)


def _over_ik(values: Values) -> Values:
    def divided(k: np.ndarray, length: np.ndarray) -> np.ndarray:
        wave: np.ndarray = values(k, length) / (1j * k)
        return wave

    return divided


@dataclass(frozen=True)
class FamilyRows:
    """Rows (n,) of echoes that have a part of one family, whose path is ``offset`` (n,) metres longer."""

    family: int
    rows: np.ndarray
    offset: np.ndarray


def smeared_waves(
    table: Smeared,
    rows: np.ndarray,
    parts: Sequence[FamilyRows],
    scale: np.ndarray,
    length: np.ndarray,
    smear: np.ndarray,
    ends: tuple[float, float],
    tolerance: float,
) -> ModalEchoes:
    """scale·F(k, length)·sinc(k·smear), (m,) each, of ``rows``, as waves between two wavenumbers.

    parts : by rows among these m.
    """
    share = RULE * tolerance
    points = 1 + np.searchsorted(_reaches(share), ends[1] * smear)
    waves: list[tuple[LinePlaces, np.ndarray, np.ndarray, np.ndarray]] = []
    for part in parts:
        kind = points[part.rows]
        for count in range(1, POINTS + 2):
            these = np.flatnonzero(kind == count)
            some, later = part.rows[these], part.offset[these]
            if not len(some):
                continue
            apart = count > POINTS
            places = table.modes.places(2 * part.family + (0 if apart else 1), length[some])
            turn, weight = _rule(count)
            each = 0.5 * scale[some] / (smear[some] if apart else 1.0)
            for one, factor in zip(turn, weight, strict=True):
                waves.append((places, some, later + one * smear[some], factor * each))
    k = ends[0] + (ends[1] - ends[0]) * MIDDLES
    sizes = table.sizes.take(table.place(length).astype(np.int32), axis=0)
    sizes *= np.abs(np.sinc(np.outer(smear, k / math.pi)) * scale[:, None])
    each, owner, offset, factor = zip(*waves, strict=True)
    return ModalEchoes(
        rows,
        table.modes,
        LinePlaces.joined(each),
        np.concatenate(owner),
        np.concatenate(factor),
        np.concatenate(offset),
        sizes,
        share,
    )


def _rule(count: int) -> tuple[list[float], list[float]]:
    """Places and weights of so many points; beyond ``POINTS``, of the two ends."""
    if count > POINTS:
        return [-1.0, 1.0], [1.0, -1.0]
    turn, weight = np.polynomial.legendre.leggauss(count)
    return turn.tolist(), weight.tolist()


@lru_cache(maxsize=16)
def _reaches(error: float) -> np.ndarray:
    """(``POINTS``,) largest arguments up to which rules of 1, 2 … points give the sinc within an error."""
    argument = np.linspace(0.0, math.pi, 4001)[1:]
    found = []
    for count in range(1, POINTS + 1):
        turn, weight = np.polynomial.legendre.leggauss(count)
        off = np.abs(0.5 * np.cos(np.outer(argument, turn)) @ weight - np.sinc(argument / math.pi))
        found.append(float(argument[max(int(np.argmax(off > error)) - 1, 0)]))
    return np.array(found)
