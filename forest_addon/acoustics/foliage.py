"""Absorption of sound by foliage (Watanabe & Yamada 1996, J. Acoust. Soc. Jpn. (E) 17).

A leaf absorbs the share α = G·√f of the sound on its surface, G from 0.001 to 0.002 as measured in a
reverberation room. Sound among leaves that look all ways meets both faces of F square metres of leaf a
cubic metre: its energy falls as e^{-αFx/2} (Kuttruff 2009, 5.1: A/4V of a surface 2F).
"""

from __future__ import annotations

import numpy as np

MOST = 0.9  # of the sound; G·√f is a fit, and would pass 1


def foliage_loss(frequency: np.ndarray, leaf_area_density: float, absorption: float) -> np.ndarray:
    """Nepers (of amplitude) per metre at frequencies in Hz. absorption : G."""
    share = np.minimum(absorption * np.sqrt(frequency), MOST)
    found: np.ndarray = 0.25 * leaf_area_density * share
    return found
