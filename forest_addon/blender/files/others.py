"""Scenes for other programs: each mesh once as OBJ, scenes and surveys of HELIOS++, and all else as JSON.

Beside them stand the whole as a .glb and a .blend, for programs that take one file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import bpy
import numpy as np

from ...base.trimesh import DEAD, GROUND, LEAF, OTHER, PART_NAMES, WOOD
from ...formats.atomic import replacing
from ...formats.helios.writing import (
    is_similar,
    scene_document,
    write_document,
    write_materials,
    write_obj,
)
from ...formats.ownership import claim
from ...sensing.lidar.surveys.export import SCENES, write_survey
from ...sensing.rays.geometry import SceneGeometry, apply_transform
from ...sensing.trajectory import Trajectory
from ...spec import Scanner, Scene, SpecError, Surfaces
from .export import export_glb, save_blend

PARTS = "data/sceneparts"


def export_for_others(
    scene: Scene,
    geometry: SceneGeometry,
    ways: Mapping[str, Trajectory | None],
    folder: Path,
    say: Callable[[str], None],
) -> int:
    """Write a scene that stands in Blender for other programs; how many parts it has.

    geometry : of the evaluated scene. ways : of its sensors by name, None of those that stand. say : is told
    what is written and what HELIOS++ cannot say, in sentences.

    Raises
    ------
    SpecError : nothing in it has faces.
    OSError : a file cannot be written.
    """
    if not len(geometry):
        raise SpecError(scene.name, "has nothing to export: nothing in it has faces")
    surveys = (f"data/surveys/{scene.name}-{sensor.name}.xml" for sensor in scene.sensors)
    whole = ("scene.json", "forest.glb", "scene.blend", f"{SCENES}/{scene.name}.xml")
    claim(*(folder / file for file in (*whole, *surveys)))
    surfaces = next((s.surfaces for s in scene.sensors if isinstance(s, Scanner)), Surfaces())
    placed, unsaid = write_parts(geometry, folder, scene.name, surfaces)
    for sentence in unsaid:
        say(f"  {sentence}")
    told = []
    for sensor in scene.sensors:
        survey, left = write_survey(sensor, folder, scene.name, surfaces, ways[sensor.name])
        told.append({"sensor": sensor.name, "survey": survey, "unsaid": left})
        say(f"  {sensor.name}: {folder / survey if survey else 'no survey'}")
        for sentence in left:
            say(f"    {sentence}")
    said = {
        "name": scene.name,
        "seed": scene.seed,
        "offset_m": scene.offset,
        "crs": scene.crs,
        "units": "metres, degrees, z up; OBJ parts are local, transform is (3, 4) local to world",
        "materials": dict(enumerate(PART_NAMES)),
        "parts": [
            {
                "id": row,
                "file": file,
                "object": geometry.object_name[geometry.object_index[row]],
                "tree": int(geometry.tree[row]),
                "species": int(geometry.species[row]),
                "transform": transform.tolist(),
            }
            for row, file, transform in placed
        ],
        "species": dict(enumerate(planting.species for planting in scene.plantings)),
        "sensors": [asdict(sensor) for sensor in scene.sensors],
        "ways": {  # attitudes as quaternions x, y, z, w
            name: {
                "time_s": way.time.tolist(),
                "position_m": way.position.tolist(),
                "attitude_xyzw": way.at(way.time)[1].as_quat().tolist(),
            }
            for name, way in ways.items()
            if way is not None
        },
        "surveys": told,
        "unsaid": unsaid,
    }
    with replacing(folder / "scene.json") as partial:
        partial.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    say(f"{folder / 'scene.json'}: {len(placed):,} parts of {len(geometry.meshes):,} meshes")
    export_glb(bpy.context.scene, folder / "forest.glb")
    save_blend(folder / "scene.blend")
    for file in ("forest.glb", "scene.blend"):
        say(str(folder / file))
    return len(placed)


def write_parts(
    geometry: SceneGeometry, folder: Path, name: str, surfaces: Surfaces
) -> tuple[list[tuple[int, str, np.ndarray]], list[str]]:
    """Write the meshes, materials and scene document of a scene.

    surfaces : reflectances by part.

    Returns
    -------
    the instances in order, and what HELIOS++ cannot say of them.
    """
    home = folder / PARTS / name
    home.mkdir(parents=True, exist_ok=True)
    reflectance: dict[str, float] = {}  # of materials, by name
    placed, own = [], 0
    written: dict[tuple, str] = {}
    for row in range(len(geometry)):
        number, transform = int(geometry.mesh_index[row]), geometry.transform[row]
        mesh = geometry.meshes[number]
        if not len(mesh.triangles):
            continue
        alone = not is_similar(transform)
        triangle = np.arange(len(mesh.triangles))
        share = geometry.reflectance_at(np.full(len(triangle), row), triangle, np.nan)
        slot = _slots(mesh.part, share, surfaces, reflectance)
        key = (number, row if alone else -1, slot.tobytes())
        if key not in written:
            file = f"mesh{len(written):05d}.obj"
            vertices = apply_transform(transform, mesh.vertices) if alone else mesh.vertices
            names = list(reflectance)
            write_obj(home / file, vertices, mesh.triangles, slot, names, "materials.mtl")
            written[key] = f"{PARTS}/{name}/{file}"
        own += alone
        placed.append((row, written[key], np.eye(3, 4) if alone else transform))
    ground = {name for name in reflectance if name.partition("_")[0] == PART_NAMES[GROUND]}
    write_materials(home / "materials.mtl", reflectance, ground)
    write_document(folder / SCENES / f"{name}.xml", scene_document(name, placed))
    unsaid = (
        (own, f"{own:,} instances are sheared or mirrored: each has an OBJ file of its own"),
        (
            surfaces.leaf_transmittance,
            "leaves let light pass (leaf_transmittance): in HELIOS++ they are opaque",
        ),
        (
            geometry.optics is not None or geometry.slot_optics,
            "mirrors, glass, water and retro-reflectors are surfaces as any other in HELIOS++",
        ),
    )
    return placed, [sentence for holds, sentence in unsaid if holds]


def _slots(
    part: np.ndarray, own: np.ndarray, surfaces: Surfaces, reflectance: dict[str, float]
) -> np.ndarray:
    """(T,) materials of triangles of parts (T,) with a reflectance of their own (T,), or NaN.

    reflectance : of materials by name, whose order is their number; filled on.
    """
    by_part = {OTHER: surfaces.other, WOOD: surfaces.wood, LEAF: surfaces.leaf}
    by_part |= {GROUND: surfaces.ground, DEAD: surfaces.wood}
    usual = np.array([by_part[number] for number in range(len(PART_NAMES))])
    share = np.where(np.isnan(own), usual[part], own)
    kinds, slot = np.unique(np.stack([part, share]), axis=1, return_inverse=True)
    numbers = []
    for kind, value in kinds.T.tolist():
        name = PART_NAMES[int(kind)].replace(" ", "_")
        name = name if value == usual[int(kind)] else f"{name}_{value:.6g}"
        reflectance.setdefault(name, value)
        numbers.append(list(reflectance).index(name))
    return np.array(numbers)[slot.ravel()]
