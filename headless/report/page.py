"""report.html: what was simulated, pictures, counts, timings and how exact it is, in one file.

A ``Finding`` is what one stage has to say: a title, a sentence, a few facts, a picture. The report lays
findings out one below the other; the same facts go into run.json.
"""

from __future__ import annotations

import base64
import html
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.growth.mesh.trimesh import GROUND, LEAF, WOOD
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.lidar.tractor import TractorScan
from forest_addon.sensing.reverb import metrics
from forest_addon.sensing.reverb.model_error import ModelError
from forest_addon.sensing.reverb.response import ImpulseResponse
from forest_addon.sensing.reverb.slices import Trunks
from forest_addon.sensing.sonar.flight import Flight
from forest_addon.sensing.sonar.ping import Echo
from forest_addon.spec import Reverb, Scanner, Scene, Sonar, Terrestrial, Tractor
from forest_addon.stand.forest import Forest
from forest_addon.stand.statistics.goodness import Goodness


@dataclass(frozen=True)
class Finding:
    """What one stage has to say; ``notes`` are about accuracy and what was left out."""

    title: str
    sentence: str
    facts: dict[str, str]
    notes: tuple[str, ...] = ()
    picture: Path | None = field(default=None, compare=False)


def forest_finding(settings: Scene, forest: Forest, picture: Path) -> Finding:
    """Trees, leaves and triangles of the forest, and where its trees stand."""
    stand = forest.stand
    leaves = sum(len(forest.variant_of(tree).leaves) for tree in range(len(stand)))
    triangles = sum(len(forest.variant_of(tree).mesh.triangles) for tree in range(len(stand)))
    unique = sum(len(tree.mesh.triangles) for tree in forest.variants.values())
    facts = {
        "trees": f"{len(stand):,}",
        **{label: f"{count:,}" for label, count in zip(forest.labels, stand.counts(), strict=True)},
        "leaves": f"{leaves:,}",
        "triangles": f"{triangles:,} ({unique:,} of them unique)",
        "density": f"{stand.density().sum() * 1e4:,.0f} trees/ha",
    }
    kinds = {planting.layout for planting in settings.plantings}
    what = {frozenset({"rows"}): "An orchard", frozenset({"list"}): "A forest from a list of trees"}
    return Finding(
        "Forest",
        f"{what.get(frozenset(kinds), 'An inhomogeneous Poisson forest')} on "
        f"{settings.forest.size[0]:g} by {settings.forest.size[1]:g} m, grown from L-systems and STL "
        "branch templates.",
        facts,
        tuple(_stand_notes(settings, forest)),
        picture,
    )


