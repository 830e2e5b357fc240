"""A tree as beams: its green wood, a few straight members that carry all the rest as mass, and their first
modes.

Short segments of one axis become a member of up to a fortieth of the tree's height; of those the thickest
stay. What is thinner rides rigidly on the member that it grows from.

Members are Euler-Bernoulli beams in space: cubic in bending, linear in stretch and torsion, their taper
integrated exactly by five Gauss points (Przemieniecki 1968, ch. 5, 11 and 15). The weight of what a member
carries takes from its stiffness, as in Greenhill's column. The foot is clamped. The modes solve K φ = ω² M φ
by shift-invert Lanczos (ARPACK), with φᵀMφ = 1.

Green wood by genus, density and modulus of elasticity. Where trees of a genus were tested as they grow in
Europe: modulus in static bending and density as they stand (ForestGALES: Locatelli et al. 2022, package fgr,
``species_parameters``; moduli of Lavers 1983, The strength properties of timber). Of beech and oak that
table's density, 1158 kg/m³, is nearly that of wood full of water, and the handbook's stands here. Other
genera: Forest Products Laboratory 2010, Wood handbook, FPL-GTR-190, modulus of green wood by Table 5-3, the
mean of the species of a genus, density by the specific gravity on green volume there times one plus the mean
moisture content of heartwood and sapwood (Table 4-1). Apple: Markwardt & Wilson 1935. Moduli are those of the
tests, of short beams of clear wood: the shear in them takes a tenth, knots and young wood of whole stems take
more (2.0 to 6.4 GPa in standing Sitka spruces, whose sawn wood has 5.9: Milne & Blackburn 1989, Tree Physiol.
5:195). Branches are of less dense young wood: at most 4.6 GPa where trunks have at most 7.5, in spruce, pine,
larch and birch alike (Cannell & Morgan 1987, Tree Physiol. 3:355). Those of conifers keep the stem's modulus
here: frequencies agree with measured ones either way (0.865 and 0.875 within the band), and with less their
outer shoots would turn farther than small rotations tell in 6 m/s.

Leaves: dry mass over the leaf area (BAAD, Falster et al. 2015: the geometric mean over studies of a genus of
their medians), which is half of the surface of needles however a study counted (``measured/allometry``),
as allometry draws it; fresh leaves have 0.4 of their mass dry. Needles weigh 0.22 kg/m² dry by their
one-sided area (Poorter et al. 2009, New Phytol. 182). Bark weighs as wood and stiffens nothing:
diameters inside of it are 0.87 to 0.93 of those over it (Husch, Beers & Kershaw 2003, Forest Mensuration,
ch. 6), of thin-barked genera more.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import scipy  # loads a part when it is first asked

from ...base.vectors import beside_segments, unit
from ...spec import Species
from ..skeleton import Skeleton, frustums

DRY = 0.4  # dry mass of leaves over the fresh one
BROAD_LEAF, NEEDLE = 0.053, 0.22  # kg/m² dry, by one-sided area
INSIDE = 0.92  # diameter without bark over that with it
THIN_BARK = {"fagus": 0.97, "picea": 0.95, "abies": 0.95}
BRANCH = 0.6  # modulus of branches over that of the stem, of broadleaves
TORSION = 0.065  # shear modulus over modulus of elasticity (Wood handbook, Table 5-1)
EVERGREEN = ("picea", "pinus", "pseudotsuga", "abies")
LONGEST = 1 / 40  # of the tree's height, of a member
MOST = 240  # members
GRAVITY = 9.81
# Of the frequency without weight, what a tree keeps at least: it is 1.4 times lower than the height at which
# it buckles. Our judgement: measured safety factors of slender forest trees lie there and above.
STEADY = 0.8
POINT, WEIGHT = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True)
class GreenWood:
    """Wood as it stands: density kg/m³, modulus of elasticity Pa, fresh leaf mass kg by m² of leaf area.

    inside : diameter inside of the bark over that outside. one_sided : m² of one side of leaves in a m² of
    leaf area. branch : modulus of branches over that of the stem.
    """

    density: float
    modulus: float
    leaf_mass: float = BROAD_LEAF / DRY
    inside: float = 1.0
    one_sided: float = 1.0
    branch: float = BRANCH


# genus: modulus GPa, density kg/m³, dry leaf mass kg/m²
CONIFERS = {
    "picea": (6.3, 850.0, 0.173),
    "pinus": (7.3, 850.0, 0.228),
    "pseudotsuga": (8.3, 850.0, 0.202),
    "abies": (5.7, 850.0, 0.133),
    "larix": (7.9, 850.0, BROAD_LEAF),
}
BROADLEAVES = {
    "fagus": (9.8, 916.0, 0.052),
    "acer": (8.7, 848.0, 0.056),
    "betula": (9.9, 900.0, 0.050),
    "fraxinus": (9.8, 810.0, BROAD_LEAF),
    "quercus": (8.3, 1003.0, 0.082),
    "populus": (6.8, 785.0, BROAD_LEAF),
    "tilia": (7.2, 662.0, BROAD_LEAF),
    "malus": (7.2, 1083.0, BROAD_LEAF),
}
ENGLISH = {
    "spruce": "picea",
    "pine": "pinus",
    "douglas": "pseudotsuga",
    "fir": "abies",
    "larch": "larix",
    "beech": "fagus",
    "maple": "acer",
    "birch": "betula",
    "hazel": "betula",
    "corylus": "betula",
    "ash": "fraxinus",
    "oak": "quercus",
    "aspen": "populus",
    "linden": "tilia",
    "apple": "malus",
}


def wood_of_species(species: Species) -> GreenWood:
    """Green wood of a species, by the genus that its allometry or name says, else the mean of its kind."""
    genus = genus_of(species)
    if genus:
        return wood_of_genus(genus)
    woods = [wood_of_genus(g) for g in (CONIFERS if species.needles is not None else BROADLEAVES)]
    names = [field.name for field in fields(GreenWood)]
    return GreenWood(*(sum(getattr(wood, name) for wood in woods) / len(woods) for name in names))


def genus_of(species: Species) -> str:
    """Genus of the table that a species' allometry or name says; "": none."""
    target = species.targets.allometry if species.targets is not None else ""
    words = f"{target} {species.name}".lower().replace("-", " ").replace("_", " ").split()
    for word in words:
        for start, genus in {
            **ENGLISH,
            **{name: name for name in (*CONIFERS, *BROADLEAVES)},
        }.items():
            if word == start or (len(start) > 3 and word.startswith(start)):
                return genus
    return ""


