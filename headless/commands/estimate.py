"""``python -m headless estimate``: a map of trees becomes a scene whose forests are like the site.

Written beside each other: the scene (TOML), for kernel estimates one array a species (npy), and a picture
of trees, estimated intensity and what the statistics say.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.formats.atomic import replacing
from forest_addon.formats.ownership import claim
from forest_addon.formats.raster_file import GeoRaster, read_raster
from forest_addon.formats.toml_file import write_settings
from forest_addon.formats.tree_map import read_rings, read_tree_map
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import Kind, draw_diameters, middle
from forest_addon.spec import Forest, Gaussian, Normal, Planting, Raster, Scene, SpecError, Targets
from forest_addon.stand.compose import Inputs, process_of
from forest_addon.stand.files import read_terrain, refuse_sizes
from forest_addon.stand.layouts import sample
from forest_addon.stand.statistics.intensity import (
    FittedMixture,
    KernelEstimate,
    Window,
    fit_mixture,
    kernel_estimate,
)
from forest_addon.stand.statistics.law import (
    ACCEPTED,
    ChosenLaw,
    Estimate,
    Goodness,
    MappedSpecies,
    choose_law,
    examine,
    law_of,
)

from ..command import PROGRAM, species_of_map
from ..report import can_draw, without


def run(chosen: argparse.Namespace) -> None:
    """Make a scene of a map, or of bare ground."""
    if chosen.map is None:
        scene_on(chosen.terrain, chosen.out, chosen.crs)
        return
    estimate_site(
        chosen.map,
        chosen.out,
        chosen.method,
        chosen.window,
        chosen.species,
        law=chosen.law,
        crs=chosen.crs,
        terrain=chosen.terrain,
    )


WIDEST = 100.0  # metres of a field on a terrain without a map of trees
FAR = 10_000.0  # metres from the origin beyond which coordinates are kept as an offset
FEW = 5  # trees with both measures that move a law of heights
PICTURE = "-estimate.png"  # after the scene's name
HIGHEST = 1e5  # trees/m² of a peak that is written; only ratios count beside an expected number


def estimate_site(
    path: Path,
    out: Path,
    method: str = "mixture",
    window: Sequence[str] = (),
    species: Sequence[str] = (),
    say: Say = print,
    law: str = "auto",
    crs: str = "",
    terrain: Path | None = None,
) -> Path:
    """Estimate a site from a table of trees; returns the scene file.

    window : four numbers x0 y0 x1 y1, or a CSV of corners; none: around the trees. species : pairs
    "name in the CSV=preset or species file", or one preset for all trees. law : "auto" chooses among
    Poisson, groups and repulsion by their tests (``choose_law``), or the name of one. crs : of the scene, to
    which degrees are projected. terrain : the ground that they stand on.

    Raises
    ------
    SpecError : the map, the window, a species or the law cannot be used.
    """
    if method == "kernel" and law not in ("auto", "poisson"):
        raise SpecError("--law", f"{law} goes with --method mixture; a kernel estimate is Poisson")
    trees = read_tree_map(path, crs)
    if not len(trees):
        raise SpecError(str(path), "has no trees below its header; give one a row")
    refuse_sizes(path, trees)
    frame = _window(window) if window else Window.around(trees.position)
    outside = np.flatnonzero(~frame.contains(trees.position))
    if len(outside):
        x, y = trees.position[outside[0]]
        others = f", as do {len(outside) - 1:,} more" if len(outside) > 1 else ""
        raise SpecError(
            str(path),
            f"row {trees.line[outside[0]]}: the tree at ({x:.10g}, {y:.10g}) lies outside the window"
            f"{others}; leave it out, or widen --window",
        )
    kinds = species_of_map(np.unique(trees.species).tolist(), species, out.parent)
    ends = ("-allometry.toml", ".npy") if method == "kernel" else ("-allometry.toml",)
    own = [f"-{_plain(name or kind)}{end}" for name, kind in kinds.items() for end in ends]
    claim(out, *(out.with_name(out.stem + end) for end in (PICTURE, *own)))
    offset = np.floor(frame.low) if np.abs(frame.high).max() > FAR else np.zeros(2)
    frame = Window(tuple(ring - offset for ring in frame.rings))
    field = _field(frame)

    for line in trees.said:
        say(line)
    kept = f"; coordinates are kept from ({offset[0]:.0f}, {offset[1]:.0f})" if offset.any() else ""
    say(f"{path.name}: {len(trees):,} trees on {frame.area:,.0f} m²{kept}")
    shown, plantings = [], []
    arrays: dict[str, np.ndarray] = {}
    out.parent.mkdir(parents=True, exist_ok=True)
    for name, kind in kinds.items():
        own = trees.species == name
        points = trees.position[own] - offset
        mapped = MappedSpecies(name or kind, points, frame, field)
        file = f"{out.stem}-{_plain(name or kind)}.npy"
        estimate, planting, goodness, rasters = _grown(mapped, kind, method, law, file, say)
        targets = _targets(kind, out, _plain(name or kind), trees.numbers[own], say)
        plantings.append(planting.changed(targets=targets))
        shown.append((mapped.name, points, estimate.at, goodness))
        arrays |= rasters

    for file, pixels in arrays.items():
        with replacing(out.parent / file) as written:
            np.save(written, pixels)
    scene = Scene(
        name=out.stem,
        seed=1,
        offset=(float(offset[0]), float(offset[1]), 0.0),
        crs=trees.crs,
        forest=field,
        plantings=tuple(plantings),
    )
    if terrain is not None:
        scene = _on_terrain(scene, terrain, out, say)
    with replacing(out) as written:
        _write_scene(written, scene, f"{path.name}, {method}", trees.position)
    written = [str(out), *arrays]
    if can_draw():
        from forest_addon.drawing.figures import save_figure
        from forest_addon.drawing.stands import draw_site

        picture = save_figure(draw_site(shown, frame), out.with_name(out.stem + PICTURE))
        written.append(picture.name)
    else:
        say(without("The picture is left out"))
    say(f"Wrote {', '.join(written)}.")
    say(f"Next: {PROGRAM} run {out}")
    return out


def scene_on(terrain: Path, out: Path, crs: str = "", say: Say = print) -> Path:
    """Write a scene of bare ground in the middle of a terrain's file, with the offset that puts it there.

    Raises
    ------
    SpecError : the file cannot be used, or does not say where it lies.
    """
    raster = read_raster(terrain)
    if raster.transform is None:
        raise SpecError(str(terrain), "does not say where it lies; give a GeoTIFF or an ASCII grid")
    low, high = raster.extent
    turned = 2.0 if raster.transform[[0, 1], [1, 0]].any() else 1.0
    side = float(min(WIDEST, *np.floor((high - low) / turned)))
    east, north = np.round((low + high - side) / 2, 3 if side < WIDEST else 0).tolist()
    field = Forest(size=(side, side))
    out.parent.mkdir(parents=True, exist_ok=True)
    scene = Scene(name=out.stem, offset=(east, north, 0.0), crs=crs, forest=field)
    write_settings(out, _on_terrain(scene, terrain, out, say))
    say(f"Wrote {out}. Plant it with [[plantings]], then: {PROGRAM} run {out}")
    return out


def _on_terrain(scene: Scene, terrain: Path, out: Path, say: Say) -> Scene:
    """The scene with a terrain, which is tried; says what it was read as."""
    ground = scene.forest.terrain.changed(
        file=Path(os.path.relpath(terrain, out.parent)).as_posix()
    )
    scene = scene.changed(forest=scene.forest.changed(terrain=ground))
    say(read_terrain(scene, out.parent)[1])
    return scene


def _targets(kind: str, out: Path, name: str, numbers: np.ndarray, say: Say) -> Targets | None:
    """Diameters and heights of a map's trees (N, 7) as targets of what is planted; None without either.

    Heights that the map gives move the law of the species, which is written beside the scene.
    """
    measured = numbers[:, 2:]
    told = np.isfinite(measured).any(axis=1)
    if not told.any():
        return None
    species, files = load_species(find_species(kind, out.parent))
    law = files.allometry if isinstance(files, Kind) else None
    if law is None or species.targets is None:
        say(
            f"  {name}: dbh and height are left out; {kind} grows by its rules alone, without allometry"
        )
        return None
    even = (np.argsort(np.argsort(measured[told, 1])) + 0.5) / told.sum()
    dbh = np.where(
        np.isfinite(measured[told, 0]),
        measured[told, 0],
        draw_diameters(law, measured[told, 1:], even),
    )
    file = species.targets.allometry
    off = np.log(measured[told, 1]) - middle(law.height, dbh)
    off = off[np.isfinite(off) & np.isfinite(measured[told, 0])]
    if len(off) >= FEW:
        low, half, high = np.quantile(off, [0.05, 0.5, 0.95])
        height = law.height.changed(
            intercept=law.height.intercept + float(half),
            low=float(min(low - half, -1e-3)),
            high=float(max(high - half, 1e-3)),
            trees=len(off),
            of=out.stem,
        )
        file = f"{out.stem}-{name}-allometry.toml"
        write_settings(out.parent / file, law.changed(height=height))
    mean, sd, low, high = np.round([dbh.mean(), dbh.std(), dbh.min(), dbh.max()], 6).tolist()
    spread = Normal(mean=mean, sd=sd, low=low, high=high)
    say(f"  {name}: dbh of {spread.mean:.2g} ± {spread.sd:.2g} m, heights by {file}")
    return Targets(allometry=file, dbh=spread)


def _grown(
    mapped: MappedSpecies, kind: str, method: str, law: str, file: str, say: Say
) -> tuple[Estimate, Planting, Goodness | None, dict[str, np.ndarray]]:
    """Estimates of a species' trees, and the arrays that its planting reads."""
    points, frame = mapped.points, mapped.window
    estimate = fit_mixture(points, frame) if method == "mixture" else kernel_estimate(points, frame)
    planting, inputs = _planting(kind, estimate, file)
    process = process_of(planting, mapped.field, inputs)
    fitness = examine(
        points,
        frame,
        law_of(
            estimate,
            lambda number: sample(process, stream(0, "goodness", mapped.name, number)),
        ),
    )
    others: list[ChosenLaw] = []
    if isinstance(estimate, FittedMixture):
        by_chance = ChosenLaw("poisson", estimate, planting, fitness)
        try:
            taken, *others = choose_law(mapped, by_chance, estimate, law)
        except ValueError as problem:
            raise SpecError("--law", f"{mapped.name}: {problem}") from None
        estimate, planting, fitness = taken.estimate, taken.planting, taken.goodness
    what = f"{mapped.name} as {planting.species}: {len(points):,} {'tree' if len(points) == 1 else 'trees'}"
    say(f"  {what}, {_summary(estimate, planting, fitness)}")
    if others:
        say(f"    tried too: {', '.join(_words(one) for one in others)}")
    rasters = {file: raster.pixels for file, raster in inputs.rasters.items()}
    return estimate, planting, fitness, rasters


