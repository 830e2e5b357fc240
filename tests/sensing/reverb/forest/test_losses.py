"""What paths lose: against a field in space, the direct sum, and integrals done another way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.cylinders import scattered_in_space
from references.reverb import blades_of_leaves, rods_of_skeleton

from forest_addon.acoustics.cylinder import transfer
from forest_addon.acoustics.ground import spherical_reflection, surface_impedance, under_leaves
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.blades import shoot_of
from forest_addon.growth.tree import grow
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.forest.clutter import (
    DRAWN,
    blades_of_mesh,
    clutter_of,
    rods_of_mesh,
    shoot_triangles,
)
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand, lean_coherence
from forest_addon.sensing.reverb.forest.surroundings import (
    NEVER,
    FoliageCanopy,
    canopy_of,
    surroundings,
    terms_of,
)
from forest_addon.sensing.reverb.sums.path_gain import PathGain
from forest_addon.sensing.reverb.sums.scattering import (
    scattered_spectrum,
    spectrum_by_nodes,
    trunk_paths,
)
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

AIR = Air(sound_speed=343.0)
SOURCE, RECEIVER = np.array([-5.0, 0.0, 1.5]), np.array([5.0, 0.0, 1.8])
STAND = TrunkStand(0.07, (0.1, 0.2), 0.3, 15.0)


def losses_of(stand=STAND, source=SOURCE, receiver=RECEIVER, **changes):
    given = {"model": "forest", "surface": "forest floor"}
    return Losses.of(Reverb(**(given | changes)), AIR, stand, source, receiver)


@pytest.mark.medium
def test_a_trunk_in_space():
    """Both the weight and a path that rises, by an integral over vertical wavenumbers; far away to 1/kr."""
    k, radius, legs, turned, rise = 8.0, 0.15, (18.0, 24.0), 2.2, 3.0
    x = sum(legs)
    exact = scattered_in_space(k, radius, legs, turned, rise)
    frequency = np.array([k * 343.0 / (2.0 * np.pi)])
    level = losses_of(
        TrunkStand(), SOURCE, SOURCE + np.array([0, 0, rise]), path_ground=False, turbulence=0.0
    )
    shared = transfer(frequency * np.cos(np.arctan(rise / x)), turned, radius, 343.0)[0]
    carried = level.of_ground(frequency, np.array([x]))[0]
    found = shared * carried * np.exp(-1j * k * x) / np.sqrt(x * legs[0] * legs[1])
    assert abs(np.conj(found) - exact) < 0.015 * abs(exact)


def test_over_a_hard_ground_each_path_is_heard_twice():
    """Ends on a hard ground: twice the pressure, at any distance."""
    low = SOURCE * [1, 1, 1e-4]
    hard = losses_of(TrunkStand(), low, low, surface="constant", ground=1.0, turbulence=0.0)
    gain = hard.gain(np.array([[100.0], [5000.0]]), np.array([20.0, 300.0]))
    np.testing.assert_allclose(gain, 2.0, rtol=1e-3)


def test_the_ground_of_a_path_is_that_of_the_direct_sound_as_far_away():
    frequency, x = np.array([200.0, 2000.0]), 80.0
    found = losses_of(TrunkStand(), SOURCE, SOURCE, turbulence=0.0, lean_deg=0.0).of_ground(
        frequency, np.array(x)
    )
    path = np.hypot(x, 3.0)
    q = spherical_reflection(frequency, path, 3.0, surface_impedance(frequency, 50.0), 343.0)
    loss = losses_of(TrunkStand(), SOURCE, SOURCE).along(frequency)
    k = 2.0 * np.pi * frequency / 343.0
    there = 1.0 + q * x / path * np.exp(-(loss + 1j * k) * (path - x))
    np.testing.assert_allclose(found, there, rtol=1e-9)


def test_turbulence_keeps_the_energy_of_both_ways():
    """The mean over both states of the air is |p₁|² + |p₂|² + 2Γ·Re p₁p₂*; none where Γ = 0."""
    frequency, length = np.array([[500.0], [8000.0]]), np.array([30.0, 200.0])
    still = losses_of(TrunkStand(), turbulence=0.0)
    wild = losses_of(TrunkStand(), turbulence=100.0)
    first = replace(still, ground=False).of_ground(frequency, length)
    second = still.of_ground(frequency, length) - first
    apart = np.abs(first) ** 2 + np.abs(second) ** 2
    found = wild.mean_square(frequency, length)
    np.testing.assert_allclose(found[1], apart[1], rtol=1e-3)


def test_where_trunks_end_the_fresnel_integral_does():
    """Against e^{-iαz²} over a trunk and its image, summed over heights that differ."""
    frequency, x, top = 250.0, 120.0, 12.0
    low = SOURCE * [1, 1, 1e-6]
    stand = TrunkStand(0.0, (), 0.0, top)
    found = losses_of(stand, low, low).of_ends(np.array(frequency), np.array(x))
    bend = 2.0 * (2.0 * np.pi * frequency / 343.0) / x
    heights = top * (1.0 + 0.2 * np.linspace(-5, 5, 201))
    share = np.exp(-0.5 * np.linspace(-5, 5, 201) ** 2)
    z = np.linspace(0.0, 2.0 * top, 40_001)
    below = np.cumsum(np.exp(-1j * bend * z**2)) * (z[1] - z[0])
    summed = np.interp(heights, z, below.real) + 1j * np.interp(heights, z, below.imag)
    expected = 2.0 * (share @ summed) / share.sum() / np.sqrt(np.pi / (1j * bend))
    assert abs(found - expected) < 2e-3


@pytest.mark.medium
@pytest.mark.parametrize(
    ("extinction", "lean", "surface", "bound", "spacing", "top"),
    [
        ("none", 0.0, "snow", 1e-11, 0.05, 320.0),
        ("none", 0.0, "asphalt", 1e-11, 5.0, 10_240.0),
        ("energy", 0.0, "asphalt", 1e-7, 0.05, 320.0),
        ("none", 2.0, "snow", 1e-5, 5.0, 10_240.0),
    ],
)
def test_losses_between_nodes_are_those_of_every_frequency(
    extinction, lean, bound, surface, spacing, top
):
    """In every octave; extinction comes from a cubic spline, whose knots leave a tenth of what is allowed."""
    rng = np.random.default_rng(5)
    radius = np.array([0.03, 0.05, 0.2, 0.45, 0.0])
    trunks = Trunks(rng.uniform(-40, 40, (5, 2)), radius, np.arange(5))
    paths = trunk_paths(trunks, SOURCE[:2], RECEIVER[:2], 2.0, 0.7, None, True)
    losses = losses_of(
        surface=surface, turbulence=10.0, bark=0.05, extinction=extinction, lean_deg=lean
    )
    lowest, highest = round(10 / spacing), round(top / spacing)
    loss = losses.along(np.arange(highest + 1) * spacing)
    exact = scattered_spectrum(
        paths, spacing, loss, AIR.speed(), None, losses.gain, losses.bark, lowest
    )
    found = spectrum_by_nodes(paths, spacing, lowest, highest, losses)
    for first in lowest * 2 ** np.arange(round(np.log2(highest / lowest))):
        octave = slice(first, 2 * first)
        error = np.linalg.norm(found[octave] - exact[octave]) / np.linalg.norm(exact[octave])
        assert error < bound


def test_nothing_changes_where_all_is_off():
    """The losses of a bare stand are the air's alone."""
    bare = losses_of(
        TrunkStand(), SOURCE, SOURCE, extinction="none", path_ground=False, bark=0.0, turbulence=0.0
    )
    assert bare.passes
    frequency = np.array([100.0, 5000.0])
    np.testing.assert_array_equal(bare.removed(frequency), 0.0)
    np.testing.assert_array_equal(bare.gain(frequency, np.array([10.0, 50.0])), 1.0)


