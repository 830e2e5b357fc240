"""Draws docs/pictures/architecture.png from the imports of the code: ``make architecture``.

Boxes are rooms and the folders within them, captions their docstrings. An arrow says that one imports the
other, also where a function does; arrows that follow from others are left out. What is shown stands in the
picture's metadata too, where a test compares it with the code.
"""

from __future__ import annotations

import ast
import json
import textwrap
from pathlib import Path

import grimp
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "pictures" / "architecture.png"
INK, FAINT, PAPER = "#24302a", "#7d8a82", "#ffffff"
WING = "#ffffff"
SHELL, FILES, PURE, BASE = "#f3e3d0", "#dfe8ef", "#e3eedd", "#e9e6f2"
# Rows from above: height in hundredths of the picture's width; its rooms with left, width and colour.
ROWS = (
    (11, {"headless": (2, 60, SHELL), "ui": (64, 34, SHELL)}),
    (6, {"flight": (64, 34, SHELL)}),
    (6, {"api": (2, 96, SHELL)}),
    (6, {"blender": (2, 29, SHELL), "tiles": (35, 13, PURE), "results": (52, 46, FILES)}),
    (6, {"site": (2, 29, PURE), "drawing": (52, 46, FILES)}),
    (22, {"stand": (2, 27, PURE), "sensing": (31, 67, PURE)}),
    (21, {"growth": (2, 57, PURE), "acoustics": (62, 36, PURE)}),
    (6, {"formats": (2, 57, BASE), "kernels": (66, 32, BASE)}),
    (6, {"spec": (2, 40, BASE), "base": (46, 52, BASE)}),
)
GAP = 4
# Wings within their room: left, top below that of the room, width, height.
WINGS = {
    "sensing/lidar": (33, 5, 19, 6.6),
    "sensing/sonar": (54.5, 5, 20, 6.6),
    "sensing/reverb": (77, 5, 19, 6.6),
    "sensing/rays": (33, 14.7, 35, 5.4),
    "stand/statistics": (4, 5, 23, 6.6),
    "stand/intensity": (4, 14.7, 23, 5.4),
    "growth/own_tree": (4, 5, 53, 5.6),
    "growth/lsystem": (4, 13.4, 24, 6.6),
    "growth/mesh": (33, 13.4, 24, 6.6),
}
# Left of which an arrow goes, where not in the middle.
STRAIGHT = {("acoustics", "base"): 64.0}
SIDEWAYS = {
    ("sensing", "stand"),
    ("headless", "ui"),
    ("tiles", "results"),
    ("growth/lsystem", "growth/mesh"),
}
SHOWN = "shown"  # the metadata's key


def main() -> None:
    arrows = project_arrows()
    draw(arrows)
    print(f"{PICTURE.relative_to(ROOT)}: {len(arrows)} arrows, {len(reduced(arrows))} drawn")


def shown_of(arrows: list[tuple[str, str]]) -> dict[str, list]:
    """Content of the picture: its arrows, and the folders of the shell."""
    folders = [f"{room}/{chip}" for room in ("headless", "ui") for chip in _chips(room)]
    return {"arrows": [list(arrow) for arrow in reduced(arrows)], "folders": folders}


def box_of(module: str) -> str:
    """The box that a module is in: its room, or in rooms with wings its wing."""
    parts = module.split(".")
    if parts[0] == "headless":
        return "headless"
    wing = "/".join(parts[1:3])
    return wing if wing in WINGS else "".join(parts[1:2])


def project_arrows() -> list[tuple[str, str]]:
    """Which box imports from which, imports within functions too."""
    graph = grimp.build_graph("forest_addon", "headless", cache_dir=None)
    arrows = {
        (box_of(name), box_of(target))
        for name in graph.modules
        for target in graph.find_modules_directly_imported_by(name)
    }
    return sorted((a, b) for a, b in arrows if a and b and a != b)


