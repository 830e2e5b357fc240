"""A dataset in other formats, read back as their own tools do, and the examples of docs/dataset.md."""

import csv
import json
import re
import runpy
import sys
from datetime import date
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
from references.echoes import discs_of

from forest_addon.formats.raster_file import write_png
from forest_addon.results.reverb import write_response
from forest_addon.results.sonar import write_echo
from forest_addon.sensing.reverb.channels import ImpulseResponse
from forest_addon.sensing.reverb.metrics import octave_bands
from forest_addon.sensing.sonar.ping import ping
from forest_addon.spec import Air, Sonar
from headless.cli import main
from headless.dataset import card, disk
from headless.dataset.disk import write_shards
from headless.dataset.place import ROUTE_HEAD

laspy = pytest.importorskip("laspy")
CLASSES = ("unclassified", "low vegetation", "terrain", "out points", "stem", "live branches")
PAGE = Path(__file__).resolve().parents[3] / "docs" / "dataset.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
POINTS = 240
STANDS = (3.0, 4.0, 1.5)
OFFSET = (500000.0, 5400000.0, 100.0)


def _cloud(rng, fields):
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.header.scales, las.header.offsets = np.full(3, 0.001), np.array(OFFSET)
    las.header.creation_date = date(1980, 1, 1)
    for name, kind in fields.items():
        las.header.add_extra_dims([laspy.ExtraBytesParams(name, kind)])
    las = laspy.LasData(las.header)
    las.x, las.y, las.z = rng.uniform(0, 8, (POINTS, 3)).T + np.array(OFFSET)[:, None]
    return las


def _scene(root, number, split):
    """Write a scene's folder by hand: one tripod, three trees, classes and trees by chance."""
    rng, partial = np.random.default_rng(number), disk.begin(root, number)
    las = _cloud(rng, {"treeID": "int32", "organ": "int8", "order": "int8"})
    las.classification = rng.integers(0, 6, POINTS)
    las["treeID"] = np.where(np.asarray(las.classification) > 3, rng.integers(1, 4, POINTS), 0)
    las.write(partial / "tls-forinstance.laz")
    plain = _cloud(np.random.default_rng(number), {"organ": "int8", "tree": "int32"})
    plain.intensity = rng.integers(0, 65536, POINTS)
    plain.write(partial / "tls.laz")
    (partial / "scene.toml").write_text(
        f'offset = {list(OFFSET)}\n[[sensors]]\nkind = "terrestrial"\nname = "tls"\n'
        f"position = {list(STANDS)}\n"
    )
    (partial / "trees.csv").write_text(
        "tree,species,dbh_m,target_dbh_m\n0,oak,0.3,\n1,oak,0.2,0.2\n"
    )
    (partial / "preview.png").write_bytes(write_png(rng.random((9, 16, 3))))
    segment = np.where(np.arange(144).reshape(9, 16) < 32, 0, 8 * 70_000 + 4)
    segment[5:, 3:] = 2
    parts = np.stack([segment & 255, segment >> 8 & 255, segment >> 16], 2)
    (partial / "preview-segments.png").write_bytes(write_png(parts / 255))
    (partial / "echo.wav").write_bytes(b"RIFF, but no sound that any codec knows")
    np.savez(partial / "voxels.npz", edge=0.5, leaf_area_density=rng.random(7))
    disk.finish(partial, root, {"scene": number, "split": split, "points": {"tls": POINTS}})
    return las, plain


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    root = tmp_path_factory.mktemp("made") / "tiny"
    clouds = [_scene(root, number, split) for number, split in enumerate(("train", "validation"))]
    (root / "splits").mkdir()
    for split, names in (("train", "000000\n"), ("validation", "000001\n"), ("test", "\n")):
        (root / "splits" / f"{split}.txt").write_text(names)
    (root / "loader.py").write_bytes(card.LOADER.read_bytes())
    write_shards(root, 10**6)
    return root, clouds


def _converted(made, kind, out):
    words = ["dataset", "--convert", str(made[0]), "--to", kind, "--out", str(out), "--quiet"]
    assert main(words) == 0
    with open(out / "legend.csv", newline="") as file:
        rows = {int(row["class"]): row["name"] for row in csv.DictReader(file)}
    assert tuple(rows[number] for number in range(6)) == CLASSES
    return out


