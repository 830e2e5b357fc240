"""Pings of two ears with Doppler, plain and measured all round, beside those without.

Leaves of 8 to 30 mm stand at random in a sphere of 1.5 m about a place 4 m ahead; the sonar flies at them at
5 m/s with a sweep of 2 ms from 80 to 40 kHz. Nothing is culled, so that every row sums the same leaves.
"""

from __future__ import annotations

import time

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.sensing.sonar.beam import MeasuredSphere
from forest_addon.sensing.sonar.discs import LeafDiscs
from forest_addon.sensing.sonar.ping import EchoTargets, ping
from forest_addon.sensing.sonar.station import Equipment
from forest_addon.spec import Air, Sonar

from ..tables import table

TITLE = "sonar: Doppler and measured ears, 6,936 leaves"
LEAVES, DIRECTIONS, AGAIN = 6936, 800, 3
SONAR = Sonar(
    position=(0.0, 0.0, 0.0), ears=2, ear_spacing=0.015, band=(40e3, 80e3), sample_rate=250e3,
    call="fm", speed=5.0, cull=0.0, tolerance=1e-3, facets=False, wood=False, shading="none",
    beam_width_deg=(60.0, 60.0), hearing="gaussian", max_range=10.0,
)  # fmt: skip


def run(say: Say) -> None:
    """Print the table."""
    targets = EchoTargets.of_discs(_leaves())
    rows = []
    for model in ("paper", "piston", "exact"):
        for hearing in ("gaussian", "measured"):
            taken = [_seconds(targets, model, hearing, doppler) for doppler in (False, True)]
            rows.append([model, hearing, *(f"{1e3 * seconds:.0f}" for seconds in taken)])
    table(say, ["leaf model", "ears", "ping, ms", "with Doppler, ms"], rows)


def _seconds(targets: EchoTargets, model: str, hearing: str, doppler: bool) -> float:
    """The least CPU time of a ping of several, warm."""
    sonar = SONAR.changed(leaf_model=model, doppler=doppler)
    hears = (_ear(1.0), _ear(-1.0)) if hearing == "measured" else ()
    equipment = Equipment.of(sonar, hears=hears)
    ping(targets, sonar, Air(), equipment=equipment)
    taken = []
    for _ in range(AGAIN):
        start = time.thread_time()
        ping(targets, sonar, Air(), equipment=equipment)
        taken.append(time.thread_time() - start)
    return min(taken)


def _leaves() -> LeafDiscs:
    rng = stream(5, "bench", "sonar", "doppler")
    away = rng.normal(size=(LEAVES, 3))
    away *= 1.5 * np.cbrt(rng.uniform(size=(LEAVES, 1))) / np.linalg.norm(away, axis=1)[:, None]
    normal = rng.normal(size=(LEAVES, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    number, one = np.arange(LEAVES), np.zeros(LEAVES, np.int64)
    radius = rng.uniform(0.008, 0.03, LEAVES)
    centre = away + np.array([4.0, 0.0, 0.0])
    return LeafDiscs(centre, normal, radius, one, number, one - 1)


def _ear(left: float) -> MeasuredSphere:
    """An ear that hears best aside and ahead, the more so the higher the frequency."""
    rng = stream(6, "bench", "sonar", "ears")
    towards = rng.normal(size=(DIRECTIONS, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    frequency = np.linspace(30e3, 90e3, 7)
    level = 12.0 * (0.8 * towards[:, 0] + 0.6 * left * towards[:, 1] - 1.0)
    return MeasuredSphere.all_round(towards, frequency, level[:, None] * frequency / 60e3)
