"""Exact samples of an inhomogeneous Poisson process.

A hill of the mixture is a Poisson number of normal points over the whole plane; what falls outside the
field is dropped. By superposition and restriction the rest is exactly the process on the field, without
a grid and without a bound to violate (T20; Kingman, Poisson Processes, ch. 2).
"""

from __future__ import annotations

import numpy as np

from .intensity import Intensity

MAX_POINTS = 20_000_000


def sample(intensity: Intensity, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 2) of the process; N is Poisson with mean ∫λ.

    Raises
    ------
    ValueError : more than ``MAX_POINTS`` points would be drawn; says how many.
    """
    # ∫ C exp(-(x-a)²/h² - (y-b)²/l²) over the plane is C·π·h·l; the normal has σ = h/√2.
    whole = intensity.peak * np.pi * intensity.width.prod(axis=1)
    flat = intensity.constant * float(np.prod(intensity.high - intensity.low))
    if whole.sum() + flat > MAX_POINTS:
        raise ValueError(
            f"the intensity asks for {whole.sum() + flat:,.0f} trees, more than {MAX_POINTS:,}; "
            "lower the peaks or the expected number"
        )
    clouds = [rng.uniform(intensity.low, intensity.high, (rng.poisson(flat), 2))]
    for mean, centre, width in zip(whole, intensity.centre, intensity.width, strict=True):
        clouds.append(rng.normal(centre, width / np.sqrt(2), (rng.poisson(mean), 2)))
    points = np.concatenate(clouds)
    inside = ((points >= intensity.low) & (points <= intensity.high)).all(axis=1)
    return points[inside]
