"""The forest's impulse response against scalar loops, and its hard cases (PHYSICS 5.8)."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from references.echoes import scene_of
from references.rays import BruteCaster, scene_with
from references.reverb import reverb_spectrum_direct
from scipy import special

from forest_addon.acoustics.air import absorption
from forest_addon.acoustics.ground import spherical_reflection, surface_impedance
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh, join
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.bands import roll_off
from forest_addon.sensing.reverb.channels import ImpulseResponse
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.sums.scattering import scattered_spectrum, trunk_paths
from forest_addon.sensing.reverb.trunks import (
    STEP,
    TrunkCuts,
    Trunks,
    continue_trunks,
    convex_hull,
    equivalent_circle,
    trunks_at_height,
)
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
NOTHING = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, np.int64))


def forest(*rows: tuple[float, float, float]) -> Trunks:
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return Trunks(table[:, :2], table[:, 2], np.arange(len(table)))


def listen(
    trunks: Trunks, air: Air = AIR, wood: BruteCaster | None = None, **settings: Any
) -> ImpulseResponse:
    reverb = Reverb(**{"duration": 0.4, "sample_rate": 8000.0, **settings})
    return impulse_response(trunks, reverb, air, wood=wood)


def scattered_trunks(count: int, seed: int = 0) -> Trunks:
    rng = np.random.default_rng(seed)
    return Trunks(rng.uniform(-15, 35, (count, 2)), rng.uniform(0.02, 0.4, count), np.arange(count))


def test_spectra_against_scalar_loops() -> None:
    """Every part at single frequencies; five radii over two octaves of panels, one twice."""
    trunks = forest(
        (9, 11, 0.3), (12, 9, 0.3), (3, 10, 0.07), (25, 10, 0.11), (10, 10, 0.04), (-5, 30, 0.5)
    )
    source, receiver = np.array([5.0, 10.0]), np.array([15.0, 10.5])
    conditions = -20.0, 10.0, 80.0
    air = Air(temperature_c=conditions[0], humidity=conditions[1], pressure_kpa=conditions[2])
    spacing = 2.5
    frequency = spacing * np.arange(4801)
    loss = absorption(frequency, *conditions)
    paths = trunk_paths(trunks, source, receiver, 1.5, 0.6)
    spectrum = scattered_spectrum(paths, spacing, loss, air.speed())
    for bin_ in [0, 1, 2, 3, 10, 55, 217, 1000, 2345, 3999, 4800]:
        expected = reverb_spectrum_direct(
            frequency[bin_],
            (*source, 1.5),
            (*receiver, 1.0),
            [(x, y, a) for (x, y), a in zip(trunks.position, trunks.radius, strict=True)],
            speed=air.speed(),
            air=conditions,
            ground=-0.6,
            strength=1.5,
            spreading=0.6,
        )[2]
        assert abs(spectrum[bin_] - expected) < 1e-11 * np.abs(spectrum).max()


def test_samples_against_scalar_loops() -> None:
    trunks = forest((9, 11, 0.3), (12, 9, 0.2), (3, 10, 0.07))
    response = listen(trunks, Air(), duration=2.0, ground=-0.6, spreading=0.5)
    spectra = np.fft.rfft([response.direct, response.ground, response.trees])  # 0.5 Hz
    for bin_ in [100, 1001, 4444, 6999, 7190]:
        expected = reverb_spectrum_direct(
            bin_ * 0.5,
            (5.0, 10.0, 1.5),
            (15.0, 10.0, 1.5),
            [(x, y, a) for (x, y), a in zip(trunks.position, trunks.radius, strict=True)],
            speed=Air().speed(),
            air=(20.0, 50.0, 101.325),
            ground=-0.6,
            strength=2.0,
            spreading=0.5,
        )
        error = np.abs(spectra[:, bin_] - expected) / np.abs(spectra).max(axis=1)
        assert (error < [2e-9, 2e-9, 1e-5]).all()  # trees: the ringing is cut off after 0.3 s


def test_direct_and_ground_delay_and_level() -> None:
    """An arrival on a sample is one sample of height 1/d but for air and the band's end."""
    response = listen(
        NOTHING,
        source=(0.0, 0.0, 3.0),
        receiver=(4 * 3.43, 0.0, 3.0),
        sample_rate=10_000.0,
        air=Air(sound_speed=343.0, humidity=100.0),
    )
    assert np.argmax(response.direct) == 400
    assert response.direct_delay == pytest.approx(0.04)
    assert response.direct[400] == pytest.approx(0.95 / (4 * 3.43), rel=0.02)  # the air takes 1.8 %
    bounced = math.hypot(4 * 3.43, 6.0)
    assert np.argmax(response.ground) == round(bounced / 343 * 10_000)
    assert not response.trees.any()
    np.testing.assert_array_equal(response.samples, response.direct + response.ground)
    assert (response.trunks, response.continued, response.late, response.clamped) == (0, 0, 0, 0)


