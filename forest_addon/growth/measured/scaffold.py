"""The scaffold of a tree: its stem and its limbs by the architectural model of its species.

With apical control a leader goes to the top; limbs stand in whorls of a year, weaker ones between them, and
the lower a whorl, the more of it has been shed. Without, the stem divides: a few heavy limbs rise from low
on it to places that are spread evenly under the dome of the crown, each divides again, and weak branches
stand on the stem between them. A limb is a cubic Bézier curve from its angle at the stem to the elevation
of its tip, a little crooked. Twigs and what bears them grow from the limbs by space colonisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.vectors import azimuth_of
from ...spec import Architecture, Crown
from .colonise import Nodes, outline, stem_line

GOLDEN = np.pi * (3 - np.sqrt(5))
THICK_AT = 0.5  # metres of diameter for which the number of heavy limbs is given
FEWEST = 3  # heavy limbs of a stem that divides
WEAK_ANGLE = 68.0  # degrees
LAST_FORK = 0.72  # of the crown's length, where the last heavy limb leaves
STEEPER = 45.0  # degrees that the highest heavy limb is steeper than the lowest
KINKS = np.arange(3, 7)  # half waves of a limb's bends
FULLEST = 0.9  # of the crown's radius that heavy limbs reach
FORKED_TOP = 0.82  # of the crown's length, where a stem that divides ends
FLARE = np.array([0.1, 0.3, 0.6, 1.0, 1.6])  # diameters above the ground where a stem has nodes
APART = 0.45  # metres between nodes of a limb, at most 14 of them
MOST_NODES = 14


@dataclass(frozen=True)
class Scaffold:
    """nodes : of stem and limbs. bearing : (N,) bool, nodes that branches may grow from."""

    nodes: Nodes
    bearing: np.ndarray


@dataclass(frozen=True)
class _Limbs:
    """K limbs on the stem: height of the foot, azimuth, horizontal reach, all (K,); angles in radians."""

    foot: np.ndarray
    azimuth: np.ndarray
    share: np.ndarray  # of the crown's radius at the height of the tip
    angle: np.ndarray  # to the stem
    tip: np.ndarray  # elevation at the end


def scaffold_of(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    rng: np.random.Generator,
) -> Scaffold:
    """size : height, height of the crown's base, its width, diameter at breast height, metres."""
    height, base, width, _ = size
    heavy = _heavy_count(plan, size[3])
    side = _weak(plan, height, base, rng) if heavy else _whorled(plan, height, base, rng)
    foot, path = _paths(side, crown, height, base, width)
    parts = [(foot, path)]
    if heavy:
        forked = _forked(plan, crown, size, heavy, rng)
        parts.append(forked)
    leader = max(crown.leader, 0.02) if plan.fork >= 1 else 1.0
    top = base + (FORKED_TOP if heavy else leader * 0.97) * (height - base)
    feet = np.concatenate([foot for foot, _ in parts])
    low = np.linspace(0.0, base, max(2, int(np.ceil(base / 0.6)) + 1))
    low = np.concatenate([low, np.minimum(FLARE * size[3], base)])
    high = np.linspace(base, top, max(2, int(np.ceil((top - base) / 0.5)) + 1))
    z = np.unique(np.round(np.concatenate([low, high, np.minimum(feet, top)]), 4))
    stem = stem_line(crown, z, height, rng)
    place, parent = [stem], [np.arange(-1, len(stem) - 1)]
    count = len(stem)
    for foot, path in parts:
        if len(foot):
            on = np.searchsorted(z, np.round(np.minimum(foot, top), 4))
            made = _nodes_of(stem[on], on, path, crown.crook, count, rng)
            place.append(made[0])
            parent.append(made[1])
            count += len(made[0])
    if heavy and plan.divide > 0:
        made = _divided(plan, crown, size, made, count - len(place[-1]), rng)
        place.append(made[0])
        parent.append(made[1])
    whole, trunk = np.concatenate(place), np.zeros(sum(map(len, place)), dtype=bool)
    trunk[: len(stem)] = True
    bearing = ~trunk
    bearing[len(stem) - 1] = True
    if heavy:
        bearing[len(stem) : len(stem) + len(place[1])] = False  # weak branches stay weak
    return Scaffold(Nodes(whole, np.concatenate(parent).astype(np.int64), trunk), bearing)


def _heavy_count(plan: Architecture, dbh: float) -> int:
    """Return how many heavy limbs a stem divides into; 0 of one that has a leader, as any has when it is
    young."""
    if plan.fork >= 1 or dbh < plan.control:
        return 0
    return max(FEWEST, round(plan.limbs * (dbh / THICK_AT) ** plan.growth))