def _stand_notes(settings: Scene, forest: Forest) -> Iterator[str]:
    """What was expected, what was taken away and why."""
    stand = forest.stand
    sums = [
        f"{label} {value:,.1f}" + (f" ± {error:.2g}" if error else "")
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
    if stand.off_ground.any():
        yield f"{stand.off_ground.sum():,} trees were left out where the terrain has no ground."
    if stand.off_field.any():
        yield f"{stand.off_field.sum():,} places of rows or lists lie beyond the field."


def goodness_finding(found: Goodness, picture: Path) -> Finding:
    """Whether trees stand as their intensity says."""
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


def cloud_finding(sensor: Scanner, cloud: Cloud, picture: Path) -> Finding:
    """A scan that gives points: from a tripod, a vehicle, an aircraft."""
    organ, beam = cloud.returns.organ, sensor.beam
    trees = np.unique(cloud.returns.tree[cloud.returns.tree >= 0])
    spacing = f" every {sensor.angle_step_deg:g}°" if isinstance(sensor, Terrestrial) else ""
    instrument = f" by {sensor.scanner}" if sensor.scanner else ""
    facts = {
        "points": f"{len(organ):,}",
        "trees seen": f"{len(trees)}",
        "wood": _share(organ == WOOD),
        "leaves": _share(organ == LEAF),
        "ground": _share(organ == GROUND),
    }
    if beam.max_returns > 1:
        facts["of several returns"] = _share(cloud.count > 1)
    return Finding(
        f"{sensor.kind.title()} LiDAR: {sensor.name}",
        f"{cloud.pulses:,} pulses{spacing}{instrument} gave {len(organ):,} points.",
        facts,
        (
            "One ray a pulse."
            if beam.subrays == 1
            else f"{beam.subrays} rays of equal energy a pulse, over a Gaussian footprint.",
            "LAS coordinates are stored to 0.1 mm; labels and truth (range without noise, normal, angle "
            "of incidence) are extra bytes.",
        ),
        picture,
    )


def echo_finding(sensor: Sonar, echo: Echo, picture: Path) -> Finding:
    """The foliage echo."""
    return Finding(
        f"Biosonar: {sensor.name}",
        f"One ping of {_call_in_words(sensor)}.",
        _echo_facts(echo),
        _echo_notes(sensor, echo.cull_bound),
        picture,
    )


def flight_finding(sensor: Sonar, flight: Flight, picture: Path) -> Finding:
    """Echoes along a way; the facts are those of the loudest."""
    loudest = max(flight.echoes, key=lambda echo: float(echo.envelope.max(initial=0.0)))
    bound = max(echo.cull_bound for echo in flight.echoes)
    return Finding(
        f"Biosonar: {sensor.name}",
        f"{len(flight)} pings of {_call_in_words(sensor)}; what follows is of the loudest.",
        _echo_facts(loudest),
        _echo_notes(sensor, bound),
        picture,
    )


def _call_in_words(sensor: Sonar) -> str:
    beam = {"horseshoe": "a horseshoe bat's", "file": "a measured", "omni": "an even"}
    model = {"piston": "hard discs (physical optics)", "paper": "T20's fit"}
    return (
        f"{sensor.band[0] / 1e3:g} to {sensor.band[1] / 1e3:g} kHz with "
        f"{beam.get(sensor.beam, f'a {sensor.beam_width_deg[0]:g}°')} beam, at {sensor.ears} "
        f"ear{'s' if sensor.ears > 1 else ''}; leaves scatter as "
        f"{model.get(sensor.leaf_model, 'hard discs (exact)')}"
    )


def _echo_facts(echo: Echo) -> dict[str, str]:
    peak = int(np.argmax(echo.envelope)) if np.any(echo.envelope) else None
    kinds = {kind: int(np.count_nonzero(echo.heard.kind == kind)) for kind in ("wood", "facet")}
    metres = "nothing" if peak is None else f"{echo.time[peak] * echo.sound_speed / 2:.2f} m"
    level = "silence" if peak is None else f"{20 * np.log10(echo.envelope[peak]):.1f} dB"
    facts = {
        "leaves in the scene": f"{echo.leaves:,}",
        "leaves heard": f"{echo.leaves_heard:,}",
        "pieces of wood heard": f"{kinds['wood']:,}",
        "glints and rims heard": f"{kinds['facet']:,}",
        "hidden by wood": f"{echo.hidden:,}",
        "strongest echo from": metres,
        "level": level if peak is None else f"{level} re call at 1 m",
    }
    return facts | ({"later than the record": f"{echo.late:,}"} if echo.late else {})


def _echo_notes(sensor: Sonar, bound: float) -> tuple[str, ...]:
    summed = (
        f"Fast sum, error at most {sensor.tolerance:.0e} of all amplitudes"
        if sensor.tolerance
        else "Direct sum over every scatterer and frequency in float64"
    )
    shade = {
        "none": "Nothing shades anything, as in the paper.",
        "trunks": "Leaves do not shade each other; wood hides them as straight rays would.",
        "extinction": "Leaves weaken what lies behind them by Beer-Lambert; wood hides nothing.",
    }
    both = (
        "Leaves weaken what lies behind them by Beer-Lambert, wood hides it as straight rays would."
    )
    return (
        f"{summed}; what is left out as too weak adds at most {bound:.1e} of them.",
        shade.get(sensor.shading, both),
    )


def reverb_finding(
    sensor: Reverb, response: ImpulseResponse, trunks: Trunks, picture: Path
) -> Finding:
    """The impulse response."""
    distance = float(np.linalg.norm(np.subtract(sensor.source, sensor.receiver)))
    measures = metrics.room_metrics(response.samples, response.sample_rate, response.left_db)
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
    notes += [
        f"From {low:g} Hz to {2 * low:g} Hz the error of the sum is {error:.0e}."
        for low, error in sorted(response.errors.items())
        if error > sensor.tolerance
    ]
    if response.late:
        notes.append(
            f"The record ends before the sound: {response.late:,} trunks come later, with "
            f"{response.left_db[0]:.0f} dB of the energy. Measures that this would change are left out; "
            "duration = 0 records all."
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
    manifest = Path(__file__).resolve().parents[2] / "blender_manifest.toml"
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
