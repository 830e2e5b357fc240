"""The direct reverb sum: time by number of trunks and of different radii."""

from __future__ import annotations

import numpy as np

from forest_addon.rng import stream
from forest_addon.sensing.metrics import clarity_db, reverberation_time
from forest_addon.sensing.reverb import impulse_response
from forest_addon.sensing.slices import Trunks
from forest_addon.spec import Air, Reverb

from . import Say, median_seconds, table

TITLE = "reverb: direct sum over trunks, 24 kHz, 1 s, D = 10 m"


def run(say: Say) -> None:
    """Print time, reverberation time and clarity."""
    rows = []
    for count, radii in ((100, 1), (1_000, 1), (1_000, 40), (5_000, 1)):
        rng = stream(5, "bench", "trunks", count)
        half = np.sqrt(count / 0.1) / 2  # a thousand trees a hectare
        trunks = Trunks(
            position=rng.uniform(-half, half, (count, 2)),
            radius=np.linspace(0.1, 0.3, radii)[rng.integers(radii, size=count)],
            tree=np.arange(count),
        )
        reverb = Reverb(source=(-5.0, 0.0, 1.5), receiver=(5.0, 0.0, 1.5), duration=1.0)
        found = impulse_response(trunks, reverb, Air())
        seconds = median_seconds(lambda t=trunks, r=reverb: impulse_response(t, r, Air()), runs=1)
        rows.append(
            [
                f"{count:,}",
                f"{radii}",
                f"{seconds:.2f}",
                f"{reverberation_time(found.samples, 24e3):.2f}",
                f"{clarity_db(found.samples, 24e3):.1f}",
            ]
        )
    table(say, ["trunks", "different radii", "s", "T60, s", "C50, dB"], rows)
