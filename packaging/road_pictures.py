"""Put photographs of the newcomer's road (``python tests/gui/run.py road``) into docs/pictures, smaller."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
TAKEN, KEPT = ROOT / "out" / "gui" / "road", ROOT / "docs" / "pictures"
WIDE = 1000  # pixels
STEPS = {
    "installed": "install",
    "a-first-forest": "forest",
    "a-tree-of-my-own": "tree",
    "a-sensor-of-my-own": "sensor",
    "the-cloud-is-exported": "export",
    "the-file-reopened": "reopened",
}


def main() -> None:
    """Convert each step's photograph."""
    for step, name in STEPS.items():
        picture = Image.open(next(TAKEN.glob(f"*-{step}.png"))).convert("RGB")
        small = picture.resize((WIDE, round(WIDE * picture.height / picture.width)), Image.LANCZOS)
        small.save(KEPT / f"road-{name}.jpg", quality=78, optimize=True)


if __name__ == "__main__":
    main()
