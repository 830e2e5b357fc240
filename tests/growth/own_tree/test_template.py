"""Templates cut from trees of known structure, and hard cases; leaves for a tree without; grafted trees.
tree without leaves. A grown tree: what it is made of, its truth, its independence of everything else.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.joined_tree import box_tree, remeshed
from references.model_tree import UP, Model, at, blade, line, tree, tube
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.formats.stl import read_stl
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.blades import SHAPES
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.own_tree import template
from forest_addon.growth.own_tree.pieces import join_along, part
from forest_addon.growth.own_tree.recognise import LeanError, Recognition, TemplateError, recognise
from forest_addon.growth.own_tree.template import GraftSite, dress, graft, split_tree
from forest_addon.growth.skeleton import Skeleton, depths
from forest_addon.growth.tree import grow
from forest_addon.spec import Leaf, Normal

MAPLE = Path(__file__).resolve().parents[4] / "shared" / "data" / "maple"
DRESSED = Leaf(
    length=Normal(mean=0.08, sd=0.0), width_ratio=Normal(mean=0.5, sd=0.0), nodes=3, per_node=2
)


# --------------------------------------------------------------------------------- what is cut


def canonical(model: Model, piece: int, points: np.ndarray) -> np.ndarray:
    """Points in the canonical frame of a branch, from the truth: x along, z up, y to the left of x."""
    axis = model.tip[piece] - model.foot[piece]
    length = float(np.linalg.norm(axis))
    x = axis / length
    z = UP - (UP @ x) * x
    z /= np.linalg.norm(z)
    return np.asarray(
        (points - model.foot[piece]) @ np.stack([x, np.cross(z, x), z], axis=1) / length
    )


def facets_of(mesh: TriMesh, what: int) -> np.ndarray:
    return np.asarray(mesh.vertices[mesh.triangles[mesh.part == what]])


def test_templates_are_the_facets_of_their_branch_in_the_canonical_frame() -> None:
    model = tree()
    split = split_tree(model.wood(), model.leaves())
    assert len(split.branches) == 9
    assert sum(len(branch.leaves) for branch in split.branches) == 63
    for number, branch in enumerate(split.branches):
        first = 1 + 3 * number  # branches were built from the lowest up, each with its two twigs
        length = float(np.linalg.norm(model.tip[first] - model.foot[first]))
        wood = np.concatenate(model.tubes[first : first + 3])
        leaves = np.concatenate(model.blades[7 * number : 7 * number + 7])
        close = 0.35 * 0.07 / length  # the foot is known to a part of its radius
        np.testing.assert_allclose(
            facets_of(branch.mesh, WOOD), canonical(model, first, wood), atol=close
        )
        np.testing.assert_allclose(
            facets_of(branch.mesh, LEAF), canonical(model, first, leaves), atol=close
        )
        np.testing.assert_array_equal(
            branch.mesh.leaf[branch.mesh.part == LEAF], np.repeat(np.arange(7), 2)
        )
        assert np.all(branch.mesh.leaf[branch.mesh.part == WOOD] == -1)
        np.testing.assert_array_equal(branch.mesh.material, (branch.mesh.part == LEAF).astype(int))

        np.testing.assert_array_equal(branch.leaves.branch, [1, 1, 1, 2, 2, 2, 0])
        disc = np.sqrt(0.1 * 0.06 / np.pi)
        np.testing.assert_allclose(branch.leaves.radius * branch.length, disc, rtol=1e-9)
        centres = canonical(model, first, leaves.reshape(7, 6, 3).mean(axis=1))
        assert np.abs(branch.leaves.centre - centres).max() < 0.02

        trunk = model.tip[0] - model.foot[0]
        share = (model.foot[first] - model.foot[0]) @ trunk / (trunk @ trunk)
        axis = model.tip[first] - model.foot[first]
        angle = np.arccos(axis @ trunk / np.linalg.norm(axis) / np.linalg.norm(trunk))
        assert branch.length == pytest.approx(length, rel=0.01)
        assert branch.base_radius == pytest.approx(0.07, rel=0.1)
        assert branch.height == pytest.approx(share, abs=0.003)
        assert branch.angle == pytest.approx(angle, abs=0.02)


def test_height_sets_the_unit() -> None:
    model = tree()
    tall = float(np.ptp(model.wood()[:, :, 2]))
    metres, scaled = split_tree(model.wood()), split_tree(model.wood() * 39.37, height=tall)
    doubled = split_tree(model.wood(), height=2 * tall)
    for one, same, twice in zip(metres.branches, scaled.branches, doubled.branches, strict=True):
        assert same.length == pytest.approx(one.length, rel=1e-6)
        assert twice.length == pytest.approx(2 * one.length, rel=1e-6)
        assert twice.base_radius == pytest.approx(2 * one.base_radius, rel=1e-6)
        assert twice.angle == pytest.approx(one.angle, abs=1e-6)
        np.testing.assert_allclose(twice.mesh.vertices, one.mesh.vertices, atol=1e-6)
    assert doubled.trunk_length == pytest.approx(2 * metres.trunk_length)
    assert doubled.trunk_radius == pytest.approx(2 * metres.trunk_radius)


def test_templates_do_not_change_when_the_tree_is_turned_and_moved() -> None:
    model = tree(7)
    cos, sin = np.cos(2.0), np.sin(2.0)
    about_z = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    before = split_tree(model.wood(), model.leaves())
    after = split_tree(model.wood() @ about_z + [9, -30, 4], model.leaves() @ about_z + [9, -30, 4])
    assert len(before.branches) == len(after.branches) == 9
    for one, other in zip(before.branches, after.branches, strict=True):
        np.testing.assert_array_equal(one.mesh.triangles.shape, other.mesh.triangles.shape)
        for what in (WOOD, LEAF):
            np.testing.assert_allclose(
                facets_of(one.mesh, what), facets_of(other.mesh, what), atol=2e-3
            )
        np.testing.assert_array_equal(one.leaves.branch, other.leaves.branch)
        assert (one.height, one.angle) == pytest.approx((other.height, other.angle), abs=2e-3)


def test_an_upright_branch_has_a_frame_too() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 5]), np.linspace(0.2, 0.1, 6), -1)
    model.add(line([0, 0, 4.9], [0, 0, 8]), np.linspace(0.1, 0.02, 6), trunk)
    (branch,) = split_tree(model.wood()).branches
    assert branch.angle == pytest.approx(0, abs=0.01)
    assert branch.height == pytest.approx(0.98, abs=0.005)
    assert branch.mesh.vertices.min(axis=0) == pytest.approx([0, -0.1 / 3.1, -0.1 / 3.1], abs=0.01)
    assert branch.mesh.vertices.max(axis=0) == pytest.approx([1, 0.1 / 3.1, 0.1 / 3.1], abs=0.01)
    for axis in ([0, 0, 1.0], [0, 0, -1.0], [0.6, 0, 0.8], [1.0, 0, 0]):
        frame = template.canonical_frame(np.array(axis))
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1)


# --------------------------------------------------------------------------------- hard cases


def test_roots_are_no_trunk_and_no_templates() -> None:
    model = tree()
    for turn in (0.0, 2.0, 4.0):
        out = np.array([np.cos(turn), np.sin(turn), -0.7])
        model.add(line(model.foot[0], model.foot[0] + 2 * out), np.linspace(0.12, 0.03, 6), 0)
    model.check(recognise(model.wood(), model.leaves()))
    assert len(split_tree(model.wood(), model.leaves()).branches) == 9


def test_shoots_on_the_trunk_are_left_out_with_their_leaves() -> None:
    model = tree()
    foot = model.foot[0] + 0.2 * (model.tip[0] - model.foot[0])
    shoot = model.add(line(foot + at(0.25, 0, 0), foot + at(0.3, 0, 0.05)), 0.004, 0)
    model.leaf(shoot, foot + at(0.3, 0, 0.05), [1, 0, 0], [0, 1, 0])
    split = split_tree(model.wood(), model.leaves())
    assert len(split.branches) == 9
    assert sum(len(branch.leaves) for branch in split.branches) == 63


def signed_volume(facets: np.ndarray) -> float:
    return float(np.einsum("ti,ti->", facets[:, 0], np.cross(facets[:, 1], facets[:, 2])) / 6)


def test_pieces_modelled_inside_out_are_turned() -> None:
    model = tree(capped=True)
    for number in (0, 2, 4):
        model.tubes[number] = model.tubes[number][:, ::-1]
    split = split_tree(model.wood(), model.leaves())
    sound = split_tree(tree(capped=True).wood())
    for turned, expected in zip(split.branches, sound.branches, strict=True):
        volume = signed_volume(facets_of(turned.mesh, WOOD))
        assert volume == pytest.approx(signed_volume(facets_of(expected.mesh, WOOD)), rel=1e-6)
        assert volume > 0


def test_leaves_that_touch_wood_or_each_other_at_points() -> None:
    """A leaf uses corners of its twig, and three leaves hang by one and the same point."""
    model = tree()
    twig = model.tubes[2]
    count = len(model.blades)
    model.blades.append(np.array([[twig[3, 0], twig[3, 1], twig[3, 0] + [0.0, 0.0, 0.1]]]))
    point = model.tip[5]
    for turn in (0.0, 2.0, 4.0):
        out = np.array([np.cos(turn), np.sin(turn), 0.0]) * 0.08
        model.blades.append(np.array([[point, point + out, point + out + [0.0, 0.0, 0.05]]]))
    model.bearers += [2, 5, 5, 5]
    found = recognise(model.wood(), model.leaves())
    model.check(found)
    assert found.leaves.count == count + 4
    split = split_tree(model.wood(), model.leaves())
    for branch in split.branches:  # no vertex belongs to two leaves, nor to leaf and wood
        wood, leaf = (branch.mesh.triangles[branch.mesh.part == what] for what in (WOOD, LEAF))
        assert not np.intersect1d(wood, leaf).size
        owner = np.stack(
            [leaf.ravel(), np.repeat(branch.mesh.leaf[branch.mesh.part == LEAF], 3)], axis=1
        )
        assert len(np.unique(owner, axis=0)) == len(np.unique(leaf))


def test_leaves_on_the_trunk_are_in_no_template() -> None:
    model = tree()
    model.leaf(0, model.foot[0] + at(0.3, 0, 1), [1, 0, 0], [0, 1, 0])
    split = split_tree(model.wood(), model.leaves())
    assert sum(len(branch.leaves) for branch in split.branches) == 63


@pytest.mark.parametrize("leaves", [None, np.empty((0, 3, 3))])
def test_a_leafless_tree(leaves: np.ndarray | None) -> None:
    split = split_tree(tree().wood(), leaves)
    for branch in split.branches:
        assert len(branch.leaves) == 0
        assert np.all(branch.mesh.part == WOOD)


REFUSED = [  # what is said, and wood and leaves of which it is
    ("no facet with an area in the wood", lambda m: (np.empty((0, 3, 3)), None)),
    ("no facet with an area in the wood", lambda m: (np.zeros((4, 3, 3)), None)),
    ("one piece", lambda m: (m.tubes[0], None)),
    ("finite", lambda m: (np.full((4, 3, 3), np.nan), None)),
    ("shape", lambda m: (np.zeros((3, 3)), None)),
    ("leans 89°", lambda m: (m.wood()[:, :, [0, 2, 1]], None)),  # y up
    ("one tree alone", lambda m: (np.concatenate([m.wood(), m.wood() + at(8, 0, 0)]), None)),
    (
        "roots but no branches",
        lambda m: (
            np.concatenate(
                [
                    tube(line([0, 0, 0], [0, 0, 9]), 0.3),
                    tube(line([0, 0, 0.1], [1, 0, -1]), 0.05),
                ]
            ),
            None,
        ),
    ),
    ("no facet with an area in the leaves", lambda m: (m.wood(), np.zeros((2, 3, 3)))),
    ("finite", lambda m: (m.wood(), np.full((2, 3, 3), np.inf))),
    ("far from the wood", lambda m: (m.wood(), m.leaves() + at(50, 0, 0))),
    ("far from the wood", lambda m: (m.wood(), m.leaves() * 100)),
    (
        "hang together along edges",
        lambda m: (
            m.wood(),
            np.concatenate(
                [blade([0, 0, 2 + 0.5 * k], [0, 0, 1], [1, 0, 0], length=0.5) for k in range(16)]
            ),
        ),
    ),
]


@pytest.mark.parametrize(("words", "brought"), REFUSED)
def test_what_is_no_tree_is_refused_in_one_sentence(words, brought) -> None:
    with pytest.raises(TemplateError, match=words) as caught:
        split_tree(*brought(tree()))
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


# --------------------------------------------------------------------------------- a tree of others


def parts_by_shared_corners(facets: np.ndarray) -> list[np.ndarray]:
    """Facets of each connected part, by identical corners."""
    _, corner = np.unique(facets.reshape(-1, 3), axis=0, return_inverse=True)
    facet = np.repeat(np.arange(len(facets)), 3)
    links = coo_matrix(
        (np.ones(len(facet)), (facet, len(facets) + corner.ravel())), (9 * len(facets),) * 2
    )
    part = connected_components(links, directed=False)[1][: len(facets)]
    return [np.flatnonzero(part == number) for number in np.unique(part)]


@pytest.fixture(scope="module")
def maple() -> tuple[np.ndarray, np.ndarray]:
    if not MAPLE.is_dir():
        pytest.skip(
            f"the maple of Tanveer et al. is not at {MAPLE}; it has no licence to be shipped"
        )
    return read_stl(MAPLE / "maple_stem.stl"), read_stl(MAPLE / "maple_leaves.stl")


@pytest.mark.slow
def test_maple_pieces(maple: tuple[np.ndarray, np.ndarray]) -> None:
    """244 tubes: a trunk of 384 facets, 24 branches of 240, 219 twigs of 144. The 3,710 leaf quads are
    1,855 leaves, each drawn from both sides.
    """
    wood, leaves = maple
    found = recognise(wood, leaves)
    parts = parts_by_shared_corners(wood)
    assert found.wood.count == len(parts) == 244
    for facets in parts:
        (piece,) = np.unique(found.wood.piece[facets])
        generation = {384: 0, 240: 1, 144: 2}[len(facets)]
        assert (piece == found.trunk) == (generation == 0)
        assert (found.parent[piece] == found.trunk) == (generation == 1)
    corners = np.sort(leaves.reshape(-1, 6, 3), axis=1).reshape(-1, 18)
    assert len(corners) == 3710
    assert len(np.unique(corners, axis=0)) == found.leaves.count == 1855


@pytest.mark.medium
def test_maple_templates(maple: tuple[np.ndarray, np.ndarray]) -> None:
    wood, leaves = maple
    split = split_tree(wood, leaves, height=12.0)
    assert len(split.branches) == 24
    assert sum(len(branch.leaves) for branch in split.branches) == 1855
    assert sum(len(b.mesh.triangles) for b in split.branches) == len(wood) - 384 + 2 * 1855
    unit = 12 / np.ptp(wood[:, :, 2])
    assert split.trunk_radius / unit == pytest.approx(0.886, rel=0.01)  # its first ring

    heights = [b.height for b in split.branches]
    assert heights == sorted(heights)
    assert heights[0] == pytest.approx(0.341, abs=0.005)
    assert heights[-1] == pytest.approx(1.0, abs=0.005)
    angles = np.array([b.angle for b in split.branches])
    assert np.all(np.diff(angles) < np.deg2rad(3))  # from level at the bottom to upright at the top
    assert angles[0] > np.deg2rad(80)
    assert angles[-1] < np.deg2rad(5)
    lengths = np.array([b.length for b in split.branches])
    assert np.all(np.diff(lengths) < 0)
    for branch in split.branches:
        assert 40 <= len(branch.leaves) <= 120
        assert branch.leaves.centre[:, 0].min() > 0.1  # leaves are outward of the foot
        assert branch.leaves.centre[:, 0].max() < 1.6
        assert branch.leaves.length * branch.length == pytest.approx(2.15 * unit, rel=0.01)
        # the branch itself starts at the origin with its radius and ends at (1, 0, 0)
        own = branch.mesh.vertices[branch.mesh.part[0] == WOOD]
        foot = np.linalg.norm(own, axis=-1)
        assert branch.base_radius / branch.length == pytest.approx(float(foot.min()), rel=0.35)


@pytest.fixture(scope="module")
def wood():
    return read_stl(ASSETS / "templates" / "maple" / "wood.stl")


@pytest.mark.medium
def test_every_twig_bears_nodes_times_leaves_of_their_true_size(wood):
    unit = 0.1
    facets = dress(wood / unit, DRESSED, SHAPES["ellipse"], unit)
    bare = recognise(wood)
    twigs = np.setdiff1d(np.arange(len(bare.parent)), [*bare.parent, bare.trunk])
    split = split_tree(wood, facets * unit)
    assert sum(len(branch.leaves) for branch in split.branches) == len(twigs) * 6
    corner = facets.reshape(-1, 3) * unit
    for tip in bare.tip[twigs]:
        assert np.linalg.norm(corner - tip, axis=1).min() < 0.02
    for branch in split.branches:
        assert branch.leaves.length * branch.length == pytest.approx(0.08, rel=1e-3)
        # The polygon has the area of the ellipse of 8 by 4 cm.
        radius = np.sqrt(0.08 * 0.04) / 2
        assert branch.leaves.radius * branch.length == pytest.approx(radius, rel=1e-3)


@pytest.mark.medium
def test_a_species_file_asks_for_them(tmp_path):
    shutil.copy(ASSETS / "templates" / "maple" / "wood.stl", tmp_path)
    text = 'name = "dressed"\n[template]\nwood = "wood.stl"\n'
    (tmp_path / "bare.toml").write_text(text)
    (tmp_path / "leafy.toml").write_text(text + 'grow_leaves = true\n[leaf]\nshape = "beech"\n')
    bare, leafy = (load_species(tmp_path / f"{name}.toml") for name in ("bare", "leafy"))
    of_bare, of_leafy = (
        sum(len(branch.leaves) for branch in kind[1].branches) for kind in (bare, leafy)
    )
    assert of_bare == 0
    assert of_leafy > 100
    tree, again = (grow(*leafy, stream(1, "tree")) for _ in range(2))
    assert len(tree.leaves) > 1000
    assert np.array_equal(tree.mesh.vertices, again.mesh.vertices)


@pytest.fixture(scope="module")
def shared_maple():
    return load_species(ASSETS / "species" / "maple.toml")


@pytest.fixture(scope="module")
def grown(shared_maple):
    return grow(*shared_maple, stream(1, "tree"))


def test_a_tree_stands_on_the_ground_with_its_trunk_upright(grown):
    low = grown.mesh.vertices[:, 2].min()
    assert -0.3 < low < 0  # sunk a little, so that no gap shows
    foot = grown.mesh.vertices[np.abs(grown.mesh.vertices[:, 2]) < 0.02]
    assert np.abs(foot[:, :2]).max() < 0.4
    assert 7 < grown.height < 13
    assert np.isfinite(grown.mesh.vertices).all()


def test_the_skeleton_is_trunk_and_first_level_axes(grown, shared_maple):
    grammar = shared_maple[0].grammar
    assert set(grown.skeleton.order.tolist()) == {0, 1}
    assert (grown.skeleton.order == 0).sum() == grammar.generations + 1
    firsts = (grown.skeleton.order == 1) & (grown.skeleton.order[grown.skeleton.parent] == 0)
    assert firsts.sum() == 2 * grammar.generations
    assert grown.skeleton.radius[0, 0] == grammar.radius


def test_leaves_reach_the_tips_and_fill_the_crown(grown):
    crown = grown.leaves.centre
    assert crown[:, 2].max() > 0.97 * grown.height
    wood = grown.mesh.vertices[np.unique(grown.mesh.triangles[grown.mesh.part == WOOD])]
    reach = np.linalg.norm(wood[:, :2], axis=1).max()
    assert np.linalg.norm(crown[:, :2], axis=1).max() > 0.95 * reach


@pytest.mark.parametrize("generations", [0, 1, 9])
def test_few_and_many_generations(shared_maple, generations):
    species, template = shared_maple
    species = replace(species, grammar=replace(species.grammar, generations=generations))
    grown = grow(species, template, stream(2, "tree"))
    assert np.isfinite(grown.mesh.vertices).all()
    assert grown.skeleton.order.max() == min(generations, 1)


def test_a_graft_starts_at_its_site_and_ends_at_its_length(shared_maple):
    scion = shared_maple[1].branches[0]
    direction = np.array([0.36, 0.48, 0.8])
    site = GraftSite(np.array([1.0, 2.0, 3.0]), direction, 4.0)
    mesh, _, _ = graft(scion, site, 0.0, 0.0, stream(0, "graft"))
    wood = mesh.vertices[np.unique(mesh.triangles[mesh.part == WOOD])] - site.foot
    assert np.linalg.norm(wood, axis=1).min() < 0.1
    end = np.linalg.norm(wood - 4.0 * direction, axis=1).min()
    assert end < 0.05


def test_as_many_templates_as_nodes_match_one_to_one(shared_maple):
    species, template = shared_maple
    species = replace(species, grammar=replace(species.grammar, generations=2, copies=1))
    sites = 2 * 2 * 1 + 1
    five = replace(template, branches=template.branches[:sites])
    assert len(five.branches) == sites
    grown = grow(species, five, stream(4, "tree"))
    per_branch = np.bincount(grown.leaves.branch, minlength=sites)
    assert (per_branch > 0).all()


# -------------------------------------------------------------------------------------------- sever
# Trees in one mesh: cut at their forks into what was joined.


def corners(facets: np.ndarray) -> np.ndarray:
    """Facets as sorted rows, to be compared as sets."""
    rows = np.sort(np.round(facets, 9).view([("", float)] * 3).reshape(-1, 3), axis=1)
    return np.sort(rows.view([("", rows.dtype)] * 3).ravel())


# ------------------------------------------------------------------------------ box-modelled


def check_box(found: Recognition) -> None:
    model = box_tree()
    number = np.array(
        [np.argmin(np.linalg.norm(found.tip - r[-1].mean(axis=0), axis=1)) for r in model.rings]
    )
    assert sorted(number) == list(range(len(model.rings))) == list(range(found.wood.count))
    parents = np.array(model.parents)
    expected = np.where(parents < 0, -1, number[parents])
    np.testing.assert_array_equal(found.parent[number], expected)
    # a branch was drawn from her parent's bark, and goes on to her axis
    bark = np.array([0.0 if p < 0 else model.radius[p] for p in parents])
    length = found.lines.length()[number]
    assert np.all(length > 0.97 * np.array(model.length))
    assert np.all(length < 1.03 * np.array(model.length) + 2.5 * bark)
    np.testing.assert_allclose(found.radius[number], model.radius, rtol=0.35)


def test_a_box_modelled_tree_is_cut_at_its_forks() -> None:
    facets = box_tree().facets()
    assert part(facets).count == 1
    found = recognise(facets)
    check_box(found)
    assert found.doubts == ()
    wood = found.wood
    shown = wood.vertices[wood.triangles[: wood.drawn]]
    np.testing.assert_array_equal(corners(shown), corners(facets))  # none lost, none twice
    assert len(wood.triangles) > wood.drawn
    split = split_tree(facets)
    assert len(split.branches) == 7


def test_feet_reach_into_the_mother_and_holes_are_closed() -> None:
    found = recognise(box_tree().facets())
    hangs = found.parent >= 0
    assert np.all(found.gap[hangs] <= 0.2 * found.radius[hangs])
    for piece in range(found.wood.count):
        own = found.wood.triangles[found.wood.piece == piece].astype(np.int64)
        edges = np.sort(np.concatenate([own[:, [0, 1]], own[:, [1, 2]], own[:, [2, 0]]]), axis=1)
        edge, times = np.unique(edges, axis=0, return_counts=True)
        assert times.max() == 2
        rim = edge[times == 1]
        loop = join_along(rim, len(found.wood.vertices))[rim[:, 0]]
        assert len(np.unique(loop)) == 2, piece  # two open ends, no other hole


def noisy(facets: np.ndarray) -> np.ndarray:
    """Facets in another order, their corners moved by millimetres."""
    rng = np.random.default_rng(0)
    places, index = np.unique(facets.reshape(-1, 3), axis=0, return_inverse=True)
    places = places + rng.normal(scale=0.004, size=places.shape)
    return places[index.ravel()].reshape(-1, 3, 3)[rng.permutation(len(facets))]


def doubled(facets: np.ndarray) -> np.ndarray:
    return np.concatenate([facets, facets[::3, ::-1], facets[:40]])


@pytest.mark.parametrize("spoil", [noisy, doubled])
def test_noise_order_and_doubled_facets_change_no_branch(spoil) -> None:
    check_box(recognise(spoil(box_tree().facets())))


def test_the_cut_does_not_need_to_know_what_is_up() -> None:
    lying = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    with pytest.raises(LeanError, match="leans"):  # after it was cut
        recognise(box_tree().facets() @ lying)


def test_a_trunk_that_ends_as_a_level_limb_is_still_upright() -> None:
    bend = np.concatenate([line([0, 0, 0], [0, 0, 2], 9), line([0.3, 0, 2.2], [6, 0, 2.6], 20)])
    model = Model()
    trunk = model.add(bend, np.linspace(0.3, 0.1, len(bend)), -1)
    model.add(line([3, 0, 2.4], [3, 1, 4]), np.linspace(0.05, 0.02, 6), trunk)
    found = recognise(model.wood())
    assert (found.trunk, found.wood.count) == (0, 2)


def test_some_parts_joined_and_some_apart() -> None:
    """A box-modelled tree to which separate twigs were added."""
    model = box_tree()
    twigs = []
    for branch in (3, 6, 9):
        foot = model.rings[branch][6].mean(axis=0)
        twigs.append(tube(line(foot, foot + at(0.1, 0.1, 0.5)), np.linspace(0.02, 0.01, 6)))
    found = recognise(np.concatenate([*twigs, model.facets()]))
    assert found.wood.count == len(model.rings) + 3
    np.testing.assert_array_equal(np.bincount(depths(found.parent)), [1, 7, 4 + 3])


def test_pieces_that_only_touch_stay_apart() -> None:
    """Two branches with a common corner, and twigs that cross without one."""
    model = tree()
    model.tubes[4][0, 0] = model.tubes[1][3, 1]
    assert recognise(model.wood()).wood.count == 28


def test_a_plain_tube_is_not_cut_however_it_bends_or_swells() -> None:
    turn = np.linspace(0, 5 * np.pi, 120)
    vine = np.stack([np.cos(turn), np.sin(turn), 1.2 + 0.2 * turn], axis=1)
    swollen = np.where(np.abs(np.linspace(0, 1, 40) - 0.05) < 0.1, 0.9, 0.15)
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 9], 40), swollen, -1, sides=12)
    model.add(line([0, 0, 6], [2, 0, 7]), np.linspace(0.06, 0.02, 6), trunk)
    model.add(vine, 0.03, trunk)
    assert recognise(model.wood()).wood.count == 3


@pytest.mark.parametrize(
    "facets",
    [
        np.array([[[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]]),
        tube(line([0, 0, 0], [0, 0, 9]), 0.2),
        tube(line([0, 0, 0], [0, 0, 9], 40), np.linspace(0.3, 0.01, 40), capped=True),
    ],
    ids=["triangle", "open tube", "pole"],
)
def test_what_has_no_fork_is_one_sentence_with_a_place(facets: np.ndarray) -> None:
    with pytest.raises(TemplateError) as caught:
        recognise(facets)
    assert "one piece without a fork" in str(caught.value)
    assert caught.value.places.shape == (2, 3)


# ---------------------------------------------------------------------------------- remeshed


@pytest.mark.slow
def test_a_remeshed_tree_has_the_branches_of_its_parts() -> None:
    """Number of branches by order exact, lengths within 6 %, radii at the foot within 20 %, where a voxel
    is half of the twigs' radius."""
    model = tree(capped=True)
    for number in range(1, 28):  # no thinner than the remesher sees
        if model.parents[number] > 0:
            path = line(model.foot[number], model.tip[number])
            model.tubes[number] = tube(path, np.linspace(0.032, 0.022, 6), capped=True)
            model.radius[number] = 0.032
    joined = remeshed(model.wood(), 0.016)
    found = recognise(joined)
    np.testing.assert_array_equal(np.bincount(depths(found.parent)), [1, 9, 18])
    number = np.array([np.argmin(np.linalg.norm(found.tip - tip, axis=1)) for tip in model.tip])
    assert len(np.unique(number)) == 28
    parents = np.array(model.parents)
    np.testing.assert_array_equal(found.parent[number], np.where(parents < 0, -1, number[parents]))
    length = np.array([np.linalg.norm(b - a) for a, b in zip(model.foot, model.tip, strict=True)])
    np.testing.assert_allclose(found.lines.length()[number], length, rtol=0.06)
    np.testing.assert_allclose(found.radius[number], model.radius, rtol=0.2)


