"""Leaves laid at sites: their truth is what the triangles measure; thinning keeps the area. Leaves of
species: within their unit frame, alike in area from near and far, with stalk, fold and bend. The truth
of leaves, on leaves whose truth is known. Leaves incline as a species says, whatever bears them, and
nothing else of the tree changes.
"""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.own_trees import own_tree
from scipy import stats

from forest_addon.base.rng import child_keys, stream
from forest_addon.base.trimesh import LEAF, TriMesh, join
from forest_addon.growth.draw import draw_inclination
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.lsystem.branching import skeleton_of
from forest_addon.growth.mesh.blades import (
    HALVES,
    SHAPES,
    STALK,
    Blade,
    BladeError,
    blade_from,
    facings,
    lay,
    leaf_areas,
    leaf_blade,
    shoot_of,
    thin_leaves,
    truth_of,
)
from forest_addon.growth.mesh.cells import areas_by_cell
from forest_addon.growth.mesh.leaves import (
    Leaves,
    incline_sites,
    measure_leaves,
    separate_leaves,
    turns,
)
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import LeafSites
from forest_addon.growth.tree import blade_of, grow
from forest_addon.sensing.sonar.leaves import FoliageDiscs
from forest_addon.spec import (
    Honda,
    Inclination,
    Leaf,
    Needles,
    Siblings,
    Species,
    Template,
)

NEAR, FAR = 0.0005, 0.002
KEYS = child_keys(np.zeros(20_000, np.uint64), np.arange(20_000))
STEEP = Inclination(mean_deg=60, sd_deg=12)
UNLIKELY = (
    1e-4  # a right draw is refused by chance once in ten thousand; keys are fixed, so never by luck
)


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


def blade(shape, tolerance=NEAR, **settings):
    return leaf_blade(Leaf(shape=shape, **settings), tolerance)


BENT = {
    f"bent palmate, {tolerance:g}": blade("palmate", tolerance, petiole=0.6, curl_deg=25.0)
    for tolerance in (NEAR, FAR)
}


@pytest.mark.parametrize("shape", [*sorted(SHAPES), *BENT])
def test_truth_is_what_the_mesh_measures(shape):
    sites, blade = random_sites(), (SHAPES | BENT)[shape]
    if shape in BENT:
        sites = replace(sites, length=np.full(300, 0.07), width=np.full(300, 0.05))
    mesh = lay(sites, blade)
    truth, measured = truth_of(sites, blade, sites.segment), measure_leaves(mesh)
    np.testing.assert_allclose(truth.centre, measured.centre, atol=1e-9)
    np.testing.assert_allclose(np.abs((truth.normal * measured.normal).sum(1)), 1, atol=1e-9)
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
    blade = SHAPES[shape]
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
    sites, blade = random_sites(1000), SHAPES["maple"]
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
    assert len(lay(none, SHAPES["ellipse"]).triangles) == 0
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
    skeleton, sites = skeleton_of(Species(name="one", honda=Honda()), stream(1, "laid"))
    wood, blade, order = mesh_wood(skeleton), SHAPES["oval"], skeleton.order[sites.segment]
    many, order = sites.select(np.repeat(np.arange(len(sites)), 9)), np.repeat(order, 9)
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


