"""Welding and parting, on facets laid out by hand. Wood told from leaves by names and shapes, and what is
up. What is recognised in trees of known structure.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from references.model_tree import Model, at, blade, line, tree, tube

from forest_addon.growth.own_tree.centreline import find_contacts
from forest_addon.growth.own_tree.pieces import (
    UPRIGHT,
    Group,
    likely_up,
    looks_like_leaves,
    part,
    sort_out,
    stood,
    weld,
)
from forest_addon.growth.own_tree.recognise import recognise
from forest_addon.growth.own_tree.template import split_tree

A, B, C, D = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]
SQUARE = np.array([[A, B, C], [A, C, D]])


FAR = SQUARE + np.array([5.0, 0.0, 0.0])
TOUCHING = np.concatenate([SQUARE, SQUARE + np.array([1.0, 1.0, 0.0])])
AMONG = np.stack([FAR[0], SQUARE[0], FAR[1], SQUARE[1]])
REPEATS = np.concatenate([SQUARE, SQUARE[:, ::-1], SQUARE[:, [1, 2, 0]], SQUARE])
FLAT = np.array([[A, A, A], [A, B, A], [A, [0.5, 0.0, 0.0], B], [A, [0.3, 1e-9, 0.0], B]])


@pytest.mark.parametrize(
    ("facets", "kept", "piece"),
    [
        (SQUARE, SQUARE, [0, 0]),
        (TOUCHING, TOUCHING, [0, 0, 1, 1]),
        (AMONG, AMONG, [0, 1, 0, 1]),
        (REPEATS, SQUARE, [0, 0]),
        (np.concatenate([FLAT, SQUARE]), SQUARE, [0, 0]),
        (FLAT, FLAT[:0], []),
        (FLAT[:0], FLAT[:0], []),
    ],
    ids=[
        "edge in common",
        "point in common",
        "as the file shows",
        "twice",
        "no area",
        "flat",
        "none",
    ],
)
def test_what_hangs_together_by_edges_is_a_piece_and_no_vertex_is_of_two(facets, kept, piece):
    found = part(facets)
    assert found.piece.tolist() == piece
    np.testing.assert_array_equal(found.vertices[found.triangles], kept)
    owners = found.piece_of_vertex[found.triangles]
    np.testing.assert_array_equal(owners, np.stack([found.piece] * 3, axis=1))


def test_edges_of_a_piece_are_those_of_its_facets() -> None:
    pieces = part(SQUARE)
    assert len(pieces.vertices) == 4
    lengths = np.linalg.norm(np.diff(pieces.vertices[pieces.edges], axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(np.sort(lengths), [1, 1, 1, 1, np.sqrt(2)])


def test_a_needle_that_closes_a_crack_joins_what_it_lies_between() -> None:
    """One side of the crack has the edge AB whole, the other has a vertex M in its middle."""
    m, low = [0.5, 0.0, 0.0], [0.5, -1.0, 0.0]
    cracked = np.array([[A, B, C], [m, A, low], [B, m, low]])
    assert part(cracked).count == 2
    closed = part(np.concatenate([cracked, [[A, m, B]]]))
    assert closed.count == 1
    np.testing.assert_array_equal(closed.vertices[closed.triangles], cracked)


@given(
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    st.floats(1e-3, 1e3),
    st.integers(min_value=0, max_value=99),
)
def test_corners_a_little_apart_are_one_wherever_the_mesh_lies(
    offset: tuple[float, float, float], scale: float, seed: int
) -> None:
    """A grid of 6 x 6 squares, every corner of every facet moved by up to 4e-7 of its extent."""
    places = np.stack(np.meshgrid(np.arange(6), np.arange(6), [0]), axis=-1).reshape(-1, 1, 1, 3)
    grid = (SQUARE[None] + places).reshape(-1, 3, 3) / 6
    noise = np.random.default_rng(seed).uniform(-1, 1, grid.shape) * 4e-7 / np.sqrt(3)
    facets = (grid + noise) * scale + np.array(offset)
    vertices, triangles = weld(facets)
    assert len(vertices) == 49
    assert len(np.unique(triangles)) == 49
    np.testing.assert_allclose(vertices[triangles], facets, rtol=0, atol=3e-6 * scale)


def test_corners_clearly_apart_are_not_welded() -> None:
    aside = np.array([1.0 + 5e-6, 0.0, 0.0])
    for low in np.random.default_rng(0).uniform(-1, 0, (20, 3)):  # where cells begin
        apart = np.concatenate([SQUARE, SQUARE + aside, 0.01 * SQUARE + low])
        assert len(weld(apart)[0]) == 12
        assert part(apart).count == 3


def crossed(base: np.ndarray, cards: int) -> np.ndarray:
    """Cards that share their middle line, so that they are one piece."""
    found = []
    top = base + at(0, 0, 0.3)
    for turn in np.pi * np.arange(cards) / cards:
        for way in (-1, 1):
            side = way * 0.1 * at(np.cos(turn), np.sin(turn), 0)
            found += [[base, base + side, top + side], [base, top + side, top]]
    return np.array(found)


def curled(base: np.ndarray, out: np.ndarray, across: np.ndarray) -> np.ndarray:
    """A leaf of twenty facets, bent and folded."""
    share = np.linspace(0, 1, 6)
    width = 0.03 * np.sin(np.pi * np.clip(share, 0.05, 0.95))[:, None]
    rib = base + 0.1 * share[:, None] * out - 0.03 * share[:, None] ** 2 * at(0, 0, 1)
    rows = [rib - width * across + at(0, 0, 0.01), rib, rib + width * across + at(0, 0, 0.01)]
    found = []
    for left, right in ((0, 1), (1, 2)):
        for k in range(5):
            a, b, c, d = rows[left][k], rows[right][k], rows[right][k + 1], rows[left][k + 1]
            found += [[a, b, c], [a, c, d]]
    return np.array(found)


def needle(base: np.ndarray, out: np.ndarray) -> np.ndarray:
    """A closed prism of three sides, 6 cm long."""
    return tube(line(base, base + 0.06 * out, 2), 0.0007, 3, capped=True)


def tuft(base: np.ndarray, ways: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Spikes of three sides that stand on one edge, so that they are one piece."""
    a, b, found = base - 0.001 * across, base + 0.001 * across, []
    for way in ways:
        tip, up = base + 0.06 * way, np.cross(way, across)
        c = base + 0.0015 * up / np.linalg.norm(up)
        found += [[a, b, tip], [b, c, tip], [c, a, tip]]
    return np.array(found)


