"""Results as pictures: what is drawn stands where its axes say, and the axes are written."""

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.drawing import strips as plots
from forest_addon.results.scanner import cloud_plot
from forest_addon.sensing.lidar import glance
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.ui.results import images

RATE = 100_000.0


def tone(frequency, start, end, seconds=0.1):
    time = np.arange(int(seconds * RATE)) / RATE
    return np.where((time >= start) & (time < end), np.sin(2 * np.pi * frequency * time), 0.0)


def brightest(strip, across):
    """Where the middle of the brightest pixels is, in the values of the axes."""
    light = strip.pixels.sum(axis=2)
    row, column = (where.mean() for where in np.nonzero(light > 0.97 * light.max()))
    high, wide = light.shape
    up = strip.up
    return (
        across.low + (across.high - across.low) * (column + 0.5) / wide,
        up.low + (up.high - up.low) * (row + 0.5) / high,
    )


@pytest.mark.medium
@pytest.mark.parametrize(("frequency", "start", "end"), [(20e3, 0.04, 0.06), (31e3, 0.0, 0.02)])
def test_a_tone_is_drawn_at_its_time_and_frequency(frequency, start, end):
    samples = tone(frequency, start, end)
    samples[-1] = 1e-3  # heard, so that the picture goes to the end
    plot = plots.sound_plot(samples, RATE)
    spectrogram, level = plot.strips
    milliseconds, kilohertz = brightest(spectrogram, plot.across)
    assert milliseconds == pytest.approx(500 * (start + end), abs=1.5)
    assert kilohertz == pytest.approx(frequency / 1e3, abs=1.0)
    drawn = np.flatnonzero((level.pixels == plots.INK).all(axis=2).sum(axis=0) > plots.HIGH / 2)
    edges = plot.across.high * np.array([drawn[0], drawn[-1] + 1]) / plots.WIDE
    assert edges == pytest.approx([1e3 * start, 1e3 * end], abs=0.3)


def test_the_decay_curve_of_an_exponential_is_a_straight_line():
    """60 dB in 50 ms of a signal of 100 ms: of its energy, all but 1e-12 is before the end."""
    time = np.arange(int(0.1 * RATE)) / RATE
    samples = np.random.default_rng(1).normal(size=len(time)) * 10 ** (-3 * time / 0.05)
    plot = plots.sound_plot(samples, RATE, decay=True)
    curve = (plot.strips[1].pixels == plots.CURVE).all(axis=2)
    columns = np.flatnonzero(curve.any(axis=0))
    height = np.array([np.flatnonzero(curve[:, column]).mean() for column in columns])
    level = -plots.DEPTH_DB * (1 - height / (plots.HIGH - 1))
    milliseconds = plot.across.high * columns / plots.WIDE
    straight = milliseconds < 50
    slope = np.polyfit(milliseconds[straight], level[straight], 1)[0]
    assert slope == pytest.approx(-60 / 50, rel=0.03)


@pytest.mark.medium
def test_silence_is_a_picture_too():
    plot = plots.sound_plot(np.zeros(1000), RATE, decay=True)
    assert np.isfinite(plot.strips[0].pixels).all()
    assert np.isfinite(images.show("silence", plot).pixels[:]).all()


class Points(SimpleNamespace):
    """Of a cloud, what a picture needs."""

    def __len__(self):
        return len(self.position)


def test_a_panorama_has_each_return_where_its_beam_looked():
    scanner = spec.Terrestrial(azimuth_deg=(0, 90), elevation_deg=(-10, 20), angle_step_deg=1.0)
    cloud = Points(
        position=np.zeros((3, 3)),
        number=np.ones(3, dtype=np.uint8),
        azimuth=np.deg2rad([0, 45, 90]),
        elevation=np.deg2rad([-10, 5, 20]),
        returns=SimpleNamespace(distance=np.array([2.0, 1.0, 4.0])),
    )
    plot = cloud_plot(scanner, cloud)
    (strip,) = plot.strips
    assert (plot.across.low, plot.across.high, strip.up.low, strip.up.high) == (0, 90, -10, 20)
    azimuth, elevation = brightest(strip, plot.across)
    assert azimuth == pytest.approx(45, abs=0.6)
    assert elevation == pytest.approx(5, abs=0.6)
    sky = strip.pixels[plots.HIGH, 10]
    assert strip.pixels[0, 0].sum() > sky.sum()  # the corners hold the other two returns
    assert strip.pixels[-1, -1].sum() > sky.sum()