@pytest.mark.parametrize("height", [1.5, 0.0])
def test_the_mean_energy_is_that_of_both_states_of_the_air(height):
    """By its own formula, against the mean of two whole gains whose phases turn either way."""
    end = SOURCE * [1, 1, 0] + [0, 0, height or 0.02]
    losses = losses_of(source=SOURCE, receiver=end, lean_deg=2.0, turbulence=3.0)
    frequency, length = np.array([[125.0], [2000.0], [9000.0]]), np.array([11.0, 60.0, 700.0])
    both = [replace(losses, back=back).gain(frequency, length) for back in (False, True)]
    mean = 0.5 * sum(np.abs(one) ** 2 for one in both)
    np.testing.assert_allclose(losses.mean_square(frequency, length), mean, rtol=1e-9)


@pytest.mark.parametrize("number", [3, 8])
def test_filters_of_a_whole_transform_are_those_of_each_frequency(number):
    """Read from a spline, of a near zone's ground path and of a far zone."""
    losses = losses_of(lean_deg=2.0, floor_leaf_area=1.0, leaf_area_density=0.2)
    gain = PathGain(losses, 12e3, 1e-4, whole=True)
    zone = [zone for zone, _ in gain.zones(np.array([1.5 * 2.0**number]))][-1]
    every = np.arange(4001) * 3.0
    found = gain.filters(zone, every)
    some = np.arange(7, 4001, 333)  # as few as are computed one by one
    exact = PathGain(losses, 12e3, 1e-4, whole=True).filters(zone, every[some])
    gap = np.linalg.norm(found[:, some] - exact, axis=1)
    assert gap.max() < 1e-4 * np.linalg.norm(exact)


