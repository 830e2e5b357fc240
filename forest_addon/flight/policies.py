"""Ways to fly that learning is measured against: straight on, by the widest gap, by two ears.

A policy turns what N flyers sense into actions (N, A). It knows nothing of the world but that.

- ``straight``: towards the aim, whatever is in the way.
- ``gap``: follow the gap (after Sezer & Gokasan 2012, Robot. Auton. Syst. 60, 1123): directions in which
  nothing is nearer than is needed to go on are free, each obstacle grown by the body's radius; of the free
  directions the one that costs least to turn to from the aim and from the nose is taken.
- ``echo``: Vanderelst, Holderied & Peremans (2015, PLoS Comput. Biol. 11, e1004484): turn away from the ear
  that hears the louder echo in the first millisecond after the first echo, the more so the nearer that is;
  no place of anything is worked out. Without an echo it turns to the aim.
- ``trained``: see below.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base.vectors import azimuth_of, column
from ..formats.foreign import guarded
from ..formats.table import write_npz
from ..spec import Flight, SpecError, unknown
from .bodies import ACTIONS, wrapped
from .senses import BINS, EarSense, LidarSense, power_of

NAMES = ("straight", "gap", "echo", "trained")
FIRST = 1e-3  # s of an echo that count
WINDOW = 2.5  # metres from where on an echo turns
STANDOFF = 0.15  # metres that a gap is wider than the body on each side
AHEAD = 0.6  # seconds of flight that must be free


@dataclass
class Straight:
    """Towards the aim."""

    flight: Flight
    sensors: tuple[str, ...] = ()

    def act(self, told: dict[str, np.ndarray]) -> np.ndarray:
        return steer(
            self.flight, told, azimuth_of(told["odometry"]), np.ones(len(told["odometry"]))
        )


@dataclass
class Gap:
    """Fly towards the widest gap between ranges; rays that are not level enough are left out.

    way, pace : (N,) radians to the left and share of the speed, of the last decision.
    """

    flight: Flight
    lidar: LidarSense
    sensors: tuple[str, ...] = ("lidar",)

    def __post_init__(self) -> None:
        level, angle = self.lidar.level
        if not len(level):
            raise SpecError("lidar", "has no level rays; the gap policy needs some")
        order = np.argsort(angle)
        self._rays, self._angle = level[order], angle[order]
        self._off = np.abs(wrapped(self._angle[:, None] - self._angle))  # (R, R)
        self.way = self.pace = np.zeros(0)

    def act(self, told: dict[str, np.ndarray]) -> np.ndarray:
        flight, seen = self.flight, told["lidar"][:, self._rays]
        if len(self.way) != len(seen):
            self.way = np.zeros(len(seen))
        # What is seen there grows by the body: within this angle of it no way goes on beyond it.
        body = flight.radius + STANDOFF
        wide = np.arcsin(np.minimum(body / np.maximum(seen, body), 1.0))
        wide += np.pi / len(self._angle)
        most = self.lidar.scanner.max_range
        blocks = np.where(seen < most, seen, np.inf)
        free = np.full(seen.shape, np.inf)
        rays = np.arange(len(self._angle))
        for shift in range(-(len(rays) // 2), len(rays) // 2 + 1):
            off = self._off[rays, (rays + shift) % len(rays)]
            hides = np.roll(wide, -shift, axis=1) >= off
            np.minimum(free, np.where(hides, np.roll(blocks, -shift, axis=1), np.inf), out=free)
        aim = azimuth_of(told["odometry"])
        speed = np.hypot(*told["odometry"][:, 3:5].T)
        wanted = np.minimum(AHEAD * speed + 1.0, 0.9 * most)[:, None]
        to_aim = np.abs(wrapped(self._angle - aim[:, None]))
        turn = np.abs(self._angle)
        again = np.abs(wrapped(self._angle - self.way[:, None]))
        short = np.maximum(0.0, 1.0 - free / wanted)
        cost = to_aim + 0.6 * turn + 0.3 * again + 12.0 * short
        best = cost.argmin(axis=1)
        way = self._angle[best]
        ahead = np.minimum(free[np.arange(len(best)), best], 1e6)
        pace = np.clip(ahead / (2.0 * wanted[:, 0]), 0.25, 1.0) * np.clip(
            1.4 - np.abs(way), 0.35, 1.0
        )
        self.way, self.pace = way, pace
        return steer(flight, told, way, pace)


@dataclass
class EchoPolicy:
    """Steer by the echoes at two ears."""

    flight: Flight
    ears: EarSense
    sensors: tuple[str, ...] = ("sonar",)

    def __post_init__(self) -> None:
        if self.ears.sonar.ears < 2:
            raise SpecError("sonar", "has one ear; the echo policy compares two")
        self._side = np.zeros(0)

    def act(self, told: dict[str, np.ndarray]) -> np.ndarray:
        first, level = self.cues(told["sonar"])
        if len(self._side) != len(first):
            self._side = np.ones(len(first))
        heard = first < WINDOW
        difference = level[:, 0] - level[:, -1]  # dB, left over right
        self._side = np.where(np.abs(difference) > 0.5, np.sign(difference), self._side)
        near = np.clip(1.0 - first / WINDOW, 0.0, 1.0)
        away = -self._side * np.minimum(0.5 + np.abs(difference) / 6.0, 1.0) * np.pi / 2
        aim = np.clip(azimuth_of(told["odometry"]), -np.pi / 2, np.pi / 2)
        way = np.where(heard, near * away + (1 - near) * aim, aim)
        return steer(
            self.flight, told, way, np.where(heard, np.clip(first / WINDOW, 0.2, 1.0), 1.0)
        )

    def cues(self, sonar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) metres to what echoes first, ``inf`` for none, and (N, E) dB of its first millisecond."""
        settings, speed = self.ears.sonar, self.ears.air.speed()
        if self.ears.heard == "waveforms":
            power, step = sonar**2, 1.0 / settings.sample_rate
        else:
            power = np.where(sonar > 0, power_of(sonar), 0.0).sum(axis=2)
            step = self.ears.samples / sonar.shape[-1] / settings.sample_rate
        loud = power.max(axis=1)  # (N, T), either ear
        starts = loud > np.maximum(1e-3 * loud.max(axis=1, keepdims=True), 1e-11)
        at = starts.argmax(axis=1)
        first = np.where(starts.any(axis=1), at * step * speed / 2.0, np.inf)
        last = at + max(1, round(FIRST / step))
        inside = (np.arange(power.shape[-1]) >= at[:, None]) & (
            np.arange(power.shape[-1]) < last[:, None]
        )
        energy = (power * inside[:, None]).sum(axis=-1)
        return first, 10.0 * np.log10(np.maximum(energy, 1e-30))