def test_from_above_the_highest_point_is_the_brightest():
    grid = np.stack(np.meshgrid(np.arange(50.0), np.arange(20.0)), axis=-1).reshape(-1, 2)
    position = np.column_stack([grid, np.zeros(len(grid))])
    position[(grid == (30, 15)).all(axis=1), 2] = 7.0
    plot = cloud_plot(spec.Airborne(), Points(position=position))
    x, y = brightest(plot.strips[0], plot.across)
    assert (x, y) == pytest.approx((30, 15), abs=1.0)
    high, wide, _ = plot.strips[0].pixels.shape
    assert wide / high == pytest.approx(50 / 20, rel=0.1)


@pytest.mark.parametrize(("east", "north"), [(300.0, 4.0), (4.0, 300.0), (30.0, 30.0)])
def test_numbers_of_a_narrow_picture_have_room(east, north):
    x, y = np.meshgrid(np.linspace(0, east, 200), np.linspace(0, north, 200))
    position = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    plot = cloud_plot(spec.Airborne(), Points(position=position))
    _, labels = images._compose(plot)
    at_left = sorted(y for text, x, y, *_ in labels if x < images.LEFT - images.TICK)
    below = sorted(x for text, x, y, left, under in labels if (left, under) == (0.5, 1.0))
    assert (np.diff(at_left) >= 20).all()
    assert (np.diff(below) >= 40).all()
    assert at_left
    assert below


def test_no_points_no_picture():
    assert cloud_plot(spec.Airborne(), Points(position=np.empty((0, 3)))) is None


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0, 1000, 10, list(range(0, 1001, 100))),
        (-80, 0, 6, [-80, -60, -40, -20, 0]),
        (0.3, 0.9, 6, [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]),
        (-3.7, 46.5, 10, [0, 10, 20, 30, 40]),
        (5, 5, 6, [5]),
    ],
)
def test_ticks_are_round_and_few(low, high, most, expected):
    found = images.ticks(plots.Axis(low, high, ""), most)
    assert found == pytest.approx(expected)


