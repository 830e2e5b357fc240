"""What a scan could not see, in scenes of walls where it is plain."""

import numpy as np

from forest_addon.sensing.lidar.occlusion import occlusion, on_the_line
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.rays.cells import Cells
from forest_addon.spec import Terrestrial
from tests.references.lidar_scenes import scene_with, wall
from tests.references.rays_brute import BruteCaster

SCANNER = Terrestrial(
    position=(0.25, 0.25, 20.25),
    azimuth_deg=(-20.0, 20.0),
    elevation_deg=(-20.0, 20.0),
    angle_step_deg=1.0,
    max_range=30.0,
)
CELLS = Cells(np.array([0, -20, 0]), np.array([30, 40, 80]), 0.5)


def scanned():
    """Trees 0 and 1 are walls at 5 m and 8 m (the first of ``scene_with`` is none)."""
    caster = BruteCaster(scene_with(wall(14.0, 40.0), wall(5.0, 40.0), wall(8.0, 40.0)))
    work = Scan(SCANNER, caster, 1)
    return work, caster, work.look(0, work.pulses)


def test_pulses_go_in_up_to_the_wall_and_are_blocked_behind_it():
    work, _, cloud = scanned()
    found = occlusion(work, cloud, CELLS, 1)
    assert found["pulses"] == work.pulses == len(cloud)
    assert found["pulses_in"][:10].sum() > 0
    assert found["pulses_blocked"][:10].sum() == 0
    assert found["pulses_in"][11:].sum() == 0  # the wall at 5 m is the lower end of cells number 10
    assert found["pulses_blocked"][11:].sum() > 0
    assert found["pulses_hit"].sum() == len(cloud)
    assert np.array_equal(np.flatnonzero(found["pulses_hit"].sum(axis=(1, 2))) // 1, [10]) or set(
        np.flatnonzero(found["pulses_hit"].sum(axis=(1, 2))).tolist()
    ) <= {9, 10}  # rounding decides between both sides of the wall
    every = occlusion(work, cloud, CELLS, 4)
    assert every["pulses"] == -(-work.pulses // 4)


def test_trees_on_the_line_are_named_whether_or_not_they_were_seen():
    work, caster, cloud = scanned()
    found = on_the_line(work, caster, cloud, 3)
    pulses = np.unique(found["pulse"])
    assert np.array_equal(pulses, np.arange(0, work.pulses, 3))
    for tree, seen, near in ((0, True, 5.0), (1, False, 8.0)):
        rows = found["tree"] == tree
        assert rows.sum() == len(pulses)
        assert (found["seen"][rows] == seen).all()
        way = work.pattern.pulses(found["pulse"][rows]).direction[:, 0]
        assert np.allclose(found["distance"][rows] * way, near - 0.25, atol=1e-9)
