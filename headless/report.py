"""report.html: what was simulated, pictures, counts, timings and how exact it is, in one file.

A ``Finding`` is what one stage has to say: a title, a sentence, a few facts, a picture. The report lays
findings out one below the other; the same facts go into run.json.
"""

from __future__ import annotations

import base64
import html
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.growth.trimesh import GROUND, LEAF, WOOD
from forest_addon.sensing import metrics
from forest_addon.sensing.lidar import Cloud, TractorScan
from forest_addon.sensing.model_error import ModelError
from forest_addon.sensing.reverb import ImpulseResponse
from forest_addon.sensing.slices import Trunks
from forest_addon.sensing.sonar import Echo
from forest_addon.spec import Reverb, Scene, Sonar, Terrestrial, Tractor
from forest_addon.stand.forest import Forest


@dataclass(frozen=True)
class Finding:
    """What one stage has to say; ``notes`` are about accuracy and what was left out."""

    title: str
    sentence: str
    facts: dict[str, str]
    notes: tuple[str, ...] = ()
    picture: Path | None = field(default=None, compare=False)


def forest_finding(settings: Scene, forest: Forest) -> Finding:
    """Trees, leaves and triangles of the forest."""
    stand = forest.stand
    counts = np.bincount(stand.species, minlength=len(forest.labels))
    leaves = sum(len(forest.variant_of(tree).leaves) for tree in range(len(stand)))
    triangles = sum(len(forest.variant_of(tree).mesh.triangles) for tree in range(len(stand)))
    unique = sum(len(tree.mesh.triangles) for tree in forest.variants.values())
    area = settings.forest.size[0] * settings.forest.size[1]
    facts = {
        "trees": f"{len(stand)}",
        **{label: f"{count}" for label, count in zip(forest.labels, counts, strict=True)},
        "leaves": f"{leaves:,}",
        "triangles": f"{triangles:,} ({unique:,} of them unique)",
        "density": f"{len(stand) / area * 1e4:,.0f} trees/ha",
    }
    notes = ()
    if stand.removed:
        notes = (
            f"{stand.removed} trees were removed to keep {settings.forest.spacing:g} m apart.",
        )
    return Finding(
        "Forest",
        f"An inhomogeneous Poisson forest on {settings.forest.size[0]:g} by "
        f"{settings.forest.size[1]:g} m, grown from L-systems and STL branch templates.",
        facts,
        notes,
    )


def scan_finding(sensor: Tractor, scan: TractorScan, picture: Path) -> Finding:
    """The tractor scan."""
    organ, beams = scan.organ, scan.organ.size
    return Finding(
        f"Tractor LiDAR: {sensor.name}",
        f"{organ.shape[0]:,} scans of {organ.shape[1]} beams along {sensor.track:g} m (SIMLIDAR's "
        "scanner, one ray a beam).",
        {
            "beams": f"{beams:,}",
            "wood": _share(organ == WOOD),
            "leaves": _share(organ == LEAF),
            "ground": _share(organ == GROUND),
            "escaped": _share(organ < 0),
        },
        (
            f"Rays by {scan.engine} on the evaluated depsgraph; every distance is computed again in "
            "float64 on the triangle that was hit.",
        ),
        picture,
    )


def cloud_finding(sensor: Terrestrial, cloud: Cloud, picture: Path) -> Finding:
    """The terrestrial scan."""
    organ = cloud.returns.organ
    trees = np.unique(cloud.returns.tree[cloud.returns.tree >= 0])
    return Finding(
        f"Terrestrial LiDAR: {sensor.name}",
        f"{cloud.pulses:,} pulses every {sensor.angle_step_deg:g}° gave {len(organ):,} points.",
        {
            "points": f"{len(organ):,}",
            "trees seen": f"{len(trees)}",
            "wood": _share(organ == WOOD),
            "leaves": _share(organ == LEAF),
            "ground": _share(organ == GROUND),
        },
        (
            "LAS coordinates are stored to 0.1 mm; tree, species, organ, leaf and object are extra bytes.",
        ),
        picture,
    )


def echo_finding(sensor: Sonar, echo: Echo, picture: Path) -> Finding:
    """The foliage echo."""
    peak = int(np.argmax(echo.envelope)) if len(echo.envelope) else 0
    silent = not np.any(echo.envelope)
    return Finding(
        f"Biosonar: {sensor.name}",
        f"One ping of {sensor.band[0] / 1e3:g} to {sensor.band[1] / 1e3:g} kHz with a "
        f"{sensor.beam_width_deg[0]:g}° beam; leaves scatter as "
        + ("hard discs (physical optics)." if sensor.leaf_model == "piston" else "in T20's fit."),
        {
            "leaves in the scene": f"{echo.leaves:,}",
            "leaves heard": f"{int(np.count_nonzero(echo.heard)):,}",
            "hidden by wood": f"{echo.hidden:,}",
            "strongest echo from": "nothing"
            if silent
            else f"{echo.time[peak] * echo.sound_speed / 2:.2f} m",
            "level": "silence"
            if silent
            else f"{20 * np.log10(echo.envelope[peak]):.1f} dB re call at 1 m",
        },
        (
            f"Direct sum over every leaf and frequency in float64; leaves left out as too weak add at "
            f"most {echo.cull_bound:.1e} of all amplitudes.",
            "Leaves do not shade each other; wood hides them as straight rays would."
            if sensor.shading == "trunks"
            else "Nothing shades anything, as in the paper.",
        ),
        picture,
    )


