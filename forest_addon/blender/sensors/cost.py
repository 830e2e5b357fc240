"""What a run will cost, before it begins: how much it sends, how long that takes, how much it keeps.

The time is a guess until sensors of a kind have run once in this process; then their own pace counts, which
is that of this machine and this scene.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...sensing.lidar import scanner, tractor
from ...spec import Mobile, Reverb, Scanner, Sensor, Sonar, Tractor
from .observe import Way

RAY, PING, CHANNEL = (
    2e-6,
    0.1,
    0.2,
)  # s, first guesses: a ray of Embree, a ping, a channel of a reverb
SLOWER = 15.0  # times that BVHTree takes a ray
RETURN = 300  # bytes of a point: what is computed of it, and what Blender keeps
MOST_RETURNS = 1.5  # of a pulse, as forests give them

_pace: dict[str, float] = {}  # s a unit of work, of sensors of a kind that have run


@dataclass(frozen=True)
class Cost:
    """Of one run: ``count`` pulses, pings or channels, seconds, bytes.

    work : what the time grows with: rays, pings, channels.
    """

    what: str
    count: int
    work: int
    seconds: float
    memory: int


def cost_of(sensor: Sensor, way: Way, engine: str = "embree") -> Cost:
    """What running a sensor will cost; ``way`` is where it goes (``Observer.way``).

    Raises
    ------
    SpecError : a scanner that has nowhere to go.
    """
    if isinstance(sensor, Tractor):
        count = len(tractor.fan(sensor)) * len(tractor.positions(sensor))
        return _of_rays(sensor, count, max(sensor.splits, 1) ** 2, 1.0, engine)
    if isinstance(sensor, Scanner):
        path = way if isinstance(sensor, Mobile) and not isinstance(way, list) else None
        beam = sensor.beam
        returns = min(beam.max_returns, MOST_RETURNS)
        return _of_rays(
            sensor, scanner.pattern_of(sensor, path).count, beam.subrays, returns, engine
        )
    if isinstance(sensor, Sonar):
        pings = len(way) if isinstance(way, list) else 1
        return _of("pings", sensor.kind, pings, pings, PING, 0)
    assert isinstance(sensor, Reverb)
    channels = (1 + len(sensor.sources)) * (1 + len(sensor.receivers)) * sensor.array
    return _of("channels", sensor.kind, channels, channels, CHANNEL, 0)


def note_pace(sensor: Sensor, cost: Cost, seconds: float) -> None:
    """Remember how long a run took."""
    _pace[sensor.kind] = seconds / max(cost.work, 1)


def _of_rays(sensor: Sensor, count: int, subrays: int, returns: float, engine: str) -> Cost:
    ray = RAY if engine == "embree" else SLOWER * RAY
    memory = int(count * returns) * RETURN
    return _of("pulses", sensor.kind, count, count * subrays, ray, memory)


def _of(what: str, kind: str, count: int, work: int, guess: float, memory: int) -> Cost:
    return Cost(what, count, work, work * _pace.get(kind, guess), memory)
