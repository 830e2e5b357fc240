"""Wind over a stand and the answer of trees: spectra, coherence, an oscillator stepped through time."""

import numpy as np
import pytest
from references.reverb import rod
from scipy.integrate import solve_ivp, trapezoid
from scipy.optimize import brentq
from scipy.signal import welch

from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.sway.beams import GreenWood
from forest_addon.growth.sway.shape import shape_of, shape_with
from forest_addon.spec import Wind
from forest_addon.stand.wind import DECAY, INTERNAL, WindField, drag, kaimal, response_of

WOOD = GreenWood(800.0, 9e9)
BREEZE = Wind(speed=6.0, direction_deg=30.0)
LEAVES = np.full(40, 0.6 / 40)  # drag area of a leaf area index of 3


def tree(modes: int = 12):
    skeleton = rod(0.1, 0.02, 15.0, 30)
    area = np.where(skeleton.start[:, 2] > 6, 3.0, 0.0)
    return shape_with(skeleton, area, WOOD, modes)


def test_a_spectrum_has_unit_variance_and_its_peak():
    frequency = np.geomspace(1e-4, 1e3, 20_000)
    density = kaimal(frequency, np.array([0.15, 0.45]))
    assert trapezoid(density, frequency, axis=0) == pytest.approx([1, 1], abs=0.01)
    peak = frequency[np.argmax(frequency[:, None] * density, axis=0)]
    assert peak == pytest.approx([0.15, 0.45], rel=0.01)


def test_wind_has_its_mean_and_its_variance_at_the_tops():
    """300 seeds of one place: the deviation of the mean is σ/√300, of a standard deviation σ/√600."""
    found = np.stack(
        [
            WindField.drawn(BREEZE, 15.0, LEAVES, seed).at(
                np.array([[3.0, 4.0, 15.0]]), np.array([7.0])
            )[0]
            for seed in range(300)
        ]
    )
    along = found[:, :2] @ [np.cos(np.radians(30)), np.sin(np.radians(30))]
    sigma = 0.3 * 6.0
    assert abs(along.mean() - 6.0) < 4 * sigma / 300**0.5  # false alarm 6e-5
    assert abs(along.std() / sigma - 1) < 4 / 600**0.5 + 0.03  # the band ends at 8 Hz and 0.005 Hz
    assert found[:, 2].std() < along.std()


def test_trees_take_the_momentum_that_the_wind_loses():
    """Sum of ζ' U² over layers against β² (1 - exp(-ζ/β²)), for leaves spread evenly and all at the top."""
    layers = 4000
    top = np.where(np.arange(layers) > 0.7 * layers, 1.0, 0.01)
    for area in (np.ones(layers), top):
        area = 0.8 * area / area.sum()
        field = WindField.drawn(BREEZE, 15.0, area, 1)
        middle = (np.arange(layers) + 0.5) / layers * 15.0
        taken = float((area * field.mean(middle) ** 2).sum()) / 6.0**2
        beta = field.friction
        assert taken == pytest.approx(beta**2 * (1 - np.exp(-0.8 / beta**2)), rel=1e-3)


@pytest.mark.medium
def test_the_spectrum_of_half_an_hour_has_no_gaps():
    """Slope by the least squares of Welch's lines, 0.2 to 2 Hz, of wind at a point: Kaimal's own there."""
    frequency, steep = np.geomspace(0.2, 2.0, 200), []
    field = WindField.drawn(BREEZE, 15.0, LEAVES, 3)
    place, time = np.array([[0.0, 0.0, 15.0]]), np.arange(0, 1800, 0.25)
    turn = np.exp(2j * np.pi * time[:, None] * field.frequency[field.frequency < 2])
    gust = (turn @ field.waves(place)[0, field.frequency < 2, 0]).real
    found, power = welch(gust, 4.0, "hamming", 1600)
    steep = [
        np.polyfit(np.log(x), np.log(y), 1)[0]
        for x, y in (
            (found[(found > 0.2) & (found < 1.9)], power[(found > 0.2) & (found < 1.9)]),
            (frequency, kaimal(frequency, np.array([0.15 * 6 / 15]))[:, 0]),
        )
    ]
    assert steep[0] == pytest.approx(steep[1], abs=0.4)


def test_wind_fades_among_the_trees_and_grows_above():
    field = WindField.drawn(BREEZE, 15.0, LEAVES, 1)
    profile = field.mean(np.array([0.0, 5.0, 10.0, 15.0, 30.0]))
    assert (np.diff(profile) > 0).all()
    assert profile[3] == pytest.approx(6.0)
    assert profile[0] == pytest.approx(6.0 * np.exp(-0.6 / (2 * field.friction**2)))


def test_coherence_is_davenports():
    """The expected phase factor of waves across a distance, of 400 drawn fields."""
    apart, rows = 2.0, []
    for seed in range(400):
        field = WindField.drawn(BREEZE, 15.0, LEAVES, seed)
        rows.append(np.exp(1j * field.across[:, 0] * apart))
        frequency = field.frequency
    found = np.mean(rows, axis=0)
    some = (frequency > 0.02) & (frequency < 1.0)
    expected = np.exp(-DECAY * frequency[some] * apart / 6.0)
    assert np.abs(found[some] - expected).max() < 5 / 400**0.5  # of 130 lines; false alarm 5e-4


