"""A cloud that can be turned in report.html: points packed into the page, coloured by what they are of.

Points are sorted along a Morton curve, so that their bytes compress and every k-th of them is an even sample;
coordinates are 16 bits an axis. The viewer is three.js, bundled in assets/viewer: the page needs no network.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from forest_addon.base.places import ASSETS
from forest_addon.base.trimesh import GROUND
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.rays.boxes import morton

MOST = 1_000_000  # points of a cloud
BUDGET = 5_500_000  # characters of all clouds of a page
SHARE = 0.001  # of the points at each end of an axis that may lie beyond the picture
ORGANS = ("other", "wood", "leaf", "ground", "dead wood")
GRIDS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # metres


def turning_cloud(cloud: Cloud, species: Sequence[str], budget: int = BUDGET) -> str:
    """Return the figure of a cloud as HTML, at most ``budget`` characters of points; "" without points.

    species : names of the species by their numbers.
    """
    if not len(cloud):
        return ""
    position = cloud.position
    solid = position[cloud.returns.organ != GROUND]  # ground runs to the horizon
    framed = solid if len(solid) > 0.01 * len(position) else position
    low, high = np.quantile(framed, [SHARE, 1 - SHARE], axis=0)
    margin = 0.08 * (high - low).max() + 1e-3
    inside = ((position >= low - margin) & (position <= high + margin)).all(axis=1)
    rows = np.flatnonzero(inside)
    rows = rows[np.argsort(morton(position[rows]), kind="stable")]
    every = -(-len(rows) // MOST)
    while True:
        shown = rows[::every]
        about, packed = _packed(cloud, shown, species)
        if len(packed) <= budget:
            break
        every += max(1, int(every * (len(packed) / budget - 1)))
    said = [f"{len(shown):,} of {len(cloud):,} points" if every > 1 else f"{len(shown):,} points"]
    if len(rows) < len(cloud):
        said.append(f"{len(cloud) - len(rows):,} far ones lie beyond the picture")
    said.append(f"squares of the grid are {about['grid']:g} m")
    options = [("height", "height"), *((c["key"], c["title"]) for c in about["columns"])]
    chosen = "".join(
        f'<option value="{key}"{" selected" if key == "organ" else ""}>{title}</option>'
        for key, title in options
    )
    return (
        '<figure class="cloud"><canvas></canvas><div class="tools">'
        f"<label>Colour <select>{chosen}</select></label>"
        '<label>Cut above <input type="range" min="1" max="100" value="100"></label>'
        '<label>Cut in front <input type="range" min="1" max="100" value="100"></label>'
        f'<span class="legend"></span></div><figcaption>{"; ".join(said)}. Drag to turn, wheel to come '
        "nearer, right button to shift.</figcaption>"
        f'<script type="application/json" class="about">{_in_script(about)}'
        f'</script><script type="text/plain" class="bytes">{packed}</script></figure>'
    )


def _in_script(value: Any) -> str:
    """JSON within an element ``script``, which knows no entities and ends at its end tag."""
    text = json.dumps(value)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def viewer() -> str:
    """The viewer's code, for the end of a page with such figures."""
    return (ASSETS / "viewer" / "viewer.min.js").read_text(encoding="utf-8")


def _met(names: Sequence[str], number: np.ndarray) -> list[str]:
    """Return the names for the legend, empty where no point is of that number."""
    there = np.bincount(number[number >= 0], minlength=len(names))
    return [name if there[k] else "" for k, name in enumerate(names)]


def _packed(cloud: Cloud, rows: np.ndarray, species: Sequence[str]) -> tuple[dict[str, Any], str]:
    """Return what the viewer has to know, and the bytes."""
    position = cloud.position[rows]
    corner = position.min(axis=0)
    size = position.max(axis=0) - corner
    step = max(float(size.max()), 1e-6) / 65535
    steps = np.rint((position - corner) / step).astype(np.uint16)
    planes = [part for axis in steps.T for part in (axis & 255, axis >> 8)]
    returns = cloud.returns
    level = 10 * np.log10(np.maximum(cloud.intensity[rows], 1e-30))
    faint, strong = np.quantile(level, [0.01, 0.99])
    share = (level - faint) / max(float(strong - faint), 1e-9)
    kinds = np.clip(returns.species[rows] + 1, 0, 255)
    columns = [
        {"key": "organ", "title": "organ", "names": _met(ORGANS, returns.organ[rows])},
        {"key": "species", "title": "species", "names": _met(("none", *species), kinds)},
        {
            "key": "intensity",
            "title": "intensity",
            "low": f"{faint:.0f}",
            "high": f"{strong:.0f}",
            "unit": "dB re white at 1 m",
        },
    ]
    planes += [returns.organ[rows], kinds, np.rint(255 * np.clip(share, 0, 1))]
    raw = b"".join(np.asarray(plane).astype(np.uint8).tobytes() for plane in planes)
    ground = position[returns.organ[rows] == GROUND, 2]
    floor = float(np.median(ground) - corner[2]) if len(ground) else 0.0
    near = np.sqrt(max(float(size[0] * size[1]), 1e-6) / len(rows))
    about = {
        "count": len(rows),
        "step": step,
        "size": np.maximum(size, 1e-3).round(4).tolist(),
        "floor": floor,
        "dot": float(np.clip(1.5 * near, size.max() / 2000, size.max() / 150)),
        "grid": next((g for g in GRIDS if size.max() / g <= 12), GRIDS[-1]),
        "height": {
            "key": "height",
            "low": f"{corner[2]:.1f}",
            "high": f"{corner[2] + size[2]:.1f}",
            "unit": "m",
        },
        "columns": columns,
    }
    return about, base64.b64encode(zlib.compress(raw, 6)).decode()
