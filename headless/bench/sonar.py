"""The direct echo sum: time by number of leaves, and what culling leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from forest_addon.rng import stream
from forest_addon.sensing.discs import LeafDiscs
from forest_addon.sensing.sonar import ping
from forest_addon.spec import Air, Sonar

from . import Say, median_seconds, table

TITLE = "sonar: direct sum over leaves, 60-80 kHz, 30° beam"


def run(say: Say) -> None:
    """Print time with and without culling, and the difference between the two echoes."""
    sonar = Sonar(position=(0.0, 0.0, 2.0), shading="none", max_range=12.0)
    rows = []
    for count in (1_000, 10_000, 20_000):
        discs = _crown(count)
        whole = ping(discs, replace(sonar, cull=0.0), Air())
        culled = ping(discs, sonar, Air())
        seconds = [
            median_seconds(lambda d=discs, c=cull: ping(d, replace(sonar, cull=c), Air()), runs=1)
            for cull in (0.0, sonar.cull)
        ]
        size = min(len(whole.impulse_response), len(culled.impulse_response))
        gap = whole.impulse_response[:size] - culled.impulse_response[:size]
        error = np.linalg.norm(gap) / np.linalg.norm(whole.impulse_response)
        rows.append(
            [
                f"{count:,}",
                f"{seconds[0]:.2f}",
                f"{np.count_nonzero(culled.heard):,}",
                f"{seconds[1]:.2f}",
                f"{culled.cull_bound:.1e}",
                f"{error:.1e}",
            ]
        )
    head = ["leaves", "all, s", "heard", "culled, s", "bound", "relative L2 error of culling"]
    table(say, head, rows)


def _crown(count: int) -> LeafDiscs:
    rng = stream(4, "bench", "crown", count)
    normal = rng.normal(size=(count, 3))
    return LeafDiscs(
        centre=rng.uniform([3, -4, 0], [11, 4, 6], (count, 3)),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        radius=rng.uniform(0.02, 0.06, count),
        instance=np.zeros(count, dtype=np.int64),
        leaf=np.arange(count),
        tree=np.zeros(count, dtype=np.int64),
    )
