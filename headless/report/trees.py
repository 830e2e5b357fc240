"""Pictures of trees (species on a contact sheet, a user's tree with what was recognised and grown of it), and
how like the tree its siblings are, in a table and in what sensors make of them; pictures of flights.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from forest_addon.base.places import file_name
from forest_addon.base.progress import Say
from forest_addon.base.trimesh import GROUND, LEAF, WOOD, TriMesh, join
from forest_addon.blender.rays.casters import make_caster
from forest_addon.drawing.figures import STYLE, blank_figure, figure_on, save_figure
from forest_addon.drawing.palette import (
    BLUE,
    FAINT,
    INK,
    LEAF_GREEN,
    LINES,
    PAPER,
    RED,
    VIOLET,
    rgb,
)
from forest_addon.flight.flying import interval
from forest_addon.flight.top_view import TopView
from forest_addon.formats.atomic import replacing
from forest_addon.growth.likeness import BINS, Likeness, Portrait, compare, crown_width, portray
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.own_tree.recognise import Recognition
from forest_addon.growth.tree import Tree
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Look, Rays, Sonar, Species

TREE = 800  # pixels that a tree of a sheet has
ICON = 192  # pixels along a side of a small picture
WIDTH = 2100  # pixels of the picture of brought, rebuilt and siblings
TRUNK, DOUBT = "#4a3526", "#d22f27"
RING: dict[str, Any] = {
    "marker": "o",
    "markersize": 14,
    "markerfacecolor": "none",
    "markeredgecolor": DOUBT,
    "markeredgewidth": 1.6,
    "linestyle": "none",
}
MOST_RINGS = 60
MOST_DRAWN = 400_000  # facets


def draw_sheet(grown: Sequence[tuple[Species, Tree]], path: Path, pixels: int = TREE) -> Path:
    """The contact sheet: a render of all trees with a name and a scale below each.

    pixels : width of a tree's cell.
    """
    columns = max(1, min(6, round(math.sqrt(1.6 * len(grown)))))
    return _render_row(grown, columns, columns * pixels, path)


def render_three(
    found: Recognition,
    metres: float,
    rebuilt: Tree,
    siblings: Sequence[Tree],
    look: Look,
    path: Path,
) -> Path:
    """Render the tree as its facets were, then rebuilt, then siblings, all at one scale.

    metres : in one unit of what was recognised.
    """
    trees = [
        ("brought", _as_brought(found, metres, rebuilt)),
        ("rebuilt", rebuilt),
        *((f"sibling {number + 1}", tree) for number, tree in enumerate(siblings)),
    ]
    grown = [(Species(name=name, look=look), tree) for name, tree in trees]
    return _render_row(grown, len(grown), WIDTH, path, samples=32, one_scale=True)


def _render_row(
    grown: Sequence[tuple[Species, Tree]], columns: int, width: int, path: Path, **how: Any
) -> Path:
    """Render trees in rows of so many columns, a name, a height and a scale below each."""
    from forest_addon.blender.show.preview import FIELD, FOOT, render_sheet

    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        rendered = Path(folder) / "trees.png"
        cells = render_sheet(grown, columns, width, rendered, **how)
        image = imread(rendered)
    figure, axes = figure_on(image)
    high, wide = image.shape[:2]
    scale = max(width / columns / 330, 0.75)  # of what is written
    reach, below = 0.42 * wide / columns, FOOT / FIELD[0] * wide / columns
    for (x, y), (species, tree) in zip(cells, grown, strict=True):
        if not (tree.mesh.vertices[:, 2] < -0.02 * tree.height).any() or not how:
            # The sunk foot of a trunk is no part of the picture.
            ground = Rectangle((x - reach, y), 2 * reach, below, color=PAPER, linewidth=0)
            axes.add_patch(ground).set_zorder(1.5)
        axes.plot([x - reach, x + reach], [y, y], color=FAINT, linewidth=1.0)
        leaves = f", {len(tree.leaves):,} leaves" if len(tree.leaves) else ""
        for text, down, size in (
            (species.name, 10, 11),
            (f"{tree.height:.1f} m{leaves}", 28, 8.5),
        ):
            below_line = (x, y + down * scale, text)
            axes.text(*below_line, ha="center", va="top", color=INK, fontsize=size * scale)
    axes.set_xlim(0, wide)
    axes.set_ylim(high, 0)
    return save_figure(figure, path)


def draw_pictures(grown: Sequence[tuple[Species, Tree]], folder: Path) -> None:
    """A square JPEG of each tree, cut from one render at twice its size."""
    from PIL import Image

    from forest_addon.blender.show.preview import FIELD, FOOT, render_sheet

    columns = math.ceil(math.sqrt(len(grown)))
    wide = 2 * ICON
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as held:
        rendered = Path(held) / "trees.png"
        cells = render_sheet(grown, columns, columns * wide, rendered)
        with Image.open(rendered) as image:
            whole = image.convert("RGBA")
    above, below = round((FIELD[1] - FOOT) * wide), round(0.03 * wide)
    side = above + below
    for (species, _), (x, y) in zip(grown, cells, strict=True):
        left, foot = round(x) - wide // 2, round(y)
        tree_alone = whole.crop((left, foot - above, left + wide, foot))  # without its sunk foot
        paper = Image.new("RGBA", (side, side), PAPER)
        paper.alpha_composite(tree_alone, ((side - wide) // 2, 0))
        small = paper.convert("RGB").resize((ICON, ICON), Image.Resampling.LANCZOS)
        with replacing(folder / f"{file_name(species.name)}.jpg") as partial:
            small.save(partial, quality=85, optimize=True)


def _as_brought(found: Recognition, metres: float, rebuilt: Tree) -> Tree:
    """The facets of the file as a tree, its foot moved to the origin; the skeleton is the rebuilt one's."""
    origin = found.origin
    parts = []
    for pieces, part, slot in ((found.wood, WOOD, 0), (found.leaves, LEAF, 1)):
        mesh = TriMesh.of_part((pieces.vertices - origin) * metres, pieces.triangles, part)
        mesh.material[:] = slot
        if part == LEAF:
            mesh.leaf[:] = pieces.piece
        parts.append(mesh)
    leaves = np.argsort(parts[1].leaf, kind="stable")
    mesh = join([parts[0], parts[1].select(leaves)])
    return Tree(mesh, measure_leaves(parts[1]), rebuilt.skeleton)


