"""Learning from our plots: features do not know the density, labels are where the stem is, scores by hand."""

import os
import stat

import laspy
import numpy as np
import pytest

from forest_addon.spec import SpecError
from studies.sim_to_real.ablations import AblationScore, ablation_subject, differences
from studies.sim_to_real.clouds import (
    NAMES,
    Labelled,
    VoxelCells,
    cells_of,
    features_of,
    follow_stem,
    ground_below,
    near_cylinders,
    read_folder,
)
from studies.sim_to_real.run import Score, Taught, cross_validated, lent, train
from studies.sim_to_real.tasks import (
    TaskFindings,
    errors_of,
    matched,
    run_tasks,
    run_tool,
    task_subject,
)

RNG = np.random.default_rng(7)


def stem(count, height=10.0, lean=0.03):
    """Points of a leaning stem that tapers from 15 to 6 cm, with 3 mm of noise."""
    z = RNG.uniform(0, height, count)
    turn = RNG.uniform(0, 2 * np.pi, count)
    radius = 0.15 - 0.009 * z + RNG.normal(0, 0.003, count)
    return np.stack([lean * z + radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def floor(count):
    return np.column_stack([RNG.uniform(-1.2, 1.2, (count, 2)), RNG.normal(0, 0.005, count)])


def twigs(count):
    """Points within 1.2 m of the stem, as foliage is."""
    return np.column_stack([RNG.uniform(-1.2, 1.2, (count, 2)), RNG.uniform(3, 10, count)])


def test_circles_follow_a_leaning_stem_through_twigs():
    points = np.concatenate([stem(20_000), twigs(8_000), floor(3_000)])
    found = follow_stem(points, points[:, 2])
    assert found.top > 8.0
    centre, radius = found.at(np.array([1.3, 4.0, 7.0]))
    assert np.abs(centre - [[0.039, 0.0], [0.12, 0.0], [0.21, 0.0]]).max() < 0.008
    assert np.abs(radius - [0.1383, 0.114, 0.087]).max() < 0.006
    on = found.holds(points, points[:, 2])
    sure = (points[:, 2] > 0.5) & (points[:, 2] < found.top)
    assert on[:20_000][sure[:20_000]].mean() > 0.99
    assert on[20_000:28_000].mean() < 0.03


def test_ground_is_found_below_trees_on_a_slope():
    place = RNG.uniform(0, 12, (20_000, 2))
    slope = 0.3 * place[:, 0]
    ground = np.column_stack([place, slope + RNG.normal(0, 0.01, len(place))])
    crown = np.column_stack([place[:3000], slope[:3000] + RNG.uniform(3, 9, 3000)])
    found = ground_below(np.concatenate([ground, crown]))
    inner = (np.abs(place - 6.0) < 5.0).all(axis=1)
    assert (
        np.abs(found[: len(ground)][inner] - slope[inner]).max() < 0.35
    )  # half a cell's rise, twice
    assert np.abs(np.median(found[: len(ground)] - slope)) < 0.2


def test_features_do_not_know_how_dense_a_cloud_is():
    pytest.importorskip("pgeof")
    medians = []
    for count in (60_000, 600_000):
        cells = cells_of(np.concatenate([stem(count, lean=0.0), floor(count // 3)]))
        middle = (cells.height > 3) & (cells.height < 7)
        medians.append(np.median(features_of(cells)[middle], axis=0))
    assert np.abs(medians[0] - medians[1]).max() < 0.12


def test_a_column_goes_on_above_and_below_and_a_bar_does_not():
    pytest.importorskip("pgeof")
    along = RNG.uniform(-2, 2, 20_000)
    thin = RNG.normal(0, 0.01, (20_000, 2))
    for upright, expected in ((True, 1.0), (False, 0.1)):
        order = (1, 2, 0) if upright else (0, 1, 2)
        points = np.column_stack([along, thin])[:, order] + [3.0, 3.0, 3.0]
        points = np.concatenate([points, np.add(floor(2000), (3.0, 3.0, 0.0))])
        cells = cells_of(points)
        middle = np.linalg.norm(cells.centre - 3.0, axis=1) < 0.5
        found = features_of(cells)[middle]
        for name in ("above 0.3 m", "below 0.3 m"):
            assert abs(np.median(found[:, NAMES.index(name)]) - expected) < 0.11


def test_scores_as_by_hand():
    truth = np.array([1, 1, 1, 0, 0, 0, 0, 0], dtype=bool)
    told = np.array([1, 1, 0, 1, 0, 0, 0, 0], dtype=bool)
    score = Score.of(truth, told)
    assert score.iou == pytest.approx((2 / 4 + 4 / 6) / 2)
    assert score.f1 == pytest.approx(2 * 2 / 6)


def test_wood_is_near_a_cylinder_and_not_beyond_its_ends():
    table = np.array([[0.1, 2.0, 0, 0, 0, 0, 0, 1.0, 0, 0, 1, 0.1, 1, 0, 1]])
    points = np.array([[0.11, 0, 1], [0.16, 0, 1], [0.05, 0, 1], [0.1, 0, 2.01], [0.1, 0, 2.6]])
    assert near_cylinders(points, table).tolist() == [True, False, False, True, False]


def labelled(seed):
    """A cloud whose label is its second feature's sign."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(0, 12, (4000, 3))
    features = rng.normal(size=(4000, 3))
    cells = VoxelCells(centre, centre[:, 2], np.arange(4000))
    return Labelled(f"cloud {seed}", cells, features[:, 1] > 0, None, given=features)


def test_blocks_are_not_torn_and_the_label_is_learned():
    pytest.importorskip("sklearn")
    cloud = labelled(1)
    rows, told = cross_validated(cloud, "stem", 0)
    assert (cloud.cells.height[rows] > 0.3).all()
    assert Score.of(cloud.stem[rows], told).iou > 0.95
    some, mine = lent(cloud, "stem", 0)
    block = cloud.block()
    assert not set(block[mine]) & set(block[~mine])
    assert 0.02 < len(some.label) / len(rows) < 0.3
    learner = train(Taught(cloud.features, cloud.stem, np.ones(4000)), 0, network=True)
    assert (learner.predict(labelled(2).features) == labelled(2).stem).mean() > 0.95


def test_a_folder_of_clouds_is_read_by_the_names_of_for_instance(tmp_path):
    with pytest.raises(SpecError, match=r"holds no .las or .laz file"):
        read_folder(tmp_path)
    points = np.concatenate([stem(4_000), twigs(4_000), floor(3_000)])
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.header.scales = np.full(3, 0.001)
    las.x, las.y, las.z = points.T
    las.classification = np.repeat([4, 5, 2], (4_000, 4_000, 3_000))
    las.write(str(tmp_path / "plot_1.laz"))
    pytest.importorskip("pgeof")
    (cloud,) = read_folder(tmp_path)
    low = cloud.counted(0.5, 2.5)
    assert cloud.stem[low].all()
    assert cloud.wood is None
    las.classification = np.zeros(len(points), dtype=np.uint8)
    las.write(str(tmp_path / "plot_1.laz"))
    with pytest.raises(SpecError, match="4 for stem"):
        read_folder(tmp_path)


@pytest.mark.medium
def test_differences_are_of_pairs_of_seeds(tmp_path):
    found = [
        AblationScore(way, plots, "pine", "stem", seed, iou + 0.1 * seed, 0.5)
        for way, plots, iou in (("all", 4, 0.5), ("no noise", 4, 0.45), ("plots", 1, 0.2))
        for seed in range(3)
    ]
    assert np.allclose(differences(found)["no noise", "stem", "pine"], -0.05)
    part = ablation_subject(found, tmp_path)
    assert "| no noise | -50 (-50 to -50) |" in part.terms
    assert "6 plots each way" in part.summary
    assert (tmp_path / "ablations" / "ablations.png").stat().st_size > 1000


# --------------------------------------------------------------------------------------------- tasks
# Trees as a tool tells them against what they are: pairs, errors, and what the tool says where it stops.

TRUTH = np.array([[0.0, 0.0, 0.2, 15.0], [5.0, 0.0, 0.3, 18.0], [0.0, 5.0, 0.1, 9.0]])


def test_each_stem_is_paired_once_and_what_is_far_is_none():
    told = np.array(
        [[15.5, 0.21, 0.2, 0.0], [17.0, 0.0, 5.1, 0.1], [8.0, 0.1, 0.3, 0.1], [9.0, 0.1, 9.0, 9.0]]
    )
    trees, false = matched("plot", "pine", TRUTH, told)
    assert false == 2  # the second at the first stem, and the far one
    assert [np.isfinite(tree.away) for tree in trees] == [True, True, False]
    errors = errors_of(trees)
    assert errors["dbh"] == pytest.approx([0.01])  # 0 is: it could not tell
    assert errors["height"] == pytest.approx([0.5, -1.0])
    assert errors["place"] == pytest.approx([0.2, np.hypot(0.1, 0.1)])


def _tool(folder, words):
    (folder / "bin").mkdir(parents=True)
    settings = folder / "lib" / "site-packages" / "three_d_fin"
    settings.mkdir(parents=True)
    (settings / "3DFinconfig.ini").write_text("[basic]\n")
    path = folder / "bin" / "3DFin"
    path.write_text(f"#!/bin/sh\n{words}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@pytest.mark.skipif(os.name == "nt", reason="a shell stands in for the tool")
def test_its_table_is_read_and_its_last_words_are_kept(tmp_path):
    points = np.random.default_rng(1).uniform(0, 5, (50, 3))
    good = _tool(tmp_path / "good", 'echo "15.0 0.2 1.0 2.0" > "$5/cloud_dbh_and_heights.txt"')
    assert run_tool(good, points, tmp_path / "a").tolist() == [[15.0, 0.2, 1.0, 2.0]]
    bad = _tool(tmp_path / "bad", "echo too few points >&2; exit 1")
    assert run_tool(bad, points, tmp_path / "b") == "too few points"


def test_a_tool_that_is_not_there_says_how_to_get_it(tmp_path):
    with pytest.raises(SpecError, match="pip install 3DFin"):
        run_tasks(str(tmp_path / "none"), None, tmp_path, 1, 1)


def test_the_page_has_a_row_a_quantity_and_names_what_failed(tmp_path):
    told = np.array([[15.5, 0.21, 0.2, 0.0], [17.0, 0.31, 5.1, 0.1]])
    ours, false = matched("plot", "pine", TRUTH, told)
    real, _ = matched("real-pine", "real pine", TRUTH[:1], told[:1])
    found = TaskFindings(
        [*ours, *real], {"pine": false, "real pine": 0}, {"real-spruce": "too small"}
    )
    part = task_subject(found, tmp_path)
    rows = {row.quantity: row for row in part.comparisons}
    assert rows["pine: DBH, told less true"].simulated.value == pytest.approx(10.0)
    assert rows["real pine: DBH, told less true"].measured.value == pytest.approx(10.0)
    assert "2 of 3 trees" in rows["pine: distance of the stem, told less true"].words
    assert "real-spruce: too small" in part.terms
