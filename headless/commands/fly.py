"""``python -m headless fly SCENE.toml``: flights through a scene by a policy.

Flights of one speed and density share forests, ``AT_ONCE`` in each, so that their rays are cast together; the
forest of a batch has the seed of its first flight.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from forest_addon.blender.files.export import empty_file, save_blend
from forest_addon.blender.scene.layout import RESULTS, part
from forest_addon.blender.show.trails import show_flights
from forest_addon.flight.flying import Track, fly, interval
from forest_addon.flight.policies import load, policy_of
from forest_addon.flight.senses import EarSense, LidarSense, lidar_of, sonar_of
from forest_addon.flight.simulation import Flyers
from forest_addon.flight.woods import FlightSurroundings, Stock
from forest_addon.formats.rosbag import BagWay, write_bag
from forest_addon.formats.table import write_csv
from forest_addon.spec import Scene, SpecError

from ..command import numbers, refuse_beyond
from ..progress import Stages, hushed
from ..report.trees import draw_flights


def listed(name: str, words: str | None) -> tuple[float, ...]:
    """Numbers above 0 that are parted by commas; none where there are no words.

    Raises
    ------
    SpecError : something else.
    """
    values = numbers(name, words) if words else ()
    for value in values:
        refuse_beyond(name, value, LEAST, MOST)
    return values


LEAST, MOST = 1e-6, 1e6  # of speeds and densities
AT_ONCE = 25
SHOWN = 100  # flights that are animated in the .blend


@dataclass(frozen=True)
class FlightCell:
    """Flights of one speed (m/s) and one density (a factor on the scene's)."""

    speed: float
    density: float
    trees: float
    tracks: list[Track]

    @property
    def arrived(self) -> int:
        """Number that came to their aim."""
        return sum(track.end == "arrived" for track in self.tracks)


def run(chosen: argparse.Namespace) -> None:
    """Fly so many times at each speed and density and write everything into a folder.

    Raises
    ------
    SpecError : the scene, or a policy, cannot be used.
    OSError : a file could not be written.
    """
    speeds = listed("--speeds", chosen.speeds)
    densities = listed("--densities", chosen.densities) or (1.0,)
    out, policy, episodes = chosen.out, chosen.policy, chosen.episodes
    with hushed():
        empty_file()
        stock = Stock(chosen.scene, chosen.scene.resolve().parent)
    out.mkdir(parents=True, exist_ok=True)
    whole, cells, first, stages = stock.settings, [], None, Stages(quiet=False)
    print(f"{whole.name}: {policy}, {episodes} flights at each speed and density")
    if whole.wind.speed > 0:
        blows = f"a wind of {whole.wind.speed:g} m/s at the tops"
        print(f"  {blows} carries flyers, with its gusts; trees sway as they sense and touch them")
    for density in densities:
        stock.settings = thinned(whole, density)
        for speed in speeds or (whole.flight.speed,):
            cell, world = _cell(stock, chosen, speed, density)
            cells.append(cell)
            if first is None or (density == 1.0 and speed == whole.flight.speed):
                first = (cell, world)
            low, high = interval(cell.arrived, episodes)
            print(
                f"  {speed:5.1f} m/s, {cell.trees:7.4f} trees/m²: {cell.arrived / episodes:4.0%} arrive "
                f"({low:.0%} to {high:.0%}), {_mean_speed(cell):.1f} m/s on the way"
            )
            for note in world.forest.notes:
                stages.warn(note)
    stock.settings = whole
    write_csv(out / "trajectories.csv", _trajectories(cells))
    rows = []
    for cell in cells:
        low, high = interval(cell.arrived, len(cell.tracks))
        rows.append(
            {
                "speed_m_s": cell.speed,
                "density": cell.density,
                "trees_per_m2": round(cell.trees, 6),
                "flights": len(cell.tracks),
                "arrived": cell.arrived,
                "crashed": sum(track.end == "crashed" for track in cell.tracks),
                "late": sum(track.end == "late" for track in cell.tracks),
                "share": round(cell.arrived / len(cell.tracks), 4),
                "from": round(low, 4),
                "to": round(high, 4),
                "mean_speed_m_s": round(_mean_speed(cell), 3),
            }
        )
    write_csv(out / "success.csv", {name: [row[name] for row in rows] for name in rows[0]})
    draw_flights(out / "flights.png", cells, *first, title=f"{whole.name}: {policy}")
    names = "trajectories.csv, success.csv, flights.png"
    if not chosen.no_blend:
        with hushed(errors=True):
            _save(out / "flights.blend", *first)
        names += ", flights.blend"
    tracks = cells[0].tracks[: chosen.bags]
    for number, track in enumerate(tracks):
        time = np.arange(len(track.position)) * track.step
        turn = Rotation.from_euler("Z", track.heading[:, None])
        write_bag(
            out / f"flight-{number:04d}.mcap",
            BagWay(time, track.position, turn, track.nearest),
            reach=lidar_of(whole).max_range,
        )
    if tracks:
        names += f", {len(tracks)} bags: flight-0000.mcap and on"
    print(f"Written to {out}: {names}")


def _trajectories(cells: Sequence[FlightCell]) -> Iterator[dict[str, list]]:
    """The table of each flight, a row a step."""
    flights = ((cell, track) for cell in cells for track in cell.tracks)
    for number, (cell, track) in enumerate(flights):
        count = len(track.position)
        same = {
            "flight": number,
            "seed": track.seed,
            "forest": track.forest,
            "speed_m_s": cell.speed,
            "density": cell.density,
            "end": track.end,
        }
        places = zip("xyz", np.round(track.position.T, 4).tolist(), strict=True)
        yield {
            **{name: [value] * count for name, value in same.items()},
            "time_s": np.round(np.arange(count) * track.step, 6).tolist(),
            **{f"{axis}_m": along for axis, along in places},
            "heading_rad": np.round(track.heading, 5).tolist(),
            "nearest_m": np.round(track.nearest, 3).tolist(),
        }


def thinned(settings: Scene, factor: float) -> Scene:
    """The scene with so many times its trees.

    Raises
    ------
    SpecError : a planting whose number of trees is not set by a number.
    """
    if factor == 1.0:
        return settings
    plantings = []
    for number, planting in enumerate(settings.plantings):
        for key in ("expected", "density"):
            value = getattr(planting, key)
            if value is not None:
                plantings.append(planting.changed(**{key: value * factor}))
                break
        else:
            raise SpecError(
                f"plantings[{number}]", "has no expected number nor density; give one to vary it"
            )
    return settings.changed(plantings=tuple(plantings))


def _cell(
    stock: Stock, chosen: argparse.Namespace, speed: float, density: float
) -> tuple[FlightCell, FlightSurroundings]:
    settings, episodes, seed = stock.settings, chosen.episodes, chosen.seed
    flight = settings.flight.changed(speed=speed, slowest=min(settings.flight.slowest, speed))
    lidar, ears = LidarSense(lidar_of(settings)), EarSense(sonar_of(settings), settings.air)
    learnt = load(chosen.trained, flight, lidar) if chosen.trained else None
    pilot = policy_of(chosen.policy, flight, lidar, ears, learnt)
    hears = "sonar" in pilot.sensors
    flyers = Flyers(
        flight, min(AT_ONCE, episodes), None if hears else lidar, ears if hears else None
    )
    tracks: list[Track] = []
    world = None
    for begin in range(0, episodes, AT_ONCE):
        some = [seed + n for n in range(begin, min(begin + AT_ONCE, episodes))]
        around = stock.surroundings(some[0])
        world = world or around
        flyers.enter(around)
        tracks += fly(flyers, pilot, some, forest=some[0])
    trees = float(sum(world.forest.stand.expected)) / world.forest.stand.area
    return FlightCell(speed, density, trees, tracks), world


def _mean_speed(cell: FlightCell) -> float:
    seconds = sum(track.seconds for track in cell.tracks)
    return sum(track.flown for track in cell.tracks) / seconds if seconds else 0.0


def _save(path: Path, cell: FlightCell, world: FlightSurroundings) -> None:
    """The first forest of a cell in Blender, with the flights through it."""
    import bpy

    world.stock.built(world.forest)
    forest = cell.tracks[0].forest
    shown_tracks = [track for track in cell.tracks if track.forest == forest][:SHOWN]
    show_flights(part(bpy.context.scene, RESULTS), shown_tracks)
    save_blend(path)
