"""A scan's audit: silent on what is right, loud on what is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from references.rays import BruteCaster, ordinary, scene_with

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, TriMesh
from forest_addon.sensing.audit import Check, held
from forest_addon.sensing.lidar.audit import (
    beam_ranges,
    first_ranges,
    parts_of_drive,
    parts_of_scan,
)
from forest_addon.sensing.lidar.cloud import join
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.lidar.tractor import drive
from forest_addon.sensing.rays.exact import Referee
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Beam, Rays, Surfaces, Terrestrial, Tractor


def scene(count: int = 300, shift: float = 0.0) -> SceneGeometry:
    rng = stream(5, "audit test")
    corners = rng.uniform(-3, 3, (count, 1, 3)) + rng.normal(0, 0.4, (count, 3, 3))
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), LEAF)
    found = scene_with(mesh)
    found.transform[0, :, 3] = shift
    return found


class Off(BruteCaster):
    """A caster whose hits are changed."""

    def __init__(self, scene, change):
        super().__init__(scene)
        self._change = change

    def cast(self, *rays, **limits):
        hits = super().cast(*rays, **limits)
        return replace(hits, distance=self._change(hits.distance))


def blind(distance):
    """Every tenth ray meets nothing."""
    return np.where(np.arange(len(distance)) % 10, distance, np.inf)


def audit(work, cloud):
    return held(parts_of_scan(work, cloud, 0.05), stream(1, "audit"), 2.0)


def audit_of_drive(drives, found, caster):
    return held(parts_of_drive(drives, found, caster, 0.05), stream(1, "a"), 2.0)


@pytest.mark.slow
def test_a_right_scan_passes_and_says_what_it_took():
    shift = 5e5
    caster = BruteCaster(scene(shift=shift))
    looks = Terrestrial(position=(shift,) * 3, angle_step_deg=9, beam=Beam(subrays=7))
    found = audit(Scan(looks, caster), scan(looks, caster))
    assert found.kept, str(found)
    assert found.checked >= 8
    assert all(check.rms <= check.error <= check.allowed for check in found.checks)
    assert found.exact_seconds > 0


@pytest.mark.medium
@pytest.mark.parametrize("wrong", [lambda distance: distance * (1 + 1e-8), blind])
def test_a_wrong_engine_is_found(wrong):
    caster = Off(scene(), wrong)
    looks = Terrestrial(position=(0, 0, 0), angle_step_deg=9)
    found = audit(Scan(looks, caster), scan(looks, caster))
    assert not found.kept
    assert "MORE than" in str(found)


@pytest.mark.medium
def test_light_that_passes_leaves_is_followed_too():
    caster = BruteCaster(scene())
    shines = Surfaces(leaf_transmittance=0.3, passing="share")
    looks = Terrestrial(position=(0, 0, 0), angle_step_deg=9, surfaces=shines)
    cloud = scan(looks, caster)
    assert audit(Scan(looks, caster), cloud).kept
    behind = Off(scene(), lambda distance: distance * (1 + 1e-7))
    assert not audit(Scan(looks, behind), scan(looks, behind)).kept


def test_ranges_of_some_pulses_are_those_of_the_whole():
    caster, some = BruteCaster(scene()), np.arange(3, 400, 7)
    looks = Terrestrial(position=(0, 0, 0), angle_step_deg=5, beam=Beam(subrays=3))
    first = {pulse: r for pulse, n, r in zip(*columns(scan(looks, caster)), strict=True) if n == 1}
    whole = [first.get(pulse, np.inf) for pulse in some.tolist()]
    assert first_ranges(Scan(looks, caster), some) == pytest.approx(whole, rel=1e-12)
    drives = Tractor(position=(-4, -4, 0.5), track=6, step=0.5, angle_step_deg=5, splits=2)
    found = drive(drives, caster).distance.ravel()
    assert np.isfinite(found[some[:12]]).any()
    assert beam_ranges(drives, caster, some[:12]) == pytest.approx(found[some[:12]], rel=1e-12)


def columns(cloud):
    return cloud.pulse.tolist(), cloud.number.tolist(), cloud.true_range.tolist()


def test_of_the_rays_of_a_beam_that_meet_level_ground_at_once_any_is_right():
    """Strips of ground across the drive: the rays of a beam meet one each, at the same distance."""
    edge = np.arange(-4.0, 4.0, 0.3)
    ends = np.stack(np.meshgrid(edge, (-9.0, 9.0), (0.0,), indexing="ij"), axis=-1).reshape(-1, 3)
    first = 2 * np.arange(len(edge) - 1)[:, None]
    strips = np.concatenate([first + np.array([0, 1, 2]), first + np.array([1, 3, 2])])
    mesh = TriMesh.of_part(ends[:, [1, 0, 2]] * (-1, 1, 1), strips, LEAF)
    level = scene_with(mesh)
    place = {"position": (-6.0, -3.0, 1.0), "reach": 5.0, "top": 2.0}
    drives = Tractor(**place, track=6.0, step=0.5, angle_step_deg=5, splits=1)

    # Right, but for the last bits.
    caster = Off(level, lambda distance: distance * (1 - 1e-15 * (np.arange(len(distance)) % 97)))
    found = drive(drives, caster)
    assert (found.returns.triangle != drive(drives, BruteCaster(level)).returns.triangle).any()
    assert audit_of_drive(drives, found, caster).kept
    met = np.isfinite(found.returns.distance)
    wrong = np.where(met, found.returns.triangle + 4, -1)
    moved = replace(found, returns=replace(found.returns, triangle=wrong))
    assert not audit_of_drive(drives, moved, caster).kept


@pytest.mark.parametrize("seed", range(6))
def test_of_surfaces_that_lie_on_each_other_any_is_right(seed):
    """Roads in the ground, walls that stand there twice, boxes that share a face: by engines of single
    precision, in batches of any size."""
    from forest_addon.blender.rays.casters import make_caster

    rng = stream(seed, "ordinary")
    scene = ordinary(rng)
    caster = make_caster(scene, Rays(engine=str(rng.choice(["embree", "bvhtree"]))))
    turn, shift = scene.transform[0, :, :3], scene.transform[0, :, 3]
    place = shift + turn @ [*rng.uniform(-6, 6, 2), rng.uniform(3.2, 6)]
    beam = Beam(subrays=int(rng.choice([1, 3, 7, 19])))
    looks = {"angle_step_deg": 4.0, "elevation_deg": (-80, 30), "beam": beam}
    work = Scan(Terrestrial(position=tuple(place), **looks), caster, seed)
    pieces = work.chunks(at_once=int(rng.integers(200, 3000)))
    found = audit(work, join([piece for _, piece in pieces]))
    assert found.kept, str(found)
    low = max(place[2] - 2.5, 0.5)
    fan = {"track": 4.0, "step": 0.2, "angle_step_deg": 4.0, "top": low + 8.0}
    drives = Tractor(position=(*place[:2], low), splits=int(rng.integers(0, 3)), **fan)
    found = audit_of_drive(drives, drive(drives, caster), caster)
    assert found.kept, str(found)


def test_a_drive_along_the_lines_of_a_grid_of_ground_is_right():
    """Beams pass corners by less than single precision tells; what is named elsewhere is wrong."""
    from forest_addon.blender.rays.casters import make_caster

    ticks = np.linspace(-4.9, 17.1, 111).astype(np.float32).astype(float)
    places = np.stack([*np.meshgrid(ticks, ticks), np.zeros((111, 111))], axis=-1).reshape(-1, 3)
    corner = (np.arange(110)[:, None] * 111 + np.arange(110)).ravel()[:, None]
    cells = np.concatenate([corner + np.array(way) for way in ((0, 1, 112), (0, 112, 111))])
    ground = TriMesh.of_part(places, cells, LEAF)
    one = replace(scene_with(ground), transform=np.eye(4)[None, :3])
    drives = Tractor(position=(-3.0, 0.1, 1.3), track=5.0, gap=199)
    caster = make_caster(one, Rays(engine="embree"))
    found = drive(drives, caster)

    assert audit_of_drive(drives, found, caster).kept
    other = np.where(found.returns.triangle < 0, -1, (found.returns.triangle + 9) % len(cells))
    moved = replace(found, returns=replace(found.returns, triangle=other))
    assert not audit_of_drive(drives, moved, caster).kept


def ray_errors(caster, origins, ways, reach):
    """(R,) metres between an engine and float64; a miss counts as a hit at ``reach``."""
    both = (one.cast(origins, ways, reach).distance for one in (caster, Referee(caster)))
    return np.abs(np.subtract(*(np.minimum(distance, reach) for distance in both)))


def test_either_side_of_an_edge_is_right():
    """A ray along the rim of a triangle: that the engine misses what brute force hits is no error."""
    mesh = TriMesh.of_part(
        np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 1]]), np.array([[0, 1, 2]]), LEAF
    )
    caster = Off(scene_with(mesh), blind)
    way = np.array([[1.0, 0.3, 1e-7]])
    assert ray_errors(caster, np.zeros((1, 3)), way, 50.0) == 0.0
    assert ray_errors(caster, np.zeros((1, 3)), np.array([[1.0, 0.3, 0.3]]), 50.0) > 40.0


def test_of_two_surfaces_that_single_precision_cannot_part_either_is_right():
    """A ray 1e-7 m inside of an outer edge meets the front, and the back 2e-7 m behind it."""
    place = np.array([[1.0, 0, 0], [2.0, 1, 0], [2.0, -1, 0], [1.0, 0, 1]])
    both = TriMesh.of_part(place, np.array([[0, 1, 3], [0, 3, 2]]), LEAF)
    wedge = scene_with(both)
    origin, way = np.array([[1.0 + 1e-7, -5.0, 0.3]]), np.array([[0.0, 1.0, 0.0]])
    behind = both.select(np.array([True, False]))

    class Later(BruteCaster):
        """Finds the back."""

        def __init__(self, factor=1.0):
            super().__init__(wedge)
            self._back = BruteCaster(scene_with(behind))
            self._factor = factor

        def cast(self, *rays, **limits):
            found = self._back.cast(*rays, **limits)
            return replace(found, distance=found.distance * self._factor)

    first = BruteCaster(wedge).cast(origin, way, 50.0).distance
    assert 1e-8 < Later().cast(origin, way, 50.0).distance - first < 1e-6
    assert ray_errors(Later(), origin, way, 50.0) < 1e-12
    assert ray_errors(Later(1 + 1e-8), origin, way, 50.0) > 1e-9


def test_an_error_that_is_no_number_is_not_kept():
    assert not Check("x", 1, 1, float("nan"), 0.0, 1.0).kept
