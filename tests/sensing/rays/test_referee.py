"""The judge between an engine and float64: what it excuses beside an edge, and what not."""

import numpy as np
import pytest

from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.sensing.rays.caster import Hits, RayCaster
from forest_addon.sensing.rays.exact import ExactCaster, Referee
from forest_addon.sensing.rays.geometry import SceneGeometry


def roof(far=0.0):
    """Two faces that meet in the ridge x = 0, z = 0, and fall away at 45°; and such another far away."""
    vertices = np.array([(0, -1, 0), (0, 1, 0), (1, 0, -1), (-1, 0, -1.0)])
    mesh = TriMesh.of_part(vertices, np.array([[0, 1, 2], [1, 0, 3]]), OTHER)
    place = np.tile(np.eye(3, 4), (2, 1, 1))
    place[1, 0, 3] = far
    none = np.full(2, -1)
    return SceneGeometry((mesh,), place, np.zeros(2, int), ("near", "far"), none, none)


class Beside(RayCaster):
    """An engine that names the left face of the roof, at its plane, whatever a ray meets."""

    engine = "beside"

    def __init__(self, scene):
        self.scene = scene

    def cast(self, origins, directions, max_distance=np.inf, **_):
        count = len(origins)
        there = origins[:, 2] - origins[:, 0]  # of the plane z = x, straight down
        named = np.zeros(count, np.int64), np.ones(count, np.int64)
        return Hits(there, *named, np.zeros((count, 3)))


@pytest.mark.parametrize(
    ("far", "aside", "excused"),
    [
        (5.0, 3e-6, True),  # metres from the ridge
        (5.0, 1e-4, False),
        (2000.0, 1e-4, True),  # a float32 has steps of 6e-5 m at half of that
        (2000.0, 1e-3, False),
    ],
)
def test_the_face_beside_an_edge_counts_where_single_precision_does_not_tell(far, aside, excused):
    """A ray meets the right face, and the engine names the left one, whose plane is 2 * aside nearer."""
    scene = roof(far)
    origins, ways = np.array([[aside, 0.1, 3.0]]), np.array([[0.0, 0.0, -1.0]])
    true = ExactCaster(scene).cast(origins, ways)
    assert (true.instance[0], true.triangle[0]) == (0, 0)
    assert true.distance[0] == pytest.approx(3 + aside, abs=1e-12)
    found = Referee(Beside(scene)).cast(origins, ways)
    assert found.triangle[0] == (1 if excused else 0)
    assert found.distance[0] == pytest.approx(3 - aside if excused else 3 + aside, abs=1e-12)
