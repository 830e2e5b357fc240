"""The experiment with S's orchards: what is asked for, what is written, and how it goes on."""

import numpy as np
import pytest

pytest.importorskip("bpy")

from forest_addon.growth.skeleton import Skeleton
from forest_addon.sensing.lidar import tractor as driven
from studies.__main__ import main
from studies.bench.lidar import first_hits
from studies.papers import simlidar, simlidar as orchards
from studies.papers.simlidar import Orchard, orchard_of, read_rows

SMALL = [
    Orchard(iterations=2, trees=1, smallest=0.006),
    Orchard(iterations=2, trees=2, smallest=0.006),
    Orchard(iterations=2, trees=1, smallest=0.006, pruned=False, stochastic=False),
]


@pytest.fixture
def small(monkeypatch):
    """An experiment of three small orchards."""
    monkeypatch.setattr(orchards, "experiment", lambda quick: SMALL)
    monkeypatch.setattr(orchards, "first_internode", lambda: 0.4)


def run(out, *more):
    return main(["simlidar", "--quick", "--out", str(out), "--quiet", *more])


def test_the_experiment_has_42_orchards_and_the_rows_of_table_3():
    all_of_them = orchards.experiment()
    assert len(set(all_of_them)) == len(all_of_them) == 42
    assert {o.smallest for o in all_of_them} == {0.005, 0.006, 0.007}
    assert {Orchard(*row[:2], 0.006) for row in orchards.TABLE_3} < set(all_of_them)
    assert set(orchards.experiment(quick=True)) < set(all_of_them)


def test_the_scanner_sees_all_of_an_orchard_in_scans_of_601_beams():
    forest = orchards.plant(SMALL[1], 0.4, seed=3)
    tractor = orchards.tractor_for(forest, 0)
    low, high = orchards.extent_along(forest)
    track = tractor.position[1] + driven.positions(tractor)
    assert len(driven.fan(tractor)) == 601
    assert len(track) % 5 == 0
    assert low - 0.01 <= track[0] <= low
    assert high <= track[-1] + tractor.step <= high + 0.01 + 1e-9


@pytest.mark.slow
def test_the_command_prints_both_tables_and_goes_on_where_it_was(
    small, tmp_path, capsys, monkeypatch
):
    assert run(tmp_path) == 0
    said = capsys.readouterr().out
    for word in ("Table 3", "A_PR = k·A_IM", "3.6166", "10.812", "one ray", "solid beam"):
        assert word in said
    assert (tmp_path / "regressions.png").read_bytes()[:4] == b"\x89PNG"
    first = (tmp_path / "orchards.csv").read_bytes()
    rows = read_rows(tmp_path / "orchards.csv")
    trees = read_rows(tmp_path / "trees.csv")
    assert [orchard_of(row) for row in rows] == SMALL
    assert [sum(t["trees"] == n for t in trees) for n in (1, 2)] == [2, 2]
    for row in rows:
        own = [t for t in trees if orchard_of(t) == orchard_of(row)]
        assert sum(t["impacted_m2"] for t in own) == pytest.approx(row["impacted_m2"], rel=1e-12)
        assert 0 < row["impacted_m2"] < row["impacted_solid_m2"]  # the solid beam sees wood thicker
        assert row["area_m2"] == pytest.approx(np.pi * row["projected_m2"], rel=1e-12)

    # Interrupted before the last orchard: only that one is done again.
    done = []
    observe = simlidar.observe

    def counted(orchard, *rest):
        done.append(orchard)
        return observe(orchard, *rest)

    monkeypatch.setattr(simlidar, "observe", counted)
    lines = first.splitlines(keepends=True)
    (tmp_path / "orchards.csv").write_bytes(b"".join(lines[:-1]))
    assert run(tmp_path) == 0
    assert done == SMALL[-1:]
    again = read_rows(tmp_path / "orchards.csv")
    still = {"build_s": 0, "scan_s": 0, "scan_solid_s": 0}
    assert [r | still for r in again] == [r | still for r in rows]


def test_ctrl_c_keeps_what_is_finished(small, tmp_path, monkeypatch, capsys):
    observe = simlidar.observe

    def until_the_second(orchard, *rest):
        if orchard == SMALL[1]:
            raise KeyboardInterrupt
        return observe(orchard, *rest)

    monkeypatch.setattr(simlidar, "observe", until_the_second)
    assert run(tmp_path) == 130
    assert "kept" in capsys.readouterr().err
    rows = read_rows(tmp_path / "orchards.csv")
    assert [orchard_of(row) for row in rows] == SMALL[:1]


def test_a_file_of_another_kind_is_refused(small, tmp_path, capsys):
    (tmp_path / "orchards.csv").write_text("a,b\n1,2\n")
    assert run(tmp_path) == 2
    assert "orchards.csv" in capsys.readouterr().err
    assert run(tmp_path / "new", "--seed", "-1") == 2


def test_exact_cones_against_closed_forms():
    """A frustum from r = 2 to 1 over a height of 4, from the side, from above, and past it."""
    cone = Skeleton(
        start=np.array([[0.0, 0.0, 0.0]]),
        end=np.array([[0.0, 0.0, 4.0]]),
        radius=np.array([[2.0, 1.0]]),
        parent=np.array([-1]),
        order=np.zeros(1, dtype=np.int64),
        generation=np.zeros(1, dtype=np.int64),
    )
    origins = np.array([[-10, 0, 2], [-10, 1.2, 0], [0.5, 0, 9], [1.5, 0, 9], [-10, 0, 4.1]], float)
    ways = np.array([[1, 0, 0], [1, 0, 0], [0, 0, -1], [0, 0, -1], [1, 0, 0]], float)
    # From the side r = 1.5 at z = 2; off the axis x² + y² = r²; from above the cap, and the wall at z = 2.
    expected = [8.5, 10 - 1.6, 5.0, 7.0, np.inf]
    assert first_hits(cone, origins, ways) == pytest.approx(expected)


def test_lines_through_the_origin():
    x, noise = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.1, -0.2, 0.1, 0.0])
    slope, r2 = simlidar.line_through_origin(x, 3.0 * x + noise)
    assert slope == pytest.approx(3.0, abs=1e-12)  # the noise is at right angles to x
    assert r2 == pytest.approx(1 - 0.06 / ((3 * x + noise).var() * 4))
    assert simlidar.line_through_origin(x, 2 * x) == (2.0, 1.0)
    with pytest.raises(ValueError, match="two points"):
        simlidar.line_through_origin(x[:1], x[:1])
    with pytest.raises(ValueError, match="not 0"):
        simlidar.line_through_origin(0 * x, x)
