"""Light that comes back from walls, edges, leaves and twigs, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from references.rays import BruteCaster, ground, level, scene_with, sheet, wall
from scipy import stats
from scipy.spatial.transform import Rotation
from scipy.special import erf

from forest_addon.base.rng import first_key
from forest_addon.base.trimesh import GROUND, LEAF, OTHER, WOOD, TriMesh
from forest_addon.formats.toml_file import read_scanner, scanner_names
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar import tractor as driven
from forest_addon.sensing.lidar.cloud import ESCAPED
from forest_addon.sensing.lidar.footprint import places
from forest_addon.sensing.lidar.occlusion import occlusion, on_the_line
from forest_addon.sensing.lidar.radiometry import registration
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.lidar.waveform import LIGHT, pulse_length
from forest_addon.sensing.rays.cells import Cells
from forest_addon.spec import Beam, Noise, SpecError, Surfaces, Terrestrial, Tractor

CHANCE = 4.5  # standard deviations: a right program fails in 7 of a million tests


def along_x(pulses=1, **settings):
    """A scanner whose pulses all go almost exactly along X."""
    settings = {"min_range": 0.0, "max_range": 1000.0} | settings
    return Terrestrial(
        position=(0.0, 0.0, 0.0),
        azimuth_deg=(0.0, 1e-7),
        elevation_deg=(0.0, 1e-7),
        angle_step_deg=1.0 if pulses == 1 else 1e-7 / (pulses - 1),
        line_step_deg=90.0,
        **settings,
    )


def look(scanner, *meshes, seed=0):
    return scan(scanner, BruteCaster(scene_with(*meshes)), seed)


# ------------------------------------------------------------------------------------- radiometry


@pytest.mark.parametrize(("distance", "subrays"), [(1.0, 1), (17.3, 19), (400.0, 19)])
def test_a_facing_wall(distance, subrays):
    beam = Beam(subrays=subrays, divergence_mrad=(0.3, 0.3), exit_diameter=0.005)
    cloud = look(along_x(beam=beam, surfaces=Surfaces(other=0.8)), sheet(distance))
    assert cloud.intensity[0] == pytest.approx(0.8 / distance**2, rel=1e-6)
    assert cloud.true_range[0] == pytest.approx(distance, rel=1e-7)
    assert cloud.width[0] == pytest.approx(pulse_length(4.0) * 2 / LIGHT, rel=1e-6)
    assert cloud.returns.cos_incidence[0] == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("tilt", [0.3, 0.9, 1.3])
def test_a_tilted_plane_dims_by_the_cosine_and_widens_the_echo(tilt):
    beam = Beam(subrays=400, divergence_mrad=(2.0, 2.0), pulse_ns=1.0)
    cloud = look(along_x(beam=beam), sheet(100.0, tilt=tilt))
    assert cloud.intensity[0] == pytest.approx(0.5 * np.cos(tilt) / 100**2, rel=1e-3)
    spread = 0.1 / 2 * np.tan(tilt)  # the footprint's sd is half its radius at 1/e²
    expected = np.hypot(pulse_length(1.0), spread) * 2 / LIGHT
    assert cloud.width[0] == pytest.approx(expected, rel=1e-2)
    assert cloud.true_range[0] == pytest.approx(100, abs=1e-2 * spread)


def test_each_part_has_its_reflectance_and_objects_may_say_their_own():
    surfaces = Surfaces(other=0.1, wood=0.2, leaf=0.3, ground=0.4)
    for part, share in ((OTHER, 0.1), (WOOD, 0.2), (LEAF, 0.3), (GROUND, 0.4)):
        cloud = look(along_x(surfaces=surfaces), sheet(10.0, part))
        assert cloud.intensity[0] == pytest.approx(share / 100)
    scene = replace(scene_with(sheet(10.0)), reflectance=np.array([0.77]))
    cloud = scan(along_x(surfaces=surfaces), BruteCaster(scene))
    assert cloud.intensity[0] == pytest.approx(0.0077)


@pytest.mark.parametrize("where", ["object", "material"])
@pytest.mark.parametrize(
    ("part", "says", "passes", "right"),
    [
        (LEAF, 0.7, 0.4, False),
        (LEAF, 0.6, 0.4, True),
        (WOOD, 0.7, 0.4, True),
        (WOOD, 1.2, 0.0, False),
        (OTHER, -0.1, 0.0, False),
    ],
)
def test_nor_does_what_says_its_own_reflectance(where, part, says, passes, right):
    scene = scene_with(sheet(10.0, part))
    if where == "object":
        scene = replace(scene, reflectance=np.array([says]))
    else:
        scene = replace(scene, slot_reflectance=(np.array([says]),))
    scanner = along_x(surfaces=Surfaces(leaf=0.3, leaf_transmittance=passes))
    if right:
        assert len(scan(scanner, BruteCaster(scene))) <= 1
        return
    with pytest.raises(SpecError, match=r'forest_reflectance: "x"'):
        scan(scanner, BruteCaster(scene))


# ---------------------------------------------------------------------------------------- echoes


def edge_scene(share_of_radius):
    """A near wall up to an edge in the footprint, a far wall behind it: w = 0.05 m at 100 m."""
    return sheet(100.0, high=share_of_radius * 0.05), sheet(130.0)


@pytest.mark.parametrize("edge", [-0.8, 0.5])
def test_an_edge_shares_the_pulse_by_the_error_function(edge):
    beam = Beam(subrays=1000, divergence_mrad=(1.0, 1.0), max_returns=5)
    cloud = look(along_x(beam=beam), *edge_scene(edge))
    near = 0.5 + 0.5 * erf(np.sqrt(2) * edge)
    assert cloud.number.tolist() == [1, 2]
    assert cloud.count.tolist() == [2, 2]
    assert cloud.true_range == pytest.approx([100, 130], abs=1e-4)
    assert cloud.intensity[0] * 2 * 100**2 == pytest.approx(near, abs=0.005)
    assert cloud.intensity[1] * 2 * 130**2 == pytest.approx(1 - near, abs=0.005)
    assert cloud.returns.instance.tolist() == [0, 1]


def test_a_thin_twig_far_away_returns_its_share_of_the_footprint():
    # 0.5 mm at 80 m in a beam of 0.3 mrad: 2.4 % of the light, often between two sub-rays.
    beam = Beam(subrays=100, divergence_mrad=(0.3, 0.3))
    scanner = along_x(pulses=400, beam=beam)
    cloud = look(scanner, sheet(80.0, WOOD, low=-0.00025, high=0.00025))
    share = erf(np.sqrt(2) * 0.00025 / 0.012)
    mean = cloud.intensity.sum() / cloud.pulses
    assert mean == pytest.approx(0.5 * share / 80**2, rel=0.15)
    assert cloud.true_range == pytest.approx(80, abs=1e-4)


# ---------------------------------------------------------------------------------------- leaves


def leaves(count, gap=2.0):
    return [sheet(10.0 + gap * n, LEAF) for n in range(count)]


@pytest.mark.parametrize("transmittance", [0.2, 0.7])
def test_rays_pass_leaves_by_the_binomial_law(transmittance):
    surfaces = Surfaces(leaf=0.3, leaf_transmittance=transmittance)
    cloud = look(along_x(pulses=4000, surfaces=surfaces), *leaves(4), sheet(50.0, GROUND))
    assert len(cloud) == cloud.pulses  # each ray ends once
    for passed in range(5):
        chance = transmittance**passed * (1 - transmittance if passed < 4 else 1)
        count = np.count_nonzero(cloud.returns.instance == passed)
        deviation = np.sqrt(cloud.pulses * chance * (1 - chance))
        assert abs(count - cloud.pulses * chance) < CHANCE * deviation + 1, passed


def test_a_share_of_the_light_passes_each_leaf_there_and_back():
    surfaces = Surfaces(leaf=0.45, ground=0.3, leaf_transmittance=0.4, passing="share")
    scanner = along_x(surfaces=surfaces, beam=Beam(max_returns=15))
    cloud = look(scanner, *leaves(3), sheet(50.0, GROUND))
    distance = np.array([10, 12, 14, 50.0])
    expected = np.array([0.45, 0.45, 0.45, 0.3]) * 0.4 ** (2 * np.arange(4)) / distance**2
    assert cloud.intensity == pytest.approx(expected, rel=1e-9)
    assert cloud.true_range == pytest.approx(distance)
    assert cloud.number.tolist() == [1, 2, 3, 4]


def test_wood_lets_nothing_pass():
    surfaces = Surfaces(leaf=0.01, leaf_transmittance=0.99)
    cloud = look(along_x(pulses=200, surfaces=surfaces), sheet(10.0, WOOD), sheet(20.0, GROUND))
    assert (cloud.returns.organ == WOOD).all()


# --------------------------------------------------------------------------------- noise, limits


def noisy(pulses=20_000, **noise):
    return along_x(pulses=pulses, noise=Noise(**noise))


@pytest.mark.parametrize("tilt", [0.3, 0.9, 1.3])
def test_light_that_a_tilted_plane_spreads_is_harder_to_see(tilt):
    """The crest of the echo is lower by its width over the pulse's, as a Gaussian of that width says."""
    beam = Beam(divergence_mrad=(2.0, 2.0), subrays=300, pulse_ns=1.0)
    spread = 0.1 / 2 * np.tan(tilt)  # the footprint's sd is half its radius at 1/e²
    pulse = 1e-9 * 299_792_458 / 2 / (2 * np.sqrt(2 * np.log(2)))
    crest = 0.5 * np.cos(tilt) * pulse / np.hypot(pulse, spread)  # of a white plane's
    for share, seen in ((0.98, 1), (1.02, 0)):
        scanner = along_x(beam=beam, max_range=120.0, faintest=share * crest * 1.2**2)
        assert len(look(scanner, sheet(100.0, tilt=tilt))) == seen


