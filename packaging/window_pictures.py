"""Put photographs of the window's sessions into docs/pictures, smaller.

``python tests/gui/run.py road session ten_clicks`` takes them; a picture whose step was not played stays.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
TAKEN, KEPT = ROOT / "out" / "gui", ROOT / "docs" / "pictures"


class Shot(NamedTuple):
    """A picture of the docs: where its scenario's photographs are, which step, how many pixels wide."""

    folder: str
    step: str
    wide: int


SHOTS = {
    "road-install": Shot("road", "installed", 1000),
    "road-forest": Shot("road", "a-first-forest", 1000),
    "road-tree": Shot("road", "a-tree-of-my-own", 1000),
    "road-sensor": Shot("road", "a-sensor-of-my-own", 1000),
    "road-export": Shot("road", "the-cloud-is-exported", 1000),
    "road-reopened": Shot("road", "the-file-reopened", 1000),
    "panel": Shot("session", "build-the-demo-forest", 1440),
    "panel-echo": Shot("ten_clicks", "the-echo-as-a-picture", 1440),
    "panel-cloud": Shot("ten_clicks", "down-to-the-results", 1440),
}


def main() -> None:
    """Convert each step's photograph, and say which were not taken."""
    for name, shot in SHOTS.items():
        taken = sorted((TAKEN / shot.folder).glob(f"[0-9][0-9]-{shot.step}.png"))
        if not taken:
            print(f"{name}.jpg stays as it is: no photograph of {shot.step} in {shot.folder}")
            continue
        picture = Image.open(taken[0]).convert("RGB")
        high = round(shot.wide * picture.height / picture.width)
        small = picture.resize((shot.wide, high), Image.Resampling.LANCZOS)
        small.save(KEPT / f"{name}.jpg", quality=78, optimize=True)


if __name__ == "__main__":
    main()