def reverb_finding(
    sensor: Reverb, response: ImpulseResponse, trunks: Trunks, picture: Path
) -> Finding:
    """The impulse response."""
    distance = float(np.linalg.norm(np.subtract(sensor.source, sensor.receiver)))
    measures = metrics.room_metrics(response.samples, response.sample_rate)
    channels = response.channels
    peak = float(np.abs([channel.samples for channel in channels]).max())
    notes = [
        (
            "Direct sum over every trunk and frequency in float64."
            if response.exact
            else f"Sum over trunks to a relative error of {sensor.tolerance:.0e}."
        )
        + " Single scattering itself is the larger error, and grows with the density of the stand"
        " (rescattering = 100 measures it).",
        "Reverberation time is read from -5 to -35 dB of the energy decay; C50 with the onset at "
        "-20 dB.",
    ]
    if len(channels) > 1:
        notes.append(
            f"Figures are of the first of {len(channels)} channels, {response.channel}; "
            f"{sensor.name}.npz has those of all."
        )
    if any(channel.clamped for channel in channels):
        most = max(channel.clamped for channel in channels)
        notes.append(
            f"{most} trunk(s) cover a source or a receiver; their distance is taken as their radius."
        )
    if peak > 1:
        notes.append("The sound exceeds full scale; the WAV is 32-bit float and does not clip.")
    return Finding(
        f"Forest reverb: {sensor.name}",
        f"The impulse response over {distance:.1f} m, from single scattering by trunks (K).",
        {
            "channels": ", ".join(channel.channel for channel in channels[:8])
            + (f" and {len(channels) - 8} more" if len(channels) > 8 else ""),
            "trunks cut from the scene": f"{len(trunks.radius):,}",
            "trunks heard": f"{response.trunks:,}",
            "trunks beyond the field": f"{response.continued:,}",
            "reverberation time": f"{measures.t30[0]:.2f} s"
            if np.isfinite(measures.t30[0])
            else "not reached",
            "reverberation time by octave": _by_octave(measures.band, measures.t30, "s", 2),
            "C50": f"{measures.c50[0]:.1f} dB" if np.isfinite(measures.c50[0]) else "no late sound",
            "C50 by octave": _by_octave(measures.band, measures.c50, "dB", 1),
            "direct path": _passing(channel.direct_clear for channel in channels),
            "ground path": _passing(channel.ground_clear for channel in channels),
            **_multiple_scattering(response.model_error),
        },
        tuple(notes),
        picture,
    )


def _by_octave(band: np.ndarray, value: np.ndarray, unit: str, digits: int) -> str:
    """Octaves with their values; those without are left out."""
    shown = [
        f"{middle:g} Hz {number:.{digits}f} {unit}"
        for middle, number in zip(band[1:], value[1:], strict=True)
        if np.isfinite(number)
    ]
    return ", ".join(shown) or "not reached"


def _passing(clear: Iterable[bool]) -> str:
    """Whether a path is clear, for one channel or several."""
    free = list(clear)
    if all(free):
        return "clear"
    return "blocked by wood" + (f" in {free.count(False)} of {len(free)}" if any(free) else "")


def _multiple_scattering(found: ModelError | None) -> dict[str, str]:
    """What single scattering leaves out, if it was measured and there was something to measure."""
    if found is None or not len(found.frequency):
        return {}
    return {
        "error of single scattering": f"{100 * found.relative:.0f} % (L2), {found.level_db:+.1f} dB "
        f"against exact multiple scattering by the {len(found.trunks)} trunks with the shortest paths, "
        f"line source in the plane, {found.frequency[0]:.0f} to {found.frequency[-1]:.0f} Hz",
    }


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
    page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(settings.name)} · Forest Sensing</title>
<style>{CSS}</style></head>
<body><header><h1>{html.escape(settings.name)}</h1>
<p>Forest Sensing {version()}, seed {settings.seed}</p></header>
{hero}
<main>{body}
<section><h2>Times</h2><table>{times}
<tr class="sum"><td>together</td><td>{sum(seconds.values()):.2f} s</td></tr></table></section>
<section><h2>Files</h2><ul class="files">{listed}</ul>
<p>run.json holds versions, seed and every parameter of this run.</p></section>
</main></body></html>
"""
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")


def version() -> str:
    """The version of Forest Sensing, from its manifest."""
    manifest = Path(__file__).resolve().parents[1] / "blender_manifest.toml"
    return str(tomllib.loads(manifest.read_text(encoding="utf-8"))["version"])


def _section(finding: Finding) -> str:
    facts = "".join(
        f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
        for name, value in finding.facts.items()
    )
    notes = "".join(f"<p class='note'>{html.escape(note)}</p>" for note in finding.notes)
    picture = (
        f'<img src="{_inline(finding.picture)}" alt="{html.escape(finding.title)}">'
        if finding.picture
        else ""
    )
    return (
        f"<section><h2>{html.escape(finding.title)}</h2><p>{html.escape(finding.sentence)}</p>"
        f"<dl>{facts}</dl>{picture}{notes}</section>"
    )


def _inline(picture: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(picture.read_bytes()).decode()


def _share(mask: np.ndarray) -> str:
    return f"{100 * float(np.mean(mask)):.1f} %" if mask.size else "0 %"


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
dl{display:flex;flex-wrap:wrap;gap:12px 34px;margin:14px 0 18px}
dt{color:var(--faint);font-size:13px}dd{margin:0;font-size:18px;font-variant-numeric:tabular-nums}
section img{width:100%;border:1px solid var(--line);border-radius:4px;background:#fff}
.note{color:var(--faint);font-size:14px;margin:10px 0 0}
table{border-collapse:collapse}td{padding:3px 34px 3px 0;font-variant-numeric:tabular-nums}
td+td{text-align:right;padding-right:0}.sum td{border-top:1px solid var(--line);font-weight:600}
.files{columns:3;padding-left:18px}a{color:var(--leaf)}
@media(max-width:640px){.files{columns:1}h1{font-size:27px}}
"""