@pytest.mark.parametrize(
    ("noise", "tilt", "expected"),
    [
        ({"range_sd": 0.02}, 0.0, 0.02),
        ({"range_ppm": 500.0}, 0.0, 0.05),
        ({"incidence_sd": 0.01}, 1.0, 0.01 * np.tan(1.0)),
        ({"range_sd": 0.03, "range_ppm": 400.0}, 0.0, 0.05),
    ],
)
def test_ranges_scatter_as_stated(noise, tilt, expected):
    cloud = look(noisy(**noise), sheet(100.0, tilt=tilt))
    error = (cloud.returns.distance - cloud.true_range) / expected
    count = len(error)
    assert abs(error.mean()) < CHANCE / np.sqrt(count)
    assert abs(error.var() - 1) < CHANCE * np.sqrt(2 / count)
    assert abs(np.mean(error**4) - 3) < CHANCE * np.sqrt(96 / count)
    after = np.mean(error[1:] * error[:-1])
    assert abs(after) < CHANCE / np.sqrt(count)  # neighbours know nothing of each other
    away = np.linalg.norm(cloud.position, axis=1)
    assert away == pytest.approx(cloud.returns.distance)


def test_scans_are_joined_amiss_as_rigid_bodies():
    """Of 60 seeds the squares of turns and shifts over their variances are χ² of 180 each: false alarm below
    2e-6."""
    wall, field = sheet(100.0, tilt=0.4), {"azimuth_deg": (-6.0, 6.0), "elevation_deg": (-6.0, 6.0)}
    scanner = Terrestrial(position=(0.0, 0.0, 0.0), max_range=500.0, angle_step_deg=3.0, **field)
    amiss = replace(scanner, noise=Noise(registration_sd=0.02, registration_deg=0.1))
    still, sums = look(scanner, wall).position, np.zeros(2)
    for seed in range(60):
        moved = look(amiss, wall, seed=seed).position
        turn, _ = Rotation.align_vectors(moved - moved.mean(axis=0), still - still.mean(axis=0))
        assert np.ptp(moved - turn.apply(still), axis=0) == pytest.approx(0.0, abs=1e-9)
        shift = moved.mean(axis=0) - turn.apply(still.mean(axis=0))  # of a scanner at the origin
        sums += (np.rad2deg(turn.magnitude()) / 0.1) ** 2, (np.linalg.norm(shift) / 0.02) ** 2
    low, high = stats.chi2.ppf([5e-7, 1 - 5e-7], 180)
    assert (low < sums).all()
    assert (sums < high).all()


