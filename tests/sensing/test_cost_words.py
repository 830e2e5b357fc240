"""Cost of a run in words, as commands say it before they begin."""

import math

import pytest

from forest_addon.sensing.kind import Cost
from forest_addon.sensing.kinds import kind_of
from forest_addon.spec import Beam, Forest, Place, Reverb, Scene, Stems, Terrestrial


@pytest.mark.parametrize(
    ("cost", "words"),
    [
        (Cost("pings", 12, 12, 1.2, 0), "12 pings: about a second"),
        (
            Cost("pulses", 22_000_000, 154_000_000, 308.0, 9_900_000_000),
            "22,000,000 pulses of 154,000,000 rays: about 5 min, 9.9 GB",
        ),
        (Cost("pulses", 10**9, 10**9, 2e4, 0), "1,000,000,000 pulses: about 5.6 h"),
        (Cost("pulses", 9, 9, 1.1e11, 10**16), "9 pulses: about 30,555,556 h, 10,000,000 GB"),
    ],
)
def test_costs_in_words(cost, words):
    assert str(cost) == words


def test_a_reverb_takes_longer_with_heights_stems_and_a_forest_that_goes_on():
    """In proportion to cuts and to channels; a forest that goes on as stems of its number do."""
    level = Reverb(source=(5.0, 5.0, 1.5), receiver=(9.0, 5.0, 1.5))

    def among(*given):
        count = kind_of(level).cost(given[0], None, "embree").count
        return sum(kind_of(level).seconds_among(*given, count))

    field = Scene(name="field", forest=Forest(size=(100.0, 100.0)))
    stems = field.changed(stems=(Stems(count=30_000), Stems(count=10_000)))
    one = among(level, field, 100)
    assert among(level, field, 200) == pytest.approx(2 * one)
    high = [among(level.changed(receiver=(9.0, 5.0, 1.5 + rise)), field, 100) for rise in (6, 11.5)]
    assert (high[1] - one) / (high[0] - one) == pytest.approx(22 / 11)  # 23 and 12 heights
    pair = level.changed(receivers=(Place(position=(9.0, 7.0, 1.5)),))
    assert among(pair, stems, 0) == pytest.approx(2 * among(level, stems, 0))
    far = level.changed(continue_to=200.0)  # 0.01 trees/m² over π·4 ha, of which 100 stand
    as_many = field.changed(stems=(Stems(count=round(0.01 * math.pi * 200.0**2) - 100),))
    assert among(far, field, 100) == pytest.approx(among(level, as_many, 100), rel=1e-3)
    assert among(level, as_many, 100) < among(level, stems, 100)


def test_a_scanners_pulses_are_counted_before_they_are_sent():
    scanner = Terrestrial(angle_step_deg=1.0, elevation_deg=(0, 9), beam=Beam(subrays=7))
    assert str(kind_of(scanner).cost(scanner, None, "embree")).startswith("3,600 pulses of 25,200 ")
