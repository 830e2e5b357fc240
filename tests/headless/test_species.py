"""The table and the contact sheet of species."""

import pytest

from headless.cli import main


def test_table_and_sheet(tmp_path, capsys, monkeypatch):
    pytest.importorskip("bpy")
    from headless import species_command

    monkeypatch.setattr(species_command, "WIDTH", 300)
    sheet = tmp_path / "new" / "species.png"
    assert main(["species", "hazelnut", "--sheet", str(sheet)]) == 0
    said = capsys.readouterr().out
    assert "hazelnut" in said
    assert sheet.stat().st_size > 10_000


def test_unknown_species_is_one_sentence(capsys):
    assert main(["species", "plum-pudding"]) == 2
    assert "plum-pudding" in capsys.readouterr().err
