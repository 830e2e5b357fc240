"""Wind over a stand as a closed function of place and time: a sum of plane waves that travel with the gusts.

Mean: logarithmic above the trees, U_h exp(-(ζ_h - ζ(z))/(2 β²)) among them, ζ(z) the drag area below z over
the ground's (Massman 1997, Boundary-Layer Meteorol. 83:407), β = u*/U_h = 0.320 - 0.264 exp(-15.1 ζ_h)
(same source): the trees of a stand then take the momentum ρ u*² (1 - exp(-ζ_h/β²)) that the wind loses,
however their leaves are spread. Spectrum of each component: Kaimal's (IEC 61400-1 form), with its peak
where it is found at the tops of trees: 0.15 U_h/h along the wind, 0.45 U_h/h upright (Raupach, Finnigan &
Brunet 1996). Waves travel at 1.8 U_h. Their wave numbers across are drawn from Cauchy laws, whose
characteristic function is Davenport's coherence exp(-c f Δ/U): the expected coherence is exact. Lines lie
close enough that the spectrum of an hour has no gaps where trees answer.

Leaves flutter about their stalks, relative to the branch that bears them. Leaves begin to flutter by
torsional galloping at a wind of a metre or two a second, and then hardly more as it grows (Tadrist et al.
2015, J. Fluids Struct. 56; 2018, J. R. Soc. Interface 15), while branches move ever more. A leaf turns
about its midrib and nods across it; two close tones of its own make it come and go.

Response of one tree to the wind: amplitudes of its modes as a closed function of time.

Drag on a member is quadratic in slow and linear in fast wind, as leaves fold and crowns bend
(reconfiguration, Vogel exponent -1: de Langre 2008; Rudnicki et al. 2004): F = c U² / √(1 + (U/U_r)²), c =
ρ c_d A. What has bent by an angle θ faces the wind with cos θ of its area, and only the wind across it
pushes: F cos²θ, θ the arctangent of the small rotation θ_0, so F/(1 + θ_0²) (as plates and rods in Gosselin,
de Langre & Machado-Almeida 2010, J. Fluid Mech. 650). It is made linear about the local mean: its slope times
the turbulence drives the modes, its slope times the tree's own velocity is the aerodynamic damping, and what
it loses as the tree bends on is a stiffness. A mode is then an oscillator whose answer to each wave of the
wind is known.

Sway of a whole stand: the motion that sensors and the view ask for, tree by tree.

A variant is reduced to its modes once, a tree's answer to the wind is found when it is first asked for. All
of it follows from the scene's settings and seed, so every process finds the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..base.rng import child_keys, first_key, keyed_normal, keyed_uniform, stream
from ..base.rows import RowTable
from ..base.trimesh import TriMesh
from ..growth.mesh.leaves import corner_leaves
from ..growth.sway.beams import GreenWood, wood_of_species
from ..growth.sway.shape import (
    SwayRig,
    SwayShape,
    rig_of,
    shape_of,
)
from ..growth.tree import Tree
from ..spec import Wind
from .forest import GrownForest

LOWEST, HIGHEST = 0.005, 8.0  # Hz
EVEN = (0.1, 2.0)  # Hz, between which lines lie at equal steps
STEPS = (100, 633, 47)  # lines below, within and above: 3 % apart, 0.003 Hz, 3 %
DECAY = 10.0  # c of Davenport's coherence, across and upright
TRAVEL = 1.8  # speed of gusts over that of the wind at the tops
DRAG = 0.2  # of leaves in canopies, by one-sided area (Katul et al. 2004)
SIDE, UP = 0.8, 0.55  # standard deviations across and upright over that along the wind
PEAKS = (0.15, 0.25, 0.45)  # f h / U_h where f S(f) peaks: along, across, upright
DISPLACED, ROUGH = 0.7, 0.1  # zero plane and roughness length over the height of trees


@dataclass(frozen=True)
class WindField:
    """Wind over trees of a height, its waves drawn.

    speed : mean at the tops, m/s. height : of the tops, m. shelter : (Q + 1,) drag area above the edges of Q
    equal layers from the ground to the tops, over the ground's. along : (2,) unit, where it blows to.
    frequency : (K,) Hz. amplitude : (K, 3) m/s of the waves along, across and upright, at the tops.
    phase : (K, 3) radians. across, upright : (K, 3) wave numbers, rad/m.
    """

    speed: float
    height: float
    shelter: np.ndarray
    along: np.ndarray
    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    across: np.ndarray
    upright: np.ndarray

    @classmethod
    def drawn(cls, wind: Wind, height: float, drag_area: np.ndarray, seed: int) -> WindField:
        """Draw the waves of a scene's wind.

        height : of the trees' tops, m. drag_area : (Q,) drag coefficient times area of what stands in each of
        Q equal layers from the ground to the tops, over the ground's area (a drag of ρ times that times U²).
        """
        rng = stream(seed, "wind")
        below, within, above = STEPS
        parts = np.geomspace(LOWEST, EVEN[0], below + 1), np.linspace(*EVEN, within + 1)[1:]
        edge = np.concatenate([*parts, np.geomspace(EVEN[1], HIGHEST, above + 1)[1:]])
        frequency = edge[:-1] + np.diff(edge) * rng.random(len(edge) - 1)
        sigma = wind.turbulence * wind.speed * np.array([1.0, SIDE, UP])
        spread = DECAY * frequency[:, None] / wind.speed
        waves = rng.random((4, len(frequency), 3))
        turn = np.radians(wind.direction_deg)
        power = kaimal(frequency, np.array(PEAKS) * wind.speed / height) * np.diff(edge)[:, None]
        return cls(
            speed=wind.speed,
            height=height,
            shelter=np.append(np.cumsum(drag_area[::-1])[::-1], 0.0),
            along=np.array([np.cos(turn), np.sin(turn)]),
            frequency=frequency,
            amplitude=sigma * np.sqrt(2 * power),
            phase=2 * np.pi * waves[0],
            across=spread * np.tan(np.pi * (waves[1] - 0.5)),
            upright=spread * np.tan(np.pi * (waves[2] - 0.5)),
        )

    @property
    def friction(self) -> float:
        """Friction velocity over the speed at the tops, β."""
        return 0.320 - 0.264 * float(np.exp(-15.1 * self.shelter[0]))

    def mean(self, z: np.ndarray) -> np.ndarray:
        """(N,) mean speed at heights (N,) above the ground, m/s."""
        share = np.maximum(z, 0.0) / self.height
        over = np.log(np.maximum((share - DISPLACED) / ROUGH, np.e)) / np.log(
            (1 - DISPLACED) / ROUGH
        )
        return self.speed * np.where(share > 1, np.maximum(over, 1.0), np.exp(-self._faded(z)))

    def strength(self, z: np.ndarray) -> np.ndarray:
        """(N,) turbulence at heights over that at the tops; it fades half as fast as the mean."""
        return np.exp(-0.5 * self._faded(z))

    def _faded(self, z: np.ndarray) -> np.ndarray:
        edges = np.linspace(0.0, self.height, len(self.shelter))
        return np.asarray(np.interp(z, edges, self.shelter) / (2 * self.friction**2))

    def waves(self, points: np.ndarray) -> np.ndarray:
        """(N, K, 3) complex amplitudes at points (N, 3) in the world: components along, across and upright.

        The wind at a time t is the real part of their sum with exp(2πi f t).
        """
        waves = np.empty((len(points), len(self.frequency), 3), dtype=np.complex128)
        for part in range(3):
            cos, sin = self._turned(points, part)
            waves[:, :, part].real, waves[:, :, part].imag = cos, sin
        waves *= self.amplitude
        waves *= self.strength(points[:, 2])[:, None, None]
        return waves

    def push(self, points: np.ndarray, lever: np.ndarray) -> np.ndarray:
        """(K, M) complex amplitudes of the sum over points (N, 3) and components of ``waves`` times levers
        (N, M, 3)."""
        lever = lever * self.strength(points[:, 2])[:, None, None]
        total = np.zeros((len(self.frequency), lever.shape[1]), dtype=np.complex128)
        for part in range(3):
            own = np.ascontiguousarray(lever[:, :, part])
            cos, sin = self._turned(points, part)
            total += ((cos.T @ own) + 1j * (sin.T @ own)) * self.amplitude[:, part, None]
        return total

    def _turned(self, points: np.ndarray, part: int) -> tuple[np.ndarray, np.ndarray]:
        """(N, K) cosine and sine of the angle of the waves of a component at points (N, 3).

        Whole turns are taken off in float64; what is left goes through float32: 1e-7 of an amplitude.
        """
        x = points[:, :2] @ self.along
        y = points[:, :2] @ np.array([-self.along[1], self.along[0]])
        number = np.stack([self.across[:, part], self.upright[:, part]]) / (2 * np.pi)
        number = np.stack([self.frequency / (TRAVEL * self.speed), *number])
        # Not by BLAS, whose threads wait for each other longer than these sums take.
        turns = np.einsum("ni,ik->nk", np.column_stack([x, y, points[:, 2]]), number)
        turns = self.phase[:, part] / (2 * np.pi) - turns
        turns -= np.rint(turns)
        angle = (2 * np.pi * turns).astype(np.float32)
        return np.cos(angle).astype(np.float64), np.sin(angle).astype(np.float64)

    def at(self, points: np.ndarray, time: np.ndarray) -> np.ndarray:
        """(N, 3) wind at points (N, 3) and times (N,), m/s in the world's axes."""
        turn = np.exp(2j * np.pi * time[:, None] * self.frequency)
        own = np.einsum("nkc,nk->nc", self.waves(points), turn).real
        own[:, 0] += self.mean(points[:, 2])
        x, y = self.along
        return np.stack(
            [own[:, 0] * x - own[:, 1] * y, own[:, 0] * y + own[:, 1] * x, own[:, 2]], axis=1
        )


