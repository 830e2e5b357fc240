"""Makes the pictures of trees in docs/pictures.

    python packaging/make_pictures.py [--out DIR] [--share 0.3] [--samples 48] [NAME ...]

rioja-pines and undergrowth are forests at a walker's eye: a scene is grown as its file says, without its
sensors, and hills stand at the horizon for the picture alone. The others are what commands of the product
draw: demo (the demo's preview), close-ups (``species --close-ups``), measured-species and species
(``species --sheet``), asset-library (``assets --sheet``). Without a NAME all are made, in about ten minutes;
--share shrinks the first two for a trial.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from PIL import Image

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from forest_addon import spec
from forest_addon.blender.files.export import empty_file
from forest_addon.blender.scene.forest import build
from forest_addon.blender.show.preview import (
    EYE,
    SUN,
    grow_around,
    lay_horizon,
    render,
    set_stage,
    walkers_view,
)
from forest_addon.site import ForestSite
from headless.cli import main as headless
from headless.command import read_scene
from headless.commands.species import show_closeups

ROOT = Path(__file__).resolve().parents[1]
MEASURED = (
    *("european-beech", "european-ash", "pedunculate-oak", "norway-maple", "silver-birch"),
    *("malus-domestica", "scots-pine", "norway-spruce", "silver-fir", "douglas-fir"),
    "european-larch",
)
EXHIBITED = (
    *("scots-pine", "norway-spruce", "silver-birch", "european-beech", "maple", "spruce"),
    *("hazelnut", "orchard-apple", "honda-willow", "fern", "grass", "bilberry"),
)
TREE = 3.0  # metres of height, from which on a plant is in a walker's way
GAP = 8  # pixels between pictures side by side


@dataclass(frozen=True)
class Shot:
    """View of a walker who stands where most stems are seen.

    up : metres that the eye rises, a metre forward. sun : its height, and how far to the right of straight
    ahead it is, degrees. golden : the sun is low.
    """

    scene: str
    size: tuple[int, int]
    up: float
    lens: float
    sun: tuple[float, float]
    golden: bool
    exposure: float


WIDE = (1000, 562)
SHOTS = {
    "rioja-pines": Shot(
        *("assets/scenes/rioja-pines.toml", WIDE, 0.20, 24.0, (22.0, 120.0), True, 0.6)
    ),
    "undergrowth": Shot(
        *("packaging/pictures/undergrowth.toml", WIDE, 0.05, 25.0, (38.0, 105.0), False, 1.1)
    ),
}


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Render the pictures of trees.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--share", type=float, default=1.0, help="of the size, for a trial")
    parser.add_argument("--samples", type=int, default=32, help="a pixel")
    parser.add_argument("names", nargs="*", help="of pictures; all unless given")
    given = parser.parse_args(arguments)
    for name in given.names or (*SHOTS, *DRAWN):
        before = time.process_time()
        path = given.out / f"{name}.jpg"
        if name in SHOTS:
            take(SHOTS[name], path, given.share, given.samples)
        else:
            with tempfile.TemporaryDirectory() as folder:
                DRAWN[name](Path(folder), path)
        print(f"{name}: {time.process_time() - before:.0f} CPU s", flush=True)


def take(shot: Shot, path: Path, share: float, samples: int) -> None:
    """Grow the forest of a shot and render it to a JPEG."""
    file = ROOT / shot.scene
    settings = read_scene(file, None).changed(sensors=())
    empty_file()
    site = ForestSite.read(settings, file.parent)
    forest = site.grow()
    scene = bpy.context.scene
    build(scene, site.scene, forest, as_assets=False)
    size = (round(shot.size[0] * share), round(shot.size[1] * share))
    set_stage(scene, size, golden=shot.golden)
    field = settings.forest
    middle, reach = np.array(field.origin) + np.array(field.size) / 2, max(field.size) / 2
    lay_horizon(scene, middle, reach, field.terrain.base)
    place, tall = forest.stand.position[:, :2], forest.heights()
    eye, turn = walkers_view(place[tall > TREE], tall[tall > TREE], middle, reach)
    grow_around(scene, eye, turn, site.ground.height)
    foot = float(site.ground.height(eye[None])[0])
    _aim(scene, shot, np.array([*eye, foot + EYE]), turn)
    rendered = path.with_suffix(".trial.png")
    render(scene, spec.Output(preview_samples=samples), rendered, exposure=shot.exposure)
    _keep([rendered], path)
    rendered.unlink()


def _aim(scene: bpy.types.Scene, shot: Shot, eye: np.ndarray, turn: float) -> None:
    """Put camera and sun where the shot has them."""
    camera = scene.camera
    camera.location, camera.data.lens, camera.data.clip_start = eye, shot.lens, 0.05
    way = Vector((math.cos(turn), math.sin(turn), shot.up))
    camera.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()
    height, side = (math.radians(angle) for angle in shot.sun)
    flat, side = math.cos(height), turn - side
    light = Vector((flat * math.cos(side), flat * math.sin(side), math.sin(height)))
    scene.objects[SUN].rotation_euler = light.to_track_quat("Z", "Y").to_euler()


def _demo(folder: Path, path: Path) -> None:
    headless(["demo", "--out", str(folder)])
    _keep([folder / "preview.png"], path, 1000)


def _closeups(folder: Path, path: Path) -> None:
    show_closeups((), folder, 1, size=(480, 600), samples=32)
    _keep([next(folder.glob(f"{kind}-*.png")) for kind in ("fork", "bark", "twig")], path)


def _sheet(names: tuple[str, ...], pixels: int, wide: int) -> Callable[[Path, Path], None]:
    """Make what draws the sheet of some species, or of all, a picture so many pixels wide."""

    def draw(folder: Path, path: Path) -> None:
        sheet = folder / "sheet.png"
        headless(["species", *names, "--sheet", str(sheet), "--pixels", str(pixels)])
        _keep([sheet], path, wide)

    return draw


def _library(folder: Path, path: Path) -> None:
    words = ["assets", *EXHIBITED, "--variants", "2", "--out", str(folder / "library")]
    headless([*words, "--sheet", str(folder / "sheet.png")])
    _keep([folder / "sheet.png"], path, 1344)


def _keep(files: list[Path], path: Path, wide: int = 0) -> None:
    """Pictures side by side, each at most so many pixels wide, as a JPEG."""
    shown = []
    for file in files:
        with Image.open(file) as image:
            shown.append(image.convert("RGB"))
        if 0 < wide < shown[-1].width:
            high = round(shown[-1].height * wide / shown[-1].width)
            shown[-1] = shown[-1].resize((wide, high), Image.Resampling.LANCZOS)
    across = sum(image.width for image in shown) + GAP * (len(shown) - 1)
    whole = Image.new("RGB", (across, max(image.height for image in shown)), (243, 242, 238))
    left = 0
    for image in shown:
        whole.paste(image, (left, 0))
        left += image.width + GAP
    whole.save(path, quality=86, optimize=True)


DRAWN: dict[str, Callable[[Path, Path], None]] = {
    "demo": _demo,
    "close-ups": _closeups,
    "measured-species": _sheet(MEASURED, 500, 1600),
    "species": _sheet((), 220, 1020),
    "asset-library": _library,
}


if __name__ == "__main__":
    main()
