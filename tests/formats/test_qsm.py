"""TreeQSM's files: the structure that its readers walk, and the numbers of the skeleton."""

import numpy as np
import pytest
from scipy.io import loadmat

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.growth.library import load_species
from forest_addon.results.tables import write_cylinders, write_models
from forest_addon.stand.forest import cylinder_table, grow_forest, inventory

CYLINDER = (  # names by which rTwig and aRchi take them
    *("radius", "length", "start", "axis", "parent", "extension", "added", "UnmodRadius"),
    *("branch", "SurfCov", "mad", "BranchOrder", "PositionInBranch"),
)
BRANCH = (
    *("order", "parent", "diameter", "volume", "area"),
    *("length", "angle", "height", "azimuth", "zenith"),
)


@pytest.fixture(scope="module")
def grown():
    scene = spec.Scene(
        seed=3,
        forest=spec.Forest(size=(20.0, 20.0)),
        plantings=(
            spec.Planting(species="abop-monopodial-a", variants=2, expected=3, exact=True),
            spec.Planting(species="scots-pine", variants=1, expected=2, exact=True),
        ),
    )
    kinds = [load_species(ASSETS / "species" / f"{p.species}.toml") for p in scene.plantings]
    return grow_forest(scene, kinds)


@pytest.mark.medium
def test_models_hold_the_trees(grown, tmp_path):
    table, stand = cylinder_table(grown), inventory(grown)
    paths = list(write_models(tmp_path / "qsm", table, (1000.0, 0.0, 0.0)))
    assert len(paths) == len(grown.stand)
    for row, path in enumerate(paths):
        qsm = loadmat(path, simplify_cells=True)["QSM"]
        cylinder, branch, data = qsm["cylinder"], qsm["branch"], qsm["treedata"]
        assert [name for name in CYLINDER if name not in cylinder] == []
        assert [name for name in BRANCH if name not in branch] == []
        mine = table["tree"] == grown.stand.id[row]
        assert len(cylinder["radius"]) == mine.sum()
        assert cylinder["start"].shape == cylinder["axis"].shape == (mine.sum(), 3)
        assert np.allclose(cylinder["start"][:, 0], table["startX"][mine] + 1000.0)
        end = cylinder["start"] + cylinder["axis"] * cylinder["length"][:, None]
        assert np.allclose(end[:, 2], table["endZ"][mine], atol=1e-9)
        assert np.isclose(data["TotalVolume"], 1e3 * table["volume"][mine].sum())
        assert np.isclose(branch["volume"].sum(), data["TotalVolume"])
        assert np.isclose(data["DBHqsm"], stand["dbh_m"][row], rtol=0.06)
        # a branch is one run of cylinders, each the extension of the one before
        for number in (1, int(cylinder["branch"].max())):
            run = np.flatnonzero(cylinder["branch"] == number)
            run = run[np.argsort(cylinder["PositionInBranch"][run])]
            assert (cylinder["PositionInBranch"][run] == np.arange(1, len(run) + 1)).all()
            assert (cylinder["extension"][run[:-1]] == run[1:] + 1).all()
            assert len(set(cylinder["BranchOrder"][run])) == 1
        daughters = branch["parent"] > 0
        mothers = branch["order"][branch["parent"][daughters].astype(int) - 1]
        assert (branch["order"][daughters] == mothers + 1).all()


@pytest.mark.medium
def test_the_table_is_that_of_the_map(grown, tmp_path):
    write_cylinders(tmp_path / "cylinders.csv", cylinder_table(grown), (0.0, 5.0, 0.0))
    read = np.genfromtxt(tmp_path / "cylinders.csv", delimiter=",", names=True)
    assert np.allclose(read["startY"], cylinder_table(grown)["startY"] + 5.0, atol=1e-5)