@pytest.mark.medium
def test_branches_that_have_grown_together_spoil_no_other_piece() -> None:
    """Two branches that cross: the ring that they make with the trunk is said, all lines are sound."""
    model = Model()
    thick = np.linspace(0.09, 0.06, 6)
    trunk = model.add(line([0, 0, 0], [0, 0, 6]), np.linspace(0.25, 0.12, 6), -1, capped=True)
    model.add(line([0, 0, 1.5], [3, 0.0, 4.0]), thick, trunk, capped=True)
    model.add(line([0, 0, 4.0], [3, 0.02, 1.5]), thick, trunk, capped=True)
    model.add(line([0, 0, 4.8], [-2, 0.3, 5.6]), thick, trunk, capped=True)
    found = recognise(remeshed(model.wood(), 0.025))
    assert found.lines.length()[found.trunk] == pytest.approx(6.0, rel=0.02)
    chord = np.linalg.norm(found.tip - found.foot, axis=1)
    assert np.all(found.lines.length() < 1.6 * chord + 0.1)  # no line turns back
    assert 4 <= found.wood.count <= 6  # what lies beyond the crossing may be a branch of its own
    (doubt,) = found.doubts
    assert "grown into one another" in doubt.sentence


def skeleton_of(name: str, thinnest: float) -> Skeleton:
    """A tree of our growers without what is thinner than this."""
    species, template = load_species(find_species(name, Path()))
    whole = grow(species, template, stream(1, "joined")).skeleton
    keep = whole.radius[:, 0] >= thinnest
    for number in np.flatnonzero(whole.parent >= 0):
        keep[number] &= keep[whole.parent[number]]
    kept = whole.some(keep)
    return replace(kept, radius=np.maximum(kept.radius, 0.8 * thinnest))