HEIGHT, REFLECTED = 1.5, -0.9
Z = np.linspace(0.0, 60.0, 3001)[1:]
FADE = np.cos(np.clip((Z - 20.0) / 40.0, 0.0, 1.0) * np.pi / 2) ** 2


def along_the_axis(k: float, legs: tuple[float, float], turn: float, slope: np.ndarray) -> float:
    """|p|² of sound that an axis scatters, from a source and its image to a receiver and its image."""
    ends = np.array([[-legs[0], 0.0], legs[1] * np.array([np.cos(turn), np.sin(turn)])])
    place = np.outer(Z - HEIGHT, slope)
    waves = []
    for end in ends:
        level = np.hypot(*(place - end).T)
        way = [np.hypot(level, Z - z) for z in (HEIGHT, -HEIGHT)]
        waves.append(
            np.exp(1j * k * way[0]) / way[0] + REFLECTED * np.exp(1j * k * way[1]) / way[1]
        )
    return float(abs((waves[0] * waves[1] * FADE).sum()) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [1000.0, 2000.0])
def test_energy_over_a_ground_of_trunks_that_lean(frequency: float) -> None:
    """Mean over leans, turns, places on the way and a third of an octave, re upright trunks; 1.2 dB."""
    rng, lean, x = np.random.default_rng(1), 0.05, 30.0
    leaning = upright = formula = plain = 0.0
    detour = np.hypot(x, 2 * HEIGHT) - x
    for n in range(320):
        k = 2 * np.pi * frequency / 340.0 * 2 ** rng.uniform(-1 / 6, 1 / 6)
        share = (n % 16 + 0.5) / 16
        turn = 2 * np.arcsin(np.sqrt(1 - rng.random() ** 2)) * rng.choice((-1, 1))
        given = k, (share * x, (1 - share) * x), turn
        scale = share * (1 - share) * k
        leaning += scale * along_the_axis(*given, lean * rng.normal(size=2))
        upright += scale * along_the_axis(*given, np.zeros(2))
        left = lean_coherence(np.array(k), np.array(x), (HEIGHT, HEIGHT), lean, np.array(1e-5))
        turned = 2 * REFLECTED * np.cos(k * detour)
        formula += 1 + REFLECTED**2 + left * turned
        plain += 1 + REFLECTED**2 + turned
    apart = 10 * np.log10(leaning / upright) - 10 * np.log10(formula / plain)
    assert abs(apart) < 1.2
    assert abs(10 * np.log10(leaning / upright)) > 0.3