def flat_area(one):
    a, b, c = (one.vertices[one.triangles[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


@pytest.mark.parametrize("shape", HALVES)
@pytest.mark.parametrize("tolerance", [NEAR, FAR])
def test_a_blade_is_one_flat_piece_that_faces_up(shape, tolerance):
    one = blade(shape, tolerance, petiole=0.3)
    area = flat_area(one)
    assert area.min() > 0
    assert one.vertices[:, 0].min() == 0
    assert one.vertices[:, 0].max() == pytest.approx(1)
    edges = np.sort(np.concatenate([one.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]))
    _, times = np.unique(edges, axis=0, return_counts=True)
    assert set(times.tolist()) == {1, 2}  # no facet over another's edge twice
    mirrored = one.vertices * [1, -1, 1]
    assert {tuple(v) for v in mirrored.round(9)} == {tuple(v) for v in one.vertices.round(9) + 0.0}
    assert one.atlas.min() >= 0
    assert one.atlas.max() <= 1


@pytest.mark.parametrize("shape", HALVES)
def test_near_and_far_have_the_same_area(shape):
    near, far = blade(shape, NEAR, petiole=0.3), blade(shape, FAR, petiole=0.3)
    assert far.share == pytest.approx(near.share, rel=1e-12)
    assert len(far.triangles) < len(near.triangles) / 2
    assert len(far.triangles) <= 15


def test_a_stalk_is_its_share_of_the_leaf_and_thin():
    bare, stalked = blade("beech"), blade("beech", petiole=0.5)
    assert stalked.share == pytest.approx(bare.share / 1.5 + STALK / 3, rel=1e-3)
    low = stalked.vertices[stalked.vertices[:, 0] < 0.3]
    assert np.abs(low[:, 1]).max() == pytest.approx(STALK)


def test_a_leaf_bends_down_by_its_curl_and_folds_up_along_its_midrib():
    flat, bent = blade("beech"), blade("beech", curl_deg=40.0)
    assert flat.vertices[:, 2].min() == 0
    edge = np.abs(flat.vertices[:, 1]).argmax()
    assert flat.vertices[edge, 2] > 0
    tip = bent.vertices[bent.vertices[:, 0].argmax()]
    chord = np.arctan2(-tip[2], tip[0])
    assert np.rad2deg(chord) == pytest.approx(20.0, abs=1.0)  # half the bend, of an arc


@pytest.mark.medium
def test_needles_of_a_fascicle_spring_from_one_place_and_shade_as_their_number():
    single, pairs = (
        shoot_of(Needles(length=0.05, diameter=0.0013, count=120, blades=0, together=n), 0.09)
        for n in (1, 2)
    )
    feet = pairs.vertices[::4]
    assert len(np.unique(feet.round(9), axis=0)) == 60
    assert len(np.unique(single.vertices[::4].round(9), axis=0)) == 120
    assert pairs.needle_area == single.needle_area
    assert pairs.shadow == pytest.approx(single.shadow, rel=0.06)
    tips = pairs.vertices[2::4].reshape(60, 2, 3)
    assert np.linalg.norm(tips[:, 0] - tips[:, 1], axis=1).min() > 0.05


def test_a_shoot_of_scots_pine_shades_as_measured():
    """Silhouette over all of the needles' surface: 0.14 of 258 shoots (Oker-Blom & Smolander 1988), 0.146 of
    305 (Tree Physiology 14:971, 1994); 0.25 would be needles apart."""
    species, _ = load_species(find_species("scots-pine", Path()))
    shoot = shoot_of(species.needles.changed(blades=0), species.leaf.length.mean)
    assert shoot.clumping / 4 == pytest.approx(0.143, abs=0.008)
    feet = shoot.vertices[::4, 0]
    assert feet.min() < 0.1
    assert feet.max() > 0.95
    assert shoot.vertices[:, 0].max() > 1.3


def rectangle(length, width, number=0):
    corners = np.array([[0, 0, 0], [length, 0, 0], [length, width, 0], [0, width, 0]], float)
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), LEAF)
    mesh.leaf[:] = number
    return mesh


def moved(mesh, rotation, shift):
    return replace(mesh, vertices=mesh.vertices @ rotation.T + shift)


@pytest.mark.parametrize("seed", range(2))
def test_rectangle_anywhere(seed):
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation[:, 0] *= np.linalg.det(rotation)
    shift = rng.normal(size=3) * 100
    leaves = measure_leaves(moved(rectangle(0.12, 0.05), rotation, shift))
    assert leaves.centre[0] == pytest.approx(rotation @ [0.06, 0.025, 0] + shift)
    assert abs(leaves.normal[0] @ rotation[:, 2]) == pytest.approx(1)
    assert abs(leaves.axis[0] @ rotation[:, 0]) == pytest.approx(1)
    assert leaves.radius[0] == pytest.approx(np.sqrt(0.12 * 0.05 / np.pi), rel=1e-9)
    assert leaves.length[0] == pytest.approx(0.12)
    assert leaves.width[0] == pytest.approx(0.05)


def test_facets_wound_against_each_other_do_not_cancel():
    mesh = rectangle(0.1, 0.1)
    flipped = replace(mesh, triangles=np.array([[0, 1, 2], [3, 2, 0]], np.int32))
    leaves = measure_leaves(flipped)
    assert abs(leaves.normal[0, 2]) == pytest.approx(1)
    assert leaves.radius[0] == pytest.approx(np.sqrt(0.01 / np.pi))


def test_zero_area_leaf_is_harmless():
    leaves = measure_leaves(rectangle(0.1, 0.0))
    assert leaves.radius[0] == 0
    assert np.isfinite(leaves.centre).all()
    assert np.linalg.norm(leaves.normal[0]) == pytest.approx(1)


def test_no_leaves():
    assert len(Leaves.none()) == 0
    assert len(measure_leaves(TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), 1))) == 0


