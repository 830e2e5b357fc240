"""A map that was drawn by a law is given that law, and a scene of it stands like the map."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Clusters, Forest, Gaussian, Planting, Scene, SpecError, Strauss
from forest_addon.stand.compose import Inputs, process_of
from forest_addon.stand.plan import draw_places
from headless.commands.estimate import estimate_site

FIELD = Forest(size=(100.0, 100.0))
EVEN = Planting(species="maple", expected=300)
HILLS = Planting(
    species="maple",
    expected=300,
    gaussians=(
        Gaussian(peak=1.0, centre=(30.0, 40.0), width=(20.0, 20.0)),
        Gaussian(peak=0.7, centre=(75.0, 70.0), width=(25.0, 15.0)),
    ),
)
MADE = {
    "even": (EVEN, {"poisson"}),
    "hills": (HILLS, {"poisson"}),
    # 60 groups in the window; of which shape they are, 300 trees hardly say.
    "groups": (
        EVEN.changed(layout="clusters", clusters=Clusters(groups=0.006, spread=1.5)),
        {"clusters"},
    ),
    "apart": (
        EVEN.changed(layout="strauss", strauss=Strauss(radius=3.0, gamma=0.05)),
        {"strauss"},
    ),
}


def mapped(planting, seed, path):
    """A CSV of trees that this planting draws."""
    points = draw_places(planting, process_of(planting, FIELD, Inputs()), stream(seed, "a map"))
    path.write_text("x,y\n" + "".join(f"{x:.3f},{y:.3f}\n" for x, y in points))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("made", MADE)
def test_the_law_of_a_map_is_found_again(tmp_path, made, monkeypatch):
    planting, layouts = MADE[made]
    if layouts == {"poisson"}:  # chance rejects that in 5 % of maps, by as few simulations as by 39
        monkeypatch.setattr("forest_addon.stand.statistics.law.SIMULATIONS", 19)
    window = ["0", "0", "100", "100"]
    said = []
    scene = estimate_site(
        mapped(planting, 5, tmp_path / "map.csv"),
        tmp_path / "like.toml",
        window=window,
        species=["maple"],
        say=said.append,
    )
    (found,) = read_settings(scene, Scene).plantings
    assert found.layout in layouts
    assert len(found.gaussians) == len(planting.gaussians)
    if made == "groups":
        assert np.isclose(found.clusters.groups, 0.006, rtol=0.5)
        assert np.isclose(found.clusters.spread, 1.5, rtol=0.5)
        assert "tried too: poisson" in "\n".join(said)
    if made == "apart":
        assert np.isclose(found.strauss.radius, 3.0, rtol=0.25)
        assert found.strauss.gamma < 0.3


def test_a_law_that_does_not_fit_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("forest_addon.stand.statistics.law.SIMULATIONS", 19)
    rows = "".join(f"{x},{y}\n" for x in range(2, 40, 4) for y in range(2, 40, 4))
    (tmp_path / "grid.csv").write_text("x,y\n" + rows)
    with pytest.raises(SpecError, match=r"--law: .*a kernel estimate is Poisson"):
        estimate_site(
            tmp_path / "grid.csv", tmp_path / "s.toml", "kernel", species=["maple"], law="thomas"
        )
    (tmp_path / "three.csv").write_text("x,y\n1,1\n5,5\n")
    with pytest.raises(SpecError, match="show no groups at any distance; leave --law out"):
        estimate_site(tmp_path / "three.csv", tmp_path / "s.toml", species=["maple"], law="matern")
