"""A dataset that was made: its bytes, its labels, its truth, and what a change of plan does."""

import csv
import json
import os
import shutil
import subprocess
import sys
import tarfile

import numpy as np
import pytest
from references.dataset_runs import PLAN, bytes_of, run

from headless.dataset import factory

pytestmark = pytest.mark.slow


@pytest.fixture
def copy(undisturbed, tmp_path):
    out = tmp_path / "data"
    shutil.copytree(undisturbed, out)
    return out


def test_every_hash_and_label_is_right_and_a_wrong_one_is_named(copy, warm):
    warm.run("--check", copy)
    path = copy / "scenes" / "000001" / "tls.laz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    ended = warm.run("--check", copy, ends=4)
    assert "000001: tls.laz has another SHA-256" in ended.stderr


def test_the_folder_describes_itself(undisturbed):
    names = {path.name for path in undisturbed.iterdir()}
    assert names >= {
        "README.md",
        "manifest.csv",
        "overview.png",
        "varied.png",
        "plan.toml",
        "splits",
    }
    with open(undisturbed / "manifest.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["done"] * 4
    assert all(int(row["points"]) > 100 for row in rows)
    splits = [
        line for path in (undisturbed / "splits").iterdir() for line in path.read_text().split()
    ]
    assert sorted(splits) == [row["scene"] for row in rows]
    card = (undisturbed / "README.md").read_text()
    assert "4 of 4 scenes" in card
    assert "CC0-1.0" in card


def test_the_loader_is_short_and_reads_with_numpy_alone(undisturbed):
    code = (
        "import sys; sys.modules['laspy'] = None; sys.path.insert(0, '.')\n"
        "import loader\n"
        "n = sum(len(loader.Scenes('.', s)) for s in ('train', 'validation', 'test'))\n"
        "one = loader.Scenes('.')[0]\n"
        "print(n, one['voxels']['leaf_area_density'].shape[0] > 0, len(one['trees']))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], cwd=undisturbed, capture_output=True, text=True
    )
    assert ended.stdout.split()[:2] == ["4", "True"], ended.stderr


def test_truth_beside_a_cloud_is_its_own(undisturbed):
    for folder in (undisturbed / "scenes").iterdir():
        with open(folder / "trees.csv", newline="") as file:
            trees = list(csv.DictReader(file))
        with np.load(folder / "voxels.npz") as data:
            volume = data["edge"] ** 3
            area = data["leaf_area_density"].sum() * volume
        wanted = sum(float(tree["leaf_area_m2"]) for tree in trees)
        assert abs(area - wanted) <= 1e-9 * max(wanted, 1e-12)
        with np.load(folder / "tls-occlusion.npz") as data:
            assert (data["pulses_hit"] <= data["pulses_in"] + 1).all()
        with np.load(folder / "tls-hidden.npz") as data:
            assert set(data["tree"].tolist()) <= {int(tree["tree"]) for tree in trees}


@pytest.mark.skipif(not os.environ.get("FOREST_LONG_TESTS"), reason="eight Blenders")
def test_eight_workers_make_the_same_bytes_as_one(warm, tmp_path):
    words = (PLAN, "--quiet", "--set", "count=10")
    warm.run(*words, "--out", tmp_path / "one", "--workers", "1")
    ended = run(*words, "--out", tmp_path / "eight", "--workers", "8")
    assert ended.returncode == 0, ended.stderr
    assert bytes_of(tmp_path / "eight") == bytes_of(tmp_path / "one")
    assert len(list((tmp_path / "eight" / "scenes").iterdir())) == 10


def test_a_changed_plan_is_noticed_and_nothing_is_overwritten(copy, undisturbed, warm):
    ended = warm.run(PLAN, "--out", copy, "--workers", "1", "--set", "keep.voxels=2.0", ends=2)
    assert "scenes 000000, 000001, 000002, 000003" in ended.stderr
    assert "--replace" in ended.stderr
    assert bytes_of(copy) == bytes_of(undisturbed)
    more = ("--set", "keep.voxels=2.0", "--set", "count=1", "--replace", "--quiet")
    warm.run(PLAN, "--out", copy, "--workers", "1", *more)
    assert sorted(os.listdir(copy / "scenes")) == ["000000"]
    with np.load(copy / "scenes" / "000000" / "voxels.npz") as data:
        assert data["edge"] == 2.0


def test_done_scenes_are_not_made_again_and_lost_ones_come_back_the_same(copy, undisturbed, warm):
    shutil.rmtree(copy / "scenes" / "000002")
    kept = (copy / "scenes" / "000001" / "scene.json").stat().st_mtime_ns
    warm.run(PLAN, "--out", copy, "--workers", "1", "--shards", "1", "--quiet")
    assert bytes_of(copy) == bytes_of(undisturbed)
    assert (copy / "scenes" / "000001" / "scene.json").stat().st_mtime_ns == kept
    names = []
    for path in sorted((copy / "shards").glob("*.tar")):
        with tarfile.open(path) as tar:
            names += tar.getnames()
    assert sorted(names) == sorted(name.replace("/", ".", 1) for name in bytes_of(copy))


def test_shared_trees_are_the_same_as_each_grown_alone(tmp_path, warm):
    """The last scene of a library, alone in a process and a run of its own, and after others."""
    shared = (
        "--set",
        'trees="shared library of 2"',
        "--set",
        "count=2",
        "--workers",
        "1",
        "--quiet",
    )
    warm.run(PLAN, "--out", tmp_path / "all", *shared)
    wanted = bytes_of(tmp_path / "all")
    shutil.rmtree(tmp_path / "all" / "scenes" / "000001")
    warm.renew()
    warm.run(PLAN, "--out", tmp_path / "all", *shared)
    assert bytes_of(tmp_path / "all") == wanted
    records = [
        json.loads((path / "scene.json").read_text())
        for path in (tmp_path / "all" / "scenes").iterdir()
    ]
    seen = {}
    for record in records:
        for digest in record["variants"].values():
            seen.setdefault(digest, set()).add(record["split"])
    assert any(len(r["variants"]) for r in records)
    assert all(len(splits) == 1 for splits in seen.values())


def test_a_dry_run_says_what_it_costs_and_writes_nothing(tmp_path, warm):
    ended = warm.run(PLAN, "--out", tmp_path / "none", "--dry-run", "--set", "count=1")
    for word in ("1 scenes", "core-hours", "GB", "Boreal3D"):
        assert word in ended.stderr
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
@pytest.mark.parametrize("allowed", [False, True])
def test_an_empty_cloud_is_no_good_data_unless_the_plan_says_so(tmp_path, warm, allowed):
    """A scanner that looks past everything: its files are whole and their labels right, all none of them."""
    out = tmp_path / "data"
    more = ("--set", "count=1", "--set", "scene.sensors[tls].elevation_deg=[88.0,89.0]")
    allow = ("--set", "keep.empty=true") if allowed else ()
    warm.run(PLAN, *more, *allow, "--out", out, "--workers", "1", "--quiet")
    assert "| empty | 1 results; first: 0 points: " in (out / "README.md").read_text()
    ended = warm.run("--check", out, ends=0 if allowed else 4)
    assert ("tls: 0 points" in ended.stderr) is not allowed


def test_points_in_the_terms_of_for_instance_agree_with_trees_and_cylinders(undisturbed):
    laspy = pytest.importorskip("laspy")
    known, stems = 0, 0
    for folder in sorted((undisturbed / "scenes").iterdir()):
        plain = laspy.read(folder / "tls.laz")
        cloud = laspy.read(folder / "tls-forinstance.laz")
        organ, tree = np.asarray(plain["organ"]), np.asarray(plain["tree"])
        classes = np.asarray(cloud.classification)
        assert np.abs(cloud.xyz - plain.xyz).max() <= 0.0006
        assert (np.asarray(cloud["treeID"]) == np.where(tree >= 0, tree + 1, 0)).all()
        assert ((classes == 2) == (organ == 3)).all()
        assert np.isin(classes[organ == 2], (5,)).all()
        rows = np.loadtxt(folder / "cylinders.csv", delimiter=",", skiprows=1, ndmin=2)
        with open(folder / "cylinders.csv") as file:
            head = file.readline().strip().split(",")
        column = {name: rows[:, head.index(name)] for name in head}
        for number in np.flatnonzero(organ == 1)[::7]:
            mine = column["tree"] == tree[number]
            start, end = (
                np.column_stack([column[f"{which}{a}"][mine] for a in "XYZ"])
                for which in ("start", "end")
            )
            step = end - start
            share = np.clip(
                ((plain.xyz[number] - start) * step).sum(1) / (step**2).sum(1), 0.0, 1.0
            )
            away = np.linalg.norm(plain.xyz[number] - start - share[:, None] * step, axis=1)
            order = column["branching_order"][mine][np.argmin(away - column["radius_cyl"][mine])]
            known += 1
            stems += (order == 0) == (classes[number] == 4)
    assert known > 20
    assert stems > 0.9 * known  # at forks two cylinders are as near


def test_what_is_lost_goes_on_from_its_store_elsewhere(undisturbed, tmp_path, warm, monkeypatch):
    """Two scenes are in the store when the machine goes; another makes the rest. A user's store is left."""
    upath = pytest.importorskip("upath")
    url = "memory://forests/small"
    copied, copy, make = [], factory._copy_scene, warm.make

    def lost(folder, store):
        if len(copied) == 2:
            raise OSError("no network")
        copied.append(folder.name)
        copy(folder, store)

    monkeypatch.setattr(factory, "_copy_scene", lost)
    ended = warm.run(PLAN, "--out", tmp_path / "first", "--store", url, "--workers", 1, ends=1)
    assert "no network" in ended.stderr
    shutil.rmtree(tmp_path / "first")
    monkeypatch.setattr(factory, "_copy_scene", copy)
    made = []
    monkeypatch.setattr(warm, "make", lambda job: made.append(job.name) or make(job))
    warm.run(PLAN, "--out", tmp_path / "second", "--store", url, "--workers", 1, "--shards", 1)
    assert len(made) == 2
    assert bytes_of(tmp_path / "second") == bytes_of(undisturbed)
    store = upath.UPath(url)
    there = {path.path for path in store.rglob("*") if path.is_file()}
    for path in (tmp_path / "second").rglob("*"):
        name = path.relative_to(tmp_path / "second").as_posix()
        if path.is_file() and not name.startswith((".", "status")):
            assert (store / name).read_bytes() == path.read_bytes()
            there.remove((store / name).path)
    assert there == {(store / ".forest-sensing").path}
    (upath.UPath("memory://forests/mine") / "notes.txt").write_bytes(b"mine")
    ended = warm.run(PLAN, "--out", tmp_path / "third", "--store", "memory://forests/mine", ends=2)
    assert "holds what no run put there" in ended.stderr
    assert not (tmp_path / "third" / "scenes").exists()
