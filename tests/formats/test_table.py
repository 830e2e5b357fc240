"""Numbers as text against Python's own formatting; texts that spreadsheets would take for formulas."""

import csv
import dataclasses
import os

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.formats.atomic import remove_partial_files, replacing
from forest_addon.formats.table import unquoted, write_csv, write_numbers
from forest_addon.formats.tree_map import read_tree_map
from forest_addon.results.kind import facts, words
from forest_addon.results.kinds import RESULTS, figures_of
from forest_addon.results.reverb import of_response
from forest_addon.sensing.reverb.channels import ImpulseResponse
from forest_addon.sensing.reverb.metrics import octave_bands
from forest_addon.spec import Reverb


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


# -------------------------------------------------------------------------------------------- atomic
# A file is whole or not there.


def test_a_good_block_leaves_the_file_and_nothing_else(tmp_path):
    with replacing(tmp_path / "a.txt") as partial:
        partial.write_text("new")
        assert not (tmp_path / "a.txt").exists()
        assert partial.suffix == ".txt"
    assert os.listdir(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"


@pytest.mark.parametrize("problem", [ValueError, KeyboardInterrupt, OSError])
def test_a_bad_block_leaves_the_old_file(tmp_path, problem):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(problem), replacing(tmp_path / "a.txt") as partial:
        partial.write_text("half")
        raise problem
    assert os.listdir(tmp_path) == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


@pytest.mark.parametrize("text", [None, ""])
def test_a_writer_that_wrote_nothing_is_an_error(tmp_path, text):
    with pytest.raises(OSError, match=r"a\.txt could not be written"):
        with replacing(tmp_path / "a.txt") as partial:
            if text is not None:
                partial.write_text(text)
    assert os.listdir(tmp_path) == []


def test_partial_files_can_be_removed_before_a_sudden_end(tmp_path):
    with (
        pytest.raises(OSError, match="could not be written"),
        replacing(tmp_path / "a.txt") as partial,
    ):
        partial.write_text("half")
        remove_partial_files()
        assert os.listdir(tmp_path) == []


# ------------------------------------------------------------------------------------------- figures
# Figures of a result: worded once, the same value in the report and in the panel.


def response(direct_clear=True, further=()):
    """A decay of 60 dB/s after an impulse."""
    time = np.arange(24_000) / 24_000
    decay = 10.0 ** (-3 * time)
    return ImpulseResponse(
        sample_rate=24_000.0,
        direct=np.where(time == 0, 1.0, 0.0),
        ground=np.zeros_like(time),
        trees=0.1 * decay,
        direct_delay=0.0,
        direct_clear=direct_clear,
        ground_clear=True,
        trunks=1234,
        continued=0,
        late=0,
        clamped=0,
        exact=True,
        left_db=np.full(1 + len(octave_bands(24_000.0)), -np.inf),
        errors={},
        further=further,
    )


def test_numbers_of_a_response():
    shown = facts(of_response(response(), trunks=5000))
    assert shown["trunks cut from the scene"] == "5,000"
    assert shown["trunks heard"] == "1,234"
    assert float(shown["reverberation time"].removesuffix(" s")) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("trunks", "continued", "stands", "said"),
    [
        (0, 0, 0, "no trunks heard"),
        (12, 0, 9, "12 stems of 9 trees heard"),
        (4492, 4472, 4481, "20 stems of 9 trees heard, and 4,472 trunks around the scene"),
        (4492, 4480, 4492, "4,492 trunks heard"),
        (12, 4, -1, "12 trunks heard"),
    ],
)
def test_trunks_beyond_the_scene_are_no_trees_of_it(trunks, continued, stands, said):
    of = {"trunks": trunks, "continued": continued, "stands": stands}
    assert RESULTS["reverb"].sentence(dataclasses.replace(response(), **of)) == said


def test_a_path_of_several_channels():
    blocked = dataclasses.replace(response(direct_clear=False), channel="other")
    found = figures_of(Reverb(), response(further=(blocked,)))
    (path,) = [each for each in found if each.name == "direct path"]
    assert path.text == "blocked by wood in 1 of 2"
    assert path.pattern.format(**path.values) == path.text
    assert facts(figures_of(Reverb(), blocked))["direct path"] == "blocked by wood"


def test_a_reverb_whose_tolerance_was_not_reached_is_warned_of():
    found = dataclasses.replace(response(), errors={20.0: 3e-4, 40.0: 1e-4})
    (warning,) = RESULTS["reverb"].doubts(Reverb(tolerance=1e-4), found)
    assert "3e-04 off from 20 to 40 Hz, where 1e-04 was asked for" in warning
    assert RESULTS["reverb"].doubts(Reverb(tolerance=1e-3), found) == ()


def test_a_record_shorter_than_its_reverberation_time_tells_none():
    """A decay of 60 dB a second, of which 0.3 s are recorded, tells more than it lasts."""
    short = dataclasses.replace(
        response(),
        **{part: getattr(response(), part)[:7200] for part in ("direct", "ground", "trees")},
    )
    told = RESULTS["reverb"].doubts(Reverb(duration=0.3), short)
    assert len(told) == 1
    assert "the record of 0.3 s is shorter" in told[0]
    assert facts(figures_of(Reverb(duration=0.3), short))["reverberation time"] == "not reached"
    assert RESULTS["reverb"].doubts(Reverb(duration=0.0), short) == ()
    assert "s" in facts(figures_of(Reverb(duration=0.0), short))["reverberation time"].split()
    assert RESULTS["reverb"].doubts(Reverb(duration=1.5), response()) == ()


def test_the_tail_says_how_sure_its_level_is():
    error = np.array([np.nan, 5.25, *np.full(len(octave_bands(24_000.0)) - 2, 0.3)])
    found = of_response(dataclasses.replace(response(), tail_error=error))
    assert facts(found)["standard error of the tail's level by octave"].startswith("62.5 Hz 5.2 dB")
    (shown,) = [each.text for each in found if each.short == "Tail Error"]
    assert shown == "5.2 dB at 62.5 Hz"
    assert "Tail Error" not in [each.short for each in of_response(response())]


def test_no_name_twice():
    error = np.ones(len(octave_bands(24_000.0)))
    found = of_response(dataclasses.replace(response(), tail_error=error), trunks=1)
    for names in ([each.name for each in found], [each.short for each in found]):
        named = [name for name in names if name]
        assert len(named) == len(set(named))


def test_braces_in_a_text_stay():
    assert words("a", "A", "as {it} is").text == "as {it} is"
    assert words("a", "A", "{n:,} of them", n=1200).text == "1,200 of them"