def wood_of_genus(genus: str) -> GreenWood:
    """Green wood of a genus of the table.

    Raises
    ------
    KeyError : it is not in the table.
    """
    modulus, density, leaf = {**CONIFERS, **BROADLEAVES}[genus]
    inside = THIN_BARK.get(genus, INSIDE)
    one_sided = min(1.0, leaf / NEEDLE) if genus in EVERGREEN else 1.0
    branch = 1.0 if genus in CONIFERS else BRANCH
    return GreenWood(density, 1e9 * modulus, leaf / DRY, inside, one_sided, branch)


@dataclass(frozen=True)
class Members:
    """B straight tapered members of a tree and how its S segments ride on them.

    start, end : (B, 3) metres. stem : (B,) bool, of the stem.
    radius : (B, 2) at start and end, metres, that give the segments' volume.
    node : (B, 2) int64, nodes of start and end; node 0 is the ground, b + 1 the end of member b.
    offset : (B, 3) metres from the start's node to the member's start.
    of_segment : (S,) int64, the member that each segment is part of, or rides on.
    kept : (S,) bool, part of a member. along : (S, 2) share of the member's length where each segment's start
    and end hold on to it.
    """

    start: np.ndarray
    end: np.ndarray
    stem: np.ndarray
    radius: np.ndarray
    node: np.ndarray
    offset: np.ndarray
    of_segment: np.ndarray
    kept: np.ndarray
    along: np.ndarray

    def __len__(self) -> int:
        return len(self.start)

    @property
    def length(self) -> np.ndarray:
        """(B,) metres."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    @property
    def nodes(self) -> np.ndarray:
        """(B + 1, 3) places of the nodes, metres."""
        return np.concatenate([self.start[:1], self.end])


def members_of(skeleton: Skeleton, most: int = MOST) -> Members:
    """Reduce a skeleton of at least one segment to members."""
    height = float(skeleton.end[:, 2].max() - skeleton.start[:, 2].min())
    member = _joined(skeleton, LONGEST * height)
    count = int(member.max()) + 1
    first, last = np.full(count, len(member)), np.zeros(count, dtype=np.int64)
    np.minimum.at(first, member, np.arange(len(member)))
    np.maximum.at(last, member, np.arange(len(member)))
    parent = skeleton.parent[first]
    above = np.where(parent >= 0, member[np.maximum(parent, 0)], -1)
    girth = skeleton.radius[first].mean(axis=1)
    for b in range(count):  # a member is no thicker than the one that it grows from
        if above[b] >= 0:
            girth[b] = min(girth[b], girth[above[b]])
    stays = np.zeros(count, dtype=bool)
    stays[np.argsort(-girth, kind="stable")[:most]] = True
    number = np.cumsum(stays) - 1
    bearer = np.arange(count)
    for b in range(count):
        if not stays[b]:
            bearer[b] = bearer[above[b]] if above[b] >= 0 else 0
    own = bearer[member]
    start, end = skeleton.start[first[stays]], skeleton.end[last[stays]]
    radius = np.stack([skeleton.radius[first, 0], skeleton.radius[last, 1]], axis=1)
    radius = np.maximum(radius, 1e-5)
    chord = np.linalg.norm(skeleton.end[last] - skeleton.start[first], axis=1)
    volume = np.bincount(member, skeleton.volume)  # of a member as of its segments
    scale = np.sqrt(np.clip(volume / frustums(np.maximum(chord, 1e-9), radius), 0.25, 4.0))
    radius = (radius * scale[:, None])[stays]
    node, offset = _nodes(start, end, np.where(above >= 0, number[above], -1)[stays])
    along = _along(skeleton, stays[member], number[own], start, end)
    stem = skeleton.order[first[stays]] == 0
    return Members(start, end, stem, radius, node, offset, number[own], stays[member], along)


def _joined(skeleton: Skeleton, longest: float) -> np.ndarray:
    """(S,) the member of each segment: on along its axis until that is long enough; parents come first."""
    length = skeleton.length.tolist()
    parent, order = skeleton.parent.tolist(), skeleton.order.tolist()
    member = [0] * len(parent)
    went_on = [False] * len(parent)
    reach: list[float] = []
    for s, bearer in enumerate(parent):
        on = bearer >= 0 and order[bearer] == order[s] and not went_on[bearer]
        if on:
            went_on[bearer] = True
        if on and reach[member[bearer]] + length[s] <= longest:
            member[s] = member[bearer]
            reach[member[s]] += length[s]
        else:
            member[s] = len(reach)
            reach.append(length[s])
    return np.array(member)


def _nodes(start: np.ndarray, end: np.ndarray, above: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(B, 2) nodes of members and (B, 3) from its node, the nearer end of the parent, to each start."""
    count = len(start)
    base = np.zeros(count, dtype=np.int64)
    node = np.stack([base, np.arange(count) + 1], axis=1)
    place = np.concatenate([start[:1], end])
    for b in range(1, count):
        if above[b] < 0:
            continue
        ends = node[above[b]]
        away = np.linalg.norm(place[ends] - start[b], axis=1)
        node[b, 0] = ends[int(np.argmin(away))]
    return node, np.where((above < 0)[:, None], 0.0, start - place[node[:, 0]])


