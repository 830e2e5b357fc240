"""Leaves incline as a species says, whatever bears them, and nothing else of the tree changes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.own_trees import own_tree
from scipy import stats

from forest_addon.base.rng import daughter_keys, stream
from forest_addon.base.trimesh import LEAF
from forest_addon.growth.draw import draw_inclination
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.blades import facings, truth_of
from forest_addon.growth.mesh.leaves import incline_sites, measure_leaves, turns
from forest_addon.growth.skeleton import LeafSites
from forest_addon.growth.tree import blade_of, grow
from forest_addon.spec import Inclination, Siblings, SpecError, Species, Template

KEYS = daughter_keys(np.zeros(20_000, np.uint64), np.arange(20_000))
STEEP = Inclination(mean_deg=60, sd_deg=12)
UNLIKELY = (
    1e-4  # a right draw is refused by chance once in ten thousand; keys are fixed, so never by luck
)


def beta_of(spread):
    """The beta distribution of a mean and a standard deviation, from scipy."""
    mean, spare = spread.mean_deg / 90, (spread.sd_deg / 90) ** 2
    both = mean * (1 - mean) / spare - 1
    return stats.beta(mean * both, (1 - mean) * both, scale=np.pi / 2)


def angles_of(leaves):
    return np.arccos(np.clip(np.abs(leaves.normal[:, 2]), 0, 1))


@pytest.mark.parametrize(("mean", "sd"), [(27, 17), (55, 20), (3, 2), (87, 2), (45, 30)])
def test_draws_follow_the_beta_distribution(mean, sd):
    spread = Inclination(mean_deg=mean, sd_deg=sd)
    drawn = draw_inclination(spread, KEYS)
    assert np.rad2deg(drawn.mean()) == pytest.approx(mean, abs=4 * sd / np.sqrt(len(KEYS)))
    assert stats.kstest(drawn, beta_of(spread).cdf).pvalue > UNLIKELY


def test_draws_follow_shares_of_classes():
    drawn = np.rad2deg(draw_inclination(Inclination(shares=(1, 0, 3)), KEYS))
    counts = np.histogram(drawn, [0, 30, 60, 90])[0]
    assert counts[1] == 0
    assert stats.binomtest(int(counts[0]), len(KEYS), 0.25).pvalue > UNLIKELY
    assert stats.kstest(drawn[drawn < 30] / 30, "uniform").pvalue > UNLIKELY


def test_a_turned_leaf_has_the_inclination_and_keeps_its_azimuth():
    rng = stream(1, "turned")
    normal = rng.normal(size=(500, 3))
    normal[:2] = (0, 0, 1), (0, 0, -1)  # flat: no azimuth
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    axis = np.cross(normal, rng.normal(size=(500, 3)))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    wanted = rng.uniform(0, np.pi / 2, 500)
    turn = turns(normal, axis, wanted)
    assert np.allclose(turn @ np.swapaxes(turn, 1, 2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turn), 1)
    now = np.einsum("lij,lj->li", turn, normal)
    assert np.allclose(np.arccos(np.clip(np.abs(now[:, 2]), 0, 1)), wanted, atol=1e-7)
    some = slice(2, None)
    facing = [np.arctan2(v[:, 1], v[:, 0]) for v in (normal[some], now[some])]
    assert np.allclose(*facing, atol=1e-6)
    tip = np.einsum("lij,lj->li", turn[:1], axis[:1])
    assert tip[0, 2] == pytest.approx(-np.sin(wanted[0]))  # a flat leaf tips downwards


def test_curled_leaves_that_hang_incline_as_wanted_too():
    """A curled leaf faces not as its foot does, and leaves of hanging twigs all lean the same way."""
    species, _ = load_species(find_species("silver-birch", Path()))
    blade = blade_of(species, None)
    assert blade.curved
    rng = np.random.default_rng(3)
    down = rng.normal(size=(200, 3)) * [0.3, 0.3, 0.1] - [0, 0, 1]
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    up = np.cross(down, rng.normal(size=(200, 3)))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    size = np.full(200, 0.05)
    sites = LeafSites(np.zeros((200, 3)), down, up, size, 0.7 * size, np.zeros(200, np.int64))
    wanted = rng.uniform(0.05, 1.5, 200)
    inclined = incline_sites(sites, wanted, facings(sites, blade))
    truth = truth_of(inclined, blade, np.zeros(200, np.int64))
    assert np.allclose(angles_of(truth), wanted, atol=1e-7)


def grown(kind, inclination):
    if kind == "sibling":
        species = Species(
            name="x", template=Template(wood="w.stl"), siblings=Siblings(), inclination=inclination
        )
        return grow(species, own_tree("whorled").habit, stream(4, "incline"))
    species, template = load_species(find_species(kind, Path()))
    return grow(replace(species, inclination=inclination), template, stream(4, "incline"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hazelnut", "apple", "sibling", "honda-broadleaf"])
def test_trees_of_every_growth_incline_their_leaves(kind):
    """A template's branches, rules, siblings and W's branching."""
    plain, steep = grown(kind, None), grown(kind, STEEP)
    assert (plain.skeleton.end == steep.skeleton.end).all()
    assert (plain.mesh.triangles == steep.mesh.triangles).all()
    wood = np.unique(plain.mesh.triangles[plain.mesh.part != LEAF])
    assert (plain.mesh.vertices[wood] == steep.mesh.vertices[wood]).all()
    assert np.allclose(plain.leaves.radius, steep.leaves.radius)
    away = np.linalg.norm(plain.leaves.centre - steep.leaves.centre, axis=1)
    assert (away < 2 * plain.leaves.length).all()  # they hang where they hung
    assert stats.kstest(angles_of(steep.leaves), beta_of(STEEP).cdf).pvalue > UNLIKELY
    again = measure_leaves(steep.mesh, steep.leaves.branch)
    assert np.allclose(np.abs(np.einsum("li,li->l", again.normal, steep.leaves.normal)), 1)


def test_what_cannot_be_a_distribution_is_refused():
    with pytest.raises(SpecError, match="40 is too wide for a mean of 10; use at most"):
        Inclination(mean_deg=10, sd_deg=40)
    with pytest.raises(SpecError, match="are all zero"):
        Inclination(shares=(0, 0))