def axes_by_order(skeleton: Skeleton) -> np.ndarray:
    parent = np.maximum(skeleton.parent, 0)
    first = (skeleton.parent < 0) | (skeleton.order != skeleton.order[parent])
    return np.bincount(skeleton.order[first])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "thinnest"), [("abop-monopodial-a", 0.014), ("honda-birch", 0.03)]
)
def test_trees_of_our_growers_remeshed_keep_their_orders(name: str, thinnest: float) -> None:
    """Number of branches by order exact; length by order within 4 %, or half the parents' radii."""
    skeleton = skeleton_of(name, thinnest)
    mesh = mesh_wood(skeleton, 0.002)
    found = recognise(remeshed(mesh.vertices[mesh.triangles], 0.5 * thinnest))
    order = depths(found.parent)
    np.testing.assert_array_equal(np.bincount(order), axes_by_order(skeleton))
    length, expected = (
        np.bincount(order, found.lines.length()),
        np.bincount(skeleton.order, skeleton.length),
    )
    thick = np.where(found.parent < 0, 0.0, found.radius[found.parent])
    assert np.all(np.abs(length - expected) <= 0.04 * expected + 0.5 * np.bincount(order, thick))


@pytest.mark.slow
def test_limbs_that_leave_the_trunk_as_one_fork_where_they_part() -> None:
    """A coarse ginkgo: two of its eight limbs, 5 cm thick, begin 3 cm apart in one direction, and are one
    tube for 11 cm of their way. What parts there is a fork off the trunk, one limb the other's child."""
    skeleton = skeleton_of("ginkgo", 0.02)
    mesh = mesh_wood(skeleton, 0.002)
    found = recognise(remeshed(mesh.vertices[mesh.triangles], 0.01))
    np.testing.assert_array_equal(axes_by_order(skeleton), [1, 8])
    np.testing.assert_array_equal(np.bincount(depths(found.parent)), [1, 7, 1])
    (late,) = np.flatnonzero(depths(found.parent) == 2)
    away = np.linalg.norm((found.foot[late] - found.foot[found.parent[late]])[:2])
    assert 0.1 < away < 0.25
    assert found.lines.length()[found.trunk] == pytest.approx(
        np.bincount(skeleton.order, skeleton.length)[0], rel=0.01
    )


