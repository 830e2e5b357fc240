"""Trees as a tool tells them against what they are: pairs, errors, and what the tool says where it stops."""

import os
import stat

import numpy as np
import pytest

from studies.sim_to_real.tasks import (
    TaskFindings,
    errors_of,
    matched,
    run_tasks,
    run_tool,
    task_subject,
)

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
    from forest_addon.spec import SpecError

    with pytest.raises(SpecError, match="pip install 3DFin"):
        run_tasks(str(tmp_path / "none"), None, tmp_path, 1, 1)


@pytest.mark.medium
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