def test_join_numbers_leaves_on_and_select_drops_unused_vertices():
    mesh = join(
        [rectangle(1, 1), rectangle(2, 1), TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), 1)]
    )
    assert mesh.leaf.tolist() == [0, 0, 1, 1, -1]
    kept = mesh.select(mesh.leaf == 1)
    assert len(kept.vertices) == 4
    assert kept.vertices.max() == 2


def test_copies_that_share_a_number_become_leaves_of_their_own():
    a, b = rectangle(1, 1, 0), moved(rectangle(1, 1, 0), np.eye(3), np.array([5.0, 0, 0]))
    both = join([a, b])
    both.leaf[:] = 0  # as an Array modifier leaves it
    assert separate_leaves(both).leaf.tolist() == [0, 0, 1, 1]
    assert separate_leaves(a) is a


def shoots(count=3, blades=4):
    """Shoots of blades that do not touch each other."""
    sites = LeafSites(
        foot=np.arange(3.0 * count).reshape(count, 3),
        direction=np.tile([1.0, 0, 0], (count, 1)),
        up=np.tile([0, 0, 1.0], (count, 1)),
        length=np.ones(count),
        width=np.ones(count),
        segment=np.zeros(count, dtype=np.int64),
    )
    one = np.array([[0, 0, 0], [0.2, 0.1, 0], [0.2, -0.1, 0]])
    vertices = np.concatenate([one + np.array([0.2 * k, 0, 0.05 * k]) for k in range(blades)])
    triangles = np.arange(3 * blades, dtype=np.int32).reshape(-1, 3)
    return lay(sites, Blade(vertices, triangles))


def test_a_shoot_in_pieces_is_one_leaf_and_its_copies_are_others():
    mesh = shoots()
    assert separate_leaves(mesh) is mesh
    copied = join([mesh, moved(mesh, np.eye(3), np.array([50.0, 0, 0]))])
    copied.leaf[len(mesh.leaf) :] -= 3  # as an Array modifier leaves it
    assert separate_leaves(copied).leaf.tolist() == np.repeat([0, 1, 2, 3, 4, 5], 4).tolist()


