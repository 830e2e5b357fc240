"""Numbers as text against Python's own formatting; texts that spreadsheets would take for formulas."""

import csv

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.formats.table import unquoted, write_csv, write_numbers
from forest_addon.formats.tree_map import read_tree_map


def test_numbers_are_as_python_writes_them(tmp_path):
    rng = stream(1, "digits")
    columns = {
        "whole": rng.integers(-(10**12), 10**12, 500),
        "small": rng.integers(0, 10, 500).astype(np.int8),
        "metres": rng.normal(0, 1e3, 500),
        "tiny": rng.normal(0, 1e-3, 500),
        "none": np.zeros(500),
    }
    columns["metres"][:6] = [0.0, -0.0, 0.00004, -0.00004, 99999.99996, -1.0]
    decimals = {"metres": 4, "tiny": 6, "none": 2}
    write_numbers(tmp_path / "x.csv", columns, decimals)
    lines = (tmp_path / "x.csv").read_text().splitlines()
    assert lines[0] == "whole,small,metres,tiny,none"
    for number, line in enumerate(lines[1:]):
        for (name, values), text in zip(columns.items(), line.split(","), strict=True):
            wanted = f"{values[number]:.{decimals.get(name, 0)}f}"
            if float(wanted) == 0:
                wanted = wanted.lstrip("-")
            assert text == wanted


def test_many_rows_and_none(tmp_path):
    write_numbers(tmp_path / "many.csv", {"n": np.arange(45_000)}, {})
    assert np.array_equal(np.loadtxt(tmp_path / "many.csv", skiprows=1), np.arange(45_000))
    write_numbers(tmp_path / "none.csv", {"a": np.empty(0), "b": np.empty(0, int)}, {})
    assert (tmp_path / "none.csv").read_text() == "a,b\n"


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_what_is_no_number_is_refused(tmp_path, bad):
    with pytest.raises(ValueError, match="length"):
        write_numbers(tmp_path / "x.csv", {"length": np.array([1.0, bad])}, {"length": 3})
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize(
    "text", ["=1+1", "+a", "@sum", "'=x", "''@y", "'plain", "-3", "+3", "a=b", ""]
)
def test_a_text_that_would_be_a_formula_is_none_and_comes_back(tmp_path, text):
    path = tmp_path / "t.csv"
    write_csv(path, {"x": [-3.0], "y": [2], "species": [text]})
    with open(path, newline="", encoding="utf-8") as file:
        x, y, cell = list(csv.reader(file))[1]
    assert (x, y) == ("-3.0", "2")
    assert not cell.startswith(("=", "+", "@")) or cell == "+3"
    assert unquoted(cell) == text
    assert read_tree_map(path).species.tolist() == [text]
