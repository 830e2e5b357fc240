"""Scenes for other programs: each mesh once as OBJ, scenes and surveys of HELIOS++, and all else as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from forest_addon.base.trimesh import DEAD, GROUND, LEAF, OTHER, PART_NAMES, WOOD
from forest_addon.formats.atomic import replacing
from forest_addon.formats.helios.writing import (
    PlacedPart,
    is_similar,
    rotated,
    scene_document,
    words,
    write_document,
    write_materials,
    write_obj,
)
from forest_addon.sensing.lidar.scanner import directions
from forest_addon.sensing.rays.geometry import SceneGeometry, apply_transform
from forest_addon.sensing.trajectory import Trajectory, strips
from forest_addon.spec import Airborne, Scanner, Sensor, SpecError, Surfaces, Terrestrial

from ...command import read_scene
from ...progress import Stages, hushed

MOST_ROWS = 10_000  # beams one above the other, that a scanner is given as channels
PARTS, SCENES, SURVEYS = "data/sceneparts", "data/scenes", "data/surveys"
SCANNERS, PLATFORMS = "data/scanners-{name}.xml", "data/platforms-{name}.xml"


@dataclass(frozen=True)
class Exported:
    """Survey of a sensor, None where HELIOS++ has none like it, and what was not said, in sentences."""

    sensor: str
    survey: str | None
    unsaid: tuple[str, ...]


def export_scene(path: Path, folder: Path, seed: int | None = None, quiet: bool = False) -> None:
    """Grow a scene file and write it for other programs.

    Raises
    ------
    SpecError : a scene that cannot be used.
    OSError : a file that cannot be written.
    """
    stages = Stages(quiet)
    scene = read_scene(path, seed)
    with stages.stage("load bpy"), hushed():
        import bpy

        from forest_addon.api.site import build
        from forest_addon.blender.sensors.observe import Observer
    with stages.stage("grow the forest"), hushed():
        build(scene, folder=path.parent)
        observer = Observer(bpy.context.evaluated_depsgraph_get(), scene.rays)
    geometry = observer.geometry
    if not len(geometry):
        raise SpecError(str(path), "has nothing to export: nothing in it has faces")
    with stages.stage("write parts"):
        surfaces = next((s.surfaces for s in map(_scanner, scene.sensors) if s), Surfaces())
        placed, unsaid = write_parts(geometry, folder, scene.name, surfaces)
    for sentence in unsaid:
        stages.say(f"  {sentence}")
    told = []
    for sensor in scene.sensors:
        found = write_survey(sensor, folder, scene.name, surfaces)
        told.append(found)
        stages.say(f"  {sensor.name}: {folder / found.survey if found.survey else 'no survey'}")
        for sentence in found.unsaid:
            stages.say(f"    {sentence}")
    ways = {
        sensor.name: strips(cast(Airborne, sensor))
        if sensor.kind == "airborne"
        else observer.way(sensor)
        for sensor in scene.sensors
    }
    said = {
        "name": scene.name,
        "seed": scene.seed,
        "offset_m": scene.offset,
        "crs": scene.crs,
        "units": "metres, degrees, z up; OBJ parts are local, transform is (3, 4) local to world",
        "materials": dict(enumerate(PART_NAMES)),
        "parts": _rows(geometry, placed),
        "species": dict(enumerate(planting.species for planting in scene.plantings)),
        "sensors": [asdict(sensor) for sensor in scene.sensors],
        "ways": {name: _way(way) for name, way in ways.items() if way is not None},
        "surveys": [asdict(found) for found in told],
        "unsaid": unsaid,
    }
    with replacing(folder / "scene.json") as partial:
        partial.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    stages.say(f"{folder / 'scene.json'}: {len(placed):,} parts of {len(geometry.meshes):,} meshes")


def write_parts(
    geometry: SceneGeometry, folder: Path, name: str, surfaces: Surfaces
) -> tuple[list[PlacedPart], list[str]]:
    """Write the meshes, materials and scene document of a scene.

    surfaces : reflectances by part.

    Returns
    -------
    the instances in order, and what HELIOS++ cannot say of them.
    """
    home = folder / PARTS / name
    home.mkdir(parents=True, exist_ok=True)
    materials = _Materials(surfaces)
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
        slot = materials.slots(mesh.part, share)
        key = (number, row if alone else -1, slot.tobytes())
        if key not in written:
            file = f"mesh{len(written):05d}.obj"
            vertices = apply_transform(transform, mesh.vertices) if alone else mesh.vertices
            names = materials.names
            write_obj(home / file, vertices, mesh.triangles, slot, names, "materials.mtl")
            written[key] = f"{PARTS}/{name}/{file}"
        own += alone
        placed.append(PlacedPart(str(row), written[key], np.eye(3, 4) if alone else transform))
    write_materials(home / "materials.mtl", materials.reflectance, materials.ground)
    write_document(folder / SCENES / f"{name}.xml", scene_document(name, placed))
    unsaid = []
    if own:
        unsaid.append(f"{own:,} instances are sheared or mirrored: each has an OBJ file of its own")
    if surfaces.leaf_transmittance:
        unsaid.append("leaves let light pass (leaf_transmittance): in HELIOS++ they are opaque")
    if geometry.optics is not None or geometry.slot_optics:
        unsaid.append("mirrors, glass and water are surfaces as any other in HELIOS++")
    return placed, unsaid


class _Materials:
    """Materials by part and reflectance."""

    def __init__(self, surfaces: Surfaces) -> None:
        usual = {OTHER: surfaces.other, WOOD: surfaces.wood, LEAF: surfaces.leaf}
        usual |= {GROUND: surfaces.ground, DEAD: surfaces.wood}
        self._usual = np.array([usual[part] for part in range(len(PART_NAMES))])
        self.names: list[str] = []
        self.reflectance: dict[str, float] = {}
        self.ground: set[str] = set()

    def slots(self, part: np.ndarray, own: np.ndarray) -> np.ndarray:
        """(T,) materials of triangles of parts (T,) with a reflectance of their own (T,), or NaN."""
        share = np.where(np.isnan(own), self._usual[part], own)
        kinds, slot = np.unique(np.stack([part, share]), axis=1, return_inverse=True)
        numbers = []
        for kind, value in kinds.T.tolist():
            name = PART_NAMES[int(kind)].replace(" ", "_")
            name = name if value == self._usual[int(kind)] else f"{name}_{value:.6g}"
            if name not in self.names:
                self.names.append(name)
                self.reflectance[name] = value
                if int(kind) == GROUND:
                    self.ground.add(name)
            numbers.append(self.names.index(name))
        return np.array(numbers)[slot.ravel()]


def write_survey(sensor: Sensor, folder: Path, scene: str, surfaces: Surfaces) -> Exported:
    """Write the survey of a sensor with its scanner and platform, if HELIOS++ has one like it.

    surfaces : that the materials were made of.
    """
    scanner_of_ours = _scanner(sensor)
    if scanner_of_ours is None:
        return Exported(sensor.name, None, (f"HELIOS++ has no {sensor.kind}",))
    pattern = getattr(sensor, "pattern", "")
    if sensor.kind == "terrestrial":
        rows = len(directions(cast(Terrestrial, sensor))[1])
        if rows > MOST_ROWS:
            why = f"{rows:,} beams one above the other are more than {MOST_ROWS:,}"
            return Exported(sensor.name, None, (why,))
        scanner, platform, legs = _tripod(cast(Terrestrial, sensor))
        unsaid = ["the beams of a column leave at one time"]
    elif sensor.kind == "airborne" and pattern == "lines":
        scanner, platform, legs = _strips(cast(Airborne, sensor))
        unsaid = [
            "a strip begins in the middle of a line, and lines may have a pulse more at their end"
        ]
    else:
        what = f"a {sensor.kind} scanner with pattern {pattern} is not written as a survey"
        return Exported(sensor.name, None, (f"{what}; its way is in scene.json",))
    name = f"{scene}-{sensor.name}"
    files = SCANNERS.format(name=name), PLATFORMS.format(name=name)
    for file, element in zip(files, (scanner, platform), strict=True):
        root = Element("document")
        root.append(element)
        write_document(folder / file, root)
    root = Element("document")
    survey = SubElement(
        root,
        "survey",
        name=name,
        scene=f"{SCENES}/{scene}.xml#{scene}",
        platform=f"{files[1]}#platform",
        scanner=f"{files[0]}#scanner",
    )
    survey.extend(legs)
    path = f"{SURVEYS}/{name}.xml"
    write_document(folder / path, root)
    return Exported(sensor.name, path, (*unsaid, *_unsaid(scanner_of_ours, surfaces)))


def _scanner(sensor: Sensor) -> Scanner | None:
    """The sensor as a scanner with a beam, None where it is none."""
    return (
        cast(Scanner, sensor) if hasattr(sensor, "beam") and hasattr(sensor, "surfaces") else None
    )


def _unsaid(sensor: Scanner, surfaces: Surfaces) -> Iterator[str]:
    """Sentences on what HELIOS++ has no word for."""
    beam, noise, receiver = sensor.beam, sensor.noise, sensor.receiver
    if sensor.surfaces != surfaces:
        yield "its reflectances differ from those of the first scanner, which the materials have"
    if len(set(beam.divergence_mrad)) > 1:
        yield "its beam is told as round, as wide as the mean of both divergences"
    if beam.exit_diameter:
        yield "the width of the beam at its exit (exit_diameter) is left out"
    if beam.subrays > 1:
        yield f"its {beam.subrays} rays of equal energy are rings of {_rays(_rings(beam.subrays))}"
    if sensor.faintest:
        yield "the threshold of detection (faintest) is left out: HELIOS++ has watts of its own"
    if noise.range_ppm or noise.incidence_sd or noise.drop_out:
        yield "of its noise only range_sd is told"
    if receiver != type(receiver)():
        yield "settings of its receiver are left out"
    if beam.extinction:
        yield "extinction by the air is left out"
    if sensor.motion:
        yield "the scene stands as at the present frame"
    if sensor.bounces:
        yield "bounces are left out"


def _rings(subrays: int) -> int:
    """Rings of HELIOS++ that have at least so many rays: 1 + 3·q·(q - 1)."""
    return int(np.ceil((3 + np.sqrt(9 + 12 * (subrays - 1))) / 6 - 1e-9))


def _rays(rings: int) -> int:
    return 1 + 3 * rings * (rings - 1)


def _device(sensor: Scanner, pulse_rate: float, widest_deg: float, scan_hz: float) -> Element:
    """The scanner with its light and ranges."""
    beam = sensor.beam
    values: dict[str, object] = {
        "id": "scanner",
        "name": sensor.scanner or sensor.name,
        "optics": "rotating",
        "accuracy_m": sensor.noise.range_sd,
        "beamDivergence_rad": float(np.mean(beam.divergence_mrad)) * 1e-3,
        "pulseFreqs_Hz": pulse_rate,
        "pulseLength_ns": beam.pulse_ns,
        "wavelength_nm": beam.wavelength_nm,
        "rangeMin_m": sensor.min_range,
        "rangeMax_m": sensor.max_range,
        "scanAngleMax_deg": widest_deg,
        "scanAngleEffectiveMax_deg": widest_deg,
        "scanFreqMin_Hz": 0.0,
        "scanFreqMax_Hz": scan_hz,
        "headRotatePerSecMax_deg": 1e9,
        "maxNOR": beam.max_returns,
    }
    scanner = Element("scanner", words(values))
    SubElement(scanner, "FWFSettings", beamSampleQuality=str(_rings(beam.subrays)))
    SubElement(scanner, "headRotateAxis", x="0", y="0", z="1")
    return scanner


def _tripod(sensor: Terrestrial) -> tuple[Element, Element, list[Element]]:
    """Scanner, platform and legs of a tripod: a head that turns a column a pulse, with a channel a row."""
    azimuth, elevation = (np.rad2deg(angles) for angles in directions(sensor))
    columns = sensor.pulse_rate / len(elevation)
    step = sensor.angle_step_deg
    scanner = _device(sensor, columns, 180.0, 0.0)
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    channels = SubElement(scanner, "channels")
    for number, angle in enumerate(elevation.tolist()):
        channel = SubElement(channels, "channel", id=str(number))
        origin = SubElement(channel, "beamOrigin", x="0", y="0", z="0")
        SubElement(origin, "rot", axis="x", angle_deg=repr(angle))
    platform = Element("platform", id="platform", name="tripod", type="static")
    SubElement(platform, "scannerMount", x="0", y="0", z="0")
    leg = Element("leg")
    x, y, z = (float(value) for value in sensor.position)
    SubElement(leg, "platformSettings", words({"x": x, "y": y, "z": z}))
    start = float(azimuth[0]) - 90.0 - step  # the beam looks along +Y, and the first step is one on
    values = {
        "active": True,
        "pulseFreq_hz": columns,
        "scanFreq_hz": 0.0,
        "scanAngle_deg": 180.0,
        "headRotatePerSec_deg": step * columns,
        "headRotateStart_deg": start,
        "headRotateStop_deg": start + step * len(azimuth),
    }
    SubElement(leg, "scannerSettings", words(values))
    return scanner, platform, [leg]


def _strips(sensor: Airborne) -> tuple[Element, Element, list[Element]]:
    """Scanner, platform and legs of an aircraft whose mirror sweeps parallel lines."""
    low, high = sensor.field_deg
    half, middle = (high - low) / 2, np.deg2rad((low + high) / 2)
    scanner = _device(sensor, sensor.pulse_rate, half, sensor.line_rate)
    SubElement(scanner, "beamOrigin", x="0", y="0", z="0")
    platform = Element("platform", id="platform", name="aircraft", type="linearpath")
    # Theirs: X right, Y ahead, the mirror swings from Y to Z. Ours: X ahead, Y left, from nadir to the right.
    ahead = np.array([np.sin(middle), 0.0, -np.cos(middle)])
    beside = np.array([np.cos(middle), 0.0, np.sin(middle)])
    swung = Rotation.from_matrix(np.stack([np.cross(ahead, beside), ahead, beside], axis=1))
    roll, pitch, yaw = np.deg2rad(sensor.mount_deg)
    ours = Rotation.from_euler("ZYX", [yaw, -pitch, roll])
    turn = Rotation.from_euler("z", np.pi / 2)  # from ours to theirs
    mount = SubElement(platform, "scannerMount", x="0", y="0", z="0")
    rotated(mount, turn * ours * turn.inv() * swung)
    legs = []
    for start, stop in strips(sensor).position.reshape(-1, 2, 3):
        for place, active in ((start, True), (stop, False)):
            leg = Element("leg")
            x, y, z = place.tolist()
            where = {"x": x, "y": y, "z": z, "movePerSec_m": sensor.speed}
            SubElement(leg, "platformSettings", words(where))
            values = {
                "active": active,
                "pulseFreq_hz": sensor.pulse_rate,
                "scanFreq_hz": sensor.line_rate,
                "scanAngle_deg": half,
            }
            SubElement(leg, "scannerSettings", words(values))
            legs.append(leg)
    return scanner, platform, legs


def _rows(geometry: SceneGeometry, placed: list[PlacedPart]) -> list[dict[str, object]]:
    """Labels and places of the parts, for JSON."""
    found = []
    for part in placed:
        row = int(part.name)
        found.append(
            {
                "id": row,
                "file": part.file,
                "object": geometry.object_name[geometry.object_index[row]],
                "tree": int(geometry.tree[row]),
                "species": int(geometry.species[row]),
                "transform": part.transform.tolist(),
            }
        )
    return found


def _way(way: Trajectory) -> dict[str, object]:
    """A way for JSON: times, places, and attitudes as quaternions x, y, z, w."""
    _, attitude = way.at(way.time)
    return {
        "time_s": way.time.tolist(),
        "position_m": way.position.tolist(),
        "attitude_xyzw": attitude.as_quat().tolist(),
    }
