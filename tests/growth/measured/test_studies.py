"""Leaf areas of conifers as half of their surface: by each study's way, and against weighed needles."""

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.growth.library.species_file import FOLDER, read_allometry, read_measured
from forest_addon.growth.measured.allometry import measures
from forest_addon.spec import SpecError

HEADER = "study,species,pft,dbh_m,height_m,crown_width_m,crown_base_m,leaf_area_m2,leaf_area_is\n"
# Needle mass, kg: exp(a + b·d/(d + c) + e·h/(h + 1) + s²/2), d = 2 + 1.25 D/cm (Repola 2009, models 1); half
# of the surface, m² a kg: Palmroth & Hari 2001, Stenberg et al. 1999, as Majasalmi et al. 2013 put together.
WEIGHED = {
    "picea-abies": (-2.994, 12.251, 10.0, -3.415, 0.098, 4.95),
    "pinus-sylvestris": (-6.303, 14.472, 6.0, -3.976, 0.1135, 6.2),
}


def weighed(name, dbh, height):
    a, b, c, e, half, area = WEIGHED[name]
    d = 2 + 125 * dbh
    return area * np.exp(a + b * d / (d + c) + e * height / (height + 1) + half)


@pytest.mark.parametrize(
    ("row", "area"),
    [
        ("Burger1953,Picea abies,EG,0.2,15,3,5,100,", 50.0),
        ("Garber2005,Abies grandis,EG,0.2,15,3,5,100,", 114.0),
        ("Garber2005,Pinus ponderosa,EG,0.2,15,3,5,100,", 50.0),
        ("Roberts2003,Pinus taeda,EG,0.2,15,3,5,100,", 100 / 0.778),
        ("Burger1953,Fagus sylvatica,DA,0.2,15,3,5,100,", 100.0),  # a leaf's area is one side of it
        ("mine,Picea abies,EG,0.2,15,3,5,100,", 100.0),
        ("mine,Picea abies,EG,0.2,15,3,5,100,all", 50.0),
        ("Burger1953,Picea abies,EG,0.2,15,3,5,100,half", 100.0),
    ],
)
def test_leaf_areas_are_read_as_half_of_the_surface(tmp_path, row, area):
    path = tmp_path / "trees.csv"
    path.write_text(HEADER + row + "\n")
    assert read_measured(path)["leaf_area"] == pytest.approx([area])


def test_a_way_of_counting_that_is_not_known_is_told(tmp_path):
    path = tmp_path / "trees.csv"
    path.write_text(HEADER + "mine,Picea abies,EG,0.2,15,3,5,100,total\n")
    with pytest.raises(SpecError, match='row 2: "total" is none of half, all, outline'):
        read_measured(path)


@pytest.mark.parametrize("name", WEIGHED)
def test_leaves_of_a_stem_are_those_of_needles_that_were_weighed(name):
    """Within a third of Finnish needle masses times their area, 12 to 35 cm; all sides would double it."""
    dbh = np.linspace(0.12, 0.35, 12)
    ours = measures(read_allometry(name, FOLDER), dbh, np.zeros((12, 4)))
    ratio = ours[:, 3] / weighed(name, dbh, ours[:, 0])
    assert 0.66 < ratio.min() < ratio.max() < 1.34
    assert np.exp(np.log(ratio).mean()) == pytest.approx(1, abs=0.25)


@pytest.mark.parametrize(
    ("name", "basal_area", "low", "high"),
    [("picea-abies", 40, 5, 10), ("pinus-sylvestris", 25, 1.5, 4), ("abies", 40, 4, 10)],
)
def test_a_closed_stand_has_a_leaf_area_index_that_is_measured(name, basal_area, low, high):
    dbh = np.linspace(0.15, 0.4, 6)
    trees = basal_area / 1e4 / (np.pi / 4 * dbh**2)
    index = trees * measures(read_allometry(name, FOLDER), dbh, np.zeros((6, 4)))[:, 3]
    assert low < index.min() < index.max() < high


@needs_measurements
def test_sapwood_of_every_diameter_fits_heights_that_trees_have():
    """Pines whose diameters were inches: 10 cm or more of stem by 15 m of height, not 4."""
    table = read_measured(FOUND / "baad_trees.csv")
    own = table["study"] == "OHara1995"
    assert own.sum() == 103
    slender = table["height"][own] / table["dbh"][own]
    others = (table["study"] != "OHara1995") & np.char.startswith(table["species"], "Pinus p")
    middle = np.nanmedian(table["height"][others] / table["dbh"][others])
    assert np.median(slender) == pytest.approx(middle, rel=0.25)
