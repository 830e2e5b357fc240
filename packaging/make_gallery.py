"""Makes docs/gallery.md and its pictures: each scene file of docs/gallery, run, with its picture above it.

    python packaging/make_gallery.py [NAME ...]

A scene with a sensor shows what the sensor found, any other the forest. The first line of a file is said
below its picture. Without a NAME all pictures are made, in some four CPU minutes; the page is always whole.
"""

from __future__ import annotations

import sys
import tempfile
import tomllib
from pathlib import Path

from PIL import Image

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from headless.cli import main as headless

DOCS = Path(__file__).resolve().parents[1] / "docs"
WIDTH, QUALITY = 800, 75  # pixels; of JPEG
HEAD = """\
# Gallery

Twelve pictures, each with the whole scene file that it comes from. Copy one to `my.toml` and run it:
`python -m headless run my.toml`. `python packaging/make_gallery.py` makes this page.
"""
# From above a field, from among its trees; then what sensors find.
ORDER = (
    *("beeches", "autumn", "winter", "plantation", "pines", "clearing"),
    *("tripod", "drone", "orchard", "bat", "noise", "clap"),
)


def main(names: list[str]) -> None:
    for name in names or ORDER:
        picture(name)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


def picture(name: str) -> None:
    """Run a scene and keep one of its pictures, as a small JPEG."""
    scene = DOCS / "gallery" / f"{name}.toml"
    sensors = tomllib.loads(scene.read_text(encoding="utf-8")).get("sensors")
    with tempfile.TemporaryDirectory() as folder:
        if headless(["run", str(scene), "--out", folder, "--quiet"]):
            raise SystemExit(f"{scene.name}: did not run")
        found = Path(folder) / f"{sensors[0]['name'] if sensors else 'preview'}.png"
        with Image.open(found) as image:
            small = image.convert("RGB")
            small.thumbnail((WIDTH, WIDTH))
            small.save(DOCS / "pictures" / f"gallery-{name}.jpg", quality=QUALITY, optimize=True)


def page() -> str:
    """The page: a title, a picture, words and a scene file each."""
    parts = [HEAD]
    for name in ORDER:
        text = (DOCS / "gallery" / f"{name}.toml").read_text(encoding="utf-8")
        words, scene = text.split("\n", 1)
        words = words.removeprefix("# ")
        parts += [
            f"## {name.title()}\n",
            f"![{words}](pictures/gallery-{name}.jpg)\n",
            f"{words}\n",
            f"```toml\n{scene.strip()}\n```\n",
        ]
    return "\n".join(parts)


if __name__ == "__main__":
    main(sys.argv[1:])
