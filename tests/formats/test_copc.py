"""A cloud as COPC: an octree as readers expect it, of any cloud, with every point once."""

import os
from pathlib import Path

import laspy
import numpy as np
import pytest

from forest_addon.formats.copc import CELLS, nodes
from forest_addon.formats.las import write_las
from forest_addon.results.points import POINT

REAL = Path(os.environ.get("FOREST_MEASURED", "../shared/data/measured")) / "clouds"


def written(path, place):
    rows = np.zeros(len(place), POINT)
    for axis, name in enumerate("xyz"):
        rows[name] = place[:, axis]
    rows["tree"] = np.arange(len(place))
    write_las(path, rows)
    return rows


def place_of(points):
    return np.column_stack([points.x, points.y, points.z])


def clumped():
    """A ground, two dense crowns and 6,000 points in one place."""
    rng = np.random.default_rng(2)
    return np.concatenate(
        [
            rng.random((40_000, 3)) * [80, 60, 0.2],
            rng.normal([20, 20, 9], 0.4, (30_000, 3)),
            rng.normal([61, 33, 12], 0.1, (20_000, 3)),
            np.tile([5.0, 5.0, 1.0], (6_000, 1)),
        ]
    )


def test_each_point_is_in_one_node_that_holds_it():
    place = clumped() - clumped().min(axis=0)
    edge = float(place.max()) * 1.0001
    seen, keys = [], set()
    for (depth, *corner), points in nodes(place, edge):
        side = edge / 2**depth
        low = np.array(corner) * side
        assert (place[points] >= low - 1e-9).all()
        assert (place[points] <= low + side + 1e-9).all()
        assert depth == 0 or (depth - 1, *(c // 2 for c in corner)) in keys  # no orphans
        keys.add((depth, *corner))
        seen.append(points)
    assert max(depth for depth, *_ in keys) >= 4
    assert (np.sort(np.concatenate(seen)) == np.arange(len(place))).all()


@pytest.mark.medium
def test_coarse_nodes_are_an_even_sample():
    place = clumped() - clumped().min(axis=0)
    edge = float(place.max()) * 1.0001
    ((depth, *_), points), *_ = nodes(place, edge)
    assert depth == 0
    cells = np.unique((place[points] / edge * CELLS).astype(int), axis=0)
    assert len(cells) == len(points)  # one a cell, and every cell that holds any
    assert len(cells) == len(np.unique((place / edge * CELLS).astype(int), axis=0))


@pytest.mark.medium
def test_another_reader_finds_what_lies_in_a_box(tmp_path):
    place = clumped()
    written(tmp_path / "a.copc.laz", place)
    low, high = np.array([15.0, 10.0, 5.0]), np.array([30.0, 25.0, 15.0])
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        found = reader.query(bounds=laspy.copc.Bounds(low, high))
        coarse = reader.query(resolution=2.0)
    inside = ((place >= low) & (place <= high)).all(axis=1)
    there = place_of(found)
    rows = ((there >= low) & (there <= high)).all(axis=1)
    assert set(np.asarray(found["tree"])[rows]) == set(np.flatnonzero(inside))
    assert 100 < len(coarse) < len(place) / 2


@pytest.mark.skipif(not REAL.is_dir(), reason="the measured clouds are not here")
def test_a_real_cloud_keeps_every_point(tmp_path):
    place = np.asarray(laspy.read(REAL / "spanner_ALS.laz").xyz)
    written(tmp_path / "a.copc.laz", place)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        found = reader.query()
    order = np.argsort(np.asarray(found["tree"]))
    assert np.abs(place_of(found)[order] - place).max() <= 0.51e-4
