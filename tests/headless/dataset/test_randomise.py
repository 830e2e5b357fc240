"""Domain randomisation by one word: within published ranges, below the plan's own words."""

import pytest

from forest_addon.formats.scanner_file import read_scanner
from forest_addon.spec import SpecError
from headless.dataset.plan import PLANS, read_plan, recipes

TRIPODS = ("faro-focus-s350", "leica-blk360", "ouster-os1-128", "riegl-vz-400i", "velodyne-vlp-16")


def drawn(path, *overrides):
    return [one.varied for one in recipes(read_plan(path, overrides))]


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
    assert all(0 <= one["terrain.relief"] <= 3 for one in found)
    assert len({one["sensors[*].scanner"] for one in found}) > 3


def test_ears_have_no_instruments(tmp_path):
    found = drawn(PLANS / "echoes.toml", "randomise=measured", "count=4")
    assert not any("scanner" in key for one in found for key in one)


def test_what_cannot_be_used_is_said(tmp_path):
    with pytest.raises(SpecError, match="randomise"):
        read_plan(PLANS / "tiny.toml", ("randomise=wild",))
    path = tmp_path / "grid.toml"
    path.write_text(
        'randomise = "measured"\n[scene]\n[vary]\n"air.humidity" = { grid = [40.0, 60.0] }\n'
    )
    with pytest.raises(SpecError, match="count"):
        read_plan(path)
