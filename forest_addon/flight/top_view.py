"""A flight from above, as an image: trees, trail, flyer and goal, drawn by numpy alone.

The forest is painted once a world, wood that stops over crowns; what moves is painted on a copy, so that a
picture costs less than a millisecond. A window shows it where matplotlib can open one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.runs import numbered
from ..base.trimesh import LEAF

PIXELS = 480  # of the longer side
GROUND, CROWN, WOOD = (233, 228, 214), (150, 178, 128), (84, 58, 40)
TRAIL, FLYER, GOAL = (200, 60, 30), (180, 20, 20), (30, 90, 200)
MARGIN = 5.0  # metres around the field
POINTS = 4000  # of a mesh, that stand for it


class TopView:
    """The picture of one world; ``picture`` (Y, X, 3) is its forest alone."""

    def __init__(self, world: Any) -> None:
        self.world = world
        low, high = world.field
        self._low, extent = low - MARGIN, high - low + 2 * MARGIN
        self._scale = PIXELS / float(extent.max())
        self._size = np.maximum((extent * self._scale).astype(int), 16)  # x, y
        self._window: Any = None
        self.picture = self._painted()

    def draw(self, trail: np.ndarray, goal: np.ndarray, heading: float) -> np.ndarray:
        """(Y, X, 3) uint8. trail : (P, 3) places from the start on. heading : radians."""
        picture = self.picture.copy()
        steps = np.linalg.norm(np.diff(trail[:, :2], axis=0), axis=1)
        row, place = numbered(np.maximum((steps * self._scale * 1.5).astype(int), 1))
        if len(steps):
            share = place / np.bincount(row)[row]
            line = trail[row, :2] + share[:, None] * (trail[row + 1, :2] - trail[row, :2])
            self._dots(picture, line, TRAIL, 1)
        self._dots(picture, goal[None, :2], GOAL, 4)
        here = trail[-1, :2]
        nose = here + np.linspace(0, 8, 16)[:, None] / self._scale * [
            np.cos(heading),
            np.sin(heading),
        ]
        self._dots(picture, nose, FLYER, 1)
        self._dots(picture, here[None], FLYER, 3)
        return picture

    def show(self, picture: np.ndarray) -> None:
        """Show a picture in a window; without a screen nothing is shown."""
        import matplotlib.pyplot as plt

        if self._window is None:
            figure = plt.figure("Flight", figsize=(6, 6 * self._size[1] / self._size[0]))
            axes = figure.add_axes((0, 0, 1, 1))
            axes.axis("off")
            self._window = (figure, axes.imshow(picture))
        figure, image = self._window
        image.set_data(picture)
        figure.canvas.draw_idle()
        figure.canvas.flush_events()

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            import matplotlib.pyplot as plt

            plt.close(self._window[0])
            self._window = None

    def _painted(self) -> np.ndarray:
        picture = np.empty((self._size[1], self._size[0], 3), dtype=np.uint8)
        picture[:] = GROUND
        geometry = self.world.geometry
        for leafy, colour, radius in ((True, CROWN, 1), (False, WOOD, 1)):
            for number, mesh in enumerate(geometry.meshes):
                rows = np.flatnonzero((geometry.mesh_index == number) & (geometry.tree >= 0))
                if leafy:
                    points = mesh.vertices[mesh.triangles[mesh.part == LEAF, 0]]
                else:
                    points = self.world.stock.solids[number].corners.reshape(-1, 3)
                    points = points[points[:, 2] < 2.5]
                points = points[:: max(1, len(points) // POINTS)]
                for m in geometry.transform[rows]:
                    self._dots(picture, points @ m[:2, :3].T + m[:2, 3], colour, radius)
        return picture

    def _dots(
        self, picture: np.ndarray, place: np.ndarray, colour: tuple[int, ...], radius: int
    ) -> None:
        """Squares of so many pixels around places (P, 2)."""
        column, row = ((place - self._low) * self._scale).astype(int).T
        row = self._size[1] - 1 - row
        reach = np.arange(-radius + 1, radius) if radius > 1 else np.zeros(1, dtype=int)
        rows, columns = row[:, None, None] + reach[:, None], column[:, None, None] + reach
        rows, columns = np.broadcast_arrays(rows, columns)
        inside = (rows >= 0) & (rows < self._size[1]) & (columns >= 0) & (columns < self._size[0])
        picture[rows[inside], columns[inside]] = colour