@pytest.mark.parametrize(("x", "angle"), [(25.0, math.pi), (-5.0, math.pi), (10.0, 0.0)])
def test_tree_in_line(x: float, angle: float) -> None:
    """Straight back the echo leads the axis by a diameter's way, straight on it is with the axis."""
    trunks = forest((x, 10.0, 0.3))
    paths = trunk_paths(trunks, np.array([5.0, 10]), np.array([15.0, 10]), 2.0, 0.7)
    assert paths.angle[0] == pytest.approx(angle, abs=1e-12)
    response = listen(trunks, sample_rate=48_000.0)
    axis = paths.length[0] / 343.0
    first = (axis - 2 * 0.3 * math.sin(angle / 2) / 343.0) * 48_000
    energy = np.cumsum(response.trees**2)
    assert energy[int(first) - 10] < 1e-2 * energy[-1]
    assert abs(np.argmax(np.abs(response.trees)) - first) < 3


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.2999])
def test_receiver_on_or_in_a_trunk(offset: float) -> None:
    response = listen(forest((15 + offset, 10, 0.3), (9, 9, 0.1)))
    assert np.isfinite(response.samples).all()
    assert response.clamped == 1
    paths = trunk_paths(
        forest((15 + offset, 10, 0.3)), np.array([5.0, 10]), np.array([15.0, 10]), 2.0, 0.7
    )
    assert paths.weight[0] == pytest.approx(2.0 / ((10 + offset) * 0.3**0.7))
    assert listen(forest((15.3001, 10, 0.3))).clamped == 0


def test_source_is_receiver() -> None:
    place = {"source": (0.0, 0.0, 1.5), "receiver": (0.0, 0.0, 1.5)}
    response = listen(forest((3, 4, 0.2)), **place)
    assert np.isfinite(response.samples).all()
    assert response.direct_delay == 0
    assert np.abs(response.direct).max() < 1.01 / 0.1  # as at 0.1 m
    assert abs(np.argmax(np.abs(response.trees)) - (10 - 0.4) / 343 * 8000) < 2


def test_shorter_than_the_direct_delay() -> None:
    response = listen(scattered_trunks(5), duration=0.001, source=(-90.0, 0.0, 1.0))
    assert len(response.samples) == 8
    assert np.isfinite(response.samples).all()
    assert not response.samples.any()
    assert response.late == 5
    assert response.direct_delay > 0.25
    assert len(listen(NOTHING, duration=1e-6).samples) == 1


def test_late_trunks_are_counted_and_nothing_wraps() -> None:
    near, far = (10.0, 12.0, 0.2), (10.0, 400.0, 0.2)
    both = listen(forest(near, far), duration=0.2)
    assert (both.trunks, both.late) == (1, 1)
    np.testing.assert_array_equal(both.samples, listen(forest(near), duration=0.2).samples)
    long = listen(forest(near, far), duration=3.0)
    assert (long.trunks, long.late) == (2, 0)
    peak = np.abs(both.trees).max()
    np.testing.assert_allclose(both.samples, long.samples[:1600], atol=1e-6 * peak)
    arrival = int(math.hypot(5, 390) * 2 / 343 * 8000)
    assert np.abs(long.trees[arrival - 20 : arrival + 20]).max() > 1e-4 * peak