def kaimal(frequency: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """(K, C) Kaimal's spectral density of unit variance, 1/Hz, whose f S(f) peaks at frequencies (C,)."""
    scale = 0.25 / peak  # f S = 4 n / (1 + 6 n)^(5/3) peaks at n = 1/4
    n = frequency[:, None] * scale
    return np.asarray(4 * scale / (1 + 6 * n) ** (5 / 3))


ONSET = 1.5  # m/s
TWIST, NOD = 0.30, 0.15  # radians, standard deviations once it flutters
TONE, SPREAD = 5.0, 0.3  # Hz, and the standard deviation of its logarithm
APART = 0.15  # between the two tones, over the first


def flutter(key: np.ndarray, wind: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) twist and nod of leaves with keys (N,) in local mean winds (N,) m/s at times (N,), radians, and
    their rates: two tones each.
    """
    share = wind**2 / (ONSET**2 + wind**2)
    tone = TONE * np.exp(SPREAD * keyed_normal(key, "flutter"))
    rates = [tone, tone * (1 + APART), 0.6 * tone, 0.6 * tone * (1 + APART)]
    phases = [keyed_uniform(child_keys(key, "flutter"), name) for name in "abcd"]
    size = np.stack([TWIST * share, NOD * share], axis=1)
    rate = 2 * np.pi * np.stack(rates, axis=1)
    turn = rate * time[:, None] + 2 * np.pi * np.stack(phases, axis=1)
    speed = (rate * np.cos(turn)).reshape(-1, 2, 2).sum(axis=2)
    return size * np.sin(turn).reshape(-1, 2, 2).sum(axis=2), size * speed


AIR = 1.2  # kg/m³
WOOD_DRAG = 1.0  # of a cylinder, by the area that faces the wind
FOLDING = 10.0  # m/s, speed at which leaves and crowns fold
INTERNAL = 0.02  # damping of wood and roots over the critical one; below 0.05 in the measured trees
MOST_DAMPING = 0.95
KNOTS = 32  # a second, between which amplitudes are cubic
CALM = 0.01  # rad², mean square of rotations by gusts that change drag by less than a per cent
MOST_STEPS = 60
MOST_TURN = 1.5  # radians, beyond which small rotations no longer tell: no wood turns farther
DEVIATIONS = 2.0  # of gusts, that are counted to a turn


@dataclass(frozen=True)
class SwayResponse:
    """Sway of one tree: the real part of the sum over waves, about a mean.

    mean : (M,) amplitudes of modes as the mean wind bends the tree. waves : (M, K) complex amplitudes.
    rate : (K,) rad/s. frequency : (M,) Hz, damping : (M,) over the critical one, aerodynamic included.
    Amplitudes times the variant's modes are metres in the variant's axes, of the tree as large as it stands.
    held : the tree would bend farther than small rotations tell, and is held to ``MOST_TURN``.
    """

    mean: np.ndarray
    waves: np.ndarray
    rate: np.ndarray
    frequency: np.ndarray
    damping: np.ndarray
    held: bool = False

    def exact(
        self, time: np.ndarray, turn: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (N, M) at times (N,), and their rates, by the whole sum. turn : (N, K) of the waves."""
        turn = np.exp(1j * time[:, None] * self.rate) if turn is None else turn
        return self.turned(turn), _real_sum(turn, 1j * self.rate * self.waves)

    def turned(self, turn: np.ndarray) -> np.ndarray:
        """Amplitudes (N, M) when waves have turned (N, K)."""
        return self.mean + _real_sum(turn, self.waves)


def _real_sum(turn: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """(N, M) real part of the sum over waves (M, K) that have turned (N, K)."""
    against = np.ascontiguousarray(waves.conj())
    return np.ascontiguousarray(turn).view(np.float64) @ against.view(np.float64).T


def response_of(
    shape: SwayShape,
    field: WindField,
    position: np.ndarray,
    rotation: float,
    scale: float = 1.0,
    ground: float = 0.0,
) -> SwayResponse:
    """Answer of a tree that stands at a place, turned and scaled, to the wind.

    position : (3,) of its foot in the world. ground : height from which its heights count.
    A tree scaled by s sways s times slower: stiffness goes with s, mass with s³.
    """
    cos, sin = np.cos(rotation), np.sin(rotation)
    own, modes = shape.at_members()
    world = scale * own @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + position
    world[:, 2] -= ground
    wind = field.mean(world[:, 2])
    force, slope = drag(shape, wind, scale)
    x, y = field.along
    axes = np.array([[x * cos + y * sin, y * cos - x * sin, 0.0], [0, 0, 0], [0, 0, 1.0]])
    axes[1] = [-axes[0, 1], axes[0, 0], 0.0]
    push = np.einsum("bmi,ci->bmc", modes, axes) / scale**1.5
    omega = 2 * np.pi * shape.modes.frequency / scale
    tilt = shape.tilts / scale**2.5  # of a unit of push
    lever = np.stack([slope, *[force / np.maximum(wind, 1e-9)] * 2], 1)  # what a gust adds, N s/m
    waves, shaken = np.zeros((0, 0)), np.zeros(len(force))
    for _ in range(2):
        kept, mean, falls = _bent(push, tilt, omega, force, shaken)
        damper = np.einsum("bmc,bnc,bc->mn", push, push, lever * kept[:, None])
        # Beyond the critical damping a mode creeps; the share that the others take from it stays.
        most = 2 * omega * (MOST_DAMPING - INTERNAL)
        damper *= np.minimum(1.0, most / np.maximum(np.diagonal(damper), 1e-12)).min()
        damper = damper + np.diag(2 * INTERNAL * omega)
        rate = 2 * np.pi * field.frequency[:, None, None]
        answer = 1j * rate * damper + push[:, :, 0].T @ falls
        answer += np.eye(len(omega)) * (omega**2 - rate[:, :, 0] ** 2)[:, :, None]
        drive = field.push(world, push * (lever * kept[:, None])[:, None])
        waves = np.linalg.solve(answer, drive[:, :, None])[:, :, 0].T
        covariance = 0.5 * np.einsum("mk,nk->mn", waves, waves.conj()).real
        shaken = np.einsum("bmi,mn,bni->b", tilt, covariance, tilt)
        if shaken.max(initial=0.0) < CALM:
            break
    mean, waves = mean / scale**1.5, waves / scale**1.5
    share = _share_kept(shape, mean, waves, scale)
    return SwayResponse(
        mean=share * mean,
        waves=share[:, None] * waves,
        rate=2 * np.pi * field.frequency,
        frequency=omega / (2 * np.pi),
        damping=np.diagonal(damper) / (2 * omega),
        held=bool((share < 1).any()),
    )


def _share_kept(shape: SwayShape, mean: np.ndarray, waves: np.ndarray, scale: float) -> np.ndarray:
    """(M,) shares of modes' amplitudes with which no wood turns by more than ``MOST_TURN``, at the mean and
    ``DEVIATIONS`` of the gusts. Where some would, modes are held by their part in that turn: a thin tip turns
    by modes of its own, and the rest of its tree sways on."""
    turns = np.concatenate(shape.ends)[:, :, 3:] / scale
    gusts = 0.5 * (waves @ waves.conj().T).real
    alone = np.abs(mean) + DEVIATIONS * np.sqrt(np.diagonal(gusts))
    share = np.ones(len(mean))
    for _ in range(MOST_STEPS):
        own = turns * share[:, None]
        lean = np.linalg.norm(np.einsum("bmi,m->bi", own, mean), axis=1)
        shaken = np.einsum("bmi,bmi->b", own, np.einsum("mn,bni->bmi", gusts, own))
        turn = lean + DEVIATIONS * np.sqrt(np.maximum(shaken, 0.0))
        worst = int(np.argmax(turn))
        if turn[worst] <= MOST_TURN:
            return share
        part = np.linalg.norm(own[worst], axis=1) * alone
        share *= 1 - (1 - MOST_TURN / turn[worst]) * part / part.max()
    return np.asarray(share * (MOST_TURN / turn[worst]))


def _bent(
    push: np.ndarray, tilt: np.ndarray, omega: np.ndarray, force: np.ndarray, shaken: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(B,) shares of drag that members keep as they bend, (M,) how far the mean wind bends the tree, and
    (B, M) N that drag falls by a unit of each mode.

    push : (B, M, 3) of modes along, across and upright. tilt : (B, M, 2) radians by a unit of each mode.
    omega : (M,) rad/s. force : (B,) N of the mean wind at rest. shaken : (B,) mean square of the rotation by
    gusts.
    """
    share, mean, lean = 1 / (1 + shaken), np.zeros(len(omega)), np.zeros((len(shaken), 2))
    for _ in range(MOST_STEPS):
        mean = push[:, :, 0].T @ (force * share) / omega**2
        lean = np.einsum("bmi,m->bi", tilt, mean)
        new = 1 / (1 + shaken + (lean**2).sum(axis=1))
        apart = np.abs(new - share).max(initial=0.0)
        share = (share + new) / 2
        if apart < 1e-4:
            break
    falls = 2 * force * share**2
    return share, mean, falls[:, None] * np.einsum("bi,bmi->bm", lean, tilt)


def drag(shape: SwayShape, wind: np.ndarray, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(B,) drag of members in N in winds (B,) m/s, and (B,) its slope in N s/m."""
    # Of leaves by their one-sided area, half of which is ``leafy``.
    leaf = AIR * 2 * DRAG * shape.leafy * scale**2
    wood = 0.5 * AIR * WOOD_DRAG * shape.woody * scale**2
    fold = np.sqrt(1 + (wind / FOLDING) ** 2)
    force = wood * wind**2 + leaf * wind**2 / fold
    slope = 2 * wood * wind + leaf * wind * (2 + (wind / FOLDING) ** 2) / fold**3
    return force, slope


LAYERS = 40  # from the ground to the tops
SLICES = 100  # of a variant's height


def drag_area_of(
    forest: GrownForest, height: float, wood_of: Callable[[tuple[int, int]], GreenWood]
) -> np.ndarray:
    """(LAYERS,) drag coefficient times area in equal layers up to a height in m, over the ground's area.

    wood_of : the wood of a variant, by planting and number. What stands above the height counts in the top
    layer.
    """
    stand, areas = forest.stand, np.zeros(LAYERS)
    for key, tree in forest.variants.items():
        same = (stand.species == key[0]) & (stand.variant == key[1])
        place, area = drag_slices(tree, wood_of(key).one_sided)
        layer = np.outer(stand.scale[same], place) / height * LAYERS
        rows = np.clip(layer.astype(np.int64), 0, LAYERS - 1)
        own = np.outer(stand.scale[same] ** 2, area)
        areas += np.bincount(rows.ravel(), own.ravel(), minlength=LAYERS)
    return areas / stand.area


def drag_slices(tree: Tree, one_sided: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights (SLICES,) in m of a variant and its drag coefficient times area (SLICES,) there, m².

    one_sided : m² of one side of its leaves in a m² of leaf area.
    """
    skeleton, leaves = tree.skeleton, tree.leaves
    length = np.linalg.norm(skeleton.end - skeleton.start, axis=1)
    wood = 0.5 * WOOD_DRAG * length * skeleton.radius.sum(axis=1)
    leaf = DRAG * one_sided * np.pi * leaves.radius**2
    z = np.concatenate([(skeleton.start + skeleton.end)[:, 2] / 2, leaves.centre[:, 2]])
    top = max(float(z.max(initial=0.0)), 1e-6)
    row = np.clip((z / top * SLICES).astype(np.int64), 0, SLICES - 1)
    area = np.bincount(row, np.concatenate([wood, leaf]), minlength=SLICES)
    return (np.arange(SLICES) + 0.5) / SLICES * top, area


LOWEST_TOP = 1.0  # metres of height for which wind is told
LEAN = 0.2  # of a tree's height: a top that is farther off no longer moves by small motions
AT_ONCE = 4096  # points whose motion is asked for


@dataclass(frozen=True)
class Anchors(RowTable):
    """Holds of N points of a variant: (N,) the piece that each rides on, (N,) its leaf, -1 where it is wood,
    and the points (N, 3) at rest, in the variant's own frame and size."""

    piece: np.ndarray
    leaf: np.ndarray
    point: np.ndarray


Moving = TypeVar("Moving")


def _sure(value: Moving | None) -> Moving:
    """Return a value that only trees that move have, of one that does."""
    assert value is not None
    return value


class ForestSway:
    """Motion of the trees of a grown forest in the wind.

    field : the wind. like : of a forest of the same variants, whose modes are shared. Trees without a
    skeleton, and dead wood that lies or stands as a stump, do not move.
    """

    def __init__(
        self, forest: GrownForest, wind: Wind, seed: int, like: ForestSway | None = None
    ) -> None:
        self._forest = forest
        self._first = first_key(seed, "flutter")
        heights = forest.heights()
        top = float(np.quantile(heights, 0.9)) if len(heights) else LOWEST_TOP
        top = max(top, LOWEST_TOP)
        shelter = drag_area_of(forest, top, lambda key: wood_of_species(forest.species[key[0]]))
        self.field = WindField.drawn(wind, top, shelter, seed)
        self._shapes: dict[tuple[int, int], SwayShape | None] = {}
        self._responses: dict[int, SwayResponse | None] = {}
        self._rigs: dict[tuple[int, int], SwayRig | None] = {}
        if like is not None and like._forest.variants is forest.variants:
            self._shapes, self._rigs = like._shapes, like._rigs
        self._moments, self._turned = np.empty(0), np.empty((0, 0))

    @property
    def number(self) -> dict[int, int]:
        """The place in the stand of each tree, by the number that sensors report."""
        return {int(tree): row for row, tree in enumerate(self._forest.stand.id)}

    def shape(self, tree: int) -> SwayShape | None:
        """The modes of a tree's variant, None of what does not move."""
        key = self.variant(tree)
        if key not in self._shapes:
            grown, species = self._forest.variants[key], self._forest.species[key[0]]
            wood = grown.skeleton
            moves = len(wood) > 1 and not species.dead and wood.radius.max() > 0
            beams = wood_of_species(species)
            self._shapes[key] = shape_of(wood, grown.leaves, beams) if moves else None
        return self._shapes[key]

    def response(self, tree: int) -> SwayResponse | None:
        """The answer of a tree to the wind, None of what does not move."""
        if tree not in self._responses:
            shape, stand = self.shape(tree), self._forest.stand
            place = stand.position[tree] - [0.0, 0.0, stand.sink[tree]]
            turn, scale = float(stand.rotation[tree]), float(stand.scale[tree])
            ground = float(stand.position[tree, 2])
            self._responses[tree] = (
                None
                if shape is None
                else response_of(shape, self.field, place, turn, scale, ground)
            )
        return self._responses[tree]

    def moves(self, tree: int) -> bool:
        """Return whether a tree sways: it has a skeleton and does not lie dead."""
        return self.shape(tree) is not None

    def rig(self, tree: int) -> SwayRig | None:
        """The pieces of a tree's variant that move as one, None of what does not move."""
        key = self.variant(tree)
        if key not in self._rigs:
            shape = self.shape(tree)
            self._rigs[key] = None if shape is None else rig_of(shape)
        return self._rigs[key]

    def pieces(self, tree: int, mesh: TriMesh) -> np.ndarray:
        """(T,) the piece that each triangle of the mesh of a tree's variant is of; the tree must move."""
        return self.pieces_at(tree, mesh.vertices[mesh.triangles].mean(axis=1), mesh.leaf)

    def places(self, tree: int, knot: np.ndarray) -> np.ndarray:
        """(K, G, 3, 4) where the pieces of a tree are at knots (K,), whole numbers of 1/32 s.

        They are maps from rest in the variant's own frame and size. Between knots pieces go straight.
        """
        return _sure(self.rig(tree)).places(self.amplitudes(tree, knot))

    def amplitudes(self, tree: int, knot: np.ndarray) -> np.ndarray:
        """(K, M) amplitudes of a tree's modes at knots (K,), over the tree's size."""
        response, scale = _sure(self.response(tree)), float(self._forest.stand.scale[tree])
        return response.turned(self._turn(response, np.asarray(knot) / KNOTS)) / scale

    def _swayed(self, tree: int, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, M) amplitudes of a tree's modes at times (N,), over the tree's size, and their rates."""
        response, scale = _sure(self.response(tree)), float(self._forest.stand.scale[tree])
        amplitude, rate = response.exact(time, self._turn(response, time))
        return amplitude / scale, rate / scale

    def _turn(self, response: SwayResponse, time: np.ndarray) -> np.ndarray:
        """(N, K) turns of waves at times (N,); kept, since they are those of all trees of a moment."""
        if not np.array_equal(time, self._moments):
            self._moments = time.copy()
            self._turned = np.exp(1j * time[:, None] * response.rate)
        return self._turned

    def rest(self, tree: int) -> TriMesh:
        """The mesh of a tree's variant at rest, in its own frame."""
        return self._forest.variant_of(tree).mesh

    def variant(self, tree: int) -> tuple[int, int]:
        """The planting and the variant that a tree is of."""
        stand = self._forest.stand
        return int(stand.species[tree]), int(stand.variant[tree])

    def moment(self, tree: int, time: float) -> tuple[np.ndarray, np.ndarray]:
        """(G, 3, 4) where the pieces of a tree are at a time, s, and (G, 3, 4) how fast that changes, 1/s;
        as ``places``, without knots."""
        rig, (amplitude, rate) = _sure(self.rig(tree)), self._swayed(tree, np.array([time]))
        return rig.places(amplitude)[0], rig.shifts(rate)[0]

    def pieces_at(self, tree: int, points: np.ndarray, leaf: np.ndarray) -> np.ndarray:
        """(N,) the piece that points (N, 3) of a tree's variant are on; leaf : (N,) its leaf, -1 wood."""
        shape, rig = _sure(self.shape(tree)), _sure(self.rig(tree))
        return np.asarray(rig.of_member[shape.members_at(points, leaf)])

    def anchors(self, tree: int) -> Anchors:
        """Anchors of the mesh vertices of a tree's variant, in their order, for ``displacement``."""
        mesh = self.rest(tree)
        leaf = corner_leaves(mesh)
        held = (
            self.pieces_at(tree, mesh.vertices, leaf) if self.moves(tree) else np.zeros_like(leaf)
        )
        return Anchors(held, leaf, mesh.vertices)

    def displacement(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(N, 3) metres that points of trees (N,) are off their rest at times (N,), in the world's axes."""
        return self._moved(tree, at, time)[0]

    def velocity(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(N, 3) metres a second of points of trees (N,) at times (N,), in the world's axes."""
        return self._moved(tree, at, time)[1]

    def _moved(self, tree: np.ndarray, at: Anchors, time: np.ndarray) -> np.ndarray:
        """(2, N, 3) displacements and velocities: of the pieces, and of leaves about their feet."""
        moved, stand = np.zeros((2, len(tree), 3)), self._forest.stand
        for one in filter(self.moves, np.unique(tree).tolist()):
            cos, sin = np.cos(stand.rotation[one]), np.sin(stand.rotation[one])
            world = stand.scale[one] * np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
            rows = np.flatnonzero(np.asarray(tree) == one)
            for few in np.array_split(rows, 1 + len(rows) // AT_ONCE):
                held, when = at.select(few), np.asarray(time)[few]
                foot, *turns = self.flutter(one, np.maximum(held.leaf, 0), when)
                arm = np.where(held.leaf[:, None] >= 0, held.point - foot, 0.0)
                maps = _sure(self.rig(one)).maps[held.piece]
                for order, size in enumerate(self._swayed(one, when)):
                    map_of = np.einsum("nm,nmij->nij", size, maps)
                    off = np.einsum("nij,nj->ni", map_of[:, :, :3], held.point) + map_of[:, :, 3]
                    moved[order, few] = (off + np.cross(turns[order], arm)) @ world.T
        return moved

    def flutter(
        self, tree: int, leaf: np.ndarray, time: float | np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Foot (N, 3) of leaves of a tree, and by how much they turn about it at a time, or at times (N,):
        vectors (N, 3) in radians and their rates, in the variant's frame. Needles do not flutter.
        """
        shape = _sure(self.shape(tree))
        species = self._forest.species[self.variant(tree)[0]]
        if species.needles is not None or not len(shape.seats.segment):
            none = np.zeros((len(leaf), 3))
            return none, none, none
        seats = np.minimum(leaf, len(shape.seats.segment) - 1)
        foot, along = shape.seats.foot[seats], shape.seats.direction[seats]
        across = np.cross(along, shape.seats.up[seats])
        tree_key = child_keys(self._first, np.array([tree]))
        key = child_keys(np.broadcast_to(tree_key, seats.shape), seats)
        wind = self.field.mean(float(self._forest.stand.scale[tree]) * foot[:, 2])
        value, rate = (
            angle[:, :1] * along + angle[:, 1:] * across
            for angle in flutter(key, wind, np.full(len(leaf), time))
        )
        return foot, value, rate

    def most(
        self, tree: int, low: np.ndarray, high: np.ndarray, knot: np.ndarray | None = None
    ) -> float:
        """Metres in the variant's size that no point of a tree's pieces, in boxes from (G, 3) to (G, 3), is
        off its rest at knots (K,) and between them; left out: ever, all waves in phase."""
        rig, response = _sure(self.rig(tree)), _sure(self.response(tree))
        middle, half = (low + high) / 2, (high - low) / 2
        off = np.abs(np.einsum("gmij,gj->gmi", rig.maps[..., :3], middle) + rig.maps[..., 3])
        off += np.einsum("gmij,gj->gmi", np.abs(rig.maps[..., :3]), half)
        if knot is None:
            amplitude = np.abs(response.mean) + np.abs(response.waves).sum(axis=1)
            amplitude /= float(self._forest.stand.scale[tree])
        else:
            amplitude = np.abs(self.amplitudes(tree, knot)).max(axis=0)
        return float(np.linalg.norm(np.einsum("m,gmi->gi", amplitude, off), axis=1).max())

    def leaning(self) -> int:
        """Count the trees asked until now whose tops lean by more than ``LEAN`` of their height, or that are
        held where they would bend farther than small rotations tell."""
        heights, count = self._forest.heights(), 0
        for tree, response in self._responses.items():
            shape = self.shape(tree)
            if shape is not None and response is not None:
                off = np.einsum("nmi,m->ni", shape.modes.shape[:, :, :3], response.mean)
                count += (
                    response.held or float(np.linalg.norm(off, axis=1).max()) > LEAN * heights[tree]
                )
        return count


def sway_of(
    forest: GrownForest, wind: Wind, seed: int, like: ForestSway | None = None
) -> ForestSway | None:
    """The motion of a forest in a scene's wind; None without wind or trees. like : see ``ForestSway``."""
    return ForestSway(forest, wind, seed, like) if wind.speed > 0 and len(forest.stand) else None
