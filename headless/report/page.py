"""report.html: what was simulated, pictures, counts, timings and how exact it is, in one file.

A ``Finding`` is what one stage has to say: a title, a sentence, a few facts, a picture. The report lays
findings out one below the other; the same facts go into run.json.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from forest_addon.base.places import version
from forest_addon.formats.atomic import replacing
from forest_addon.sensing.audit import Audit
from forest_addon.spec import Scene

from .turning import viewer


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
<p>Forest Sensing {version()}, seed {settings.seed}</p></header>
{hero}
<main>{body}
<section><h2>Times</h2><table>{times}
<tr class="sum"><td>together</td><td>{sum(seconds.values()):.2f} s</td></tr></table></section>
<section><h2>Files</h2><ul class="files">{listed}</ul>
<p>run.json holds versions, seed and every parameter of this run.</p></section>
</main>{code}</body></html>
"""
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")


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