def test_reciprocity() -> None:
    """With spherical spreading on both legs, source and receiver can change places."""
    trunks = scattered_trunks(6)
    ends = {"source": (1.0, 2.0, 1.2), "receiver": (11.0, 8.0, 2.5)}
    there = listen(trunks, spreading=1.0, **ends)
    back = listen(trunks, spreading=1.0, source=ends["receiver"], receiver=ends["source"])
    np.testing.assert_allclose(there.samples, back.samples, atol=1e-13)


def wall(low: float, high: float) -> TriMesh:
    """Across the way from (5, 10) to (15, 10), from one height to another."""
    corners = [(10, 9, low), (10, 11, low), (10, 11, high), (10, 9, high)]
    return TriMesh.of_part(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), WOOD)


def caster(mesh: TriMesh) -> BruteCaster:
    return BruteCaster(scene_with(mesh))


@pytest.mark.parametrize(
    ("low", "high", "direct", "ground"),
    [
        (0.0, 3.0, False, False),
        (1.0, 3.0, False, True),
        (0.0, 0.5, True, False),
        (4, 5, True, True),
    ],
)
def test_line_of_sight(low: float, high: float, direct: bool, ground: bool) -> None:
    free = listen(scattered_trunks(3))
    response = listen(scattered_trunks(3), wood=caster(wall(low, high)))
    assert (response.direct_clear, response.ground_clear) == (direct, ground)
    np.testing.assert_array_equal(response.direct, free.direct * direct)
    np.testing.assert_array_equal(response.ground, free.ground * ground)
    np.testing.assert_array_equal(response.trees, free.trees)


def test_the_ground_does_not_hide_its_own_sound() -> None:
    corners = np.array([(-99.0, -99, 0.001), (99, -99, 0.001), (99, 99, 0.001), (-99, 99, 0.001)])
    floor = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), WOOD)
    low = listen(NOTHING, wood=caster(floor), source=(5.0, 10.0, 0.02))
    assert low.ground_clear
    assert listen(NOTHING, wood=caster(floor)).ground_clear


@pytest.mark.medium
def test_continuation() -> None:
    trunks = scattered_trunks(40)
    settings = Reverb(duration=0.4, sample_rate=4000.0, continue_to=60.0)
    field = ((-15.0, -15.0), (50.0, 50.0))

    def run(seed: int) -> ImpulseResponse:
        return impulse_response(trunks, settings, AIR, rng=stream(seed, "beyond"), field=field)

    first = run(1)
    assert first.continued > 50
    assert first.trunks == 40 + first.continued
    np.testing.assert_array_equal(first.samples, run(1).samples)
    assert not np.array_equal(first.samples, run(2).samples)
    with pytest.raises(ValueError, match="continue_to"):
        impulse_response(trunks, settings, AIR)


def test_roll_off() -> None:
    share = np.linspace(0, 0.5, 1001)
    gain = roll_off(share)
    assert (gain[share <= 0.45] == 1).all()
    assert gain[-1] == 0
    assert (np.diff(gain) <= 0).all()
    assert abs(gain[950] - 0.5) < 1e-9


def test_the_ground_has_the_spectrum_of_its_reflection() -> None:
    """At single frequencies, by both impedance models."""
    path, rise = math.hypot(10.0, 3.0), 3.0
    frequency = np.fft.rfftfreq(16_000, 1 / 8000.0)
    bins = [200, 1000, 4000, 7000]
    for model in ("miki", "delany-bazley"):
        settings = {"surface": "grass", "duration": 2.0}
        found = np.fft.rfft(listen(NOTHING, impedance_model=model, **settings).ground)
        mirror = np.fft.rfft(listen(NOTHING, ground=1.0, duration=2.0).ground)
        impedance = surface_impedance(frequency[bins], 200.0, model)
        expected = spherical_reflection(frequency[bins], path, rise, impedance, 343.0)
        np.testing.assert_allclose(found[bins] / mirror[bins], expected, atol=2e-3)


