"""Euler-Bernoulli beams in space: stiffness and mass of tapered members, and the first modes of a tree.

Every member is one element: cubic in bending, linear in stretch and torsion, its taper integrated exactly by
five Gauss points (Przemieniecki 1968, ch. 5, 11 and 15). The weight of what a member carries takes from its
stiffness, as in Greenhill's column. The foot is clamped. The modes solve K φ = ω² M φ by shift-invert Lanczos
(ARPACK), with φᵀMφ = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import eigsh

from .members import Members, frustum
from .wood import TORSION, GreenWood

GRAVITY = 9.81
# Of the frequency without weight, what a tree keeps at least: it is 1.4 times lower than the height at which
# it buckles. Our judgement: measured safety factors of slender forest trees lie there and above.
STEADY = 0.8
POINT, WEIGHT = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True)
class Modes:
    """The first M modes of a tree of N nodes.

    frequency : (M,) Hz. shape : (N, M, 6) displacement and rotation of the nodes for a unit amplitude
    (of a modal mass of 1 kg): m and rad.
    """

    frequency: np.ndarray
    shape: np.ndarray


def modes_of(
    members: Members, wood: GreenWood, load: np.ndarray, count: int, gravity: float = GRAVITY
) -> Modes:
    """Find the first modes of members clamped at the ground.

    load : (N, 6, 6) mass that nodes carry besides, as of ``point_masses``. count : how many modes.
    gravity : m/s². A tree that its own weight would buckle is taken as if it had none.
    """
    found = _solved(members, wood, load, count, gravity)
    return found or modes_of(members, wood, load, count, 0.0)


def _solved(
    members: Members, wood: GreenWood, load: np.ndarray, count: int, gravity: float
) -> Modes | None:
    """The first modes; None of a tree that its weight buckles."""
    stiff, mass = matrices(members, wood, load, gravity)
    free = stiff.shape[0] - 6
    count = min(count, free - 2)
    begin = np.ones(free)  # a fixed start: the same modes to the bit every time
    square, shape = eigsh(stiff[6:, 6:], count, M=mass[6:, 6:], sigma=0.0, which="LM", v0=begin)
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
    light = modes_of(members, wood, load, 1, 0.0).frequency[0]
    gravity = GRAVITY
    while True:
        found = _solved(members, wood, load, count, gravity)
        if found is None:
            gravity *= 0.5
        elif found.frequency[0] >= 0.999 * STEADY * light:
            return found
        else:  # stiffness falls ever faster with weight: less is taken at this gravity than in proportion
            gravity *= (1 - STEADY**2) / (1 - (found.frequency[0] / light) ** 2)


def matrices(
    members: Members, wood: GreenWood, load: np.ndarray, gravity: float = GRAVITY
) -> tuple[csc_matrix, csc_matrix]:
    """Assemble stiffness and mass of all nodes, the clamped one first, (6N, 6N)."""
    length = np.linalg.norm(members.end - members.start, axis=1)
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
        csc_matrix(coo_matrix((stiffness, (rows, columns)), size)),
        csc_matrix(coo_matrix((loads, (rows, columns)), size)),
    )


def point_masses(node: np.ndarray, mass: np.ndarray, offset: np.ndarray, count: int) -> np.ndarray:
    """(count, 6, 6) mass of nodes that carry masses (P,) kg rigidly at offsets (P, 3) m from nodes (P,)."""
    x, y, z = offset.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    lever = np.concatenate([np.broadcast_to(np.eye(3), cross.shape), cross], axis=2)
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
        stiff += np.einsum("b,bip,bjp->bij", wood.modulus * inertia * dx, bend, bend)
        weighed = move.copy()
        weighed[:, :, 3] *= (2 * turning / area)[:, None]
        mass += np.einsum("b,bip,bjp->bij", wood.density * area * dx, weighed, move)
        pull, twist = (
            wood.modulus * wood.inside**2 * area * dx,
            TORSION * wood.modulus * 2 * inertia * dx,
        )
        for at, modulus in ((0, pull), (3, twist)):
            for i, j, sign in (
                (at, at, 1),
                (at + 6, at + 6, 1),
                (at, at + 6, -1),
                (at + 6, at, -1),
            ):
                stiff[:, i, j] += sign * modulus / length**2
    return stiff, mass


def _under_weight(
    members: Members, wood: GreenWood, load: np.ndarray, length: np.ndarray, gravity: float
) -> np.ndarray:
    """(B, 12, 12) what the weight above members takes from their bending stiffness (geometric stiffness)."""
    own = wood.density * frustum(members.start, members.end, members.radius)
    above = load[:, 0, 0].copy()
    carried = np.zeros(len(length))
    for b in range(len(length) - 1, -1, -1):  # children come after their mothers
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
    y = np.cross(aside, x)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    frame = np.stack([x, y, np.cross(x, y)], axis=1)
    whole = np.zeros((len(length), 12, 12))
    for block in range(4):
        whole[:, 3 * block : 3 * block + 3, 3 * block : 3 * block + 3] = frame
    a, b, c = members.offset.T
    zero = np.zeros_like(a)
    cross = np.stack([zero, c, -b, -c, zero, a, b, -a, zero], axis=1).reshape(-1, 3, 3)
    whole[:, 0:3, 3:6] = np.einsum("bij,bjk->bik", frame, cross)
    return whole
