"""Tiles of a field: every place in one, every crown that reaches in, no pulse beyond what its scene holds."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from forest_addon.base.rng import stream
from forest_addon.sensing.lidar.pattern import Pulses, pattern_of
from forest_addon.spec import Airborne, Forest, Terrestrial
from forest_addon.tiles import LEVELS, TiledPulses, TileGrid, belongs, buffer_of, tiled_pulses

SIZES = st.floats(0.5, 300.0)


@given(
    size=SIZES, along=st.floats(1.0, 200.0), across=st.floats(1.0, 200.0), x=st.floats(-1e5, 1e5)
)
def test_every_place_lies_in_one_tile_and_between_its_corners(size, along, across, x):
    grid = TileGrid.of(Forest(size=(along, across), origin=(x, -7.0)), size)
    rng = stream(3, "places")
    place = grid.low + rng.random((200, 2)) * (grid.high - grid.low)
    low, high = grid.corners(grid.tile_of(place))
    room = 1e-9 * (1 + abs(x))
    assert (place >= low - room).all()
    assert (place <= high + room).all()
    low, high = grid.corners(np.arange(len(grid)))
    assert np.prod(high - low, axis=1).sum() == pytest.approx(along * across, rel=1e-6)
    assert len({grid.name(tile) for tile in range(len(grid))}) == len(grid)


@given(
    size=st.floats(3.0, 80.0),
    height=st.floats(-5.0, 90.0),
    down=st.floats(-1.0, 1.0),
    reach=st.floats(1.0, 200.0),
    seed=st.integers(0, 99),
)
def test_no_ray_of_a_beam_leaves_what_its_tile_holds(size, height, down, reach, seed):
    scanner = Terrestrial(max_range=reach)
    grid = TileGrid.of(Forest(size=(60.0, 40.0)), size)
    rng = stream(seed, "pulses")
    origin = np.column_stack(
        [rng.uniform(-30, 90, 60), rng.uniform(-30, 70, 60), np.full(60, height)]
    )
    way = rng.normal(size=(60, 3)) * [1.0, 1.0, 0.3] + [0, 0, down]
    way /= np.linalg.norm(way, axis=1)[:, None]
    zero = np.zeros(60)
    box = np.array([[-10.0, -5.0, -1.0], [55.0, 60.0, 22.0]])
    tile, excess = belongs(scanner, Pulses(origin, way, way, zero, zero), grid, box)
    low, high = grid.corners(tile)
    far = np.linspace(0, reach, 301)[:, None, None]
    point = origin + far * way
    beyond = np.maximum(low - point[..., :2], point[..., :2] - high).max(axis=2)
    among = ((point >= box[0]) & (point <= box[1])).all(axis=2)
    assert (np.where(among, beyond, 0.0) <= excess).all()


def test_pulses_of_all_pieces_are_all_pulses_once_and_followed_ones_are_counted():
    scanner = Airborne(position=(0, 20, 60), track=60, speed=20, pulse_rate=2000, line_rate=20)
    pattern = pattern_of(scanner)
    grid = TileGrid.of(Forest(size=(60.0, 40.0)), 12.0)
    box = np.array([[-20.0, -20.0, 0.0], [80.0, 60.0, 15.0]])
    found = tiled_pulses(scanner, pattern, grid, box, 5.0)
    every = [np.concatenate(list(found.numbers(piece, 97))) for piece in found.pieces]
    assert np.array_equal(np.sort(np.concatenate(every)), np.arange(pattern.count))
    assert all((np.diff(numbers) > 0).all() for numbers in every)
    beyond = [len(n) for n, p in zip(every, found.pieces, strict=True) if p % LEVELS]
    assert found.followed == sum(beyond) > 0
    tile, excess = belongs(scanner, pattern.pulses(np.arange(pattern.count)), grid, box)
    for numbers, piece in zip(every, found.pieces, strict=True):
        assert (tile[numbers] == piece // LEVELS).all()
        assert (excess[numbers] <= buffer_of(int(piece % LEVELS), 5.0)).all()


def test_a_piece_without_pulses_gives_none():
    found = TiledPulses(np.array([0]), np.array([LEVELS]), 5, 0.0, 0)
    assert list(found.numbers(0, 10)) == []