def test_upright_trunks_keep_all_coherence_and_more_meetings_leave_less() -> None:
    k, x = np.geomspace(0.2, 300.0, 60), np.array(60.0)
    none = lean_coherence(k, x, (1.5, 1.5), 1e-6, np.array(1.0))
    np.testing.assert_allclose(none, 1.0, atol=1e-3)
    once, twice = (lean_coherence(k, x, (1.5, 1.2), 0.03, np.array(m)) for m in (1e-5, 2.0))
    assert (twice <= once + 1e-12).all()
    assert once[0] > 0.99
    assert once[-1] < 0.1


def test_a_layer_without_leaves_is_the_ground_alone() -> None:
    frequency = np.array([200.0, 1000.0, 8000.0])
    ground = surface_impedance(frequency, 60.0)
    for sine in (0.01, 0.3, 0.9):
        found = under_leaves(frequency, sine, ground, 0.3, np.zeros(3), 343.0)
        np.testing.assert_allclose(found, ground, rtol=1e-9)


def test_a_dense_layer_hides_the_ground_but_for_waves_that_come_level() -> None:
    """From above, leaves that take all leave next to nothing; level waves are turned back at their top."""
    frequency, loss = np.array([4000.0]), np.array([3.0])
    for sine, low, high in ((0.8, 0.0, 0.1), (0.001, 0.95, 1.0)):
        z = under_leaves(frequency, sine, np.array([1e9 + 0j]), 2.0, loss, 343.0)
        reflected = abs((z * sine - 1) / (z * sine + 1))[0]
        assert low <= reflected <= high


def test_herbs_take_from_the_ground_at_high_frequencies_alone() -> None:
    ends = np.array([[0.0, 0.0, 1.5], [30.0, 0.0, 1.5]])
    bare, herbs = (
        Losses.of(
            Reverb(model="forest", turbulence=0.0, lean_deg=0.0),
            Air(),
            TrunkStand(floor_leaf_area=area),
            *ends,
        )
        for area in (0.0, 2.0)
    )
    frequency = np.array([250.0, 4000.0])
    share = np.abs(herbs.bounce(frequency, 30.0) / bare.bounce(frequency, 30.0))
    assert share[0] > 0.98
    assert share[1] < 0.75


# ------------------------------------------------------------------------------------------- clutter
# Branches by a tree's skeleton and, independently, by the curvature of its mesh.


@pytest.fixture(scope="module")
def birch():
    species, template = load_species(find_species("betula-pendula", Path()))
    return grow(species, template, stream(1, "test"))


def test_a_mesh_tells_its_branches_as_the_skeleton_has_them(birch):
    true, found = rods_of_skeleton(birch.skeleton), rods_of_mesh(birch.mesh)
    for low, high in ((0.001, 0.002), (0.002, 0.006), (0.006, 0.02)):
        lengths = [r.length[(r.radius > low) & (r.radius < high)].sum() for r in (true, found)]
        assert lengths[1] == pytest.approx(lengths[0], rel=0.15)
    assert found.length.sum() == pytest.approx(true.length.sum(), rel=0.05)
    heights = [(r.length @ r.height) / r.length.sum() for r in (true, found)]
    rises = [(r.length @ r.rise) / r.length.sum() for r in (true, found)]
    assert heights[1] == pytest.approx(heights[0], rel=0.02)
    assert rises[1] == pytest.approx(rises[0], rel=0.05)


