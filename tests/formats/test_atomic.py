"""A file is whole or not there."""

import os

import pytest

from forest_addon.formats.atomic import remove_partial_files, replacing


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
