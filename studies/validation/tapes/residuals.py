"""Residuals of circles on pines, by the yardstick that measured clouds went through (``clouds.circles``).

Boles of Scots pine stand as thick as those of a measured plot (12.8 to 28.5 cm on 10 x 10 m) and are scanned
from five tripods, as such clouds of whole stems are made. A stem's residual is the mean of its slices', 30 cm
thick.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np

from forest_addon.blender.rays.casters import make_caster
from forest_addon.sensing.lidar.scan import scan
from forest_addon.spec import Noise, Rays

from ..clouds.circles import HIGH, LOW, stems_of
from ..comparison import Comparison, Interval
from ..living import SIDE, STATIONS, pine_stems
from ..stems import SCANNER
from .girths import bole, scene_of

RESIDUALS = (5.0, 12.0)  # mm, of circles on pines of two other clouds, by this yardstick
STEP, ROUND = 0.15, 0.35  # degrees between beams; m about an axis that are scanned
LOWEST = 3.5  # m of bole that are looked at
NOISE = Noise(range_sd=0.003)  # m, as of the plot's other rows
ALIKE = 0.03  # m of diameter, of stems beside the pine that is at hand


def stems_of_plot(seed: int, bark: bool = True) -> np.ndarray:
    """(S, 5) x, y, radius, arc and residual, m, of the boles of a plot."""
    stems = pine_stems(seed)
    stems = stems[((stems[:, :2] > 0) & (stems[:, :2] < SIDE)).all(axis=1)]
    meshes = [bole(d, seed * 1000 + k, bark, LOWEST) for k, d in enumerate(stems[:, 2])]
    caster, place = make_caster(scene_of(meshes, stems[:, :2]), Rays()), []
    for number, (x, y) in enumerate(STATIONS):
        for k, (dx, dy) in enumerate((stems[:, :2] - [x, y]).tolist()):
            away, turn = np.hypot(dx, dy), np.degrees(np.arctan2(dy, dx))
            half = np.degrees(np.arcsin(min(ROUND / away, 0.9)))
            low, high = np.degrees(np.arctan2(np.array([LOW - 0.1, HIGH + 0.1]) - 1.6, away))
            tripod = SCANNER.changed(
                position=(x, y, 1.6),
                azimuth_deg=(float(turn - half), float(turn + half)),
                elevation_deg=(float(low), float(high)),
                angle_step_deg=STEP,
                noise=NOISE,
            )
            cloud = scan(tripod, caster, seed + 100 * number + k)
            place.append(cloud.position[cloud.returns.tree == k])
    points = np.concatenate(place)
    return stems_of(points, points[:, 2])


def compare_residuals(wood: Path, seed: int) -> Comparison:
    """Residuals of circles on boles with bark beside those of measured clouds."""
    ours, smooth = stems_of_plot(seed), stems_of_plot(seed, bark=False)
    published = Interval(float(np.mean(RESIDUALS)), *RESIDUALS)
    mine = Interval.of(1000 * ours[:, 4])
    row = Comparison(
        *("residuals of circles on pines", "mm", published, mine, published.meets(mine)),
        words=f"Of {len(ours)} stems of 12.8 to 28.5 cm from five tripods, 3 mm of noise; scans are joined "
        "without an error. Before, boles are round and smooth; measured in two other clouds of pines. Agrees "
        "where the intervals meet; ours holds 90 % of the stems.",
        before=Interval(float(np.median(1000 * smooth[:, 4]))),
    )
    file = wood / "treels_pine.laz"
    if not file.is_file():
        return row
    points = np.asarray(laspy.read(file).xyz)
    found = stems_of(points, points[:, 2] - points[:, 2].min())
    if not len(found):
        return row
    near = np.abs(2 * (ours[:, 2] - found[0, 2])) < ALIKE
    alike = f"{1000 * np.median(ours[near, 4]):.1f} mm" if near.any() else "none"
    return replace(
        row,
        words=f"{row.words} A measured pine of {200 * found[0, 2]:.0f} cm (R package TreeLS): "
        f"{1000 * found[0, 4]:.1f} mm; ours within {100 * ALIKE:.0f} cm of it: {alike}.",
    )
