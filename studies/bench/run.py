"""``python -m studies bench``: time and error side by side, printed as tables.

Each section is a module with ``TITLE``, perhaps ``WORDS`` about its ``ROWS`` (``rows`` measures each), and
perhaps ``run(say, told)`` for what has another form, told what the rows took, which may give back a picture.
Beside each stands the machine and what the section took. Nothing is asserted here.
"""

from __future__ import annotations

import importlib
import os
import platform
import re
import time
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version as installed
from pathlib import Path

from ..inside import save_figure, unknown, version, write_whole
from .rows import say_rows

SECTIONS = (
    *("kernels", "growth", "stand", "lidar", "sonar", "reverb", "series", "flight"),
    *("dataset", "cluster", "waiting", "frontier"),
)
ON_REQUEST = ("peers",)  # what needs other programs, in ``others``


def run(names: Sequence[str], folder: Path, docs: Path | None = None) -> None:
    """Run sections in order, print their tables, draw their pictures into a folder.

    docs : the folder of the documentation, whose benchmarks.md gets the sections as they are measured.
    """

    known = SECTIONS + ON_REQUEST
    for name in names:
        if name not in known:
            raise unknown("bench", name, known)
    for name in names or SECTIONS:
        section = importlib.import_module(f".{name}", __package__)
        said = [f"## {section.TITLE}", ""]

        def say(text: str, said: list[str] = said) -> None:
            print(text, flush=True)
            said.append(text)

        print(f"\n{said[0]}\n", flush=True)
        started = time.perf_counter()
        told, figure = {}, None
        if hasattr(section, "ROWS"):
            say(section.WORDS)
            told = say_rows(say, name, section.ROWS)
        if hasattr(section, "run"):
            figure = section.run(say, told)
        say(f"\nMeasured on {machine()}; the section took {time.perf_counter() - started:.0f} s.")
        if figure is not None:
            folder.mkdir(parents=True, exist_ok=True)
            drawn = save_figure(figure, folder / f"{name}.png")
            print(f"\nDrawn in {drawn}", flush=True)
            picture = None if docs is None else docs / "pictures" / drawn.name
            if picture is not None and picture.exists():  # those that the page shows
                write_whole(picture, drawn.read_bytes())
                said[2:2] = [f"![{section.TITLE}](pictures/{drawn.name})", ""]
        if docs is not None:
            page = docs / "benchmarks.md"
            text = with_section(page.read_text(encoding="utf-8"), "\n".join(said))
            write_whole(page, text)


def machine() -> str:
    """Processor, cores, system and versions, in a line."""
    model = platform.processor() or platform.machine()
    told = Path("/proc/cpuinfo")
    if told.is_file():
        named = re.search(r"(?m)^model name\s*: (.+)$", told.read_text(errors="replace"))
        model = named.group(1) if named else model
    try:
        blender = f"Blender {installed('bpy')}"
    except PackageNotFoundError:
        blender = "no Blender"
    return (
        f"{model}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}, "
        f"{blender}, Forest Sensing {version()}"
    )


def with_section(page: str, section: str) -> str:
    """The text of a page with this section in place of the one of its title, or at its end.

    section : from its line ``## title`` on. A title counts up to its colon.
    """
    name = section.split("\n", 1)[0].split(":")[0]
    parts = re.split(r"(?m)^(?=## )", page)
    new = section.strip() + "\n\n"
    same = [n for n, part in enumerate(parts) if part.split("\n", 1)[0].split(":")[0] == name]
    if same:
        parts[same[0]] = new
    else:
        parts[-1] = parts[-1].rstrip() + "\n\n"
        parts.append(new)
    return "".join(parts).rstrip() + "\n"