def test_gusts_travel():
    """A wave of the field is the same a time later, so much further along the wind."""
    field = WindField.drawn(BREEZE, 15.0, LEAVES, 1)
    way = np.append(field.along, 0.0)
    here = np.array([[1.0, 2.0, 15.0]])
    assert field.at(here + 1.8 * 6.0 * 3.0 * way, np.array([5.0])) == pytest.approx(
        field.at(here, np.array([2.0]))
    )


def test_drag_goes_from_quadratic_to_linear():
    shape = tree()
    leafy = shape.leafy > 0
    slow, twice = drag(shape, np.full(len(leafy), 0.1))[0], drag(shape, np.full(len(leafy), 0.2))[0]
    assert (twice / slow)[leafy] == pytest.approx(np.full(leafy.sum(), 4.0), rel=1e-3)
    bare = shape_with(
        rod(0.1, 0.02, 15.0, 30), np.where(rod(0.1, 0.02, 15.0, 30).start[:, 2] > 6, 1e4, 0.0), WOOD
    )
    fast = [drag(bare, np.full(len(bare.leafy), u))[0][bare.leafy > 0] for u in (200.0, 400.0)]
    assert (fast[1] / fast[0]) == pytest.approx(np.full(len(fast[0]), 2.0), rel=0.01)
    step = 1e-4
    for speed in (1.0, 9.0, 25.0):
        low, high = (drag(shape, np.full(len(leafy), speed + d))[0] for d in (-step, step))
        assert drag(shape, np.full(len(leafy), speed))[1] == pytest.approx(
            (high - low) / (2 * step)
        )


@pytest.mark.slow
def test_modes_have_the_energy_of_a_fine_integration_in_time():
    """Each mode as an oscillator, stepped from rest under the force of a wind that hardly bends the tree."""
    shape = tree(modes=4)
    field = WindField.drawn(Wind(speed=2.0), 15.0, LEAVES, 2)
    place, turn = np.array([4.0, 5.0, 0.0]), 0.7
    answer = response_of(shape, field, place, turn)
    points, modes = shape.at_members()
    cos, sin = np.cos(turn), np.sin(turn)
    rotate = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    world = points @ rotate.T + place
    mean = field.mean(world[:, 2])
    force, slope = drag(shape, mean)
    first = np.einsum("bmi,ji->bmj", modes, rotate)
    along, upright = np.append(field.along, 0.0), np.array([0.0, 0.0, 1.0])
    side = np.array([-along[1], along[0], 0.0])
    omega = 2 * np.pi * answer.frequency
    parts = [(along, slope), (side, force / mean), (upright, force / mean)]
    damper = np.diag(2 * INTERNAL * omega)
    for way, part in parts:
        damper += (first @ way).T @ (part[:, None] * (first @ way))

    step = np.arange(0.0, 90.0, 0.03)
    waves = field.waves(world)
    turning = np.exp(2j * np.pi * step[:, None] * field.frequency)
    gust = np.einsum("bkc,tk->tbc", waves, turning).real
    drag_of = (
        force[:, None] * along
        + slope[:, None] * gust[..., :1] * along
        + (force / mean)[:, None] * (gust[..., 1:2] * side + gust[..., 2:] * upright)
    )
    push = np.einsum("bmj,tbj->tm", first, drag_of)

    def rate(time, state):
        q, v = state[:4], state[4:]
        f = [np.interp(time, step, push[:, m]) for m in range(4)]
        return np.concatenate([v, f - damper @ v - omega**2 * q])

    at = np.arange(50.0, 90.0, 0.1)
    solved = solve_ivp(rate, (0, 90), np.zeros(8), t_eval=at, max_step=0.1, rtol=1e-5)
    energy = (solved.y[4:] ** 2 + (omega[:, None] * solved.y[:4]) ** 2).T / 2
    value, speed = answer.exact(at)
    own = (speed**2 + (omega * value) ** 2) / 2
    assert own[:, :2].mean() == pytest.approx(energy[:, :2].mean(), rel=0.01)
    assert own.mean(axis=0) == pytest.approx(energy.mean(axis=0), rel=0.01)


def test_what_bends_turns_out_of_the_wind():
    """F cos²(arctan θ) against one equation for the amplitude, solved by bisection; and far from what is
    linear."""
    shape, field = tree(modes=1), WindField.drawn(Wind(speed=15.0), 15.0, LEAVES, 2)
    found = response_of(shape, field, np.zeros(3), 0.0)
    points, modes = shape.at_members()
    force = drag(shape, field.mean(points[:, 2]))[0]
    along = modes[:, 0] @ np.append(field.along, 0.0)
    tilt = (shape.tilts[:, 0] ** 2).sum(axis=1)
    shaken = tilt * 0.5 * (np.abs(found.waves[0]) ** 2).sum()
    stiff = (2 * np.pi * found.frequency[0]) ** 2

    def left(q):
        return stiff * q - along @ (force / (1 + tilt * q**2 + shaken))

    linear = float(along @ force) / stiff
    exact = brentq(left, *sorted((0.0, linear)))
    assert found.mean[0] == pytest.approx(exact, rel=2e-3)
    assert abs(exact) < 0.98 * abs(linear)


