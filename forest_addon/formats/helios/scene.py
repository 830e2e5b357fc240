"""Scenes of HELIOS++: parts with scale, rotation and translation, on the ground if they ask, which may move.

A part is scaled, then turned, then moved, in whichever order its filters stand. It is loaded from OBJ files,
from a GeoTIFF of heights, or from a text of points or AMAPVox's voxels as boxes. With swaps in a part the
survey is played again, and another shape stands in its place. What is not supported is refused by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from .document import (
    asset_of,
    find_file,
    find_files,
    number,
    rotation_of,
    strange_words,
    vector,
    yes,
)
from .motion import PartMotion, read_motion
from .parts import (
    Material,
    PartMesh,
    read_materials,
    read_obj,
    read_points,
    read_terrain,
    read_voxels,
    together,
)

VOXEL_MODES = ("fixed", "scaled", "transmittive")
LOADERS = ("objloader", "geotiffloader", "xyzloader", "detailedvoxels")


@dataclass(frozen=True)
class Part:
    """Part of a scene: a surface, where it is, (3, 4) local to world, and how it moves; None: it stands.

    later : what stands in its place in each further play of the survey (None: nothing).
    """

    name: str
    mesh: PartMesh
    transform: np.ndarray
    motion: PartMotion | None = None
    later: tuple[Part | None, ...] = ()

    @property
    def corners(self) -> np.ndarray:
        """(T, 3, 3) corners of the triangles in the world, metres."""
        turned = self.mesh.vertices @ self.transform[:, :3].T + self.transform[:, 3]
        return np.asarray(turned[self.mesh.triangles])

    @property
    def middle(self) -> np.ndarray:
        """(3,) metres, middle of the box around it in the world."""
        corners = self.corners
        return np.asarray((corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2)

    def shifted(self, by: np.ndarray) -> Part:
        """The part moved by (3,) metres; one that moves is not to be moved so."""
        transform = self.transform + np.column_stack([np.zeros((3, 3)), by])
        return replace(self, transform=transform)


def read_scene(
    reference: str, near: Path, assets: Path | None = None, pulse_rate: float = 1.0
) -> tuple[tuple[Part, ...], list[str]]:
    """The parts of the scene "FILE.xml#ID", and sentences on what is passed over.

    pulse_rate : Hz, of the first leg, by which parts move that state a step in seconds.

    Raises
    ------
    SpecError : it cannot be read, or holds what is not supported.
    """
    scene, path = asset_of(reference, "scene", near, assets)
    strange, reader = strange_words(scene, path), _PartReader(path, assets)
    elements = scene.findall("part")
    for index, element in enumerate(elements):
        reader.parts.append(reader.part(element, index))
    parts = tuple(reader.parts)
    if not parts:
        raise SpecError(str(path), "the scene has no part")
    strange += [note for mesh in reader.meshes.values() for note in mesh.notes]
    if scene.find(".//dmotion") is None:
        return parts, strange
    origin = np.min([part.corners.min(axis=(0, 1)) for part in parts], axis=0)
    return tuple(
        replace(part, motion=read_motion(scene, element, origin, pulse_rate, path))
        for part, element in zip(parts, elements, strict=True)
    ), strange


class _PartReader:
    """Reads parts of a scene; keeps those before, which are the ground of others, and surfaces that were
    loaded."""

    def __init__(self, path: Path, assets: Path | None) -> None:
        self.path, self.assets = path, assets
        self.parts: list[Part] = []
        self.meshes: dict[tuple[object, ...], PartMesh] = {}

    def part(self, element: Element, index: int) -> Part:
        """A part with what stands in its place later.

        Raises
        ------
        SpecError : filters or swaps that are not supported.
        """
        name, where = (
            element.get("id", f"part{index}"),
            f"{self.path}, part {element.get('id', index)}",
        )
        swaps, moves = element.findall("swap"), element.find("dmotion") is not None
        if swaps and moves:
            raise SpecError(where, "moves (dmotion) and is swapped (swap); only one is supported")
        filters = element.findall("filter")
        loaders = [step for step in filters if _kind(step) in LOADERS]
        part = self._shape(name, where, filters)
        if part.mesh.hazes and moves:
            raise SpecError(
                where,
                "moves (dmotion), and light passes its voxels by chance; set "
                "intersectionMode to fixed or scaled",
            )
        later: list[Part | None] = []
        shapes: dict[int, Part | None] = {-1: part}
        for swap in _in_order(swaps, where, self.path):
            if swap not in shapes:
                steps = swaps[swap].findall("filter")
                shapes[swap] = None
                if not yes(swaps[swap].get("force_null"), False):
                    if not steps:
                        raise SpecError(
                            where, "has a swap without filters; give some, or force_null"
                        )
                    # It goes on from the part before, but for its surface, which is that of the first.
                    filters += steps if _kind(steps[0]) in LOADERS else [*loaders, *steps]
                    shapes[swap] = self._shape(name, where, filters)
            later.append(shapes[swap])
        return replace(part, later=tuple(later))

    def _shape(self, name: str, where: str, filters: list[Element]) -> Part:
        """A part as its filters make it: loaders take another surface, turns add up, the rest replaces."""
        mesh: PartMesh | None = None
        scale, turn, shift, on_ground = 1.0, Rotation.identity(), np.zeros(3), False
        for step in filters:
            kind = _kind(step)
            params = {p.get("key", ""): p for p in step.findall("param")}
            if kind in LOADERS:
                key = kind, *((k, p.get("value")) for k, p in sorted(params.items()))
                if key not in self.meshes:
                    self.meshes[key] = self._loaded(kind, params, where)
                mesh = self.meshes[key]
            elif kind == "scale" and "scale" in params:
                scale = number(params["scale"], "value", self.path) or scale
            elif kind == "rotate" and "rotation" in params:
                turn = rotation_of(params["rotation"], self.path) * turn
            elif kind == "translate":
                shift = np.zeros(3)
                if "offset" in params:
                    shift = vector(params["offset"].get("value", ""), self.path)
                if "onGround" in params:  # a word, or any number but 0
                    stands = params["onGround"].get("value", "").lower()
                    on_ground = stands == "true" or (
                        stands != "false" and number(params["onGround"], "value", self.path) != 0
                    )
            else:
                known = f"{', '.join(LOADERS)}, scale, rotate and translate are"
                raise SpecError(where, f'filter "{kind}" is not supported; {known}')
        if mesh is None:
            raise SpecError(
                f"{self.path}, part {name}", f"has no loader; give one of {', '.join(LOADERS)}"
            )
        part = Part(name, mesh, np.column_stack([turn.as_matrix() * scale, shift]))
        if not on_ground:
            return part
        corners = part.corners.reshape(-1, 3)
        lowest = corners[np.argmin(corners[:, 2])]
        height = ground_height(self.parts, lowest[0], lowest[1])
        if height is None:
            raise SpecError(
                str(self.path), f"{name} is to stand on the ground, but none is below it"
            )
        return part.shifted(np.array([0.0, 0.0, height - lowest[2]]))

    def _loaded(self, kind: str, params: dict[str, Element], where: str) -> PartMesh:
        """The surface that a loader of a part makes."""
        said = {"up": "z", "separator": " ", "intersectionMode": "transmittive"}
        said |= {key: element.get("value", "") for key, element in params.items()}
        path, assets = self.path, self.assets
        if said["up"] not in ("y", "z"):
            raise SpecError(where, f'up = "{said["up"]}" is not y or z')
        if said.get("efilepath"):
            files = find_files(said["efilepath"], path, assets)
        elif said.get("filepath"):
            files = [find_file(said["filepath"], path, assets)]
        else:
            raise SpecError(where, f"its {kind} names no file (filepath)")
        if kind == "objloader":
            return together([read_obj(file, said["up"]) for file in files])
        material = self._material(said.get("matfile", ""), said.get("matname", ""), where)
        if kind == "geotiffloader":
            return together([read_terrain(file, material) for file in files])

        def value(key: str, otherwise: float) -> float:
            return number(params[key], "value", path) if key in params else otherwise

        if kind == "detailedvoxels":
            mode = said["intersectionMode"].lower()
            if mode not in VOXEL_MODES:
                known = ", ".join(VOXEL_MODES)
                raise SpecError(where, f'intersectionMode = "{mode}" is not supported; {known} are')
            ways = mode, value("intersectionArgument", 0.5), yes(said.get("randomShift"), False)
            return together([read_voxels(file, material, *ways) for file in files])
        estimated = said.get("estimateNormals", "0") != "0" and "defaultNormal" not in params
        given = said["separator"], value("voxelSize", 1.0), material, 3 if estimated else 1
        return together([read_points(file, *given) for file in files])

    def _material(self, file: str, name: str, where: str) -> Material:
        """The material that a loader names; without one it is ground, as in HELIOS++.

        Raises
        ------
        SpecError : there is no such material.
        """
        if not file:
            return Material(ground=True)
        known = read_materials(find_file(file, self.path, self.assets))
        if name and name not in known:
            raise SpecError(where, f'matname = "{name}" is not in {file}')
        return known[name or next(iter(known))]


def _kind(step: Element) -> str:
    return step.get("type", "").lower()


def _in_order(swaps: list[Element], where: str, path: Path) -> list[int]:
    """Number of the swap in each play after the first; -1: the part as it was at first.

    They follow each other (``swapStep``), or say which plays are theirs, the first after the baseline being 1
    (``swapIndices``); in plays that none names the one before stands.

    Raises
    ------
    SpecError : a step below 1, plays that are no list of such, that two name, or that are not on end.
    """
    if not any(swap.get("swapIndices") for swap in swaps):
        steps = [int(number(swap, "swapStep", path, 1.0)) for swap in swaps]
        if min(steps, default=1) < 1:
            raise SpecError(where, f"swap has swapStep = {min(steps)}; it is at least 1")
        return [which for which, plays in enumerate(steps) for _ in range(plays)]
    whose: dict[int, int] = {0: -1}
    for which, swap in enumerate(swaps):
        text = swap.get("swapIndices", "")
        try:
            plays = [int(one) for one in text.strip().strip("[]").split(",")]
        except ValueError:
            raise SpecError(where, f'swapIndices = "{text}" is no list as [1, 2]') from None
        if plays != list(range(plays[0], plays[0] + len(plays))) or plays[0] < 1:
            raise SpecError(where, f"swapIndices = {text}: plays on end from 1 are supported")
        if whose.keys() & set(plays):
            raise SpecError(where, f"swapIndices = {text} names a play of another swap")
        whose.update(dict.fromkeys(plays, which))
    for play in range(1, max(whose) + 1):
        whose.setdefault(play, whose[play - 1])
    return [whose[play] for play in range(1, max(whose) + 1)]


def plays_of(parts: Sequence[Part]) -> list[tuple[Part, ...]]:
    """The parts of each play of a survey: one, and one more for each play that a swap lasts (Esmorís et al.
    2024: geometry swaps on repeat); after its last a part stays as it is."""
    count = 1 + max(len(part.later) for part in parts)
    shown = [[part, *part.later] for part in parts]
    shown = [[*row, *row[-1:] * (count - len(row))] for row in shown]
    return [tuple(p for p in play if p is not None) for play in zip(*shown, strict=True)]


def ground_height(parts: Sequence[Part], x: float, y: float) -> float | None:
    """Height of the highest ground (``helios_isGround``) at a place, metres; None where there is none."""
    corners = [part.corners[part.mesh.ground] for part in parts]
    a, b, c = np.moveaxis(np.concatenate([np.empty((0, 3, 3)), *corners]), 1, 0)
    u, v, away = b - a, c - a, np.array([x, y]) - a[:, :2]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (away[:, 0] * v[:, 1] - away[:, 1] * v[:, 0]) / area
        t = (u[:, 0] * away[:, 1] - u[:, 1] * away[:, 0]) / area
        inside = (area != 0) & (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9)
        height = (a[:, 2] + s * u[:, 2] + t * v[:, 2])[inside]
    return float(height.max()) if len(height) else None
