"""Makes the template trees in ``assets/templates``: our own shapes, from numbers and nothing else.

    python assets/make_templates.py [--out FOLDER]

A template tree has one trunk, its foot at the origin, and a few first-level branches; grown forests are
assembled from copies of those branches. Every axis starts on its parent's axis, at an angle and a turn
that follow the species' phyllotaxis, bends towards or away from the sky, and wanders a little. Leaves
sit on the axes in the same phyllotaxis and turn their upper side to the light. All draws come from
keyed streams and all coordinates are rounded to 0.01 mm, so the files are the same byte for byte
wherever they are made. Metres, z up.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ASSETS = Path(__file__).resolve().parent
if __name__ == "__main__":
    sys.path.insert(0, str(ASSETS.parent))

from forest_addon.base.rng import stream  # noqa: E402
from forest_addon.formats.stl import write_stl  # noqa: E402
from forest_addon.growth.mesh.meshing import tube  # noqa: E402

SEED = 2028
UP = np.array([0.0, 0.0, 1.0])
NORTH = np.array([0.0, 1.0, 0.0])
GOLDEN_DEG = 137.508
TIP_RADIUS = 0.0015  # metres
DECIMALS = 5  # of the coordinates: the last digits of sines differ between processors


# --------------------------------------------------------------------------------------- species


@dataclass(frozen=True, kw_only=True)
class Order:
    """The axes of one order: where they stand on their parent, how long, how bent, how thick.

    count : places on a parent of mean length; a longer one has more, in proportion.
    reach : share of the parent's length at the first and the last place.
    length : metres, at the first and the last place.
    spread : relative standard deviation of the length.
    angle_deg : from the parent's direction, at the first and the last place.
    phyllotaxis : what stands at a place, see ``turns_deg``.
    lift_deg : turn towards the sky, in the first and in the second half of the axis.
    wander_deg : standard deviation of its bend.
    radius : metres at the foot, of an axis of mean length.
    rings, sides : of its tube.
    """

    count: float = 1
    reach: tuple[float, float] = (0, 0)
    length: tuple[float, float]
    spread: float = 0
    angle_deg: tuple[float, float] = (0, 0)
    phyllotaxis: str = "spiral"
    lift_deg: tuple[float, float] = (0, 0)
    wander_deg: float
    radius: float
    rings: int
    sides: int


@dataclass(frozen=True, kw_only=True)
class Foliage:
    """A leaf, and how leaves sit on the axes of the three orders of branches.

    outline : right half of the leaf's edge from foot to tip, (along, across) in leaf lengths; with the
        foot it makes a fan of triangles, and the left half mirrors it.
    length : smallest and largest, metres.
    fold : rise of the edge over the midrib, per length across.
    sag : drop of the tip, in leaf lengths.
    bare : share of the axis before its first leaf, for each order.
    internode : metres between nodes, for each order.
    tips : leaves at the tip of an axis.
    phyllotaxis : what sits at a node, see ``turns_deg``.
    angle_deg : between the axis and a leaf.
    level : 0, leaves keep the direction in which they leave the axis; 1, they turn level.
    droop_deg : how far the midrib hangs below that.
    tilt_deg : standard deviation of heading, droop and roll.
    gap : metres between the axis and the leaf's foot, where its stalk would be.
    """

    outline: tuple[tuple[float, float], ...]
    length: tuple[float, float]
    fold: float
    sag: float
    bare: tuple[float, float, float]
    internode: tuple[float, float, float]
    tips: int
    phyllotaxis: str
    angle_deg: float
    level: float
    droop_deg: float
    tilt_deg: float
    gap: float


@dataclass(frozen=True)
class Kind:
    """A species: its trunk, three orders of branches, its foliage."""

    trunk: Order
    orders: tuple[Order, Order, Order]
    foliage: Foliage


# fmt: off
MAPLE = Kind(  # Acer platanoides: rising boughs, everything in pairs, leaves with five lobes
    Order(length=(6.0, 6.0), wander_deg=3, radius=0.080, rings=20, sides=8),
    (
        Order(count=5, reach=(0.26, 0.76), length=(2.7, 2.4), spread=0.03, angle_deg=(52, 46),
              lift_deg=(10, 16), wander_deg=9, radius=0.025, rings=12, sides=7),
        Order(count=6.2, reach=(0.12, 0.94), length=(1.15, 0.40), spread=0.12, angle_deg=(58, 40),
              phyllotaxis="opposite", lift_deg=(4, 14), wander_deg=14, radius=0.010, rings=5, sides=5),
        Order(count=1.35, reach=(0.26, 0.82), length=(0.46, 0.28), spread=0.20, angle_deg=(54, 44),
              phyllotaxis="opposite", lift_deg=(4, 10), wander_deg=16, radius=0.004, rings=3, sides=3),
    ),
    Foliage(
        outline=((0.0, 0.36), (0.22, 0.33), (0.63, 0.50), (0.54, 0.24), (0.78, 0.20), (1.0, 0.0)),
        length=(0.122, 0.1375), fold=0.14, sag=0.14,
        bare=(0.95, 0.68, 0.42), internode=(0.14, 0.14, 0.145), tips=3, phyllotaxis="opposite",
        angle_deg=62, level=0.7, droop_deg=32, tilt_deg=16, gap=0.02,
    ),
)
HAZELNUT = Kind(  # Corylus avellana: long rods, round leaves with an abrupt tip in two ranks
    Order(length=(5.4, 5.4), wander_deg=2, radius=0.055, rings=16, sides=8),
    (
        Order(count=6, reach=(0.10, 0.76), length=(2.5, 2.1), spread=0.04, angle_deg=(46, 42),
              lift_deg=(12, -6), wander_deg=5, radius=0.016, rings=12, sides=6),
        Order(count=12, reach=(0.10, 0.95), length=(0.80, 0.30), spread=0.18, angle_deg=(46, 36),
              phyllotaxis="alternate", lift_deg=(8, -4), wander_deg=14, radius=0.0065, rings=5, sides=5),
        Order(count=2.6, reach=(0.26, 0.84), length=(0.32, 0.18), spread=0.22, angle_deg=(50, 42),
              phyllotaxis="alternate", lift_deg=(4, -6), wander_deg=18, radius=0.0028, rings=3, sides=3),
    ),
    Foliage(
        outline=((-0.02, 0.24), (0.28, 0.43), (0.66, 0.40), (0.84, 0.14), (1.0, 0.0)),
        length=(0.081, 0.097), fold=0.12, sag=0.12,
        bare=(0.80, 0.34, 0.22), internode=(0.075, 0.075, 0.07), tips=1, phyllotaxis="alternate",
        angle_deg=60, level=0.7, droop_deg=26, tilt_deg=14, gap=0.008,
    ),
)
APPLE = Kind(  # Malus domestica: spreading and crooked, leaves in rosettes on short spurs
    Order(length=(3.4, 3.4), wander_deg=6, radius=0.080, rings=14, sides=8),
    (
        Order(count=6, reach=(0.30, 0.76), length=(1.8, 1.5), spread=0.05, angle_deg=(66, 54),
              lift_deg=(0, 10), wander_deg=20, radius=0.022, rings=12, sides=7),
        Order(count=10, reach=(0.12, 0.95), length=(0.72, 0.28), spread=0.25, angle_deg=(60, 44),
              lift_deg=(8, 10), wander_deg=22, radius=0.008, rings=6, sides=5),
        Order(count=5, reach=(0.10, 0.88), length=(0.10, 0.09), spread=0.45, angle_deg=(62, 50),
              lift_deg=(12, 12), wander_deg=16, radius=0.0034, rings=3, sides=3),
    ),
    Foliage(
        outline=((0.12, 0.20), (0.42, 0.31), (0.75, 0.22), (1.0, 0.0)),
        length=(0.068, 0.079), fold=0.30, sag=0.12,
        bare=(0.95, 0.74, 0.55), internode=(0.03, 0.035, 0.014), tips=1, phyllotaxis="spiral",
        angle_deg=60, level=0.5, droop_deg=14, tilt_deg=16, gap=0.008,
    ),
)
SPRUCE = Kind(  # Picea abies: flat boughs, tips up, shoots hanging; a "leaf" is a chevron of needles
    Order(length=(5.0, 5.0), wander_deg=1, radius=0.065, rings=16, sides=8),
    (
        Order(count=6, reach=(0.20, 0.76), length=(1.8, 1.5), spread=0.03, angle_deg=(96, 80),
              lift_deg=(-14, 34), wander_deg=5, radius=0.018, rings=12, sides=6),
        Order(count=22, reach=(0.12, 0.95), length=(0.72, 0.18), spread=0.08, angle_deg=(58, 48),
              phyllotaxis="ranks", lift_deg=(-6, 14), wander_deg=7, radius=0.0055, rings=5, sides=5),
        Order(count=3.5, reach=(0.26, 0.86), length=(0.22, 0.12), spread=0.15, angle_deg=(48, 42),
              phyllotaxis="ranks", lift_deg=(-28, -6), wander_deg=8, radius=0.0024, rings=3, sides=3),
    ),
    Foliage(
        outline=((1.0, 0.40), (0.46, 0.0)),
        length=(0.070, 0.082), fold=0.1, sag=0.0,
        bare=(0.75, 0.15, 0.05), internode=(0.03, 0.037, 0.037), tips=1, phyllotaxis="ranks",
        angle_deg=6, level=0.0, droop_deg=0, tilt_deg=24, gap=0.001,
    ),
)
# fmt: on
KINDS = {"maple": MAPLE, "hazelnut": HAZELNUT, "apple": APPLE, "spruce": SPRUCE}


# ------------------------------------------------------------------------------------------ wood


@dataclass(frozen=True)
class Axis:
    """A trunk, branch or twig: a polyline of equal steps.

    points : (P, 3) metres.
    radius : (P,) metres.
    order : 0 the trunk, 1 a first-level branch.
    lineage : names the axis and the stream of its draws.
    """

    points: np.ndarray
    radius: np.ndarray
    order: int
    lineage: tuple[int | str, ...]

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def at(self, share: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Point, unit direction and radius at a share of the length."""
        steps = len(self.points) - 1
        step = min(int(share * steps), steps - 1)
        part = share * steps - step
        a, b = self.points[step], self.points[step + 1]
        radius = between((self.radius[step], self.radius[step + 1]), part)
        return a + part * (b - a), unit(b - a), radius