def _along(
    skeleton: Skeleton,
    kept: np.ndarray,
    own: np.ndarray,
    start: np.ndarray,
    end: np.ndarray,
) -> np.ndarray:
    """(S, 2) where segments hold on; what rides does so where the first of it leaves the member."""
    axis, ends = (end - start)[own], (skeleton.start, skeleton.end)
    along = np.stack([beside_segments(points, start[own], axis)[0] for points in ends], axis=1)
    for s in np.flatnonzero(~kept).tolist():
        parent = skeleton.parent[s]
        rides = parent >= 0 and not kept[parent]
        along[s] = along[parent, 0] if rides else along[s, 0]
    return along


@dataclass(frozen=True)
class Modes:
    """The first M modes of a tree of N nodes.

    frequency : (M,) Hz. shape : (N, M, 6) displacement and rotation of the nodes for a unit amplitude
    (of a modal mass of 1 kg): m and rad.
    """

    frequency: np.ndarray
    shape: np.ndarray


def modes_of(
    members: Members, wood: GreenWood, load: np.ndarray, count: int, gravity: float
) -> Modes | None:
    """Find the first modes of members clamped at the ground; None of a tree that its weight buckles.

    load : (N, 6, 6) mass that nodes carry besides, as of ``point_masses``. count : how many modes.
    gravity : m/s².
    """
    stiff, mass = matrices(members, wood, load, gravity)
    free = stiff.shape[0] - 6
    count = min(count, free - 2)
    begin = np.ones(free)  # a fixed start: the same modes to the bit every time
    square, shape = scipy.sparse.linalg.eigsh(
        stiff[6:, 6:], count, M=mass[6:, 6:], sigma=0.0, which="LM", v0=begin
    )
    if gravity and square.min() <= 0:
        return None
    order = np.argsort(square)
    square, shape = np.maximum(square[order], 1e-12), shape[:, order]
    turn = np.where(shape[np.argmax(np.abs(shape), axis=0), np.arange(count)] < 0, -1.0, 1.0)
    full = np.concatenate([np.zeros((6, count)), shape * turn])
    return Modes(np.sqrt(square) / (2 * np.pi), full.reshape(-1, 6, count).transpose(0, 2, 1))


