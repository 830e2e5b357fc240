"""Statistics of flights and guesses: shares with their intervals, and the area under an ROC curve."""

from __future__ import annotations

import numpy as np


def interval(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's interval of a share (1927): from, to; 0 to 1 without trials."""
    if not trials:
        return 0.0, 1.0
    share, square = successes / trials, z * z / trials
    middle = (share + square / 2) / (1 + square)
    half = z * np.sqrt(share * (1 - share) / trials + square / (4 * trials)) / (1 + square)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def area_under_curve(score: np.ndarray, is_it: np.ndarray) -> float:
    """Chance that one that is it (M,) bool scores higher than one that is not, ties counted half: the area
    under the ROC curve (Mann & Whitney 1947).
    """
    score = np.asarray(score, dtype=np.float64)
    _, place, count = np.unique(score, return_inverse=True, return_counts=True)
    rank = (np.cumsum(count) - (count - 1) / 2.0)[place]
    yes, no = int(is_it.sum()), int((~is_it).sum())
    if not yes or not no:
        return 0.5
    return float((rank[is_it].sum() - yes * (yes + 1) / 2.0) / (yes * no))


def discriminant(features: np.ndarray, is_it: np.ndarray, ridge: float = 0.1) -> np.ndarray:
    """(F + 1,) weights and offset of Fisher's linear discriminant (1936) of features (M, F).

    ridge : share of the mean variance that is added to each, so that few samples do for many features.
    """
    yes, no = features[is_it], features[~is_it]
    spread = np.atleast_2d(np.cov(yes, rowvar=False) + np.cov(no, rowvar=False)) / 2
    spread = spread + np.eye(len(spread)) * (ridge * np.trace(spread) / len(spread) + 1e-12)
    weights = np.linalg.solve(spread, yes.mean(axis=0) - no.mean(axis=0))
    middle = (yes.mean(axis=0) + no.mean(axis=0)) / 2
    return np.append(weights, -weights @ middle)
