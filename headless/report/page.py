"""report.html, one file: pictures, counts, audits, timings, and clouds that can be turned.

Pictures of stands and of results are figures where matplotlib is there, else plain ones. Points of a
cloud are sorted along a Morton curve, so that their bytes compress and every k-th of them is an even
sample; coordinates are 16 bits an axis. The viewer is three.js, bundled in assets/viewer: the page needs
no network.
"""

from __future__ import annotations

import base64
import html
import json
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from forest_addon import kernels
from forest_addon.base.places import ASSETS, version
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import GROUND
from forest_addon.blender.sensors.observe import Observer
from forest_addon.drawing.palette import SPECIES
from forest_addon.drawing.strips import Plot, stand_map
from forest_addon.formats.atomic import write_whole
from forest_addon.formats.raster_file import write_png
from forest_addon.results.kind import Finding as SensorFinding, facts, of_forest
from forest_addon.results.kinds import results_of
from forest_addon.sensing.audit import Audit
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.rays.boxes import morton
from forest_addon.sensing.rays.geometry import apply_transform
from forest_addon.sensing.sonar.kind import targets_of
from forest_addon.spec import Scene, Sensor
from forest_addon.stand.compose import Inputs
from forest_addon.stand.forest import GrownForest
from forest_addon.stand.measured import TargetsMet, facts_of, sentences
from forest_addon.stand.plan import Stand

from . import can_draw

if TYPE_CHECKING:
    from forest_addon.stand.statistics.law import Goodness

LEAVES = 60_000  # on a map


def draw_result(
    sensor: Sensor, found: SensorFinding, observer: Observer, path: Path
) -> Path | None:
    """Draw what a sensor found into a PNG; return its path, None where there is nothing to draw."""
    if can_draw():
        from forest_addon.drawing.echoes import figure_of
        from forest_addon.drawing.figures import save_figure

        around = (_leaves_of(observer), observer.stems) if sensor.kind == "sonar" else None
        figure = figure_of(sensor, found, around)
        if figure is not None:
            return save_figure(figure, path)
    plot = results_of(sensor).plot(sensor, found)
    return _save_plainly(plot, path) if plot else None


def _leaves_of(observer: Observer) -> np.ndarray:
    """(M, 2) metres, places of some of the leaves that a sonar may hear."""
    scene = observer.once(targets_of).scene
    firsts = []
    for mesh in scene.meshes:
        facets = np.flatnonzero(mesh.leaf >= 0)
        _, first = np.unique(mesh.leaf[facets], return_index=True)
        firsts.append(mesh.triangles[facets[first]])
    count = np.array([len(firsts[index]) for index in scene.mesh_index], dtype=np.int64)
    share = min(1.0, LEAVES / max(int(count.sum()), 1))
    rng = stream(0, "picture", "leaves")
    places = []
    for instance, index in enumerate(scene.mesh_index):
        some = np.flatnonzero(rng.random(len(firsts[index])) < share)
        middle = scene.meshes[index].vertices[firsts[index][some]].mean(axis=1)
        places.append(apply_transform(scene.transform[instance], middle)[:, :2])
    return np.concatenate(places) if places else np.empty((0, 2))


def draw_stand(
    stand: Stand, labels: Sequence[str], settings: Scene, inputs: Inputs, path: Path
) -> Path:
    """Draw the map of a stand into a PNG; returns its path."""
    if not can_draw():
        return _save_plainly(stand_map(stand, settings, inputs), path)
    from forest_addon.drawing import figures, stands

    return figures.save_figure(stands.draw_stand(stand, labels, settings, inputs), path)


def colours_in_words(labels: Sequence[str]) -> str:
    """Colour of a species in the map."""
    names = list(SPECIES)
    said = (f"{label} {names[k % len(names)]}" for k, label in enumerate(labels))
    return f"In the map: {', '.join(said)}."


def _save_plainly(plot: Plot, path: Path) -> Path:
    import bpy  # noqa: F401  where Blender is a module, it brings blf and imbuf

    from forest_addon.ui.results.images import drawn

    write_whole(path, write_png(drawn(plot)[::-1]))
    return path