def standing_modes(members: Members, wood: GreenWood, load: np.ndarray, count: int) -> Modes:
    """Find the first modes of a tree that stands.

    A slender tree of mean wood may be near the height at which its weight buckles it, or above, and would
    sway without bound there. What stands has stiffer wood or a lighter crown: where its weight takes more
    than 1 - ``STEADY``² of the lowest stiffness, gravity is taken as so much less that this is what it takes.
    """
    still, gravity = modes_of(members, wood, load, 1, 0.0), GRAVITY
    assert still is not None  # nothing buckles without weight
    light = still.frequency[0]
    while True:
        modes = modes_of(members, wood, load, count, gravity)
        if modes is None:
            gravity *= 0.5
        elif modes.frequency[0] >= 0.999 * STEADY * light:
            return modes
        else:  # stiffness falls ever faster with weight: less is taken at this gravity than in proportion
            gravity *= (1 - STEADY**2) / (1 - (modes.frequency[0] / light) ** 2)


def matrices(
    members: Members, wood: GreenWood, load: np.ndarray, gravity: float = GRAVITY
) -> tuple[scipy.sparse.csc_matrix, scipy.sparse.csc_matrix]:
    """Assemble stiffness and mass of all nodes, the clamped one first, (6N, 6N)."""
    length = members.length
    turn = _to_global(members, length)
    stiff, mass = _elements(members, wood, length)
    stiff += _under_weight(members, wood, load, length, gravity)
    stiff = np.einsum("bki,bkl,blj->bij", turn, stiff, turn)
    mass = np.einsum("bki,bkl,blj->bij", turn, mass, turn)
    dof = (members.node[:, :, None] * 6 + np.arange(6)).reshape(len(length), 12)
    row, column = np.repeat(dof, 12, axis=1).ravel(), np.tile(dof, (1, 12)).ravel()
    nodes = np.arange(len(load))[:, None] * 6 + np.arange(6)
    rows = np.concatenate([row, np.repeat(nodes, 6, axis=1).ravel()])
    columns = np.concatenate([column, np.tile(nodes, (1, 6)).ravel()])
    size = (6 * len(load),) * 2
    topple = np.zeros_like(load)  # a mass above its node leans further the more it leans
    topple[:, 3, 3] = topple[:, 4, 4] = -gravity * load[:, 0, 4]
    stiffness = np.concatenate([stiff.ravel(), topple.ravel()])
    loads = np.concatenate([mass.ravel(), load.ravel()])
    return (
        scipy.sparse.csc_matrix(scipy.sparse.coo_matrix((stiffness, (rows, columns)), size)),
        scipy.sparse.csc_matrix(scipy.sparse.coo_matrix((loads, (rows, columns)), size)),
    )


def point_masses(node: np.ndarray, mass: np.ndarray, offset: np.ndarray, count: int) -> np.ndarray:
    """(count, 6, 6) mass of nodes that carry masses (P,) kg rigidly at offsets (P, 3) m from nodes (P,)."""
    arm = _arms(offset)
    lever = np.concatenate([np.broadcast_to(np.eye(3), arm.shape), arm], axis=2)
    own = np.einsum("p,pki,pkj->pij", mass, lever, lever).reshape(-1, 36)
    total = np.empty((count, 36))
    for k in range(36):
        total[:, k] = np.bincount(node, own[:, k], minlength=count)
    return total.reshape(-1, 6, 6)