def steer(
    flight: Flight, told: dict[str, np.ndarray], way: np.ndarray, pace: np.ndarray
) -> np.ndarray:
    """(N, A) the action of any body that goes to a direction from its nose (N,), at a share of its speed
    (N,), and towards the aim's height.
    """
    own = told["odometry"]
    turn_rate = np.deg2rad(flight.turn_rate_deg)
    speed = own[:, 3]
    rise = np.clip(own[:, 2], -flight.climb, flight.climb) / max(flight.climb, 1e-9)
    action = np.zeros((len(own), len(ACTIONS[flight.body])))
    if flight.body == "bird":
        action[:, 0] = np.clip(
            flight.speed * np.tan(np.clip(way, -1.5, 1.5)) / flight.sideways, -1, 1
        )
        return action
    if flight.body in ("bat", "planar"):
        turn_rate = np.minimum(turn_rate, flight.acceleration / np.maximum(np.abs(speed), 1e-9))
    turn = np.clip(way / (turn_rate * flight.step * 2.0), -1.0, 1.0)
    if flight.body == "planar":
        action[:, 0] = turn
    elif flight.body == "bat":
        faster = pace * flight.speed - speed
        action = np.stack([turn, rise, faster / (flight.acceleration * flight.step)], axis=1)
    else:
        faster, drift = pace * flight.speed - speed, own[:, 4]
        action = np.stack([faster, 1.5 * drift / flight.speed, turn, rise], axis=1)
    return np.clip(action, -1.0, 1.0)


def policy_of(
    name: str, flight: Flight, lidar: LidarSense | None, ears: EarSense | None, trained: Any = None
) -> Any:
    """A policy by its name, for flyers that carry this.

    Raises
    ------
    SpecError : there is none of that name; it needs a sensor that is not there.
    """
    if name not in NAMES:
        raise unknown("policy", name, NAMES)
    if name == "straight":
        return Straight(flight)
    if name == "gap" and lidar is not None:
        return Gap(flight, lidar)
    if name == "echo" and ears is not None:
        return EchoPolicy(flight, ears)
    if name == "trained" and trained is not None and lidar is not None:
        return trained
    needs = {"gap": "a lidar", "echo": "a sonar"}
    lacks = needs.get(name, "a lidar and the file of what was learnt")
    raise SpecError("policy", f'"{name}" needs {lacks}')


# A small policy that learns, by the cross-entropy method: numpy alone, minutes on two cores.
#
# What is felt, and the aim's direction, go through one hidden layer to a direction and a pace, which
# ``policies.steer`` flies. By LiDAR it is the nearest thing in each of ``SECTORS`` sectors of its level rays;
# by ear, in each of ``GATES`` spans of range, how much louder the left ear hears than the right, and how
# loud it is; and how loud the loudest is. Weights θ are drawn
# from a normal distribution N(μ, σ²), each drawing flies the same starts, and μ, σ become those of the best
# (Rubinstein 1999; with noise that fades, Szita & Lőrincz 2006, Neural Comput. 18, 2936).