def grow(name: str) -> tuple[Axis, list[list[Axis]]]:
    """The trunk of a species' tree; for each first-level branch, itself and all axes it bears."""
    kind = KINDS[name]
    lineage = ("template", name)
    points, radius = bend(np.zeros(3), UP, kind.trunk.length[0], kind.trunk, stream(SEED, *lineage))
    trunk = Axis(points, radius, 0, lineage)
    branches = []
    for branch in bear(trunk, kind.trunk, kind.orders[0]):
        twigs = [
            axis
            for bough in bear(branch, kind.orders[0], kind.orders[1])
            for axis in (bough, *bear(bough, kind.orders[1], kind.orders[2]))
        ]
        branches.append([branch, *twigs])
    return trunk, branches


def bear(parent: Axis, parent_order: Order, order: Order) -> Iterator[Axis]:
    """The axes of one order that stand on a parent axis."""
    draw = stream(SEED, *parent.lineage, "places")
    count = int(order.count * parent.length / np.mean(parent_order.length) + draw.random())
    shares = (np.arange(count) + 0.5 + draw.uniform(-0.25, 0.25, count)) / max(count, 1)
    for number, share in enumerate(shares):
        foot, direction, thickness = parent.at(between(order.reach, share))
        for sister, turn in enumerate(turns_deg(order.phyllotaxis, number, direction)):
            lineage = (*parent.lineage, number, sister)
            own = stream(SEED, *lineage)
            turn += own.normal(0, 12)
            angle = between(order.angle_deg, share) + own.normal(0, 4)
            length = between(order.length, share)
            length *= 1 + order.spread * np.clip(own.normal(), -2, 2)
            points, radius = bend(foot, leave(direction, turn, angle), length, order, own)
            radius = np.minimum(radius, 0.9 * thickness)
            yield Axis(points, radius, parent.order + 1, lineage)


