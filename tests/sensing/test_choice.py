"""What is left to "auto": from files and from Python, bounds that hold, and what knows no auto."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings, structure, table_of, write_settings
from forest_addon.sensing.kinds import choose
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import AUTO, Air, Reverb, Scene, Sonar, SpecError, Terrestrial

AUTOS = [Sonar(tolerance="auto", cull="auto"), Reverb(tolerance="auto")]


@pytest.mark.parametrize("sensor", AUTOS, ids=["sonar", "reverb"])
def test_the_word_in_a_file_and_in_python(sensor, tmp_path):
    assert sensor.tolerance == AUTO
    assert table_of(sensor)["tolerance"] == "auto"
    write_settings(tmp_path / "scene.toml", Scene(sensors=(sensor,)))
    assert 'tolerance = "auto"' in (tmp_path / "scene.toml").read_text()
    assert read_settings(tmp_path / "scene.toml", Scene).sensors == (sensor,)


@pytest.mark.parametrize("sensor", AUTOS, ids=["sonar", "reverb"])
def test_nothing_is_left_to_auto_and_each_choice_has_its_bound(sensor):
    made, chosen = choose(sensor)
    assert AUTO not in vars(made).values()
    assert all(getattr(made, choice.key) == choice.value for choice in chosen)
    assert all(0 < choice.bound < 0.01 and choice.why for choice in chosen)
    assert choose(made) == (made, ())


def test_a_cruder_leaf_is_summed_more_coarsely():
    exact, paper = (choose(AUTOS[0].changed(leaf_model=m))[0] for m in ("exact", "paper"))
    assert exact.tolerance < paper.tolerance
    assert exact.cull < paper.cull
    assert choose(Sonar(tolerance=1e-3, cull="auto"))[0].cull == pytest.approx(1e-2)


def test_what_has_nothing_to_choose_stays():
    tripod = Terrestrial()
    assert choose(tripod) == (tripod, ())


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"kind": "sonar", "max_range": "auto"}, "max_range"),
        ({"kind": "sonar", "tolerance": "automatic"}, "tolerance"),
        ({"kind": "reverb", "tolerance": -0.5}, 'or "auto"'),
        ({"kind": "reverb", "strength": -1.0}, "strength"),
    ],
)
def test_only_what_can_be_chosen_may_be_left_to_it(table, words):
    with pytest.raises(SpecError) as said:
        structure({"sensors": [table]}, Scene)
    assert words in str(said.value)


@pytest.mark.slow
def test_a_chosen_reverb_keeps_its_bound():
    rng = stream(3, "choice")
    place = rng.uniform(-60, 60, (3000, 2))
    place = place[np.linalg.norm(place, axis=1) > 3]
    trunks = Trunks(place, np.exp(rng.uniform(-4, -1, len(place))), np.arange(len(place)))
    clap = Reverb(source=(0, 0, 1.5), receiver=(2, 0, 1.5), sample_rate=8000, duration=0.3)
    made, (choice,) = choose(clap.changed(tolerance="auto"))
    fast = impulse_response(trunks, made, Air()).trees
    exact = impulse_response(trunks, clap.changed(tolerance=0.0), Air()).trees
    assert np.linalg.norm(fast - exact) <= choice.bound * np.linalg.norm(exact)


def test_what_only_the_direct_sum_keeps_is_served_and_said():
    made, (choice,) = choose(Reverb(tolerance=1e-8))
    assert made.tolerance == 1e-8
    assert "direct sum" in str(choice)
    assert choice.record()["asked"] == 1e-8
    assert choose(Reverb(tolerance=1e-6)) == (Reverb(tolerance=1e-6), ())
