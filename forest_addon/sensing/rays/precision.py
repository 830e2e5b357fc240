"""Precision of a scene's places: Blender keeps coordinates in float32.

Beyond 8 km from the origin neighbouring float32 numbers are a millimetre apart and more (at UTM northings
half a metre), so what stands there has been moved by up to half of that before anything is sensed.
"""

from __future__ import annotations

import numpy as np

from .geometry import SceneGeometry

COARSE = 1e-3  # metres between numbers, from which a user should know


def rounding_warning(scene: SceneGeometry) -> str:
    """A sentence on what stands too far from the origin, and what to do; empty where nothing does."""
    if not len(scene):
        return ""
    local = np.array([np.abs(mesh.vertices).max(initial=0.0) for mesh in scene.meshes])
    far = np.abs(scene.transform[:, :, 3]).max(axis=1)
    far = np.nan_to_num(np.maximum(far, local[scene.mesh_index]), posinf=0.0)
    worst = int(np.argmax(far))
    step = float(np.spacing(np.float32(far[worst])))
    if step < COARSE:
        return ""
    name = scene.object_name[scene.object_index[worst]]
    return (
        f'"{name}" is {far[worst] / 1000:,.0f} km from the origin, where coordinates in Blender have steps '
        f"of {step:.2g} m: places are off by up to {step / 2:.2g} m. Move the scene near the origin and "
        "give the distance as the offset, which is added to what is written"
    )