def test_errors_of_a_line_change_along_it_and_are_as_wide_everywhere():
    """Shifts of 400 seeds at a knot, at an eighth and in the middle between two: sums of squares are χ² of
    1,200 each, false alarm below 6e-6; neighbouring pulses are moved alike, those of other knots not."""
    noise = Noise(registration_sd=0.03, registration_deg=0.01, registration_s=2.0)
    time = np.array([2.0, 2.25, 3.0, 3.0 + 1e-6, 8.0])
    drawn = [registration(noise, first_key(k, "lidar", "a"), time) for k in range(400)]
    shift = np.array([shift for _, shift in drawn]) / 0.03
    turn = np.rad2deg([turn.as_rotvec() for turn, _ in drawn]) / 0.01
    low, high = stats.chi2.ppf([2e-7, 1 - 2e-7], 1200)
    for moved in (shift, turn):
        sums = (moved**2).sum(axis=(0, 2))
        assert (low < sums).all()
        assert (sums < high).all()
        assert np.abs(moved[:, 3] - moved[:, 2]).max() < 1e-5
        alike = (moved[:, :1] * moved).mean(axis=(0, 2))
        expected = [1.0, np.cos(np.pi / 16), np.cos(np.pi / 4), np.cos(np.pi / 4), 0.0]
        assert alike == pytest.approx(expected, abs=0.2)


def test_returns_drop_out_by_chance():
    cloud = look(noisy(drop_out=0.3), sheet(100.0))
    lost = cloud.pulses - len(cloud)
    assert abs(lost - 0.3 * cloud.pulses) < CHANCE * np.sqrt(cloud.pulses * 0.3 * 0.7)


