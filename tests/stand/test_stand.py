"""The stand against its laws. Every statistical test states its false-alarm rate."""

import numpy as np
import pytest
from scipy import integrate, stats

from forest_addon.base.rng import stream
from forest_addon.spec import Forest, Gaussian, Planting
from forest_addon.stand.compose import process_of
from forest_addon.stand.layouts import sample
from forest_addon.stand.plan import Spacing, labels, matern_ii, plan_stand

FIELD = Forest(size=(20.0, 20.0))
HILLS = Planting(
    species="maple",
    gaussians=(
        Gaussian(
            peak=0.4, centre=(5.0, 5.0), width=(5**0.5, 6**0.5)
        ),  # Tanveer et al. 2020a's example
        Gaussian(peak=0.3, centre=(19.0, 15.0), width=(3.0, 9.0)),  # reaches over the edge
    ),
)


@pytest.mark.medium
def test_integral_is_the_numerical_one():
    intensity = process_of(HILLS, FIELD)

    def at(y, x):
        return float(intensity.at(np.array([[x, y]]))[0])

    for low, high in [((0, 0), (20, 20)), ((3, 4), (6, 9)), ((15, 0), (20, 20))]:
        numeric = integrate.dblquad(at, low[0], high[0], low[1], high[1], epsabs=1e-8)[0]
        assert intensity.expected(np.array(low), np.array(high)) == pytest.approx(numeric, abs=1e-6)


@pytest.mark.medium
def test_counts_in_rectangles_are_poisson():
    intensity = process_of(HILLS, FIELD)
    samples = [sample(intensity, stream(s, "count")) for s in range(1500)]
    for low, high in [((0, 0), (20, 20)), ((3, 3), (6, 8)), ((16, 5), (20, 20))]:
        low, high = np.array(low), np.array(high)
        counts = np.array([((p >= low) & (p < high)).all(axis=1).sum() for p in samples])
        mean = intensity.expected(low, high)
        # Mean and dispersion, 2 tests on 3 rectangles at 4.5 sigma: false alarm below 5e-5.
        assert abs(counts.mean() - mean) < 4.5 * np.sqrt(mean / len(counts))
        dispersion = counts.var(ddof=1) / mean
        assert abs(dispersion - 1) < 4.5 * np.sqrt(2 / len(counts) + 1 / (mean * len(counts)))


@pytest.mark.medium
def test_positions_follow_the_intensity():
    intensity = process_of(HILLS, FIELD)
    x = np.concatenate([sample(intensity, stream(s, "pit")) for s in range(600)])[:, 0]
    low, high = np.zeros(2), np.array([20.0, 20.0])
    at, total = np.linspace(0, 20, 401), intensity.expected(low, high)
    below = np.array([intensity.expected(low, np.array([v, 20.0])) for v in at]) / total
    assert stats.kstest(x, lambda v: np.interp(v, at, below)).pvalue > 1e-4  # false alarm 1e-4


def test_disjoint_cells_are_independent():
    intensity = process_of(HILLS, FIELD)
    counts = np.array(
        [
            [(p[:, 0] < 10).sum(), (p[:, 0] >= 10).sum()]
            for p in (sample(intensity, stream(s, "cells")) for s in range(1500))
        ]
    )
    assert abs(np.corrcoef(counts.T)[0, 1]) < 4.5 / np.sqrt(1500)  # false alarm 7e-6


@pytest.mark.parametrize("gaussians", [HILLS.gaussians, ()])
def test_expected_number_scales_the_intensity(gaussians):
    planting = Planting(species="m", expected=37.5, gaussians=gaussians)
    assert process_of(planting, FIELD).expected() == pytest.approx(37.5, rel=1e-12)


def test_zero_trees_and_nothing_to_scale():
    assert len(plan_stand(0, FIELD, [])) == 0
    assert len(plan_stand(0, FIELD, [Planting(species="m", expected=0)])) == 0
    far = (Gaussian(centre=(1e6, 0.0), width=(1.0, 1.0)),)
    with pytest.raises(ValueError, match="put nothing on the field"):
        process_of(Planting(species="m", expected=3, gaussians=far), FIELD)


def test_too_many_trees_are_refused_with_the_number():
    with pytest.raises(ValueError, match="40,000,000 trees"):
        sample(process_of(Planting(species="m", expected=1e5), FIELD).scaled(400), stream(0, "x"))


def test_one_huge_spike_is_sampled_at_its_place():
    spike = Planting(
        species="m", gaussians=(Gaussian(peak=1e6, centre=(3.0, 4.0), width=(0.01, 0.01)),)
    )
    points = sample(process_of(spike, FIELD), stream(0, "spike"))
    mean = 1e6 * np.pi * 1e-4
    assert abs(len(points) - mean) < 5 * np.sqrt(mean)
    assert np.abs(points - [3, 4]).max() < 0.06


@pytest.mark.parametrize("distance", [0.0, 0.5, 2.0, 100.0])
def test_spacing_is_kept_and_equals_the_definition(distance):
    rng = stream(4, "spacing")
    points, mark = rng.uniform(0, 20, (400, 2)), rng.random(400)
    alike = Spacing(np.array([[distance]]), np.zeros(400, dtype=int), np.zeros(400))
    keep = matern_ii(points, mark, alike)
    gap = np.linalg.norm(points[:, None] - points[None], axis=2)
    older_near = (gap < distance) & (mark[None, :] < mark[:, None])
    np.fill_diagonal(older_near, False)
    assert (keep == ~older_near.any(axis=1)).all()
    if distance == 100.0:
        assert keep.sum() == 1  # the oldest tree
    kept = gap[np.ix_(keep, keep)] + np.eye(keep.sum()) * 1e9
    assert kept.min(initial=np.inf) >= distance


def test_adding_a_species_moves_no_tree_of_another():
    maple = Planting(species="maple", expected=30)
    hazel = Planting(species="hazelnut", expected=50)
    alone = plan_stand(9, FIELD, [maple])
    for both in (plan_stand(9, FIELD, [maple, hazel]), plan_stand(9, FIELD, [hazel, maple])):
        place = (
            0 if both is not None and (both.position[: len(alone)] == alone.position).all() else 1
        )
        mine = both.species == (place if len(both) else 0)
        for name in ("position", "rotation", "scale", "variant"):
            assert (getattr(both, name)[mine] == getattr(alone, name)).all()


def test_labels_tell_plantings_of_one_species_apart():
    names = ("maple", "maple", "my/maple.toml", "hazelnut", "maple")
    made = labels([Planting(species=n, expected=1) for n in names])
    assert made == ["maple", "maple-2", "maple-3", "hazelnut", "maple-4"]
    assert len(set(made)) == len(made)


@pytest.mark.parametrize("names", [("pine-2", "pine", "pine"), ("pine", "pine", "pine-2")])
def test_no_species_has_the_label_of_another(names):
    made = labels([Planting(species=name, expected=1) for name in names])
    assert len(set(made)) == 3


def test_scales_stay_in_their_range_and_variants_too():
    stand = plan_stand(
        1, FIELD, [Planting(species="m", expected=500, variants=3, scale=(0.5, 2.0))]
    )
    assert stand.scale.min() >= 0.5
    assert stand.scale.max() <= 2.0
    assert set(stand.variant.tolist()) == {0, 1, 2}
    # Turns are uniform: Kolmogorov-Smirnov, false alarm 1e-4.
    assert stats.kstest(stand.rotation / (2 * np.pi), "uniform").pvalue > 1e-4
