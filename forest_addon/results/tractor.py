"""Record of what a tractor's scan gives: SIMLIDAR's matrix of distances, and points."""

from __future__ import annotations

import numpy as np

from ..base.words import keep
from ..drawing.strips import Axis, Plot, by_distance
from ..sensing.kind import Seen
from ..sensing.lidar.tractor import TractorScan, to_cloud
from ..spec import Tractor
from .kind import Figure, ResultKind, Variables, numbers, organ_figures, share
from .points import ENDINGS, write_points


def _figures(_tractor: Tractor, scan: TractorScan, _seen: Seen | None) -> list[Figure]:
    organ = scan.organ
    return [
        numbers("beams", "Beams", f"{organ.size:,}"),
        numbers("", "Points", f"{int(np.count_nonzero(organ >= 0)):,}"),
        *organ_figures(organ),
        numbers("escaped", "Sky", share(organ < 0)),
        numbers("", "Rays By", scan.engine),
    ]


def _story(tractor: Tractor, scan: TractorScan) -> str:
    scans, beams = scan.organ.shape
    return f"{scans:,} scans of {beams} beams along {tractor.track:g} m (SIMLIDAR's scanner, one ray a beam)."


def _notes(_tractor: Tractor, scan: TractorScan) -> tuple[str, ...]:
    return (
        f"Rays by {scan.engine} on the evaluated depsgraph; every distance is computed again in "
        "float64 on the triangle that was hit.",
    )


def _arrays(scan: TractorScan) -> dict[str, np.ndarray]:
    return {
        "distance": scan.matrix,
        "organ": scan.organ,
        "tree": scan.returns.tree.reshape(scan.distance.shape),
        "angle": scan.angle,
        "track": scan.track,
    }


def matrix_plot(_tractor: Tractor, scan: TractorScan) -> Plot:
    """The distances of a tractor's scan, near is bright; a beam that escaped is dark."""
    angle = np.rad2deg(scan.angle)
    track = scan.track
    return Plot(
        (
            by_distance(
                keep("Distance of the first hit"),
                scan.distance.T,
                Axis(float(angle[0]), float(angle[-1]), keep("degrees from the horizontal")),
            ),
        ),
        Axis(float(track[0]), float(track[-1]), keep("m along the track")),
        keep(
            "{length:.3g} m by {angle:.3g}°",
            length=track[-1] - track[0],
            angle=angle[-1] - angle[0],
        ),
    )


def _labelled(scan: TractorScan) -> tuple[Variables, Variables]:
    both = ("scan", "angle")
    return {
        "distance": (both, scan.matrix, "m"),
        "organ": (both, scan.organ, ""),
    }, {
        "angle": (("angle",), np.rad2deg(scan.angle), "deg"),
        "track": (("scan",), scan.track, "m"),
    }


TRACTOR = ResultKind(
    figures=_figures,
    labelled=_labelled,
    arrays=_arrays,
    units={"distance": "m", "angle": "rad", "track": "m"},
    sentence=lambda scan: keep("{count:,} points", count=int((scan.organ >= 0).sum())),
    title=lambda tractor: f"Tractor LiDAR: {tractor.name}",
    story=_story,
    notes=_notes,
    saves=dict.fromkeys(
        ENDINGS,
        lambda path, tractor, scan, offset: write_points(path, to_cloud(scan, tractor), offset),
    ),
    plot=matrix_plot,
    points=lambda tractor, scan: to_cloud(scan, tractor),
)
