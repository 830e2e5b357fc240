"""Scenes of HELIOS++: parts with scale, rotation and translation, on the ground if they ask, which may move.

A part is scaled, then turned, then moved, in whichever order its filters stand. It is loaded from OBJ files,
from a GeoTIFF of heights, or from a text of points or AMAPVox's voxels as boxes. With swaps in a part the
survey is played again, and another shape stands in its place. What is not supported is refused by name.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
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
from .parts import (
    Material,
    PartMesh,
    PartMotion,
    VoxelMode,
    read_materials,
    read_motion,
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

    later : what stands in its place when the survey is repeated (None: nothing), each for so many plays.
    """

    name: str
    mesh: PartMesh
    transform: np.ndarray
    motion: PartMotion | None = None
    later: tuple[tuple[Part | None, int], ...] = ()

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
        transform = self.transform.copy()
        transform[:, 3] += by
        later = tuple((part and part.shifted(by), plays) for part, plays in self.later)
        return replace(self, transform=transform, later=later)


@dataclass(frozen=True)
class _PartReader:
    """Folders of the files that a scene names, and meshes that were read."""

    path: Path
    assets: Path | None
    meshes: dict[tuple[Path, str], PartMesh]

    def obj(self, path: Path, up: str) -> PartMesh:
        if (path, up) not in self.meshes:
            self.meshes[path, up] = read_obj(path, up)
        return self.meshes[path, up]


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
    strange = strange_words(scene, path)
    parts: list[Part] = []
    reader = _PartReader(path, assets, {})
    elements = scene.findall("part")
    for index, element in enumerate(elements):
        parts.append(_part(element, index, reader, parts))
    if not parts:
        raise SpecError(str(path), "the scene has no part")
    strange += [note for mesh in reader.meshes.values() for note in mesh.notes]
    if scene.find(".//dmotion") is None:
        return tuple(parts), strange
    origin = np.min([part.corners.reshape(-1, 3).min(axis=0) for part in parts], axis=0)
    return tuple(
        replace(part, motion=read_motion(scene, element, origin, pulse_rate, path))
        for part, element in zip(parts, elements, strict=True)
    ), strange


@dataclass
class _Shape:
    """A part as its filters make it: loaders take another surface, turns add up, the rest replaces."""

    mesh: PartMesh | None = None
    scale: float = 1.0
    turn: Rotation = field(default_factory=Rotation.identity)
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    on_ground: bool = False

    def filtered(self, step: Element, where: str, reader: _PartReader) -> None:
        """Take a filter.

        Raises
        ------
        SpecError : one that is not supported, or a broken number.
        """
        kind = step.get("type", "").lower()
        params = {p.get("key", ""): p for p in step.findall("param")}
        if kind in LOADERS:
            self.mesh = _loaded(kind, params, where, reader)
        elif kind == "scale" and "scale" in params:
            self.scale = number(params["scale"], "value", reader.path) or self.scale
        elif kind == "rotate" and "rotation" in params:
            self.turn = rotation_of(params["rotation"], reader.path) * self.turn
        elif kind == "translate":
            self.shift = np.zeros(3)
            if "offset" in params:
                self.shift = vector(params["offset"].get("value", ""), reader.path)
            if "onGround" in params:
                self.on_ground = _stands(params["onGround"], reader.path)
        else:
            known = ", ".join(LOADERS)
            raise SpecError(
                where, f'filter "{kind}" is not supported; {known}, scale, rotate and translate are'
            )

    def part(self, name: str, before: list[Part], path: Path) -> Part:
        """The part, on the ground of those before it if it is to stand there."""
        if self.mesh is None:
            raise SpecError(
                f"{path}, part {name}", f"has no loader; give one of {', '.join(LOADERS)}"
            )
        transform = np.column_stack([self.turn.as_matrix() * self.scale, self.shift])
        part = Part(name, self.mesh, transform)
        return _lowered(part, before, path) if self.on_ground else part


def _part(element: Element, index: int, reader: _PartReader, before: list[Part]) -> Part:
    name = element.get("id", f"part{index}")
    where = f"{reader.path}, part {element.get('id', index)}"
    swaps = _in_order(element.findall("swap"), where, reader.path)
    if swaps and element.find("dmotion") is not None:
        raise SpecError(where, "moves (dmotion) and is swapped (swap); only one is supported")
    shape = _Shape()
    for step in element.findall("filter"):
        shape.filtered(step, where, reader)
    baseline = shape.mesh
    if baseline is not None and baseline.hazes and element.find("dmotion") is not None:
        raise SpecError(
            where,
            "moves (dmotion), and light passes its voxels by chance; set "
            "intersectionMode to fixed or scaled",
        )
    part = shape.part(name, before, reader.path)
    later: list[tuple[Part | None, int]] = []
    for swap, plays in swaps:
        if swap is None:
            later.append((part, plays))
            continue
        steps = swap.findall("filter")
        if yes(swap.get("force_null"), False):
            later.append((None, plays))
            continue
        if not steps:
            raise SpecError(where, "has a swap without filters; give some, or force_null")
        if steps[0].get("type", "").lower() not in LOADERS:
            shape.mesh = baseline
        for step in steps:
            shape.filtered(step, where, reader)
        later.append((shape.part(name, before, reader.path), plays))
    return replace(part, later=tuple(later))


