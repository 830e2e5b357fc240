"""The rows of Méndez et al.'s experiment, and the two files that grow with every orchard that is finished."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from forest_addon.formats.table import write_csv
from forest_addon.spec import SpecError

from .orchards import Orchard


@dataclass(frozen=True)
class OrchardFinding:
    """A row of orchards.csv: what was asked for, down to the engine, and what came out (times: CPU s)."""

    iterations: int
    trees: int
    smallest_m: float
    pruned: bool
    stochastic: bool
    seed: int
    internode_m: float
    gap: int
    engine: str
    branches: int
    triangles: int
    scans: int
    beams: int
    volume_m3: float
    area_m2: float
    projected_m2: float
    impacted_m2: float
    impacted_solid_m2: float
    impacted_eq14_m2: float
    hits: int
    hits_solid: int
    build_s: float
    scan_s: float
    scan_solid_s: float

    @property
    def orchard(self) -> Orchard:
        """Return which one it is."""
        return Orchard(self.iterations, self.trees, self.smallest_m, self.pruned, self.stochastic)


@dataclass(frozen=True)
class TreeFinding:
    """A row of trees.csv: one tree of one orchard."""

    iterations: int
    trees: int
    smallest_m: float
    pruned: bool
    stochastic: bool
    tree: int
    branches: int
    volume_m3: float
    area_m2: float
    projected_m2: float
    impacted_m2: float
    impacted_solid_m2: float

    @property
    def orchard(self) -> Orchard:
        """Return which orchard it stands in."""
        return Orchard(self.iterations, self.trees, self.smallest_m, self.pruned, self.stochastic)


class FinishedOrchards:
    """The rows of orchards that are finished, in two files that grow orchard by orchard."""

    def __init__(self, out: Path) -> None:
        self._orchards, self._trees = out / "orchards.csv", out / "trees.csv"
        self.rows = read_rows(self._orchards, OrchardFinding)
        finished = {row.orchard for row in self.rows}
        self._tree_rows = [
            row for row in read_rows(self._trees, TreeFinding) if row.orchard in finished
        ]

    def find(
        self, orchard: Orchard, seed: int, internode: float, gap: int, engine: str
    ) -> OrchardFinding | None:
        """The row of an orchard that was done with these settings."""
        for row in self.rows:
            same = (row.orchard, row.seed, row.internode_m, row.gap) == (
                *(orchard, seed, internode, gap),
            )
            if same and engine in ("auto", row.engine):
                return row
        return None

    def add(self, row: OrchardFinding, trees: Sequence[TreeFinding]) -> None:
        """Write an orchard, in place of one that was done with other settings."""
        self._tree_rows = [t for t in self._tree_rows if t.orchard != row.orchard] + list(trees)
        self.rows = [r for r in self.rows if r.orchard != row.orchard] + [row]
        _write(self._trees, TreeFinding, self._tree_rows)
        _write(self._orchards, OrchardFinding, self.rows)  # last: what stands here is finished


def _write(path: Path, kind: type, rows: Sequence[object]) -> None:
    write_csv(path, {f.name: [getattr(row, f.name) for row in rows] for f in fields(kind)})


def read_rows(path: Path, kind: type) -> list:
    """Rows of a file of ours, none where there is no file.

    Raises
    ------
    SpecError : it is not such a file.
    """
    if not path.is_file():
        return []
    readers = {
        "int": int,
        "float": float,
        "str": str,
        "bool": {"True": True, "False": False}.__getitem__,
    }
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return [
                kind(**{f.name: readers[str(f.type)](line[f.name]) for f in fields(kind)})
                for line in csv.DictReader(file)
            ]
    except (KeyError, ValueError, TypeError, csv.Error):
        raise SpecError(
            str(path), "is not of this experiment; remove it, or choose another --out"
        ) from None
