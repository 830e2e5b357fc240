"""The frame of ``validate``: what a subject returns is printed, kept whole, and joined to a page."""

import argparse
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from forest_addon.spec import SpecError
from studies.validation import run
from studies.validation.run import Comparison, Interval, Picture


def arguments(**given):
    plain = {"data": None, "file": None, "stand": None, "scene": None, "seed": 1, "docs": None}
    return argparse.Namespace(**(plain | given))


@pytest.fixture
def subject(monkeypatch):
    """A subject of its own in place of that of leaves, which draws a picture."""

    def validate(data, out, arguments):
        picture = out / "angles.png"
        picture.write_bytes(b"picture")
        return [
            Comparison(
                *("mean", "deg", Interval(34.0, 33.0, 35.0), Interval(36.0, 35.5, 37.0), False),
                words="it stands steeper",
                before=Interval(60.0),
                pictures=(Picture(picture, "Angles."),),
            ),
            Comparison("spread", "deg", None, Interval(20.0), None),
        ]

    module = ModuleType("studies.validation.leaves")
    module.TITLE, module.SUMMARY, module.validate = "Leaves", "How they face.", validate
    monkeypatch.setitem(sys.modules, module.__name__, module)


def test_what_is_kept_is_read_as_it_was(subject, tmp_path):
    said = []
    chosen = arguments(data=tmp_path, docs=tmp_path / "docs")
    chosen.docs.mkdir()
    parts = run.run_sections(["leaves"], chosen, tmp_path / "out", said.append)
    assert (
        run._read(tmp_path / "out" / "leaves" / run.KEPT, tmp_path / "out" / "leaves") == parts[0]
    )
    text = "\n".join(said)
    assert "mean, deg" in text
    assert "34 (33 to 35)" in text
    assert "it stands steeper" in text
    page = (chosen.docs / "validation.md").read_text(encoding="utf-8")
    assert "0 agree, 1 do not and 0 cannot" in page
    assert "pictures/validation/angles.png" in page
    assert (chosen.docs / "pictures" / "validation" / "angles.png").read_bytes() == b"picture"


def test_the_page_of_the_documentation_is_what_its_kept_parts_give(tmp_path):
    docs = Path(__file__).parents[3] / "docs"
    shutil.copytree(docs / "validation", tmp_path / "validation")
    page = run.write_page(tmp_path / "elsewhere", tmp_path)
    assert page.read_text(encoding="utf-8") == (docs / "validation.md").read_text(encoding="utf-8")


def test_what_cannot_be_asked_for(tmp_path):
    with pytest.raises(SpecError, match=r".leafs. is not known; did you mean .leaves.\?"):
        run.run_sections(["leafs"], arguments(data=tmp_path), tmp_path)
    with pytest.raises(SpecError, match="is no folder; give that of the measurements"):
        run.run_sections(["leaves"], arguments(data=tmp_path / "none"), tmp_path)


@pytest.mark.parametrize(
    ("measured", "simulated", "verdict"),
    [
        (Interval(10.0, 9.0, 11.0), Interval(10.5, 9.5, 11.5), run.AGREES),  # tells a fifth
        (Interval(17.9, 6.2, 23.9), Interval(8.02, 7.94, 9.0), run.UNTOLD),  # tells a half
        (Interval(10.0), Interval(10.5, 4.0, 17.0), run.AGREES),  # what a row says
    ],
)
def test_intervals_that_any_value_would_meet_do_not_agree(measured, simulated, verdict):
    assert (
        Comparison("height", "m", measured, simulated, measured.meets(simulated)).verdict == verdict
    )
