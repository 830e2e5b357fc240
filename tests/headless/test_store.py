"""Runs in tiles whose pieces and files go to a store of objects, and the catalogue of their COPC files."""

import json
import os
import shutil

import laspy
import numpy as np
import pyproj
import pytest

pytest.importorskip("bpy")
pytest.importorskip("upath")

from forest_addon import api as forest
from forest_addon.spec import SpecError
from headless.catalogue import write_catalogue
from headless.cli import main
from headless.store import MARK, claim_store, store_of

FIELD = """
seed = 3
offset = [500000.0, 5000000.0, 0.0]
crs = "EPSG:32632"

[forest]
size = [40, 40]

[tiles]
size = 20
buffer = 10
files = "FILES"

[[plantings]]
species = "abop-monopodial-a"
variants = 1
expected = 9
exact = true

[[sensors]]
kind = "airborne"
name = "als"
position = [0, 20, 60]
track = 40
pulse_rate = 2000
"""


def field_of(folder, files="merged"):
    path = folder / "field.toml"
    path.write_text(FIELD.replace("FILES", files))
    return path


def run(field, out, *more):
    return main(["run", str(field), "--out", str(out), "--quiet", *more])


def bytes_of(folder):
    """{name: bytes} of all that a run leaves but how long it took."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "run.json"]
    names = {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
    return {name: data for name, data in names.items() if not name.startswith((".", "tiles/"))}


def objects_of(store):
    return {
        path.path.removeprefix(store.path).lstrip("/"): path.read_bytes()
        for path in store.rglob("*")
        if path.is_file() and path.name not in ("run.json", MARK)
    }


@pytest.mark.slow
def test_what_is_killed_goes_on_from_its_store_elsewhere(tmp_path, empty_blender, monkeypatch):
    field = field_of(tmp_path)
    assert run(field, tmp_path / "whole") == 0
    store = store_of("memory://bucket/field")
    make, made = forest.TiledScan.make, []

    def killed(self, piece, world=None, cuts=1):
        if made:
            raise OSError("no power")
        made.append(piece)
        make(self, piece, world, cuts)

    with monkeypatch.context() as patched:
        patched.setattr(forest.TiledScan, "make", killed)
        assert run(field, tmp_path / "first", "--store", "memory://bucket/field") == 1
    assert len([path for path in (store / "tiles").iterdir() if path.suffix == ".rows"]) == 1
    shutil.rmtree(tmp_path / "first")  # the machine is gone
    anew = []

    def counted(self, piece, world=None, cuts=1):
        anew.append(piece)
        make(self, piece, world, cuts)

    monkeypatch.setattr(forest.TiledScan, "make", counted)
    words = ("--store", "memory://bucket/field", "--resume")
    assert run(field, tmp_path / "second", *words) == 0
    assert len(anew) > 0
    assert not set(anew) & set(made)
    assert objects_of(store) == bytes_of(tmp_path / "second") == bytes_of(tmp_path / "whole")


@pytest.mark.slow
def test_objects_of_a_user_stay_as_they_are(tmp_path, empty_blender, capsys):
    url, field = "memory://mine/maps", field_of(tmp_path)
    theirs = {"trees.csv": b"mine", "tiles/0.png": b"a map", "tiles/als-1-1-0.rows": b"no piece"}
    for name, content in theirs.items():
        (store_of(url) / name).write_bytes(content)
    for more in ((), ("--resume",), ("--share", "1/2")):
        assert run(field, tmp_path / "out", "--store", url, *more) == 2
        assert "holds what no run put there" in capsys.readouterr().err
    assert objects_of(store_of(url)) == theirs
    empty = "memory://mine/field"
    assert run(field, tmp_path / "one", "--store", empty) == 0
    (store_of(empty) / "tiles/0.png").write_bytes(b"a map")
    assert run(field, tmp_path / "two", "--store", empty) == 2
    assert "holds a field in tiles; --resume" in capsys.readouterr().err
    assert run(field, tmp_path / "two", "--store", empty, "--resume") == 0
    assert (store_of(empty) / "tiles/0.png").read_bytes() == b"a map"


def test_a_store_of_another_command_is_left():
    store = store_of("memory://shared/place")
    claim_store(store, "a dataset", goes_on=True)
    claim_store(store, "a dataset", goes_on=True)
    with pytest.raises(SpecError, match=r"holds a dataset; take an empty place"):
        claim_store(store, "a field in tiles", goes_on=True)
    assert (store / MARK).read_text() == "Forest Sensing: a dataset"


@pytest.mark.slow
def test_workers_write_to_s3(tmp_path, empty_blender, monkeypatch):
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(port=0)
    server.start()
    try:
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            monkeypatch.setitem(os.environ, name, "testing")
        host, port = server.get_host_and_port()
        monkeypatch.setitem(os.environ, "AWS_ENDPOINT_URL", f"http://{host}:{port}")
        monkeypatch.setitem(os.environ, "AWS_DEFAULT_REGION", "us-east-1")
        store_of("s3://forests").mkdir()
        field = field_of(tmp_path)
        assert run(field, tmp_path / "whole") == 0
        words = ("--workers", "1", "--store", "s3://forests/field")
        assert run(field, tmp_path / "out", *words) == 0
        assert objects_of(store_of("s3://forests/field")) == bytes_of(tmp_path / "whole")
    finally:
        server.stop()


@pytest.mark.slow
def test_copc_of_tiles_open_as_one_by_their_catalogue(tmp_path, empty_blender):
    pystac = pytest.importorskip("pystac")
    pytest.importorskip("copclib")
    assert run(field_of(tmp_path), tmp_path / "whole") == 0
    points = np.sort(laspy.read(tmp_path / "whole" / "als.laz").xyz, axis=0)
    field = field_of(tmp_path, "copc")
    for out in ("one", "two"):
        assert run(field, tmp_path / out) == 0
    assert bytes_of(tmp_path / "one") == bytes_of(tmp_path / "two")
    folder = tmp_path / "one" / "als"
    items = list(pystac.Catalog.from_file(str(folder / "catalog.json")).get_items())
    virtual = json.loads((folder / "als.vpc").read_text())
    assert virtual["type"] == "FeatureCollection"
    assert len(items) == len(virtual["features"]) == len(list(folder.glob("*.copc.laz"))) > 1
    found, seen = [], 0
    for item, feature in zip(items, virtual["features"], strict=True):
        found.append(laspy.read(item.assets["data"].get_absolute_href()).xyz)
        assert (folder / feature["assets"]["data"]["href"]).is_file()
        seen += item.properties["pc:count"]
        assert item.properties["proj:code"] == "EPSG:32632"
        assert item.properties["forest:seed"] == 3
        assert "run field.toml --seed 3" in item.properties["forest:command"]
        # The meridian of zone 32 is 9 degrees east; 5,000 km north are 45.15 degrees.
        assert np.allclose(np.delete(item.bbox, [2, 5]), [9.0, 45.153, 9.0, 45.153], atol=2e-3)
        names = {column["name"] for column in item.properties["pc:schemas"]}
        assert {"X", "Y", "Z", "Intensity", "ReturnNumber", "GpsTime", "tree"} <= names
        # What QGIS and pdal_wrench ask a VPC for.
        assert feature["stac_version"] == "1.0.0"
        said = feature["properties"]
        assert said["proj:epsg"] == pyproj.CRS(said["proj:wkt2"]).to_epsg() == 32632
        assert said["proj:geometry"]["type"] == "Polygon"
        assert said["proj:bbox"] == item.properties["proj:bbox"]
        low, high = np.array(item.properties["proj:bbox"]).reshape(2, 3)
        assert np.allclose(low, found[-1].min(axis=0), atol=1e-3)
        assert np.allclose(high, found[-1].max(axis=0), atol=1e-3)
    assert seen == len(points)
    assert np.array_equal(np.sort(np.concatenate(found), axis=0), points)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("out/field", "is no store; write such as s3"),
        ("nowhere://a", "install forest-sensing"),
        *((f"{scheme}FOLDER", "is no store") for scheme in ("", "file://", "local://")),
    ],
)
def test_what_is_no_store_is_said(tmp_path, url, words):
    with pytest.raises(SpecError, match=words):
        store_of(url.replace("FOLDER", str(tmp_path)))


def test_a_catalogue_without_its_library_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pystac", None)
    with pytest.raises(SpecError, match=r"needs pystac; install forest-sensing\[cloud\]"):
        write_catalogue(tmp_path, [], "", {})
