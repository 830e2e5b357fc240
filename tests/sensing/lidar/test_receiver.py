"""Returns that receivers make of echoes, against plates at known distances and plain loops."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from references.rays import BruteCaster, scene_with, sheet
from scipy.optimize import curve_fit

from forest_addon.base.trimesh import LEAF, OTHER, TriMesh
from forest_addon.formats.toml_file import read_scanner, scanner_names, settings_of, structure
from forest_addon.sensing.lidar.radiometry import received_energy
from forest_addon.sensing.lidar.receiver import awake, chosen_returns, false_alarm_rate
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.lidar.waveform import (
    LIGHT,
    WaveformEchoes,
    Waveforms,
    decompose,
    find_echoes,
    fitted_echoes,
    pulse_length,
    record,
    sent_pulse,
)
from forest_addon.spec import Airborne, Beam, LinkBudget, Receiver, Surfaces, Terrestrial

KEEP = ("first", "last", "strongest", "strongest+last")


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
    plates = sheet(100.0, high=0.0), sheet(100.0 + apart)
    beam = Beam(subrays=100, divergence_mrad=(1.0, 1.0), pulse_ns=2.0, max_returns=5)
    assert len(looked(plates, beam)) == 2  # the waveform tells them apart
    cloud = looked(plates, beam, receiver=Receiver(dead_zone=2.5))
    at = [100.0, 100.0 + apart][:returns]
    assert cloud.true_range == pytest.approx(at, abs=1e-3)
    assert cloud.count.tolist() == [returns] * returns


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
    plates = sheet(10.0, LEAF), sheet(20.0, LEAF), sheet(40.0)
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
    cloud = looked([sheet(distance)], beam, surfaces=surfaces, receiver=calibrated)
    assert cloud.intensity == pytest.approx([0.37], rel=1e-6)
    cloud = looked([sheet(distance)], beam, surfaces=surfaces)
    assert cloud.intensity == pytest.approx([0.37 * np.exp(-0.004 * distance) / distance**2])


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_the_faintest_surface_that_is_seen_grows_with_range_squared(share):
    # 0.8 is seen at 1000 m, so 0.8·(R/1000)² is at R.
    for distance in (50.0, 200.0, 900.0):
        surfaces = Surfaces(other=0.8 * share * (distance / 1000) ** 2)
        cloud = looked([sheet(distance)], Beam(), surfaces=surfaces, faintest=0.8)
        assert len(cloud) == (share > 1)


def test_light_beyond_the_dynamic_range_reads_the_same():
    # 0.2 at 1000 m is the faintest; 20 dB more is white, 0.5, at √(0.5/0.2/100)·1000 = 158.1 m.
    receiver = Receiver(dynamic_range=20.0)
    for distance in (30.0, 158.0, 158.3, 300.0):
        cloud = looked([sheet(distance)], Beam(), faintest=0.2, receiver=receiver)
        expected = min(0.5 / distance**2, 0.2 / 1000**2 * 100)
        assert cloud.intensity == pytest.approx([expected], rel=1e-6)


def test_instruments_resolve_what_their_sheets_say():
    aircraft = structure(settings_of("leica-als50-ii", "airborne"), Airborne)
    for apart, returns in ((2.5, 1), (2.9, 2)):
        plates = sheet(100.0, high=0.0), sheet(100.0 + apart)
        cloud = looked(plates, aircraft.beam, receiver=aircraft.receiver)
        assert len(cloud) == returns
    drone = structure(settings_of("dji-zenmuse-l2", "airborne"), Airborne)
    limit = drone.faintest * (250 / drone.max_range) ** 2
    assert limit == pytest.approx(0.1)  # 10 % is seen at 250 m
    assert drone.beam.max_returns == 5


def noisy(snr, **settings):
    """A tripod of 10,000 pulses whose receiver has noise; its threshold is a tenth of white at 200 m."""
    given = {"max_range": 200.0, "faintest": 0.1, "beam": Beam(pulse_ns=5.0, max_returns=15)}
    return Terrestrial(
        position=(0.0, 0.0, 0.0),
        azimuth_deg=(0.0, 9.9),
        elevation_deg=(-5.0, 4.9),
        angle_step_deg=0.1,
        receiver=Receiver(threshold_snr=snr, **settings),
        **given,
    )


@pytest.mark.medium
def test_false_alarm_rate_is_that_of_filtered_noise():
    rng = np.random.default_rng(1)
    step, sigma = 0.1e-9, 5e-9 / 2.3548200450309493
    time = np.arange(-60, 61) * step
    filtered = np.convolve(
        rng.standard_normal(4_000_000), np.exp(-0.5 * (time / sigma) ** 2), "valid"
    )
    filtered /= filtered.std()
    for snr in (1.0, 2.0, 3.0):
        crossings = ((filtered[:-1] < snr) & (filtered[1:] >= snr)).sum()
        expected = false_alarm_rate(snr, 5.0) * len(filtered) * step
        assert abs(crossings - expected) < 5 * np.sqrt(expected)  # odds of 1 in a million


def test_noise_gives_false_points_everywhere_in_the_gate_and_says_that_nothing_was_met():
    scanner = noisy(3.0)
    cloud = scan(
        scanner, BruteCaster(scene_with(sheet(-50.0))), seed=4
    )  # behind: no pulse meets it
    gate = 2 * (scanner.max_range - scanner.min_range) / 299_792_458.0
    mean = 10_000 * false_alarm_rate(3.0, 5.0) * gate
    assert abs(len(cloud) - mean) < 5 * np.sqrt(mean)
    place = np.sort(cloud.true_range - scanner.min_range) / (scanner.max_range - scanner.min_range)
    away = np.abs(place - (np.arange(len(place)) + 0.5) / len(place)).max()
    assert away < 2.63 / np.sqrt(len(place))  # Kolmogorov's law: 1 in a million
    limit = 0.1 / 200.0**2
    excess = (cloud.intensity / limit) ** 2 - 1  # over the threshold: exponential, of mean 2/snr²
    assert excess.mean() == pytest.approx(2 / 9, abs=5 * 2 / 9 / np.sqrt(len(cloud)))
    assert (cloud.returns.organ == -1).all()
    assert (cloud.returns.instance == -1).all()
    assert np.isfinite(cloud.position).all()
    work = Scan(scanner, BruteCaster(scene_with(sheet(-50.0))), seed=4)
    parts = np.concatenate([piece.position for _, piece in work.chunks(at_once=777)])
    assert (parts == cloud.position).all()


@pytest.mark.medium
@pytest.mark.parametrize(("over", "chance"), [(1.0, 0.5), (1.2, 0.8413447), (0.8, 0.1586553)])
def test_weak_echoes_come_and_go_as_their_share_of_the_noise_says(over, chance):
    scanner = noisy(5.0)
    pulses = 10_000
    dish = TriMesh.of_part(*sphere(150.0), OTHER)
    white = over * 0.1 / 200.0**2 * 150.0**2
    scanner = type(scanner)(**{**vars(scanner), "surfaces": Surfaces(other=white)})
    cloud = scan(scanner, BruteCaster(scene_with(dish)), seed=2)
    seen = ((np.abs(cloud.true_range - 150.0) < 0.5) & (cloud.returns.organ == OTHER)).sum()
    assert (
        abs(seen - pulses * chance) < 5 * np.sqrt(pulses * chance * (1 - chance)) + 0.002 * pulses
    )


def sphere(radius):
    """A fine cap of a sphere around the origin, in front of the scanner."""
    az, el = np.meshgrid(
        np.radians(np.arange(-1, 23, 2)), np.radians(np.arange(-7, 8, 2)), indexing="ij"
    )
    place = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)], 2) * radius
    number = np.arange(az.size).reshape(az.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = [np.stack(f, 2).reshape(-1, 3) for f in ((a, b, c), (a, c, d))]
    return place.reshape(-1, 3), np.concatenate(faces)


def test_far_echoes_fold_into_the_range_of_the_next_pulse():
    period = 299_792_458.0 / 2 / 1e6  # 149.9 m at 1 MHz
    plates = sheet(20.0, high=-5.0), sheet(400.0)
    settings = {"max_range": 1000.0, "pulse_rate": 1e6, "beam": Beam(max_returns=5)}
    scanner = Airborne(
        position=(0.0, 0.0, 0.0),
        heading_deg=90.0,
        pattern="lines",
        field_deg=(60.0, 110.0),
        line_rate=1e4,
        track=1.0,
        speed=1e3,
        receiver=Receiver(beyond="folded"),
        **settings,
    )
    caster = BruteCaster(scene_with(*plates))
    cloud = scan(scanner, caster)
    true = scan(type(scanner)(**{**vars(scanner), "receiver": Receiver()}), caster)
    rounds = np.floor(true.true_range / period)
    sent = dict(zip(true.pulse.tolist(), true.true_range.tolist(), strict=True))
    assert rounds.max() >= 2
    late = np.round((cloud.true_range - cloud.returns.distance) / period).astype(int)
    assert late.max() >= 2
    for pulse, seems, k in zip(cloud.pulse, cloud.returns.distance, late, strict=True):
        assert seems + k * period == pytest.approx(sent[pulse - k], abs=1e-6)
    expected = (true.pulse + rounds < true.pulses) & (true.true_range - rounds * period >= 0.1)
    assert len(cloud) == expected.sum()
    work = Scan(scanner, caster)
    parts = np.concatenate([piece.position for _, piece in work.chunks(at_once=97)])
    assert (parts == cloud.position).all()


@pytest.mark.parametrize("beyond", ["resolved", "folded"])
def test_light_that_arrives_while_a_later_pulse_is_sent_is_lost(beyond):
    period = 299_792_458.0 / 2 / 1e6
    settings = {"max_range": 1000.0, "pulse_rate": 1e6, "pattern": "lines", "line_rate": 1e4}
    settings |= {"position": (0.0, 0.0, 0.0), "heading_deg": 90.0, "track": 1.0, "speed": 1e3}
    caster = BruteCaster(scene_with(sheet(20.0, high=-5.0), sheet(448.0)))
    clouds = [
        scan(
            Airborne(
                receiver=Receiver(beyond=beyond, blanking=b), field_deg=(60.0, 110.0), **settings
            ),
            caster,
        )
        for b in (0.0, 30.0)
    ]
    true = clouds[0].true_range
    lost = (true >= period) & (true % period < 30.0)
    assert 0 < lost.sum() < len(true)
    assert clouds[1].true_range == pytest.approx(true[~lost], abs=1e-9)
    assert (clouds[1].pulse == clouds[0].pulse[~lost]).all()


def test_a_link_budget_sees_as_far_as_its_photons_reach():
    link = LinkBudget(energy=1.0, aperture=0.05, efficiency=0.4, photons=2000.0)
    joules = 1e-6 * 0.4 * 0.05**2 / 4 * 0.5  # at 1 m, of reflectance 0.5
    needed = 2000.0 * 6.62607015e-34 * 299_792_458.0 / 1064e-9
    reach = np.sqrt(joules / needed)  # 580 m
    beam = Beam(wavelength_nm=1064.0)
    for share, seen in ((0.999, 1), (1.001, 0)):
        assert len(looked([sheet(share * reach)], beam, link=link)) == seen
    light = np.array([0.5 / reach**2])
    scanner = Terrestrial(link=link, beam=beam)
    assert received_energy(scanner, light) == pytest.approx(needed, rel=1e-12)


@given(
    seed=st.integers(0, 2**32 - 1),
    dead_zone=st.one_of(st.just(0.0), st.floats(0.01, 20.0)),
    most=st.integers(1, 15),
    keep=st.sampled_from(KEEP),
)
def test_receivers_make_no_light_and_lose_none_without_a_reason(seed, dead_zone, most, keep):
    """Each for 200 pulses of its own."""
    echoes = random_echoes(np.random.default_rng(seed), pulses=200)
    told = awake(echoes, dead_zone)
    seen = echoes.select(told)
    kept = seen.select(chosen_returns(seen, most, keep))
    light = np.bincount(echoes.pulse, echoes.energy, 200)
    if not dead_zone:
        assert np.bincount(seen.pulse, seen.energy, 200) == pytest.approx(light)
    if not dead_zone and most >= 9:
        assert np.bincount(kept.pulse, kept.energy, 200) == pytest.approx(light)
    assert (np.bincount(kept.pulse, kept.energy, 200) <= light + 1e-9).all()
    count = np.bincount(seen.pulse, minlength=200)
    assert (np.bincount(kept.pulse, minlength=200) == np.minimum(count, most)).all()
    same = np.diff(seen.pulse) == 0
    assert (np.diff(seen.distance)[same] >= dead_zone).all()
    for row in np.setdiff1d(
        np.arange(len(echoes.pulse)), told
    ):  # each lost one is near one that was told
        mine = seen.distance[seen.pulse == echoes.pulse[row]]
        away = echoes.distance[row] - mine
        assert ((away >= 0) & (away < dead_zone)).any()


# ------------------------------------------------------------------------------------------ waveform
# Echoes against sampled waveforms and closed forms.

SIGMA = 0.3


def sample(time, distance, energy, sigma):
    """Waveform at two-way times (T,) s of contacts (C,): energy a metre of range."""
    away = (time[:, None] * LIGHT / 2 - distance) / sigma
    return np.exp(-0.5 * away**2) / (sigma * np.sqrt(2 * np.pi)) @ energy


def echoes_of(distance, energy=None, pulse=None, sigma=SIGMA):
    distance = np.asarray(distance, float)
    energy = np.ones(len(distance)) if energy is None else np.asarray(energy, float)
    pulse = np.zeros(len(distance), np.int64) if pulse is None else np.asarray(pulse)
    ray = pulse * len(distance) + np.arange(len(distance))
    return find_echoes(ray, max(len(distance), 1), distance, energy, sigma)


def crests_by_grid(distance, energy, sigma):
    """Local maxima of the waveform on a grid of σ/2000."""
    x = np.arange(min(distance) - sigma, max(distance) + sigma, sigma / 2000)
    wave = sample(x * 2 / LIGHT, np.asarray(distance), np.asarray(energy), sigma)
    inner = (wave[1:-1] > wave[:-2]) & (wave[1:-1] >= wave[2:])
    return x[1:-1][inner]


def test_a_pulse_of_so_many_nanoseconds():
    # FWHM of 10 ns in time is c·10 ns/2 = 1.499 m in range.
    assert pulse_length(10.0) * 2.3548200450309493 == pytest.approx(1.49896229, rel=1e-9)


@pytest.mark.parametrize("gap", [0.0, 0.5, 1.0, 1.9, 2.0])
def test_two_equal_contacts_within_two_sigma_are_one_echo_in_the_middle(gap):
    found = echoes_of([10.0, 10.0 + gap * SIGMA])
    # At 2 σ the crest is of the fourth order: rounding of 1e-16 moves it by 1e-4 σ.
    off = 1e-9 if gap < 2 else 1e-4 * SIGMA
    assert found.distance == pytest.approx([10 + gap * SIGMA / 2], abs=off)
    assert found.energy == pytest.approx([2.0])
    assert found.width == pytest.approx([SIGMA * np.sqrt(1 + gap**2 / 4)])


@pytest.mark.parametrize("seed", range(4))
def test_random_foliage_has_the_crests_of_its_waveform(seed):
    rng = np.random.default_rng(seed)
    distance = 40 + rng.gamma(2.0, 1.5 * SIGMA, 60)
    energy = rng.uniform(0.1, 1, 60)
    found = echoes_of(distance, energy)
    grid = crests_by_grid(distance, energy, SIGMA)
    assert len(found.distance) == len(grid)
    assert found.distance == pytest.approx(grid, abs=SIGMA / 2000)
    assert found.energy.sum() == pytest.approx(
        energy.sum(), rel=1e-12
    )  # all light is accounted for


def test_pulses_are_apart_whatever_their_order():
    rng = np.random.default_rng(3)
    pulse = rng.integers(0, 50, 800)
    distance, energy = rng.uniform(5, 9, 800), rng.uniform(0.5, 1, 800)
    together = echoes_of(distance, energy, pulse)
    for number in range(50):
        rows = pulse == number
        alone = echoes_of(distance[rows], energy[rows])
        mine = together.pulse == number
        assert (together.distance[mine] == alone.distance).all()
        assert (together.energy[mine] == alone.energy).all()
    assert (np.diff(together.pulse) >= 0).all()


def test_the_contact_that_stands_for_an_echo_is_the_innermost_of_the_strong():
    found = find_echoes(
        np.array([3, 1, 0, 2]),
        4,
        np.array([10.0, 10.01, 10.02, 10.03]),
        np.array([1.0, 0.6, 0.1, 0.9]),
        SIGMA,
    )
    assert found.contact.tolist() == [1]


def test_nothing_comes_back():
    found = echoes_of([])
    assert [len(array) for array in (found.pulse, found.distance, found.energy)] == [0, 0, 0]


# ------------------------------------------------------------------------------- whatever comes back


def instruments():
    """Lengths of the pulses of all instruments, metres."""
    tables = [read_scanner(name).tables for name in scanner_names()]
    lengths = {kind["beam"]["pulse_ns"] for table in tables for kind in table.values()}
    return sorted(pulse_length(length) for length in lengths)


# One pulse of 19 sub-rays: its middle crest owns the one contact just before the valley behind it.
HARD_SIGMA = 0.19096520260599778
HARD_DISTANCE = [
    4.603726448587371, 4.606746323905647, 4.585039914057052, 4.604206140163594, 4.607711508584166,
    4.697875275149075, 4.607894887604133, 4.588637505925392, 4.590658047032093, 4.610694575374582,
    4.6992313832892325, 4.605974451488044, 4.608730617181796, 4.697957508946587, 4.612390761619516,
    4.700392540703029, 4.068985619504748, 3.681032491995881, 4.7014040049208266,
]  # fmt: skip
HARD_ENERGY = [
    4.156467178376e-4, 4.150884609011e-4, 2.920888601144e-5, 4.155058845432e-4, 4.149652887694e-4,
    7.900817810521e-4, 4.148196529239e-4, 2.922817088974e-5, 2.899422421653e-5, 4.143808004705e-4,
    7.895927222211e-4, 4.151077079492e-4, 4.148557268778e-4, 7.901177934023e-4, 4.139804121130e-4,
    7.796377293331e-4, 9.878054989664e-4, 1.036429684209e-3, 7.889418956579e-4,
]  # fmt: skip


def contacts(most=100):
    """Contacts of one pulse: in clumps, far and near, some at the very same place."""
    place = st.one_of(
        st.floats(-30, 30),
        st.integers(-8, 8).map(float),
        st.floats(-2.5, 2.5),
        st.floats(-1e-9, 1e-9),
    )  # in pulse lengths
    return st.lists(
        st.tuples(place, st.floats(0, 5), st.sampled_from([0.0, 0.0, 0.5, 3.0, 40.0])),
        min_size=1,
        max_size=most,
    )


HARD_PULSE = [
    ((x - 40) / HARD_SIGMA, 5 + np.log10(e), 0.0)
    for x, e in zip(HARD_DISTANCE, HARD_ENERGY, strict=True)
]


@settings(max_examples=10)
@given(
    sigma=st.sampled_from(instruments()),
    pulses=st.lists(contacts(), min_size=1, max_size=3),
    spread=st.booleans(),
)
@example(sigma=HARD_SIGMA, pulses=[HARD_PULSE], spread=False)
def test_no_pulse_is_lost_and_no_light(sigma, pulses, spread):
    place, decade, blur = (
        np.array([contact[k] for pulse in pulses for contact in pulse]) for k in range(3)
    )
    pulse = np.repeat(np.arange(len(pulses)), [len(contacts) for contacts in pulses])
    distance, energy, blur = 40 + sigma * place, 10 ** (decade - 5), sigma * blur * spread
    subray = np.concatenate([np.arange(len(contacts)) for contacts in pulses])
    found = find_echoes(pulse * 100 + subray, 100, distance, energy, sigma, blur)

    for number in range(len(pulses)):
        mine, its = found.pulse == number, pulse == number
        assert 1 <= mine.sum() <= its.sum()
        assert found.energy[mine].sum() == pytest.approx(energy[its].sum(), rel=1e-12)
        assert (np.diff(found.distance[mine]) > 0).all()
        assert (pulse[found.contact[mine]] == number).all()
        assert found.distance[mine].min() >= distance[its].min()
        assert found.distance[mine].max() <= distance[its].max()
    assert (found.width >= sigma).all()
    assert (found.energy > 0).all()
    assert len(np.unique(found.contact)) == len(found.contact)


@settings(max_examples=10)
@given(sigma=st.sampled_from(instruments()), places=contacts(most=45), seed=st.integers(0, 99))
def test_every_contact_is_in_exactly_one_echo(sigma, places, seed):
    # Energies are powers of two from 2^0 to 2^44 in any order: the bits of an echo's energy are its contacts.
    distance = 40 + sigma * np.array([place for place, _, _ in places])
    energy = 2.0 ** np.random.default_rng(seed).permutation(len(places))
    found = echoes_of(distance, energy, sigma=sigma)
    taken = [{k for k in range(45) if int(e) >> k & 1} for e in found.energy]
    assert sum(len(one) for one in taken) == len(places)
    assert set().union(*taken) == set(range(len(places)))
    for one, contact in zip(taken, found.contact, strict=True):
        assert int(np.log2(energy[contact])) in one
    reach = [[distance[energy == 2.0**k][0] for k in one] for one in taken]
    assert all(max(a) <= min(b) for a, b in pairwise(reach))  # in order


@pytest.mark.parametrize(
    ("gap", "ratio"), [(2.2, 0.5), (2.4, 0.5), (2.4, 1.0), (3.0, 0.5), (6.0, 1.0)]
)
def test_gaussians_fitted_to_a_record_are_where_the_contacts_are(gap, ratio):
    """A crest is drawn to its neighbour (5.5 cm of two equal ones at 2.4σ of 4 ns), a fit is not."""
    ray, none = np.arange(2), np.zeros(2)
    distance, energy = np.array([10.0, 10.0 + gap * SIGMA]), np.array([1.0, ratio])
    waves = record(ray, 2, distance, energy, none, (SIGMA, np.ones(1), 0), SIGMA / 4)
    time = waves.index * waves.step * 2 / LIGHT
    assert waves.value == pytest.approx(sample(time, distance, energy, SIGMA), abs=1e-7)
    found = fitted_echoes(waves, ray, 2, distance, energy, SIGMA, 0.0)
    if len(found.distance) == 2 or gap > 2.4:
        assert found.distance == pytest.approx(distance, abs=1e-6)
        assert found.energy == pytest.approx(energy, rel=1e-5)
        assert found.width == pytest.approx([SIGMA, SIGMA], rel=1e-5)
        assert found.contact.tolist() == [0, 1]
    else:  # of unequal ones the weaker has no crest yet
        assert ratio < 1
        assert len(echoes_of(distance, energy).distance) == 1


def test_records_and_fits_of_a_pulse_do_not_depend_on_the_others():
    rng = np.random.default_rng(3)
    ray, distance = np.arange(7 * 60), 50 + rng.choice([0.0, 0.9, 4.0, 30.0], 420)
    distance += rng.uniform(0, 0.2, 420)
    energy, blur = rng.random(420) * (rng.random(420) > 0.2), rng.uniform(0, 0.1, 420)
    sent = sent_pulse(Beam(pulse_ns=6.0, pulse_shape=(0.2, 1.0, 0.7, 0.2, 0.05, -0.02)), 0.05)

    def made(some):
        given = ray[some], 7, distance[some], energy[some], blur[some]
        waves = record(*given, sent, 0.05)
        return waves, fitted_echoes(waves, *given[:4], SIGMA, 0.0)

    waves, whole = made(ray >= 0)
    for parts in (ray < 7 * 23, ray >= 7 * 23):
        some, echoes = made(parts)
        of = np.isin(waves.pulse, some.pulse)
        assert (some.value == waves.value[of]).all()
        assert (some.index == waves.index[of]).all()
        rows = np.isin(whole.pulse, echoes.pulse)
        for name in ("pulse", "distance", "energy", "width"):
            assert (getattr(echoes, name) == getattr(whole, name)[rows]).all()


@pytest.mark.parametrize("seed", [160, 481, 487, 528])
def test_a_gaussian_that_finds_nothing_in_noise_ends_no_fit(seed):
    """Crests of noise whose Gaussians narrow to nothing, or to each other's: the echo beside them stands."""
    rng, time = np.random.default_rng(seed), np.arange(64)
    place = rng.uniform(24, 60)
    power = np.exp(-0.5 * ((time - 20) / 2) ** 2) + 0.16 * np.exp(-0.5 * ((time - place) / 2) ** 2)
    power += 0.05 * rng.standard_normal(64)
    found = decompose(Waveforms(0 * time, time, power, 0.15), 1.2, 0.1)
    assert np.isfinite(found).all()
    assert np.abs(found[1] - 20 * 0.15).min() < 0.06