def _elements(
    members: Members, wood: GreenWood, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(B, 12, 12) stiffness and mass of members along their own x axis."""
    stiff, mass = np.zeros((len(length), 12, 12)), np.zeros((len(length), 12, 12))
    modulus = wood.modulus * np.where(members.stem, 1.0, wood.branch)
    for point, weight in zip(POINT, WEIGHT, strict=True):
        x = (point + 1) / 2
        radius = members.radius[:, 0] * (1 - x) + members.radius[:, 1] * x
        area = np.pi * radius**2
        turning = np.pi * radius**4 / 4
        inertia = wood.inside**4 * turning
        dx = weight / 2 * length
        bend, move = np.zeros((len(length), 12, 2)), np.zeros((len(length), 12, 4))
        curve = np.array([12 * x - 6, (6 * x - 4), 6 - 12 * x, (6 * x - 2)])
        cubic = np.array(
            [1 - 3 * x**2 + 2 * x**3, x - 2 * x**2 + x**3, 3 * x**2 - 2 * x**3, x**3 - x**2]
        )
        for plane, (shift, tilt, sign) in enumerate(((1, 5, 1.0), (2, 4, -1.0))):
            for k, at in enumerate((shift, tilt, shift + 6, tilt + 6)):
                lever = sign * length if k % 2 else np.ones_like(length)
                bend[:, at, plane] = curve[k] * lever / length**2
                move[:, at, plane] = cubic[k] * lever
        move[:, 0, 2], move[:, 6, 2] = 1 - x, x
        move[:, 3, 3], move[:, 9, 3] = 1 - x, x
        stiff += np.einsum("b,bip,bjp->bij", modulus * inertia * dx, bend, bend)
        weighed = move.copy()
        weighed[:, :, 3] *= (2 * turning / area)[:, None]
        mass += np.einsum("b,bip,bjp->bij", wood.density * area * dx, weighed, move)
        pull, twist = (
            modulus * wood.inside**2 * area * dx,
            TORSION * modulus * 2 * inertia * dx,
        )
        for at, rigid in ((0, pull), (3, twist)):
            for i, j, sign in (
                (at, at, 1),
                (at + 6, at + 6, 1),
                (at, at + 6, -1),
                (at + 6, at, -1),
            ):
                stiff[:, i, j] += sign * rigid / length**2
    return stiff, mass


def _under_weight(
    members: Members, wood: GreenWood, load: np.ndarray, length: np.ndarray, gravity: float
) -> np.ndarray:
    """(B, 12, 12) what the weight above members takes from their bending stiffness (geometric stiffness)."""
    own = wood.density * frustums(length, members.radius)
    above = load[:, 0, 0].copy()
    carried = np.zeros(len(length))
    for b in range(len(length) - 1, -1, -1):  # children come after their parents
        carried[b] = above[b + 1] + own[b] / 2
        above[members.node[b, 0]] += above[b + 1] + own[b]
    push = gravity * carried * (members.end - members.start)[:, 2] / length
    one = np.ones_like(length)
    plane = np.array(
        [[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]], dtype=float
    )
    matrix = np.zeros((len(length), 12, 12))
    for shift, tilt, sign in ((1, 5, 1.0), (2, 4, -1.0)):
        at = [shift, tilt, shift + 6, tilt + 6]
        lever = np.stack([one, sign * length, one, sign * length], axis=1)
        scaled = plane * lever[:, :, None] * lever[:, None, :]
        matrix[:, np.array(at)[:, None], at] = -(push / (30 * length))[:, None, None] * scaled
    return matrix


def _to_global(members: Members, length: np.ndarray) -> np.ndarray:
    """(B, 12, 12) from nodal motion in the tree's axes to the members' ends in their own."""
    x = (members.end - members.start) / length[:, None]
    aside = np.where(np.abs(x[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    y = unit(np.cross(aside, x))
    frame = np.stack([x, y, np.cross(x, y)], axis=1)
    whole = np.zeros((len(length), 12, 12))
    for block in range(4):
        whole[:, 3 * block : 3 * block + 3, 3 * block : 3 * block + 3] = frame
    whole[:, 0:3, 3:6] = np.einsum("bij,bjk->bik", frame, _arms(members.offset))
    return whole


def _arms(offset: np.ndarray) -> np.ndarray:
    """(N, 3, 3) from a rotation of nodes to the displacement of points at offsets (N, 3) from them."""
    x, y, z = offset.T
    zero = np.zeros_like(x)
    return np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