def test_to_sound_every_piece_of_a_shoot_is_a_disc():
    mesh = shoots()
    foliage = FoliageDiscs(mesh)
    assert foliage.leaf.tolist() == np.repeat([0, 1, 2], 4).tolist()
    centre, normal, radius = foliage.local
    corners = mesh.vertices[mesh.triangles]
    np.testing.assert_allclose(centre, corners.mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(np.pi * radius**2, 0.02, rtol=1e-12)
    np.testing.assert_allclose(np.abs(normal[:, 2]), 1.0)


def beta_of(spread):
    """The beta distribution of a mean and a standard deviation, from scipy."""
    mean, spare = spread.mean_deg / 90, (spread.sd_deg / 90) ** 2
    both = mean * (1 - mean) / spare - 1
    return stats.beta(mean * both, (1 - mean) * both, scale=np.pi / 2)


def angles_of(leaves):
    return np.arccos(np.clip(np.abs(leaves.normal[:, 2]), 0, 1))


@pytest.mark.parametrize(("mean", "sd"), [(27, 17), (3, 2), (45, 30)])
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
    """A template's branches, rules, siblings and Honda's branching."""
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


# --------------------------------------------------------------------------------------------- cells
# Area by cell against polygons that are clipped cell by cell (Sutherland & Hodgman), one after the other.


def clipped(polygon, axis, wall, above):
    """The part of a polygon on one side of a plane."""
    kept = []
    for a, b in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        da, db = (p[axis] - wall if above else wall - p[axis] for p in (a, b))
        if da >= 0:
            kept.append(a)
        if (da < 0) != (db < 0):
            kept.append(a + da / (da - db) * (b - a))
    return kept


def area(polygon):
    total = np.zeros(3)
    for b, c in itertools.pairwise(polygon[1:]):
        total += np.cross(b - polygon[0], c - polygon[0])
    return np.linalg.norm(total) / 2


def brute(triangle, edge):
    """{cell: area} of one triangle."""
    low = np.floor(triangle.min(axis=0) / edge).astype(int)
    high = np.floor(triangle.max(axis=0) / edge).astype(int)
    found = {}
    for cell in itertools.product(*(range(a, b + 1) for a, b in zip(low, high, strict=True))):
        polygon = list(triangle)
        for axis in range(3):
            for wall, above in ((cell[axis] * edge, True), ((cell[axis] + 1) * edge, False)):
                polygon = clipped(polygon, axis, wall, above) if polygon else polygon
        if len(polygon) > 2 and area(polygon) > 1e-13:
            found[cell] = area(polygon)
    return found


def sizes(corners):
    side = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * np.linalg.norm(side, axis=1)


@pytest.mark.medium
@pytest.mark.parametrize("edge", [0.11, 1.7])
def test_areas_are_those_of_clipped_polygons(edge):
    rng = stream(4, "cells")
    corners = rng.normal(0, 0.3, (20, 3, 3)) - 0.7  # cells of negative number too
    part = rng.integers(0, 2, len(corners))
    found = areas_by_cell(
        corners.reshape(-1, 3), np.arange(60).reshape(-1, 3), part, 2, edge, sizes(corners)
    )
    wanted = {}
    for triangle, kind in zip(corners, part, strict=True):
        for cell, size in brute(triangle, edge).items():
            wanted.setdefault(cell, np.zeros(2))[kind] += size
    got = {tuple(cell): size for cell, size in zip(found.cell.tolist(), found.area, strict=True)}
    for cell in wanted.keys() | got.keys():
        assert np.allclose(wanted.get(cell, 0.0), got.get(cell, 0.0), atol=1e-12)


def test_sums_are_the_area_also_where_corners_lie_on_walls():
    rng = stream(5, "cells")
    corners = np.concatenate(
        [
            np.rint(rng.normal(0, 3, (200, 3, 3))) / 2,  # corners, edges and faces on walls
            rng.normal(0, 1e-9, (50, 3, 3)) + 0.5,  # a wall within rounding
            rng.normal(1e6, 2, (50, 3, 3)),  # a map's coordinates
            np.repeat(rng.normal(0, 1, (10, 1, 3)), 3, axis=1),  # no area
        ]
    )
    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    found = areas_by_cell(
        corners.reshape(-1, 3), triangles, np.zeros(len(corners), int), 1, 0.5, sizes(corners)
    )
    whole = sizes(corners).sum()
    assert abs(found.area.sum() - whole) < 1e-9 * whole
    assert len(np.unique(found.cell, axis=0)) == len(found.cell)


def test_areas_that_are_known_keep_their_sum_far_from_the_origin():
    """Leaves of a centimetre in a map's coordinates, where corners have lost half of their digits."""
    rng = stream(6, "cells")
    corners = rng.normal(0, 0.01, (500, 3, 3)) + rng.normal(0, 2, (500, 1, 3))
    triangles = np.arange(1500).reshape(-1, 3)
    size = sizes(corners)
    part = rng.integers(0, 2, 500)
    found = areas_by_cell(corners.reshape(-1, 3) + 6e6, triangles, part, 2, 0.1, size)
    assert np.allclose(found.area.sum(axis=0), np.bincount(part, size), rtol=1e-13)
    assert (np.abs(found.cell * 0.1 - 6e6) < 12).all()


def test_nothing_has_no_cells():
    none = np.empty((0, 3))
    found = areas_by_cell(none, np.empty((0, 3), int), np.empty(0, int), 2, 0.5, np.empty(0))
    assert found.cell.shape == (0, 3)
    assert found.area.shape == (0, 2)
