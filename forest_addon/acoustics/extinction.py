"""Extinction of sound by trunks: cross-sections of scattering and absorption per metre of trunk.

Sizes ka go in, widths over the radius come out, from the partial waves w_n = sinγ_n·e^{iγ_n} of
``cylinder``: extinction by the optical theorem, scattering by Parseval,

    σ_ext = 4/k·Σ ε_n·Im w_n,   σ_sca = 4/k·Σ ε_n·|w_n|²

(Bohren & Huffman 1983, ch. 8, for sound). Large trunks take out twice their width: half of that is the
shadow, which goes straight on. As far as energy is concerned it has not met the trunk: σ_energy is
σ_ext, at most about the width 2a (a smooth minimum, ``EDGE``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cylinder import order_count, partial_waves

EDGE = 6.0  # (σ_ext^-EDGE + (2a)^-EDGE)^(-1/EDGE)


@dataclass(frozen=True)
class CrossSections:
    """(K,) each, over the radius: what is taken out, and what is scattered."""

    extinction: np.ndarray
    scattering: np.ndarray

    @property
    def absorption(self) -> np.ndarray:
        """Absorption cross-section of bark."""
        return self.extinction - self.scattering

    @property
    def energy(self) -> np.ndarray:
        """Extinction without the shadow: at most the width of the trunk."""
        share = np.maximum(self.extinction, 1e-30) / 2.0
        return 2.0 * share / (1.0 + share**EDGE) ** (1.0 / EDGE)


def cross_sections(ka: np.ndarray, bark: float = 0.0) -> CrossSections:
    """Cross-sections of trunks of sizes ka (K,), above 0. bark : share that it absorbs of a wave head on."""
    order = np.argsort(ka, kind="stable")
    sections = np.empty((2, len(ka)))
    for rows in np.array_split(order, max(1, len(ka) // 64)):
        if len(rows) == 0:
            continue
        size = np.asarray(ka, np.float64)[rows]
        waves = partial_waves(size, order_count(float(size.max())), bark)
        weight = np.full((len(waves), 1), 2.0)
        weight[0] = 1.0
        sections[0, rows] = 4.0 / size * (weight * waves.imag).sum(axis=0)
        sections[1, rows] = 4.0 / size * (weight * np.abs(waves) ** 2).sum(axis=0)
    return CrossSections(*sections)
