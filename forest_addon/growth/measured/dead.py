"""Dead branches below the living crown: what shade has killed and wind has not yet taken (self-pruning).

They stand where whorls stood (or anywhere, where a stem has none), are fewer and shorter towards the ground,
where they have been dead the longest, and are broken: a third are stubs. Side branches are left on them. All
of it hangs on the segments of the stem, after the living wood, and bears no leaves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...base.rng import daughter_keys, keyed_normal, keyed_uniform
from ...base.runs import numbered
from ...base.vectors import cross_rows
from ...spec import Architecture
from ..draw import draw_normal
from ..mesh.blades import across
from ..skeleton import Skeleton
from .allometry import Wanted

PIECES = 4  # of a dead branch
STUBS, STUB = 0.3, (0.06, 0.25)  # share of branches that are broken off short, and how short
THICKEST, THINNEST = 0.02, 0.0012  # metres of radius
LONGEST = 3.0  # metres
SIDE = 0.35  # length of a side branch over that of what bears it


def with_dead(wood: Skeleton, plan: Architecture, wanted: Wanted, key: np.ndarray) -> Skeleton:
    """The tree with its dead branches.

    key : (1,) uint64, their lineage.
    """
    dead = plan.dead
    base = wanted.crown_base
    low = base * (1 - dead.down)
    count = round(dead.density * (base - low) * (1 - dead.decay * dead.down / 2))
    if count < 1 or not (wood.order == 0).any():
        return wood
    keys = daughter_keys(np.repeat(key, count), np.arange(count))
    rank = (np.arange(count) + keyed_uniform(keys, "height")) / count
    depth = np.linspace(0.0, dead.down, 65)  # below the crown's base, as a share of it
    share = depth * (1 - dead.decay * depth / 2)
    depth = np.interp(rank, share / share[-1], depth)
    z = base * (1 - depth)
    if plan.fork >= 1:  # whorls of years long gone
        level = base - plan.shoot * np.round((base - z) / plan.shoot)
        z = np.where(level > 0.1, level + 0.03 * keyed_normal(keys, "whorl"), z)
    z = np.clip(z, min(0.1, 0.5 * base), 0.98 * base)
    on, foot, radius = _on_stem(wood, z)
    whole = dead.length * wanted.crown_width / 2
    length = whole * (1 - dead.decay * depth) * (0.4 + 0.6 * keyed_uniform(keys, "length"))
    stub = keyed_uniform(keys, "broken") < STUBS
    short = STUB[0] + (STUB[1] - STUB[0]) * keyed_uniform(keys, "stub")
    length = np.clip(length * np.where(stub, short, 1.0), 0.03, LONGEST) + radius
    thick = np.minimum(dead.radius * radius, THICKEST) * (0.6 + 0.5 * keyed_uniform(keys, "girth"))
    thick = np.clip(thick, THINNEST, 0.7 * radius)
    azimuth = 2 * np.pi * keyed_uniform(keys, "azimuth")
    angle = np.deg2rad(draw_normal(dead.angle_deg, keys, "angle"))
    heading = np.column_stack(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
    )
    branches = _bent(foot, heading, length, thick, keys, PIECES)
    gone = _segments(branches, on, 1, wood, len(wood))
    side = _sides(branches, keys, dead.twigs)
    if side is not None:
        line, bearer = side
        gone = Skeleton.joined(
            [gone, _segments(line, len(wood) + bearer, 2, gone, len(wood) + len(gone))]
        )
    living = replace(wood, dead=np.zeros(len(wood), dtype=bool))
    return Skeleton.joined([living, gone])


def _on_stem(wood: Skeleton, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segment of the stem (N,), place (N, 3) and radius (N,) there at heights (N,)."""
    stem = np.flatnonzero(wood.order == 0)
    stem = stem[np.argsort(wood.start[stem, 2], kind="stable")]
    pick = np.clip(np.searchsorted(wood.start[stem, 2], z, side="right") - 1, 0, len(stem) - 1)
    on = stem[pick]
    rise = np.maximum(wood.end[on, 2] - wood.start[on, 2], 1e-9)
    share = np.clip((z - wood.start[on, 2]) / rise, 0, 1)
    place = wood.start[on] + share[:, None] * (wood.end[on] - wood.start[on])
    radius = wood.radius[on, 0] + share * (wood.radius[on, 1] - wood.radius[on, 0])
    return on, place, radius