def test_semantic_kitti_as_its_own_tools_read_it(made, tmp_path):
    yaml = pytest.importorskip("yaml")
    out = _converted(made, "semantic-kitti", tmp_path / "kitti")
    said = yaml.safe_load((out / "semantic-kitti.yaml").read_text())
    assert said["split"] == {"train": [0], "valid": [1], "test": []}
    assert set(said["labels"]) == set(said["color_map"]) == set(said["learning_map"])
    for sequence in (0, 1):
        las, plain = made[1][sequence]
        folder = out / "sequences" / f"{sequence:02d}"
        scan = np.fromfile(folder / "velodyne" / "000000.bin", dtype=np.float32).reshape(-1, 4)
        label = np.fromfile(folder / "labels" / "000000.label", dtype=np.uint32)
        pose = np.array((folder / "poses.txt").read_text().split(), float).reshape(3, 4)
        assert (pose[:, 3] == np.add(OFFSET, STANDS)).all()
        assert np.abs(scan[:, :3] @ pose[:, :3].T + pose[:, 3] - las.xyz).max() < 1e-5
        assert np.allclose(scan[:, 3], np.asarray(plain.intensity) / 65535, atol=1e-6)
        assert (label & 0xFFFF == np.asarray(las.classification)).all()
        assert (label >> 16 == np.asarray(las["treeID"])).all()
        assert [said["labels"][k] for k in range(6)] == list(CLASSES)


def test_s3dis_has_every_point_once_in_a_room_and_once_in_an_object(made, tmp_path):
    out = _converted(made, "s3dis", tmp_path / "s3dis")
    las, plain = made[1][1]
    room = out / "Area_2" / "scene_000001"
    whole = np.loadtxt(room / "scene_000001.txt")
    turn = np.lexsort(las.xyz.T.round(3))
    assert np.allclose(whole[np.lexsort(whole[:, :3].T), :3], las.xyz[turn], atol=6e-4)
    grey = np.rint(np.asarray(plain.intensity)[turn] / 65535 * 255)
    assert (whole[np.lexsort(whole[:, :3].T), 3] == grey).all()
    rows = []
    for path in (room / "Annotations").iterdir():
        name, tree = path.stem.split("_")  # as loaders do
        number = [each.replace(" ", "") for each in CLASSES].index(name)
        part = np.loadtxt(path, ndmin=2)
        is_it = np.asarray(las.classification) == number
        assert len(part) == (is_it & (np.asarray(las["treeID"]) == int(tree))).sum()
        rows.append(part)
    rows = np.concatenate(rows)
    assert (rows[np.lexsort(rows[:, :3].T)] == whole[np.lexsort(whole[:, :3].T)]).all()


def test_coco_panoptic_segments_are_the_pixels_of_its_pngs(made, tmp_path):
    image = pytest.importorskip("PIL.Image")
    out = _converted(made, "coco-panoptic", tmp_path / "coco")
    told = json.loads((out / "panoptic_train.json").read_text())
    assert [one["file_name"] for one in told["images"]] == ["000000.png"]
    pixels = np.asarray(image.open(out / "panoptic" / "000000.png"), dtype=np.int64)
    numbers = pixels @ [1, 256, 65536]  # rgb2id of panopticapi
    assert numbers.shape == (told["images"][0]["height"], told["images"][0]["width"])
    segments = {one["id"]: one for one in told["annotations"][0]["segments_info"]}
    assert set(segments) == set(np.unique(numbers).tolist()) - {0}
    names = {one["id"]: one["name"] for one in told["categories"]}
    things = {one["id"]: one["isthing"] for one in told["categories"]}
    for number, one in segments.items():
        rows, columns = np.nonzero(numbers == number)
        x, y, wide, high = one["bbox"]
        assert one["area"] == len(rows)
        assert (x, y) == (columns.min(), rows.min())
        assert (x + wide - 1, y + high - 1) == (columns.max(), rows.max())
    assert {names[one["category_id"]] for one in segments.values()} == {"stem", "terrain"}
    assert things[4] == 1
    assert things[2] == 0


def test_a_dataset_is_not_converted_into_itself(made, headless):
    ended = headless("dataset", "--convert", made[0], "--to", "s3dis", "--out", made[0], ends=2)
    assert "is read by this command" in ended.stderr


def test_a_cloud_without_classes_says_what_to_keep(tmp_path, capsys):
    _scene(tmp_path, 0, "train")
    (tmp_path / "scenes" / "000000" / "tls-forinstance.laz").unlink()
    record = json.loads((tmp_path / "scenes" / "000000" / "scene.json").read_text())
    del record["files"]["tls-forinstance.laz"]
    (tmp_path / "scenes" / "000000" / "scene.json").write_text(json.dumps(record))
    words = ("--convert", str(tmp_path), "--to", "semantic-kitti", "--out", str(tmp_path / "out"))
    assert main(["dataset", *words]) == 2
    assert "keep.for_instance = true" in capsys.readouterr().err


