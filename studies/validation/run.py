"""Comparisons of a validation: a quantity, as measured and as simulated, each with an interval, and a
verdict."""

from __future__ import annotations

import argparse
import importlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.api import SpecError

from ..inside import Say, unknown, write_whole


@dataclass(frozen=True)
class Interval:
    """A value with the interval that it was measured to; low and high None where nobody knows."""

    value: float
    low: float | None = None
    high: float | None = None

    @staticmethod
    def of(values: np.ndarray, level: float = 0.9) -> Interval:
        """Median of values, and the quantiles that hold ``level`` of them."""
        edge = (1 - level) / 2
        low, middle, high = np.quantile(values, [edge, 0.5, 1 - edge])
        return Interval(float(middle), float(low), float(high))

    @staticmethod
    def mean(values: np.ndarray, errors: float = 1.96) -> Interval:
        """Mean of values, and what lies within so many standard errors of it: 95 % as it stands."""
        middle, half = values.mean(), errors * values.std(ddof=1) / np.sqrt(len(values))
        return Interval(float(middle), float(middle - half), float(middle + half))

    def meets(self, other: Interval) -> bool:
        """Return whether the intervals overlap; a value without an interval is a point."""
        (low, high), (least, most) = (
            (each.value, each.value) if each.low is None else (each.low, each.high)
            for each in (self, other)
        )
        return low <= most and least <= high

    def text(self) -> str:
        """The value as a table shows it."""
        if self.low is None or self.high is None:
            return _number(self.value)
        return f"{_number(self.value)} ({_number(self.low)} to {_number(self.high)})"


@dataclass(frozen=True)
class Picture:
    """A drawn file and the sentence below it."""

    file: Path
    words: str


VERDICTS = AGREES, DIFFERS, UNTOLD, UNJUDGED = "agrees", "does not agree", "not told apart", "-"
BLIND = 0.5  # relative difference that a row has to be able to tell


@dataclass(frozen=True)
class Comparison:
    """One quantity beside its measurement.

    agrees : None where nothing was promised, or nothing was measured.
    before : what was simulated before the model was mended, where it was.
    """

    quantity: str
    unit: str
    measured: Interval | None
    simulated: Interval | None
    agrees: bool | None
    words: str = ""
    before: Interval | None = None
    pictures: tuple[Picture, ...] = ()

    @property
    def power(self) -> float | None:
        """Relative difference from which on these intervals would no longer overlap; None where they are not
        both known. Intervals of 90 % that just do not overlap differ at about the level of 2 %."""
        both = [each for each in (self.measured, self.simulated) if each and each.low is not None]
        size = max((abs(each.value) for each in both), default=0.0)
        if len(both) < 2 or size == 0:
            return None
        return sum((each.high or 0.0) - (each.low or 0.0) for each in both) / 2 / size

    @property
    def verdict(self) -> str:
        """The verdict in a word: intervals that any likely value would overlap are no agreement."""
        if self.agrees and self.power is not None and self.power > BLIND:
            return UNTOLD
        return {True: AGREES, False: DIFFERS, None: UNJUDGED}[self.agrees]


