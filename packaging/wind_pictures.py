"""Makes the pictures of the wind in docs/pictures.

    python packaging/wind_pictures.py [--out DIR] [--speed 9] [--samples 16] [NAME ...]

wind-frames: the demo at rest and at three moments of a wind, as *Show Wind* has it, and what moved between
two of them. wind-scan: a slice of one tripod's scan of the demo, still and in the wind. Without a NAME both
are made.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from PIL import Image, ImageChops, ImageDraw

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from forest_addon import api as forest, spec
from forest_addon.blender.show.preview import render, set_stage
from forest_addon.blender.show.wind import show_wind
from forest_addon.drawing.figures import blank_figure, save_figure
from forest_addon.drawing.palette import FAINT, INK
from forest_addon.stand.wind import KNOTS, sway_of

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / "assets" / "scenes" / "demo.toml"
SIZE = (520, 400)
MOMENTS = (1, 37, 49)  # frames at 24 a second: the beginning, 1.5 and 2 s
LOUD, DIFFERENT = 3.0, 24  # times that differences are shown brighter; of 255, what differs
EDGE, LINE = 14, 22  # pixels around what differs, and for words
SLICE = 0.75  # m to each side of a line through the tripod
FIELD = (-14.0, 14.0)  # m from the tripod


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Draw the demo in the wind.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--speed", type=float, default=9.0, help="m/s at the trees' tops")
    parser.add_argument("--samples", type=int, default=16, help="a pixel")
    parser.add_argument("names", nargs="*", help="of pictures; all unless given")
    given = parser.parse_args(arguments)
    names = given.names or ["wind-scan", "wind-frames"]
    if "wind-scan" in names:
        draw_scans(given.speed, given.out / "wind-scan.png")
    if "wind-frames" in names:
        draw_frames(given.speed, given.samples, given.out / "wind-frames.jpg")


def draw_scans(speed: float, path: Path) -> None:
    """Draw a slice of the demo's forest, scanned still and in a wind of a speed in m/s."""
    tripod = forest.Terrestrial(position=(14.5, 14.5, 1.6), angle_step_deg=0.1)
    settings = forest.read(DEMO)
    figure = blank_figure((10.0, 3.0))
    for number, wind in enumerate((0.0, speed)):
        world = forest.build(settings.changed(wind=forest.Wind(speed=wind)))
        cloud = world.scan(tripod).found
        axes = figure.add_subplot(1, 2, number + 1)
        x, y, z = cloud.position.T - np.array([[14.5], [14.5], [0.0]])
        rows = (np.abs(y) < SLICE) & (x > FIELD[0]) & (x < FIELD[1])
        away = np.zeros(len(x))
        if cloud.rest is not None:
            away = 100 * np.linalg.norm(cloud.position - cloud.rest, axis=1)
        drawn = axes.scatter(
            x[rows], z[rows], c=away[rows], s=0.4, lw=0, cmap="viridis", vmin=0, vmax=60
        )
        axes.set_aspect("equal")
        axes.grid(color=FAINT, lw=0.5)
        axes.set_xlabel("from the tripod, m")
        axes.set_ylabel("height, m")
        axes.set_title(f"{wind:g} m/s at the tops" if wind else "still", fontsize=10, color=INK)
    bar = figure.colorbar(drawn, ax=figure.axes, fraction=0.02, pad=0.02)
    bar.set_label("off its place at rest, cm")
    save_figure(figure, path)


def draw_frames(speed: float, samples: int, path: Path) -> None:
    """Render the demo at rest and at moments of a wind of a speed in m/s, side by side."""
    settings = forest.read(DEMO).changed(wind=forest.Wind(speed=speed), sensors=())
    world, scene = forest.build(settings), bpy.context.scene
    set_stage(scene, SIZE)
    shown = []
    with tempfile.TemporaryDirectory() as folder:
        for frame in (0, *MOMENTS):
            if frame == MOMENTS[0]:
                scene.frame_start, scene.frame_end = 1, max(MOMENTS)
                show_wind(scene, sway_of(world.forest, settings.wind, settings.seed), KNOTS)
            scene.frame_set(max(frame, 1))
            file = Path(folder) / f"{frame}.png"
            render(scene, spec.Output(preview_samples=samples), file)
            with Image.open(file) as image:
                words = f"{(frame - 1) / 24:.1f} s, {speed:g} m/s" if frame else "still"
                shown.append((words, image.convert("RGB")))
    _sheet(shown).save(path, quality=86, optimize=True)


def _sheet(shown: list[tuple[str, Image.Image]]) -> Image.Image:
    """Pictures with their words, and what differs between the first and the third and the last two, three a
    row, cut
    to where anything differs."""
    pairs = (shown[0], shown[2]), (shown[2], shown[3])
    apart = [ImageChops.difference(one[1], other[1]) for one, other in pairs]
    box = apart[0].point(lambda v: 255 * (v > DIFFERENT)).getbbox()
    cut = (max(0, box[0] - EDGE), max(0, box[1] - EDGE), box[2] + EDGE, box[3] + EDGE)
    for (one, other), image in zip(pairs, apart, strict=True):
        words = f"difference: {one[0]} and {other[0]}"
        shown = [*shown, (words, image.point(lambda v: min(255, LOUD * v)))]
    wide, high = cut[2] - cut[0], cut[3] - cut[1]
    whole = Image.new("RGB", (3 * wide, 2 * (high + LINE)), (243, 242, 238))
    pen = ImageDraw.Draw(whole)
    for number, (words, image) in enumerate(shown):
        left, top = number % 3 * wide, number // 3 * (high + LINE)
        pen.text((left + 6, top + 4), words, fill=(40, 40, 40))
        whole.paste(image.crop(cut), (left, top + LINE))
    return whole


if __name__ == "__main__":
    main()