@pytest.mark.slow
def test_a_weeping_tree_in_one_mesh_comes_back() -> None:
    """Branches that arch over, hanging twigs nearer to the ground than their parents' feet."""
    model, rise = Model(), np.linspace(0, 1, 14)
    trunk = model.add(line([0, 0, 0], [0.2, 0, 6], 20), np.linspace(0.2, 0.06, 20), -1, capped=True)
    for number in range(6):
        turn, z = 2.4 * number, 2.2 + 0.55 * number
        out = at(np.cos(turn), np.sin(turn), 0)
        path = at(0.2 * z / 6, 0, z) + np.outer(1.6 * rise, out)
        path[:, 2] += 1.2 * rise - 3.0 * rise**2
        branch = model.add(path, np.linspace(0.05, 0.03, 14), trunk, capped=True)
        for knot, hand in ((6, 1), (10, -1)):
            twig = path[knot] + np.outer(0.35 * rise, hand * np.cross(out, [0, 0, 1]))
            twig[:, 2] -= rise**2
            model.add(twig, np.linspace(0.034, 0.028, 14), branch, capped=True)
    found = recognise(remeshed(model.wood(), 0.017))
    assert found.doubts == ()
    assert found.wood.count == 19
    apart = np.linalg.norm(found.tip[:, None] - np.array(model.tip), axis=2)
    number = np.argmin(apart, axis=0)
    assert apart.min(axis=0).max() < 0.01
    parents = np.array(model.parents)
    np.testing.assert_array_equal(found.parent[number], np.where(parents < 0, -1, number[parents]))


