"""Clouds held to clouds: closed forms, densities that differ, and media that differ."""

import argparse

import laspy
import numpy as np
import pytest
from scipy.stats import hypergeom

from forest_addon.base.rng import stream
from forest_addon.spec import SpecError
from studies.__main__ import main
from studies.validation import cloud_pair as cloud_sums
from studies.validation.cloud_pair import compare_clouds, hold_pair, lines_in, rarefied, stems_of

ORIGIN = np.array([15.0, 15.0, 4000.0])
TALL, WIDE = 12.0, 30.0


def medium(path, pulses, density, seed, low=0.0):
    """A LAS file of single returns: a medium of this many contacts a metre from ``low`` to 12 m, by
    chance."""
    rng = stream(seed, "medium")
    foot = np.column_stack([rng.uniform(0, WIDE, (pulses, 2)), np.zeros(pulses)])
    way = (ORIGIN - foot) / np.linalg.norm(ORIGIN - foot, axis=1, keepdims=True)
    into = rng.exponential(1 / density, pulses)
    z = np.where(TALL - into * way[:, 2] > low, TALL - into * way[:, 2], 0.0)
    place = foot + (z / way[:, 2])[:, None] * way
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [1e-4] * 3
    cloud = laspy.LasData(header)
    cloud.xyz = place
    cloud.return_number = cloud.number_of_returns = np.ones(pulses, np.uint8)
    cloud.classification = np.where(z == 0, 2, 1)
    cloud.write(path)
    return path


def test_rarefied_occupancy_is_the_hypergeometric_chance():
    many, hits = np.array([10, 12, 40, 200, 30]), np.array([0, 3, 4, 150, 30])
    right = 1 - hypergeom.pmf(0, many, hits, 10)
    assert np.allclose(rarefied(many, hits, 10), right, atol=1e-10)


@pytest.mark.medium
@pytest.mark.parametrize("pulses", [60_000, pytest.param(600_000, marks=pytest.mark.slow)])
def test_voxels_let_through_what_beers_law_says_at_every_density(tmp_path, pulses):
    density = 0.15
    whole = lines_in(medium(tmp_path / "a.las", pulses, density, 1), ORIGIN)[0].whole()
    layer = slice(2, int(TALL) - 1)
    passed = whole["passed"][layer].sum() / whole["voxels"][layer].sum()
    filled = whole["filled"][layer].sum() / whole["voxels"][layer].sum()
    assert passed == pytest.approx(np.exp(-density), abs=0.01)
    assert filled == pytest.approx(1 - np.exp(-density * 10), abs=0.01)
    gap = whole["gap"].sum() / whole["sent"].sum()
    assert gap == pytest.approx(np.exp(-density * (TALL - 0.5)), abs=0.03)


@pytest.mark.slow
def test_a_cloud_agrees_with_a_thinner_one_and_not_with_a_denser_medium(tmp_path):
    one = medium(tmp_path / "one.las", 150_000, 0.15, 1)
    thin = medium(tmp_path / "thin.las", 40_000, 0.15, 2)
    other = medium(tmp_path / "other.las", 150_000, 0.3, 3)
    verdicts = [
        {row.measure.name: row.verdict for row in compare_clouds(one, two, (ORIGIN, ORIGIN), 1)[0]}
        for two in (thin, other)
    ]
    for name in ("light that passes a voxel of 1 m", "voxels of 1 m that 10 beams meet"):
        assert [verdict[name] for verdict in verdicts] == ["agrees", "does not agree"]
    assert verdicts[0]["profile of light"] == "agrees"
    assert verdicts[0]["residual of stems' circles"].startswith("too little of it in one and thin")


@pytest.mark.medium
def test_stems_residuals_and_arcs_are_those_that_were_made():
    rng = stream(4, "stems")
    angle = rng.uniform(0, np.pi, (3, 4000))  # half of each stem is seen
    middle = np.array([[5.0, 0.0], [9.0, 4.0], [12.0, -6.0]])
    radius = np.array([0.1, 0.2, 0.15])[:, None] + 0.005 * rng.standard_normal(angle.shape)
    xy = middle[:, None] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    height = rng.uniform(0.5, 4, angle.size)
    bush = np.column_stack([rng.normal(0, 0.5, (2000, 2)), rng.uniform(0, 4, 2000)])
    place = np.concatenate([np.column_stack([xy.reshape(-1, 2), height]), bush])
    found = stems_of(place, place[:, 2])
    order = np.argsort(found[:, 0])
    assert np.allclose(found[order, :2], middle, atol=0.003)
    assert np.allclose(found[order, 2], [0.1, 0.2, 0.15], atol=0.002)
    assert np.allclose(found[:, 3], 0.5, atol=0.06)
    assert np.allclose(found[:, 4], 0.005, atol=0.0007)


@pytest.mark.medium
def test_the_command_writes_table_and_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cloud_sums, "MOST", 5000)
    files = [str(medium(tmp_path / f"{name}.las", 20_000, 0.2, 1)) for name in "ab"]
    out = tmp_path / "out"
    words = ["validate", "lidar", *files, "--origin", "15,15,4000", "--out", str(out)]
    assert not main(words)
    said = capsys.readouterr().out
    assert (out / "lidar" / "pair.md").read_text("utf-8") in said
    assert "| profile of light, m, median |" in said
    assert (out / "lidar" / "pair.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("subject", "origins", "said"),
    [("stand", [], "two files go with lidar"), ("lidar", ["0,0,0"] * 3, "is given 3 times")],
)
def test_what_cannot_be_a_pair_is_refused(tmp_path, subject, origins, said):
    chosen = argparse.Namespace(scene=None, stand=None, docs=None, out=tmp_path, seed=1)
    with pytest.raises(SpecError, match=said):
        hold_pair(subject, (tmp_path / "a.las", tmp_path / "b.las"), origins, chosen)
