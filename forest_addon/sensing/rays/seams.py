"""Seams of trees in pieces: triangles that several pieces have, a little apart where the tree bends.

Which of them an engine in float32 meets first may depend on the rays it goes with. In float64 one is first.
"""

from __future__ import annotations

import numpy as np

from .pieces import SwayingScene


class Seams:
    """Triangles at the seams of a scene in pieces, each with its other copies, in a ring."""

    def __init__(self, cut: SwayingScene) -> None:
        size = np.array([len(rows) for rows in cut.triangle], dtype=np.int64)
        self._first = np.cumsum(size) - size
        every = int(size.sum())
        self._shift = np.zeros(every, dtype=np.int64)  # from the piece's instance to the next one's
        self._next = np.arange(every) - np.repeat(self._first, size)  # its triangle there
        for listed in cut.known.values():
            self._join([mesh for _, mesh in listed], cut)
        self._mesh, self._count = cut.scene.mesh_index, cut.count

    def _join(self, meshes: list[int], cut: SwayingScene) -> None:
        own = np.concatenate([cut.triangle[mesh] for mesh in meshes])
        place = np.repeat(np.arange(len(meshes)), [len(cut.triangle[mesh]) for mesh in meshes])
        number = np.concatenate(
            [self._first[mesh] + np.arange(len(cut.triangle[mesh])) for mesh in meshes]
        )
        order = np.argsort(own, kind="stable")
        begins = np.flatnonzero(np.diff(own[order], prepend=-1))
        copies = np.diff(begins, append=len(own))
        after = np.arange(1, len(own) + 1)
        after[begins + copies - 1] = begins
        here, there = order, order[after]
        local = number - self._first[np.array(meshes)[place]]
        self._shift[number[here]] = place[there] - place[here]
        self._next[number[here]] = local[there]

    def shared(self, instance: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """The rows of hits on pieces, by instances and triangles (R,), whose triangle has copies."""
        return np.flatnonzero(self._shift[self._first[self._mesh[instance]] + triangle])

    def other(self, instance: np.ndarray, triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The next copy of triangles of instances (R,): its instance and triangle."""
        number = self._first[self._mesh[instance]] + triangle
        return instance + self._shift[number], self._next[number]