def bend(
    foot: np.ndarray, heading: np.ndarray, length: float, order: Order, draw: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) and radii (P,) of an axis that turns to the sky, or from it, and wanders."""
    steps = order.rings - 1
    early = np.arange(steps) < steps / 2
    lift = np.deg2rad(np.where(early, *order.lift_deg)) / (steps / 2)
    wander = draw.normal(0, np.deg2rad(order.wander_deg) / steps**0.5, (steps, 3))
    wander[0] = 0
    points = [foot]
    for step in range(steps):
        heading = raise_by(lift[step], unit(heading + wander[step]))
        points.append(points[-1] + heading * length / steps)
    thick = order.radius * length / np.mean(order.length)
    tip = min(TIP_RADIUS, 0.6 * thick)
    radius = tip + (thick - tip) * (1 - np.linspace(0, 1, order.rings)) ** 0.85
    return np.array(points), radius


def skin(axis: Axis, kind: Kind) -> np.ndarray:
    """(F, 3, 3) facets of the tube around an axis."""
    sides = (kind.trunk, *kind.orders)[axis.order].sides
    vertices, triangles = tube(axis.points, axis.radius, sides)
    return vertices[triangles]


# ---------------------------------------------------------------------------------------- leaves


def foliate(axis: Axis, foliage: Foliage) -> Iterator[np.ndarray]:
    """The leaves of a branch or twig, from its tip back: (F, 3, 3) facets each."""
    draw = stream(SEED, *axis.lineage, "leaves")
    flat = blade(foliage)
    for turn in (None, 0, 180)[: foliage.tips]:
        angle = 12 if turn is None else 50
        yield hang(flat, axis, 1.0, turn or 0, angle, foliage, draw)
    internode = foliage.internode[axis.order - 1]
    leafy = axis.length * (1 - foliage.bare[axis.order - 1])
    back, node = internode * draw.uniform(0.7, 1.1), 0
    while back < leafy:
        share = 1 - back / axis.length
        for turn in turns_deg(foliage.phyllotaxis, node, axis.at(share)[1]):
            turn += draw.normal(0, 14)
            yield hang(flat, axis, share, turn, foliage.angle_deg, foliage, draw)
        back += internode * draw.uniform(0.85, 1.15)
        node += 1


def hang(
    flat: np.ndarray,
    axis: Axis,
    share: float,
    turn: float,
    angle: float,
    foliage: Foliage,
    draw: np.random.Generator,
) -> np.ndarray:
    """(F, 3, 3) a leaf on its axis, its upper side to the sky; ``flat`` is the leaf of length 1."""
    point, direction, thickness = axis.at(share)
    heading, droop, roll = np.deg2rad(draw.normal(0, foliage.tilt_deg, 3))
    ahead = leave(direction, turn, angle)
    azimuth = np.arctan2(ahead[1], ahead[0]) + heading
    rise = (1 - foliage.level) * np.arcsin(np.clip(ahead[2], -1, 1))
    rise = np.clip(rise - np.deg2rad(foliage.droop_deg) - droop, -1.5, 1.5)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    midrib = np.cos(rise) * level + np.sin(rise) * UP
    left = np.cos(roll) * np.cross(UP, level) + np.sin(roll) * np.cross(midrib, np.cross(UP, level))
    frame = np.stack([midrib, left, np.cross(midrib, left)])
    foot = point + (thickness + foliage.gap) * midrib
    return foot + draw.uniform(*foliage.length) * flat @ frame


def blade(foliage: Foliage) -> np.ndarray:
    """(F, 3, 3) the leaf of length 1: foot at the origin, tip towards +x, upper side to +z."""
    along, across = np.array(foliage.outline).T
    edge = np.stack([along, -across, foliage.fold * across - foliage.sag * along**2], axis=1)
    right = np.stack([np.zeros_like(edge[1:]), edge[:-1], edge[1:]], axis=1)
    left = right[:, ::-1] * [1, -1, 1]
    return np.concatenate([right, left])


# ------------------------------------------------------------------------------------ directions


def turns_deg(phyllotaxis: str, node: int, direction: np.ndarray) -> list[float]:
    """Turns about an axis of what stands at its node: 0 and 180 are level, 90 is up.

    "opposite" pairs cross, and "alternate" nodes follow the golden angle, on an upright axis; the more
    level it is the more they lie in one plane, to get light. "ranks" lie in that plane always, "spiral"
    nodes never.
    """
    upright = float(direction[2] ** 2)
    if phyllotaxis == "opposite":
        return [90 * upright * node, 90 * upright * node + 180]
    if phyllotaxis == "alternate":
        return [(180 - (180 - GOLDEN_DEG) * upright) * node]
    if phyllotaxis == "ranks":
        return [180.0 * node]
    return [GOLDEN_DEG * node]


def leave(direction: np.ndarray, turn_deg: float, angle_deg: float) -> np.ndarray:
    """The unit direction at an angle from another, turned about it as ``turns_deg`` says."""
    steep = abs(direction[2]) > 0.98  # there a small bend would swing "level and to the side" round
    side = unit(np.cross(direction, NORTH if steep else UP))
    turn, angle = np.deg2rad(turn_deg), np.deg2rad(angle_deg)
    away = np.cos(turn) * side + np.sin(turn) * np.cross(side, direction)
    return np.cos(angle) * direction + np.sin(angle) * away


def raise_by(angle: float, direction: np.ndarray) -> np.ndarray:
    """A unit direction turned up by an angle, but not over the zenith."""
    level = np.hypot(direction[0], direction[1])
    if level < 1e-6:
        return direction
    rise = np.clip(np.arctan2(direction[2], level) + angle, -1.55, 1.55)
    return np.array([*(direction[:2] / level * np.cos(rise)), np.sin(rise)])


def unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def between(ends: tuple[float, float], share: float) -> float:
    return ends[0] + (ends[1] - ends[0]) * share


# ----------------------------------------------------------------------------------------- files


def write_templates(out: Path) -> None:
    """Write wood.stl and leaves.stl of every species below a folder, and say how large they are."""
    for name, kind in KINDS.items():
        trunk, branches = grow(name)
        axes = [axis for branch in branches for axis in branch]
        wood = [skin(axis, kind) for axis in (trunk, *axes)]
        leaves = [leaf for axis in axes for leaf in foliate(axis, kind.foliage)]
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        for part, pieces in (("wood", wood), ("leaves", leaves)):
            write_stl(folder / f"{part}.stl", np.round(np.concatenate(pieces), DECIMALS))
        print(
            f"{name}: {len(branches)} branches, {len(leaves)} leaves, "
            f"{sum(map(len, wood))} + {sum(map(len, leaves))} triangles"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the template trees.")
    parser.add_argument("--out", type=Path, default=ASSETS / "templates", help="folder to write to")
    write_templates(parser.parse_args().out)
