"""Returns that receivers make of echoes, against plates at known distances and plain loops."""

import numpy as np
import pytest
from references.lidar_scenes import scene_with
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import LEAF, OTHER, TriMesh
from forest_addon.formats.scanner_file import settings_of
from forest_addon.formats.toml_file import structure
from forest_addon.sensing.lidar.receiver import awake, chosen_returns
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.lidar.waveform import WaveformEchoes
from forest_addon.spec import Airborne, Beam, Receiver, SpecError, Surfaces, Terrestrial

KEEP = ("first", "last", "strongest", "strongest+last")


def plate(distance, part=OTHER, high=50.0):
    """A plane across the X axis up to y = high."""
    y, z = np.array([-50.0, high, high, -50.0]), np.array([-50.0, -50.0, 50.0, 50.0])
    corners = np.stack([np.full(4, distance), y, z], axis=1)
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), part)


def looked(meshes, beam, **settings):
    """The returns of one pulse along X."""
    scanner = Terrestrial(
        position=(0.0, 0.0, 0.0),
        azimuth_deg=(0.0, 1e-7),
        elevation_deg=(0.0, 1e-7),
        angle_step_deg=1.0,
        max_range=1000.0,
        beam=beam,
        **settings,
    )
    return scan(scanner, BruteCaster(scene_with(*meshes)))


def random_echoes(rng, pulses=400):
    """Echoes of pulses with none to nine of them, some equally strong."""
    pulse = np.repeat(np.arange(pulses), rng.integers(0, 10, pulses))
    distance = rng.uniform(5, 15, len(pulse))
    distance = distance[np.lexsort((distance, pulse))]
    energy = rng.integers(1, 6, len(pulse)).astype(float)
    return WaveformEchoes(pulse, distance, energy, np.ones(len(pulse)), np.arange(len(pulse)))


@pytest.mark.parametrize(("apart", "returns"), [(1.0, 1), (2.4, 1), (2.6, 2), (9.0, 2)])
def test_two_plates_are_told_apart_beyond_the_dead_zone(apart, returns):
    plates = plate(100.0, high=0.0), plate(100.0 + apart)
    beam = Beam(subrays=100, divergence_mrad=(1.0, 1.0), pulse_ns=2.0, max_returns=5)
    assert len(looked(plates, beam)) == 2  # the waveform tells them apart
    cloud = looked(plates, beam, receiver=Receiver(dead_zone=2.5))
    at = [100.0, 100.0 + apart][:returns]
    assert cloud.true_range == pytest.approx(at, abs=1e-3)
    assert cloud.count.tolist() == [returns] * returns


def test_what_is_lost_does_not_make_the_blindness_longer():
    at = np.array([10.0, 11.5, 12.0, 13.9, 14.0, 15.0, 30.0])
    echoes = WaveformEchoes(np.zeros(7, int), at, np.ones(7), np.ones(7), np.arange(7))
    assert at[awake(echoes, 2.0)].tolist() == [10.0, 12.0, 14.0, 30.0]


@pytest.mark.parametrize("dead_zone", [0.0, 0.4, 1.3, 20.0])
def test_a_receiver_is_awake_as_an_electronic_clock_says(dead_zone):
    echoes = random_echoes(np.random.default_rng(3))
    expected, until = [], {}
    for row, (pulse, distance) in enumerate(zip(echoes.pulse, echoes.distance, strict=True)):
        if distance >= until.get(pulse, 0.0):
            expected.append(row)
            until[pulse] = distance + dead_zone
    assert awake(echoes, dead_zone).tolist() == expected


@pytest.mark.parametrize("keep", KEEP)
@pytest.mark.parametrize("most", [1, 2, 3, 9])
def test_returns_are_kept_as_a_loop_over_pulses_keeps_them(keep, most):
    echoes = random_echoes(np.random.default_rng(7))
    expected = []
    for pulse in np.unique(echoes.pulse):
        rows = np.flatnonzero(echoes.pulse == pulse).tolist()
        strong = sorted(rows, key=lambda row: (-echoes.energy[row], row))
        others = [row for row in strong if row != rows[-1]]
        expected += sorted(
            {
                "first": rows[:most],
                "last": rows[-most:],
                "strongest": strong[:most],
                "strongest+last": [rows[-1], *others][:most],
            }[keep]
        )
    assert chosen_returns(echoes, most, keep).tolist() == expected


