"""Gaps between the returns of a pulse from a tripod among conifers, beside those of a real VZ-400i scan.

The real scan (975,000 pulses; its stand is not described) had the quantiles in ``REAL`` and the shares in
``SHARES``. Ours is the pine plot of ``living``, by the instrument's own file, between 4 and 30 m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from forest_addon.blender.rays.casters import make_caster
from forest_addon.formats.scanner_file import settings_of
from forest_addon.formats.toml_file import structure
from forest_addon.sensing.lidar.scan import scan
from forest_addon.spec import Rays, Terrestrial

from ..comparison import Comparison, Interval
from ..living import geometry_of, pine_stems, site_of
from .shares import shares_of

REAL = {0.001: 0.36, 0.01: 0.54, 0.05: 0.76, 0.1: 0.87}  # metres
SHARES = (92.8, 7.04, 0.15)  # %
NEAR = 0.1  # m that count as the same, stated before the run
RANGES = (4.0, 30.0)
STEP = 0.25  # degrees


def compare_gaps(seed: int) -> list[Comparison]:
    """Quantiles of the gaps between returns of a pulse, and what share of pulses has one."""
    site = site_of(pine_stems(seed), "scots-pine", seed)
    plain = structure(settings_of("riegl-vz-400i", "terrestrial", Path()), Terrestrial)
    scanner = plain.changed(position=(5.0, 5.0, 1.6), angle_step_deg=STEP)
    cloud = scan(scanner, make_caster(geometry_of(site, site.grow()), Rays()), seed)
    near, far = RANGES
    same = (np.diff(cloud.pulse) == 0) & (cloud.true_range[:-1] > near)
    gap = np.diff(cloud.returns.distance)[same & (cloud.true_range[1:] < far)]
    first = cloud.number == 1
    shares = 100 * shares_of(cloud.count[first])
    words = (
        f"Of {len(gap):,} gaps in {first.sum():,} pulses; pulses with 1, 2 and 3 returns "
        f"{shares[0]:.1f}, {shares[1]:.2f}, {shares[2]:.2f} %, in the real scan "
        f"{SHARES[0]}, {SHARES[1]}, {SHARES[2]}. Within 0.1 m; another stand."
    )
    return [
        Comparison(
            f"VZ-400i, gap between returns of a pulse, {100 * share:g} % are smaller",
            "m",
            Interval(real),
            Interval(float(np.quantile(gap, share))),
            bool(abs(float(np.quantile(gap, share)) - real) <= NEAR),
            words="" if k else words,
        )
        for k, (share, real) in enumerate(REAL.items())
    ]
