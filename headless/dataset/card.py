"""The data card: README.md of a dataset, its contact sheet, histograms of what varied, and a loader.

All of it is read from the folders of the scenes and their records, so it says what is there, not what was
meant.
"""

from __future__ import annotations

import html
import importlib.metadata
import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forest_addon.formats.atomic import replacing

from ..progress import plain
from . import disk
from .convert.legend import write_names
from .labels import FILES, LIMITS
from .plan import SPLITS, Plan, Recipe

LOADER = Path(__file__).parent / "convert" / "loader.py"  # read, never imported here
LEGEND = "legend.csv"
CARD = ("README.md", "loader.py", LEGEND, "overview.png", "varied.png")
PACKAGES = ("forest-sensing", "bpy", "numpy", "scipy", "laspy", "lazrs")


def write_card(plan: Plan, wanted: Sequence[Recipe], root: Path) -> None:
    """Write README.md, loader.py, legend.csv, overview.png and varied.png of a dataset."""
    done = list(disk.scenes_done(root))
    with replacing(root / "loader.py") as text:
        text.write_bytes(LOADER.read_bytes())
    write_names(root / LEGEND)
    if done:
        from .overview import draw_overview, draw_varied

        draw_overview(done, plan.head.seed, root / "overview.png")
        draw_varied(done, root / "varied.png")
    with replacing(root / "README.md") as text:
        text.write_text(card_text(plan, wanted, done), encoding="utf-8")


def card_text(plan: Plan, wanted: Sequence[Recipe], done: Sequence[disk.Done]) -> str:
    """The text of README.md."""
    records = [one.record for one in done]
    points = sum(sum(record["points"].values()) for record in records)
    species = sorted({name for record in records for name in record["species"]})
    lost = len(wanted) - len(done)
    lines = [
        f"# {_text(plan.head.name)}",
        "",
        f"{len(done):,} of {len(wanted):,} scenes of a simulated forest, with the truth of every tree"
        + (f"; {lost} could not be made (manifest.csv says why)" if lost > 0 else "")
        + ".",
        "",
        "![Some scenes](overview.png)",
        "",
        "| | |",
        "|---|---|",
        f"| trees | {sum(record['trees'] for record in records):,} |",
        f"| leaves | {sum(record['leaves'] for record in records):,} |",
        f"| leaf area | {sum(record['leaf_area_m2'] for record in records):,.0f} m² |",
        f"| species | {_text(', '.join(species)) or 'none'} |",
        f"| points | {points:,} |",
        *_what_is_empty(records),
        f"| size | {sum(one.size for one in done) / 1e9:.2f} GB |",
        *(
            f"| {split} | {sum(r['split'] == split for r in records):,} scenes |"
            for split in SPLITS
        ),
        f"| licence | {_text(plan.head.licence)} |",
        "",
        "## How it was made",
        "",
        f"Forest Sensing, plan `{_code(plan.path.name)}` (`plan.toml` is the plan as it was used), seed "
        f"{plan.head.seed}, "
        f"trees: {plan.head.trees}. {_shared(plan, records)}",
        "",
        "Made with " + ", ".join(f"{name} {number}" for name, number in versions().items()) + ".",
        "",
        *_what_varied(plan),
        "## What a scene's folder holds",
        "",
        *(f"- `{name}`: {what}" for name, what in FILES.items() if _is_there(name, records)),
        "",
        "![What varied](varied.png)",
        "",
        "`loader.py` reads scenes and clouds by number; `legend.csv` explains every column, array and field; "
        "`manifest.csv` has a row a scene, `splits/` names the scenes "
        "of each "
        "split.",
        "",
        "## Known limits",
        "",
        *(f"- {limit}" for limit in LIMITS),
        "",
    ]
    return "\n".join(lines)


def _what_is_empty(records: Sequence[dict[str, Any]]) -> list[str]:
    """A row that counts results without a point or an echo, and scenes without a tree."""
    whys = [why for record in records for why in record.get("empty", {}).values()]
    return [f"| empty | {len(whys):,} results; first: {_text(whys[0])} |"] if whys else []


def _text(words: str) -> str:
    """Words as Markdown shows them: no tag, no link, no cell of their own."""
    shown = html.escape(" ".join(plain(words).split()), quote=False)
    return re.sub(r"[|`*\[\]\\]", lambda found: f"&#{ord(found[0])};", shown)


def _code(words: str) -> str:
    """Words between backticks of a table: an entity would be shown as it is."""
    return " ".join(plain(words).replace("`", "'").replace("|", "\\|").split())


def _is_there(pattern: str, records: Sequence[dict[str, Any]]) -> bool:
    ending = pattern.replace("NAME", "").replace("*", "")
    return any(name.endswith(ending) for record in records for name in record["files"]) or (
        ending == disk.RECORD
    )


def _what_varied(plan: Plan) -> list[str]:
    if not plan.varied:
        return []
    rows = []
    for one in plan.varied:
        values, design = (
            _text(f"{one.kind} {one.given}"),
            one.design if one.kind != "grid" else "grid",
        )
        rows.append(f"| `{_code(one.path)}` | {values} | {design} |")
    return ["## What varied", "", "| key | values | design |", "|---|---|---|", *rows, ""]


def shared_trees(records: Sequence[dict[str, Any]]) -> int:
    """Return how many grown trees stand in scenes of more than one split."""
    splits: dict[str, set[str]] = {}
    for record in records:
        for digest in record["variants"].values():
            splits.setdefault(digest, set()).add(record["split"])
    return sum(len(found) > 1 for found in splits.values())


def _shared(plan: Plan, records: Sequence[dict[str, Any]]) -> str:
    count = shared_trees(records)
    if not count:
        return "No two splits share a grown tree."
    meant = (
        "as the plan says" if plan.splits.share_trees else "because their species know no chance"
    )
    return f"{count} grown trees stand in scenes of more than one split, {meant}."


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the bytes, by name."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found
