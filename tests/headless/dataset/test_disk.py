"""A scene's folder is whole or not there; the manifest follows from the folders; a folder has one command."""

import json
import os
from contextlib import nullcontext

import pytest

from forest_addon.formats.ownership import Keeper, keeping
from forest_addon.spec import SpecError
from headless.dataset import disk
from headless.dataset.disk import rows_of
from headless.lock import only_one

RECORD = {
    "split": "train",
    "seed": 1,
    "base": "b",
    "settings": "s",
    "trees": 1,
    "points": {"tls": 3},
}


def made(root, number, text="points"):
    partial = disk.begin(root, number)
    (partial / "tls.laz").write_text(text)
    return disk.finish(partial, root, {"scene": number, **RECORD})


def test_a_finished_scene_has_its_name_and_its_digests(tmp_path):
    folder = made(tmp_path, 7)
    assert folder.name == "000007"
    found = disk.read_scene(folder)
    assert found.record["files"]["tls.laz"]["sha256"] == disk.digest_of(folder / "tls.laz")
    assert [one.number for one in disk.scenes_done(tmp_path)] == [7]


def test_who_comes_second_throws_his_away(tmp_path):
    before = (made(tmp_path, 7) / "scene.json").stat().st_ino
    assert (made(tmp_path, 7) / "scene.json").stat().st_ino == before
    assert os.listdir(tmp_path / "scenes") == ["000007"]


@pytest.mark.parametrize(
    ("damage", "ours"),
    [("record", False), ("file", True), ("other", False), ("more", False), ("empty", True)],
)
def test_what_is_not_whole_is_not_done_and_made_anew_where_it_is_ours(tmp_path, damage, ours):
    folder = made(tmp_path, 3)
    if damage == "record":
        (folder / "scene.json").write_text('{"scene": 3')
    elif damage == "file":
        (folder / "tls.laz").unlink()
    elif damage == "other":
        (folder / "tls.laz").write_text("poin")
    elif damage == "more":
        (folder / "tls.laz").unlink()
        (folder / "notes.txt").write_text("mine")
    else:
        for path in folder.iterdir():
            path.unlink()
    disk.begin(tmp_path, 4)
    assert list(disk.scenes_done(tmp_path)) == []
    disk.clean(tmp_path)
    assert os.listdir(tmp_path / "scenes") == ["000003"]
    refused = nullcontext() if ours else pytest.raises(SpecError, match="not what Forest Sensing")
    with keeping(Keeper(tmp_path, "dataset")), refused:
        disk.claim_scene(tmp_path, 3)
    said = []
    with keeping(Keeper(tmp_path, "dataset", force=True, say=said.append)):
        disk.claim_scene(tmp_path, 3)
    assert bool(said) is not ours


def test_the_manifest_is_what_the_folders_say(tmp_path):
    made(tmp_path, 2)
    disk.write_status(tmp_path, 2, {"status": "done", "seconds": 2.5, "cpu": {"sensors": 1.5}})
    disk.write_status(
        tmp_path, 5, {"status": "failed", "kind": "timeout", "why": "ran past its time"}
    )
    (row,) = rows_of(tmp_path, [])
    assert (row["scene"], row["status"], row["points"], row["cpu_seconds"]) == (
        "000002",
        "done",
        3,
        1.5,
    )
    disk.remove_scene(tmp_path, 2)
    assert rows_of(tmp_path, []) == []


def test_a_second_command_says_who_holds_the_folder(tmp_path):
    with only_one(tmp_path), pytest.raises(SpecError, match=f"in use by .*process {os.getpid()}"):
        with only_one(tmp_path):
            pass
    with only_one(tmp_path):  # free again; what an ended command left does not hold it
        assert json.loads((tmp_path / ".lock").read_text())["pid"] == os.getpid()
