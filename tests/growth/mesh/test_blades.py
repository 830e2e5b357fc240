"""Leaves laid at sites: their truth is what the triangles measure; thinning keeps the area."""

from dataclasses import replace

import numpy as np
import pytest

from forest_addon.base.trimesh import LEAF
from forest_addon.growth.mesh.blades import (
    SHAPES,
    BladeError,
    blade_from,
    lay,
    leaf_areas,
    thin_leaves,
    truth_of,
)
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.skeleton import LeafSites


def random_sites(count=300, seed=0):
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    length = rng.uniform(0.03, 0.1, count)
    return LeafSites(
        foot=rng.normal(size=(count, 3)) * 5,
        direction=frame[:, :, 0],
        up=frame[:, :, 1],
        length=length,
        width=length * rng.uniform(0.2, 0.7, count),
        segment=rng.integers(0, 50, count),
    )


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_truth_is_what_the_mesh_measures(shape):
    sites, blade = random_sites(), SHAPES[shape]()
    mesh = lay(sites, blade)
    truth, measured = truth_of(sites, blade, sites.segment), measure_leaves(mesh)
    np.testing.assert_allclose(truth.centre, measured.centre, atol=1e-12)
    np.testing.assert_allclose(truth.normal, measured.normal, atol=1e-9)
    np.testing.assert_allclose(truth.radius, measured.radius, rtol=1e-9)
    np.testing.assert_allclose(leaf_areas(sites, blade), np.pi * measured.radius**2, rtol=1e-9)
    assert (mesh.part == LEAF).all()
    assert (mesh.material == 1).all()
    assert mesh.uv.min() >= 0
    assert mesh.uv.max() <= 1
    facing = np.einsum("ti,ti->t", mesh.area_vectors(), sites.up[mesh.leaf])
    assert facing.min() > 0
    reach = np.einsum(
        "ti,ti->t",
        mesh.vertices[mesh.triangles[:, 0]] - sites.foot[mesh.leaf],
        sites.direction[mesh.leaf],
    )
    assert reach.min() > -1e-12


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_shapes_fill_their_unit_frame(shape):
    blade = SHAPES[shape]()
    np.testing.assert_allclose(blade.vertices.min(axis=0)[0], 0, atol=1e-12)
    np.testing.assert_allclose(blade.vertices.max(axis=0)[0], 1, atol=1e-12)
    assert (blade.vertices[0] == 0).all() or shape == "ellipse"
    assert np.abs(blade.vertices[0]).max() < 1e-12  # the first corner is the foot
    if shape == "ellipse":
        assert blade.share == pytest.approx(np.pi / 4, rel=1e-12)
    else:
        assert np.ptp(blade.vertices[:, 1]) == pytest.approx(1)


@pytest.mark.parametrize("share", [0.5, 0.1, 0.003])
def test_thinning_keeps_the_total_area(share):
    sites, blade = random_sites(1000), SHAPES["maple"]()
    few = thin_leaves(sites, share, np.random.default_rng(4))
    assert len(few) == round(1000 * share)
    whole = np.linalg.norm(lay(sites, blade).area_vectors(), axis=1).sum()
    kept = np.linalg.norm(lay(few, blade).area_vectors(), axis=1).sum()
    assert kept == pytest.approx(whole, rel=1e-9)
    more = thin_leaves(sites, min(1, 2 * share), np.random.default_rng(4))
    assert {tuple(f) for f in few.direction} <= {tuple(f) for f in more.direction}


def test_thinning_nothing_and_everything():
    none = LeafSites.none()
    assert len(thin_leaves(none, 0.5, np.random.default_rng(0))) == 0
    assert len(lay(none, SHAPES["ellipse"]()).triangles) == 0
    sites = random_sites(10)
    assert thin_leaves(sites, 1.0, np.random.default_rng(0)) is sites
    assert (
        len(thin_leaves(sites, 0.0, np.random.default_rng(0))) == 1
    )  # the area has to be somewhere


def test_a_leaf_of_the_users_own():
    """A kite drawn 30 cm long in a tilted plane, its stalk near the origin."""
    kite = np.array([[0, 0, 0], [0.1, -0.06, 0], [0.3, 0, 0], [0.1, 0.06, 0]])
    facets = kite[[[0, 1, 2], [0, 2, 3]]]
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    blade = blade_from(facets @ turn.T + turn @ [0.01, 0, 0])
    assert blade.share == pytest.approx(0.5)
    assert blade.middle[0] == pytest.approx(4 / 9)
    assert np.abs(blade.vertices[:, 2]).max() < 1e-12
    assert np.ptp(blade.vertices, axis=0)[:2] == pytest.approx([1, 1])
    with pytest.raises(BladeError, match="no area"):
        blade_from(np.zeros((1, 3, 3)) + np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]))


def test_leaves_laid_behind_wood_are_the_joined_mesh():
    """To the last bit, with all that both know: coordinates, numbers, texture, orders and edges."""
    from forest_addon.base.rng import stream
    from forest_addon.base.trimesh import join
    from forest_addon.growth.mesh.meshing import mesh_wood
    from forest_addon.growth.species import skeleton_of
    from forest_addon.spec import Honda, Species

    skeleton, sites = skeleton_of(Species(name="one", honda=Honda()), stream(1, "laid"))
    wood, blade, order = mesh_wood(skeleton), SHAPES["oval"](), skeleton.order[sites.segment]
    many = replace(
        sites, **{n: np.repeat(getattr(sites, n), 9, axis=0) for n in sites.__dataclass_fields__}
    )
    order = np.repeat(order, 9)
    assert len(many) > 5000
    at_once, joined = (
        lay(many, blade, order=order, wood=wood),
        join([wood, lay(many, blade, order=order)]),
    )
    for name in ("vertices", "triangles", "part", "leaf", "material", "uv", "order"):
        assert np.array_equal(getattr(at_once, name), getattr(joined, name)), name
        assert getattr(at_once, name).dtype == getattr(joined, name).dtype
    for name in ("ends", "of_corner"):
        assert np.array_equal(
            getattr(at_once.known_edges(), name), getattr(joined.known_edges(), name)
        )
