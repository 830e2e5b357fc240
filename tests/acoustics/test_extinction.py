"""Cross-sections against published limits and energy balance; bark against fundamental solutions."""

import numpy as np
import pytest
from references.cylinders_mfs import scattered_mfs
from scipy import special

from forest_addon.acoustics.cylinder import (
    order_count,
    partial_waves,
    scattering_sum,
    surface_admittance,
)
from forest_addon.acoustics.extinction import cross_sections
from forest_addon.acoustics.foliage import foliage_loss
from forest_addon.acoustics.ground import coherence

KA = np.array([0.1, 1.0, 5.0, 30.0, 200.0])


def test_rigid_trunks_have_the_known_widths_and_absorb_nothing():
    found = cross_sections(KA)
    known = [0.00369, 1.00019, 1.66507, 1.90620, 1.97437]
    np.testing.assert_allclose(found.extinction / 2.0, known, rtol=1e-3)
    known = [0.01226, 2.6597, 2.5750, 2.6533, 2.6654]
    np.testing.assert_allclose(found.transport, known, rtol=1e-3)
    np.testing.assert_allclose(found.absorption, 0.0, atol=1e-12)


def test_energy_extinction_is_all_of_it_for_thin_trunks_and_the_width_for_thick_ones():
    found = cross_sections(KA)
    assert found.energy[0] == pytest.approx(found.extinction[0], rel=1e-6)
    assert found.energy[-1] == pytest.approx(2.0, rel=0.01)


def test_large_trunks_absorb_what_rays_lose():
    """At each angle a ray loses 1 - |(cosθ - β)/(cosθ + β)|², θ from head on; over the width of the trunk."""
    beta = float(surface_admittance(np.array([200.0]), 0.1)[0])
    across = (np.arange(20_000) + 0.5) / 10_000 - 1.0
    cosine = np.sqrt(1.0 - across**2)
    lost = 1.0 - ((cosine - beta) / (cosine + beta)) ** 2
    found = cross_sections(np.array([200.0]), 0.1).absorption[0]
    assert found == pytest.approx(2.0 * lost.mean(), rel=0.05)


@pytest.mark.parametrize("ka", [0.3, 1.5, 4.0])
def test_bark_against_fundamental_solutions(ka):
    bark, k = 0.3, 2.0
    radius = ka / k
    source, receiver = np.array([-3.0, 0.4]), np.array([[2.5, 1.0], [-4.0, 2.0]])
    beta = float(surface_admittance(np.array([ka]), bark)[0])
    exact = scattered_mfs(k, np.zeros((1, 2)), np.array([radius]), source, receiver, 60, beta)
    waves = partial_waves(np.array([ka]), order_count(ka), bark)[:, 0]
    r = np.hypot(*receiver.T)
    turned = np.arctan2(receiver[:, 1], receiver[:, 0]) - np.arctan2(source[1], source[0])
    found = np.zeros(2, complex)
    for n, wave in enumerate(waves):
        both = special.hankel1(n, k * np.hypot(*source)) * special.hankel1(n, k * r)
        found += (1 if n == 0 else 2) * 1j * wave * both * np.cos(n * turned)
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_bark_that_absorbs_almost_nothing_changes_almost_nothing():
    ka, angle = np.array([1e-4, 0.3, 5.0, 300.0])[:, None], np.linspace(0.0, np.pi, 5)
    rigid, nearly = scattering_sum(ka, angle), scattering_sum(ka, angle, 1e-9)
    np.testing.assert_allclose(nearly, rigid, rtol=1e-7, atol=1e-7 * np.abs(rigid).max(1).min())


def test_leaves_take_what_was_measured_of_their_absorption():
    """1 m²/m³ that absorbs 15 % at 10 kHz: energy falls by e^{-0.15/2} a metre."""
    loss = foliage_loss(np.array([0.0, 10_000.0]), 1.0, 0.0015)
    np.testing.assert_allclose(np.exp(-2.0 * loss), [1.0, np.exp(-0.075)], rtol=1e-6)


def test_air_takes_more_coherence_of_longer_paths_higher_sounds_and_ways_farther_apart():
    k, path, apart = np.array(20.0), np.array(50.0), np.array(1.5)
    here = coherence(k, path, apart, 5e-6)
    assert 0 < coherence(2 * k, path, apart, 5e-6) < here < 1
    assert coherence(k, 2 * path, apart, 5e-6) < here
    assert coherence(k, path, apart / 10, 5e-6) > here
    assert coherence(k, path, apart, 0.0) == 1
