"""Plans: designs that are what they say, recipes that depend on what decides a scene, and words for
mistakes."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from forest_addon.spec import SpecError
from headless.dataset.plan import PLANS, idle_in_plan, read_plan, recipes, split_of
from headless.dataset.vary import draw, read_varied

SMALL = Path(__file__).with_name("small.toml")
MIX = """
count = 60
[scene]
[[scene.sensors]]
kind = "terrestrial"
name = "tls"
[mix]
species = ["maple", "hazelnut", "apple", "ginkgo"]
kinds = [1, 2]
"""


def values(distribution, count=400, **more):
    varied = read_varied({"air.humidity": {**distribution, **more}})
    return np.array([one["air.humidity"] for one in draw(varied, 3, count)])


@pytest.mark.parametrize("design", ["independent", "latin", "sobol"])
@pytest.mark.parametrize(
    ("distribution", "quantile"),
    [
        ({"uniform": [2.0, 4.0]}, lambda u: 2 + 2 * u),
        ({"log_uniform": [1.0, 100.0]}, lambda u: 100**u),
        ({"normal": [5.0, 1.0], "low": -95.0, "high": 105.0}, lambda u: 5 + ndtri(u)),
    ],
)
def test_distributions_have_their_quantiles(design, distribution, quantile):
    found = np.sort(values(distribution, design=design))
    u = (np.arange(400) + 0.5) / 400
    # Kolmogorov: sup |F - u| > 1.95/√400 with a chance of 0.001 where draws are independent.
    place = np.searchsorted(found, quantile(u)) / 400
    assert np.abs(place - u).max() < (0.0976 if design == "independent" else 0.0075)


def test_a_latin_hypercube_has_one_scene_in_each_slice():
    found = values({"uniform": [0.0, 1.0]}, 37, design="latin")
    assert sorted(np.floor(found * 37)) == list(range(37))


def test_first_scenes_of_a_sobol_design_stay_when_more_are_asked_for():
    few, many = (values({"uniform": [0.0, 1.0]}, n, design="sobol") for n in (10, 50))
    assert np.array_equal(few, many[:10])


def test_grids_go_through_all_combinations_and_choices_keep_their_weights():
    varied = read_varied({"a": {"grid": [1, 2, 3]}, "b": {"grid": ["x", "y"]}})
    assert Counter((one["a"], one["b"]) for one in draw(varied, 1, 12)) == Counter(
        {(a, b): 2 for a in (1, 2, 3) for b in "xy"}
    )
    found = values({"choice": [0, 1], "weights": [1, 3]}, 1000)
    assert abs(found.mean() - 0.75) < 4.5 * np.sqrt(0.75 * 0.25 / 1000)
    assert set(values({"integers": [2, 4]}).tolist()) == {2, 3, 4}
    assert values({"fixed": 3.0, "times": 2}, 1).tolist() == [[3.0, 3.0]]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("vary.air.humidty={uniform=[1.0,2.0]}", ("small.toml", "air.humidty", "humidity")),
        ("vary.air.humidity={unifrom=[1.0,2.0]}", ("vary.air.humidity.unifrom", "uniform")),
        ("vary.air.humidity={uniform=[2.0,1.0]}", ("vary.air.humidity", "[low, high]")),
        ("vary.sensors[als].max_range=3.0", ("[als] is not there", "tls")),
        ("keep.voxls=1.0", ("keep.voxls", "voxels", "Allowed")),
        ('place[0].rule="middle"', ("place[0].rule", "centre")),
        ('place[0].sensor="als"', ("place[0].sensor", "tls")),
        ("splits.train=0.9", ("splits.train", "add up to 1")),
        ('trees="shared"', ("trees", "shared library of N")),
        ("cuont=3", ("cuont", "Allowed", "count")),
        ("vary.air.humidity={fixed=300.0}", ("air.humidity", "at most 100")),
    ],
)
def test_mistakes_are_named_with_file_key_and_what_is_allowed(said, words):
    with pytest.raises(SpecError) as problem:
        recipes(read_plan(SMALL, [said]))
    assert "small.toml" in str(problem.value)
    for word in words:
        assert word in str(problem.value)


def test_tiles_of_one_large_field_are_refused(tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(MIX.replace("[scene]\n", "[scene]\n[scene.tiles]\nsize = 50\n"))
    with pytest.raises(SpecError, match=r"scene 000000: tiles: are for one large field"):
        recipes(read_plan(plan))


def test_a_recipe_changes_with_what_decides_the_bytes_and_with_nothing_else(tmp_path):
    digests = [r.digest for r in recipes(read_plan(SMALL))]
    assert len(set(digests)) == 4
    (tmp_path / "small.toml").write_text(SMALL.read_text())
    moved = read_plan(tmp_path / "small.toml", ['licence="other"', "run.timeout=9.0"])
    assert [r.digest for r in recipes(moved)] == digests
    assert recipes(read_plan(SMALL, ["keep.voxels=0.5"]))[0].digest != digests[0]
    assert recipes(read_plan(SMALL, ["seed=6"]))[0].digest != digests[0]


def test_a_recipe_knows_the_content_of_the_files_that_it_names(tmp_path):
    text = SMALL.read_text().replace('"apple", "whorl-8"', '"mine.toml"')
    (tmp_path / "plan.toml").write_text(text)
    preset = (PLANS.parent / "species" / "honda-birch.toml").read_text()
    (tmp_path / "mine.toml").write_text(preset)
    before = recipes(read_plan(tmp_path / "plan.toml"))[0].digest
    other = tmp_path / "other"
    other.mkdir()
    (other / "plan.toml").write_text(text)
    (other / "mine.toml").write_text("# changed\n" + preset)
    assert recipes(read_plan(other / "plan.toml"))[0].digest != before


def mixed(tmp_path, more=""):
    (tmp_path / "plan.toml").write_text(MIX + more)
    return read_plan(tmp_path / "plan.toml")


def test_any_run_of_scenes_has_nearly_the_shares_that_were_asked_for(tmp_path):
    plan = mixed(tmp_path)
    splits = [split_of(plan, number) for number in range(60)]
    for first in range(0, 40, 5):
        counts = Counter(splits[first : first + 20])
        for split, share in (("train", 0.7), ("validation", 0.15), ("test", 0.15)):
            assert abs(counts[split] - 20 * share) <= 2


def test_splits_by_species_share_none(tmp_path):
    plan = mixed(tmp_path, '[splits]\nby = "species"\n')
    known = {}
    for recipe in recipes(plan):
        for planting in recipe.scene["plantings"]:
            known.setdefault(planting["species"], set()).add(recipe.split)
    assert all(len(splits) == 1 for splits in known.values())
    assert {split for splits in known.values() for split in splits} == {
        "train",
        "validation",
        "test",
    }


@pytest.mark.medium
def test_libraries_are_a_splits_own_unless_told_otherwise(tmp_path):
    head = 'trees = "shared library of 9"\n'
    (tmp_path / "plan.toml").write_text(head + MIX)
    found = {(r.split, r.library) for r in recipes(read_plan(tmp_path / "plan.toml"))}
    assert len(found) == 3
    assert len({library for _, library in found}) == 3
    (tmp_path / "plan.toml").write_text(head + MIX + "[splits]\nshare_trees = true\n")
    assert len({r.library for r in recipes(read_plan(tmp_path / "plan.toml"))}) == 1


@pytest.mark.medium
def test_poses_of_a_scanner_on_its_way_are_said_to_be_idle(tmp_path):
    path = tmp_path / "way.toml"
    path.write_text(
        'count = 2\n[scene]\n[[scene.sensors]]\nkind = "mobile"\nname = "walk"\n'
        '[mix]\nspecies = ["maple"]\n[[place]]\nsensor = "walk"\nrule = "path"\ncount = 3\n'
    )
    (said,) = [one for one in idle_in_plan(read_plan(path)) if one.startswith("place")]
    assert "place[0].count has no effect on the way of a scanner" in said


@pytest.mark.parametrize("name", sorted(path.stem for path in PLANS.glob("*.toml")))
def test_shipped_plans_can_be_used(name):
    plan = read_plan(PLANS / f"{name}.toml", ["count=5"])
    assert not [one for one in idle_in_plan(plan) if one.startswith("place")]
    assert len({recipe.digest for recipe in recipes(plan)}) == 5


CHANCELESS = """
count = 20
[scene]
[mix]
species = ["abop-ternary-a", "apple-stochastic"]
kinds = [2, 2]
"""


@pytest.mark.medium
@pytest.mark.parametrize(
    "more",
    ["[splits]\nshare_trees = true\n", "[splits]\ntrain = 1.0\nvalidation = 0.0\ntest = 0.0\n"],
)
def test_species_that_know_no_chance_are_refused_where_splits_would_share_their_tree(
    tmp_path, more
):
    path = tmp_path / "plan.toml"
    path.write_text(CHANCELESS)
    with pytest.raises(SpecError, match='splits: "abop-ternary-a" knows no chance') as problem:
        recipes(read_plan(path))
    assert "plan.toml" in str(problem.value)
    assert "\n" not in str(problem.value)
    path.write_text(CHANCELESS + more)
    assert len(recipes(read_plan(path))) == 20


def test_a_species_of_one_split_may_know_no_chance(tmp_path):
    species = '["abop-ternary-a", "apple-stochastic", "maple"]'
    text = CHANCELESS.replace('["abop-ternary-a", "apple-stochastic"]', species)
    (tmp_path / "plan.toml").write_text(text + '[splits]\nby = "species"\n')
    assert len(recipes(read_plan(tmp_path / "plan.toml"))) == 20


def test_a_flight_above_its_scanners_range_is_refused(tmp_path):
    path = tmp_path / "plan.toml"
    text = """
[[scene.sensors]]
kind = "airborne"
name = "als"
max_range = 60.0

[mix]
species = ["apple-stochastic"]

[[place]]
sensor = "als"
rule = "over"
height = 80.0
"""
    path.write_text(text)
    with pytest.raises(
        SpecError, match=r'80 m above the ground is beyond the range of "als", 60 m'
    ):
        recipes(read_plan(path, ["count=2"]))
    assert recipes(read_plan(path, ["count=2", "keep.empty=true"]))
    assert recipes(read_plan(path, ["count=2", "place[0].height=50.0"]))


@pytest.mark.parametrize("name", sorted(path.stem for path in PLANS.glob("*.toml")))
def test_nothing_in_a_plan_that_is_shipped_is_idle(name):
    """Distances of strips, figures of instruments and what is switched off are no slips."""
    assert idle_in_plan(read_plan(PLANS / f"{name}.toml")) == []