LEAVES = {
    "quads": blade,
    "cards": lambda base, out, across: blade(base, out, across, 0.3, 0.2),
    "crossed": lambda base, _out, _across: crossed(base, 2),
    "stars": lambda base, _out, _across: crossed(base, 3),
    "shaped": curled,
}


def foliage(kind: str, model: Model) -> np.ndarray:
    """Leaves of a kind at the tips of the twigs and along them."""
    rng = np.random.default_rng(1)
    found = []
    for number in range(1, 28):
        way = model.tip[number] - model.foot[number]
        for share in (0.4, 0.6, 0.8, 1.0):
            base = model.foot[number] + share * way
            out = rng.normal(size=3)
            out /= np.linalg.norm(out)
            across = np.cross(out, [0.3, 0.2, 0.9])
            across /= np.linalg.norm(across)
            ways = out + 0.4 * rng.normal(size=(5, 3))
            ways /= np.linalg.norm(ways, axis=1, keepdims=True)
            if kind == "joined":
                found.append(tuft(base, ways, across))
            elif kind == "tufts":
                found += [needle(base + 0.002 * way, way) for way in ways]
            else:
                found.append(LEAVES[kind](base, out, across))
    return np.concatenate(found)


@pytest.mark.medium
@pytest.mark.parametrize(
    "kind", ["quads", "cards", "crossed", "stars", "shaped", "tufts", "joined"]
)
def test_leaves_of_every_kind_are_told_from_wood_by_their_shape(kind: str) -> None:
    model = tree()
    leaves = foliage(kind, model)
    found = sort_out([Group("", "", np.concatenate([model.wood(), leaves]))])
    assert found.said == "by shape"
    assert len(found.wood) == len(model.wood())
    assert found.leaves is not None
    assert len(found.leaves) == len(leaves)
    number = {"quads": 108, "tufts": 540}.get(kind, 108)
    seen = recognise(found.wood, found.leaves)
    assert seen.leaves.count == number
    np.testing.assert_array_equal(seen.wood.count, 28)
    bears = np.bincount(seen.bearer, minlength=28)
    assert np.count_nonzero(bears) >= 26