def draw_recognised(found: Recognition, metres: float, name: str, path: Path) -> Path:
    """Front and side of the tree, each first-level branch with all it bears in a colour of its own.

    metres : in one unit of what was recognised.
    """
    figure = blank_figure((12, 7.5))
    front, side, bare = figure.subplots(1, 3, sharey=True)
    colours, firsts = _branch_colours(found)
    wood = found.wood.vertices[found.wood.triangles] * metres
    leaves = found.leaves.vertices[found.leaves.triangles] * metres
    green = np.empty((0, 3))
    if len(leaves):
        bearer = colours[found.bearer[found.leaves.piece]]
        green = 0.78 * np.array(rgb(LEAF_GREEN)) + 0.22 * bearer
    paint = colours[found.wood.piece]
    _draw(front, np.concatenate([wood, leaves]), np.concatenate([paint, green]), 0)
    _draw(side, np.concatenate([wood, leaves]), np.concatenate([paint, green]), 1)
    _draw(bare, wood, paint, 0)
    for axes, title, across in (
        (front, "from the front (-y)", "x, m"),
        (side, "from the right (+x)", "y, m"),
        (bare, "wood alone, from the front", "x, m"),
    ):
        axes.set_title(title)
        axes.set_xlabel(across)
    front.set_ylabel("z, m")
    for doubt in found.doubts:
        _ring(front, doubt.places * metres, 0)
        _ring(side, doubt.places * metres, 1)
    figure.suptitle(
        f"{name}: {found.wood.count:,} pieces of wood, {len(firsts):,} first-level branches, "
        f"{found.leaves.count:,} leaves",
        color=INK,
        x=0.01,
        ha="left",
    )
    shown = firsts[:: max(1, len(firsts) // 5)][:5]
    branches = "first-level branches and what hangs on them"
    keys = [
        Patch(facecolor=TRUNK, label="trunk"),
        *(Patch(facecolor=colours[first], label="") for first in shown[:-1]),
        Patch(facecolor=colours[shown[-1]], label=branches),
    ]
    if found.doubts:
        keys.append(Line2D([], [], **RING, label="in doubt"))
    if len(leaves):
        keys.append(Patch(facecolor=LEAF_GREEN, label="leaves, tinted by their branch"))
    figure.legend(
        handles=keys,
        loc="outside lower center",
        ncols=len(keys),
        handlelength=1.2,
        columnspacing=0.6,
    )
    return save_figure(figure, path)


def draw_problem(facets: np.ndarray, places: np.ndarray, name: str, path: Path) -> Path:
    """Front and side of facets (T, 3, 3) that are no tree, in their own units; places (N, 3) ringed."""
    figure = blank_figure((9, 7.5))
    facets = facets[:: max(1, len(facets) // MOST_DRAWN)]
    colour = np.tile(np.array(rgb("#8b8b86")), (len(facets), 1))
    both = figure.subplots(1, 2, sharey=True)
    for axes, across, title, label in (
        (both[0], 0, "from the front (-y)", "x"),
        (both[1], 1, "from the right (+x)", "y"),
    ):
        _draw(axes, facets, colour, across)
        _ring(axes, places, across)
        axes.set_title(title)
        axes.set_xlabel(f"{label}, units of the file")
    both[0].set_ylabel("z")
    figure.suptitle(f"{name}: not understood; rings mark where", color=INK, x=0.01, ha="left")
    return save_figure(figure, path)


def _ring(axes: Axes, places: np.ndarray, across: int) -> None:
    shown = places[:: max(1, len(places) // MOST_RINGS)]
    axes.plot(*(shown[:, [across, 2]].T), **RING, zorder=5)


def _branch_colours(found: Recognition) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3) colour of each piece of wood, and the first-level branches from the lowest up."""
    firsts = found.firsts
    firsts = firsts[np.argsort(found.foot[firsts, 2])]
    hue = (0.02 + 0.618034 * np.arange(len(firsts))) % 1.0  # neighbours differ
    bright = hsv_to_rgb(
        np.stack([hue, np.full(len(hue), 0.75), np.full(len(hue), 0.85)], axis=1)
    ).reshape(-1, 3)
    colours = np.tile(np.array(rgb(TRUNK)), (found.wood.count, 1))
    place = np.full(found.wood.count, -1)
    place[firsts] = np.arange(len(firsts))
    branch = np.where(found.branch >= 0, place[np.maximum(found.branch, 0)], -1)
    colours[branch >= 0] = bright[branch[branch >= 0]]
    return colours, firsts


def _draw(axes: Axes, facets: np.ndarray, colour: np.ndarray, across: int) -> None:
    """Facets (T, 3, 3) seen along an axis, the nearest last, shaded by their slope."""
    normal = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    depth = 1 - across
    shade = 0.55 + 0.45 * np.abs(normal @ np.array([0.45, 0.35, 0.82]))
    middle = facets[:, :, depth].mean(axis=1)
    order = np.argsort(-middle if across == 0 else middle, kind="stable")
    axes.add_collection(
        PolyCollection(
            facets[order][:, :, [across, 2]],
            facecolors=np.clip(colour * shade[:, None], 0, 1)[order],
            linewidths=0,
            rasterized=True,
        )
    )
    axes.autoscale_view()
    axes.set_aspect("equal")


PULSES = 128  # along a side of the grid
SIDES = 12  # from which a sonar pings at each sibling
OF_TEMPLATE = 48  # and at the template, of which there is one only
AWAY = 6.0  # metres between the sonar and the crown's edge


def portray_with_sensors(tree: Tree, sides: int = SIDES) -> Portrait:
    """The portrait of a tree, with what a scanner and a sonar find.

    sides : from which the sonar pings. A few leaves that face it make a flash, so the mean of 12 sides
        is uncertain by more than a decibel.
    """
    portrait = portray(tree.skeleton, tree.leaves, tree.height)
    scene = _alone(tree)
    gap, profile = _scan_from_above(tree, scene)
    levels = _echo_levels(tree, scene, sides)
    numbers = {
        **portrait.numbers,
        "gap fraction from above": gap,
        "echo level, dB": float(levels.mean()),
        "its spread over all sides, dB": float(levels.std(ddof=1)),
    }
    return replace(
        portrait, numbers=numbers, profiles={**portrait.profiles, "first returns": profile}
    )


def tell_likeness(found: Likeness, siblings: int, sensed: int, say: Say) -> None:
    """Print the table. sensed : how many of the siblings the sensors looked at."""
    say(f"\n{siblings} siblings against the tree, {sensed} of them with sensors:")
    say(f"  {'':<38}{'tree':>9}{'siblings':>10}{'differ':>9}{'spread':>8}{'away':>6}")
    for row in found.numbers:
        decibels = row.name.endswith("dB")
        apart = (
            f"{row.mean - row.template:+.1f} dB" if decibels else f"{100 * row.difference:+.1f} %"
        )
        spread = f"{row.spread:.1f} dB"
        if not decibels:
            spread = f"{100 * row.spread / abs(row.template):.0f} %" if row.template else "-"
        say(
            f"  {row.name:<38}{row.template:>9.4g}{row.mean:>10.4g}{apart:>9}{spread:>8}"
            f"{row.spreads:>6.1f}"
        )
    say(f"\n  {'distributions':<38}{'tree':>9}{'siblings':>10}{'KS':>9}{'earth mover':>14}")
    for sample in found.samples:
        say(
            f"  {sample.name:<38}{sample.template:>9.4g}{sample.mean:>10.4g}"
            f"{sample.kolmogorov:>9.2f}{sample.mover:>14.3g}"
        )
    say(f"\n  {'profiles over height':<38}{'overlap':>9}{'of one sibling':>19}")
    for profile in found.profiles:
        say(f"  {profile.name:<38}{profile.overlap:>9.2f}{profile.single:>19.2f}")
    missed = ", ".join(found.missed)
    goals = "means within 10 %, overlap at least 0.85, the tree within 2 spreads of its siblings"
    say(f"\n  Goals ({goals}): " + (f"missed by {missed}" if missed else "all met"))


def _alone(tree: Tree) -> SceneGeometry:
    """A tree on a wide ground."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 100.0
    ground = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)
    return SceneGeometry(
        meshes=(tree.mesh, ground),
        transform=np.tile(np.eye(3, 4), (2, 1, 1)),
        mesh_index=np.arange(2),
        object_name=("tree", "ground"),
        tree=np.array([0, -1]),
        species=np.array([0, -1]),
    )


def _scan_from_above(tree: Tree, scene: SceneGeometry) -> tuple[float, np.ndarray]:
    """Share of pulses in the crown's circle that reach the ground, and shares of first returns by height."""
    points = tree.leaves.centre if len(tree.leaves) else tree.skeleton.end
    middle = np.median(points[:, :2], axis=0)
    radius = crown_width(tree.skeleton, tree.leaves) / 2
    step = (np.arange(PULSES) + 0.5) / PULSES * 2 - 1
    x, y = (grid.ravel() for grid in np.meshgrid(step, step))
    inside = np.hypot(x, y) <= 1
    origins = np.column_stack([x[inside], y[inside], np.zeros(inside.sum())]) * radius
    origins[:, :2] += middle
    origins[:, 2] = tree.height + 1.0
    down = np.tile([0.0, 0.0, -1.0], (len(origins), 1))
    hits = make_caster(scene, Rays(threads=1)).cast(origins, down, tree.height + 2.0)
    met = hits.instance == 0
    height = origins[met, 2] - hits.distance[met]
    bins = np.clip((height / tree.height * BINS).astype(np.int64), 0, BINS - 1)
    counts = np.bincount(bins, minlength=BINS)
    return float(1 - met.mean()), counts / max(counts.sum(), 1)


def _echo_levels(tree: Tree, scene: SceneGeometry, sides: int) -> np.ndarray:
    """(sides,) dB of the mean power in the band, re the sent one at 1 m."""
    points = tree.leaves.centre if len(tree.leaves) else tree.skeleton.end
    middle = np.median(points, axis=0)
    away = crown_width(tree.skeleton, tree.leaves) / 2 + AWAY
    targets, levels = EchoTargets(scene), []
    for side in 2 * np.pi * np.arange(sides) / sides:
        place = middle - away * np.array([np.cos(side), np.sin(side), 0.0])
        sonar = Sonar(
            position=tuple(place.tolist()),
            azimuth_deg=float(np.rad2deg(side)),
            elevation_deg=0.0,
            beam_width_deg=(30.0, 30.0),
            wood=not len(tree.leaves),
            facets=False,
            leaf_model="piston",
            tolerance=1e-3,
            cull=0.01,
            shading="none",
        )
        echo = ping(targets, sonar, Air())
        levels.append(10 * np.log10(max(float((np.abs(echo.spectrum) ** 2).mean()), 1e-30)))
    return np.array(levels)


def add_sensors(found: Likeness, template: Tree, siblings: Iterable[Tree]) -> Likeness:
    """A comparison with what sensors find added; each sibling is let go before the next is grown."""
    itself = portray_with_sensors(template, OF_TEMPLATE)
    seen = compare(itself, [portray_with_sensors(tree) for tree in siblings])
    numbers, profiles = ({row.name for row in rows} for rows in (found.numbers, found.profiles))
    return Likeness(
        found.numbers + tuple(row for row in seen.numbers if row.name not in numbers),
        found.samples,
        found.profiles + tuple(row for row in seen.profiles if row.name not in profiles),
    )


ENDS = {"arrived": BLUE, "crashed": RED, "late": VIOLET}


def new_figure(columns: int, size: tuple[float, float], **options: Any) -> tuple[Figure, Any]:
    """A figure of the project's look with a row of axes."""
    with rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(1, columns, squeeze=False, **options)[0]
    return figure, axes


def draw_flights(path: Path, cells: Sequence[Any], cell: Any, world: Any, title: str) -> Path:
    """The flights of one cell in its first forest from above; beside it success against speed."""
    with rc_context(STYLE):
        figure, (above, curve) = new_figure(2, (12, 5), width_ratios=(2, 1))
        view = TopView(world)
        low, high = world.field
        extent = (low[0] - 5, high[0] + 5, low[1] - 5, high[1] + 5)
        above.imshow(view.picture, extent=extent, aspect="equal", interpolation="nearest")
        forest = cell.tracks[0].forest
        tracks = [track for track in cell.tracks if track.forest == forest]
        for end, colour in ENDS.items():
            lines = [track.position[:, :2] for track in tracks if track.end == end]
            above.add_collection(LineCollection(lines, colors=colour, linewidths=0.9, label=end))
        stops = np.array([t.position[-1, :2] for t in tracks if t.end == "crashed"]).reshape(-1, 2)
        above.plot(*stops.T, "x", color=RED, ms=4)
        above.set(xlabel="x, m", ylabel="y, m", title=f"{title}, {cell.speed:g} m/s")
        above.legend(loc="lower right", facecolor="white", frameon=True, framealpha=0.8)
        for colour, density in zip(LINES, sorted({cell.density for cell in cells}), strict=False):
            of_density = sorted((c for c in cells if c.density == density), key=lambda c: c.speed)
            share = np.array([c.arrived / len(c.tracks) for c in of_density])
            ends = np.array([interval(c.arrived, len(c.tracks)) for c in of_density])
            speed = [c.speed for c in of_density]
            error = np.maximum(np.stack([share - ends[:, 0], ends[:, 1] - share]), 0)
            curve.errorbar(
                speed,
                share,
                error,
                color=colour,
                marker="o",
                ms=4,
                lw=1.3,
                capsize=2,
                label=f"{of_density[0].trees:.3g} trees/m²",
            )
        curve.set(
            xlabel="speed, m/s", ylabel="share that arrives", ylim=(-0.03, 1.05), title="Success"
        )
        curve.grid(color=FAINT, lw=0.4)
        curve.legend()
    return save_figure(figure, path)