def _in_order(swaps: list[Element], where: str, path: Path) -> list[tuple[Element | None, int]]:
    """Swaps as they are played, and how many plays each lasts; None: the part as it was at first.

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
        return list(zip(swaps, steps, strict=True))
    whose: dict[int, Element] = {}
    for swap in swaps:
        text = swap.get("swapIndices", "")
        try:
            plays = [int(one) for one in text.strip().strip("[]").split(",")]
        except ValueError:
            raise SpecError(where, f'swapIndices = "{text}" is no list as [1, 2]') from None
        if plays != list(range(plays[0], plays[0] + len(plays))) or plays[0] < 1:
            raise SpecError(where, f"swapIndices = {text}: plays on end from 1 are supported")
        if whose.keys() & set(plays):
            raise SpecError(where, f"swapIndices = {text} names a play of another swap")
        whose.update(dict.fromkeys(plays, swap))
    order: list[tuple[Element | None, int]] = []
    for play in range(1, max(whose) + 1):
        swap_of = whose.get(play, order[-1][0] if order else None)
        if order and order[-1][0] is swap_of:
            order[-1] = (swap_of, order[-1][1] + 1)
        else:
            order.append((swap_of, 1))
    return order


def _stands(param: Element, path: Path) -> bool:
    """Return whether a part is to stand on the ground: a word, or any number but 0."""
    words = {"true": True, "false": False}
    said = words.get(param.get("value", "").lower())
    return number(param, "value", path) != 0 if said is None else said


def _loaded(kind: str, params: dict[str, Element], where: str, reader: _PartReader) -> PartMesh:
    """The surface that a loader of a part makes."""

    def said(key: str, otherwise: str = "") -> str:
        return params[key].get("value", otherwise) if key in params else otherwise

    up = said("up", "z")
    if up not in ("y", "z"):
        raise SpecError(where, f'up = "{up}" is not y or z')
    if said("efilepath"):
        files = find_files(said("efilepath"), reader.path, reader.assets)
    elif said("filepath"):
        files = [find_file(said("filepath"), reader.path, reader.assets)]
    else:
        raise SpecError(where, f"its {kind} names no file (filepath)")
    if kind == "objloader":
        return together([reader.obj(file, up) for file in files])
    material = _material_of(said("matfile"), said("matname"), where, reader)
    if kind == "geotiffloader":
        return together([read_terrain(file, material) for file in files])
    if kind == "detailedvoxels":
        mode = said("intersectionMode", "transmittive").lower()
        if mode not in VOXEL_MODES:
            known = ", ".join(VOXEL_MODES)
            raise SpecError(where, f'intersectionMode = "{mode}" is not supported; {known} are')
        power = 0.5
        if "intersectionArgument" in params:
            power = number(params["intersectionArgument"], "value", reader.path)
        ways = VoxelMode(mode, power, yes(said("randomShift") or None, False))
        return together([read_voxels(file, ways, material) for file in files])
    size = number(params["voxelSize"], "value", reader.path) if "voxelSize" in params else 1.0
    fewest = 3 if said("estimateNormals", "0") != "0" and "defaultNormal" not in params else 1
    return together(
        [read_points(file, said("separator", " "), size, material, fewest) for file in files]
    )


def _material_of(file: str, name: str, where: str, reader: _PartReader) -> Material:
    """The material that a loader names; without one it is ground, as in HELIOS++.

    Raises
    ------
    SpecError : there is no such material.
    """
    if not file:
        return Material(ground=True)
    known = read_materials(find_file(file, reader.path, reader.assets))
    if name and name not in known:
        raise SpecError(where, f'matname = "{name}" is not in {file}')
    return known[name] if name else next(iter(known.values()), Material())


def _lowered(part: Part, before: list[Part], path: Path) -> Part:
    """The part with its lowest corner on the ground of the parts before it."""
    corners = part.corners.reshape(-1, 3)
    lowest = corners[np.argmin(corners[:, 2])]
    height = ground_height(before, lowest[0], lowest[1])
    if height is None:
        raise SpecError(str(path), f"{part.name} is to stand on the ground, but none is below it")
    return part.shifted(np.array([0.0, 0.0, height - lowest[2]]))


def plays_of(parts: tuple[Part, ...]) -> list[tuple[Part, ...]]:
    """The parts of each play of a survey: one, and one more for each play that a swap lasts (Esmorís et al.
    2024: geometry swaps on repeat)."""
    count = 1 + max(sum(plays for _, plays in part.later) for part in parts)
    shown = []
    for part in parts:
        row: list[Part | None] = [part]
        for other, plays in part.later:
            row += [other] * plays
        shown.append(row + row[-1:] * (count - len(row)))
    return [tuple(p for p in play if p is not None) for play in zip(*shown, strict=True)]


def ground_height(parts: tuple[Part, ...] | list[Part], x: float, y: float) -> float | None:
    """Height of the highest ground (``helios_isGround``) at a place, metres; None where there is none."""
    best: float | None = None
    for part in parts:
        a, b, c = np.moveaxis(part.corners[part.mesh.ground], 1, 0)
        u, v, away = b - a, c - a, np.array([x, y]) - a[:, :2]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (away[:, 0] * v[:, 1] - away[:, 1] * v[:, 0]) / area
            t = (u[:, 0] * away[:, 1] - u[:, 1] * away[:, 0]) / area
            inside = (area != 0) & (s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9)
        if inside.any():
            height = float((a[:, 2] + s * u[:, 2] + t * v[:, 2])[inside].max())
            best = height if best is None else max(best, height)
    return best
