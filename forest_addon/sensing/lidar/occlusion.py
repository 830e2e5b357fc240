"""Occlusion of a scan: cells that pulses reached or did not, and trees that stood behind others.

A pulse is its axis. It goes in at every cell that it passes before its last return (all, if nothing came
back), hits the cells that its returns lie in, and is blocked from those behind its last return, up to the
scanner's range. A cell with many pulses blocked and none in is one of which the cloud says nothing.
"""

from __future__ import annotations

import numpy as np

from ...base.rows import distinct
from ..rays.caster import RayCaster
from ..rays.cells import Cells, counts, walk
from .cloud import Cloud, organs
from .scan import Scan

AT_ONCE = 8192  # lines: what is in work stays in the cache
MOST_SURFACES = 10_000  # on one line
GROUND = 3


def occlusion(scan: Scan, cloud: Cloud, cells: Cells, every: int) -> dict[str, np.ndarray]:
    """Pulses by cell: that went in, that hit, and that were blocked before it; (X, Y, Z) int32 each.

    every : of every how many pulses.
    """
    number = np.arange(0, scan.pulses, every)
    points = np.flatnonzero(cloud.pulse % every == 0)
    slot, last = cloud.pulse[points] // every, np.zeros(len(number))
    np.maximum.at(last, slot, cloud.true_range[points])
    last[last == 0] = scan.scanner.max_range
    count = cells.count
    tally = np.zeros(2 * count, np.int32)  # passed, then blocked
    for first in range(0, len(number), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        pulses = scan.pattern.pulses(number[rows])
        reach, stop = np.full(len(pulses), scan.scanner.max_range), last[rows]
        for step in walk(cells, np.asarray(pulses.origin), pulses.direction, reach):
            np.add.at(tally, step.cell + count * (step.enter >= stop[step.line]), 1)
    passed, blocked = tally.reshape(2, *cells.size)
    pulses = scan.pattern.pulses(cloud.pulse[points])
    place = pulses.origin + cloud.true_range[points, None] * pulses.direction
    where = cells.at(place)
    inside = where >= 0
    pairs = distinct(slot[inside] * count + where[inside])  # two returns in a cell: one pulse
    return {
        "pulses_in": passed,
        "pulses_blocked": blocked,
        "pulses_hit": counts(cells, [pairs % max(count, 1)]),
        "edge": np.array(cells.edge),
        "low": cells.low,
        "every": np.array(every),
        "pulses": np.array(len(number)),
    }


def on_the_line(scan: Scan, caster: RayCaster, cloud: Cloud, every: int) -> dict[str, np.ndarray]:
    """Every tree that a pulse's axis meets before the ground, whether or not anything hid it.

    every : of every how many pulses. Columns of one row a pulse and tree: ``pulse``, ``tree``,
    ``distance`` of its first surface in metres, ``seen``: whether a return of that pulse is of that tree.
    """
    number = np.arange(0, scan.pulses, every)
    pulses = scan.pattern.pulses(number)
    origins, ways = np.asarray(pulses.origin), pulses.direction
    limit = scan.scanner.max_range
    line = np.arange(len(number))
    hits = caster.cast(origins, ways, limit)
    met: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for _ in range(MOST_SURFACES):
        rows = np.flatnonzero(hits.found & (organs(caster.scene, hits) != GROUND))
        line, hits = line[rows], hits.select(rows)
        if not len(line):
            break
        met.append((line, caster.scene.tree[hits.instance], hits.distance))
        hits = caster.cast(
            origins[line], ways[line], limit, min_distance=hits.distance, leaving=hits
        )
    none = (np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    lines, trees, distances = (np.concatenate(parts) for parts in zip(*met, none, strict=True))
    order = np.lexsort((distances, trees, lines))
    first = (np.diff(lines[order], prepend=-1) != 0) | (np.diff(trees[order], prepend=-1) != 0)
    rows = order[first & (trees[order] >= 0)]
    lines, trees, distances = lines[rows], trees[rows], distances[rows]
    wide = int(caster.scene.tree.max(initial=0)) + 1
    points = np.flatnonzero((cloud.pulse % every == 0) & (cloud.returns.tree >= 0))
    known_pairs = (cloud.pulse[points] // every) * wide + cloud.returns.tree[points]
    return {
        "pulse": number[lines],
        "tree": trees.astype(np.int32),
        "distance": distances,
        "seen": np.isin(lines * wide + trees, known_pairs),
        "every": np.array(every),
    }
