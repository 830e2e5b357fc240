"""Choice of the engine that casts the rays of a scene.

``auto`` is Embree where Blender's own library is found and passes a test against float64, once a
session, and BVHTree elsewhere; a caster's ``engine`` says which it is.
"""

from __future__ import annotations

import os
from functools import cache, partial

import numpy as np

from ...base.rng import stream
from ...base.trimesh import OTHER, TriMesh
from ...growth.mesh.meshing import tube
from ...sensing.moving import MovingScene
from ...sensing.moving_rays import MovingCaster
from ...sensing.rays.exact import ExactCaster
from ...sensing.rays.geometry import SceneGeometry
from ...sensing.rays.search import Search
from ...spec import Rays
from .bvh import BvhCaster
from .embree import EmbreeCaster, EmbreeError
from .embree_motion import EmbreeMotion, embree_motion

ROUNDING = 1e-6  # metres, as far from the origin as the trial scene is


def make_caster(scene: SceneGeometry, rays: Rays, like: Search | None = None) -> Search:
    """The caster that the settings ask for.

    like : a caster of before by the same settings, whose trees of meshes that both scenes have are shared.

    Raises
    ------
    ValueError : Embree is asked for by name and cannot be used; says why.
    """
    plain = like if isinstance(like, BvhCaster) else None
    if rays.engine == "bvhtree":
        return BvhCaster(scene, plain)
    problem = embree_problem()
    if not problem:
        fast = like if isinstance(like, EmbreeCaster) else None
        try:
            return EmbreeCaster(scene, rays.threads or os.cpu_count() or 1, fast)
        except EmbreeError as error:  # no memory left for this scene
            problem = str(error)
    if rays.engine == "embree":
        raise ValueError(f'engine "embree" cannot be used: {problem}; use "auto" or "bvhtree"')
    return BvhCaster(scene, plain)


def make_moving_caster(
    moving: MovingScene, rays: Rays, like: MovingCaster | None = None
) -> MovingCaster:
    """The caster of a scene that moves that the settings ask for. like : of a scene of the same meshes, whose
    trees are shared."""
    if rays.engine != "bvhtree" and not embree_problem():
        known = like if isinstance(like, EmbreeMotion) else None
        fast = embree_motion(moving, rays.threads or os.cpu_count() or 1, known)
        if fast is not None:
            return fast
    return MovingCaster(moving, partial(make_caster, rays=rays))


@cache
def embree_problem() -> str:
    """Reason why Embree cannot be used here; empty where it can."""
    scene = _trial_scene()
    rng = stream(0, "embree", "trial")
    origins = rng.uniform(-4, 4, (500, 3)) + scene.transform[0, :, 3]
    directions = scene.transform[rng.integers(3, size=500), :, 3] + rng.normal(0, 0.3, (500, 3))
    directions -= origins
    try:
        ours = EmbreeCaster(scene).cast(origins, directions, 6.0)
    except EmbreeError as problem:
        return str(problem)
    truth = ExactCaster(scene).cast(origins, directions, 6.0)
    same = (ours.instance == truth.instance) & (ours.triangle == truth.triangle)
    same &= np.isclose(ours.distance, truth.distance, rtol=0, atol=ROUNDING)
    return "" if same.mean() > 0.99 else "it does not find what is there"  # but for edges


def _trial_scene() -> SceneGeometry:
    """A knot and a bar, turned, mirrored and sheared, far from the origin."""
    way = np.linspace(0.0, 2 * np.pi, 25)
    knot = np.stack([np.sin(3 * way), np.sin(2 * way), np.cos(way)], axis=1)
    bar = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    meshes = tuple(
        TriMesh.of_part(*tube(line, np.full(len(line), 0.3), 12), OTHER) for line in (knot, bar)
    )
    linear = np.array(
        [
            [[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]],
            [[-1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.5]],
            [[1.0, 0.7, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]],
        ]
    )
    place = np.array([[5e5, 4e6, 100.0], [5e5 + 2, 4e6 + 1, 100.0], [5e5 - 2, 4e6 + 1, 101.0]])
    nothing = np.full(3, -1)
    return SceneGeometry(
        meshes=meshes,
        transform=np.concatenate([linear, place[:, :, None]], axis=2),
        mesh_index=np.array([0, 1, 1]),
        object_name=("trial",) * 3,
        tree=nothing,
        species=nothing,
    )
