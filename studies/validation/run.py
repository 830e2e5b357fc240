"""Run validations: print their tables; keep each as JSON, Markdown and pictures in its own folder."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import time
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from forest_addon.base.progress import Say
from forest_addon.formats.atomic import replacing
from forest_addon.spec import SpecError, unknown

from .comparison import Comparison, as_record, from_record
from .page import Subject, copy_pictures, page_text, part_text

SECTIONS = ("reverb", "lidar", "stand", "leaves", "trees", "wind")  # in the order of the page
PARTS = (*SECTIONS, "training", "ablations", "tasks")  # the last three are made by ``study``
KEPT = "validation.json"


def run_sections(
    names: Sequence[str], arguments: argparse.Namespace, out: Path, say: Say = print
) -> list[Subject]:
    """Validate the named subjects, all if none is named; returns what each says.

    Raises
    ------
    SpecError : a name is unknown, or the folder of measurements is not there.
    """
    wanted = tuple(names) or SECTIONS
    for name in wanted:
        if name not in SECTIONS:
            raise unknown("validate", name, SECTIONS)
    data = find_data(arguments.data, own=bool(arguments.file))
    parts = []
    for name in wanted:
        module = _module(name)
        if module is None:
            say(f"\n{name}: not in this version")
            continue
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        began = time.process_time()
        comparisons = module.validate(data, folder, arguments)
        part = Subject(
            name,
            module.TITLE,
            f"Measured: {arguments.file}. Simulated: {arguments.scene}.\n"
            if arguments.file
            else getattr(module, "SUMMARY", ""),
            "" if arguments.file else getattr(module, "TERMS", ""),
            tuple(comparisons),
        )
        keep_subject(part, folder)
        tell_subject(part, time.process_time() - began, say)
        parts.append(part)
    if arguments.docs:
        say(f"\nWrote {write_page(out, arguments.docs)}.")
    return parts


def find_data(given: Path | None, own: bool = False) -> Path:
    """The folder of measurements: as given, else ``measured``.

    own : a file of the user's own is judged, which needs no folder.

    Raises
    ------
    SpecError : there is no such folder.
    """
    folder = Path(given or "measured")
    if not folder.is_dir() and not own:
        raise SpecError(
            "--data",
            f"{folder} is no folder; give that of the measurements (docs/validation.md says "
            f"which files), or set FOREST_MEASURED",
        )
    return folder


def write_page(out: Path, docs: Path) -> Path:
    """All subjects as one page, pictures below it; returns the page.

    What is in ``out`` replaces what the page was last made of, which is kept beside it in ``validation/``:
    one subject can be run anew alone.
    """
    kept, pictures = docs / "validation", docs / "pictures" / "validation"
    kept.mkdir(parents=True, exist_ok=True)
    parts = []
    for name in PARTS:
        new, old = out / name / KEPT, kept / f"{name}.json"
        if new.is_file():
            copy_pictures(_read(new, new.parent), pictures)
            with replacing(old) as written:
                written.write_bytes(new.read_bytes())
        if old.is_file():
            parts.append(_read(old, pictures))
    page = docs / "validation.md"
    with replacing(page) as written:
        written.write_text(page_text(parts, "pictures/validation"), encoding="utf-8")
    return page


def _read(file: Path, pictures: Path) -> Subject:
    kept = json.loads(file.read_text(encoding="utf-8"))
    comparisons = tuple(from_record(record, pictures) for record in kept.pop("comparisons"))
    return Subject(**kept, comparisons=comparisons)


def _module(name: str) -> ModuleType | None:
    """The module of a subject; None where this version has none."""
    whole = f"{__package__}.{name}"
    return importlib.import_module(whole) if importlib.util.find_spec(whole) else None


def keep_subject(part: Subject, folder: Path) -> None:
    """Write a subject as JSON and Markdown into a folder, where ``write_page`` finds it."""
    folder.mkdir(parents=True, exist_ok=True)
    record = {
        "name": part.name,
        "title": part.title,
        "summary": part.summary,
        "terms": part.terms,
        "comparisons": [as_record(c) for c in part.comparisons],
    }
    with replacing(folder / KEPT) as written:
        written.write_text(
            json.dumps(record, indent=1, ensure_ascii=False, default=lambda v: v.item()),
            encoding="utf-8",
        )
    with replacing(folder / "validation.md") as written:
        written.write_text(part_text(part, ""), encoding="utf-8")


def tell_subject(part: Subject, seconds: float, say: Say) -> None:
    """Say a subject's table, and what does not agree."""
    say(f"\n{part.title} ({seconds:.0f} CPU s)")
    rows = [_row(c) for c in part.comparisons]
    head = ("", "measured", "simulated", "")
    width = [max(len(row[k]) for row in [head, *rows]) for k in range(4)]
    for row in [head, *rows]:
        say("  " + "  ".join(text.ljust(w) for text, w in zip(row, width, strict=True)).rstrip())
    for comparison in part.comparisons:
        if comparison.agrees is False and comparison.words:
            say(f"  {comparison.quantity}: {comparison.words}")


def _row(c: Comparison) -> tuple[str, str, str, str]:
    return (
        f"{c.quantity}, {c.unit}" if c.unit else c.quantity,
        c.measured.text() if c.measured else "not measured",
        c.simulated.text() if c.simulated else "-",
        c.verdict,
    )