@pytest.mark.parametrize(
    ("keep", "at"),
    [
        ("first", [10, 20]),
        ("last", [20, 40]),
        ("strongest", [10, 40]),
        ("strongest+last", [10, 40]),
    ],
)
def test_of_three_plates_those_asked_for_are_kept(keep, at):
    # Each leaf lets 0.9 pass, there and back: 0.02/10², 0.02·0.81/20² and 0.9·0.81²/40² come back.
    surfaces = Surfaces(leaf=0.02, leaf_transmittance=0.9, passing="share", other=0.9)
    plates = plate(10.0, LEAF), plate(20.0, LEAF), plate(40.0)
    cloud = looked(plates, Beam(max_returns=2), surfaces=surfaces, receiver=Receiver(keep=keep))
    light = {10: 0.02 / 100, 20: 0.02 * 0.81 / 400, 40: 0.9 * 0.81**2 / 1600}
    assert cloud.true_range == pytest.approx(at, rel=1e-6)
    assert cloud.intensity == pytest.approx([light[one] for one in at], rel=1e-5)
    assert cloud.number.tolist() == [1, 2]


@pytest.mark.parametrize("distance", [3.0, 40.0, 399.0])
def test_a_calibrated_wall_has_its_reflectance_at_every_range(distance):
    beam = Beam(extinction=2e-3)
    surfaces = Surfaces(other=0.37)
    calibrated = Receiver(reading="reflectance")
    cloud = looked([plate(distance)], beam, surfaces=surfaces, receiver=calibrated)
    assert cloud.intensity == pytest.approx([0.37], rel=1e-6)
    cloud = looked([plate(distance)], beam, surfaces=surfaces)
    assert cloud.intensity == pytest.approx([0.37 * np.exp(-0.004 * distance) / distance**2])


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_the_faintest_surface_that_is_seen_grows_with_range_squared(share):
    # 0.8 is seen at 1000 m, so 0.8·(R/1000)² is at R.
    for distance in (50.0, 200.0, 900.0):
        surfaces = Surfaces(other=0.8 * share * (distance / 1000) ** 2)
        cloud = looked([plate(distance)], Beam(), surfaces=surfaces, faintest=0.8)
        assert len(cloud) == (share > 1)


def test_light_beyond_the_dynamic_range_reads_the_same():
    # 0.2 at 1000 m is the faintest; 20 dB more is white, 0.5, at √(0.5/0.2/100)·1000 = 158.1 m.
    receiver = Receiver(dynamic_range=20.0)
    for distance in (30.0, 158.0, 158.3, 300.0):
        cloud = looked([plate(distance)], Beam(), faintest=0.2, receiver=receiver)
        expected = min(0.5 / distance**2, 0.2 / 1000**2 * 100)
        assert cloud.intensity == pytest.approx([expected], rel=1e-6)
    with pytest.raises(SpecError, match=r"receiver.dynamic_range: counts from the faintest"):
        Terrestrial(receiver=receiver)


def test_instruments_resolve_what_their_sheets_say():
    aircraft = structure(settings_of("leica-als50-ii", "airborne"), Airborne)
    for apart, returns in ((2.5, 1), (2.9, 2)):
        plates = plate(100.0, high=0.0), plate(100.0 + apart)
        cloud = looked(plates, aircraft.beam, receiver=aircraft.receiver)
        assert len(cloud) == returns
    drone = structure(settings_of("dji-zenmuse-l2", "airborne"), Airborne)
    limit = drone.faintest * (250 / drone.max_range) ** 2
    assert limit == pytest.approx(0.1)  # 10 % is seen at 250 m
    assert drone.beam.max_returns == 5


@pytest.mark.parametrize("keep", KEEP)
def test_pulses_into_the_sky_have_no_returns(keep):
    receiver = Receiver(keep=keep, dead_zone=2.0, dynamic_range=30.0, reading="reflectance")
    assert not len(looked([plate(-5.0)], Beam(max_returns=2), faintest=0.2, receiver=receiver))
