"""Intensities from settings: what a planting says, as one process on its field.

λ = (base + hills + rasters and paint that are added) · rasters that multiply, within the field's polygon,
the planting's polygon, its masks and its limits of slope and altitude; scaled to an expected number, or to a
mean density over the ground that these leave, where one is given.

Inputs of a stand besides its settings: rasters, painted meshes, lists of trees and the ground.

All are plain arrays, so files (``stand.files``) and objects of a Blender scene can fill them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from .. import spec
from ..formats.raster_file import GeoRaster
from ..spec import Allometry, Forest, Raster, Terrain
from .intensity.functions import (
    Constant,
    Intensity,
    Mask,
    Mixture,
    Painted,
    PaintedMesh,
    PixelMask,
    Polygon,
    Product,
    RasterIntensity,
    RasterMask,
    Sum,
    TerrainLimits,
)
from .intensity.surface import Flat, GroundSurface, IntensityError
from .layouts import Process


@dataclass(frozen=True)
class TreeList:
    """Trees that somebody has placed; what is None is drawn.

    position : (N, 2) metres, or (N, 3) where heights are given and count in place of the terrain's.
    species : (N,) names of plantings. scale : (N,), NaN where it is drawn.
    rotation : (N,) radians, NaN where it is drawn.
    measures : (N, 5) dbh, height, crown width, crown base and leaf area, NaN where they are drawn.
    said : sentences about how a file was read.
    """

    position: np.ndarray
    species: tuple[str, ...] | None = None
    scale: np.ndarray | None = None
    rotation: np.ndarray | None = None
    measures: np.ndarray | None = None
    said: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True)
class Inputs:
    """Everything by the name that the settings use.

    rasters : by ``Raster.file``, the first row the north edge; those that say where they lie in the scene's
    own metres.
    painted : by ``Planting.painted``. lists : by ``Planting.trees`` or ``Planting.collection``.
    terrain : the ground; None: flat at ``GroundSurface.base``. allometries : by ``Targets.allometry``.
    """

    rasters: Mapping[str, GeoRaster] = field(default_factory=dict)
    painted: Mapping[str, Painted] = field(default_factory=dict)
    lists: Mapping[str, TreeList] = field(default_factory=dict)
    terrain: GroundSurface | None = None
    allometries: Mapping[str, Allometry] = field(default_factory=dict)
    told: tuple[str, ...] = ()

    def ground(self, base: float) -> GroundSurface:
        """The ground, flat where no other is given."""
        return Flat(base) if self.terrain is None else self.terrain


def on_field(
    raster: GeoRaster, given: Raster | Terrain, forest: Forest
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest corner (2,) and extent (2,) of a raster, metres in the scene: as given, else as its file says,
    of an image as the field."""
    low, size = np.array(forest.origin), np.array(forest.size)
    if raster.transform is not None:
        low, high = raster.extent
        size = high - low
    if given.origin is not None:
        low = np.array(given.origin)
    return low, size if given.size is None else np.array(given.size)


def process_of(
    planting: spec.Planting, forest: spec.Forest, inputs: Inputs | None = None
) -> Process:
    """The Poisson process of a species.

    Raises
    ------
    IntensityError : nothing of the intensity lies on the field, so that it could be scaled; a raster,
    polygon or mesh that cannot be used.
    """
    inputs = inputs or Inputs()
    low, high = corners_of(forest)
    added, masks = _added(planting, forest, inputs), masks_of(planting, forest, inputs)
    parts: list[Intensity] = [
        added[0] if len(added) == 1 else Sum(tuple(added)),
        *(_raster(r, forest, inputs, planting) for r in planting.rasters if r.use == "multiply"),
        *masks,
    ]
    process = Process(_product(parts), low, high)
    wanted, asked = planting.expected, f"{planting.expected:g} trees" if planting.expected else ""
    if planting.density is not None:
        permitted = Process(_product(masks), low, high).expected if masks else area_of(forest)
        wanted = planting.density * permitted
        asked = f"{planting.density:g} trees/m²" if planting.density else ""
    if wanted is None:
        return process
    total = process.expected
    if total <= 0 and asked:
        what = "gaussians" if planting.gaussians and not planting.rasters else "intensity"
        raise IntensityError(
            f"{planting.species}: the {what} put nothing on the field, so {asked} "
            "cannot be expected there; move a centre or widen it"
        )
    return process.scaled(wanted / total if total > 0 else 0.0)