def test_axes_are_written_and_the_strips_are_as_drawn():
    plot = plots.sound_plot(tone(20e3, 0.0, 0.1), RATE)
    image = images.show("with axes", plot)
    wide, high = image.size
    pixels = np.empty(wide * high * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(high, wide, 4)
    below = pixels[: images.BELOW - images.TICK, images.LEFT :, 0]
    assert (below > 0.5).sum() > 200  # ink of the numbers and of "ms"
    lowest = plot.strips[0].pixels
    drawn = pixels[
        images.BELOW : images.BELOW + len(lowest), images.LEFT : images.LEFT + lowest.shape[1]
    ]
    assert np.abs(drawn[..., :3] - lowest).max() < 1 / 254
    assert image.preview.image_size[:] == (images.ICON, images.ICON)
    assert image.packed_file is not None


@pytest.mark.medium
def test_a_picture_of_another_size_is_drawn_into_the_first():
    first = images.show("again", plots.sound_plot(tone(20e3, 0.0, 0.1), RATE))
    flat = cloud_plot(spec.Airborne(), Points(position=np.eye(3)))
    before = len(bpy.data.images)
    again = images.show("again", flat)
    assert again == first  # editors go on showing it
    assert len(bpy.data.images) == before
    pixels = np.empty((again.size[1], again.size[0], 4), dtype=np.float32)
    again.pixels.foreach_get(pixels.ravel())
    drawn = flat.strips[0].pixels
    high, wide, _ = drawn.shape
    part = pixels[images.BELOW : images.BELOW + high, images.LEFT : images.LEFT + wide, :3]
    assert np.abs(part - drawn).max() < 1 / 254


@pytest.mark.medium
def test_an_image_of_the_user_that_has_the_name_stays():
    mine = bpy.data.images.new("mine", 4, 4)
    flat = cloud_plot(spec.Airborne(), Points(position=np.eye(3)))
    shown = images.show("mine", flat)
    assert shown != mine
    assert tuple(mine.size) == (4, 4)
    assert images.show("mine", flat) == shown


@pytest.mark.parametrize("step", [10.0, 7.0, 0.7])
def test_each_beam_of_a_whole_turn_has_its_pixel_and_there_is_no_other(step):
    """The beam at 360 degrees would be that at 0 again; azimuths come back as -180 to 180."""
    scanner = spec.Terrestrial(azimuth_deg=(-90, 270), elevation_deg=(0, 10), angle_step_deg=step)
    pattern = pattern_of(scanner)
    way = pattern.pulses(np.arange(pattern.count)).direction
    cloud = Points(
        number=np.ones(len(way), dtype=np.uint8),
        azimuth=np.arctan2(way[:, 1], way[:, 0]),
        elevation=np.arcsin(way[:, 2]),
        returns=SimpleNamespace(distance=np.arange(len(way), dtype=float)),
    )
    image = glance.range_image(cloud, scanner)
    assert np.array_equal(image.T.ravel(), cloud.returns.distance)  # column by column


def some_plot(name):
    """A picture of a kind, and what its scale must say at its foot and head."""
    rng = np.random.default_rng(3)
    if name == "heights":
        return plots.from_above(
            np.vstack([rng.uniform((0, 0, 2), (9, 3, 7), (500, 3)), [[0, 0, 2], [9, 3, 7]]])
        )
    if name == "levels":
        return plots.sound_plot(tone(20e3, 0.02, 0.06), RATE)
    distance = np.geomspace(1.0, 50.0, 4000).reshape(40, 100)
    return plots.Plot(
        (plots.by_distance("d", distance, plots.Axis(0, 1, "")),), plots.Axis(0, 1, ""), ""
    )


@pytest.mark.parametrize(
    ("name", "ends", "label"),
    [("heights", (2, 7), "m"), ("levels", (-80, 0), "dB"), ("distances", (1.04, 50), "m")],
)
def test_no_picture_leaves_its_colours_without_a_scale(name, ends, label):
    """The bar's colours at its ticks are those that the strip has where its values are so."""
    plot = some_plot(name)
    strip = next(strip for strip in plot.strips if strip.values is not None)
    assert (strip.values.low, strip.values.high) == pytest.approx(ends, rel=0.01)
    assert strip.values.label == label
    canvas, labels = images._compose(plot)
    texts = [text for text, *_ in labels]
    right = images.LEFT + strip.pixels.shape[1]
    at = [(x, float(t)) for t, x, *_ in labels if x > right + images.BAR and t != label]
    assert label in texts
    assert len(at) > 2
    assert all(ends[0] <= value <= ends[1] for _, value in at)
    assert max(x for x, _ in at) + 60 < canvas.shape[1]  # room for the numbers
    bar = canvas[:, right + images.RIGHT // 2 + images.BAR // 2]
    bar = bar[np.ptp(bar, axis=1) > 0.05]
    assert len(bar) > 0.9 * len(strip.pixels)
    near, far = strip.colours[0], strip.colours[-1]
    assert np.allclose(bar[0], near, atol=0.1)
    assert np.allclose(bar[-1], far, atol=0.02)


def test_distances_on_the_bar_are_those_of_the_picture():
    plot = some_plot("distances")
    (strip,) = plot.strips
    high, _, _ = strip.pixels.shape
    rows = np.arange(high) * 40 // high
    for value, place in images._places(strip.values, 200, 6, 30):
        share = np.log(value / strip.values.low) / np.log(strip.values.high / strip.values.low)
        assert place / 199 == pytest.approx(share, abs=0.01)
        row = np.searchsorted(np.geomspace(1, 50, 4000)[::100], value) - 1
        seen = strip.pixels[np.flatnonzero(rows == row)[0]].mean(axis=0)
        place = share * (len(strip.colours) - 1)
        bar = [np.interp(place, range(len(strip.colours)), channel) for channel in strip.colours.T]
        assert np.allclose(seen, bar, atol=0.08)


@pytest.mark.parametrize("shape", [(300, 1100), (900, 300), (256, 256)])
def test_a_thumbnail_is_not_stretched(shape):
    """A disc stays round."""
    rows, columns = np.indices(shape) - (np.array(shape)[:, None, None] - 1) / 2
    disc = np.hypot(rows, columns) < min(shape) / 2.5
    strip = plots.Strip(
        "", np.repeat(disc[..., None], 3, axis=2).astype(float), plots.Axis(0, 1, "")
    )
    small = images._small(plots.Plot((strip,), plots.Axis(0, 1, ""), ""))
    assert small.shape == (images.ICON, images.ICON, 3)
    light = small[..., 0] > 0.5
    high, wide = (np.flatnonzero(light.any(axis=axis)) for axis in (1, 0))
    assert len(high) == pytest.approx(len(wide), abs=2)
    assert light.sum() == pytest.approx(np.pi / 4 * len(high) ** 2, rel=0.05)