def _needs(block):
    for name in re.findall(r"^(?:import|from) (\w+)", block, re.M):
        if name != "loader":
            pytest.importorskip(name, exc_type=ImportError)  # some want a newer numpy


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_the_pages_examples_run_and_are_short(made, number, tmp_path, monkeypatch):
    block = BLOCKS[number]
    assert len(block.splitlines()) <= 5
    monkeypatch.setenv("HF_HOME", str(tmp_path / "home"))
    _needs(block)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "tiny").symlink_to(made[0], target_is_directory=True)
    for kind in ("semantic-kitti", "s3dis", "coco-panoptic"):
        if kind in block:
            _converted(made, kind, tmp_path / "out" / f"tiny-{kind}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(made[0]))
    monkeypatch.delitem(sys.modules, "loader", raising=False)
    names = {}
    exec(compile(block, f"dataset.md, block {number}", "exec"), names)
    monkeypatch.delitem(sys.modules, "loader", raising=False)
    assert any(
        hasattr(value, "__len__") and len(value) for key, value in names.items() if key == "one"
    )


def test_ragged_clouds_come_apart_again_and_trees_are_numbers(made, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    loader = runpy.run_path(str(made[0] / "loader.py"))
    cloud = loader["Clouds"](made[0])[0]
    few = {key: value if key == "origin" else value[:7] for key, value in cloud.items()}
    batch = loader["collate"]([few, cloud, few])
    assert batch["offset"].tolist() == [0, 7, 7 + POINTS, 14 + POINTS]
    for number, one in enumerate((few, cloud, few)):
        mine = batch["batch"] == number
        assert (batch["xyz"][mine] == one["xyz"]).all()
        assert (batch["treeID"][mine] == one["treeID"]).all()
    las = made[1][0][0]
    assert np.abs(cloud["xyz"] + cloud["origin"] - las.xyz).max() < 1e-5
    trees = loader["Scenes"](made[0])[0]["trees"]
    assert trees["dbh_m"].dtype == np.float64
    assert trees["dbh_m"].tolist() == [0.3, 0.2]
    assert np.isnan(trees["target_dbh_m"][0])
    assert trees["species"].tolist() == ["oak", "oak"]


def test_tensors_come_where_torch_is(made):
    torch = pytest.importorskip("torch")
    loader = runpy.run_path(str(made[0] / "loader.py"))
    clouds = loader["Clouds"](made[0])
    batch = loader["collate"]([clouds[0], clouds[0]])
    assert all(isinstance(value, torch.Tensor) for value in batch.values())


def test_every_name_in_a_label_file_has_its_legend(undisturbed):
    with open(undisturbed / "legend.csv", newline="") as file:
        known = {(row["file"], row["name"]): row["meaning"] for row in csv.DictReader(file)}
    assert all(known.values())
    seen = 0
    for folder in (undisturbed / "scenes").iterdir():
        for path in folder.iterdir():
            kind = path.name.replace("tls", "NAME", 1)
            for name in _names_of(path):
                seen += 1
                assert _meaning_of(kind, name), (path.name, name)
    assert seen > 100


def test_every_name_of_echoes_and_responses_has_its_legend(tmp_path):
    bat = Sonar(name="bat", contributions=True)
    leaves = discs_of([[2, 0, 2], [3, 0.2, 2]], [1.0, 0, 0], 0.02)
    write_echo(tmp_path, bat, ping(leaves, bat, Air()))
    write_response(tmp_path / "ir.npz", _response())
    (tmp_path / "bat-route.csv").write_text(f"{ROUTE_HEAD}\n0,0,1,0,0,0\n")
    kinds = {
        "bat.npz": "NAME.npz (sonar)",
        "bat-heard.npz": "NAME-heard.npz",
        "ir.npz": "NAME.npz (reverb)",
        "bat-route.csv": "NAME-route.csv",
    }
    for file, kind in kinds.items():
        names = _names_of(tmp_path / file)
        assert len(names) >= 5
        assert not [name for name in names if not _meaning_of(kind, name)], file
    assert not _meaning_of("NAME-heard.npz", "loudness")


def _meaning_of(file, name):
    """The legend of a name in a kind of file; a unit's text is explained by what it is the unit of."""
    known = card.NAMES.get(file, {})
    plain = (name, name.removesuffix("_unit"))
    return next((words for key, words in known.items() if any(fnmatch(n, key) for n in plain)), "")


def _response():
    decay = np.exp(-np.arange(4800) / 300)
    facts = dict.fromkeys(("trunks", "continued", "late", "clamped"), 0)
    return ImpulseResponse(
        sample_rate=24_000.0,
        direct=np.where(np.arange(4800) == 0, 1.0, 0.0),
        ground=np.zeros(4800),
        trees=0.1 * decay,
        direct_delay=0.0,
        direct_clear=True,
        ground_clear=True,
        exact=True,
        left_db=np.full(1 + len(octave_bands(24_000.0)), -np.inf),
        errors={},
        further=(),
        **facts,
    )


def _names_of(path):
    if path.suffix == ".csv":
        with open(path, newline="") as file:
            return next(csv.reader(file))
    if path.suffix == ".npz":
        return np.load(path).files
    if path.suffix == ".laz":
        return list(laspy.read(path).point_format.extra_dimension_names)
    return []