def test_another_seed_or_name_is_other_noise():
    wall = sheet(100.0)
    first = look(noisy(pulses=50, range_sd=0.1), wall)
    again = look(noisy(pulses=50, range_sd=0.1), wall)
    seed = look(noisy(pulses=50, range_sd=0.1), wall, seed=1)
    other = look(replace(noisy(pulses=50, range_sd=0.1), name="other"), wall)
    assert (first.returns.distance == again.returns.distance).all()
    assert not np.isin(seed.returns.distance, first.returns.distance).any()
    assert not np.isin(other.returns.distance, first.returns.distance).any()


@pytest.mark.medium
@pytest.mark.parametrize("at_once", [1, 64])
def test_chunks_do_not_change_a_byte(at_once):
    scanner = along_x(
        pulses=150,
        beam=Beam(subrays=5, divergence_mrad=(2.0, 2.0), max_returns=3),
        surfaces=Surfaces(leaf_transmittance=0.5),
        noise=Noise(range_sd=0.1, incidence_sd=0.1, drop_out=0.2),
    )
    work = Scan(
        scanner, BruteCaster(scene_with(sheet(30.0, LEAF, high=0.01), sheet(60.0, tilt=0.5)))
    )
    whole = work.look(0, work.pulses)
    pieces = [cloud for _, cloud in work.chunks(at_once=at_once)]
    for name in ("position", "pulse", "number", "count", "intensity", "width", "true_range"):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert joined.tobytes() == getattr(whole, name).tobytes(), name


@pytest.mark.parametrize(
    ("low", "high", "seen"),
    [(20.0, 90.0, True), (0.0, 20.0, True), (np.nextafter(20.0, 21), 90.0, False),
     (0.0, np.nextafter(20.0, 19), False)],
)  # fmt: skip
def test_limits_are_inclusive_to_the_last_digit(low, high, seen):
    assert len(look(along_x(min_range=low, max_range=high), sheet(20.0))) == seen


def test_what_is_too_near_hides_what_is_behind():
    assert len(look(along_x(min_range=5.0), sheet(3.0), sheet(20.0))) == 0


def test_noise_does_not_move_a_return_in_or_out_of_the_limits():
    cloud = look(along_x(pulses=500, max_range=20.0, noise=Noise(range_sd=1.0)), sheet(20.0))
    assert len(cloud) == cloud.pulses
    assert cloud.returns.distance.max() > 20.5


# ---------------------------------------------------------------------------------------------- scan
# Scanners in scenes whose every distance is known in closed form.


def test_a_full_circle_has_no_beam_twice():
    cloud = scan(
        Terrestrial(angle_step_deg=5.0, elevation_deg=(-40.0, -10.0)),
        BruteCaster(scene_with(ground())),
    )
    assert cloud.pulses == 72 * 7
    assert len(np.unique(np.round(cloud.position, 6), axis=0)) == len(cloud.position)


# ------------------------------------------------------------------------------------------- patches
# Grazing incidence: what goes on between sub-rays is one echo, what does not is apart.

FLAT = BruteCaster(scene_with(ground(5000.0)))
SPREADS = (0.3, 1.2, 3.0, 12.0)  # of the footprint in range, in pulse lengths


def beams():
    """Those of all instruments whose pulse is Gaussian, each at a spread: the crest of another pulse moves as
    it gets longer."""
    tables = {
        name: next(iter(read_scanner(name).tables.values()))["beam"] for name in scanner_names()
    }
    found = []
    for name, table in tables.items():
        if "pulse_shape" not in table:
            beam = Beam(**table | {"divergence_mrad": tuple(table["divergence_mrad"])})
            found.append(pytest.param(beam, SPREADS[len(found) % len(SPREADS)], id=name))
    return found


def down(beam, height, distance, pulses=24, **settings):
    """Pulses from a height onto flat ground at a distance, around a quarter of a turn."""
    elevation = -np.rad2deg(np.arcsin(height / distance))
    return Terrestrial(
        position=(0.0, 0.0, height),
        azimuth_deg=(0.0, 90.0),
        angle_step_deg=90.0 / pulses,
        elevation_deg=(elevation, elevation + 1e-9),
        line_step_deg=1.0,
        min_range=0.0,
        max_range=2000.0,
        beam=replace(beam, max_returns=15),
        **settings,
    )