def test_what_a_soft_ground_sends_after_a_short_record_is_not_heard_at_its_begin() -> None:
    """Against a long record; the path of 100.04 m ends 8 ms before the short one does."""
    far = {"source": (0.0, 0.0, 1.5), "receiver": (100.0, 0.0, 1.5), "sample_rate": 24e3}
    short, long = (
        listen(NOTHING, surface="snow", duration=seconds, **far).ground for seconds in (0.3, 4.0)
    )
    assert np.abs(short - long[: len(short)]).max() < 1e-5 * np.abs(long).max()


# -------------------------------------------------------------------------------------------- trunks
# Trunks from cut meshes, against analytic cylinders, cones and leaning stems.


def pole(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    radius: tuple[float, float],
    sides: int = 24,
    part: int = WOOD,
) -> TriMesh:
    """A tube open at both ends whose rings have the perimeter of the circle."""
    vertices, triangles = tube(np.array([start, end], float), np.array(radius), sides)
    return TriMesh.of_part(vertices, triangles[: 2 * sides], part)


def leaning(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


THIN = pole((0, 0, -9), (0, 0, 9), (0.15, 0.15), 48)
POST = pole((0, 0, 0), (0, 0, 2), (0.2, 0.2), 180)
SOUP = TriMesh.of_part(
    POST.vertices[POST.triangles].reshape(-1, 3), np.arange(1080).reshape(-1, 3), WOOD
)
BROKEN = replace(POST, vertices=np.where(np.arange(362)[:, None] == 5, np.nan, POST.vertices))
SIDE = np.arange(360) // 2
MIDDLE = -4 * 0.2 / (3 * math.pi)  # of half a disc's area
STEMS = {
    "of 3 sides": (pole((2, 3, 0), (2, 3, 5), (0.2, 0.2), 3), np.eye(3), (2, 3), 0.2, 1e-13),
    "of 8 sides": (pole((2, 3, 0), (2, 3, 5), (0.2, 0.2), 8), np.eye(3), (2, 3), 0.2, 1e-13),
    **{
        f"that leans {angle}": (THIN, leaning(angle), (0, -1.5 * math.tan(angle)), 0.15, 1e-12)
        for angle in (0.1, 0.5, 1.0)
    },
    "elliptic": (  # has its mean width
        POST, np.diag([2.0, 1.0, 1.0]), (0, 0), 0.4 * special.ellipe(0.75) * 2 / math.pi, 1e-4,
    ),
    "not welded": (SOUP, np.eye(3), (0, 0), 0.2, 1e-13),
    "with a slit": (POST.select(SIDE != 10), np.eye(3), (0, 0), 0.2, 1e-3),
    "with half its wall": (  # the hull closes what is left
        POST.select(SIDE < 90), np.eye(3), (MIDDLE, 0), 0.2 * (0.5 + 1 / math.pi), 1e-3,
    ),
    "with a broken corner": (BROKEN, np.eye(3), (0, 0), 0.2, 1e-3),
}  # fmt: skip


@pytest.mark.parametrize(("mesh", "linear", "place", "radius", "off"), STEMS.values(), ids=STEMS)
def test_a_stem_is_where_and_as_thick_as_it_is_cut(
    mesh: TriMesh, linear: np.ndarray, place: tuple[float, float], radius: float, off: float
) -> None:
    scene = replace(scene_with(mesh), transform=np.column_stack([linear, np.zeros(3)])[None])
    trunks = trunks_at_height(scene, 1.5, 0.01)
    np.testing.assert_allclose(trunks.radius, [radius], rtol=off)
    np.testing.assert_allclose(trunks.position, [place], atol=off)
    assert (trunks.thin, trunks.inside) == (0, 0)


def test_cone_under_instance_transforms() -> None:
    cone = pole((0.1, -0.2, 0), (0.1, -0.2, 4), (0.4, 0.0), 64)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    transform = np.zeros((3, 3, 4))
    transform[0, :, :3], transform[0, :, 3] = 2.0 * turn, (5, 6, -1)
    transform[1, :, :3], transform[1, :, 3] = np.diag([1.0, 1.0, -1.0]), (4e5, 5e6, 3.0)  # mirrored
    transform[2, :, :3] = np.diag([1.0, 1.0, 0.0])  # flattened into the ground: never cut
    scene = SceneGeometry(
        (cone,), transform, np.zeros(3, np.int64), ("a",) * 3, np.array([4, -1, 9]), np.zeros(3)
    )
    trunks = trunks_at_height(scene, 1.0, 0.01)
    assert trunks.tree.tolist() == [4, -1]
    assert trunks.instance is not None
    assert trunks.instance.tolist() == [0, 1]
    np.testing.assert_allclose(trunks.position[0], [5 + 2 * 0.2, 6 + 2 * 0.1], atol=1e-12)
    np.testing.assert_allclose(trunks.position[1], [4e5 + 0.1, 5e6 - 0.2], atol=1e-8)
    # Chord against slant height bends the section of a cone of many sides by next to nothing.
    np.testing.assert_allclose(trunks.radius, [2 * 0.4 * 0.75, 0.4 * 0.5], rtol=1e-8)


def test_plane_through_vertices() -> None:
    """A ring of vertices exactly in the plane neither splits nor loses a stem, nor doubles it."""
    scene = scene_with(
        join([pole((0, 0, 0), (0, 0, 2), (0.2, 0.2)), pole((0, 0, 2), (0, 0, 3), (0.2, 0.2))])
    )
    np.testing.assert_allclose(trunks_at_height(scene, 2.0).radius, [0.2], rtol=1e-14)
    np.testing.assert_allclose(trunks_at_height(scene, 3.0).radius, [0.2], rtol=1e-14)  # its top
    assert len(trunks_at_height(scene, 0.0)) == 0  # its foot
    assert len(trunks_at_height(scene, 3.0 + 1e-6)) == 0
    assert len(trunks_at_height(scene, -1e-6)) == 0


def test_one_vertex_in_the_plane() -> None:
    """A leaning tube whose ring touches the plane in single vertices stays one contour."""
    mesh = pole((0, 0, 0), (0.3, 0, 4), (0.2, 0.15), 16)
    inner = mesh.vertices[20, 2]
    assert len(trunks_at_height(scene_with(mesh), float(inner))) == 1


def test_thin_and_inner_stems_are_counted() -> None:
    mesh = join(
        [
            pole((0, 0, 0), (0, 0, 4), (0.2, 0.2)),
            pole((0, 0, 0.5), (0.3, 0, 4), (0.05, 0.05)),  # a branch that is still in its trunk
            pole((1, 0, 0), (1, 0, 4), (0.02, 0.02)),
            pole((2, 0, 0), (2, 0, 4), (0.004, 0.004)),
            pole((3, 0, 0), (3, 0, 4), (0.3, 0.3), part=OTHER),
            pole((4, 0, 0), (4, 0, 4), (0.3, 0.3), part=LEAF),
        ]
    )
    trunks = trunks_at_height(scene_with(mesh), 1.0, 0.01)
    np.testing.assert_allclose(trunks.radius, [0.2, 0.02], rtol=1e-12)
    assert (trunks.thin, trunks.inside) == (1, 1)
    assert len(trunks_at_height(scene_with(mesh), 3.9, 0.01)) == 3  # the branch has left it


def test_nothing_to_cut() -> None:
    empty = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), WOOD)
    trunks = trunks_at_height(scene_with(empty), 1.0)
    assert (len(trunks), trunks.position.shape, trunks.tree.dtype) == (0, (0, 2), np.int64)