# ------------------------------------------------------------------------------------- apart


def right_parents(skeleton: Skeleton, found: Recognition) -> np.ndarray:
    """Tell whether the piece of each axis hangs on the piece of its parent, at the right end."""
    bearer = np.maximum(skeleton.parent, 0)
    begins = (skeleton.parent < 0) | (skeleton.order != skeleton.order[bearer])
    first, axis = np.flatnonzero(begins), np.cumsum(begins) - 1
    last = first.copy()
    for number in np.flatnonzero(~begins):
        axis[number] = axis[skeleton.parent[number]]
        last[axis[number]] = number
    ends = found.lines.ends()
    both = np.concatenate([ends.reshape(-1, 6), ends[:, ::-1].reshape(-1, 6)])
    truth = np.concatenate([skeleton.start[first], skeleton.end[last]], axis=1)
    end, piece = np.divmod(cKDTree(both).query(truth)[1], found.wood.count)
    assert len(np.unique(piece)) == len(first) == found.wood.count
    parent = skeleton.parent[first]
    expected = np.where(parent < 0, -1, piece[axis[parent]])
    return np.asarray((found.parent[piece] == expected) & (found.foot_end[piece] == end))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "honda-willow",
        "ginkgo",
        "abop-sympodial-b",
    ],
)
def test_trees_of_our_growers_in_parts_come_back(name: str) -> None:
    """Every axis a piece, every piece on its parent, also where twigs begin within others that cross."""
    species, template = load_species(find_species(name, Path()))
    skeleton = grow(species, template, stream(2, "apart")).skeleton
    mesh = mesh_wood(skeleton, 0.004)
    assert right_parents(skeleton, recognise(mesh.vertices[mesh.triangles])).all()
