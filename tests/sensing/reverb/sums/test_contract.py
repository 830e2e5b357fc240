"""The sum over trunks: the promise of a tolerance over drawn scenes, and stands and records that are hard."""

import math

import numpy as np
import pytest
from references.reverb import sum_at_length

from forest_addon.acoustics.air import absorption
from forest_addon.acoustics.cylinder import transfer
from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.channels import ImpulseResponse
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.metrics import octave_bands, reverberation_time, room_metrics
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.sums import layer_sum
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions, arrivals_of, judged
from forest_addon.sensing.reverb.sums.scattering import TrunkPaths, direct_sum, trunk_paths
from forest_addon.sensing.reverb.sums.tree_response import (
    AFTER,
    LONGEST,
    RANGE_DB,
    _largest,
    arrival_energies,
    record_length,
    tree_response,
    weak_trunks,
)
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb

slow, medium = pytest.mark.slow, pytest.mark.medium
AIR = Air(sound_speed=343.0)


def stand(
    count: int, radii: tuple[float, float], side: float, distance: float, seed: int = 0
) -> tuple[TrunkPaths, np.ndarray, np.ndarray]:
    """Paths among even random trunks, radii even by their logarithm, and both ends."""
    rng = np.random.default_rng(seed)
    radius = np.exp(rng.uniform(*np.log(radii), count))
    place = rng.uniform(-side / 2, side / 2, (count, 2))
    return between(place, radius if radii[0] < radii[1] else np.full(count, radii[0]), distance)


def between(
    place: np.ndarray, radius: np.ndarray, distance: float
) -> tuple[TrunkPaths, np.ndarray, np.ndarray]:
    ends = np.array([[-distance / 2, 0.0, 1.5], [distance / 2, 0.0, 1.2]])
    trunks = Trunks(place, radius, np.arange(len(radius)))
    return trunk_paths(trunks, *ends[:, :2], 2.0, 0.7, None, True), *ends


def worst(
    paths: TrunkPaths,
    rate: float,
    tolerance: float,
    losses: Losses | None = None,
    air: Air = AIR,
    seconds: float | None = None,
    exact: np.ndarray | None = None,
) -> float:
    """Largest error of all that is promised, over the tolerance; what the sum tells is held as well."""
    if exact is None:
        exact = exact_sum(paths, rate, losses, air, seconds)
    samples, errors = Expansions().sum(paths, rate, len(exact), air, tolerance, losses)
    assert max(errors.values(), default=0.0) < 3.0 * tolerance
    arrivals = arrivals_of(paths, losses, air.speed())
    return max(judged(samples, exact, rate, tolerance, arrivals).values()) / tolerance


def exact_sum(
    paths: TrunkPaths,
    rate: float,
    losses: Losses | None = None,
    air: Air = AIR,
    seconds: float | None = None,
) -> np.ndarray:
    count = int(rate * (seconds or float(paths.length.max()) / 343.0 + 0.05))
    return direct_sum(paths, rate, count, air, None, losses, 1e-6)


def forest(ends: tuple[np.ndarray, np.ndarray], leaves: float = 0.3, **changes: object) -> Losses:
    given = {"model": "forest", "surface": "forest floor"} | changes
    return Losses.of(Reverb(**given), AIR, TrunkStand(0.05, (0.1, 0.2), leaves, 15.0), *ends)