def test_leaves_and_layers(birch):
    of_truth, of_mesh = blades_of_leaves(birch.leaves), blades_of_mesh(birch.mesh)
    assert of_mesh.area.sum() == pytest.approx(of_truth.area.sum(), rel=1e-6)
    rods = rods_of_skeleton(birch.skeleton)
    found = clutter_of([rods], [of_truth], 10.0)
    thick = rods.radius < 0.08
    assert np.sum(found.length) * 10.0 == pytest.approx(rods.length[thick].sum(), rel=0.05)
    assert np.sum(found.leaf_area) * 10.0 == pytest.approx(of_truth.area.sum(), rel=1e-6)


def test_a_tree_twice_as_large(birch):
    rods = rods_of_skeleton(birch.skeleton)
    large = rods.placed(np.hstack([2.0 * np.eye(3), [[0.0], [0.0], [1.0]]]))
    np.testing.assert_allclose(large.length, 2 * rods.length)
    np.testing.assert_allclose(large.height, 2 * rods.height + 1.0)


def test_few_pieces_are_the_same_stand(birch):
    rods, blades = rods_of_skeleton(birch.skeleton), blades_of_leaves(birch.leaves)
    whole = clutter_of([rods], [blades], 10.0)
    found = clutter_of([rods.summed()], [blades.summed()], 10.0)
    assert len(rods.summed().length) < 0.3 * len(rods.length)
    np.testing.assert_allclose(np.sum(found.length), np.sum(whole.length), rtol=1e-9)
    np.testing.assert_allclose(found.radii, whole.radii, rtol=1e-9)
    np.testing.assert_allclose(np.sum(found.leaf_area), np.sum(whole.leaf_area), rtol=1e-9)
    np.testing.assert_allclose(found.leaf_radius, whole.leaf_radius, rtol=1e-9)


@pytest.mark.medium
def test_shoots_are_needles_and_leaves_are_not(birch):
    """Half the needles' surface within 20 %, and how far they are from the middle within 10 %."""
    species, _ = load_species(find_species("norway-spruce", Path()))
    length = species.leaf.length.mean
    every = shoot_of(replace(species.needles, blades=0), length)
    drawn = shoot_of(species.needles, length)
    meshes = [
        TriMesh(
            length * blade.vertices,
            blade.triangles,
            material=np.zeros(len(blade.triangles), np.int64),
            part=np.full(len(blade.triangles), LEAF),
            leaf=np.zeros(len(blade.triangles), np.int64),
        )
        for blade in (every, drawn)
    ]
    needles = blades_of_mesh(meshes[0])
    found = blades_of_mesh(meshes[1])
    assert shoot_triangles(meshes[1]).all()
    assert not shoot_triangles(birch.mesh).any()
    assert found.area[0] / DRAWN == pytest.approx(needles.area[0], rel=0.2)
    assert found.shoot[0] == pytest.approx(needles.shoot[0], rel=0.1)
    clutter = clutter_of([], [found], 1.0)
    assert np.sum(clutter.leaf_area) == 0.0
    assert np.sum(clutter.needle_area) == pytest.approx(found.area[0] / DRAWN)
    assert clutter.shoot_area == pytest.approx(found.area[0] / DRAWN)


def scene(scale=1.0):
    """A stem of 10 m and two leaves of 0.5 m², at 1.5 and at 8 m."""
    corners, up = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([0, 0, 1.0])
    stem = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 10.0]])
    vertices = np.concatenate([stem, corners + 1.5 * up, corners + 8 * up])
    mesh = TriMesh(
        vertices,
        np.arange(9).reshape(3, 3),
        np.array([WOOD, LEAF, LEAF]),
        np.array([-1, 0, 1]),
        np.zeros(3, int),
    )
    transform = np.zeros((2, 3, 4))
    transform[:, :, :3] = scale * np.eye(3)
    return SceneGeometry(
        (mesh,), transform, np.zeros(2, int), ("a", "b"), np.arange(2), np.zeros(2, int)
    )


