"""A policy that is trained by ear in noise, flown in more of it.

A bat of two ears flies among trunks at random, one pulse a step. Its receiver has white noise of its own, so
loud that the peak echo of a trunk straight ahead is ``LEARNT_DB`` above the noise in the band; there the
small policy learns (cross-entropy method, ``flight.policies``). It is then flown through forests that it has
not heard, in no noise, in that of the training and in more; each flight has a stretch of forest of its own.
Beside it the rule of Vanderelst et al. (2015), and who hears nothing and flies straight on.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from forest_addon.api import Air, Flight, SonarReceiver

from ..inside import (
    SONAR,
    TRUNK,
    EarSense,
    EchoPolicy,
    EchoReceiver,
    Flyers,
    StemForests,
    StemWorld,
    Straight,
    Trained,
    at_rest,
    fly,
    interval,
    write_csv,
)
from .learn import learnt

DENSITY = 0.08  # trees/m²
AHEAD = 2.0  # metres to the trunk whose echo says how loud noise is
LEARNT_DB, SNR_DB = 10.0, (None, 10.0, 0.0, -5.0)  # dB; None: no noise
ROUNDS, DRAWINGS, STARTS = 12, 20, 2
FLIGHTS, LANE = 100, 40.0  # of a level, and metres of the forest's width for each
SOURCE_LEVEL = 110.0  # dB re 20 µPa at 0.1 m
FLIGHT = Flight(
    speed=3.0,
    distance=15.0,
    aim="heading",
    step=0.2,
    steps=60,
    start_low=(0.0, 0.1),
    start_high=(0.0, 0.9),
    height=1.5,
    clearance=1.0,
)
HEARS = SONAR.changed(
    call="impulse", band=(30e3, 50e3), sample_rate=125e3, max_range=4.0, wood=True, leaves=False
)


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> dict:
    """Train, fly, write ``trained.npz`` and ``noise.csv``; returns how many arrive, by policy and noise."""
    out.mkdir(parents=True, exist_ok=True)
    flights = max(4, round(FLIGHTS * size))
    ears = {snr: hearing(snr) for snr in SNR_DB}
    plan = max(2, round(ROUNDS * size)), DRAWINGS, STARTS
    weights = learnt(FLIGHT, ears[LEARNT_DB], forests(STARTS).surroundings, plan, seed, say)
    Trained(FLIGHT, ears[LEARNT_DB], weights).save(out / "trained.npz")
    world = forests(flights).surroundings(seed)
    found: dict[tuple[str, float | None], int] = {}
    for snr, sense in ears.items():
        policies = {"trained": Trained(FLIGHT, sense, weights), "echo": EchoPolicy(FLIGHT, sense)}
        if snr is None:
            policies["straight on"] = Straight(FLIGHT)
        for name, policy in policies.items():
            flyers = Flyers(FLIGHT, flights, None, sense if policy.sensors else None)
            flyers.enter(world)
            tracks = fly(flyers, policy, [1000 + seed + n for n in range(flights)])
            count = found[name, snr] = sum(track.end == "arrived" for track in tracks)
            low, high = interval(count, flights)
            level = "no noise" if snr is None else f"{snr:g} dB"
            say(
                f"| {name} | {level} | {count} of {flights} | {100 * low:.0f} to {100 * high:.0f} % |"
            )
    ends = np.array([interval(count, flights) for count in found.values()])
    table = {
        "policy": [name for name, _ in found],
        "snr_db": ["" if snr is None else snr for _, snr in found],
        "flights": [flights] * len(found),
        "arrived": list(found.values()),
        "share_low": ends[:, 0].round(3).tolist(),
        "share_high": ends[:, 1].round(3).tolist(),
    }
    write_csv(out / "noise.csv", table)
    say(f"Written to {out}: trained.npz, noise.csv")
    return found


def forests(flights: int) -> StemForests:
    """Forests with a lane for each flight."""
    return StemForests(FLIGHT, DENSITY, width=LANE * flights)


def hearing(snr: float | None) -> EarSense:
    """Ears in such noise that the echo of a trunk ahead is ``snr`` dB above it."""
    if snr is None:
        return EarSense(HEARS, Air())
    settings = SonarReceiver(source_level_db=SOURCE_LEVEL)
    tree = StemWorld(np.array([[AHEAD, 0.0]]), np.array([TRUNK]), np.zeros(2), np.ones(2))
    silent = EarSense(HEARS.changed(receiver=settings), Air())
    state = at_rest(FLIGHT, np.array([[0.0, 0.0, FLIGHT.height]]), np.zeros(1))
    echo = silent.ping(tree, state)
    level = EchoReceiver(silent.sonar).self_noise_for(
        float(echo.envelopes.max()) * echo.received.pressure, snr
    )
    return EarSense(HEARS.changed(receiver=settings.changed(self_noise_db=level)), Air())