@pytest.mark.parametrize("cost", [0.0, math.inf], ids=["on a grid", "one by one"])
def test_trunks_on_a_grid_and_one_by_one(cost: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever seems cheaper: near the record's begin, beyond its end, and at all parts of a sample."""
    monkeypatch.setattr(layer_sum, "POINT", cost)
    paths, *_ = stand(60, (0.25, 0.25), 60.0, 1.0)
    exact = exact_sum(paths, 8e3, seconds=0.15)
    for tolerance in (1e-2, 1e-4, 1e-5):
        assert worst(paths, 8e3, tolerance, exact=exact) < 1.0, tolerance


@medium
@pytest.mark.parametrize(
    ("count", "radii", "side", "rate", "tolerance", "air", "seconds"),
    [
        (441, (0.007, 0.007), 100.0, 24e3, 1e-6, (20.0, 50.0, 101.3), None),
        (60, (0.1, 0.1), 100.0, 24e3, 1e-4, (-40.0, 0.01, 60.0), None),
        (60, (0.12, 0.12), 60.0, 4e3, 1e-5, (0.0, 3.0, 101.3), 0.08),  # ends among arrivals
        pytest.param(2, (0.1, 0.1), 10.0, 192e3, 1e-4, (20.0, 50.0, 101.3), 0.06, marks=slow),
    ],
)
def test_every_air_and_rate(
    count: int,
    radii: tuple[float, float],
    side: float,
    rate: float,
    tolerance: float,
    air: tuple[float, float, float],
    seconds: float | None,
) -> None:
    """At 192 kHz ka goes to 176, and the air takes 3 dB a metre at the band's end. Stands of any radii,
    leaves and grounds at low rates: ``sensing/test_tolerances``."""
    warm, humid, pressure = air
    state = Air(sound_speed=343.0, temperature_c=warm, humidity=humid, pressure_kpa=pressure)
    paths, *_ = stand(count, radii, side, 10.0)
    assert worst(paths, rate, tolerance, None, state, seconds) < 1.0


@medium
@pytest.mark.parametrize(
    "radii",
    [(0.02, 0.02), pytest.param((0.5, 2.0), marks=slow)],
)
def test_the_exact_sum_is_exact_at_all_times(radii: tuple[float, float]) -> None:
    """Against one transform of ten minutes, also before the first arrival and below 20 Hz."""
    paths, *_ = stand(3, radii, 60.0, 10.0)
    truth = sum_at_length(paths, 1000.0, 400, AIR)
    found = direct_sum(paths, 1000.0, 400, AIR, None, None, 1e-6)
    assert np.linalg.norm(found - truth) < 1e-9 * np.linalg.norm(truth)
    tenths = [np.linalg.norm(part) for part in np.array_split(found - truth, 10)]
    assert max(tenths) < 1e-6 * 3e-5 * 10 * np.linalg.norm(truth)


@medium
def test_the_exact_sum_with_every_loss_is_exact() -> None:
    paths, *ends = stand(3, (0.1, 0.3), 40.0, 10.0)
    losses = forest(ends, 1.0)
    truth = sum_at_length(paths, 1000.0, 300, AIR, losses, 150.0)
    found = direct_sum(paths, 1000.0, 300, AIR, None, losses, 1e-6)
    assert np.linalg.norm(found - truth) < 3e-8 * np.linalg.norm(truth)


@medium
def test_thick_trunks_beside_both_ends() -> None:
    """Was 4 to 7 times over in a tenth of the record."""
    rng = np.random.default_rng(5)
    ends = np.array([[-10.0, 0.0], [10.0, 0.0]])
    near = np.repeat(ends, 6, axis=0) + rng.normal(0, 2.5, (12, 2))
    place = np.concatenate([near, rng.uniform(-60, 60, (60, 2))])
    trunks = Trunks(place, rng.uniform(0.5, 2.0, 72), np.arange(72))
    paths = trunk_paths(trunks, *ends, 2.0, 0.7)
    assert worst(paths, 4e3, 1e-4) < 1.0


@slow
def test_trunks_that_lean_in_warm_air_with_leaves() -> None:
    """Was 1.09 of the tolerance: what trunks that lean do had a kink at 20 Hz."""
    radii = 10.0**-0.1449, 10.0**-0.0454
    paths, *ends = stand(40, radii, 63.4, 1.1, 10_000)
    air = Air(sound_speed=343.0, temperature_c=50.0, humidity=100.0)
    reverb = Reverb(
        model="forest",
        surface="grass",
        ground=3.4e-42,
        extinction="coherent",
        bark=0.0,
        turbulence=1.0,
    )
    trunks = TrunkStand(0.03, (radii[0], math.sqrt(radii[0] * radii[1]), radii[1]), 3.0, 20.0)
    losses = Losses.of(reverb.changed(leaf_absorption=0.0), air, trunks, *ends)
    assert worst(paths, 4e3, 1e-4, losses, air) < 1.0


@slow
def test_many_trunks_at_single_frequencies() -> None:
    """1,500 trunks, lognormal from 1 cm to 2 m: the spectrum in each octave against the plain sum."""
    rng = np.random.default_rng(3)
    radius = np.clip(rng.lognormal(math.log(0.08), 0.7, 1_500), 0.01, 2.0)
    some, *_ = between(rng.uniform(-125, 125, (1_500, 2)), radius, 10.0)
    rate, tolerance = 16e3, 1e-4
    samples, _ = Expansions().sum(
        some, rate, int((some.length.max() / 343 + 1.0) * rate), AIR, tolerance
    )
    for octave in 20.0 * 2.0 ** np.arange(9):
        frequency = rng.uniform(octave, min(2 * octave, 0.44 * rate), 2)
        loss = absorption(frequency)[:, None]
        way = np.exp(-(loss + 2j * np.pi * frequency[:, None] / 343.0) * some.length)
        exact = (some.weight * way * transfer(frequency[:, None], some.angle, radius, 343.0)).sum(1)
        turn = np.exp(-2j * np.pi * np.outer(frequency, np.arange(len(samples))) / rate)
        gap = turn @ samples - exact
        assert np.linalg.norm(gap) < tolerance * np.linalg.norm(exact)


def test_below_20_hz() -> None:
    """Thin stems, which are 2 to 6 % off with filters that end too early; they fade below 6.4 Hz."""
    some, *_ = stand(60, (0.02, 0.02), 60.0, 10.0)
    found, _ = Expansions().sum(some, 8e3, 40_000, AIR, 1e-4)
    exact = direct_sum(some, 8e3, 40_000, AIR)
    turn = np.exp(-2j * np.pi / 8e3 * np.outer([5.0, 10.0, 17.0], np.arange(40_000)))
    error = np.abs(turn @ (found - exact)) / np.abs(turn @ exact)
    assert (error < [5e-4, 1e-4, 1e-4]).all()


@medium
@pytest.mark.parametrize(
    ("angle", "different"),
    [(0.0, True), (1e-9, False), (1e-3, True), (1.6, False), (np.pi - 1e-6, True), (np.pi, False)],
)
def test_single_angles(angle: float, different: bool) -> None:
    """Straight on and straight back, where cos φ is at its ends."""
    radius = np.linspace(0.2, 0.25, 6) if different else np.full(6, 0.25)
    some = TrunkPaths(
        np.linspace(30.0, 33.0, 6), np.ones(6), np.full(6, angle), radius, np.zeros(6, bool)
    )
    assert worst(some, 16e3, 1e-5) < 1.0


@medium
def test_few_radii_and_one_of_none() -> None:
    some, *_ = stand(200, (0.1, 0.1), 80.0, 10.0)
    radii = np.array([0.1, 0.3, 0.0, 0.02])[np.arange(200) % 4]
    some = TrunkPaths(some.length, some.weight, some.angle, radii, some.clamped)
    assert worst(some, 8e3, 1e-4) < 1.0


@pytest.mark.parametrize("radii", [(0.25, 0.25), pytest.param((0.05, 0.3), marks=slow)])
def test_nothing_wraps_and_short_records(radii: tuple[float, float]) -> None:
    some, *_ = stand(300, radii, 100.0, 10.0)
    prepared = Expansions()
    whole, _ = prepared.sum(some, 8e3, 8_000, AIR, 1e-4)
    for count in (1, 7, 700, 5003):
        part, _ = prepared.sum(some, 8e3, count, AIR, 1e-4)
        assert len(part) == count
        np.testing.assert_allclose(part, whole[:count], atol=2e-4 * np.abs(whole).max())
    before = int((some.earliest.min() / 343.0) * 8e3) - 256
    assert np.abs(whole[: max(0, before)]).max(initial=0.0) < 1e-5 * np.abs(whole).max()


@medium
def test_chosen_by_tolerance_and_number() -> None:
    rng = np.random.default_rng(1)
    trunks = Trunks(rng.uniform(-30, 30, (300, 2)), np.full(300, 0.2), np.arange(300))
    ends = np.array([[-5.0, 0, 1.5], [5.0, 0, 1.5]])

    def listen(count: int, tolerance: float):
        some = Trunks(trunks.position[:count], trunks.radius[:count], trunks.tree[:count])
        reverb = Reverb(duration=0.3, sample_rate=8000.0, tolerance=tolerance)
        return tree_response(some, *ends, reverb, AIR)

    exact, fast = listen(300, 0.0), listen(300, 1e-4)
    assert exact.exact
    assert listen(20, 1e-4).exact
    assert not fast.exact
    gap = np.linalg.norm(fast.samples - exact.samples)
    assert 0 < gap < 1e-4 * np.linalg.norm(exact.samples)


@slow
@pytest.mark.parametrize(
    ("source", "receiver"),
    [
        ((0.0, 0.0), (0.0, 0.0)),  # source is receiver
        ((0.0, 0.0), (1e-9, 0.0)),
        ((-5.0, 0.0), (5.0, 0.0)),
        ((-5.0, 0.0), (8.0, 0.1)),  # the receiver in a trunk
        ((8.0, 0.0), (8.0, 0.0)),  # both at a trunk's axis
    ],
)
def test_hard_places(
    monkeypatch: pytest.MonkeyPatch, source: tuple[float, float], receiver: tuple[float, float]
) -> None:
    """Trunks exactly between, exactly behind, on and around both; one far off; of one radius or of many."""
    for name in ("FEW", "FEW_SUMMANDS"):  # the fast sum also where the exact one takes no longer
        monkeypatch.setattr(f"forest_addon.sensing.reverb.sums.tree_response.{name}", 0)
    rng, spread = np.random.default_rng(4), 0.1 * (source != receiver)
    rows = [(0.5, 0.0), (8.0, 0.0), (-8.0, 0.0), (0.0, 600.0), *rng.uniform(-40, 40, (96, 2))]
    radius = 0.3 + spread * rng.uniform(-1, 0, 100) * (np.arange(100) != 1)
    trunks = Trunks(np.array(rows), radius, np.arange(100))
    exact, fast = (
        tree_response(
            trunks,
            np.array(source),
            np.array(receiver),
            Reverb(duration=5.0, sample_rate=2000.0, tolerance=tolerance),
            AIR,
        )
        for tolerance in (0.0, 1e-4)
    )
    assert exact.exact
    assert not fast.exact
    assert fast.heard.all()
    assert fast.clamped == exact.clamped >= (np.hypot(8 - receiver[0], receiver[1]) < 0.3)
    gap = np.linalg.norm(fast.samples - exact.samples)
    assert gap < 1e-4 * np.linalg.norm(exact.samples)


@medium
@pytest.mark.parametrize("radii", [(0.25, 0.25), pytest.param((0.1, 0.2), marks=slow)])
def test_order_of_trunks_does_not_matter(radii: tuple[float, float]) -> None:
    some, *_ = stand(500, radii, 80.0, 10.0)
    order = np.random.default_rng(3).permutation(500)
    prepared, told = Expansions(), []
    one, _ = prepared.sum(some, 8e3, 4000, AIR, 1e-6, progress=lambda *at: told.append(at))
    other, _ = prepared.sum(some.select(order), 8e3, 4000, AIR, 1e-6)
    np.testing.assert_allclose(one, other, atol=1e-6 * np.abs(one).max())
    shares = [done / every for done, every in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


# -------------------------------------------------------------------------------------------- record
# How long a record is, and what a cut one says of itself.


def record_forest(count: int, side: float, radius: float = 0.25) -> Trunks:
    place = np.random.default_rng(8).uniform(-side / 2, side / 2, (count, 2))
    return Trunks(place, np.full(count, radius), np.arange(count))


def listen(trunks: Trunks, duration: float) -> ImpulseResponse:
    reverb = Reverb(
        source=(-5.0, 0.0, 1.5), receiver=(5.0, 0.0, 1.5), sample_rate=8e3, duration=duration
    )
    return impulse_response(trunks, reverb, AIR)


def test_a_record_ends_where_only_the_inaudible_is_left_and_at_the_longest() -> None:
    place = np.array([[0.0, 5.0], [0.0, 300.0], [0.0, 30_000.0]])
    trunks = Trunks(place, np.array([0.3, 1e-6, 0.3]), np.arange(3))
    ends = np.array([-5.0, 0.0]), np.array([5.0, 0.0])
    paths = trunk_paths(trunks, *ends, 2.0, 0.7)
    near = paths.select(np.array([0, 1]))
    assert record_length(near, (10.0,), 8e3, AIR) < 0.15 + AFTER
    assert record_length(paths.select(np.array([2])), (), 8e3, AIR) == LONGEST
    assert RANGE_DB > 65


def test_the_last_trunk_that_is_needed_is_that_of_a_sum_over_all_in_order() -> None:
    trunks = record_forest(4000, 3000.0)
    paths = trunk_paths(trunks, np.array([-5.0, 0.0]), np.array([5.0, 0.0]), 2.0, 0.7)
    energies, unscattered = arrival_energies(paths, (10.0,), 24e3, AIR)
    order = np.argsort(paths.length)
    left = np.cumsum(energies[:, order[::-1]], axis=1)[:, ::-1]
    allowed = (left[:, :1] + unscattered[:, None]) * 10.0 ** (-RANGE_DB / 10.0)
    last = paths.length[order[np.flatnonzero((left > allowed).any(axis=0))[-1]]]
    assert last < paths.length.max()
    assert record_length(paths, (10.0,), 24e3, AIR) == pytest.approx(last / 343.0 + AFTER)


def test_energies_are_those_of_the_sound() -> None:
    """One trunk at a time is summed; trunks all round, so that the mean over angles is what they have."""
    trunks = record_forest(400, 60.0, 0.1)
    paths = trunk_paths(trunks, np.array([-5.0, 0.0]), np.array([5.0, 0.0]), 2.0, 0.7)
    angle = np.random.default_rng(2).uniform(0.0, math.pi, 400)
    paths = type(paths)(paths.length, paths.weight, angle, paths.radius, paths.clamped)
    expected = arrival_energies(paths, (), 8e3, AIR)[0].sum(axis=1)
    samples = direct_sum(paths, 8e3, 8000, AIR)
    spectrum = np.square(np.abs(np.fft.rfft(samples)))
    frequency = np.fft.rfftfreq(8000, 1 / 8e3)
    measured = [
        spectrum[(frequency > f / 2**0.5) & (frequency < f * 2**0.5)].sum()
        for f in 31.25 * 2.0 ** np.arange(len(expected))
    ]
    ratio = 10 * np.log10(np.array(measured) / expected)
    assert np.ptp(ratio[2:]) < 4.0  # dB, as random sums are


def test_a_cut_record_says_so_and_has_no_reverberation_time() -> None:
    """The same forest, whole and cut after 0.3 s: its T30 would come out at half or less."""
    trunks = record_forest(3000, 600.0)
    whole, cut = listen(trunks, 0.0), listen(trunks, 0.3)
    paths = trunk_paths(trunks, np.array([-5.0, 0.0]), np.array([5.0, 0.0]), 2.0, 0.7)
    last = float(paths.length.max()) / 343.0
    assert last < len(whole.samples) / 8e3 <= last + AFTER + 1e-3
    assert whole.late == 0
    assert (whole.left_db == -np.inf).all()
    assert cut.late > 2000
    assert (cut.left_db[2:] > -40.0).all()
    energy = [float(np.square(found.samples).sum()) for found in (whole, cut)]
    missing = 10 * math.log10((energy[0] - energy[1]) / energy[0])
    assert cut.left_db[0] == pytest.approx(missing, abs=3.0)
    short = reverberation_time(cut.samples, 8e3)
    assert short < 0.6 * reverberation_time(whole.samples, 8e3)
    measures = room_metrics(cut.samples, 8e3, cut.left_db)
    assert np.isnan(measures.t30).all()
    assert np.isfinite(room_metrics(whole.samples, 8e3, whole.left_db).t30[1:]).all()


def test_measures_are_refused_one_by_one() -> None:
    """A rest -50 dB below changes no T30, but T60; -15 dB below changes the clarity."""
    samples = 10.0 ** (-3.0 * np.arange(32_000) / 8e3 / 1.0)
    count = len(room_metrics(samples, 8e3).band)
    some = room_metrics(samples, 8e3, np.full(count, -50.0))
    assert np.isfinite([some.edt[0], some.t20[0], some.t30[0], some.c50[0]]).all()
    assert np.isnan(some.t60).all()
    few = room_metrics(samples, 8e3, np.full(count, -15.0))
    assert np.isnan([few.edt[0], few.t20[0], few.c50[0], few.centre_time[0]]).all()


CLAP = Reverb(source=(0, 0, 1.5), receiver=(4, 0, 1.5), sample_rate=8000, duration=0.3)


def record_stand(count=80, low=1e-3, high=0.3, seed=3):
    """Twigs beside trunks: most of them change nothing."""
    rng = stream(seed, "weak")
    place = rng.uniform(-60, 60, (count, 2))
    place = place[np.linalg.norm(place, axis=1) > 5]
    radius = np.exp(rng.uniform(math.log(low), math.log(high), len(place)))
    return Trunks(place, radius, np.arange(len(place)))


def octave_norms(samples, rate):
    power = np.abs(np.fft.rfft(samples)) ** 2 * (rate / len(samples))
    frequency = np.arange(len(power)) * rate / len(samples)
    middles = octave_bands(rate)
    return np.array(
        [
            np.sqrt(power[(frequency >= f / 2**0.5) & (frequency < f * 2**0.5)].sum())
            for f in middles
        ]
    )


@pytest.mark.medium
@pytest.mark.parametrize("model", ["paper", pytest.param("forest", marks=pytest.mark.slow)])
def test_what_is_left_out_is_below_its_bound(model):
    trunks, clap = record_stand(25), CLAP.changed(model=model, tail="none", tolerance=0.0)
    field = ((-60.0, -60.0), (120.0, 120.0))
    whole = impulse_response(trunks, clap, Air(), field=field)
    some = impulse_response(trunks, clap, Air(), field=field, all_trunks=False)
    assert 0 < some.weak < len(trunks)
    assert whole.trunks + whole.late == some.trunks + some.late + some.weak
    apart = octave_norms(whole.trees - some.trees, CLAP.sample_rate)
    heard = octave_norms(some.samples, CLAP.sample_rate)
    assert (apart <= some.weak_bound * heard * 1.001).all()
    assert (apart > 0).any()
    assert some.weak_bound < 3 * 10 ** (-75 / 20)  # what is allowed is set against an estimate


def test_the_bound_holds_trunk_by_trunk():
    """Twenty trunks of any size and angle, each alone against its own bound."""
    trunks = record_stand(20, low=1e-3, high=2.0, seed=5)
    clap = CLAP.changed(duration=1.0, tolerance=0.0)
    paths = trunk_paths(trunks, np.zeros(2), np.array([4.0, 0.0]), clap.strength, clap.spreading)
    norms = _largest(paths, np.array(octave_bands(clap.sample_rate)), Air())
    for row in range(0, len(trunks), 4):
        one = impulse_response(trunks.select(np.array([row])), clap, Air()).trees
        assert (octave_norms(one, clap.sample_rate) <= 1.02 * norms[:, row]).all()


def test_nothing_is_left_out_where_all_matters():
    trunks = record_stand(12, low=0.2, high=0.3)
    assert impulse_response(trunks, CLAP, Air(), all_trunks=False).weak == 0
    none = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, int))
    paths = trunk_paths(none, np.zeros(2), np.ones(2), 2.0, 0.7)
    weak = weak_trunks(paths, (1.0,), 8000.0, Air())
    assert weak.bound(np.zeros(100), 8000.0) == 0.0


def test_silence_leaves_nothing_out():
    """With no direct sound, all is relative to the trunks themselves."""
    trunks = Trunks(np.array([[10.0, 0.0], [0.0, 10.0]]), np.array([0.1, 0.0]), np.arange(2))
    paths = trunk_paths(trunks, np.zeros(2), np.array([4.0, 0.0]), 2.0, 0.7)
    assert weak_trunks(paths, (), 8000.0, Air()).rows.tolist() == [False, True]
