"""F1, or *Online Manual* on a right click: a page on this machine, opened at what it is asked about.

The page is written when it is asked for, into the cache: first docs/panel.md, then every operator and
group of settings as Blender knows them (name, help, range, what each entry of a menu does). So it needs no
network and is never older than the add-on. Blender matches identifiers in lower case; the first pattern
that fits counts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path
from typing import Any

import bpy

from .preferences import cache_folder

DOCS = Path(__file__).resolve().parents[2] / "docs" / "panel.md"
PAGE = "manual.html"
OWNERS = ("Object", "Mesh", "Scene", "WindowManager")  # what may have properties of ours, forest_…
ENDLESS = 1e9  # limits beyond are none

LOOK = (
    "body{max-width:46rem;margin:2rem auto;padding:0 1rem;font:16px/1.5 sans-serif}"
    "dt{font-weight:600;margin-top:.7rem}dd{margin:0 0 0 1.2rem}small{color:#666}"
    "table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.3rem .6rem;text-align:left}"
    ":target{background:#fff3b0}"
)

Section = tuple[str, str, str, Any]  # anchor, title, help, properties

_covered: tuple[type, ...] = ()


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """Where the page is, and which part of it each operator, group and property of ours means."""
    return write_page().as_uri(), tuple(_links())


def write_page() -> Path:
    """The page as it is now, in the cache."""
    path = cache_folder() / PAGE
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(), encoding="utf-8")
    return path


def page() -> str:
    """The whole page, HTML."""
    found = list(sections())
    body = [_html_of(DOCS.read_text(encoding="utf-8"))] if DOCS.is_file() else []
    body += [_part(*section) for section in sorted(found, key=lambda section: section[1])]
    title = "Forest Sensing"
    head = f'<meta charset="utf-8"><title>{title}</title><style>{LOOK}</style>'
    return f"<!doctype html><html><head>{head}</head><body>{''.join(body)}</body></html>"


def sections() -> Iterator[Section]:
    """One for every operator and group of settings that is registered, and for what objects got from us."""
    for cls in _covered:
        if issubclass(cls, bpy.types.Operator):
            verb = cls.__name__.removeprefix("FOREST_OT_")
            rna = getattr(bpy.ops.forest, verb).get_rna_type()
            yield f"forest.{verb}", rna.name, cls.__doc__ or rna.description, rna.properties
        elif issubclass(cls, bpy.types.PropertyGroup):
            name = cls.__name__
            title = name.removeprefix("FOREST_PG_").replace("_", " ").title()
            yield name.lower(), title, "", cls.bl_rna.properties
    for owner in OWNERS:
        ours = [each for each in getattr(bpy.types, owner).bl_rna.properties if _is_ours(each)]
        if ours:
            yield owner.lower(), owner, "", ours


def _links() -> Iterator[tuple[str, str]]:
    for anchor, _, _, properties in sections():
        operator = "." in anchor
        whole = f"bpy.ops.{anchor}" if operator else f"bpy.types.{anchor}"
        for each in _told(properties):
            name = each.identifier.lower()
            yield f"{whole}.{name}", f"#{anchor}.{each.identifier}"
        if operator or anchor.startswith("forest_"):
            yield whole, f"#{anchor}"
            yield f"{whole}.*", f"#{anchor}"


def _is_ours(known: Any) -> bool:
    return bool(known.identifier.startswith("forest_"))


def _told(properties: Any) -> Iterator[Any]:
    return (each for each in properties if each.identifier not in ("rna_type", "bl_idname"))


def _part(anchor: str, title: str, words: str, properties: Any) -> str:
    """A section of the page."""
    lines = [f'<h3 id="{escape(anchor)}">{escape(title)}</h3><p>{escape(words)}</p><dl>']
    for each in _told(properties):
        if not each.name and not each.description:
            lines.append(f'<span id="{anchor}.{each.identifier}"></span>')
            continue
        lines.append(f'<dt id="{anchor}.{each.identifier}">{escape(each.name or each.identifier)}')
        lines.append(f" <small>{_range(each)}</small></dt><dd>{escape(each.description)}")
        items = list(each.enum_items_static) if each.type == "ENUM" else []
        if items:
            entries = (f"<li>{escape(i.name)}: {escape(i.description)}</li>" for i in items)
            lines.append(f"<ul>{''.join(entries)}</ul>")
        lines.append("</dd>")
    return "".join((*lines, "</dl>"))


def _range(known: Any) -> str:
    """From where to where a number goes."""
    if known.type not in ("INT", "FLOAT"):
        return ""
    low, high = known.hard_min, known.hard_max
    ends = [f"{end:g}" if math.isfinite(end) and abs(end) < ENDLESS else "" for end in (low, high)]
    return "–".join(ends) if all(ends) else f"≥ {ends[0]}" if ends[0] else ""


def _html_of(markdown: str) -> str:
    """What of Markdown docs/panel.md uses: headings, paragraphs, tables, code, emphasis."""
    return "".join(_block(block) for block in re.split(r"\n\s*\n", markdown.strip()))


def _block(block: str) -> str:
    if block.startswith("#"):
        marks, _, words = block.partition(" ")
        return f"<h{len(marks)}>{_inline(words)}</h{len(marks)}>"
    if block.startswith("|"):
        rows = [row.strip("| ").split("|") for row in block.splitlines() if "---" not in row]
        cells = ("".join(f"<td>{_inline(cell.strip())}</td>" for cell in row) for row in rows)
        return "<table>" + "".join(f"<tr>{row}</tr>" for row in cells) + "</table>"
    return f"<p>{_inline(block)}</p>"


def _inline(words: str) -> str:
    said = escape(words, quote=False)
    said = re.sub(r"`([^`]+)`", r"<code>\1</code>", said)
    return re.sub(r"\*([^*]+)\*", r"<em>\1</em>", said)


def cover(classes: Iterable[type]) -> None:
    """Tell Blender where to look for what these are; the page is written when it does."""
    global _covered
    _covered = tuple(classes)
    bpy.utils.register_manual_map(manual_map)


def uncover() -> None:
    """Take it back."""
    global _covered
    _covered = ()
    bpy.utils.unregister_manual_map(manual_map)
