"""Domain randomisation by one word: within published ranges, below the plan's own words."""

import numpy as np
import pytest
from scipy.special import psi

from forest_addon.formats.toml_file import read_scanner
from forest_addon.spec import SpecError
from headless.dataset import vary
from headless.dataset.plan import PLANS, read_plan, recipes, redealt

TRIPODS = (
    *("faro-focus-s350", "leica-blk360", "ouster-os1-128", "riegl-vz-400", "riegl-vz-400i"),
    "velodyne-vlp-16",
)


def drawn(path, *overrides):
    return [one.varied for one in recipes(read_plan(path, overrides))]


@pytest.mark.medium
def test_a_word_draws_instruments_noise_undergrowth_and_ground():
    plan = PLANS / "measured-stands.toml"
    found = drawn(plan, "randomise=measured", "count=60")
    instruments = {one["sensors[*].scanner"] for one in found}
    assert instruments == set(TRIPODS)
    spread = [read_scanner(name).tables["terrestrial"]["noise"]["range_sd"] for name in TRIPODS]
    own = [one["sensors[*].noise.range_sd"] for one in found]
    assert min(own) >= 0.001  # the plan's own [vary] goes over it
    assert max(own) <= 0.006 < max(spread)
    assert {one["forest.undergrowth"] for one in found} == {"sparse", "dense"}  # likewise
    settings = [
        one.settings() for one in recipes(read_plan(plan, ("randomise=measured", "count=8")))
    ]
    assert len({scene.sensors[0].beam.divergence_mrad for scene in settings}) > 1
    assert all(scene.sensors[0].max_range == 40.0 for scene in settings)  # the plan's, not theirs


def test_a_mix_and_a_plain_scene(tmp_path):
    path = tmp_path / "mix.toml"
    path.write_text(
        'count = 40\nrandomise = "measured"\n[scene]\n[[scene.sensors]]\nkind = "airborne"\n'
        'name = "als"\nposition = [0.0, 0.0, 100.0]\n'
        '[mix]\nspecies = ["maple", "hazelnut"]\ndensity = 0.01\n'
    )
    found = drawn(path)
    assert {one["forest.undergrowth"] for one in found} == {"none", "sparse", "dense"}
    density = [one["mix.density"] for one in found]
    assert 0.005 <= min(density) < 0.008
    assert 0.013 < max(density) <= 0.02
    assert {tuple(one["mix.kinds"]) for one in found} == {(1, 1), (2, 2)}
    assert len({one["sensors[*].scanner"] for one in found}) > 3


def test_ears_have_no_instruments(tmp_path):
    found = drawn(PLANS / "echoes.toml", "randomise=measured", "count=4")
    assert not any("scanner" in key for one in found for key in one)


def test_receivers_of_sonars_differ_in_level_noise_and_wind(tmp_path):
    path = tmp_path / "ears.toml"
    path.write_text(
        'count = 30\nrandomise = "measured"\n[scene]\n[[scene.sensors]]\nkind = "sonar"\n'
        'receiver = { source_level_db = 110, self_noise_db = 20, ambient = "wind" }\n'
        '[mix]\nspecies = ["maple"]\ndensity = 0.01\n'
    )
    every = [one.settings().sensors[0].receiver for one in recipes(read_plan(path))]
    levels, noise, wind = np.transpose(
        [(one.source_level_db, one.self_noise_db, one.wind_speed) for one in every]
    )
    for values, (low, high) in ((levels, vary.SOURCE_LEVEL), (noise, (14, 26)), (wind, (0.5, 9))):
        assert low <= values.min() < values.max() <= high
        assert np.ptp(values) > 0.7 * (high - low)  # chance of less in 30: 3e-4


def test_what_cannot_be_used_is_said(tmp_path):
    with pytest.raises(SpecError, match="randomise"):
        read_plan(PLANS / "tiny.toml", ("randomise=wild",))
    path = tmp_path / "grid.toml"
    path.write_text(
        'randomise = "measured"\n[scene]\n[vary]\n"air.humidity" = { grid = [40.0, 60.0] }\n'
    )
    with pytest.raises(SpecError, match="count"):
        read_plan(path)


STANDS = """randomise = "measured"
count = 500
[scene]
[[scene.plantings]]
species = "norway-spruce"
density = 0.03
[[scene.plantings]]
species = "european-beech"
density = 0.01
[[scene.sensors]]
kind = "terrestrial"
name = "tls"
max_range = 40.0
angle_step_deg = 0.2
"""
RANGES = {  # by the tables of docs/dataset.md
    "terrain.relief": (0.0, 6.0),
    "mix.redealt": (0.6, 30.0),
    "wind.speed": (0.0, 9.0),
    "sensors[*].noise.range_sd": (0.00025, 0.02),
    "sensors[*].noise.registration_sd": (0.003, 0.012),
    "sensors[*].angle_step_deg": (0.15, 0.3),
}