def _bent(
    foot: np.ndarray,
    heading: np.ndarray,
    length: np.ndarray,
    thick: np.ndarray,
    keys: np.ndarray,
    pieces: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (N, pieces + 1, 3) and radii (N, pieces + 1) of branches, crooked, thinner to a broken tip."""
    nodes, way = [foot], heading
    for piece in range(pieces):
        turn = [keyed_normal(keys, f"bend {axis} {piece}") for axis in range(3)]
        way = way + 0.14 * np.column_stack(turn)
        way = way / np.linalg.norm(way, axis=1, keepdims=True)
        nodes.append(nodes[-1] + (length / pieces)[:, None] * way)
    place = np.stack(nodes, axis=1)
    place[:, :, 2] = np.maximum(place[:, :, 2], 0.03)
    narrow = 1 - 0.65 * np.linspace(0, 1, pieces + 1)
    return place, np.maximum(thick[:, None] * narrow, 0.6 * THINNEST)


def _segments(
    line: tuple[np.ndarray, np.ndarray], on: np.ndarray, order: int, bearer: Skeleton, first: int
) -> Skeleton:
    """Branches as segments, each branch in a row; numbers from ``first`` on.

    on : (N,) segments that bear them. parent : the skeleton that those are of.
    """
    place, radius = line
    count, pieces = len(place), place.shape[1] - 1
    number = first + np.arange(count * pieces).reshape(count, pieces)
    parent = np.concatenate([on[:, None], number[:, :-1]], axis=1)
    own = on - (first - len(bearer))  # numbers within the parent
    depth = bearer.generation[own][:, None] + 1 + np.arange(pieces)
    return Skeleton(
        start=place[:, :-1].reshape(-1, 3),
        end=place[:, 1:].reshape(-1, 3),
        radius=np.stack([radius[:, :-1], radius[:, 1:]], axis=2).reshape(-1, 2),
        parent=parent.ravel(),
        order=np.full(count * pieces, order, dtype=np.int64),
        generation=depth.ravel(),
        dead=np.ones(count * pieces, dtype=bool),
    )


def _sides(
    branches: tuple[np.ndarray, np.ndarray], keys: np.ndarray, each: float
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray] | None:
    """Side branches, and the segment that bears each, counted from the first of the branches."""
    place, radius = branches
    pieces = place.shape[1] - 1
    way = np.diff(place, axis=1)
    length = np.linalg.norm(way, axis=2).sum(axis=1)
    many = np.floor(each * length + keyed_uniform(keys, "sides")).astype(int)
    of, number = numbered(many)
    if not len(of):
        return None
    own = daughter_keys(keys[of], number)
    at = (0.25 + 0.7 * keyed_uniform(own, "place")) * pieces
    piece = np.minimum(at.astype(int), pieces - 1)
    part = (at - piece)[:, None]
    foot = place[of, piece] * (1 - part) + place[of, piece + 1] * part
    along = way[of, piece] / np.linalg.norm(way[of, piece], axis=1, keepdims=True)
    aside = cross_rows(along, across(along))
    turn = 2 * np.pi * keyed_uniform(own, "turn")[:, None]
    out = np.cos(turn) * across(along) + np.sin(turn) * aside
    heading = along + (0.7 + 0.6 * keyed_uniform(own, "lean"))[:, None] * out
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    long = SIDE * length[of] * (0.3 + 0.9 * keyed_uniform(own, "length"))
    thick = np.maximum(0.5 * radius[of, piece], THINNEST)
    line = _bent(foot, heading, long, thick, own, 2)
    return line, of * pieces + piece
