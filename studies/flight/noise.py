"""A policy that learns by ear in noise, flown in more of it.

A bat of two ears flies among trunks at random, one pulse a step. Its receiver has white noise of its own, so
loud that the peak echo of a trunk straight ahead is ``LEARNT_DB`` above the noise in the band. There the
small policy (``flight.policies``) learns from one that sees: the gap policy decides by LiDAR where the bat
should go, first as it flies itself, then as the pupil does (Ross, Gordon & Bagnell 2011). It is then flown
through forests that it has not heard, in no noise, in that of the training and in more; each flight has a
stretch of forest of its own.
Beside it, in no noise, the rule of Vanderelst et al. (2015), and who flies straight on.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from forest_addon.api import Air, Flight, SonarReceiver

from ..inside import (
    LIDAR,
    SIZE,
    SONAR,
    TRUNK,
    EarSense,
    EchoPolicy,
    EchoReceiver,
    Flyers,
    Gap,
    LidarSense,
    StemForests,
    StemWorld,
    Straight,
    Trained,
    at_rest,
    azimuth_of,
    decided,
    fly,
    interval,
    stream,
)
from ..tables import write_rows

DENSITY = 0.1  # trees/m²
AHEAD = 2.0  # metres to the trunk whose echo says how loud noise is
LEARNT_DB, SNR_DB = 10.0, (None, 10.0, 0.0, -5.0)  # dB; None: no noise
PASSES, PUPILS = 2, 32  # of lessons; flights in each
LONGEST = 20  # steps of the fit
REST = 0.02  # radians, that a weight of 1 costs as much as
FLIGHTS, LANE = 48, 40.0  # of a level, and metres of the forest's width for each
SOURCE_LEVEL = 110.0  # dB re 20 µPa at 0.1 m
FLIGHT = Flight(
    speed=3.0,
    distance=12.0,
    aim="heading",
    step=0.2,
    steps=30,
    start_low=(0.0, 0.1),
    start_high=(0.0, 0.9),
    height=0.5,
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
    weights = taught(ears[LEARNT_DB], max(4, round(PUPILS * size)), seed, say)
    Trained(FLIGHT, ears[LEARNT_DB], weights).save(out / "trained.npz")
    world = forests(flights).surroundings(seed)
    found: dict[tuple[str, float | None], int] = {}
    rows = []
    for snr, sense in ears.items():
        policies = {"trained": Trained(FLIGHT, sense, weights)}
        if snr is None:
            policies |= {"echo": EchoPolicy(FLIGHT, sense), "straight on": Straight(FLIGHT)}
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
            row = {"policy": name, "snr_db": "" if snr is None else snr, "flights": flights}
            rows.append(
                row | {"arrived": count, "share_low": round(low, 3), "share_high": round(high, 3)}
            )
    write_rows(out / "noise.csv", rows)
    say(f"Written to {out}: trained.npz, noise.csv")
    return found


def taught(sense: EarSense, pupils: int, seed: int, say: Callable[[str], None]) -> np.ndarray:
    """(SIZE,) weights of a policy by ear that decides as near as it can to what the gap policy does."""
    lidar = LidarSense(LIDAR)
    teacher = Gap(FLIGHT, lidar)
    weights = 0.3 * stream(seed, "flight", "taught").standard_normal(SIZE)
    rows: list[tuple[np.ndarray, ...]] = []
    for number in range(PASSES):
        flyers, pupil = Flyers(FLIGHT, pupils, lidar, sense), Trained(FLIGHT, sense, weights)
        flyers.enter(forests(pupils).surroundings(seed + 1 + number))
        flyers.start(range(pupils), [pupils * number + n for n in range(pupils)])
        going = np.ones(pupils, dtype=bool)
        for _ in range(FLIGHT.steps):
            told = flyers.sense(going)
            action = teacher.act(told)
            step = pupil.felt(told), azimuth_of(told["odometry"]), teacher.way, teacher.pace
            rows.append(tuple(part[going] for part in step))
            out = flyers.step(pupil.act(told) if number else action)
            going &= ~out.ended
            if not going.any():
                break
        felt, aim, way, pace = (np.concatenate(part) for part in zip(*rows, strict=True))

        def off(weights: np.ndarray, known=(felt, aim), asked=(way, pace)) -> np.ndarray:
            ours = decided(weights, *known)
            return np.concatenate([ours[0] - asked[0], ours[1] - asked[1], REST * weights])

        say(f"lesson {number + 1}: {len(felt)} decisions")
        weights = least_squares(off, weights, method="lm", max_nfev=LONGEST).x
    return weights


def forests(flights: int) -> StemForests:
    """Forests with a lane for each flight."""
    return StemForests(FLIGHT, DENSITY, width=LANE * flights, height=2 * FLIGHT.height)


def hearing(snr: float | None) -> EarSense:
    """Ears in such noise that the echo of a trunk ahead is ``snr`` dB above it."""
    if snr is None:
        return EarSense(HEARS, Air())
    settings = SonarReceiver(source_level_db=SOURCE_LEVEL)
    tree = StemWorld(np.array([[AHEAD, 0.0]]), np.array([TRUNK]), *np.eye(2), 2 * FLIGHT.height)
    silent = EarSense(HEARS.changed(receiver=settings), Air())
    state = at_rest(FLIGHT, np.array([[0.0, 0.0, FLIGHT.height]]), np.zeros(1))
    echo = silent.ping(tree, state)
    level = EchoReceiver(silent.sonar).self_noise_for(
        float(echo.envelopes.max()) * echo.received.pressure, snr
    )
    return EarSense(HEARS.changed(receiver=settings.changed(self_noise_db=level)), Air())
