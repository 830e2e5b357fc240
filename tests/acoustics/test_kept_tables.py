"""Tables kept on the disk: the same bytes with and without, whatever happens to a file or beside it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from forest_addon.acoustics import disc_table, kept_tables
from forest_addon.acoustics.kept_tables import VARIABLE, cache_folder, kept_table

ROOT = Path(__file__).resolve().parents[2]
TABLE = np.arange(12.0).reshape(3, 4) * (1 + 2j)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


class Maker:
    def __init__(self):
        self.made = 0

    def __call__(self):
        self.made += 1
        return TABLE


def test_a_table_is_made_once_and_read_the_same(folder):
    make = Maker()
    first, second = (kept_table("t", "1", make) for _ in range(2))
    assert make.made == 1
    assert first.tobytes() == second.tobytes()
    assert (first.dtype, first.shape) == (second.dtype, second.shape)
    assert [path.name for path in folder.iterdir()] == ["t-1.table"]
    kept_table("t", "2", make)
    assert make.made == 2


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "text", "folder"])
def test_a_damaged_file_is_ignored_and_made_anew(folder, damage):
    kept_table("t", "1", Maker())
    path = folder / "t-1.table"
    data = bytearray(path.read_bytes())
    if damage == "cut":
        path.write_bytes(data[:-7])
    elif damage == "flipped":
        data[-3] ^= 16
        path.write_bytes(data)
    elif damage == "folder":
        path.unlink()
        path.mkdir()
    else:
        path.write_bytes(b"" if damage == "empty" else b"no table at all")
    make = Maker()
    assert np.array_equal(kept_table("t", "1", make), TABLE)
    assert make.made == 1
    if damage != "folder":
        assert np.array_equal(kept_table("t", "1", make), TABLE)
        assert make.made == 1
    assert not [one for one in folder.iterdir() if one.name.startswith(".")]


def test_a_cache_that_is_off_or_cannot_be_written_to_is_not_used(tmp_path, monkeypatch):
    make = Maker()
    monkeypatch.setenv(VARIABLE, "off")
    assert cache_folder() is None
    (tmp_path / "file").write_text("")
    for number in range(2):
        assert kept_table("t", "1", make) is TABLE
        assert make.made == number + 1
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "cache"))
    assert kept_table("t", "1", make) is TABLE


def test_it_lies_where_the_system_keeps_such_things(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    for system, place in (
        ("linux", ".cache/forest-sensing"),
        ("darwin", "Library/Caches/forest-sensing"),
        ("win32", "AppData/Local/forest-sensing"),
    ):
        monkeypatch.setattr(kept_tables.sys, "platform", system)
        assert cache_folder() == tmp_path / place


@pytest.mark.slow
def test_discs_are_the_same_to_the_bit_with_and_without_and_by_many_at_once(tmp_path):
    code = (
        "import hashlib, numpy as np\n"
        "from forest_addon.acoustics import disc_table as d\n"
        "ka, angle = np.linspace(0, 120, 50)[:, None], np.linspace(0, 1.5, 40)\n"
        "data = d.tabulated(ka, angle).tobytes() + d._splines().tobytes() + d._maxima().tobytes()\n"
        "print(hashlib.sha256(data).hexdigest())"
    )

    def process(where):
        environment = dict(os.environ) | {VARIABLE: where, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
        )

    cache = str(tmp_path / "cache")
    processes = [process("off"), *(process(cache) for _ in range(2))]
    said = {one.communicate()[0] for one in processes}
    said.add(process(cache).communicate()[0])  # all from the disk
    assert len(said) == 1
    assert len(said.pop().strip()) == 64
    names = sorted(path.name for path in (tmp_path / "cache").iterdir())
    version = disc_table._version()
    assert names == [f"disc-maxima-{version}.table", f"disc-splines-{version}.table"]