def test_hull_of_degenerate_points() -> None:
    assert convex_hull(np.empty((0, 2))).shape == (0, 2)
    assert convex_hull(np.zeros((4, 2))).tolist() == [[0, 0]]
    line = np.linspace(0, 1, 5)[:, None] * [2.0, 1.0]
    assert sorted(convex_hull(line).tolist()) == [[0, 0], [2, 1]]


def test_flat_sheet_is_a_strip_of_its_width() -> None:
    ends = np.array([[[0.0, 0], [0.5, 0]], [[0.5, 0], [1, 0]]])
    centre, radius = equivalent_circle(ends, np.tile([0.0, 1, 0], (2, 1)))
    np.testing.assert_allclose(centre, [0.5, 0])
    np.testing.assert_allclose(radius, 2 / (2 * math.pi))


@pytest.mark.parametrize("slant", [0.0, 0.6, 1.45])
def test_stems_that_are_thick_enough_are_all_found(slant):
    """Poles that stand, lean and nearly lie, each by its own radius and by a little more."""
    rng = stream(8, "contours")
    poles = []
    for number, radius in enumerate(rng.uniform(0.01, 0.5, 12).tolist()):
        turn = rng.uniform(0, 2 * np.pi)
        way = 20.0 * np.sin(slant) * np.array([np.cos(turn), np.sin(turn)])
        foot, top = np.array([100.0 * number, 0.0]), 20.0 * np.cos(slant)
        poles.append(pole((*(foot - way), -top), (*(foot + way), top), (radius, 0.7 * radius)))
    radii = trunks_at_height(scene_with(*poles), 0.0).radius
    assert len(radii) == 12
    for number, radius in enumerate(radii.tolist()):
        for least, count in ((radius, 1), (1.0001 * radius, 0)):
            found = trunks_at_height(scene_with(poles[number]), 0.0, least)
            assert (len(found), found.thin) == (count, 1 - count)


