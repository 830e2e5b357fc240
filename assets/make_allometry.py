"""Fits assets/allometry anew. Run: python assets/make_allometry.py baad_trees.csv pytreedb.csv

Laws of height, crown width and leaf area are those of BAAD (Falster et al. 2015, Ecology 96:1445; CC0). Bases
of crowns are also those of trees of pytreedb (Weiser et al. 2022, Earth Syst. Sci. Data 14:2989), which were
measured on point clouds of closed mixed stands; the median counts where a tree was measured several times.
A plot of them is a study. So are crown widths of firs and of deciduous broadleaves: BAAD has those of thin
American and Japanese firs alone, and silver firs are wider; of its 1,096 broadleaves with a width 1,070 are
evergreens of the tropics.
"""

import csv
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.formats.toml_file import write_settings
from forest_addon.growth.library import file_stem, read_measured
from forest_addon.growth.measured.allometry import KINDS, fit_kind
from forest_addon.spec import Allometry

FOLDER = Path(__file__).with_name("allometry")
SOURCE = (
    "BAAD, a biomass and allometry database (Falster et al. 2015, Ecology 96:1445; CC0), trees over 2 m; "
    "crown bases also of pytreedb (Weiser et al. 2022, Earth Syst. Sci. Data 14:2989); fitted by "
    "assets/make_allometry.py"
)
NUMBERS = ("height_m", "dbh_cm", "crown_base_m")
WIDTH = "crown_diameter_m"
WIDTHS_TOGETHER = ("Abies", *(kind for kind, of in KINDS.items() if of == "DA"))
CONIFERS = {"Pinus": "EG", "Abies": "EG", "Picea": "EG", "Tsuga": "EG", "Larix": "DG"}


def medians(table: Path) -> list[dict[str, object]]:
    """Trees of pytreedb as rows of BAAD's table: of each quantity the median of what was measured."""
    measured: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    species: dict[str, str] = {}
    with open(table, newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            species[row["tree"]] = row["species"]
            for key in (*NUMBERS, WIDTH):
                if row[key] and float(row[key]) > 0:
                    measured[row["tree"]][key].append(float(row[key]))
    rows: list[dict[str, object]] = []
    for tree, found in measured.items():
        value = {key: float(np.median(values)) for key, values in found.items() if values}
        if value.keys() >= set(NUMBERS):
            of = species[tree]
            rows.append(
                {
                    "study": "pytreedb " + "_".join(tree.split("_")[1:]),
                    "species": of,
                    "pft": CONIFERS.get(of.split()[0], "DA"),
                    "height_m": value["height_m"],
                    "dbh_m": round(value["dbh_cm"] / 100, 4),
                    "crown_base_m": value["crown_base_m"],
                    "crown_width_m": value.get(WIDTH, ""),
                }
            )
    return rows


def fitted(baad: Path, clouds: Path) -> Iterator[Allometry]:
    """Return every kind as it is fitted to the two tables."""
    with open(baad, newline="", encoding="utf-8") as file:
        rows: list[dict[str, object]] = list(csv.DictReader(file))
    with tempfile.TemporaryDirectory() as folder:
        both = Path(folder) / "both.csv"
        with open(both, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows + medians(clouds))
        alone, together = read_measured(baad), read_measured(both)
    for kind in KINDS:
        law, more = (fit_kind(kind, table, SOURCE) for table in (alone, together))
        law = replace(law, crown_base=more.crown_base)
        if kind in WIDTHS_TOGETHER:
            source = SOURCE.replace("crown bases", "crown bases and widths")
            law = replace(law, crown_width=more.crown_width, source=source)
        yield law


if __name__ == "__main__":
    for kind in fitted(*map(Path, sys.argv[1:3])):
        write_settings(FOLDER / f"{file_stem(kind.name)}.toml", kind)