def _product(parts: Sequence[Intensity]) -> Intensity:
    return parts[0] if len(parts) == 1 else Product(tuple(parts))


def corners_of(forest: spec.Forest) -> tuple[np.ndarray, np.ndarray]:
    """(2,) corners of the field's rectangle, metres."""
    low = np.array(forest.origin)
    return low, low + np.array(forest.size)


def area_of(forest: spec.Forest) -> float:
    """m² of the field, within its polygon."""
    low, high = corners_of(forest)
    if not forest.polygon:
        return float(np.prod(high - low))
    return Polygon(forest.polygon, forest.holes, "forest.polygon").closed_integral(low, high)


def masks_of(planting: spec.Planting, forest: spec.Forest, inputs: Inputs) -> list[Mask]:
    """Part of the field's rectangle where a planting's trees may stand."""
    masks: list[Mask] = []
    for owner, name in ((forest, "forest.polygon"), (planting, f"{planting.species}: polygon")):
        if owner.polygon:
            masks.append(Polygon(owner.polygon, owner.holes, name))
    for raster in planting.rasters:
        if raster.use == "mask":
            image, low, size = _pixels(raster, forest, inputs, planting)
            if image.transform is not None:  # by whole pixels, which may be classes
                masks.append(PixelMask(image.pixels >= raster.threshold, low, size))
            else:
                values = RasterIntensity(image.pixels, low, size, raster.file)
                masks.append(RasterMask(values, raster.threshold))
    defaults = {f: spec.Planting.__dataclass_fields__[f].default for f in ("slope_deg", "altitude")}
    if any(getattr(planting, name) != default for name, default in defaults.items()):
        ground = inputs.ground(forest.terrain.base)
        steep = (np.deg2rad(planting.slope_deg[0]), np.deg2rad(planting.slope_deg[1]))
        masks.append(TerrainLimits(ground, steep, planting.altitude))
    return masks


def _added(planting: spec.Planting, forest: spec.Forest, inputs: Inputs) -> list[Intensity]:
    added: list[Intensity] = []
    if planting.base:
        added.append(Constant(planting.base))
    if planting.gaussians:
        added.append(
            Mixture(
                peak=np.array([g.peak for g in planting.gaussians]),
                centre=np.array([g.centre for g in planting.gaussians]),
                width=np.array([g.width for g in planting.gaussians]),
            )
        )
    added += [_raster(r, forest, inputs, planting) for r in planting.rasters if r.use == "add"]
    if planting.painted:
        painted = inputs.painted.get(planting.painted)
        if painted is None:
            raise IntensityError(
                f'{planting.species}: the painted mesh "{planting.painted}" is an object of a Blender '
                "scene, and there is none here; plant it within Blender, or use a raster"
            )
        added.append(PaintedMesh(painted, planting.painted_value, planting.painted))
    return added or [Constant(1.0)]


def _raster(
    raster: spec.Raster, forest: spec.Forest, inputs: Inputs, planting: spec.Planting
) -> Intensity:
    pixels, low, size = _pixels(raster, forest, inputs, planting)
    there = np.isfinite(pixels.pixels)
    if pixels.transform is None or there.all():
        return RasterIntensity(raster.value * pixels.pixels, low, size, raster.file)
    nearest = scipy.ndimage.distance_transform_edt(
        np.isnan(pixels.pixels), return_distances=False, return_indices=True
    )
    spread = np.nan_to_num(pixels.pixels[tuple(nearest)])
    filled = RasterIntensity(raster.value * spread, low, size, raster.file)
    return Product((filled, PixelMask(there, low, size)))


def _pixels(
    raster: spec.Raster, forest: spec.Forest, inputs: Inputs, planting: spec.Planting
) -> tuple[GeoRaster, np.ndarray, np.ndarray]:
    """A raster with its lowest corner (2,) and extent (2,) in the scene, metres."""
    pixels = inputs.rasters.get(raster.file)
    if pixels is None:
        raise IntensityError(f"{planting.species}: the raster {raster.file} was not read")
    return pixels, *on_field(pixels, raster, forest)