def waveform_of_ground(beam, height, distance):
    """Mean and standard deviation of the light that flat ground sends back, by quadrature over the beam.

    Of each angle from the axis as much as the Gaussian beam has, times sin(elevation)/R².
    """
    width = np.hypot(beam.exit_diameter / 2, distance * beam.divergence_mrad[1] * 5e-4)
    turn = np.linspace(-7, 7, 4001) * width / 2 / distance
    elevation = np.arcsin(height / distance) + turn
    assert elevation.min() > 0
    at = height / np.sin(elevation)
    light = np.exp(-0.5 * (turn / (width / 2 / distance)) ** 2) * np.sin(elevation) / at**2
    light /= light.sum()
    mean = light @ at
    return mean, np.sqrt(light @ (at - mean) ** 2)


def grazing(beam, spread):
    """A height and a distance at which the footprint is about so many pulses long."""
    width = np.hypot(beam.exit_diameter / 2, 80 * beam.divergence_mrad[1] * 5e-4)
    return 80 * np.sin(np.arctan(width / 2 / spread / pulse_length(beam.pulse_ns))), 80.0


@pytest.mark.parametrize(("beam", "spread"), beams())
def test_flat_ground_is_one_echo_where_the_beam_meets_it(beam, spread):
    height, distance = grazing(beam, spread)
    cloud = scan(down(beam, height, distance), FLAT)
    mean, length = waveform_of_ground(beam, height, distance)
    sigma = pulse_length(beam.pulse_ns)
    assert len(cloud) == cloud.pulses
    assert (cloud.true_range - mean) == pytest.approx(0, abs=0.03 * length + 1e-3 * sigma)
    assert cloud.width * LIGHT / 2 == pytest.approx(
        np.hypot(sigma, length), rel=0.01 if spread < 5 else 0.03
    )


@pytest.mark.parametrize("subrays", [2, 3, 4, 9, 26, 150])
def test_any_number_of_rays_at_any_turn_makes_one_echo_of_a_plane(subrays):
    beam = Beam(subrays=subrays, divergence_mrad=(1.0, 1.0), pulse_ns=0.05)
    cloud = scan(down(beam, 2.0, 60.0, pulses=100), FLAT)
    mean, length = waveform_of_ground(beam, 2.0, 60.0)
    assert length > 60 * pulse_length(0.05)
    assert len(cloud) == cloud.pulses
    assert np.abs(cloud.true_range - mean).max() < 0.1 * length
    if subrays > 2:  # two lie on a line, which turns
        assert cloud.width * LIGHT / 2 == pytest.approx(length, rel=0.03)


@pytest.mark.parametrize("subrays", [91, 150, 397])
def test_flat_ground_hardly_below_the_horizon_is_one_echo_of_any_number_of_rays(subrays):
    beam = Beam(subrays=subrays, divergence_mrad=(2.0, 2.0))
    cloud = scan(down(beam, 1.7, 1.7 / np.cos(np.deg2rad(89.7)), pulses=60), FLAT)
    assert cloud.number.tolist() == [1] * cloud.pulses


@pytest.mark.parametrize("subrays", [3, 7, 19, 100])
def test_the_moments_of_the_rays_are_exact_along_every_axis(subrays):
    place = places(subrays)
    assert place.mean(axis=0) == pytest.approx([0, 0], abs=1e-15)
    assert place.T @ place / subrays == pytest.approx(np.eye(2) / 4, abs=1e-14)
    assert (np.diff(np.hypot(*place.T)) >= 0).all()


def hills(cell, relief=0.02):
    """Ground in square cells that rises and falls by so much over 40 m."""
    x, y = np.meshgrid(np.arange(0, 120, cell), np.arange(-6, 6, cell), indexing="ij")
    z = relief * np.sin(2 * np.pi * x / 40) * np.cos(2 * np.pi * y / 40)
    corners = np.stack([x, y, z], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(x.shape[0] - 1), np.arange(x.shape[1] - 1), indexing="ij")
    a = (i * x.shape[1] + j).ravel()
    b, c, d = a + x.shape[1], a + x.shape[1] + 1, a + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return TriMesh.of_part(corners, faces, GROUND)


def test_ground_of_many_small_triangles_is_one_echo_too():
    beam = Beam(subrays=7, divergence_mrad=(3.0, 1.5), exit_diameter=0.01, pulse_ns=6.0)
    scanner = replace(down(beam, 1.8, 70.0, pulses=1), azimuth_deg=(-1.0, 1.0), angle_step_deg=0.1)
    cloud = scan(scanner, BruteCaster(scene_with(hills(0.8))))
    assert len(cloud) == cloud.pulses == 21
    assert cloud.width.mean() * LIGHT / 2 > 2 * pulse_length(6.0)


BEAM = Beam(
    subrays=19, divergence_mrad=(0.7, 0.7), pulse_ns=2.0
)  # on ground 60 m away: 3 pulses long