def _whorled(plan: Architecture, height: float, base: float, rng: np.random.Generator) -> _Limbs:
    """Whorls of a year from the crown's base up, the weaker branches between them."""
    span = height - base
    years = max(3, round(span / plan.shoot))
    level = base + span * np.arange(years) / years
    level[1:] += 0.15 * span / years * (rng.random(years - 1) - 0.5)
    share = (level - base) / span
    drawn = np.clip(plan.whorl.mean + plan.whorl.sd * rng.standard_normal(years), 1, None)
    left = 1 - plan.shed * (1 - share) ** 2
    count = np.maximum(1, np.round(drawn * left)).astype(int)
    of = np.repeat(np.arange(years), count)
    within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    azimuth = GOLDEN * of + 2 * np.pi * (within + 0.5 * rng.random(len(of))) / count[of]
    reach = 0.78 + 0.22 * rng.random(len(of))
    foot = level[of] + 0.02 * span / years * within
    foot[0] = base
    small = rng.poisson(plan.between * drawn)
    gap = np.repeat(np.arange(years), small)
    inner = np.minimum(level[gap] + span / years * (0.1 + 0.8 * rng.random(len(gap))), height - 0.1)
    foot = np.concatenate([foot, inner])
    azimuth = np.concatenate([azimuth, 2 * np.pi * rng.random(len(gap))])
    reach = np.concatenate([reach, 0.3 + 0.35 * rng.random(len(gap))])
    up = np.clip((foot - base) / span, 0, 1)
    angle = plan.angle_deg.mean + up * (plan.top_angle_deg - plan.angle_deg.mean)
    angle = np.deg2rad(angle + plan.angle_deg.sd * rng.standard_normal(len(foot)))
    tip = np.deg2rad(plan.tip_deg + up * (90 - plan.top_angle_deg - plan.tip_deg))
    return _Limbs(foot, azimuth, reach, np.clip(angle, 0.1, 2.2), tip)


def _weak(plan: Architecture, height: float, base: float, rng: np.random.Generator) -> _Limbs:
    """Weak branches on a stem that divides; the lowest stands at the crown's base."""
    span = height - base
    count = max(1, round(plan.weak * 0.8 * span))
    foot = base + 0.8 * span * (np.arange(count) + 0.8 * rng.random(count)) / count
    foot[0] = base
    azimuth = GOLDEN * np.arange(count) + rng.random(count)
    reach = 0.1 + 0.12 * rng.random(count)
    angle = np.deg2rad(WEAK_ANGLE + 8 * rng.standard_normal(count))
    tip = np.full(count, np.deg2rad(min(plan.tip_deg, 25.0)))
    return _Limbs(foot, azimuth, reach, np.clip(angle, 0.3, 1.9), tip)