def _window(words: Sequence[str]) -> Window:
    try:
        if len(words) == 1:
            return Window(tuple(read_rings(Path(words[0]))))
        corners = [float(word) for word in words]
        if len(corners) != 4 or not (corners[0] < corners[2] and corners[1] < corners[3]):
            raise ValueError("give X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, or one CSV of corners")
        return Window.rectangle(corners[:2], corners[2:])
    except SpecError:
        raise
    except ValueError as problem:
        raise SpecError("--window", str(problem)) from None


def _field(window: Window) -> Forest:
    corners = [tuple(tuple(map(float, corner)) for corner in ring) for ring in window.rings]
    polygon = {} if window.is_rectangle else {"polygon": corners[0], "holes": tuple(corners[1:])}
    low, high = np.floor(1e6 * window.low) / 1e6, np.ceil(1e6 * window.high) / 1e6
    origin, size = (tuple(side.round(6).tolist()) for side in (low, high - low))
    return Forest(origin=origin, size=size, **polygon)


def _planting(kind: str, estimate: Estimate, file: str) -> tuple[Planting, Inputs]:
    """The settings of a species, and the array that they name."""
    if isinstance(estimate, KernelEstimate):
        pixels = np.ascontiguousarray(estimate.pixels[::-1])  # north first
        raster = Raster(file=file)
        planting = Planting(species=kind, expected=len(estimate.leave_one_out), rasters=(raster,))
        return planting, Inputs(rasters={file: GeoRaster(pixels)})
    shown = min(1.0, HIGHEST / max(estimate.peak.max(initial=0.0), 1e-300))
    hills = tuple(
        Gaussian(
            peak=float(peak * shown),
            centre=tuple(map(float, centre)),
            width=tuple(map(float, width)),
        )
        for peak, centre, width in zip(estimate.peak, estimate.centre, estimate.width, strict=True)
    )
    base = float(estimate.base * shown) if hills else 0.0
    return (
        Planting(species=kind, expected=float(estimate.trees), base=base, gaussians=hills),
        Inputs(),
    )


