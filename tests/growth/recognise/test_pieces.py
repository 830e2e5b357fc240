"""Welding and parting, on facets laid out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forest_addon.growth.own_tree.pieces import part, weld

A, B, C, D = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]
SQUARE = np.array([[A, B, C], [A, C, D]])


def test_two_facets_with_an_edge_in_common_are_one_piece() -> None:
    pieces = part(SQUARE)
    assert pieces.count == 1
    assert len(pieces.vertices) == 4
    np.testing.assert_array_equal(pieces.vertices[pieces.triangles], SQUARE)
    lengths = np.linalg.norm(np.diff(pieces.vertices[pieces.edges], axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(np.sort(lengths), [1, 1, 1, 1, np.sqrt(2)])


def test_pieces_that_touch_at_a_point_stay_apart_and_share_no_vertex() -> None:
    pieces = part(np.concatenate([SQUARE, SQUARE + np.array([1.0, 1.0, 0.0])]))
    assert pieces.count == 2
    np.testing.assert_array_equal(pieces.piece, [0, 0, 1, 1])
    assert len(pieces.vertices) == 8
    owners = pieces.piece_of_vertex[pieces.triangles]
    np.testing.assert_array_equal(owners, np.stack([pieces.piece] * 3, axis=1))


def test_pieces_are_numbered_as_the_file_shows_them() -> None:
    far = SQUARE + np.array([5.0, 0.0, 0.0])
    pieces = part(np.stack([far[0], SQUARE[0], far[1], SQUARE[1]]))
    np.testing.assert_array_equal(pieces.piece, [0, 1, 0, 1])


def test_repeats_are_dropped_whichever_way_round() -> None:
    repeats = np.concatenate([SQUARE, SQUARE[:, ::-1], SQUARE[:, [1, 2, 0]], SQUARE])
    np.testing.assert_array_equal(part(repeats).triangles, part(SQUARE).triangles)


def test_facets_of_no_area_are_dropped() -> None:
    flat = np.array([[A, A, A], [A, B, A], [A, [0.5, 0.0, 0.0], B], [A, [0.3, 1e-9, 0.0], B]])
    pieces = part(np.concatenate([flat, SQUARE]))
    np.testing.assert_array_equal(pieces.vertices[pieces.triangles], SQUARE)
    assert part(flat).count == 0
    assert part(np.empty((0, 3, 3))).count == 0


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


@pytest.mark.parametrize("order", range(5))
def test_the_order_of_facets_does_not_change_the_pieces(order: int) -> None:
    rng = np.random.default_rng(order)
    owner = np.repeat(np.arange(30), 2)
    facets = (SQUARE[None] + 3.0 * np.arange(30)[:, None, None, None] * [1.0, 0.5, 0.0]).reshape(
        -1, 3, 3
    )
    shuffled = rng.permutation(60)
    turned = np.stack([np.roll(f, rng.integers(3), axis=0) for f in facets[shuffled]])
    found = part(turned).piece
    assert len(np.unique(found)) == 30
    assert len(np.unique(np.stack([found, owner[shuffled]], axis=1), axis=0)) == 30