def test_a_stem_before_the_ground_is_apart_from_it():
    stem = TriMesh.of_part(
        *tube(np.array([[48.0, 0, -1], [48.0, 0, 9.0]]), np.full(2, 0.01), 24), WOOD
    )
    scanner = replace(down(BEAM, 1.8, 60.0), azimuth_deg=(0.0, 1e-7), angle_step_deg=1e-8)
    cloud = scan(scanner, BruteCaster(scene_with(ground(), stem)))
    assert (np.bincount(cloud.pulse) == 2).all()
    stem, behind = cloud.number == 1, cloud.number == 2
    assert (cloud.returns.organ[stem] == WOOD).all()
    assert cloud.true_range[stem] == pytest.approx(48 / np.cos(np.arcsin(1.8 / 60)), abs=0.02)
    # What is left of the ground keeps the mean and the width of its own rays.
    assert cloud.true_range[behind] == pytest.approx(60, abs=0.5)
    assert (cloud.returns.organ[behind] == GROUND).all()


def steps(count, part):
    """Level plates one after the other, each 1 m long, 1 m from the next, 4 cm below it."""
    return [level((20 + 2 * n, -9), (21 + 2 * n, 9), 0.04 * n, part) for n in range(count)]


@pytest.mark.parametrize("part", [OTHER, LEAF])
def test_plates_one_behind_the_other_stay_apart(part):
    beam = Beam(subrays=100, divergence_mrad=(1.0, 16.0), pulse_ns=0.5, max_returns=9)
    scanner = replace(down(beam, 1.0, 24.0), azimuth_deg=(0.0, 1e-7), angle_step_deg=1e-8)
    plates = steps(4, part)
    cloud = scan(scanner, BruteCaster(scene_with(*plates)))
    order = np.argsort(cloud.pulse * 1000 + cloud.true_range)
    each = [set(cloud.returns.instance[order][cloud.pulse[order] == p]) for p in range(3)]
    assert all(len(one) >= 3 for one in each)
    middle = np.array([20.5, 22.5, 24.5, 26.5])[cloud.returns.instance]
    assert np.abs(cloud.true_range - middle).max() < 0.7  # each echo is on its plate


def test_leaves_at_grazing_incidence_are_not_spread():
    beam = Beam(subrays=19, divergence_mrad=(1.0, 1.0), pulse_ns=1.0, max_returns=9)
    blades = [level((30 + 2 * n, -1), (30.05 + 2 * n, 1), -0.01 * n, LEAF) for n in range(3)]
    scanner = replace(
        down(beam, 0.02, 32.0), position=(0.0, 0.0, 0.02), elevation_deg=(-0.04, -0.04 + 1e-9)
    )
    scanner = replace(scanner, azimuth_deg=(0.0, 1e-7), angle_step_deg=1e-8)
    cloud = scan(scanner, BruteCaster(scene_with(*blades)))
    assert len(cloud)
    assert cloud.width * LIGHT / 2 == pytest.approx(pulse_length(1.0), rel=0.01)


def test_the_light_stays_what_it_was():
    beam = Beam(subrays=19, divergence_mrad=(3.0, 1.5), pulse_ns=2.0)
    cloud = scan(down(beam, 1.8, 80.0), FLAT)
    short = scan(down(replace(beam, pulse_ns=1000.0), 1.8, 80.0), FLAT)  # nothing is spread
    assert cloud.intensity == pytest.approx(short.intensity, rel=1e-12)
    assert cloud.true_range == pytest.approx(short.true_range, abs=0.05)


# ----------------------------------------------------------------------------------------- occlusion
# What a scan could not see, in scenes of walls where it is plain.

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


# ------------------------------------------------------------------------------------------ tractor
# SIMLIDAR's tractor in scenes whose every distance is known in closed form.

TRACTOR = Tractor(position=(1.0, 0.0, 1.0), track=0.1, step=0.002, gap=9, reach=5.0, top=4.0)


@pytest.fixture
def simlidar():
    return pytest.importorskip("studies.papers.simlidar")


def test_the_fan_and_the_track_are_simlidars():
    angle, track = driven.fan(TRACTOR), driven.positions(TRACTOR)
    assert angle[0] == pytest.approx(-np.arctan(1 / 5))
    assert np.diff(angle) == pytest.approx(np.deg2rad(0.25))
    assert np.arctan(3 / 5) - np.deg2rad(0.25) < angle[-1] <= np.arctan(3 / 5) + 1e-12
    assert track == pytest.approx([0, 0.02, 0.04, 0.06, 0.08, 0.1])


