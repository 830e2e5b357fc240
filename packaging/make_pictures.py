"""Makes docs/pictures/rioja-pines.jpg: a forest at a walker's eye, in the last light.

    python packaging/make_pictures.py [--out DIR] [--share 0.3] [--samples 48] [NAME ...]

A scene of assets/scenes is grown as its file says, without its sensors. For the picture alone hills stand at
the horizon, and the sun is low. --share shrinks a trial. demo.jpg is the demo's preview, close-ups.jpg and
measured-species.jpg are ``headless species --close-ups`` and ``--sheet``.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from forest_addon import spec
from forest_addon.blender.files.opening import empty_file
from forest_addon.blender.scene.forest import build
from forest_addon.blender.show.horizon import lay_horizon
from forest_addon.blender.show.preview import SUN, render, set_stage
from forest_addon.site import ForestSite
from headless.command import read_scene

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Shot:
    """Where a walker stands and looks, metres; the sun's height and side, degrees."""

    scene: str
    size: tuple[int, int]
    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    lens: float
    sun: tuple[float, float]


SHOTS = {
    "rioja-pines": Shot(
        "rioja-pines", (1280, 720), (-13.0, -14.5, 1.65), (3.0, 6.0, 5.4), 24.0, (15.0, 170.0)
    ),
}


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Render the pictures of the documentation.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--share", type=float, default=1.0, help="of the size, for a trial")
    parser.add_argument("--samples", type=int, default=48, help="a pixel")
    parser.add_argument("names", nargs="*", help="of pictures; all unless given")
    given = parser.parse_args(arguments)
    for name in given.names or SHOTS:
        before = time.process_time()
        take(SHOTS[name], given.out / f"{name}.jpg", given.share, given.samples)
        print(f"{name}: {time.process_time() - before:.0f} CPU s", flush=True)


def take(shot: Shot, path: Path, share: float, samples: int) -> None:
    """Grow the forest of a shot and render it to a JPEG."""
    from PIL import Image

    file = ROOT / "assets" / "scenes" / f"{shot.scene}.toml"
    settings = read_scene(file, None)
    settings = settings.changed(sensors=())
    empty_file()
    forest = ForestSite.read(settings, file.parent).grow()
    scene = bpy.context.scene
    build(scene, settings, forest, as_assets=False)
    set_stage(scene, (round(shot.size[0] * share), round(shot.size[1] * share)), golden=True)
    field = settings.forest
    middle = np.array(field.origin) + np.array(field.size) / 2
    lay_horizon(scene, middle, max(field.size) / 2, field.terrain.base)
    _aim(scene, shot)
    rendered = path.with_suffix(".trial.png")
    render(scene, spec.Output(preview_samples=samples), rendered, exposure=0.8)
    with Image.open(rendered) as image:
        image.convert("RGB").save(path, quality=88, optimize=True)
    rendered.unlink()


def _aim(scene: bpy.types.Scene, shot: Shot) -> None:
    """Put camera and sun where the shot has them."""
    camera, sun = scene.camera, scene.objects[SUN]
    way = Vector(shot.target) - Vector(shot.eye)
    camera.location, camera.data.lens = shot.eye, shot.lens
    camera.data.clip_start = 0.05
    camera.rotation_euler = way.to_track_quat("-Z", "Y").to_euler()
    height, side = (math.radians(angle) for angle in shot.sun)
    light = -Vector(
        (math.cos(height) * math.cos(side), math.cos(height) * math.sin(side), math.sin(height))
    )
    sun.rotation_euler = light.to_track_quat("-Z", "Y").to_euler()


if __name__ == "__main__":
    main()