def _summary(estimate: Estimate, planting: Planting, goodness: Goodness | None) -> str:
    """Return what was estimated of a species and what its tests say, in words."""
    if isinstance(estimate, FittedMixture):
        count = len(estimate.peak)
        text = f"{count} hill{'s' * (count != 1)}" if count else "the same everywhere"
        if count and estimate.base:
            text += f" over {estimate.base * 1e4:.3g} trees/ha"
        text += f", BIC {estimate.bic:,.1f}"
    else:
        text = f"kernel of {estimate.bandwidth:.3g} m"
    if planting.layout == "clusters":
        groups = planting.clusters
        wide = "σ" if groups.kind == "thomas" else "radius"
        text += (
            f", in {groups.groups * 1e4:.3g} {groups.kind.capitalize()} groups/ha, "
            f"{wide} {groups.spread:.3g} m"
        )
    elif planting.layout == "strauss":
        strauss = planting.strauss
        text += f", keeping apart within {strauss.radius:.3g} m (Strauss, γ = {strauss.gamma:.2g})"
    if goodness is None:
        return text + "; too few trees to test"
    tests = goodness.excess.p_value, goodness.quadrat_p_value
    text += f"; L p = {tests[0]:.3f}, quadrats p = {tests[1]:.3f}: "
    if min(tests) > ACCEPTED:
        return text + "stands of this law are like the map"
    text += "no law that was tried is like this map, the scene has the nearest"
    return text


def _words(law: ChosenLaw) -> str:
    hills = len(law.estimate.peak)
    over = f" over {hills} hill{'s' * (hills != 1)}" if hills else ""
    return f"{law.name}{over} p = {law.p_value:.3f}"


def _write_scene(path: Path, scene: Scene, source: str, positions: np.ndarray) -> None:
    """Write a scene below notes on where it comes from, and on how near trees stand."""
    places = np.unique(positions, axis=0)
    nearest = cKDTree(places).query(places, k=2)[0][:, 1].min() if len(places) > 1 else 0.0
    write_settings(path, scene)
    notes = (
        f"# Estimated from {source}, by python -m headless estimate. The nearest two trees of the site\n"
        f"# stand {nearest:.3g} m apart; spacing keeps a distance. offset is added to what is written.\n"
    )
    path.write_text(notes + path.read_text("utf-8"), encoding="utf-8")


def _plain(name: str) -> str:
    """A name that a file may have."""
    return re.sub(r"[^\w-]+", "-", name)