@pytest.mark.parametrize("shape", [{}, {"sides": 3}, {"capped": True}, {"sides": 24}])
def test_wood_alone_stays_wood(shape: dict[str, object]) -> None:
    model = tree(**shape)  # type: ignore[arg-type]
    found = sort_out([Group("", "", model.wood())])
    assert found.leaves is None
    np.testing.assert_array_equal(found.wood, model.wood())
    assert not looks_like_leaves(part(model.wood())).any()


def test_names_tell_before_shapes_and_the_ground_is_left_out() -> None:
    model = tree()
    ground = blade([-5, 0, 0], [1, 0, 0], [0, 1, 0], 10, 10)
    wood, leaves = model.wood(), model.leaves()
    groups = [
        Group("Tree", "Bark_Oak", wood[:500]),
        Group("Tree", "Leaves.001", leaves),
        Group("Ground", "", ground),
        Group("twigs", "Material", wood[500:]),
    ]
    found = sort_out(groups)
    assert found.said == "by name"
    assert (len(found.wood), len(found.leaves)) == (len(wood), len(leaves))  # type: ignore[arg-type]
    # names that do not tell: shape decides for a whole group
    groups = [Group("a", "Mat1", wood), Group("a", "Mat2", leaves)]
    found = sort_out(groups)
    assert found.said == "by shape"
    assert (len(found.wood), len(found.leaves)) == (len(wood), len(leaves))  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(2))
def test_the_upright_axis_is_found(seed: int) -> None:
    wood = tree(seed).wood()
    assert likely_up(wood) == "z"
    lying = wood @ UPRIGHT["y"]  # back from z to y
    assert likely_up(lying) == "y"
    parts = stood(sort_out([Group("bark", "", lying)]), "y")
    np.testing.assert_allclose(parts.wood, wood, atol=1e-12)


