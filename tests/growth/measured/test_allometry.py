"""Laws of size: what a fit finds in trees of known laws, and what is drawn from it."""

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import (
    FOLDER,
    allometry_names,
    read_allometry,
    read_measured,
)
from forest_addon.growth.measured.allometry import (
    KINDS,
    MEASURES,
    band,
    draw,
    fit_kind,
    measures,
    scores,
)
from forest_addon.spec import SpecError

NOTHING = np.nan


def trees(count, rng, width=2.5):
    """A table of trees whose laws are known: H = 20 (D/0.2)^0.6, W = ..., with correlated residuals."""
    dbh = np.exp(rng.uniform(np.log(0.05), np.log(0.5), count))
    x = np.log(dbh / 0.2)
    shared, own = rng.standard_normal(count), rng.standard_normal((count, 3))
    height = 20 * np.exp(0.6 * x + 0.15 * shared)
    return {
        "species": np.full(count, "Picea abies"),
        "pft": np.full(count, "EG"),
        "dbh": dbh,
        "height": height,
        "crown_width": width * np.exp(0.5 * x + 0.1 * (0.6 * shared + 0.8 * own[:, 0])),
        "crown_base": height / (1 + np.exp(0.3 - 0.4 * x + 0.5 * own[:, 1])),
        "leaf_area": 60 * np.exp(1.8 * x + 0.3 * own[:, 2]),
    }


def test_a_fit_finds_the_laws_that_the_trees_were_made_by():
    found = fit_kind("Picea abies", trees(4000, stream(1, "fit")), "")
    assert found.height.intercept == pytest.approx(np.log(20), abs=0.02)
    assert found.height.slope == pytest.approx(0.6, abs=0.03)
    assert found.height.high == pytest.approx(1.645 * 0.15, rel=0.08)
    assert found.leaf_area.slope == pytest.approx(1.8, abs=0.04)
    assert found.crown_base.intercept == pytest.approx(-0.3, abs=0.05)
    assert found.correlation[0] == pytest.approx(0.6, abs=0.04)
    assert abs(found.correlation[2]) < 0.05  # 4,000 trees: three standard errors
    assert found.height.of == ""


def test_too_few_trees_of_a_kind_borrow_and_say_so():
    table = trees(400, stream(2, "fit"))
    table["species"] = np.where(np.arange(400) < 20, "Abies alba", "Picea abies")
    assert fit_kind("Abies", table, "").height.of == "evergreen conifer"
    with pytest.raises(SpecError, match="not in the table"):
        fit_kind("Ginkgo biloba", table, "")


def test_drawn_trees_fill_the_measured_band():
    """Scores cut at two standard deviations: 94.3 % between the 5 and 95 % points, 1,000 trees ± 3.1 %."""
    kind = read_allometry("picea-abies", FOLDER)
    dbh = np.exp(stream(3, "dbh").uniform(np.log(0.05), np.log(0.6), 1000))
    drawn = draw(kind, dbh, np.full((1000, 4), NOTHING), stream(3, "draw").random((1000, 4)))
    z = scores(kind, dbh, drawn)
    inside = np.abs(z) <= 1.645
    assert (inside.mean(axis=0) > 0.91).all()
    assert (inside.mean(axis=0) < 0.98).all()
    assert np.abs(np.median(z, axis=0)).max() < 0.15
    assert (drawn[:, 2] < drawn[:, 0]).all()
    low, high = band(kind, dbh)
    assert ((drawn[:, 0] > low[:, 0]) & (drawn[:, 0] < high[:, 0])).mean() > 0.91
    assert np.corrcoef(z[:, 0], z[:, 3])[0, 1] == pytest.approx(kind.correlation[2], abs=0.12)


def test_what_is_given_stays_and_what_is_drawn_knows_of_it():
    kind = read_allometry("picea-abies", FOLDER)
    dbh = np.full(2000, 0.3)
    given = np.full((2000, 4), NOTHING)
    tall = measures(kind, dbh[:1], np.full((1, 4), 1.5))[0, 0]
    given[:, 0] = tall
    drawn = draw(kind, dbh, given, stream(4, "draw").random((2000, 4)))
    assert (drawn[:, 0] == tall).all()
    z = scores(kind, dbh, drawn)
    expected = 1.5 * np.array(kind.correlation[:3])
    assert z[:, 1:].mean(axis=0) == pytest.approx(
        expected, abs=0.12
    )  # the cut at 2 sd takes a little


def test_a_tree_is_the_same_however_many_are_drawn():
    kind = read_allometry("fagus", FOLDER)
    uniform = stream(5, "draw").random((50, 4))
    many = draw(kind, np.full(50, 0.2), np.full((50, 4), NOTHING), uniform)
    few = draw(kind, np.full(7, 0.2), np.full((7, 4), NOTHING), stream(5, "draw").random((7, 4)))
    assert many[:7] == pytest.approx(few, rel=1e-12)


def test_at_least_a_dozen_kinds_and_four_types_are_shipped():
    assert len(allometry_names()) >= 16
    for name in allometry_names():
        kind = read_allometry(name, FOLDER)
        assert kind.source
        low, high = band(kind, np.array([0.05, 0.2, 0.4]))
        assert (low < high).all()
        assert (np.diff(low[:, :2], axis=0) > 0).all()  # thicker trees are taller and wider


@pytest.mark.medium
@needs_measurements
def test_shipped_files_are_what_the_measured_table_says():
    table = read_measured(FOUND / "baad_trees.csv")
    for name in KINDS:
        shipped = read_allometry(name.lower().replace(" ", "-"), FOLDER)
        assert fit_kind(name, table, shipped.source) == shipped


def test_a_name_that_is_not_there_is_told():
    with pytest.raises(SpecError, match="picea-abies"):
        read_allometry("picea", FOLDER)
    assert len(MEASURES) == 4
