"""Trees as people model them: six of known shape, and what is done to a mesh before it is brought."""

from collections.abc import Callable

import numpy as np

from .model_tree import Model, at, line

RISE = np.linspace(0, 1, 16)


def _crown(model: Model, stem: int, path: np.ndarray, branches: int, sides: int) -> None:
    """Branches with a twig each around the upper two thirds of a stem."""
    for number in range(branches):
        share = 0.35 + 0.6 * number / branches
        foot = np.array([np.interp(share, np.linspace(0, 1, len(path)), x) for x in path.T])
        out = at(np.cos(2.4 * number), np.sin(2.4 * number), 0.5) * (1.8 - share)
        branch = model.add(line(foot, foot + out), np.linspace(0.05, 0.012, 6), stem, sides=sides)
        way = foot + 0.6 * out
        model.add(
            line(way, way + np.cross(out, [0, 0, 0.5]) + at(0, 0, 0.2)),
            np.linspace(0.015, 0.005, 6),
            branch,
            sides=sides,
        )


def _stem(model: Model, path: np.ndarray, foot: float = 0.25, **shape: object) -> int:
    thick = np.linspace(foot, 0.2 * foot, len(path))
    return model.add(path, thick, -1, **shape)


def _leaning(sides: int, capped: bool) -> Model:
    model = Model()
    path = np.stack([2.5 * RISE, 0 * RISE, 9 * RISE], 1)
    _crown(model, _stem(model, path, sides=sides, capped=capped), path, 12, sides)
    return model


def _forked(sides: int, capped: bool) -> Model:
    model = Model()
    path = np.stack([0.6 * RISE, 0 * RISE, 8 * RISE], 1)
    stem = _stem(model, path, sides=sides, capped=capped)
    arm = path[6] + np.stack([-2.0 * RISE, 0.4 * RISE, 4.5 * RISE], 1)
    limb = model.add(arm, np.linspace(0.15, 0.04, 16), stem, sides=sides, capped=capped)
    _crown(model, stem, path, 9, sides)
    _crown(model, limb, arm, 6, sides)
    return model


def _twin(sides: int, capped: bool) -> Model:
    model = Model()
    for x, lean in ((0.0, -0.6), (0.9, 0.8)):
        path = np.stack([x + lean * RISE, 0 * RISE, (8 + x) * RISE], 1)
        _crown(model, _stem(model, path, sides=sides, capped=capped), path, 8, sides)
    model.parents = [-1 if p < 0 else p for p in model.parents]
    return model


def _stacked(sides: int, capped: bool) -> Model:
    model = Model()
    z = np.linspace(0, 9, 16)
    for number in range(3):
        part = z[5 * number : 5 * number + 6]
        model.add(
            at(0, 0, -0.05 * number) + np.outer(part, at(0.05, 0, 1)),
            np.interp(part, [0, 9], [0.26, 0.06]),
            -1,
            sides=sides,
            capped=capped,
        )
    _crown(model, 0, np.outer(z, at(0.05, 0, 1)), 12, sides)
    return model


def _flared(sides: int, capped: bool) -> Model:
    model = Model()
    z = np.concatenate([np.arange(0, 0.7, 0.07), np.linspace(0.7, 9, 16)])
    path = np.outer(z, at(0.1, 0, 1))
    model.add(path, 0.03 + 0.014 * (9 - z) + 0.2 * np.exp(-z / 0.3), -1, sides=sides, capped=capped)
    _crown(model, 0, path, 12, sides)
    return model


def _palm(sides: int, capped: bool) -> Model:
    model = Model()
    path = np.stack([1.2 * RISE**2, 0 * RISE, 10 * RISE], 1)
    stem = _stem(model, path, 0.22, sides=sides, capped=capped)
    for number in range(14):
        turn = 2.4 * number
        rise = RISE[::2]
        way = path[-1] + np.outer(2.5 * rise, at(np.cos(turn), np.sin(turn), 0))
        way[:, 2] += 1.5 * rise - 2.5 * rise**2
        model.add(way, np.linspace(0.03, 0.008, 8), stem, sides=sides)
    return model


TREES: dict[str, Callable[[int, bool], Model]] = {
    "leaning": _leaning,
    "forked": _forked,
    "twin": _twin,
    "stacked": _stacked,
    "flared": _flared,
    "palm": _palm,
}


def rough(wood: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """Facets (T, 3, 3) whose corners are off by so many metres, equal ones alike, as in a scan."""
    places, number = np.unique(wood.reshape(-1, 3), axis=0, return_inverse=True)
    off = np.random.default_rng(seed).normal(size=places.shape) * noise
    return np.asarray((places + off)[number.ravel()].reshape(wood.shape))


def doubled(wood: np.ndarray) -> np.ndarray:
    """Facets with every third one twice, every fifth turned round."""
    turned = wood.copy()
    turned[::5] = turned[::5, ::-1]
    return np.concatenate([turned, wood[::3, ::-1]])


def decimated(wood: np.ndarray, keep: float) -> np.ndarray:
    """The share of facets that Blender's Decimate leaves, edges collapsed where that shows least."""
    import bpy

    places, number = np.unique(np.round(wood.reshape(-1, 3), 9), axis=0, return_inverse=True)
    mesh = bpy.data.meshes.new("fine")
    mesh.from_pydata(places.tolist(), [], number.reshape(-1, 3).tolist())
    fine = bpy.data.objects.new("fine", mesh)
    bpy.context.scene.collection.objects.link(fine)
    fine.modifiers.new("Decimate", "DECIMATE").ratio = keep
    coarse = fine.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    coarse.calc_loop_triangles()
    corners = [triangle.vertices for triangle in coarse.loop_triangles]
    facets = np.array([vertex.co for vertex in coarse.vertices])[np.array([*map(list, corners)])]
    bpy.data.objects.remove(fine)
    bpy.data.meshes.remove(mesh)
    return facets
