"""Cost of a run in words, as commands say it before they begin."""

import pytest

from forest_addon.sensing.cost import Cost
from forest_addon.sensing.kinds import kind_of
from forest_addon.spec import Beam, Terrestrial


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


def test_a_scanners_pulses_are_counted_before_they_are_sent():
    scanner = Terrestrial(angle_step_deg=1.0, elevation_deg=(0, 9), beam=Beam(subrays=7))
    assert str(kind_of(scanner).cost(scanner, None, "embree")).startswith("3,600 pulses of 25,200 ")
