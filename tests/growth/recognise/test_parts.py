"""Wood told from leaves by names and shapes, and what is up."""

from __future__ import annotations

import numpy as np
import pytest
from references.model_tree import Model, at, blade, line, tree, tube

from forest_addon.growth.own_tree.pieces import (
    UPRIGHT,
    Group,
    likely_up,
    looks_like_leaves,
    part,
    sort_out,
    stood,
    upright,
)
from forest_addon.growth.own_tree.recognise import recognise, recognise_pieces


def card(base: np.ndarray, out: np.ndarray, across: np.ndarray) -> np.ndarray:
    return blade(base, out, across, 0.3, 0.2)


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
                make = {
                    "quads": lambda a, b, c: blade(a, b, c),
                    "cards": card,
                    "crossed": lambda a, _b, _c: crossed(a, 2),
                    "stars": lambda a, _b, _c: crossed(a, 3),
                    "shaped": curled,
                }[kind]
                found.append(make(base, out, across))
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


@pytest.mark.medium
@pytest.mark.parametrize("up", UPRIGHT)
@pytest.mark.parametrize("leafy", [False, True])
def test_pieces_that_were_sorted_are_recognised_as_the_facets_are(up: str, leafy: bool) -> None:
    model = tree()
    facets = np.concatenate([model.wood(), model.leaves()] if leafy else [model.wood()])
    parts = stood(sort_out([Group("", "", facets @ UPRIGHT[up])]), up)
    assert parts.parted is not None
    plain, quick = recognise(parts.wood, parts.leaves), recognise_pieces(*parts.parted)
    np.testing.assert_array_equal(quick.parent, plain.parent)
    np.testing.assert_array_equal(quick.bearer, plain.bearer)
    np.testing.assert_allclose(quick.lines.knot, plain.lines.knot, atol=1e-9)
    np.testing.assert_allclose(
        quick.wood.vertices[quick.wood.triangles], parts.wood, rtol=0, atol=1e-5
    )


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


@pytest.mark.parametrize("seed", range(4))
def test_the_upright_axis_is_found(seed: int) -> None:
    wood = tree(seed).wood()
    assert likely_up(wood) == "z"
    lying = wood @ UPRIGHT["y"]  # back from z to y
    assert likely_up(lying) == "y"
    np.testing.assert_allclose(upright(lying, "y"), wood, atol=1e-12)


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