def test_ground_and_sky_without_trees():
    scan = driven.drive(TRACTOR, BruteCaster(scene_with(ground())))
    down = scan.angle < 0
    # The lowest beam meets z = 0 at the reach; beams at or above the horizon escape.
    expected = 1.0 / np.sin(-scan.angle[down])
    seen = expected <= TRACTOR.max_range
    assert scan.distance[:, down][:, seen] == pytest.approx(np.tile(expected[seen], (6, 1)))
    assert np.isinf(scan.distance[:, down][:, ~seen]).all()
    assert np.isinf(scan.distance[:, ~down]).all()
    assert (scan.organ[:, ~down] == ESCAPED).all()
    assert (scan.organ[:, down][:, seen] == GROUND).all()


@pytest.mark.parametrize(
    ("heading", "side", "x"), [(90, "right", 6.0), (-90, "left", 6.0), (90, "left", -4.0)]
)
def test_a_wall_beside_the_track(heading, side, x):
    tractor = Tractor(
        position=(1.0, 0.0, 1.0),
        track=0.1,
        gap=9,
        reach=8.0,
        top=4.0,
        heading_deg=heading,
        side=side,
    )
    scan = driven.drive(tractor, BruteCaster(scene_with(ground(), wall(x))))
    high = scan.angle > -np.arctan(1 / 5)  # lower beams meet the ground before the wall
    assert scan.distance[:, high] == pytest.approx(np.tile(5 / np.cos(scan.angle[high]), (6, 1)))
    assert (scan.organ[:, high] == WOOD).all()
    assert (scan.returns.tree.reshape(scan.organ.shape)[:, high] == 0).all()


def test_a_beam_that_begins_on_a_surface_has_a_finite_intensity():
    scan = driven.drive(TRACTOR, BruteCaster(scene_with(ground(), wall(-4.0))))
    met = np.flatnonzero(np.isfinite(scan.returns.distance))
    scan.returns.distance[met[:5]] = 0.0
    cloud = driven.to_cloud(scan, TRACTOR)
    assert np.isfinite(cloud.intensity).all()
    assert cloud.true_range[0] == 0


# -------------------------------------------------------------------------------------- wood indices
# Indices of wood against closed forms, and S's solid beam against the sector that it stands for.

WOOD_INDICES_TRACTOR = Tractor(
    position=(1.0, 0.0, 1.0), track=0.098, step=0.002, reach=4.0, top=5.0
)


def post(x, low, high):
    """A board at right angles to the beams."""
    return sheet(x, WOOD, low=low, high=high)


def test_a_wall_has_its_distance_times_the_fan(simlidar):
    """l·cos θ = D, so the sum tends to D·(θ₂ - θ₁) a metre of track, to about a step of θ."""
    far = 3.0
    fine = replace(
        WOOD_INDICES_TRACTOR, angle_step_deg=0.05, reach=20.0
    )  # above the horizon: a wall, no ground
    scan = driven.drive(fine, BruteCaster(scene_with(ground(), wall(1.0 + far))))
    areas = simlidar.beam_areas(scan, fine)
    above = scan.angle >= 0
    step = np.deg2rad(0.05)
    exact = fine.step * far * (np.sin(scan.angle + step) - np.sin(scan.angle)) / np.cos(scan.angle)
    assert areas[:, above] == pytest.approx(np.tile(exact[above], (50, 1)), rel=1e-12)
    span = scan.angle[-1] + step - scan.angle[above][0]
    assert areas[:, above].sum() == pytest.approx(50 * 0.002 * far * span, rel=step)
    assert (areas[scan.organ != WOOD] == 0).all()
    # With θ from the vertical the same sum is D·∫tan θ = D·ln(cos θ₁/cos θ₂).
    upright = simlidar.beam_areas(scan, fine, from_vertical=True)[:, above].sum()
    logarithm = np.log(np.cos(scan.angle[above][0]) / np.cos(scan.angle[-1] + step))
    assert upright == pytest.approx(50 * 0.002 * far * logarithm, rel=2 * step)


@pytest.mark.medium
def test_a_vertical_cylinder_has_its_visible_front(simlidar):
    """At y from the axis, l·cos θ = D - √(r² - y²); over y and θ that is (2rD - πr²/2)·(θ₂ - θ₁)."""
    r, far = 0.04, 1.5
    points = np.array([[1.0 + far, 0.05, -60.0], [1.0 + far, 0.05, 60.0]])
    vertices, triangles = tube(points, np.full(2, r), 64)
    scene = scene_with(ground(), TriMesh.of_part(vertices, triangles, WOOD))
    tractor = replace(WOOD_INDICES_TRACTOR, step=0.0005, track=0.1, angle_step_deg=1.0)
    scan = driven.drive(tractor, BruteCaster(scene))
    areas = simlidar.beam_areas(scan, tractor)[:, scan.angle > 0]
    wide = np.sin(scan.angle + np.deg2rad(1.0)) - np.sin(scan.angle)
    fan = (wide / np.cos(scan.angle))[scan.angle > 0].sum()  # S's sum in place of θ₂ - θ₁
    assert areas.sum() == pytest.approx((2 * r * far - np.pi * r**2 / 2) * fan, rel=0.01)


