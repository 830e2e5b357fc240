"""Panels that a fast sum leaves out, against the exact sum over the same trunks."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.sums.audible import Audibility
from forest_addon.sensing.reverb.sums.scattering import scattered_spectrum, trunk_paths
from forest_addon.sensing.reverb.trunks.slices import Trunks

SPEED, LOST, TOLERANCE = 343.0, 3e-6, 1e-4  # nepers a metre and Hz: 0.04 at 12 kHz


def loss(frequency: np.ndarray) -> np.ndarray:
    return LOST * frequency


@pytest.mark.medium
@pytest.mark.parametrize(("reach", "heard"), [(60.0, True), (600.0, False)])
def test_far_trunks_are_left_out_where_nothing_hears_them(reach, heard):
    """Of 8 kHz and more; what is left out is fainter than a hundredth of the tolerance at each frequency."""
    rng = stream(2, "test", "audible")
    turn, away = rng.uniform(0, 2 * np.pi, 300), rng.uniform(0.8, 1.0, 300)
    away[:20] *= 12.0
    away[20:] *= reach
    place = away[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    trunks = Trunks(place, rng.uniform(0.05, 0.3, 300), np.arange(300))
    ends = np.array([[-5.0, 0.0], [5.0, 0.0]])
    paths = trunk_paths(trunks, ends[0], ends[1], 2.0, 0.7)
    far = paths.select(away > 20.0)
    found = Audibility(paths, loss, SPEED, TOLERANCE)
    assert found.heard(found.energy_of(far), 100.0, 300.0)
    assert found.heard(found.energy_of(far), 8e3, 12e3) == heard
    frequency = np.arange(81) * 150.0
    whole, of_far = (
        np.abs(scattered_spectrum(some, 150.0, loss(frequency), SPEED)[54:])
        for some in (paths, far)
    )
    assert heard == (np.sqrt(np.mean(of_far**2)) > 0.01 * TOLERANCE * np.sqrt(np.mean(whole**2)))