def test_only_leaves_beside_the_path_count():
    """Two trees with 0.5 m² each between 0.5 and 2.5 m, on 100 m²."""
    found = canopy_of(scene(), (1.5, 1.5), 100.0)
    assert found.leaf_area_density == pytest.approx(2 * 0.5 / (100.0 * 2.0))
    assert found.top == pytest.approx(10.0)
    assert canopy_of(scene(), (5.0, 5.0), 100.0).leaf_area_density == 0


def test_leaves_on_the_floor_are_counted_apart():
    """Herbs: the same plants at a fifth of the size, with leaves of 0.02 m² at 0.3 m and above."""
    found = canopy_of(scene(0.2), (1.5, 1.5), 100.0)
    assert found.floor_leaf_area == pytest.approx(2 * 0.5 * 0.04 / 100.0)
    assert canopy_of(scene(), (1.5, 1.5), 100.0).floor_leaf_area == 0


def test_trunks_end_where_those_trees_do_whose_trunks_are_met():
    """A tree of 10 m over a shrub of 1 m, whose stem the path at 1.5 m passes over."""
    both = scene()
    transform = both.transform.copy()
    transform[1, :, :3] *= 0.1
    both = replace(both, transform=transform)
    assert canopy_of(both, (1.5, 1.5), 100.0, np.array([0, -1])).top == pytest.approx(10.0)
    assert canopy_of(both, (1.5, 1.5), 100.0, np.array([-1])).top == 0.0
    assert canopy_of(both, (1.5, 1.5), 100.0).top == pytest.approx(5.5)


def test_terms_tell_their_values():
    held = " ".join(terms_of(Reverb(model="forest", lean_deg=1.5, bark=0.07, trunk_height=12.0))[0])
    for words in ("(1.5 degrees)", "(7 %)", "(12 m)", "forest floor", "as in the scene"):
        assert words in held


def test_a_stand_at_random_is_even_and_one_with_an_edge_is_not():
    rng = np.random.default_rng(3)
    place = rng.uniform(0, 100, (800, 2))
    field = ((0.0, 0.0), (100.0, 100.0))
    reverb = Reverb(model="forest", continue_to=200.0)

    def around(rows):
        trunks = Trunks(place[rows], np.full(rows.sum(), 0.1), np.arange(rows.sum()))
        return surroundings(trunks, reverb, field, FoliageCanopy(0.2, 12.0))

    even = around(np.ones(800, bool))
    assert even.density.cells.size == 0
    assert even.density.around == pytest.approx(0.08)
    assert even.stand.leaf_area_density == 0.2
    half = around(place[:, 0] < 50)
    assert half.density.cells.size > 0
    there = half.density.at(np.array([[20.0, 50.0], [80.0, 50.0]]))
    assert there[0] > 0.03
    assert there[1] == 0


def test_one_switch_gives_every_term():
    """The ground too: a model ``forest`` stands on a forest floor unless it is told otherwise."""
    held, missing = terms_of(Reverb(model="forest"))
    assert Reverb(model="forest").ground_kind == "forest floor"
    assert Reverb().ground_kind == "constant"
    assert Reverb(model="forest", surface="snow").ground_kind == "snow"
    assert set(missing) == set(NEVER)
    assert len(held) > len(terms_of(Reverb())[0])


def test_terms_tell_what_stands_there():
    """Leaves of two trees by hand: 1 m² on 100 m² between 0.5 and 2.5 m, the path at 1.5 m."""
    canopy = canopy_of(scene(), (1.5, 1.5), 100.0)
    trunks = Trunks(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]]), np.full(3, 0.1), np.arange(3))
    reverb = Reverb(model="forest")
    stand = surroundings(trunks, reverb, ((0.0, 0.0), (10.0, 10.0)), canopy).stand
    held = " ".join(terms_of(reverb, stand)[0])
    for words in ("300/ha", "0.005 m²/m³ at the path", "m² of leaves as discs of", "10 m"):
        assert words in held
    assert "within a shoot (none there)" in held
    assert "as in the scene" not in held
