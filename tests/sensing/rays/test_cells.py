"""Cells on a line against the interval that the line has in each cell of the box, all cells tried."""

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.sensing.rays.cells import Cells, walk


def brute(cells, origin, way, reach):
    """{number of a cell: (enter, leave)} of one line, longer than rounding."""
    grid = np.indices(cells.size).reshape(3, -1).T
    low = (cells.low + grid) * cells.edge
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / way, (low + cells.edge - origin) / way
    inside = (origin >= low) & (origin < low + cells.edge)
    near = np.where(way == 0, np.where(inside, -np.inf, np.inf), np.minimum(a, b))
    far = np.where(way == 0, np.where(inside, np.inf, -np.inf), np.maximum(a, b))
    enter, leave = np.maximum(near.max(axis=1), 0), np.minimum(far.min(axis=1), reach)
    return {n: (enter[n], leave[n]) for n in np.flatnonzero(leave - enter > 1e-9).tolist()}


def test_lines_pass_the_cells_they_should():
    rng = stream(2, "walk")
    cells = Cells(np.array([-3, 2, 0]), np.array([7, 5, 6]), 0.4)
    origins = rng.uniform(-4, 6, (120, 3))
    ways = rng.normal(0, 1, (120, 3))
    ways[:20, 0] = 0  # along walls
    ways[:10, 1] = 0
    origins[20:100] = rng.uniform([-1.2, 0.8, 0], [1.6, 2.8, 2.4], (80, 3))  # from within
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reach = rng.uniform(0.5, 12, 120)
    found = {}
    for step in walk(cells, origins, ways, reach):
        for line, cell, enter, leave in zip(
            *(step.line.tolist(), step.cell.tolist(), step.enter, step.leave), strict=True
        ):
            if leave - enter > 1e-9:
                assert (line, cell) not in found
                found[line, cell] = (enter, leave)
    wanted = {
        (line, cell): ends
        for line in range(120)
        for cell, ends in brute(cells, origins[line], ways[line], reach[line]).items()
    }
    assert found.keys() == wanted.keys()
    assert len(wanted) > 200
    for key, ends in wanted.items():
        assert np.allclose(found[key], ends, atol=1e-9)


def test_no_cells_and_no_lines():
    none = Cells.around(np.empty((0, 3), int), 0.5)
    assert not list(walk(none, np.zeros((1, 3)), np.eye(3)[:1], np.ones(1)))
    box = Cells.around(np.array([[0, 0, 0], [2, 2, 2]]), 0.5)
    assert box.count == 27
    assert not list(walk(box, np.empty((0, 3)), np.empty((0, 3)), np.empty(0)))
    assert box.at(np.array([[0.1, 0.1, 0.1], [9.0, 0, 0], [-0.1, 0, 0]])).tolist() == [0, -1, -1]