def _paths(
    limbs: _Limbs, crown: Crown, height: float, base: float, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Feet (K,) and the curves (K, 4, 3) of limbs, from their feet: control points of Bézier's."""
    span = height - base
    rise = np.tan((np.pi / 2 - limbs.angle + limbs.tip) / 2)
    reach = np.full(len(limbs.foot), 0.3 * width / 2)
    for _ in range(6):
        at = np.clip((limbs.foot + reach * rise - base) / span, 0.0, 0.985)
        reach = (reach + limbs.share * width / 2 * outline(crown, at)) / 2
    up = np.clip(limbs.foot + reach * rise, 0.3 * limbs.foot, height - 0.03 * span) - limbs.foot
    end = np.column_stack([reach, up])
    chord = np.hypot(*end.T)[:, None] / 3
    leave = np.column_stack([np.sin(limbs.angle), np.cos(limbs.angle)])
    arrive = np.column_stack([np.cos(limbs.tip), np.sin(limbs.tip)])
    flat = np.stack([np.zeros_like(end), chord * leave, end - chord * arrive, end], axis=1)
    around = np.column_stack([np.cos(limbs.azimuth), np.sin(limbs.azimuth)])
    path = np.concatenate([flat[:, :, :1] * around[:, None], flat[:, :, 1:]], axis=2)
    return limbs.foot, path


def _forked(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Feet (K,) and curves (K, 4, 3) of the limbs that a stem divides into, the outermost first."""
    height, base, width, _ = size
    span = height - base
    onward = (np.arange(count) + 0.7 * rng.random(count)) / count  # the lowest is the outermost
    wide = FULLEST * (1 - 0.75 * onward**1.3) * (0.8 + 0.2 * rng.random(count))
    wide[0] *= 0.6 + 0.25 * rng.random()  # the first division makes two stems
    level = _dome(crown, wide) * (0.8 + 0.18 * rng.random(count))
    azimuth = GOLDEN * np.arange(count) + 0.9 * rng.random(count) + 2 * np.pi * rng.random()
    start = np.clip(plan.fork + (LAST_FORK - plan.fork) * onward**1.1, 0, level - 0.12)
    foot = base + span * np.maximum(start, 0.0)
    end = np.column_stack(
        [
            wide * width / 2 * np.cos(azimuth),
            wide * width / 2 * np.sin(azimuth),
            base + span * level - foot,
        ]
    )
    steep = STEEPER * (onward - 0.4)  # limbs from low on the stem spread, the upper ones rise
    angle = plan.angle_deg.mean - steep + plan.angle_deg.sd * rng.standard_normal(count)
    angle = np.deg2rad(np.clip(angle, 15.0, 100.0))
    azimuth = azimuth + 0.5 * rng.standard_normal(count)  # they set out to another side
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    leave = np.column_stack([around * np.sin(angle)[:, None], np.cos(angle)])
    tip = plan.tip_deg + steep + 12.0 * rng.standard_normal(count)
    tip = np.deg2rad(np.clip(tip, -30.0, 85.0))
    azimuth = azimuth_of(end) + 0.4 * rng.standard_normal(count)
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    arrive = np.column_stack([around * np.cos(tip)[:, None], np.sin(tip)])
    chord = np.linalg.norm(end, axis=1, keepdims=True)
    zero = np.zeros_like(end)
    return foot, np.stack([zero, 0.4 * chord * leave, end - 0.3 * chord * arrive, end], axis=1)


def _dome(crown: Crown, wide: np.ndarray) -> np.ndarray:
    """(K,) share of the crown's length at which its upper side is so wide, of its largest radius."""
    inner = np.clip(1 - wide, 0, 1) ** (1 / crown.top)
    return np.asarray(crown.widest + (1 - crown.widest) * inner)


def _divided(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    limbs: tuple[np.ndarray, np.ndarray, np.ndarray],
    first: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what heavy limbs, as of ``_nodes_of``, divide into: curves to places beside their tips.

    first : number of the limbs' first node.
    """
    height, base, width, _ = size
    place, _, starts = limbs
    count = len(starts)
    ends = np.append(starts[1:], len(place)) - 1
    each = np.maximum(0, rng.poisson(plan.divide, count))
    of = np.repeat(np.arange(count), each)
    if not len(of):
        return np.empty((0, 3)), np.empty(0, np.int64), np.empty(0, np.int64)
    along = 0.3 + 0.5 * rng.random(len(of))
    at = (starts[of] + along * (ends[of] - starts[of])).astype(int)
    tip = place[ends[of]]
    azimuth, wide = azimuth_of(tip), np.hypot(tip[:, 0], tip[:, 1]) / (width / 2)
    side = np.where(np.arange(len(of)) % 2 == 0, 1.0, -1.0)
    azimuth = azimuth + side * (0.4 + 0.5 * rng.random(len(of))) * 2.4 / np.sqrt(count)
    wide = np.clip(wide * (0.7 + 0.45 * rng.random(len(of))), 0.05, FULLEST)
    level = _dome(crown, wide) * (0.8 + 0.17 * rng.random(len(of)))
    end = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * (wide * width / 2)[:, None]
    end = np.column_stack([end, base + (height - base) * level]) - place[at]
    end[:, 2] = np.maximum(end[:, 2], 0.1)
    before = place[np.maximum(at - 1, starts[of])]
    leave = place[at] - before + 1e-9 * end
    leave /= np.maximum(np.linalg.norm(leave, axis=1, keepdims=True), 1e-9)
    chord = np.linalg.norm(end, axis=1, keepdims=True)
    leave = 0.6 * leave + 0.4 * end / chord
    path = np.stack([0 * end, 0.35 * chord * leave, 0.7 * end, end], axis=1)
    return _nodes_of(place[at], first + at, path, crown.crook, first + len(place), rng)


def _nodes_of(
    foot: np.ndarray,
    on: np.ndarray,
    path: np.ndarray,
    crook: float,
    first: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (M, 3) along curves (K, 4, 3) from feet (K, 3), their parents (M,), where each starts (K,).

    on : (K,) nodes that the curves start from. first : number of the first node made here.
    """
    chord = np.linalg.norm(path[:, 3], axis=1)
    many = np.clip(np.ceil(chord / APART), 2, MOST_NODES).astype(int)
    of = np.repeat(np.arange(len(foot)), many)
    within = np.arange(len(of)) - np.repeat(np.cumsum(many) - many, many)
    t = ((within + 1) / many[of])[:, None]
    p1, p2, p3 = (path[of, k] for k in (1, 2, 3))
    place = 3 * t * (1 - t) ** 2 * p1 + 3 * t**2 * (1 - t) * p2 + t**3 * p3
    sway = 0.12 * crook * chord[:, None] * rng.standard_normal((2, len(foot), 3))
    place = place + sway[0][of] * np.sin(np.pi * t) + sway[1][of] * np.sin(2 * np.pi * t) / 2
    bends = 0.3 * crook * chord[:, None] * rng.standard_normal((len(KINKS), len(foot), 3))
    for bend, waves in zip(bends, KINKS, strict=True):
        place = place + bend[of] * np.sin(waves * np.pi * t) / waves**1.5
    parent = first + np.arange(len(of)) - 1
    parent[within == 0] = on
    return foot[of] + place, parent, np.flatnonzero(within == 0)
