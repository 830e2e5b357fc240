"""Thickness of thin branches in a scan: cylinders of known radius, circles through their points.

Upright cylinders are scanned from three sides at 8 m, without errors and with those of a phase scanner: a
beam of finite width, whose edge meets a twig that its axis passes, and range noise. Weighted by how the
volume of a tree of ours lies in branches of each diameter, that is what a quantitative structure model
overestimates.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.truth import segment_table
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Beam, Noise, Rays, Terrestrial
from headless.report.pictures import FAINT, INK, LEAF_GREEN, blank_figure, save_figure

from .comparison import Comparison, Interval, Picture
from .stems import taubin
from .woods import grown, pole

DIAMETERS = np.array([0.005, 0.01, 0.02, 0.05, 0.1])  # m
AWAY, HEIGHT = 8.0, 0.2
THIN = 0.05  # m
MEASURED, SHARE_THIN = 45.0, 80.0  # % by Demol et al. 2022; of it in branches thinner than THIN
NONE = (Beam(), Noise())
REAL = (
    Beam(divergence_mrad=(0.42, 0.42), exit_diameter=0.003, subrays=19, pulse_ns=2.0),
    Noise(range_sd=0.002),
)


def compare_twigs(out: Path, seed: int) -> list[Comparison]:
    """Overestimate of a tree's volume, and where it lies."""
    ratio = {name: ratios(*errors, seed) for name, errors in (("none", NONE), ("real", REAL))}
    over, thin = {}, {}
    table = segment_table(grown("honda-broadleaf", 1, seed)[0].skeleton)
    volume, diameter = table["volume_m3"], table["diameter_m"]
    for name, found in ratio.items():
        factor = np.interp(np.log(diameter), np.log(DIAMETERS), found) ** 2
        more = volume * (factor - 1)
        over[name] = 100 * float(more.sum() / volume.sum())
        thin[name] = 100 * float(more[diameter < THIN].sum() / more.sum())
    figure = blank_figure((5.5, 3.2))
    axes = figure.add_subplot()
    axes.axhline(1, color=FAINT)
    for name, colour in (("none", INK), ("real", LEAF_GREEN)):
        label = "no errors" if name == "none" else "beam 3 mm + 0.42 mrad, noise 2 mm"
        axes.plot(100 * DIAMETERS, ratio[name], "o-", color=colour, label=label)
    axes.set(xscale="log", xlabel="diameter, cm", ylabel="fitted / true diameter")
    axes.legend(fontsize=7)
    picture = Picture(
        save_figure(figure, out / "twigs.png"),
        "Diameters of cylinders 8 m away, fitted to their points, over the true ones.",
    )
    said = ", ".join(
        f"{100 * d:g} cm {r:.2f}" for d, r in zip(DIAMETERS, ratio["real"], strict=True)
    )
    return [
        Comparison(
            *("volume of a tree overestimated", "%", Interval(MEASURED), Interval(over["real"])),
            None,
            words="Not judged: measured are whole models of trees, with wind, joined scans and twigs that "
            f"are modelled as one; ours is what beam and noise add. Fitted over true diameter: {said}. "
            "*Before* is without errors.",
            before=Interval(over["none"]),
        ),
        Comparison(
            *("of it in branches thinner than 5 cm", "%", Interval(SHARE_THIN)),
            *(Interval(thin["real"]), None),
            pictures=(picture,),
        ),
    ]


def ratios(beam: Beam, noise: Noise, seed: int) -> np.ndarray:
    """(D,) fitted over true diameters of cylinders."""
    return np.array([_fitted(d, beam, noise, seed) / d for d in DIAMETERS])


def _fitted(diameter: float, beam: Beam, noise: Noise, seed: int) -> float:
    mesh = pole(diameter / 2, 2 * HEIGHT)
    scene = SceneGeometry(
        meshes=(mesh,),
        transform=np.eye(3, 4)[None],
        mesh_index=np.zeros(1, np.int64),
        object_name=("twig",),
        tree=np.zeros(1, np.int64),
        species=np.zeros(1, np.int64),
    )
    caster, points = make_caster(scene, Rays()), []
    for side in range(3):
        angle = 2 * np.pi * side / 3
        towards = np.rad2deg(angle) - 180
        half = np.rad2deg(diameter / AWAY) + 0.1
        scanner = Terrestrial(
            position=(AWAY * float(np.cos(angle)), AWAY * float(np.sin(angle)), HEIGHT),
            azimuth_deg=(towards - half, towards + half),
            elevation_deg=(-0.6, 0.6),
            angle_step_deg=0.018,
            beam=beam,
            noise=noise,
            name=f"side {side}",
        )
        points.append(scan(scanner, caster, seed).position[:, :2])
    return 2 * taubin(np.concatenate(points))[1]