def test_areas_by_tree_add_up_to_the_orchard(simlidar):
    scene = scene_with(ground(), post(3.0, 0.011, 0.031), post(4.0, 0.021, 0.071))
    scan = driven.drive(WOOD_INDICES_TRACTOR, BruteCaster(scene))
    by_tree = simlidar.impacted_by_tree(scan, WOOD_INDICES_TRACTOR, 2)
    assert by_tree.sum() == pytest.approx(
        simlidar.beam_areas(scan, WOOD_INDICES_TRACTOR).sum(), rel=1e-12
    )
    # 10 scans at 2 m; of the 25 at 3 m the first 5 are hidden.
    assert by_tree[0] / by_tree[1] == pytest.approx(2.0 / 3.0 * 10 / 20, rel=1e-12)


@pytest.mark.parametrize("parts", [1, 2, 4])
@pytest.mark.parametrize("gap", [0, 3])
def test_a_solid_beam_meets_whatever_is_in_its_sector(parts, gap):
    """A board wider than Δy/P is never passed, so the beams that meet it are those whose sector does."""
    tractor = replace(WOOD_INDICES_TRACTOR, splits=parts, gap=gap, angle_step_deg=5.0)
    width = 0.002 / parts * 1.01
    for low in np.linspace(0.0401, 0.0479, 7):
        scan = driven.drive(tractor, BruteCaster(scene_with(ground(), post(2.0, low, low + width))))
        sector = (scan.track <= low + width) & (scan.track + tractor.step >= low)
        assert np.array_equal((scan.organ == WOOD).all(axis=1), sector)
        assert np.array_equal((scan.organ == WOOD).any(axis=1), sector)


@pytest.mark.medium
def test_one_ray_passes_what_a_solid_beam_meets():
    """On a track of 2 mm a board of 0.5 mm is met by one ray in four, and always by P = 4."""
    lows = 0.04 + 0.002 * np.arange(0.005, 1, 0.01)
    met = {0: 0, 4: 0}
    for parts in met:
        tractor = replace(WOOD_INDICES_TRACTOR, splits=parts, angle_step_deg=45.0)
        for low in lows:
            scene = scene_with(ground(), post(2.0, low, low + 0.0005))
            met[parts] += bool((driven.drive(tractor, BruteCaster(scene)).organ == WOOD).any())
    assert met == {0: 25, 4: 100}


def test_the_nearest_hit_of_the_sector_counts():
    """A slanting wall is nearest at a corner of the sector, which is one of its rays."""
    a, b = 2.0, 0.5  # x = a + b·y
    slant = sheet(a, WOOD, np.arctan(b), -1.0, 1.0)
    tractor = replace(WOOD_INDICES_TRACTOR, splits=2, angle_step_deg=1.0, track=0.02)
    scan = driven.drive(tractor, BruteCaster(scene_with(slant)))
    within = np.linspace(0.0, 1.0, 101)
    y = scan.track[:, None] + tractor.step * within
    theta = scan.angle[:, None] + np.deg2rad(1.0) * within
    least = (a - 1.0 + b * y).min(axis=1)[:, None] / np.cos(theta).max(axis=1)
    steep = np.abs(scan.angle + np.deg2rad(0.5)) > np.deg2rad(0.5)  # else θ = 0 lies within
    assert scan.distance[:, steep] == pytest.approx(least[:, steep], rel=1e-12)
    assert (scan.distance >= least - 1e-12).all()


def test_one_part_of_none_is_the_ray_of_before():
    """P = 0 casts the beam's own ray; every larger P holds it, so nothing is farther."""
    scene = scene_with(ground(), post(2.0, 0.03, 0.05), wall(4.0))
    one = driven.drive(WOOD_INDICES_TRACTOR, BruteCaster(scene)).distance
    two = driven.drive(replace(WOOD_INDICES_TRACTOR, splits=2), BruteCaster(scene)).distance
    assert (two <= one + 1e-9).all()
    assert (two < one - 1e-3).any()


def test_the_escape_value_stands_in_the_matrix_only():
    tractor = replace(WOOD_INDICES_TRACTOR, escape=-1.0)
    scan = driven.drive(tractor, BruteCaster(scene_with(ground())))
    assert (scan.matrix[np.isinf(scan.distance)] == -1.0).all()
    assert np.array_equal(scan.matrix[scan.organ != -1], scan.distance[scan.organ != -1])
    assert np.isinf(
        driven.drive(WOOD_INDICES_TRACTOR, BruteCaster(scene_with(ground()))).matrix
    ).any()
