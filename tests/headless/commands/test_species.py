"""The table and the contact sheet of species."""

import numpy as np
import pytest

from forest_addon.formats.ownership import RECORD
from headless.cli import main


@pytest.mark.slow
def test_table_and_sheet(tmp_path, capsys):
    pytest.importorskip("bpy")
    sheet = tmp_path / "new" / "species.png"
    assert main(["species", "hazelnut", "--sheet", str(sheet), "--pixels", "150"]) == 0
    said = capsys.readouterr().out
    assert "hazelnut" in said
    assert sheet.stat().st_size > 10_000


def test_sheets_of_no_sensible_size_are_refused(capsys):
    assert main(["species", "hazelnut", "--pixels", "5"]) == 2
    assert "--pixels" in capsys.readouterr().err


def test_unknown_species_is_one_sentence(capsys):
    assert main(["species", "plum-pudding"]) == 2
    assert "plum-pudding" in capsys.readouterr().err


@pytest.mark.slow
def test_small_pictures_for_the_panel(tmp_path, capsys, monkeypatch):
    pytest.importorskip("bpy")
    from PIL import Image

    from headless.report import trees

    monkeypatch.setattr(trees, "ICON", 64)
    folder = tmp_path / "new" / "pictures"
    assert main(["species", "hazelnut", "honda-conifer", "--pictures", str(folder)]) == 0
    assert "Wrote 2 pictures" in capsys.readouterr().out
    names = {path.name for path in folder.iterdir()}
    assert names == {RECORD, "hazelnut.jpg", "honda-conifer.jpg"}
    for path in folder.glob("*.jpg"):
        with Image.open(path) as picture:
            assert picture.size == (64, 64)
            grey = np.asarray(picture.convert("L"), float)
        tree = grey < 180  # darker than the paper behind it
        assert 0.02 < tree.mean() < 0.5
        assert tree[:, 24:40].sum() > 0.5 * tree.sum()  # it stands in the middle
