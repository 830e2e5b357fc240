"""Record of what a scanner gives, on whatever carries it: a cloud of points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..base.rows import distinct
from ..base.words import keep
from ..drawing.strips import Axis, Plot, by_distance, from_above
from ..sensing.kind import Seen
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.glance import range_image
from ..spec import Scanner, Terrestrial
from .coordinates import Offset
from .kind import Figure, ResultKind, Variables, numbers, organ_figures, share
from .points import ENDINGS, UNITS, WAVEFORMS, records, write_points

THIRDS = 3  # of the heights of what moves


def _figures(scanner: Scanner, cloud: Cloud, _seen: Seen | None) -> list[Figure]:
    tree, organ = cloud.returns.tree, cloud.returns.organ
    back = len(distinct(cloud.pulse)) / max(cloud.pulses, 1)
    figures = [
        numbers("", "Beams", f"{cloud.pulses:,}"),
        numbers("points", "Points", f"{len(organ):,}"),
        numbers("pulses that came back", "", f"{back:.1%} of {cloud.pulses:,}"),
        numbers("trees seen", "Trees Seen", f"{len(np.unique(tree[tree >= 0]))}"),
        *organ_figures(organ),
    ]
    if scanner.beam.max_returns > 1:
        figures.append(numbers("of several returns", "Several Returns", share(cloud.count > 1)))
    if cloud.bounce is not None:  # points by the way of their light, and rays not followed
        figures += [
            numbers("ghosts, by reflection", "Ghosts", share(cloud.bounce == 1)),
            numbers("through glass", "Through Glass", share(cloud.bounce == 2)),
            numbers("refracted by water", "Refracted", share(cloud.bounce == 3)),
        ]
        if cloud.unfollowed:
            said = f"{cloud.unfollowed:,}"
            figures.append(numbers("rays that met a second mirror or pane", "Not Followed", said))
    if cloud.velocity is not None:
        figures += _of_motion(cloud)
    if cloud.lost:
        lost = "; ".join(map(str, cloud.lost))
        figures.append(numbers("not measured, by a fault of this program", "Not Measured", lost))
    return [*figures, numbers("", "Rays By", cloud.engine)]


def _of_motion(cloud: Cloud) -> list[Figure]:
    """Figures of a scene that moved: how much of what was met did, and how far from where it stands still."""
    assert cloud.velocity is not None
    assert cloud.rest is not None
    moving = np.linalg.norm(cloud.velocity, axis=1) > 0
    away = np.linalg.norm(cloud.position - cloud.rest, axis=1)
    pulses = len(distinct(cloud.pulse[moving])) / max(len(distinct(cloud.pulse)), 1)
    figures = [numbers("pulses that met something moving", "Met Moving", f"{pulses:.1%}")]
    if not moving.any():
        return figures
    speed = float(np.linalg.norm(cloud.velocity[moving], axis=1).max())
    moving &= np.isfinite(away)  # NaN: it is not there as the scene stands still
    if not moving.any():
        return [*figures, numbers("fastest of it", "Fastest", f"{speed:.3g} m/s")]
    height = cloud.rest[moving, 2]
    edges = np.linspace(height.min(), height.max(), THIRDS + 1)
    third = np.clip(np.searchsorted(edges, height, side="right") - 1, 0, THIRDS - 1)
    blur = ", ".join(
        f"{100 * float(np.sqrt(np.mean(away[moving][third == k] ** 2))):.2g} cm from {edges[k]:.1f} m"
        for k in range(THIRDS)
        if (third == k).any()
    )
    return [
        *figures,
        numbers("fastest of it", "Fastest", f"{speed:.3g} m/s"),
        numbers("blur, rms, by height", "Blur", blur),
        *_of_tops(cloud.returns.tree[moving], height, away[moving]),
    ]


def _of_tops(tree: np.ndarray, height: np.ndarray, away: np.ndarray) -> list[Figure]:
    """Figure of how far trees' highest points (P,) that moved are from their rest; none without trees."""
    order = np.lexsort((height, tree))
    last = order[np.diff(tree[order], append=-2) != 0]
    tops = 100 * away[last[tree[last] >= 0]]
    if not len(tops):
        return []
    said = f"{np.median(tops):.2g} cm (median of {len(tops)} trees), at most {tops.max():.2g} cm"
    return [numbers("trees' highest points off their rest", "Tops Off Rest", said)]


def _story(scanner: Scanner, cloud: Cloud) -> str:
    spacing = f" every {scanner.angle_step_deg:g}°" if isinstance(scanner, Terrestrial) else ""
    instrument = f" by {scanner.scanner}" if scanner.scanner else ""
    return f"{cloud.pulses:,} pulses{spacing}{instrument} gave {len(cloud):,} points."


def _notes(scanner: Scanner, _cloud: Cloud) -> tuple[str, ...]:
    subrays = scanner.beam.subrays
    return (
        "One ray a pulse."
        if subrays == 1
        else f"{subrays} rays of equal energy a pulse, over a Gaussian footprint.",
        "LAS coordinates are stored to 0.1 mm; labels and truth (range without noise, normal, angle "
        "of incidence) are extra bytes.",
    )


def _write(folder: Path, scanner: Scanner, cloud: Cloud, offset: Offset) -> list[Path]:
    path = folder / f"{scanner.name}.laz"
    write_points(path, cloud, offset)
    return [path] if cloud.waves is None else [path, path.with_suffix(WAVEFORMS)]


def cloud_plot(scanner: Scanner, cloud: Cloud) -> Plot | None:
    """Points as an image: from a tripod by azimuth and elevation, else from above; None without points."""
    if not len(cloud):
        return None
    if not isinstance(scanner, Terrestrial):
        return from_above(cloud.position)

    distance = range_image(cloud, scanner)
    (west, east), (low, high) = scanner.azimuth_deg, scanner.elevation_deg
    return Plot(
        (
            by_distance(
                keep("Distance of the first return"),
                distance,
                Axis(low, high, keep("elevation (°)")),
            ),
        ),
        Axis(west, east, keep("azimuth (°)")),
        keep("{wide:g}° by {high:g}°", wide=east - west, high=high - low),
    )


def _labelled(cloud: Cloud) -> tuple[Variables, Variables]:
    rows = records(cloud)
    return {
        name: (("point",), rows[name].copy(), UNITS.get(name, ""))
        for name in rows.dtype.names or ()
    }, {}


SCANNER = ResultKind(
    figures=_figures,
    labelled=_labelled,
    sentence=lambda cloud: keep("{count:,} points", count=len(cloud)),
    title=lambda scanner: f"{scanner.kind.title()} LiDAR: {scanner.name}",
    story=_story,
    notes=_notes,
    files=(".laz", ""),
    write=_write,
    saves=dict.fromkeys(ENDINGS, lambda path, _, cloud, offset: write_points(path, cloud, offset)),
    plot=cloud_plot,
    points=lambda _, cloud: cloud,
    is_cloud=True,
)
