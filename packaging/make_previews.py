"""Makes assets/previews/*.jpg, the pictures of the gallery: about 2 CPU minutes with Blender as a module.

    python packaging/make_previews.py [--out DIR] [NAME ...]

Each forest of ``ui.forest.gallery`` is begun as *File > New > Forest* does, grown, lit, and rendered by
Cycles at 256 pixels with few samples; a file is at most 15 kB.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from forest_addon import ui
from forest_addon.site import ForestSite
from forest_addon.ui.forest.start import GALLERY, PREVIEWS
from headless.command import read_scene

ROOT = Path(__file__).resolve().parents[1]

SIDE, SAMPLES, LARGEST = 256, 24, 15_000  # pixels, a pixel, bytes
AROUND, REACH = 60.0, 70.0  # metres from the field to the plain; as far as grass grows
NEARER = 1.9  # a small picture shows some trees well rather than all
FRAMED = {"simlidar-orchard": 3.6, "hedge-bat": 3.6}  # rows are low and far: nearer still
QUALITIES = (85, 75, 65, 50)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Render the pictures of the gallery.")
    parser.add_argument("--out", type=Path, default=PREVIEWS, help="folder to write to")
    parser.add_argument("names", nargs="*", help="of presets; all unless given")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    ui.register()
    try:
        for preset in GALLERY:
            if not given.names or preset in given.names:
                path = given.out / f"{preset}.jpg"
                take_picture(preset, path)
                print(f"{path}: {path.stat().st_size / 1e3:.1f} kB", flush=True)
    finally:
        ui.unregister()


def take_picture(preset: str, path: Path) -> None:
    """Begin a file with a preset and render what its camera sees to a JPEG."""
    from forest_addon.blender.show.preview import LAWN, grow_around, lay_horizon, set_stage

    bpy.ops.forest.new(preset=preset)
    scene = bpy.context.scene
    set_stage(scene, (SIDE, SIDE), None, golden=True)
    file = ROOT / "assets" / "scenes" / f"{preset}.toml"
    site = ForestSite.read(read_scene(file, None), file.parent)
    field = site.scene.forest
    middle = np.array(field.origin) + np.array(field.size) / 2
    lay_horizon(scene, middle, max(field.size) / 2 + AROUND, field.terrain.base)
    for thing in scene.objects:
        thing.hide_render |= thing.name.startswith(
            LAWN
        )  # the plain of the horizon is there instead
    bpy.context.view_layer.update()  # until then the camera does not say where it looks
    eye = np.array(scene.camera.location[:2])
    way = scene.camera.matrix_world.to_quaternion() @ Vector((0.0, 0.0, -1.0))
    grow_around(scene, eye, math.atan2(way.y, way.x), site.ground.height, REACH)
    scene.camera.data.lens *= FRAMED.get(preset, NEARER)
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", SAMPLES, True
    scene.cycles.max_bounces, scene.cycles.seed = 4, 0
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "JPEG"
    scene.view_settings.view_transform, scene.view_settings.exposure = "AgX", 0.9
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.render.filepath = str(path)
    bpy.ops.render.render()
    picture = bpy.data.images["Render Result"]
    for quality in QUALITIES:
        scene.render.image_settings.quality = quality
        picture.save_render(str(path), scene=scene)
        if path.stat().st_size <= LARGEST:
            return
    raise SystemExit(f"{path} is larger than {LARGEST} bytes")


if __name__ == "__main__":
    main()