def forest_finding(settings: Scene, forest: GrownForest, picture: Path | None) -> Finding:
    """Trees, leaves and triangles of the forest, and where its trees stand."""
    wide, deep = settings.forest.size
    return Finding(
        "Forest",
        f"{_stand_in_words(settings, forest.stand.removed)} on {wide:g} by {deep:g} m.",
        facts(of_forest(forest, len(settings.plantings))),
        tuple(_stand_notes(settings, forest)),
        picture,
    )


LAYOUTS = {
    "clusters": "Trees in groups",
    "strauss": "Trees that keep apart (a Strauss process)",
    "rows": "Rows of trees",
    "list": "Trees from a list",
}


def _stand_in_words(settings: Scene, removed: int) -> str:
    """Words for how the trees of a scene are placed by its settings; ``removed``: to keep distances."""
    layouts = {planting.layout for planting in settings.plantings}
    if not layouts:
        return "A field without trees"
    if len(layouts) > 1:
        return "Trees placed in several ways"
    (layout,) = layouts
    if layout != "poisson":
        return LAYOUTS[layout]
    uneven = any(
        planting.gaussians or planting.rasters or planting.painted
        for planting in settings.plantings
    )
    poisson = "An inhomogeneous Poisson forest" if uneven else "A Poisson forest"
    return f"{poisson}, thinned to keep distances," if removed else poisson


def _stand_notes(settings: Scene, forest: GrownForest) -> Iterator[str]:
    """Sentences on what was expected, what was taken away and why."""
    stand = forest.stand
    sums = [
        f"{label} {value:,.1f} ± {error:.2g}"
        if error
        else f"{label} {value:,.1f}".removesuffix(".0")
        for label, value, error in zip(forest.labels, stand.expected, stand.error, strict=True)
    ]
    if sums:
        yield f"Expected: {', '.join(sums)} trees."
    if stand.removed:
        lost = zip(forest.labels, stand.too_near, strict=True)
        rule = {"matern": "Matérn II", "greedy": "greedy removal"}[settings.forest.spacing_rule]
        yield (
            f"{stand.removed:,} trees were removed to keep their distances ({rule}): "
            + ", ".join(f"{label} {count:,}" for label, count in lost if count)
            + "."
        )
    for note in forest.notes:
        yield f"{note}."
    if stand.off_ground.any():
        yield f"{stand.off_ground.sum():,} trees were left out where the terrain has no ground."
    if stand.off_field.any():
        yield f"{stand.off_field.sum():,} places of rows or lists lie beyond the field."
    yield from forest.detail


def targets_finding(met: Sequence[TargetsMet]) -> Finding | None:
    """Measures that trees were to have and those they have; None where nobody asked."""
    if not met:
        return None
    told: dict[str, str] = {}
    notes: list[str] = []
    for one in met:
        told |= facts_of(one)
        notes += sentences(one)
    kinds = sorted({one.kind for one in met if one.kind})
    band = (
        f" The band holds nine of ten measured trees of the same diameter ({', '.join(kinds)})."
        if kinds
        else ""
    )
    return Finding(
        "What the trees were to measure",
        "Target and reached; each tree is its variant in the size at which its stem has its diameter 1.3 m "
        "up." + band,
        told,
        tuple(notes) or ("Every target is met.",),
    )


def goodness_finding(found: Goodness, picture: Path | None) -> Finding:
    """Return whether trees stand as their intensity says."""
    bands, quadrats = found.excess, found.quadrats
    return Finding(
        "Where the trees stand",
        "The inhomogeneous L function of the trees and their counts in quadrats, against "
        f"{bands.simulations} other stands of the same settings. L(r) - r is 0 for a Poisson process, below "
        "it where trees keep apart.",
        {
            "trees tested": f"{found.trees:,}",
            "L function": f"p = {bands.p_value:.3f}",
            f"quadrats ({quadrats.classes} classes)": f"p = {found.quadrat_p_value:.3f}",
        },
        (
            "Edge correction by translation, within the region where the intensity is at least a tenth of "
            "its mean over trees. The global envelope is the studentised maximum deviation at 5 %; one "
            "stand in twenty lies beyond it by chance.",
        ),
        picture,
    )


