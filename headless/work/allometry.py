"""Fit the allometry of kinds of trees to a table, write their files, say what was found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forest_addon.formats.allometry_file import file_stem, read_measured
from forest_addon.formats.toml_file import write_settings
from forest_addon.growth.measured.allometry import MEASURES, band
from forest_addon.growth.measured.fit import KINDS, fit_kind


def fit_table(table: Path, kinds: Sequence[str], source: str, out: Path) -> None:
    """Fit every kind and write its file into ``out``.

    Raises
    ------
    SpecError : the table cannot be used; a kind is not in it.
    """
    measured = read_measured(table)
    out.mkdir(parents=True, exist_ok=True)
    print(
        f"{'kind':22} {'trees':>17}  90 % at its middle diameter: height m, width m, base m, leaves m²"
    )
    for kind in kinds or KINDS:
        fitted = fit_kind(kind, measured, source or table.name)
        write_settings(out / f"{file_stem(kind)}.toml", fitted)
        trees = "/".join(str(getattr(fitted, name).trees) for name in MEASURES)
        dbh = float(np.sqrt(np.prod(fitted.height.dbh)))
        low, high = band(fitted, np.array([dbh]))[:, 0]
        spans = ", ".join(f"{a:.1f}-{b:.1f}" for a, b in zip(low, high, strict=True))
        lent = {getattr(fitted, name).of for name in MEASURES} - {""}
        note = f" (with {', '.join(sorted(lent))})" if lent else ""
        print(f"{kind:22} {trees:>17}  {dbh:.2f} m: {spans}{note}")
    print(f"Done: {len(kinds or KINDS)} files in {out}")
