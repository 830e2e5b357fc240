"""Stands that are grown from a list of stems, and clouds of them: the same path as a user's forest takes.

The pine plot has 16 stems on 10 x 10 m of 12.8 to 28.5 cm and 15 to 18 m, as a plot had that was scanned from
tripods; the same stand goes on around it, so that crowns at its edge have neighbours.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.blender.rays.casters import make_caster
from forest_addon.blender.scene.ground import ground_mesh
from forest_addon.formats.table import write_csv
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.site import ForestSite
from forest_addon.spec import Beam, Noise, Planting, Rays, Scene, Terrestrial
from forest_addon.spec import Forest as Field
from forest_addon.stand.forest import Forest

SIDE, AROUND = 10.0, 5.0  # metres: of the plot, and of the stand around it
STEMS = 4  # along a side of the plot
DBH, HEIGHT = (0.128, 0.285), (15.0, 18.0)
STATIONS = ((1.0, 1.0), (9.0, 1.0), (9.0, 9.0), (1.0, 9.0), (5.0, 5.0))
STEP = 0.06  # degrees between beams


def pine_stems(seed: int) -> np.ndarray:
    """(N, 4) stems on a shaken grid: x, y, diameter, height, metres."""
    apart = SIDE / STEMS
    many = int(np.ceil((SIDE + 2 * AROUND) / apart))
    axis = (np.arange(many) - (many - STEMS) / 2 + 0.5) * apart
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    rng = stream(seed, "pine plot")
    place = grid + 0.3 * apart * rng.uniform(-1, 1, grid.shape)
    share = rng.beta(1.6, 1.6, len(place))
    noise = 0.5 * rng.standard_normal(len(place))
    height = np.clip(HEIGHT[0] + share * (HEIGHT[1] - HEIGHT[0]) + noise, *HEIGHT)
    return np.column_stack([place, DBH[0] + share * (DBH[1] - DBH[0]), height])


def site_of(stems: np.ndarray, species: str, seed: int, undergrowth: str = "auto") -> ForestSite:
    """The site of a list of stems (N, 4) of one species, looked at by a scanner."""
    low = stems[:, :2].min(axis=0) - 1.0
    size = np.ptp(stems[:, :2], axis=0) + 2.0
    field = Field(
        origin=(float(low[0]), float(low[1])),
        size=(float(size[0]), float(size[1])),
        undergrowth=undergrowth,
    )
    listed = Planting(species=species, layout="list", trees="stems.csv", variants=len(stems))
    scene = Scene(seed=seed, forest=field, plantings=(listed,), sensors=(Terrestrial(),))
    with TemporaryDirectory() as folder:
        write_csv(
            Path(folder) / "stems.csv",
            dict(zip(("x", "y", "dbh", "height"), stems.T.tolist(), strict=True)),
        )
        return ForestSite.read(scene, folder)


def geometry_of(site: ForestSite, forest: Forest) -> SceneGeometry:
    """Return what rays meet: instances of the grown variants, and the ground."""
    keys = list(forest.variants)
    number = {key: k for k, key in enumerate(keys)}
    stand = forest.stand
    rows = zip(stand.species.tolist(), stand.variant.tolist(), strict=True)
    index = np.array([number[row] for row in rows], dtype=np.int64)
    ground = ground_mesh(site.scene.forest, site.ground)
    return SceneGeometry(
        meshes=(*(forest.variants[key].mesh for key in keys), ground),
        transform=np.concatenate([forest.transforms(), np.eye(3, 4)[None]]),
        mesh_index=np.append(index, len(keys)),
        object_name=("tree",) * len(index) + ("ground",),
        tree=np.append(stand.id, -1),
        species=np.append(stand.species, -1),
    )


def scanned(scene: SceneGeometry, seed: int, step: float = STEP) -> np.ndarray:
    """(P, 3) points of the plot from tripods at its corners and in its middle."""
    caster, clouds = make_caster(scene, Rays()), []
    for number, (x, y) in enumerate(STATIONS):
        scanner = Terrestrial(
            name=f"station {number}",
            position=(x, y, 1.6),
            elevation_deg=(-60.0, 90.0),
            angle_step_deg=step,
            beam=Beam(divergence_mrad=(0.35, 0.35), exit_diameter=0.004, subrays=1, max_returns=1),
            noise=Noise(range_sd=0.003),
            max_range=60.0,
        )
        clouds.append(scan(scanner, caster, seed).position)
    points = np.concatenate(clouds)
    inside = (points[:, :2] > 0).all(axis=1) & (points[:, :2] < SIDE).all(axis=1)
    return points[inside]