SECTORS, GATES, HIDDEN = 15, 7, 8
INPUTS = SECTORS + 2
SIZE = HIDDEN * (INPUTS + 1) + 2 * (HIDDEN + 1)
NEAR = 4.0  # metres: the scale on which nearness is felt
QUIET, LOUDER, ASIDE = (
    -60.0,
    20.0,
    10.0,
)  # dB: felt as 0; felt as 1 by both ears; by their difference


@dataclass
class Trained:
    """A policy of weights (SIZE,), or (N, SIZE) one for each flyer."""

    flight: Flight
    sense: LidarSense | EarSense
    weights: np.ndarray

    def __post_init__(self) -> None:
        self.sensors = ("lidar",) if isinstance(self.sense, LidarSense) else ("sonar",)
        if isinstance(self.sense, EarSense):
            if self.sense.heard != "cochleagram" or self.sense.sonar.ears != 2:
                raise SpecError(
                    "sonar", "has no cochleagrams of two ears; a trained policy needs them"
                )
            return
        level, angle = self.sense.level
        front = np.abs(angle) <= np.pi * 0.75
        sector = np.floor((angle[front] / (np.pi * 0.75) + 1) / 2 * SECTORS).astype(int)
        sector = np.clip(sector, 0, SECTORS - 1)
        order = np.argsort(sector, kind="stable")
        self._rays, sector = level[front][order], sector[order]
        self._first = np.searchsorted(sector, np.arange(SECTORS))
        if len(np.unique(sector)) < SECTORS:
            raise SpecError(
                "lidar", f"has too few level rays; a trained policy needs one in each of {SECTORS}"
            )

    def felt(self, told: dict[str, np.ndarray]) -> np.ndarray:
        """(N, SECTORS) what goes into the hidden layer beside the aim."""
        if isinstance(self.sense, LidarSense):
            seen = np.minimum.reduceat(told["lidar"][:, self._rays], self._first, axis=1)
            return np.exp(-seen / NEAR)
        power = power_of(told["sonar"])
        first = np.linspace(0, BINS, GATES, endpoint=False).astype(np.int64)
        heard = 10.0 * np.log10(np.add.reduceat(power.mean(axis=2), first, axis=2))  # (N, 2, GATES)
        left, right = heard[:, 0], heard[:, 1]
        loud = ((left + right) / 2 - QUIET) / LOUDER
        return np.column_stack([(left - right) / ASIDE, loud, loud.max(axis=1)])

    def act(self, told: dict[str, np.ndarray]) -> np.ndarray:
        """(N, A) actions for what N flyers sense."""
        way, pace = decided(self.weights, self.felt(told), azimuth_of(told["odometry"]))
        return steer(self.flight, told, way, pace)

    def save(self, path: Path) -> None:
        """Write the weights."""
        write_npz(path, {"weights": self.weights}, {"weights": "1"})


def decided(
    weights: np.ndarray, felt: np.ndarray, aim: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) way to the left, radians, and (N,) share of the speed that weights (SIZE,) or (N, SIZE) decide on.

    felt : (N, SECTORS), see ``Trained``. aim : (N,) radians to the left.
    """
    felt = np.column_stack([felt, np.sin(aim), np.cos(aim)])
    weights = np.atleast_2d(weights)
    split = HIDDEN * (INPUTS + 1)
    first = weights[:, :split].reshape(-1, HIDDEN, INPUTS + 1)
    last = weights[:, split:].reshape(-1, 2, HIDDEN + 1)
    inner = np.tanh(np.einsum("nhi,ni->nh", first[..., :-1], felt) + first[..., -1])
    out = np.einsum("noh,nh->no", last[..., :-1], inner) + last[..., -1]
    way = wrapped(0.5 * aim + 1.5 * np.tanh(column(out, 0)))
    pace = 0.2 + 0.8 / (1.0 + np.exp(-np.clip(out[:, 1], -30, 30)))
    return way, pace


@guarded("a trained policy")
def load(path: Path, flight: Flight, sense: LidarSense | EarSense) -> Trained:
    """A policy that was trained before.

    Raises
    ------
    SpecError : the file is none of ours.
    """
    with np.load(path, allow_pickle=False) as file:
        weights = np.array(file["weights"], dtype=np.float64)
    if weights.shape != (SIZE,) or not np.isfinite(weights).all():
        raise SpecError(str(path), f"has weights {weights.shape}, not ({SIZE},); train anew")
    return Trained(flight, sense, weights)