def reduced(arrows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The arrows that do not follow from others. To others a room is one."""
    outer = set()
    for a, b in arrows:
        if _room(a) == _room(b):
            outer |= {(a, b)} if "/" in a and "/" in b else set()
        else:
            outer.add((_room(a), _room(b)))
    inside = {(_room(wing), wing) for pair in outer for wing in pair if _room(wing) == "sensing"}
    below: dict[str, set[str]] = {}
    for a, b in outer | (inside - {("sensing", "sensing")}):
        below.setdefault(a, set()).add(b)

    def reaches(a: str, b: str) -> bool:
        return any(c == b or reaches(c, b) for c in below.get(a, ()))

    return sorted((a, b) for a, b in outer if not any(reaches(c, b) for c in below[a] if c != b))


def _room(box: str) -> str:
    return box.split("/")[0]


def caption(box: str) -> str:
    """The first sentence of a folder's docstring, without its name."""
    folder = ROOT / ("headless" if box == "headless" else f"forest_addon/{box}")
    file = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    said = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    sentence = " ".join(said.split("\n\n")[0].split()).replace("`", "").rstrip(".")
    name, _, what = sentence.partition(": ")
    shown = what if what and len(name.split()) <= 3 else name
    first, second = f"{shown} .".split()[:2]
    proper = any(c.isupper() for c in first[1:] + second[0])  # LiDAR, Forest Sensing
    return shown if proper else shown[:1].lower() + shown[1:]


def draw(arrows: list[tuple[str, str]]) -> None:
    """Draw the boxes that there are and the arrows that do not follow from others."""
    there = {_room(box) for arrow in arrows for box in arrow}
    places, colours, top = {}, {}, 2.0
    for high, rooms in ROWS:
        shown = {room: row for room, row in rooms.items() if room in there}
        for room, (x, wide, colour) in shown.items():
            places[room], colours[room] = (x, top, wide, high), colour
        top += (high + GAP) if shown else 0
    for wing, (x, down, wide, high) in WINGS.items():
        places[wing] = (x, places[_room(wing)][1] + down, wide, high)
    figure = Figure(figsize=(11, 0.11 * (top + 3)), dpi=110, facecolor=PAPER)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, 100)
    axes.set_ylim(top + 3, 0)
    axes.set_axis_off()
    for box, place in places.items():
        _frame(axes, place, colours.get(box, WING))
        if "/" in box:
            _centred(axes, place, box.split("/")[1], caption(box), 9.5)
        elif _chips(box) or any(_room(wing) == box for wing in WINGS):
            _headed(axes, place, box, caption(box))
        else:
            _centred(axes, place, box, caption(box), 12)
        _draw_chips(axes, box, place)
    for a, b in reduced(arrows):
        _arrow(axes, *_ends(a, b, places))
    axes.text(
        *(2, top),
        "An arrow: imports. What follows from other arrows is left out. Green: arrays in and out, no "
        "Blender. Drawn by make architecture from the imports.",
        fontsize=8.5,
        color=FAINT,
        va="center",
    )
    PICTURE.parent.mkdir(exist_ok=True)
    figure.savefig(PICTURE, metadata={SHOWN: json.dumps(shown_of(arrows)), "Software": None})


Place = tuple[float, float, float, float]  # left, top, width, height


def _frame(axes: Axes, place: Place, colour: str) -> None:
    x, y, wide, high = place
    axes.add_patch(
        FancyBboxPatch(
            *((x, y), wide, high),
            boxstyle="round,pad=0,rounding_size=0.9",
            facecolor=colour,
            edgecolor=FAINT,
            linewidth=0.8,
        )
    )


def _centred(axes: Axes, place: Place, name: str, said: str, size: float) -> None:
    """A name, and below it what it is, in the middle of a box."""
    x, y, wide, high = place
    below = 7.4 if size < 10 else 8.8
    lines = textwrap.wrap(said, int(14.2 * (wide - 1) / below)) if said else []
    step = 0.19 * below
    top = y + high / 2 - step * len(lines) / 2
    middle = {"ha": "center", "va": "center", "color": INK}
    axes.text(x + wide / 2, top, name, fontsize=size, weight="bold", **middle)
    for number, line in enumerate(lines, start=1):
        axes.text(x + wide / 2, top + 0.3 + step * number, line, fontsize=below, **middle)


def _headed(axes: Axes, place: Place, name: str, said: str) -> None:
    """A name above what a box holds, and what it is beside the name."""
    x, y, wide, _ = place
    start = x + 2.5 + 1.18 * len(name)
    room = int((x + wide - start) * 1.8)
    lines = textwrap.wrap(said, room)
    axes.text(x + 1.3, y + 2.5, name, fontsize=12, color=INK, weight="bold", va="center")
    axes.text(
        *(start, y + 2.55, "\n".join(lines)),
        fontsize=8.5 if len(lines) == 1 else 7.6,
        color=INK,
        va="center",
    )


def _chips(room: str) -> list[str]:
    """Folders of a room of the shell, which has no wings of its own."""
    if room not in ("headless", "ui"):
        return []
    folder = ROOT / ("headless" if room == "headless" else f"forest_addon/{room}")
    return sorted(p.name for p in folder.iterdir() if (p / "__init__.py").exists())


def _draw_chips(axes: Axes, room: str, place: Place) -> None:
    x, y, wide, _ = place
    chips = _chips(room)
    for number, chip in enumerate(chips):
        each = (wide - 3) / len(chips)
        chip_place = (x + 1.5 + number * each + 0.3, y + 5.2, each - 0.6, 4.2)
        _frame(axes, chip_place, WING)
        _centred(axes, chip_place, chip, "", 9.5 if each > 7 else 7.5)


def _ends(
    a: str, b: str, places: dict[str, Place]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """From the lower edge of one box to the upper edge of the other, straight down where that goes."""
    (xa, ya, wa, ha), (xb, yb, wb, hb) = places[a], places[b]
    if (a, b) in SIDEWAYS:
        left, right = (xa, xb + wb) if xb < xa else (xa + wa, xb)
        return (left, ya + ha / 2), (right, yb + hb / 2)
    low, high = max(xa, xb), min(xa + wa, xb + wb)
    if low < high:
        x = STRAIGHT.get((a, b), (low + high) / 2)
        return (x, ya + ha), (x, yb)
    return (xa + 1 if xb < xa else xa + wa - 1, ya + ha), (xb + wb if xb < xa else xb, yb + hb / 2)


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.add_patch(
        FancyArrowPatch(
            *(start, end),
            arrowstyle="-|>",
            mutation_scale=11,
            color=INK,
            linewidth=1.1,
            shrinkA=0,
            shrinkB=0,
        )
    )


if __name__ == "__main__":
    main()
