"""Trees of known structure, built of tubes and quads piece by piece, that remember their truth."""

from dataclasses import dataclass, field

import numpy as np

from forest_addon.growth.own_tree.recognise import Recognition

UP = np.array([0.0, 0.0, 1.0])


def tube(path: object, radius: object, sides: int = 8, capped: bool = False) -> np.ndarray:
    """Facets of a tube: a ring of ``sides`` corners at each place of a path (n, 3)."""
    path = np.asarray(path, dtype=float)
    radius = np.broadcast_to(np.asarray(radius, dtype=float), len(path))
    ahead = np.gradient(path, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    right = np.cross(ahead, [0.31, 0.59, 0.17])  # no path here runs along this
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    turn = 2 * np.pi * np.arange(sides) / sides
    spokes = np.cos(turn)[:, None, None] * right + np.sin(turn)[:, None, None] * np.cross(
        ahead, right
    )
    rings = path + radius[:, None] * spokes  # (sides, n, 3)
    a, b = rings[:, :-1], np.roll(rings, -1, axis=0)[:, :-1]
    c, d = np.roll(rings, -1, axis=0)[:, 1:], rings[:, 1:]
    facets = [
        np.stack([a, b, c], axis=2).reshape(-1, 3, 3),
        np.stack([a, c, d], axis=2).reshape(-1, 3, 3),
    ]
    if capped:
        for at, order in ((0, (0, 2, 1)), (-1, (0, 1, 2))):
            rim = rings[:, at]
            fan = np.stack(
                [np.broadcast_to(path[at], rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1
            )
            facets.append(fan[:, order])
    return np.concatenate(facets)


def at(x: float, y: float, z: float) -> np.ndarray:
    return np.array([x, y, z], dtype=float)


def line(start: object, end: object, places: int = 6) -> np.ndarray:
    return np.linspace(np.asarray(start, dtype=float), np.asarray(end, dtype=float), places)


def blade(
    base: object, out: object, across: object, length: float = 0.1, width: float = 0.06
) -> np.ndarray:
    """A leaf of two facets that hangs by the middle of one side."""
    base, out, across = (np.asarray(x, dtype=float) for x in (base, out, across))
    out, half = out / np.linalg.norm(out), across * width / 2
    a, b, c, d = base - half, base + half, base + half + out * length, base - half + out * length
    return np.array([[a, b, c], [a, c, d]])


@dataclass
class Model:
    """A tree in the making, and its truth: pieces of wood and leaves in the order they were added."""

    tubes: list[np.ndarray] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    foot: list[np.ndarray] = field(default_factory=list)
    tip: list[np.ndarray] = field(default_factory=list)
    radius: list[float] = field(default_factory=list)
    blades: list[np.ndarray] = field(default_factory=list)
    bearers: list[int] = field(default_factory=list)

    def add(self, path: object, radius: object, parent: int, **shape: object) -> int:
        path = np.asarray(path, dtype=float)
        self.tubes.append(tube(path, radius, **shape))  # type: ignore[arg-type]
        self.parents.append(parent)
        self.foot.append(path[0])
        self.tip.append(path[-1])
        self.radius.append(float(np.broadcast_to(radius, len(path))[0]))  # type: ignore[arg-type]
        return len(self.tubes) - 1

    def leaf(self, bearer: int, *blade_of: object) -> None:
        self.blades.append(blade(*blade_of))
        self.bearers.append(bearer)

    def wood(self) -> np.ndarray:
        return np.concatenate(self.tubes)

    def leaves(self) -> np.ndarray:
        return np.concatenate(self.blades)

    def check(self, found: Recognition, order: np.ndarray | None = None) -> None:
        """Pieces, parents and leaves are as built; ``order`` is that in which facets were given."""
        made = np.repeat(np.arange(len(self.tubes)), [len(t) for t in self.tubes])
        made = made if order is None else made[order]
        assert found.wood.count == len(self.tubes)
        assert len(found.wood.piece) == len(made)
        number = np.full(len(self.tubes), -1)  # built -> found
        number[made] = found.wood.piece
        np.testing.assert_array_equal(number[made], found.wood.piece)
        assert len(np.unique(number)) == len(number)

        parents = np.array(self.parents)
        expected = np.where(parents < 0, -1, number[parents])
        np.testing.assert_array_equal(found.parent[number], expected)
        assert found.trunk == number[self.parents.index(-1)]
        first = np.arange(len(parents))  # climb to the first-level branch
        while (parents[parents[first]] >= 0).any():
            first = np.where(parents[parents[first]] >= 0, parents[first], first)
        np.testing.assert_array_equal(
            found.branch[number], np.where(parents < 0, -1, number[first])
        )
        at = np.array(self.radius)
        assert np.all(np.linalg.norm(found.foot[number] - self.foot, axis=1) < 0.35 * at)
        np.testing.assert_allclose(found.radius[number], at, rtol=0.1)
        if self.blades:
            np.testing.assert_array_equal(found.bearer, number[self.bearers])


def tree(seed: int = 0, branches: int = 9, **shape: object) -> Model:
    """A leaning trunk, curved branches of known feet, twigs on them, leaves on twigs and branches."""
    rng = np.random.default_rng(seed)
    model = Model()
    base, top = np.array([3.0, -2.0, 0.5]), np.array([3.4, -1.8, 10.5])
    trunk = model.add(line(base, top, 12), np.linspace(0.3, 0.12, 12), -1, **shape)
    for number in range(branches):
        share = 0.3 + 0.6 * number / branches
        turn, lift = 2.4 * number, np.deg2rad(rng.uniform(20, 50))
        out = np.array([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)])
        foot = base + share * (top - base)
        along = np.linspace(0, 1, 9)[:, None]
        path = foot + along * out * rng.uniform(1.5, 2.5) + 0.3 * along**2 * UP
        branch = model.add(path, np.linspace(0.07, 0.02, 9), trunk, **shape)
        side = np.cross(out, UP) / np.linalg.norm(np.cross(out, UP))
        for knot, hand in ((4, 1), (6, -1)):
            way = (out + 2 * hand * side) / np.linalg.norm(out + 2 * hand * side)
            twig = model.add(
                line(path[knot], path[knot] + 0.6 * way),
                np.linspace(0.015, 0.004, 6),
                branch,
                **shape,
            )
            for part in (0.4, 0.7, 1.0):
                model.leaf(twig, path[knot] + part * 0.6 * way, np.cross(way, UP), way)
        model.leaf(branch, path[-1], out, side)
    return model