@dataclass(frozen=True)
class Finding:
    """Finding of one stage; ``notes`` are about accuracy and what was left out, ``warnings`` what is hardly
    meant. figure : HTML of a cloud that can be turned. octaves : tables by the names of figures, in place of
    these among the facts. sounds : files that the page plays.
    """

    title: str
    sentence: str
    facts: dict[str, str]
    notes: tuple[str, ...] = ()
    picture: Path | None = field(default=None, compare=False)
    audits: tuple[Audit, ...] = ()
    figure: str = field(default="", compare=False)
    warnings: tuple[str, ...] = ()
    octaves: Mapping[str, Mapping[str, str]] = field(default_factory=dict, compare=False)
    sounds: tuple[str, ...] = ()


def write(
    path: Path,
    settings: Scene,
    findings: Sequence[Finding],
    seconds: Mapping[str, float],
    files: Sequence[str],
) -> None:
    """Write the report with its pictures inside."""
    preview = path.parent / "preview.png"
    hero = (
        f'<img class="hero" src="{_inline(preview)}" alt="The forest, rendered">'
        if "preview.png" in files and preview.is_file()
        else ""
    )
    body = "\n".join(_section(finding) for finding in findings)
    times = "".join(
        f"<tr><td>{html.escape(name)}</td><td>{took:.2f} s</td></tr>"
        for name, took in seconds.items()
    )
    listed = "".join(
        f'<li><a href="{html.escape(name)}">{html.escape(name)}</a></li>' for name in files
    )
    turning = any(finding.figure for finding in findings)
    code = f"<script>{viewer()}</script>" if turning else ""
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(settings.name)} · Forest Sensing</title>
<style>{CSS}</style></head>
<body><header><h1>{html.escape(settings.name)}</h1>
<p>Forest Sensing {version()}, seed {settings.seed}, kernels: {kernels.engine()}</p></header>
{hero}
<main>{body}
<section><h2>Times</h2><table>{times}
<tr class="sum"><td>together</td><td>{sum(seconds.values()):.2f} s</td></tr></table></section>
<section><h2>Files</h2><ul class="files">{listed}</ul>
<p>The JSON file holds versions, seed and every parameter of this run.</p></section>
</main>{code}</body></html>
"""
    write_whole(path, page)


def _section(finding: Finding) -> str:
    facts = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in finding.facts.items()
        if name not in finding.octaves
    )
    notes = "".join(f"<p class='note'>{html.escape(note)}</p>" for note in finding.notes)
    sounds = "".join(
        f"<p class='sound'><audio controls preload='none' src='{html.escape(name)}'></audio> "
        f"{html.escape(name)}</p>"
        for name in finding.sounds
    )
    warnings = "".join(
        f"<p class='warning'>Warning: {html.escape(warning)}</p>" for warning in finding.warnings
    )
    picture = (
        f'<img src="{_inline(finding.picture)}" alt="{html.escape(finding.title)}">'
        if finding.picture
        else ""
    )
    audits = "".join(_audit(audit) for audit in finding.audits)
    return (
        f"<section><h2>{html.escape(finding.title)}</h2><p>{html.escape(finding.sentence)}</p>"
        f"{warnings}<dl>{facts}</dl>{_octaves(finding)}{sounds}{finding.figure}{picture}{audits}{notes}</section>"
    )


def _octaves(finding: Finding) -> str:
    """A table of the figures that have a value for each octave."""
    octaves = list(dict.fromkeys(band for values in finding.octaves.values() for band in values))
    if not octaves:
        return ""
    head = "".join(f"<th>{html.escape(band)}</th>" for band in octaves)
    rows = "".join(
        f"<tr><td>{html.escape(name.removesuffix(' by octave'))}</td>"
        + "".join(f"<td>{html.escape(values.get(band, '–'))}</td>" for band in octaves)
        + "</tr>"
        for name, values in finding.octaves.items()
    )
    return f"<table class='octaves'><tr><th></th>{head}</tr>{rows}</table>"


def _audit(audit: Audit) -> str:
    """A line and a bar: how many of the decades that were allowed, down to rounding, the error uses."""
    floor = 1e-16
    allowed = max(audit.allowed, 10 * floor)
    used = math.log(max(min(audit.error, allowed), floor) / floor) / math.log(allowed / floor)
    kind = "audit" if audit.kept else "audit bad"
    return (
        f"<div class='{kind}'><span class='bar'><i style='width:{100 * used:.0f}%'></i></span>"
        f"Audit: {html.escape(str(audit))}.</div>"
    )


def _inline(picture: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(picture.read_bytes()).decode()


CSS = """
:root{--ink:#24302a;--faint:#66736b;--line:#dde3de;--leaf:#4c8c3a;--paper:#fbfcfa}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);
font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans",sans-serif}
header,main{max-width:1060px;margin:0 auto;padding:0 24px}
header{padding-top:36px;padding-bottom:10px}
h1{font-size:34px;line-height:1.15;margin:0}header p{color:var(--faint);margin:6px 0 14px}
.hero{display:block;width:calc(100% - 48px);max-width:1012px;margin:0 auto;border-radius:6px}
section{padding:30px 0;border-bottom:1px solid var(--line)}
h2{font-size:21px;margin:0 0 6px}p{margin:0 0 12px;max-width:74ch}
.audit{margin:10px 0;color:var(--leaf)}.audit.bad{color:#c8442c;font-weight:600}
.bar{display:inline-block;width:120px;height:8px;margin-right:10px;background:var(--line)}
.bar i{display:block;height:8px;background:currentColor}
dl{display:flex;flex-wrap:wrap;gap:12px 34px;margin:14px 0 18px}
dt{color:var(--faint);font-size:13px}dd{margin:0;font-size:18px;font-variant-numeric:tabular-nums}
section img{width:100%;border:1px solid var(--line);border-radius:4px;background:#fff}
.warning{color:#8a2d17;background:#fbe9e4;border-left:4px solid #c8442c;padding:8px 12px;
max-width:none}
.cloud{margin:0 0 14px}.cloud canvas{display:block;width:100%;height:520px;border-radius:4px;
touch-action:none}
.tools{display:flex;flex-wrap:wrap;gap:6px 22px;align-items:center;margin:8px 0 2px;font-size:14px}
.tools label{display:flex;gap:8px;align-items:center}
.legend{display:flex;flex-wrap:wrap;gap:4px 14px;align-items:center}
.legend i{display:inline-block;width:11px;height:11px;border-radius:50%;margin-right:5px}
.ramp{display:inline-block;width:140px;height:11px;border-radius:3px;margin:0 6px}
.octaves{margin:0 0 16px}.octaves th{font-weight:400;font-size:13px;color:var(--faint);text-align:right}
.octaves td,.octaves th{padding:3px 0 3px 26px}.octaves td:first-child{padding-left:0;text-align:left}
.sound{display:flex;gap:14px;align-items:center;color:var(--faint);font-size:14px}
figcaption{color:var(--faint);font-size:14px}
.note{color:var(--faint);font-size:14px;margin:10px 0 0}
table{border-collapse:collapse}td{padding:3px 34px 3px 0;font-variant-numeric:tabular-nums}
td+td{text-align:right;padding-right:0}.sum td{border-top:1px solid var(--line);font-weight:600}
.files{columns:3;padding-left:18px}a{color:var(--leaf)}
@media(max-width:640px){.files{columns:1}h1{font-size:27px}}
"""


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
    # Within an element ``script``, which knows no entities and ends at its end tag.
    inside = json.dumps(about).translate({ord(c): f"\\u{ord(c):04x}" for c in "&<>"})
    return (
        '<figure class="cloud"><canvas></canvas><div class="tools">'
        f"<label>Colour <select>{chosen}</select></label>"
        '<label>Cut above <input type="range" min="1" max="100" value="100"></label>'
        '<label>Cut in front <input type="range" min="1" max="100" value="100"></label>'
        f'<span class="legend"></span></div><figcaption>{"; ".join(said)}. Drag to turn, wheel to come '
        "nearer, right button to shift.</figcaption>"
        f'<script type="application/json" class="about">{inside}'
        f'</script><script type="text/plain" class="bytes">{packed}</script></figure>'
    )


def viewer() -> str:
    """The viewer's code, for the end of a page with such figures."""
    return (ASSETS / "viewer" / "viewer.min.js").read_text(encoding="utf-8")


def _met(names: Sequence[str], number: np.ndarray) -> list[str]:
    """Return the names for the legend, empty where no point is of that number."""
    there = np.bincount(number[number >= 0], minlength=len(names))
    return [name if there[k] else "" for k, name in enumerate(names)]


def _packed(cloud: Cloud, rows: np.ndarray, species: Sequence[str]) -> tuple[dict[str, Any], str]:
    """Description for the viewer, and the bytes."""
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