def palm(fronds: int = 18) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A trunk, fronds as strips of six quads from its top, and their tips."""
    top, leaves, tips = at(0.3, 0, 8), [], []
    share = np.linspace(0, 1, 7)[:, None]
    for k in range(fronds):
        turn, lift = 2.4 * k, np.deg2rad(65 - 5 * k)
        out = at(np.cos(turn), np.sin(turn), 0)
        rib = top + 2.5 * share * (out * np.cos(lift) + at(0, 0, np.sin(lift)))
        rib = rib + 0.1 * out - share**2 * at(0, 0, 1)
        half = 0.25 * np.sin(np.pi * np.clip(share, 0.03, 0.98)) * at(-out[1], out[0], 0)
        for a, b, c, d in zip(
            rib - half, rib + half, (rib + half)[1:], (rib - half)[1:], strict=False
        ):
            leaves += [[a, b, c], [a, c, d]]
        tips.append(rib[-1])
    trunk = tube(line([0, 0, 0], top, 12), np.linspace(0.2, 0.12, 12), capped=True)
    return trunk, np.array(leaves), np.array(tips)


def test_the_fronds_of_a_palm_are_its_branches() -> None:
    trunk, leaves, tips = palm()
    parts = sort_out([Group("", "", np.concatenate([trunk, leaves]))])
    found = recognise(parts.wood, parts.leaves)
    assert found.fronds
    assert found.wood.count == 1 + len(tips)
    assert found.wood.drawn == len(trunk)
    np.testing.assert_array_equal(found.parent, [-1, *[found.trunk] * len(tips)])
    np.testing.assert_array_equal(found.bearer, 1 + np.arange(len(tips)))
    assert np.linalg.norm(found.tip[1:] - tips, axis=1).max() < 0.1
    top = at(0.3, 0, 8)
    assert np.linalg.norm(found.foot[1:] - top, axis=1).max() < 0.25


def test_small_leaves_on_a_pole_make_no_palm() -> None:
    trunk, _, _ = palm()
    leaves = np.concatenate([blade([0.2, 0, z], [1, 0, 0], [0, 1, 0]) for z in range(2, 8)])
    with pytest.raises(ValueError, match="without a fork"):
        recognise(trunk, leaves)


def test_stems_of_a_bush_are_told_from_branches() -> None:
    model = Model()
    for x, radius in ((0.0, 0.08), (0.5, 0.1), (1.0, 0.085)):
        model.add(line([x, 0, 0], [2 * x - 0.5, 0, 5]), np.linspace(radius, radius / 2, 6), -1)
    model.add(line([0.5, 0, 2], [1.5, 1, 3]), np.linspace(0.04, 0.02, 6), 1)
    found = recognise(model.wood())
    assert found.trunk == 1
    assert sorted(found.stems) == [0, 1, 2]


@pytest.mark.parametrize(
    "shape",
    [{"sides": 3}, {"sides": 24}, {"capped": True, "sides": 6}],
)
def test_structure_is_recognised_whatever_the_tubes_are_made_of(shape: dict[str, object]) -> None:
    model = tree(**shape)  # type: ignore[arg-type]
    model.check(recognise(model.wood(), model.leaves()))


@pytest.mark.parametrize("seed", [1, 4])
def test_structure_does_not_depend_on_the_order_of_facets_nor_on_float32(seed: int) -> None:
    model = tree(seed, branches=5 + seed)
    rng = np.random.default_rng(seed)
    wood = model.wood()
    order = rng.permutation(len(wood))
    shuffled = np.stack([np.roll(f, rng.integers(3), axis=0) for f in wood[order]])
    found = recognise(
        shuffled.astype(np.float32).astype(np.float64),
        model.leaves().astype(np.float32).astype(np.float64),
    )
    model.check(found, order)


@pytest.mark.parametrize(("rings", "sides"), [(2, 4), (3, 7), (7, 12), (40, 4)])
def test_centreline_does_not_depend_on_where_rings_are(rings: int, sides: int) -> None:
    model = Model()
    model.add(line([0, 0, 0], [0.5, 0, 8], rings), 0.2, -1, sides=sides)
    model.add(line([0.25, 0, 4], [3.25, 1, 5], rings), 0.05, 0, sides=sides)
    found = recognise(model.wood())
    for piece in (0, 1):
        np.testing.assert_allclose(
            found.foot[piece], model.foot[piece], atol=0.05 * model.radius[piece]
        )
        np.testing.assert_allclose(
            found.tip[piece], model.tip[piece], atol=0.05 * model.radius[piece]
        )
        np.testing.assert_allclose(found.radius[piece], model.radius[piece], rtol=0.02)
        knots = found.lines.knot[found.lines.first[piece] : found.lines.first[piece + 1]]
        axis = (model.tip[piece] - model.foot[piece]) / np.linalg.norm(
            model.tip[piece] - model.foot[piece]
        )
        aside = np.cross(knots - model.foot[piece], axis)
        assert np.linalg.norm(aside, axis=1).max() < 0.1 * model.radius[piece]


def test_radius_of_a_rounded_foot_is_that_of_the_tube() -> None:
    lift = np.deg2rad(np.arange(0, 91, 15))
    dome = 0.1 * (1 - np.cos(lift))
    path = np.concatenate([dome, np.linspace(0.2, 3, 20)])[:, None] * [1.0, 0, 0] + [0, 0, 5]
    radius = np.concatenate([0.1 * np.maximum(np.sin(lift), 1e-3), np.full(20, 0.1)])
    model = Model()
    model.add(line([0, 0, 0], [0, 0, 10]), 0.3, -1)
    model.add(path, radius, 0, sides=12)
    found = recognise(model.wood())
    assert found.radius[1] == pytest.approx(0.1, rel=0.05)
    np.testing.assert_allclose(found.foot[1], [0, 0, 5], atol=0.01)


def test_a_hairpin_is_followed_round_its_bend() -> None:
    """Up 2 m, over an arc of 0.3 m radius, and down again, nearer to the ground than its foot is."""
    arc = np.linspace(0, np.pi, 9)
    bend = np.stack([0.5 - 0.3 * np.cos(arc), 0 * arc, 7 + 0.3 * np.sin(arc)], axis=1)
    path = np.concatenate([line([0.2, 0, 5], bend[0])[:-1], bend, line(bend[-1], [0.8, 0, 3])[1:]])
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10]), 0.3, -1)
    hairpin = model.add(path, np.linspace(0.05, 0.02, len(path)), trunk)
    model.add(line([0.8, 0, 3.5], [1.4, 0, 3.6]), np.linspace(0.01, 0.003, 6), hairpin)
    found = recognise(model.wood())
    model.check(found)
    np.testing.assert_allclose(found.tip[1], [0.8, 0, 3], atol=0.02)
    drawn = 2.0 + 0.3 * np.pi + 4.0
    np.testing.assert_allclose(found.lines.length()[1], drawn, rtol=0.03)


def taper(low: float, high: float, count: int = 6) -> np.ndarray:
    return np.linspace(low, high, count)


def steep(number: int) -> np.ndarray:
    """The path of a branch that rises along a trunk, as a poplar's or a cypress'."""
    rise, turn, z = np.linspace(0, 1, 10), 2.4 * number, 1.0 + 0.25 * number
    out = at(np.cos(turn), np.sin(turn), 0) * (0.28 + 0.2 * (1 - z / 12))
    return at(0, 0, z) + np.outer(1 - (1 - rise) ** 3, out) + np.outer(1.4 * rise, at(0, 0, 1))


TRUNK = (-1, line([0, 0, 0], [0, 0, 10], 20), 0.2)
PLAIN = (-1, line([0, 0, 0], [0, 0, 5]), 0.1)
AT_TIP = at(1, 0, 3) + 0.975 * at(-0.84, 0.1, 4)
SCENES = {  # tubes: parent, path, radius and how it is made; then leaves: bearer, foot, out, across, size
    "branches of a whorl hang on the trunk and not on each other": (
        [(-1, line([0, 0, 0], [0, 0, 10], 8), taper(0.2, 0.1, 8))]
        + [
            (0, line([0, 0, 5], at(0, 0, 5) + 2 * at(np.cos(t), np.sin(t), 0.4)), taper(0.08, 0.02))
            for t in np.arange(8) * np.pi / 4
        ],
    ),
    "feet just off the bark hang on the trunk and not on a nearer neighbour": (
        [
            (-1, line([0, 0, 0], [0, 0, 10], 20), 0.3, {"sides": 64}),
            (0, line([0.31, 0, 5], [2.3, 0, 5.5]), taper(0.1, 0.03)),  # a tenth of its radius off
            (0, line([0.34, 0, 4.88], [2.3, 0, 3.9]), taper(0.1, 0.03)),  # 0.04, the other 0.02 off
        ],
    ),
    "a thin tip that touches a neighbour does not hang on it": (
        [
            TRUNK,
            (0, line([0, 0, 4], [3, 0, 4]), taper(0.08, 0.03)),
            (0, line([0, 0, 6], [3, 0, 6]), taper(0.08, 0.03)),
            (1, line([1.5, 0, 4], [1.5, 0, 6]), taper(0.03, 0.01)),  # up to the upper one
            (2, line([2.5, 0, 6], [0.1, 0, 8]), taper(0.03, 0.01)),  # back into the trunk
        ],
    ),
    # Twigs begin on the axis of a thin branch that lies against the trunk; their tips pierce another.
    "a foot within its parent is not hung on wood that crosses there": (
        [
            TRUNK,
            (0, line([0, 0, 3], [2, 0, 3]), taper(0.08, 0.04)),
            (1, line([1, 0, 3], [0.16, 0.1, 7]), taper(0.03, 0.02)),
            *(  # within each other, and in the trunk
                (2, line(AT_TIP, AT_TIP + 0.5 * way), taper(0.016, 0.012))
                for way in (at(1, 0.3, 0), at(0.3, 1, 0.2), at(1, 1, 0.5))
            ),
            (2, line([0.58, 0.05, 5], [0, 0.0, 6]), taper(0.012, 0.011)),
        ],
    ),
    # Each branch is twice as long as its bark is away from the next.
    "a column is a trunk with steep branches beside it": (
        [(-1, line([0, 0, 0], [0, 0, 12], 24), taper(0.2, 0.03, 24))]
        + [
            (0, steep(k), taper(0.3, 0.1, 10) * (0.2 - 0.014 * (1.0 + 0.25 * k))) for k in range(40)
        ],
    ),
    "a limb thicker than the tapered trunk is not the trunk": (
        [
            (-1, line([0, 0, 0], [0, 0, 3]), taper(0.3, 0.2)),
            (0, line([0, 0, 2.8], [3, 0, 9]), taper(0.32, 0.1)),
        ],
    ),
    # Its corners are nearer to the neighbour's bark than to that of its own twig.
    "a leaf hangs by the middle of its side too": (
        [
            PLAIN,
            (0, line([0, 0, 3], [2, 0, 3]), taper(0.02, 0.015)),
            (0, line([0, 0, 3.1], [2, 0, 3.1]), taper(0.02, 0.015)),
        ],
        (1, [1, 0, 3], [0, 1, 0], [0, 0, 1], 0.1, 0.14),
    ),
    # Its foot is inside both the twig and the branch that bears it, and deeper in the branch.
    "a leaf in a fork hangs on the twig": (
        [
            PLAIN,
            (0, line([0, 0, 3], [2, 0, 3]), taper(0.06, 0.05)),
            (1, line([1, 0, 3], [1, 1, 3]), taper(0.01, 0.005)),
        ],
        (2, [1, 0.03, 3], [0, 0.6, 0.8], [1, 0, 0]),
    ),
}


@pytest.mark.parametrize("scene", SCENES)
def test_what_hangs_on_what(scene: str) -> None:
    tubes, *leaves = SCENES[scene]
    model = Model()
    for parent, path, radius, *made in tubes:
        model.add(path, radius, parent, **(made[0] if made else {}))
    for leaf in leaves:
        model.leaf(*leaf)
    model.check(recognise(model.wood(), model.leaves() if leaves else None))


def test_feet_on_the_bark_and_feet_that_float_are_hung_too() -> None:
    model = Model()
    trunk = model.add(line([0, 0, 0], [0, 0, 10], 20), 0.2, -1)
    for number, gap in enumerate((-0.1, -0.01, 0.0, 0.02, 0.3)):
        foot = np.array([0.2 + gap, 0, 2.0 + 1.5 * number])
        branch = model.add(line(foot, foot + at(2, 0, 1)), np.linspace(0.04, 0.01, 6), trunk)
        foot = foot + at(1, 0.03, 0.5)
        model.add(line(foot, foot + at(0.2, 0.5, 0.2)), np.linspace(0.008, 0.003, 6), branch)
    found = recognise(model.wood())
    model.check(found)
    for number, gap in enumerate((-0.1, -0.01, 0.0, 0.02, 0.3)):
        assert found.gap[1 + 2 * number] == pytest.approx(gap, abs=0.01)


def test_pieces_that_begin_within_each_other_are_hung_all_the_same() -> None:
    """Three that float, each with its thick end in the next: a ring has no root."""
    model = Model()
    model.add(line([0, 0, 0], [0, 0, 10], 20), 0.2, -1)
    corners = [at(1, 0, 5), at(2, 0, 5), at(1.5, 0.8, 5)]
    for number in range(3):
        end = corners[(number + 1) % 3]
        model.add(line(end, corners[number] + 0.2 * (corners[number] - end)), 0.03, 0)
    found = recognise(model.wood())
    assert (found.parent[1:] >= 0).all()
    assert np.count_nonzero(found.parent == 0) == 1


def test_of_several_stems_the_largest_is_the_trunk() -> None:
    model = Model()
    for x, radius, top in ((0.0, 0.08, 4.0), (0.15, 0.1, 6.0), (0.3, 0.085, 5.0)):
        model.add(line([x, 0, 0.01 * x], [2 * x, 0, top]), np.linspace(radius, radius / 2, 6), 1)
    model.parents[1] = -1
    found = recognise(model.wood())
    assert found.trunk == 1
    np.testing.assert_array_equal(found.parent, [1, -1, 1])
    assert [b.height for b in split_tree(model.wood()).branches] == pytest.approx([0, 0], abs=0.02)


@pytest.mark.medium
def test_contacts_agree_with_a_search_of_all_wood() -> None:
    model = tree(3)
    found = recognise(model.wood())
    lines = found.lines
    rng = np.random.default_rng(5)
    low, high = model.wood().reshape(-1, 3).min(axis=0), model.wood().reshape(-1, 3).max(axis=0)
    scattered = rng.uniform(low, high, (100, 3))
    near = lines.knot[rng.integers(len(lines.knot), size=300)] + rng.normal(size=(300, 3)) * 0.04
    points = np.concatenate([scattered, near])
    contact = find_contacts(lines, np.arange(found.wood.count), points)

    gaps = np.full((len(points), found.wood.count), np.inf)
    for piece in range(found.wood.count):
        knots = slice(lines.first[piece], lines.first[piece + 1])
        fine = np.linspace(0, lines.along[knots][-1], 1000)
        axis = np.stack(
            [np.interp(fine, lines.along[knots], lines.knot[knots, k]) for k in range(3)], axis=1
        )
        radius = np.interp(fine, lines.along[knots], lines.radius[knots])
        distance = np.linalg.norm(points[:, None] - axis, axis=2) - radius
        gaps[:, piece] = distance.min(axis=1)
    exact = gaps.min(axis=1)
    missed = contact.gap - exact
    assert missed.min() > -1e-3  # never nearer than there is wood
    inside = exact < 0
    assert np.count_nonzero(inside) > 50
    assert np.all(contact.gap[inside] < 1e-3)
    assert np.mean(missed < 2e-3) > 0.97  # far from all wood, the second nearest may be taken,
    assert np.all(missed < 0.2 * np.maximum(exact, 0.02))  # but none that is much farther
    np.testing.assert_allclose(
        contact.gap, gaps[np.arange(len(points)), contact.piece], rtol=0, atol=5e-3
    )


@pytest.mark.parametrize("up", ["y", "z"])
def test_ground_below_a_tree_is_left_out_and_said(up):
    model = tree()
    wood = model.wood()
    half = np.ptp(wood) / 2
    x, y = np.meshgrid(np.linspace(-half, half, 9), np.linspace(-half, half, 9))
    corners = np.stack([x, y, np.full_like(x, wood[:, :, 2].min())], axis=-1)
    a, b, c, d = (
        corners[i : i + 8, j : j + 8].reshape(-1, 3) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    )
    ground = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    for groups in (
        [Group("", "", np.concatenate([wood, ground]) @ UPRIGHT[up])],
        [Group("wood", "", wood @ UPRIGHT[up]), Group("Slab", "", ground @ UPRIGHT[up])],
    ):
        found = sort_out(groups)
        assert "a flat piece at the foot is the ground and left out" in found.said
        assert sorted(np.ptp(found.wood, axis=(0, 1))) == pytest.approx(
            sorted(np.ptp(wood, axis=(0, 1)))
        )
