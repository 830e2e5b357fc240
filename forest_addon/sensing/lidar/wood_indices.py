"""Wood indices of a tractor scan (Méndez et al.): the impacted area, and lines through the origin.

A beam that meets wood at distance l stands for the area Δy·l·(sin(θ + Δθ) - sin θ); A_IM is their sum.
With θ from the horizontal, as Méndez et al.'s eq. 8 has it, that is the size of the sector where it is
level; with θ from the vertical, as its eq. 14 can be read, level beams stand for nothing. Ours is the
former. What it is compared with, the volume V_L, area A_L and projected area A_PR of all wood, is the
truth of the skeleton (``growth.truth``). A gap between scans is not filled: A_IM is of what was scanned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.trimesh import is_wood
from ...spec import Tractor
from .tractor import TractorScan


def beam_areas(scan: TractorScan, tractor: Tractor, *, from_vertical: bool = False) -> np.ndarray:
    """(N, M) m² of wood that each beam stands for, 0 where it met none.

    from_vertical : measure θ from the vertical, as eq. 14 can be read; the amount of the difference.
    """
    angle = np.pi / 2 - scan.angle if from_vertical else scan.angle
    step = np.deg2rad(tractor.angle_step_deg) * (-1 if from_vertical else 1)
    wide = np.abs(np.sin(angle + step) - np.sin(angle))
    reach = np.where(is_wood(scan.organ), scan.distance, 0.0)
    area: np.ndarray = tractor.step * reach * wide
    return area


def impacted_area(scan: TractorScan, tractor: Tractor) -> float:
    """A_IM of the orchard, m²."""
    return float(beam_areas(scan, tractor).sum())


def impacted_by_tree(scan: TractorScan, tractor: Tractor, trees: int) -> np.ndarray:
    """(trees,) A_IM of the trees numbered from 0, m²; wood of no tree is left out."""
    tree = scan.returns.tree
    known = (tree >= 0) & (tree < trees)
    area = beam_areas(scan, tractor).ravel()
    return np.bincount(tree[known], area[known], minlength=trees)


@dataclass(frozen=True)
class OriginLine:
    """y = slope·x; ``r2`` is 1 - Σ(y - slope·x)² / Σ(y - ȳ)²."""

    slope: float
    r2: float


def line_through_origin(x: np.ndarray, y: np.ndarray) -> OriginLine:
    """Least squares without an intercept, as S fits A_PR and A_L on A_IM.

    Raises
    ------
    ValueError : fewer than two points, or all x are 0.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(x) < 2 or not x.any():
        raise ValueError("a line needs at least two points, and an x that is not 0")
    slope = float(x @ y / (x @ x))
    scatter = float(((y - y.mean()) ** 2).sum())
    missed = float(((y - slope * x) ** 2).sum())
    return OriginLine(slope, 1.0 - missed / scatter if scatter > 0 else float(missed == 0))