@pytest.fixture
def stands(tmp_path):
    (tmp_path / "stands.toml").write_text(STANDS)
    return tmp_path / "stands.toml"


def test_draws_stay_within_their_ranges_and_reach_both_ends(stands):
    """Of 500 draws one is in each outermost fiftieth: none is by chance in 4e-5 of the cases each."""
    plan = read_plan(stands)
    found = vary.draw(plan.varied, 3, 500)
    thresholds = []
    for name in TRIPODS:
        table = read_scanner(name).tables["terrestrial"]
        if "faintest" in table:
            # As bright at 40 m as the sheet's surface at the sheet's range: the light falls with its square.
            thresholds.append(table["faintest"] / table["max_range"] ** 2 * 40.0**2)
    spread = [read_scanner(name).tables["terrestrial"]["noise"]["range_sd"] for name in TRIPODS]
    ranges = RANGES | {
        "sensors[*].faintest": (min(thresholds), max(thresholds)),
        "sensors[*].noise.range_sd": (min(spread), max(spread)),
    }
    for key, (low, high) in ranges.items():
        values = np.array([one[key] for one in found])
        if low > 0 and key != "sensors[*].angle_step_deg":
            values, low, high = np.log(values), np.log(low), np.log(high)
        share = (values - low) / (high - low)
        assert -1e-9 <= share.min() < 0.02, key
        assert 0.98 < share.max() <= 1 + 1e-9, key
    season = np.array([one["mix.season"] for one in found])
    assert abs((season == 0).mean() - 160 / 365) < 0.09  # four standard deviations
    assert abs((season == 1).mean() - 175 / 365) < 0.09
    assert set(season.tolist()) == {0.0, 0.25, 0.5, 0.75, 1.0}


@pytest.mark.medium
def test_what_is_drawn_reaches_the_scene_by_its_seed_and_evergreens_keep_their_needles(stands):
    plan = read_plan(stands)
    one = recipes(plan, [2])[0]
    assert one == recipes(read_plan(stands), [0, 2])[1]
    scene = one.settings()
    assert scene.wind.speed == one.varied["wind.speed"]
    assert scene.sensors[0].faintest == one.varied["sensors[*].faintest"]
    assert scene.plantings[0].season == 0.0
    assert scene.plantings[1].season == one.varied["mix.season"]
    density = [planting.density for planting in scene.plantings]
    assert sum(density) == pytest.approx(0.04)
    assert density != [0.03, 0.01]
    other = recipes(read_plan(stands, ("seed=1",)), [2])[0]
    assert other.varied["wind.speed"] != one.varied["wind.speed"]


def test_lines_of_an_aircraft_are_off_by_drawn_errors_that_change(tmp_path):
    """One of 100 draws is in each outermost tenth: none is by chance in 3e-5 of the cases each."""
    path = tmp_path / "lines.toml"
    path.write_text(
        'count = 100\nrandomise = "measured"\n[scene]\n[[scene.sensors]]\nkind = "airborne"\n'
        '[mix]\nspecies = ["maple"]\ndensity = 0.01\n'
    )
    noise = [one.settings().sensors[0].noise for one in recipes(read_plan(path))]
    for name, ends in vary.LINES.items():
        values = np.log([getattr(one, f"registration_{name}") for one in noise])
        low, high = np.log(ends)
        share = (values - low) / (high - low)
        assert -1e-9 <= share.min() < 0.1 < 0.9 < share.max() <= 1 + 1e-9


def test_densities_dealt_anew_keep_their_mean_and_their_evenness():
    """Mean shares, and entropies of a Dirichlet distribution: psi(2 a + 1) - psi(a + 1)."""
    for parameter in (0.6, 3.0):
        rng = np.random.default_rng(5)
        own = [{"density": 0.02}, {"density": 0.02}, {"species": "a shrub that has none"}]
        dealt = [redealt(own, parameter, rng) for _ in range(4000)]
        share = np.array([[one["density"] / 0.04 for one in each[:2]] for each in dealt])
        assert all(each[2] == own[2] for each in dealt)
        assert np.allclose(share.sum(axis=1), 1)
        assert abs(share[:, 0].mean() - 0.5) < 4 * share[:, 0].std() / 4000**0.5
        with np.errstate(divide="ignore", invalid="ignore"):
            entropy = -np.nansum(share * np.log(share), axis=1)
        expected = psi(2 * parameter + 1) - psi(parameter + 1)
        assert abs(entropy.mean() - expected) < 4 * entropy.std() / 4000**0.5


def test_plans_without_the_word_draw_nothing_more(stands):
    plan = read_plan(stands, ("randomise=none",))
    one = recipes(plan, [0])[0]
    assert one.varied == {}
    assert [planting.density for planting in one.settings().plantings] == [0.03, 0.01]
    assert [planting.season for planting in one.settings().plantings] == [0.0, 0.0]
