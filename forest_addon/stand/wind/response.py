"""Response of one tree to the wind: amplitudes of its modes as a closed function of time.

Drag on a member is quadratic in slow and linear in fast wind, as leaves fold and crowns bend
(reconfiguration, Vogel exponent -1: de Langre 2008; Rudnicki et al. 2004): F = c U² / √(1 + (U/U_r)²), c =
ρ c_d A. What has bent by an angle θ faces the wind with cos θ of its area, and only the wind across it
pushes: F cos²θ, θ the arctangent of the small rotation θ_0, so F/(1 + θ_0²) (as plates and rods in Gosselin,
de Langre & Machado-Almeida 2010, J. Fluid Mech. 650). It is made linear about the local mean: its slope times
the turbulence drives the modes, its slope times the tree's own velocity is the aerodynamic damping, and what
it loses as the tree bends on is a stiffness. A mode is then an oscillator whose answer to each wave of the
wind is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...growth.sway.shape import SwayShape
from .field import DRAG, WindField

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

    def spread(self) -> np.ndarray:
        """(M,) standard deviation of the amplitudes."""
        return np.sqrt(0.5 * (np.abs(self.waves) ** 2).sum(axis=1))

    def exact(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (N, M) at times (N,), and their rates, by the whole sum."""
        turn = np.exp(1j * time[:, None] * self.rate)
        return self.mean + (turn @ self.waves.T).real, (turn @ (1j * self.rate * self.waves).T).real

    def amplitudes(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes (N, M) at times (N,), and their rates, cubic between knots 1/32 s apart.

        Knots lie at whole multiples, so that a moment is the same in whatever company it is asked for.
        """
        knot = np.floor(time * KNOTS)
        share = (time * KNOTS - knot)[:, None]
        used, row = np.unique(np.concatenate([knot, knot + 1]), return_inverse=True)
        value, slope = (x / KNOTS**k for k, x in enumerate(self.exact(used / KNOTS)))
        low, high = row[: len(time)], row[len(time) :]
        a, b, da, db = value[low], value[high], slope[low], slope[high]
        rise = b - a
        second, third = 3 * rise - 2 * da - db, da + db - 2 * rise
        found = a + share * (da + share * (second + share * third))
        return found, KNOTS * (da + share * (2 * second + 3 * share * third))


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
    sails = _Sails(
        push, tilt, omega, force, np.stack([slope, *[force / np.maximum(wind, 1e-9)] * 2], 1)
    )
    waves, shaken = np.zeros((0, 0)), np.zeros(len(force))
    for _ in range(2):
        bent, mean, towards = sails.bent(shaken)
        drive = field.push(world, push * (sails.lever * bent[:, None])[:, None])
        waves, damper = sails.answer(drive, 2 * np.pi * field.frequency, bent, towards)
        found = 0.5 * np.einsum("mk,nk->mn", waves, waves.conj()).real
        shaken = np.einsum("bmi,mn,bni->b", tilt, found, tilt)
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
    ``DEVIATIONS`` of the gusts: each mode alone first, since thin tips turn by modes of their own."""
    turns = np.concatenate(shape.ends)[:, :, 3:] / scale
    spread = np.sqrt(0.5 * (np.abs(waves) ** 2).sum(axis=1))
    alone = np.linalg.norm(turns, axis=2).max(axis=0) * (np.abs(mean) + DEVIATIONS * spread)
    share = MOST_TURN / np.maximum(alone, MOST_TURN)
    mean, waves = share * mean, share[:, None] * waves
    gusts = 0.5 * (waves @ waves.conj().T).real
    lean = np.linalg.norm(np.einsum("bmi,m->bi", turns, mean), axis=1)
    shaken = np.einsum("bmi,bmi->b", turns, np.einsum("mn,bni->bmi", gusts, turns))
    most = (lean + DEVIATIONS * np.sqrt(np.maximum(shaken, 0.0))).max(initial=0.0)
    return np.asarray(share * (MOST_TURN / max(float(most), MOST_TURN)))


@dataclass(frozen=True)
class _Sails:
    """Members of a tree as the wind meets them.

    push : (B, M, 3) of modes along, across and upright. tilt : (B, M, 2) radians by a unit of each mode.
    omega : (M,) rad/s. force : (B,) N of the mean wind at rest. lever : (B, 3) N s/m, what a gust adds.
    """

    push: np.ndarray
    tilt: np.ndarray
    omega: np.ndarray
    force: np.ndarray
    lever: np.ndarray

    def bent(self, shaken: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(B,) shares of drag that members keep as they bend, (M,) how far the mean wind bends the tree, and
        (B, M) N that drag falls by a unit of each mode.

        shaken : (B,) mean square of the rotation by gusts.
        """
        share, mean, lean = 1 / (1 + shaken), np.zeros(len(self.omega)), np.zeros((len(shaken), 2))
        for _ in range(MOST_STEPS):
            mean = self.push[:, :, 0].T @ (self.force * share) / self.omega**2
            lean = np.einsum("bmi,m->bi", self.tilt, mean)
            new = 1 / (1 + shaken + (lean**2).sum(axis=1))
            apart = np.abs(new - share).max(initial=0.0)
            share = (share + new) / 2
            if apart < 1e-4:
                break
        falls = 2 * self.force * share**2
        return share, mean, falls[:, None] * np.einsum("bi,bmi->bm", lean, self.tilt)

    def answer(
        self, drive: np.ndarray, rate: np.ndarray, bent: np.ndarray, falls: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(M, K) answers to waves (K, M) at rates (K,), rad/s, and the damper (M, M)."""
        omega, lever = self.omega, self.lever * bent[:, None]
        aerodynamic = np.einsum("bmc,bnc,bc->mn", self.push, self.push, lever)
        # Beyond the critical damping a mode creeps; the share that the others take from it stays.
        most = 2 * omega * (MOST_DAMPING - INTERNAL)
        aerodynamic *= np.minimum(1.0, most / np.maximum(np.diagonal(aerodynamic), 1e-12)).min()
        damper = aerodynamic + np.diag(2 * INTERNAL * omega)
        answer = 1j * rate[:, None, None] * damper + self.push[:, :, 0].T @ falls
        answer += np.eye(len(omega)) * (omega**2 - rate[:, None] ** 2)[:, :, None]
        return np.linalg.solve(answer, drive[:, :, None])[:, :, 0].T, damper


def drag(shape: SwayShape, wind: np.ndarray, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(B,) drag of members in N in winds (B,) m/s, and (B,) its slope in N s/m."""
    leaf = (
        AIR * 2 * DRAG * shape.leafy * scale**2
    )  # of their one-sided area, half of which is ``leafy``
    wood = 0.5 * AIR * WOOD_DRAG * shape.woody * scale**2
    fold = np.sqrt(1 + (wind / FOLDING) ** 2)
    force = wood * wind**2 + leaf * wind**2 / fold
    slope = 2 * wood * wind + leaf * wind * (2 + (wind / FOLDING) ** 2) / fold**3
    return force, slope
