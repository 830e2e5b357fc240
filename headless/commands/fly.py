"""``python -m headless fly SCENE.toml``: flights through a scene by a policy."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import SpecError

from ..command import LOCK, SCENE_HELP, Command, name_of, refuse_negative, scene_file

POLICIES = ("straight", "gap", "echo", "trained")


class FlyCommand(Command):
    name = "fly"
    help = "fly a policy through a scene's forests"
    description = (
        "Fly through forests of a scene by what a LiDAR or two ears tell; write every way, success against "
        "speed and density, a picture, and a .blend in which the flights are animated."
    )
    epilog = """\
examples:
  python -m headless fly assets/scenes/flight-poisson.toml --policy gap --episodes 100
  python -m headless fly assets/scenes/flight-poisson.toml --speeds 3,5,8 --densities 0.5,1,2
  python -m headless fly assets/scenes/flight-hedge.toml --policy echo --episodes 20"""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("scene", type=scene_file, metavar="SCENE", help=SCENE_HELP)
        parser.add_argument("--policy", choices=POLICIES, default="gap", help="default gap")
        parser.add_argument(
            "--episodes", type=int, default=100, help="flights at each speed and density (100)"
        )
        parser.add_argument("--speeds", metavar="LIST", help="m/s; default: the scene's")
        parser.add_argument("--densities", metavar="LIST", help="times the scene's trees (1)")
        parser.add_argument(
            "--trained", type=Path, metavar="FILE", help="what `flight learn` wrote"
        )
        parser.add_argument("--seed", type=int, default=0, help="of the first flight (default 0)")
        parser.add_argument("--no-blend", action="store_true", help="write no .blend")
        parser.add_argument(
            "--bags", type=int, default=0, metavar="N", help="ROS 2 bags of the first N flights"
        )
        parser.add_argument("--out", type=Path, metavar="DIR", help="default out/fly-SCENE")

    def output(self, chosen: argparse.Namespace) -> Path:
        return chosen.out or Path("out") / f"fly-{name_of(chosen.scene)}"

    def lock(self, chosen: argparse.Namespace) -> Path:
        return chosen.out / LOCK

    def is_whole(self, chosen: argparse.Namespace) -> bool:
        return True

    def run(self, chosen: argparse.Namespace) -> None:
        refuse_negative(chosen.seed)
        if chosen.bags < 0:
            raise SpecError("--bags", f"{chosen.bags} is out of range; use at least 0")
        if chosen.episodes < 1:
            raise SpecError("--episodes", f"{chosen.episodes} is out of range; use at least 1")
        speeds = listed("--speeds", chosen.speeds)
        densities = listed("--densities", chosen.densities) or (1.0,)
        from .work.fly import fly_scene

        fly_scene(
            chosen.scene,
            chosen.out,
            chosen.policy,
            chosen.episodes,
            chosen.seed,
            speeds,
            densities,
            chosen.trained,
            not chosen.no_blend,
            bags=chosen.bags,
        )


def listed(name: str, words: str | None) -> tuple[float, ...]:
    """Numbers above 0 that are parted by commas.

    Raises
    ------
    SpecError : something else.
    """
    try:
        values = tuple(float(word) for word in (words or "").split(",") if word)
    except ValueError:
        values = (-1.0,)
    if any(not 0 < value < 1e6 for value in values):
        raise SpecError(name, f'"{words}" must be numbers above 0, parted by commas')
    return values
