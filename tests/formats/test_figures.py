"""Figures of a result: worded once, the same value in the report and in the panel."""

import dataclasses

import numpy as np
import pytest

from forest_addon.results.figures import facts, words
from forest_addon.results.kinds import RESULTS, figures_of
from forest_addon.results.reverb import of_response
from forest_addon.sensing.reverb.metrics import octave_bands
from forest_addon.sensing.reverb.response import ImpulseResponse
from forest_addon.spec import Reverb


def response(direct_clear=True, further=()):
    """A decay of 60 dB/s after an impulse."""
    time = np.arange(24_000) / 24_000
    decay = 10.0 ** (-3 * time)
    return ImpulseResponse(
        sample_rate=24_000.0,
        direct=np.where(time == 0, 1.0, 0.0),
        ground=np.zeros_like(time),
        trees=0.1 * decay,
        direct_delay=0.0,
        direct_clear=direct_clear,
        ground_clear=True,
        trunks=1234,
        continued=0,
        late=0,
        clamped=0,
        exact=True,
        left_db=np.full(1 + len(octave_bands(24_000.0)), -np.inf),
        errors={},
        further=further,
    )


def test_numbers_of_a_response():
    shown = facts(of_response(response(), trunks=5000))
    assert shown["trunks cut from the scene"] == "5,000"
    assert shown["trunks heard"] == "1,234"
    assert float(shown["reverberation time"].removesuffix(" s")) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("trunks", "continued", "stands", "said"),
    [
        (0, 0, 0, "no trunks heard"),
        (12, 0, 9, "12 stems of 9 trees heard"),
        (4492, 4472, 4481, "20 stems of 9 trees heard, and 4,472 trunks around the scene"),
        (4492, 4480, 4492, "4,492 trunks heard"),
        (12, 4, -1, "12 trunks heard"),
    ],
)
def test_trunks_beyond_the_scene_are_no_trees_of_it(trunks, continued, stands, said):
    of = {"trunks": trunks, "continued": continued, "stands": stands}
    assert RESULTS["reverb"].sentence(dataclasses.replace(response(), **of)) == said


def test_a_path_of_several_channels():
    blocked = dataclasses.replace(response(direct_clear=False), channel="other")
    found = figures_of(Reverb(), response(further=(blocked,)))
    (path,) = [each for each in found if each.name == "direct path"]
    assert path.text == "blocked by wood in 1 of 2"
    assert path.pattern.format(**path.values) == path.text
    assert facts(figures_of(Reverb(), blocked))["direct path"] == "blocked by wood"


def test_a_reverb_whose_tolerance_was_not_reached_is_warned_of():
    found = dataclasses.replace(response(), errors={20.0: 3e-4, 40.0: 1e-4})
    (warning,) = RESULTS["reverb"].doubts(Reverb(tolerance=1e-4), found)
    assert "3e-04 off from 20 to 40 Hz, where 1e-04 was asked for" in warning
    assert RESULTS["reverb"].doubts(Reverb(tolerance=1e-3), found) == ()


def test_the_tail_says_how_sure_its_level_is():
    error = np.array([np.nan, 5.25, *np.full(len(octave_bands(24_000.0)) - 2, 0.3)])
    found = of_response(dataclasses.replace(response(), tail_error=error))
    assert facts(found)["standard error of the tail's level by octave"].startswith("62.5 Hz 5.2 dB")
    (shown,) = [each.text for each in found if each.short == "Tail Error"]
    assert shown == "5.2 dB at 62.5 Hz"
    assert "Tail Error" not in [each.short for each in of_response(response())]


def test_no_name_twice():
    error = np.ones(len(octave_bands(24_000.0)))
    found = of_response(dataclasses.replace(response(), tail_error=error), trunks=1)
    for names in ([each.name for each in found], [each.short for each in found]):
        named = [name for name in names if name]
        assert len(named) == len(set(named))


def test_braces_in_a_text_stay():
    assert words("a", "A", "as {it} is").text == "as {it} is"
    assert words("a", "A", "{n:,} of them", n=1200).text == "1,200 of them"