def _number(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    if abs(value) < 1e-6:
        return "0"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


# Comparisons in Markdown: a part a subject, and all parts as one page of the documentation.


HEAD = """\
# How real

Each sensor, and each way to grow and plant trees, compared with measurements of real forests. *Agrees*
means that intervals overlap, or what the row says; *not told apart*, that they overlap and would still do
so if the two differed by half. The last column is the difference that a row can detect: beyond it the
intervals (90 % where nothing else is said) no longer overlap. Tables show what was judged, and words below
them explain what does not agree or cannot be told. Rows without a verdict and words on what agrees are in
`docs/validation/*.json`. `python -m studies --force validate --data FOLDER --docs docs` writes this page.
"""
TAIL = """\
## What was not measured

- **Sonar.** No echoes of foliage with its leaves' positions were at hand, and none of an animal's band; the
  leaf itself is held to exact waves on discs and facets ([sonar](sonar.md)).
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
    """The rows of a Markdown table; that of a simpler model only where there is one."""
    before = any(c.before for c in comparisons)
    names = [
        "quantity",
        "measured",
        *(["simpler model"] if before else []),
        "simulated",
        "verdict",
        "tells",
    ]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    for c in comparisons:
        quantity = f"{c.quantity}, {c.unit}" if c.unit else c.quantity
        columns = [quantity, c.measured.text() if c.measured else "not measured"]
        if before:
            columns.append(c.before.text() if c.before else "")
        tells = "" if c.power is None else f"{c.power:.0%}"
        columns += [c.simulated.text() if c.simulated else "", c.verdict, tells]
        lines.append("| " + " | ".join(column.replace("|", "\\|") for column in columns) + " |")
    return lines


def part_text(part: Subject, pictures: str) -> str:
    """A subject's part of the page: its rows that were judged, with words on those that do not agree.

    pictures : the folder of its pictures, from where the text is kept; empty: beside it, with all rows and
    words.
    """
    shown = [c for c in part.comparisons if not pictures or c.agrees is not None]
    shown = shown or list(part.comparisons)
    lines = [f"## {part.title}", ""]
    if part.summary:
        lines += [part.summary.strip(), ""]
    lines += [*table_of(shown), ""]
    said = [
        f"- **{c.quantity}.** {c.words}"
        for c in shown
        if c.words
        and not (pictures and (c.verdict == AGREES or c.words.startswith("Agrees within")))
    ]
    if said:
        lines += [*said, ""]
    where = f"{pictures}/" if pictures else ""
    for picture in {p.file: p for c in part.comparisons for p in c.pictures}.values():
        lines += [f"![]({where}{picture.file.name})", "", picture.words, ""]
    if part.terms:
        lines += [part.terms.strip(), ""]
    return "\n".join(lines)


def page_text(parts: Sequence[Subject], pictures: str) -> str:
    """The whole page."""
    counts = np.array(
        [[sum(c.verdict == v for c in part.comparisons) for v in VERDICTS] for part in parts]
    )
    agree, disagree, untold, _ = counts.sum(axis=0)
    overview = [
        "| | agree | do not | not told apart | not judged |",
        "|---|---|---|---|---|",
        *(
            f"| {p.title} | {' | '.join(map(str, row))} |"
            for p, row in zip(parts, counts, strict=True)
        ),
    ]
    said = (
        f"Of {agree + disagree + untold} quantities that were judged, {agree} agree, {disagree} do not and "
        f"{untold} cannot be told apart."
    )
    texts = [HEAD, said + "\n", "\n".join(overview) + "\n"]
    return "\n".join([*texts, *(part_text(part, pictures) for part in parts), TAIL])


def copy_pictures(part: Subject, folder: Path) -> None:
    """Put a part's pictures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for comparison in part.comparisons:
        for picture in comparison.pictures:
            write_whole(folder / picture.file.name, picture.file.read_bytes())


# Run validations: print their tables; keep each as JSON, Markdown and pictures in its own folder.


SECTIONS = (
    "reverb",
    "sonar",
    "lidar",
    "instruments",
    "stand",
    "leaves",
    "trees",
    "wind",
)  # in the order of the page
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
        module = importlib.import_module(f".{name}", __package__)
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
            write_whole(old, new.read_bytes())
        if old.is_file():
            parts.append(_read(old, pictures))
    page = docs / "validation.md"
    write_whole(page, page_text(parts, "pictures/validation"))
    return page


def _read(file: Path, pictures: Path) -> Subject:
    """A subject as it was kept, its pictures in a folder."""
    kept = json.loads(file.read_text(encoding="utf-8"))
    comparisons = []
    for record in kept.pop("comparisons"):
        for name in ("measured", "simulated", "before"):
            record[name] = Interval(**record[name]) if record[name] else None
        drawn = (Picture(pictures / one["file"], one["words"]) for one in record["pictures"])
        comparisons.append(Comparison(**(record | {"pictures": tuple(drawn)})))
    return Subject(**kept, comparisons=tuple(comparisons))


def keep_subject(part: Subject, folder: Path) -> None:
    """Write a subject as JSON and Markdown into a folder, where ``write_page`` finds it."""
    folder.mkdir(parents=True, exist_ok=True)
    record = json.dumps(asdict(part), indent=1, ensure_ascii=False, default=_plain)
    write_whole(folder / KEPT, record)
    write_whole(folder / "validation.md", part_text(part, ""))


def _plain(value: Path | np.generic) -> Any:
    """A picture by its name, a number of numpy as one of Python."""
    return value.name if isinstance(value, Path) else value.item()


def tell_subject(part: Subject, seconds: float, say: Say) -> None:
    """Say a subject's table, and what does not agree."""
    say(f"\n{part.title} ({seconds:.0f} CPU s)\n")
    for line in table_of(part.comparisons):
        say(line)
    for comparison in part.comparisons:
        if comparison.agrees is False and comparison.words:
            say(f"\n{comparison.quantity}: {comparison.words}")
