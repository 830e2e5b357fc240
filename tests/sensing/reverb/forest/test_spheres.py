"""Transport against exact waves among finite scatterers in space: soft and hard spheres in a ball."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from references.spheres import answers, received, scattered
from references.transport_in_space import in_ball_turned

from forest_addon.base.rng import stream

RADIUS, WAVENUMBER, LONGEST, SAMPLES = 4.0, 5.0, 40.0, 512  # m; 1/m; m of path; of the pulses
EDGES = (2.5, 4.0, 6.0, 8.5, 12.0, 16.0)
PAIRS = 8, 24  # sources; receivers of each, 2 m away


def test_one_sphere_keeps_energy_and_two_agree_with_reciprocity() -> None:
    cosine, weight = np.polynomial.legendre.leggauss(40)
    for soft in (True, False):
        whole = 2.0 * math.pi * weight @ scattered(5.0, 0.3, soft, cosine)
        each = answers(1.5, soft, 6)
        forward = (2.0 * np.arange(7) + 1.0) @ each / 5.0
        assert whole == pytest.approx(-4.0 * math.pi / 5.0 * forward.real, rel=1e-3)
        two = np.array([[0.0, 0.0, 0.5], [0.4, 0.0, -0.5]])
        ends = np.array([[0.0, 2.0, 0.3], [1.5, -1.0, 0.0]])
        given = 5.0, two, 0.3, soft, 4
        there, back = received(*given, ends[:1], ends[1:]), received(*given, ends[1:], ends[:1])
        assert there == pytest.approx(back, rel=1e-9)


def drawn(count: int, radius: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Spheres that overlap neither each other nor the ends; sources and their receivers."""
    way = rng.normal(size=(PAIRS[0], 3))
    sources = 0.5 * way / np.linalg.norm(way, axis=1, keepdims=True)
    way = rng.normal(size=(*PAIRS, 3))
    receivers = sources[:, None] + 2.0 * way / np.linalg.norm(way, axis=2, keepdims=True)
    ends, found = np.concatenate([sources, receivers.reshape(-1, 3)]), np.empty((0, 3))
    while len(found) < count:
        place = rng.normal(size=3)
        place *= RADIUS * rng.random() ** (1 / 3) / np.linalg.norm(place)
        apart = np.linalg.norm(found - place, axis=1).min(initial=np.inf) > 2.0 * radius
        if apart and np.linalg.norm(ends - place, axis=1).min() > radius:
            found = np.vstack([found, place])
    return found, sources, receivers


@pytest.mark.slow
@pytest.mark.parametrize(
    ("soft", "ka", "count", "orders", "stands"), [(True, 0.5, 120, 1, 4), (False, 1.0, 80, 2, 3)]
)
def test_waves_among_spheres_have_the_energy_of_transport(soft, ka, count, orders, stands) -> None:
    """Within 1.5 dB at all times, transport spread as the pulses are, which a band makes metres long."""
    rng, radius = stream(5, "test", "spheres"), ka / WAVENUMBER
    wavenumbers = WAVENUMBER + 2.0 * math.pi / LONGEST * np.arange(-8, 9)
    window = np.hanning(len(wavenumbers) + 2)[1:-1]
    step = LONGEST / SAMPLES
    pulse = np.square(np.abs(np.fft.ifft(window, SAMPLES)))
    energy = np.zeros(SAMPLES)
    own = np.arange(PAIRS[0])
    for _ in range(stands):
        spheres, sources, receivers = drawn(count, radius, rng)
        spectra = []
        for k in wavenumbers:
            found = received(k, spheres, radius, soft, orders, sources, receivers.reshape(-1, 3))
            spectra.append(found.reshape(*PAIRS, PAIRS[0])[own, :, own].ravel())
        pulses = np.fft.ifft(np.array(spectra).conj() * window[:, None], SAMPLES, axis=0)
        energy += np.square(np.abs(pulses)).mean(axis=1) / (pulse.sum() * step * stands)
    cosine = (np.arange(400) + 0.5) / 200.0 - 1.0
    turned = scattered(WAVENUMBER, radius, soft, cosine)
    rate = count / (4 / 3 * math.pi * RADIUS**3) * 4.0 * math.pi * turned.mean()
    fine = np.arange(SAMPLES + 1) * step
    expected = in_ball_turned(rate, turned, RADIUS, (0.5, 2.0), fine, 50_000, rng)
    spread = np.fft.fft(pulse / pulse.sum())
    expected = np.fft.ifft(np.fft.fft(expected) * spread).real
    for low, high in pairwise(EDGES):
        within = (fine[:-1] >= low) & (fine[:-1] < high)
        apart = 10.0 * math.log10(energy[within].mean() / expected[within].mean())
        assert abs(apart) < 1.5
