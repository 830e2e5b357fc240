"""A cloud in the report: what the page holds is the cloud, and a browser needs no network for it."""

import base64
import json
import re
import zlib

import numpy as np
import pytest

from forest_addon.base.trimesh import GROUND, LEAF
from forest_addon.sensing.lidar.cloud import Cloud, Returns
from headless.report.page import BUDGET, turning_cloud, viewer


@pytest.fixture
def cloud():
    rng = np.random.default_rng(3)
    position = np.vstack([rng.random((5000, 3)) * [30, 20, 12], rng.random((900, 3)) * 3000])
    position[-100:] = rng.random((100, 3)) * [30, 20, 0.1]
    organ = np.r_[np.full(5000, LEAF), np.full(900, GROUND)]
    zeros, whole = np.zeros(len(organ)), np.zeros(len(organ), dtype=np.int64)
    of = dict.fromkeys(("leaf", "tree", "species", "instance", "triangle"), whole)
    normal = np.tile([0.0, 0.0, 1.0], (len(organ), 1))
    names = ("azimuth", "elevation", "scan_angle", "width", "true_range", "time")
    return Cloud(
        position=position,
        pulse=np.arange(len(organ)),
        number=np.ones(len(organ), dtype=np.uint8),
        count=np.ones(len(organ), dtype=np.uint8),
        intensity=rng.random(len(organ)),
        returns=Returns(distance=zeros, normal=normal, cos_incidence=zeros, organ=organ, **of),
        pulses=len(organ),
        engine="test",
        **dict.fromkeys(names, zeros),
    )


def unpacked(figure):
    about = json.loads(re.search(r'class="about">(.*?)</script>', figure, re.S)[1])
    raw = zlib.decompress(base64.b64decode(re.search(r'class="bytes">(.*?)</script>', figure)[1]))
    planes = np.frombuffer(raw, np.uint8).reshape(-1, about["count"]).astype(int)
    place = np.stack([planes[2 * a] + 256 * planes[2 * a + 1] for a in range(3)], axis=1)
    return about, place * about["step"], planes[6]


def test_the_page_holds_the_points_and_says_which_it_leaves_out(cloud):
    figure = turning_cloud(cloud, ["oak"])
    about, place, organ = unpacked(figure)
    assert (organ == LEAF).sum() == 5000  # far ground is cut, no tree is
    assert "far ones lie beyond the picture" in figure
    solid = cloud.position[:5000]
    there = place[organ == LEAF]
    shift = solid.min(axis=0) - there.min(axis=0)
    key = np.round((there + shift) / 0.01)
    want = np.round(solid / 0.01)
    for axis in range(3):
        off = np.sort(key[:, axis]) - np.sort(want[:, axis])
        assert np.abs(off).max() <= 1
    assert about["columns"][0]["names"] == ["", "", "leaf", "ground", ""]


def test_a_page_has_room_for_it_and_says_how_many_it_shows(cloud):
    figure = turning_cloud(cloud, ["oak"], 12_000)
    about, _, _ = unpacked(figure)
    assert 100 < about["count"] < 3000
    assert f"{about['count']:,} of {len(cloud):,} points" in figure
    assert len(re.search(r'class="bytes">(.*?)</script>', figure)[1]) <= 12_000


def test_no_points_no_figure(cloud):
    assert turning_cloud(cloud.select(np.zeros(0, dtype=int)), ["oak"]) == ""


def test_the_viewer_asks_for_nothing_from_elsewhere():
    code = viewer()
    assert len(code) + BUDGET < 10e6  # with the pictures a page stays below 10 MB
    assert not re.search(
        r"fetch\(\s*[\"']https?:|import\(\s*[\"']https?:|src\s*=\s*[\"']https?:", code
    )