def test_wood_is_cut_alike_whether_it_is_kept_and_however_it_stands():
    leaning = pole((0, 0, 0), (0.3, 0.1, 9), (0.2, 0.1))
    upright, wood = scene_with(leaning, pole((2, 0, 0), (2, 0, 9), (0.1, 0.05))), {}
    almost = np.tile(np.eye(3, 4), (2, 1, 1))
    almost[:, 2, 0] = 1e-300  # not upright: every vertex is asked
    other = replace(upright, transform=almost)
    for height in (1.0, 4.5, 7.0):
        found = [trunks_at_height(scene, height, 0.01) for scene in (upright, other)]
        found.append(trunks_at_height(upright, height, 0.01, wood))
        assert len(found[0]) == 2
        for one in found[1:]:
            assert np.array_equal(one.position, found[0].position)
            assert np.array_equal(one.radius, found[0].radius)
    assert len(wood) == 2


def scene(mesh: TriMesh, *places: tuple[float, float]) -> SceneGeometry:
    return scene_of(mesh, *(np.column_stack([np.eye(3), (*place, 0.0)]) for place in places))


def test_each_trunk_is_cut_where_the_path_meets_it() -> None:
    """The path from 1 m up to 9 m over 40 m; a cut is at most half a step off."""
    places = [(x, 0.5) for x in (4, 12, 20, 28, 36)]
    cuts = TrunkCuts(scene(pole((0, 0, 0), (1.2, 0, 12), (0.6, 0), 48), *places), 0.0)
    source, receiver = np.array([0.0, 0, 1.0]), np.array([40.0, 0, 9.0])
    trunks = cuts.between(source, receiver)
    assert sorted(trunks.tree) == [3, 4, 5, 6, 7]
    for x, radius, tree in zip(trunks.position[:, 0], trunks.radius, trunks.tree, strict=True):
        height = 1.0 + 8.0 * x / 40
        assert abs(radius - 0.6 * (1 - height / 12)) < 0.6 / 12 * STEP / 2 + 2e-3
        assert abs(x - (places[tree - 3][0] + 0.1 * height)) < 0.1 * STEP / 2 + 1e-3


