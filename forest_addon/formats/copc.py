"""Cloud-optimised point clouds (COPC 1.0): a LAZ whose chunks are the nodes of an octree.

A viewer reads the coarse nodes first and fine ones where it looks. A node holds at most one point of each
cell of a grid, ``CELLS`` along its edge (which of them is drawn, with the same draw for the same cloud); the
others go to its children. Chunks and the hierarchy are written by copclib.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import laspy
import numpy as np

from ..base.rng import stream
from .atomic import replacing
from .foreign import library

CELLS = 128  # along the edge of a node, as the format recommends
FEWEST = 5_000  # points of a node that are not divided further
DEEPEST = 14  # the cells of its nodes still have numbers of 63 bits


def write_copc(path: str | os.PathLike[str], plain: str | os.PathLike[str]) -> None:
    """Write the points of a LAS or LAZ file of point format 6 as COPC, with its extra bytes and system.

    Raises
    ------
    SpecError : copclib is not installed.
    OSError : it cannot be written.
    """
    copclib = library(path, "files", "copclib", ", or save as .laz")
    cloud = laspy.read(plain)
    with replacing(path) as partial, tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made.copc.laz"
        if len(cloud.points):
            extra = copclib.LazReader(os.fspath(plain)).laz_config.extra_bytes_vlr
        else:
            extra = copclib.EbVlr(0)  # what it has no record of, it cannot read
        told = cloud.header.vlrs.get("WktCoordinateSystemVlr")  # copclib reads it six bytes late
        wkt = told[0].string if told else ""
        scale, offset = (
            copclib.Vector3(*map(float, v)) for v in (cloud.header.scales, cloud.header.offsets)
        )
        config = copclib.CopcConfigWriter(6, scale, offset, wkt, extra)
        position = np.column_stack([cloud.x, cloud.y, cloud.z]).astype(np.float64)
        corners = position if len(position) else np.zeros((1, 3))
        low, high = corners.min(axis=0), corners.max(axis=0)
        half = max(float((high - low).max()) / 2 * 1.0001, 1e-3)
        centre = (low + high) / 2
        info = config.copc_info
        info.center_x, info.center_y, info.center_z = map(float, centre)
        info.halfsize, info.spacing = half, 2 * half / CELLS
        config.las_header.min = copclib.Vector3(*low.tolist())
        config.las_header.max = copclib.Vector3(*high.tolist())
        config.las_header.points_by_return = list(map(int, cloud.header.number_of_points_by_return))
        writer = copclib.FileWriter(os.fspath(made), config)
        raw = cloud.points.array
        for key, points in nodes(position - centre + half, 2 * half):
            content = copclib.VectorChar(np.frombuffer(raw[points].tobytes(), dtype=np.int8))
            writer.AddNode(copclib.VoxelKey(*map(int, key)), content)
        writer.Close()
        partial.write_bytes(made.read_bytes())


def nodes(place: np.ndarray, edge: float) -> Iterator[tuple[tuple[int, int, int, int], np.ndarray]]:
    """Divide points (N, 3) within a cube from the origin: a node's depth, x, y and z, and its points."""
    left = stream(0, "copc").permutation(len(place))
    for depth in range(DEEPEST + 1):
        if not len(left):
            return
        across = 2**depth
        at = np.minimum((place[left] / edge * across).astype(np.int64), across - 1)
        # of each point the number of its node, and how many points each node has
        _, cube, count = np.unique(_keys(at, across), return_inverse=True, return_counts=True)
        grid = np.minimum(
            (place[left] / edge * across * CELLS).astype(np.int64), across * CELLS - 1
        )
        first = np.zeros(len(left), dtype=bool)
        first[np.unique(_keys(grid, across * CELLS), return_index=True)[1]] = True
        taken = first | (count[cube] <= FEWEST) | (depth == DEEPEST)
        order = np.argsort(cube[taken], kind="stable")
        here, where = left[taken][order], at[taken][order]
        ends = np.flatnonzero(np.diff(cube[taken][order])) + 1
        for points, corner in zip(np.split(here, ends), where[np.r_[0, ends]], strict=True):
            yield (depth, int(corner[0]), int(corner[1]), int(corner[2])), np.sort(points)
        left = left[~taken]


def _keys(at: np.ndarray, across: int) -> np.ndarray:
    """(N,) one whole number for three below ``across``, which is 2^21 at most."""
    mixed = at.astype(np.uint64)
    return np.asarray(
        (mixed[:, 0] * np.uint64(across) + mixed[:, 1]) * np.uint64(across) + mixed[:, 2]
    )
