"""Writes the manual that the extension carries: pages of docs/ as HTML that a browser opens offline.

F1 over a button or a setting in Blender opens them: ``ui/settings/preferences.py`` says which page.
Headings
have ids made of their words; a setting of the scene or species file has ``class.key``: ``sonar.tolerance``.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from html import escape
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = ("panel", "stand", "lidar", "sonar", "reverb", "template", "measured-trees", "flight")
GUIDES = ("asset-library", "accuracy")
REFERENCE = "scene-file"
STYLE = """
body { max-width: 52rem; margin: 2rem auto; padding: 0 1rem; font: 16px/1.55 sans-serif; color: #222; }
nav a { margin-right: 0.8em; } a { color: #2e6b34; } img { max-width: 100%; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
td, th { border-bottom: 1px solid #ddd; padding: 0.25em 0.6em; text-align: left; vertical-align: top; }
code, pre { background: #f3f5f2; } pre { padding: 0.6em; overflow-x: auto; }
:target { background: #fff3b0; }
"""


def write_manual(folder: Path) -> None:
    """Write every page into a folder, with the pictures that they show."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = {name: DOCS / f"{name}.md" for name in PAGES}
    sources |= {name: DOCS / "guide" / f"{name}.md" for name in GUIDES}
    for name, source in sources.items():
        body = rendered(source.read_text(encoding="utf-8"))
        body = re.sub(r'src="(?:\.\./)?pictures/([^"]+)"', r'src="pictures/\1"', body)
        for picture in re.findall(r'src="pictures/([^"]+)"', body):
            (folder / "pictures" / picture).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(DOCS / "pictures" / picture, folder / "pictures" / picture)
        (folder / f"{name}.html").write_text(page(body, [*sources, REFERENCE]), encoding="utf-8")
    body = reference_body()
    (folder / f"{REFERENCE}.html").write_text(page(body, [*sources, REFERENCE]), encoding="utf-8")


def rendered(text: str) -> str:
    """Markdown as HTML: headings with ids, links to other pages of the manual."""
    from markdown_it import MarkdownIt

    html = MarkdownIt("commonmark").enable("table").render(text)

    def heading(found: re.Match[str]) -> str:
        level, words = found.groups()
        return f'<h{level} id="{slug(words)}">{words}</h{level}>'

    html = re.sub(r"<h(\d)>(.*?)</h\1>", heading, html)
    html = re.sub(r'href="(?:guide/|\.\./)?([a-z-]+)\.md(#[^"]*)?"', _link, html)
    return re.sub(r'(?s)<a href="(?!https?:|#|[a-z-]+\.html)[^"]*">(.*?)</a>', r"\1", html)


def _link(found: re.Match[str]) -> str:
    name, place = found.groups()
    known = name in {*PAGES, *GUIDES, REFERENCE}
    return f'href="{name}.html{place or ""}"' if known else 'href="elsewhere"'


def slug(words: str) -> str:
    """The id of a heading."""
    plain = re.sub(r"<[^>]*>|&\w+;", "", words).lower()
    return re.sub(r"[^a-z0-9]+", "-", plain).strip("-")


def reference_body() -> str:
    """Every key of scene and species files; the id of each is that of its settings class and its name."""
    reference = scene_reference()
    parts = ["<h1>The scene file</h1>"]
    for title, group in reference.TABLES + reference.SPECIES:
        if group is reference.SPECIES[0][1]:
            parts.append("<h1>The species file</h1>")
        name = group.__name__.lower()
        table = rendered(reference._table(title, group, {group}))  # without links of the API
        seen = any(f'id="{name}"' in part for part in parts)
        if not seen:
            table = re.sub(r'<h2 id="[^"]*">', f'<h2 id="{name}">', table)
            row = re.compile(r"<tr>\s*<td><code>(\w+)</code>")
            table = row.sub(rf'<tr id="{name}.\1"><td><code>\1</code>', table)
        parts.append(table)
    return "\n".join(parts)


def scene_reference() -> ModuleType:
    """docs/scene_reference.py, which is no package."""
    spec = importlib.util.spec_from_file_location("scene_reference", DOCS / "scene_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def page(body: str, names: list[str]) -> str:
    title = re.search(r"<h1[^>]*>(.*?)</h1>", body)
    words = re.sub(r"<[^>]*>", "", title.group(1)) if title else "Forest Sensing"
    links = " ".join(f'<a href="{name}.html">{name.replace("-", " ")}</a>' for name in names)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(words)}</title>'
        f"<style>{STYLE}</style></head><body><nav>{links}</nav>\n{body}</body></html>\n"
    )


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    write_manual(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "manual")