def test_a_receiver_above_the_canopy() -> None:
    """The path passes over trees near the receiver and meets those near the source."""
    cuts = TrunkCuts(
        scene(pole((0, 0, 0), (0, 0, 10), (0.4, 0), 48), (2, 0), (5, 0), (9, 0), (11, 0)), 0.0
    )
    trunks = cuts.between(np.array([0.0, 0.3, 1.5]), np.array([12.0, 0.3, 25.0]))
    heard = [1.5 + 23.5 * x / 12 < 10 for x in (2, 5, 9, 11)]
    assert list(trunks.tree - 3) == list(np.flatnonzero(heard)) == [0]
    assert len(cuts.between(np.array([0.0, 0, 30.0]), np.array([12.0, 0, 40.0]))) == 0


@pytest.mark.parametrize("low", [1.0, 30.0])
def test_there_and_back_are_the_same_trunks(low: float) -> None:
    cuts = TrunkCuts(
        scene(pole((0, 0, 0), (0, 0, 12), (0.6, 0), 48), (4, 1), (12, 2), (20, -3), (20, 0)), 0.0
    )
    ends = np.array([0.0, 0, low]), np.array([30.0, 5, 6.0])
    there, back = cuts.between(*ends), cuts.between(*ends[::-1])
    for part in ("tree", "radius"):
        np.testing.assert_allclose(sorted(getattr(there, part)), sorted(getattr(back, part)))


FIELD = ((-10.0, -20.0), (40.0, 30.0))


def planted(count: int = 60) -> Trunks:
    rng = np.random.default_rng(5)
    inside = rng.uniform((-10, -20), (30, 10), (count, 2))
    stray = [[500.0, 500.0]]  # outside the field: neither counted nor copied
    return Trunks(
        np.concatenate([inside, stray]),
        np.append(rng.choice([0.1, 0.2, 0.4], count), 9.0),
        np.arange(count + 1),
    )


def test_outside_the_field_within_the_distance() -> None:
    centre = np.array([0.0, 0.0])
    beyond = continue_trunks(planted(), FIELD, centre, 100.0, stream(1, "beyond"))
    x, y = beyond.position.T
    assert (np.hypot(x, y) <= 100).all()
    assert not ((x > -10) & (x < 30) & (y > -20) & (y < 10)).any()
    assert set(beyond.radius) == {0.1, 0.2, 0.4}
    assert (beyond.tree == -1).all()


def test_counts_are_poisson_with_the_fields_density() -> None:
    """Mean and variance over 400 seeds; each is missed by chance once in 10 000 times."""
    density = 60 / 1200
    area = math.pi * 50**2 - 1200
    counts = [
        len(continue_trunks(planted(), FIELD, np.array([10.0, -5.0]), 50.0, stream(seed, "beyond")))
        for seed in range(400)
    ]
    expected = density * area
    assert abs(np.mean(counts) - expected) < 3.9 * math.sqrt(expected / 400)
    assert abs(np.var(counts) / expected - 1) < 3.9 * math.sqrt(2 / 399)


def test_source_and_receiver_stand_free() -> None:
    clear = np.array([[60.0, 60.0], [-60.0, -60.0]])
    for seed in range(20):
        thick = Trunks(planted().position, np.full(61, 6.0), np.arange(61))
        beyond = continue_trunks(thick, FIELD, np.zeros(2), 99.0, stream(seed, "b"), clear)
        for place in clear:
            assert (np.hypot(*(beyond.position - place).T) > 6.0).all()


def test_no_field_no_forest() -> None:
    assert len(continue_trunks(NOTHING, FIELD, np.zeros(2), 100.0, stream(0, "b"))) == 0
    # Reaching no farther than the field adds nothing.
    assert len(continue_trunks(planted(), FIELD, np.zeros(2), 5.0, stream(0, "b"))) == 0


def test_too_many_are_refused() -> None:
    dense = Trunks(np.zeros((10**6, 2)), np.ones(10**6), np.zeros(10**6, np.int64))
    with pytest.raises(ValueError, match="lower continue_to"):
        continue_trunks(dense, FIELD, np.zeros(2), 2000.0, stream(0, "b"))
