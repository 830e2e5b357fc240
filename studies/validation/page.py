"""Comparisons in Markdown: a part a subject, and all parts as one page of the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forest_addon.formats.atomic import replacing

from .comparison import Comparison

HEAD = """\
# How real

Each sensor and each way to grow and plant, held to measurements of real forests. The page is written by
`python -m studies validate --data FOLDER --docs docs`; each part names its measurements. *Agrees* means
that intervals overlap, or what a row says. What does not agree stands here like what does.
"""
TAIL = """\
## What was not measured

- **Sonar.** No echoes of foliage with its leaves' positions were at hand; the echo model is held to exact
  waves on discs and facets ([sonar](sonar.md)), not to an animal's recording.
- **Intensity of LiDAR** in absolute units: the clouds give digital numbers without calibration.
- **Rain and moving leaves**, and how wind changes a scan from one time to the next.
- **Bark**: its roughness, and its reflectance at the wavelengths of scanners.
"""


@dataclass(frozen=True)
class Subject:
    """Subject of a validation: its title, sentences before and after the table, and comparisons."""

    name: str
    title: str
    summary: str
    terms: str
    comparisons: tuple[Comparison, ...]


def table_of(comparisons: Sequence[Comparison]) -> list[str]:
    """The rows of a Markdown table; the column *before* only where something was mended."""
    before = any(c.before for c in comparisons)
    names = ["quantity", "measured", *(["before"] if before else []), "simulated", "verdict"]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for c in comparisons:
        quantity = f"{c.quantity}, {c.unit}" if c.unit else c.quantity
        columns = [quantity, c.measured.text() if c.measured else "not measured"]
        if before:
            columns.append(c.before.text() if c.before else "")
        columns += [c.simulated.text() if c.simulated else "", c.verdict]
        lines.append("| " + " | ".join(column.replace("|", "\\|") for column in columns) + " |")
    return lines


def part_text(part: Subject, pictures: str) -> str:
    """A subject's part of the page.

    pictures : the folder of its pictures, from where the text is kept; empty: beside it.
    """
    lines = [f"## {part.title}", ""]
    if part.summary:
        lines += [part.summary.strip(), ""]
    lines += [*table_of(part.comparisons), ""]
    said = [f"- **{c.quantity}.** {c.words}" for c in part.comparisons if c.words]
    if said:
        lines += [*said, ""]
    where = f"{pictures}/" if pictures else ""
    for picture in {p.path: p for c in part.comparisons for p in c.pictures}.values():
        lines += [f"![]({where}{picture.path.name})", "", picture.words, ""]
    if part.terms:
        lines += [part.terms.strip(), ""]
    return "\n".join(lines)


def page_text(parts: Sequence[Subject], pictures: str) -> str:
    """The whole page."""
    every = [c for part in parts for c in part.comparisons]
    agree, disagree = (sum(c.agrees is wanted for c in every) for wanted in (True, False))
    overview = [
        "| | agree | do not | not judged |",
        "|---|---|---|---|",
        *(_row(part) for part in parts),
    ]
    said = (
        f"Of {agree + disagree} quantities that were judged, {agree} agree and {disagree} do not."
    )
    texts = [HEAD, said + "\n", "\n".join(overview) + "\n"]
    return "\n".join([*texts, *(part_text(part, pictures) for part in parts), TAIL])


def _row(part: Subject) -> str:
    counts = [sum(c.agrees is wanted for c in part.comparisons) for wanted in (True, False, None)]
    return f"| {part.title} | " + " | ".join(map(str, counts)) + " |"


def copy_pictures(part: Subject, folder: Path) -> None:
    """Put a part's pictures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for comparison in part.comparisons:
        for picture in comparison.pictures:
            with replacing(folder / picture.path.name) as partial:
                partial.write_bytes(picture.path.read_bytes())