@pytest.mark.parametrize("step_ns", [1.0, 0.3])
def test_a_told_shape_keeps_its_light_and_its_range(step_ns):
    """Of a pulse with a tail: as much light, at the range where a Gaussian fitted to the pulse lies."""
    time = np.arange(60)
    shape = np.exp(-0.5 * ((time - 20) / 5) ** 2) + 0.3 * np.exp(-0.5 * ((time - 31) / 7) ** 2)
    fit, _ = curve_fit(
        lambda t, a, m, s: a * np.exp(-0.5 * ((t - m) / s) ** 2), time, shape, (1, 20, 5)
    )
    step = step_ns * 1e-9 * LIGHT / 2
    sent = sent_pulse(Beam(pulse_ns=12.0, pulse_shape=tuple(shape.tolist())), step)
    ray, distance = np.zeros(1, int), np.array([77.77])
    waves = record(ray, 1, distance, np.ones(1), np.zeros(1), sent, step)
    assert waves.value.sum() * step == pytest.approx(1, abs=2e-3)
    own = fit[1] + (waves.index * step - 77.77) / (1e-9 * LIGHT / 2)
    there = np.interp(own, time, shape, left=0, right=0)
    assert waves.value == pytest.approx(
        there * waves.value.max() / shape.max(), abs=0.01 * waves.value.max()
    )
    found = fitted_echoes(waves, ray, 1, distance, np.ones(1), SIGMA * 3, 0.0)
    assert found.distance == pytest.approx([77.77], abs=2e-3)