def test_velocity_is_the_derivative():
    answer = response_of(tree(), WindField.drawn(BREEZE, 15.0, LEAVES, 2), np.zeros(3), 0.0)
    time = np.sort(np.random.default_rng(1).uniform(0, 50, 200))
    low, high = (answer.exact(time + d)[0] for d in (-1e-5, 1e-5))
    assert answer.exact(time)[1] == pytest.approx((high - low) / 2e-5, abs=1e-6)


def test_damping_grows_with_the_wind():
    shape, found = tree(), []
    for speed in (1.0, 5.0, 15.0):
        field = WindField.drawn(Wind(speed=speed), 15.0, LEAVES, 2)
        found.append(response_of(shape, field, np.zeros(3), 0.0).damping[0])
    assert INTERNAL < found[0] < found[1] < found[2]


def test_damping_is_that_of_wood_and_of_the_air_that_a_mode_moves():
    """Over the critical one: 0.02 of wood and roots, and what the drag rises by with the mode's own speed, in
    the wind, across it and upright, as in finite differences of the drag by hand."""
    shape = tree(modes=1)
    field = WindField.drawn(Wind(speed=3.0), 15.0, LEAVES, 2)
    answer = response_of(shape, field, np.zeros(3), 0.0)
    points, modes = shape.at_members()
    speed, way = field.mean(points[:, 2]), np.append(field.along, 0.0)
    step = 1e-4
    faster, slower = (drag(shape, speed + d)[0] for d in (step, -step))
    along = (modes[:, 0] @ way) ** 2
    across = (modes[:, 0] ** 2).sum(axis=1) - along
    lost = along @ ((faster - slower) / (2 * step)) + across @ (drag(shape, speed)[0] / speed)
    assert answer.damping[0] == pytest.approx(
        0.02 + lost / (4 * np.pi * answer.frequency[0]), rel=0.01
    )


def test_a_larger_tree_sways_slower_and_a_turned_one_the_same():
    shape = tree()
    field = WindField.drawn(BREEZE, 15.0, LEAVES, 2)
    one, half = (response_of(shape, field, np.zeros(3), 0.0, s) for s in (1.0, 0.5))
    assert half.frequency == pytest.approx(2 * one.frequency)
    turned = response_of(shape, field, np.zeros(3), 1.0)
    tip = shape.modes.shape[-1, :, :3]
    time = np.linspace(0, 10, 50)
    here, there = (a.exact(time)[0] @ tip for a in (one, turned))
    cos, sin = np.cos(1.0), np.sin(1.0)
    back = there @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    assert back == pytest.approx(here, abs=1e-3 * np.abs(here).max())


def test_a_leaf_is_held_where_its_stalk_is():
    skeleton = rod(0.1, 0.02, 15.0, 30)
    foot, axis = np.array([[0.05, 0.0, 10.0]]), np.array([[1.0, 0.0, 0.0]])
    leaves = Leaves(
        foot + 0.05 * axis,
        np.array([[0.0, 0.0, 1.0]]),
        -axis,
        np.array([0.1]),
        np.array([0.05]),
        np.array([0.03]),
        np.zeros(1, np.int32),
    )
    shape = shape_of(skeleton, leaves, WOOD)
    assert shape.seats.foot == pytest.approx(foot)
    assert shape.seats.direction == pytest.approx(axis)
    held = shape.members_at(np.array([[0.15, 0.0, 10.0], [0.0, 0.08, 10.0]]), np.array([0, -1]))
    assert held[0] == held[1]


@pytest.mark.medium
def test_a_whip_in_a_storm_is_held_where_small_rotations_end_and_says_so():
    """Rotations of wood by the whole sum at 4,000 moments: mean and two deviations within 1.5 radians."""
    skeleton = rod(0.012, 0.002, 6.0, 30)
    shape = shape_with(skeleton, np.where(skeleton.start[:, 2] > 2, 0.5, 0.0), WOOD, 12)
    field = WindField.drawn(Wind(speed=25.0), 6.0, LEAVES, 3)
    whip = response_of(shape, field, np.zeros(3), 0.4, 0.8)
    amplitude, _ = whip.exact(np.linspace(0.0, 1000.0, 4000))
    turns = np.einsum("tm,bmi->tbi", amplitude, shape.ends[1][:, :, 3:]) / 0.8
    most = np.linalg.norm(turns.mean(axis=0), axis=1) + 2 * np.sqrt(turns.var(axis=0).sum(axis=1))
    assert whip.held
    assert 0.75 < most.max() < 1.65
    breeze = WindField.drawn(BREEZE, 15.0, LEAVES, 3)
    assert not response_of(tree(), breeze, np.zeros(3), 0.4).held
