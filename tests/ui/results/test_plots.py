"""Results as pictures: what is drawn stands where its axes say, and the axes are written."""

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import link, values
from ui.pressing import add_cube, run

from forest_addon import spec
from forest_addon.blender.scene.layout import (
    CLOUD_KEY,
    COLOUR_BY,
    COLOUR_MAP,
    FAR_POINTS,
    RADIUS,
    SHARE,
)
from forest_addon.blender.scene.nodes import (
    choose_input,
    chosen_input,
    set_input,
)
from forest_addon.blender.show.cloud_nodes import QUIET, SIZES, on_map
from forest_addon.drawing import strips as plots
from forest_addon.results.scanner import cloud_plot
from forest_addon.sensing.lidar import glance
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.stand.plan import PLANTS
from forest_addon.ui.overlay import GAMMA, seen_points
from forest_addon.ui.results import images, panel
from forest_addon.ui.results.panel import SIDE, pixels_of

from ..test_panels import drawn

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


def seen_in(image):
    """(H, W, 4) pixels, the lowest row first."""
    wide, high = image.size
    pixels = np.empty((high, wide, 4), dtype=np.float32)
    image.pixels.foreach_get(pixels.ravel())
    return pixels


def assert_drawn(plot, image):
    """The lowest strip is there pixel by pixel."""
    lowest = plot.strips[0].pixels
    high, wide, _ = lowest.shape
    drawn = seen_in(image)[images.BELOW : images.BELOW + high, images.LEFT : images.LEFT + wide]
    assert np.abs(drawn[..., :3] - lowest).max() < 1 / 254


def test_axes_are_written_and_the_strips_are_as_drawn():
    plot = plots.sound_plot(tone(20e3, 0.0, 0.1), RATE)
    image = images.show("with axes", plot)
    below = seen_in(image)[: images.BELOW - images.TICK, images.LEFT :, 0]
    assert (below > 0.5).sum() > 200  # ink of the numbers and of "ms"
    assert_drawn(plot, image)
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
    assert_drawn(flat, again)


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


# -------------------------------------------------------------------------------------------- legend
# Clouds say what their colours mean, start with what there is, and are seen in renders.


def points_of(props, name):
    return bpy.data.objects[props.results[name].shown]


def colours(obj):
    """Of the points as they are drawn, linear."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return seen_points(evaluated)[1][:, :3] ** (1 / GAMMA)


@pytest.mark.medium
@pytest.mark.parametrize("choice", ["Organ", "Species", "Object"])
def test_each_name_stands_beside_the_colour_of_its_points(ran, choice):
    obj, result = points_of(ran, "cloud"), ran.results["cloud"]
    result.opened = True
    choose_input(obj.modifiers[0], COLOUR_BY, choice)
    assert chosen_input(obj.modifiers[0], COLOUR_BY) == choice
    seen = colours(obj)
    entries = [entry for entry in result.legend if entry.choice == choice]
    assert entries
    for entry in entries:
        assert np.abs(seen - np.array(entry.colour)).max(axis=1).min() < 2e-3
    names = {entry.name for entry in entries}
    if choice == "Organ":
        organs = set(values(obj.data, "organ"))
        assert names == {("other", "wood", "leaf", "ground")[n] for n in organs}
    elif choice == "Species":
        assert names == {"hazelnut"}
    else:
        assert names <= {each.name for each in bpy.data.objects}
    assert names <= set(drawn())


@pytest.mark.slow
@pytest.mark.parametrize("instancing", ["objects", "points"])
def test_undergrowth_is_named_as_well(small, instancing):
    small.forest.undergrowth, small.forest.instancing = "sparse", instancing
    assert bpy.ops.forest.build() == {"FINISHED"}
    run("cloud")
    named = {e.name: e.colour for e in small.results["cloud"].legend if e.choice == "Species"}
    met = set(values(points_of(small, "cloud").data, "species")) - {-1}
    assert len(named) == len(met) > 2  # each species that was met has a name
    assert {"hazelnut"} < set(named) <= {"hazelnut", *PLANTS}


@pytest.mark.medium
def test_a_measure_has_its_smallest_and_largest_value(ran):
    found = [e.name for e in ran.results["cloud"].legend if e.choice == "Distance"]
    distance = values(points_of(ran, "cloud").data, "distance")
    said = [float(words.removesuffix(" m").replace(",", "")) for words in (found[0], found[-1])]
    step = float(np.ptp(distance)) / (len(found) - 1)
    np.testing.assert_allclose(said, [distance.min(), distance.max()], atol=step / 10)


@pytest.mark.medium
def test_a_foreign_scene_starts_with_objects(props, sensor):
    add_cube()
    sensor("terrestrial", name="cloud", position=(3, 0.5, 0.5), angle_step_deg=2)
    run("cloud")
    (modifier,) = points_of(props, "cloud").modifiers
    assert chosen_input(modifier, COLOUR_BY) == "Object"
    assert [e.name for e in props.results["cloud"].legend if e.choice == "Object"] == ["cube"]
    choose_input(modifier, COLOUR_BY, "Distance")
    run("cloud")
    assert chosen_input(modifier, COLOUR_BY) == "Distance"  # what the user chose stays


@pytest.mark.medium
def test_an_echo_offers_what_it_has(ran):
    obj = points_of(ran, "echo")
    (modifier,) = obj.modifiers
    assert chosen_input(modifier, COLOUR_BY) == "Loudness"
    by_loudness = colours(obj)
    level = values(obj.data, "level")
    assert by_loudness[np.argmax(level), 0] > by_loudness[np.argmin(level), 0]
    choose_input(modifier, COLOUR_BY, "Delay")
    assert np.abs(colours(obj) - by_loudness).max() > 0.1
    menu = next(n for n in modifier.node_group.nodes if n.type == "MENU_SWITCH")
    offered = [item.name for item in menu.enum_items]
    assert offered == ["Loudness", "Tree", "Delay", "Distance", "Height"]
    assert {entry.choice for entry in ran.results["echo"].legend} <= set(offered)


def test_a_swatch_is_the_colour_of_the_screen():
    pixels = pixels_of((0.5, 0.0, 1.0))
    assert pixels[SIDE // 2, SIDE // 2] == pytest.approx([0.5**GAMMA, 0.0, 1.0, 1.0])
    assert pixels[0, 0, 3] == 0


@pytest.mark.parametrize("grey", [0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0])
@pytest.mark.parametrize(
    "panel", [0.16, 0.19, 0.45, 0.6, 0.7, 0.8]
)  # of themes, as the screen has it
def test_a_swatch_is_seen_on_any_theme(grey, panel):
    """Its rim or its middle is apart from the panel, and the rim from the middle."""
    shown = pixels_of((grey,) * 3)[SIDE // 2, :, :]
    filled = shown[shown[:, 3] == 1][:, 0]
    assert abs(filled - panel).max() > 0.24
    assert np.ptp(filled) > 0.35


@pytest.mark.slow
def test_cycles_renders_points_where_that_is_asked_for(props, sensor, tmp_path):
    """EEVEE needs a graphics card: the session in the window renders there."""
    cube = add_cube()
    sensor("terrestrial", name="cloud", position=(3, 0.5, 0.5), angle_step_deg=1)
    run("cloud")
    cube.hide_render = True
    scene, obj = bpy.context.scene, points_of(props, "cloud")
    set_input(obj.modifiers[0], "Radius", 0.05)
    eye = link("eye", bpy.data.cameras.new("eye"))
    eye.location, eye.rotation_euler = (4, 0.5, 0.5), (np.pi / 2, 0, np.pi / 2)
    scene.camera, scene.render.engine = eye, "CYCLES"
    scene.cycles.samples, scene.render.film_transparent = 1, True
    scene.render.resolution_x = scene.render.resolution_y = 32
    covered = []
    for hidden in (True, False):
        obj.hide_render = hidden
        scene.render.filepath = str(tmp_path / f"{hidden}.png")
        bpy.ops.render.render(write_still=True)
        picture = bpy.data.images.load(scene.render.filepath)
        covered.append(float(np.array(picture.pixels[:])[3::4].mean()))
    assert covered[0] == 0
    assert covered[1] > 0.1


@pytest.mark.medium
def test_the_legend_follows_the_scale_of_colours(ran):
    obj = points_of(ran, "cloud")
    (modifier,) = obj.modifiers
    choose_input(modifier, COLOUR_BY, "Distance")
    choose_input(modifier, COLOUR_MAP, "Heat")
    ran.results["cloud"].opened = True
    assert {COLOUR_MAP, SHARE} <= set(drawn())
    distance = values(obj.data, "distance")
    seen = colours(obj)
    for end, share in ((np.argmin(distance), 0.0), (np.argmax(distance), 1.0)):
        assert seen[end] == pytest.approx(on_map("Heat", share), abs=2e-3)
    shown = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(panel, "_icon", lambda colour: shown.append(colour) or 0)
        drawn()
    assert [c for c in shown if c == tuple(on_map("Heat", 1.0))]
    choose_input(modifier, COLOUR_BY, "Organ")
    assert COLOUR_MAP not in drawn()


def test_a_scale_says_numbers_as_one_writes_them():
    from forest_addon.blender.show import cloud

    def said(low, high):
        return [entry.name for entry in cloud._scaled("Height", np.array([low, high]), "m")]

    assert said(-4.44e-16, 11.7) == ["0.0 m", "3.9 m", "7.8 m", "11.7 m"]
    assert said(0.0, 90_000.0) == ["0 m", "30,000 m", "60,000 m", "90,000 m"]
    assert said(1.0, 1.006) == ["1.0000 m", "1.0020 m", "1.0040 m", "1.0060 m"]


def test_things_that_are_called_alike_stand_once_in_a_legend():
    from forest_addon.blender.show import cloud

    numbers = np.repeat([0, 1, 2, 3], [5, 9, 7, 1])
    entries = cloud._named("Object", numbers, ("Ground", "rock", "rock", "rock"), cloud._of_number)
    assert [entry.name for entry in entries] == ["rock", "Ground"]
    assert entries[0].colour == cloud._of_number(1)


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [(2e-14, "m", "< 0.001 mm"), (0.0123, "m", "12.300 mm"), (3e-9, "of all", "< 0.0001 %"),
     (6.7e-05, "", "0.0067 %"), (float("inf"), "m", "inf m")],
)  # fmt: skip
def test_an_audit_says_errors_as_one_does(value, unit, words):
    from forest_addon.ui.results.finding import plain

    assert plain(value, unit) == words


@pytest.mark.medium
def test_what_renders_do_not_show_and_sensors_meet_is_said(built):
    from forest_addon.ui.sensors.run import names_unrendered

    layer = bpy.context.view_layer
    assert names_unrendered(layer) == ""
    cube = add_cube()
    cube.hide_render = True
    run("cloud")
    assert names_unrendered(layer) == "Hidden in renders, and sensed all the same: cube"
    cube.forest_seen = False
    assert names_unrendered(layer) == ""


# -------------------------------------------------------------------------------------------- points
# What the view draws of a cloud: every point, in the colours that its menu gives.


@pytest.fixture
def cloud(ran):
    return points_of(ran, "cloud")


def points_drawn(cloud):
    return seen_points(cloud.evaluated_get(bpy.context.evaluated_depsgraph_get()))[:2]


@pytest.mark.medium
def test_points_without_their_modifier_are_not_drawn(cloud):
    cloud.modifiers.clear()
    position, colour = points_drawn(cloud)
    assert (len(position), len(colour)) == (0, 0)


@pytest.mark.slow
def test_loud_points_are_larger_and_those_of_a_scan_alike(cloud):
    echo = points_of(bpy.context.scene.forest_sensing, "echo")
    set_input(echo.modifiers[0], RADIUS, 0.04)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    expected = np.interp(values(echo.data, "level"), (QUIET, 0.0), SIZES)
    np.testing.assert_allclose(seen_points(echo.evaluated_get(depsgraph))[2], expected, rtol=1e-4)
    assert np.ptp(expected) > 0.5
    np.testing.assert_allclose(seen_points(cloud.evaluated_get(depsgraph))[2], 1.0)


@pytest.mark.medium
def test_points_beyond_the_ground_that_views_show_are_counted_and_left_out(small):
    small.forest.margin = 400.0  # a horizon, of which views show 1.5 m around the field
    bpy.ops.forest.build()
    bpy.ops.forest.run(sensor="cloud")
    cloud = next(obj for obj in bpy.data.objects if CLOUD_KEY in obj)
    flat = values(cloud.data, "position")[:, :2]
    near = ((flat >= -1.5) & (flat <= 7.5)).all(axis=1)
    assert 0 < np.count_nonzero(near) < len(near)
    assert len(points_drawn(cloud)[0]) == np.count_nonzero(near)
    told = small.results["cloud"].figures["Far Points"].value
    assert told == f"{np.count_nonzero(~near):,} not shown"
    set_input(cloud.modifiers[0], FAR_POINTS, True)
    bpy.context.view_layer.update()
    assert len(points_drawn(cloud)[0]) == len(near)


@pytest.mark.medium
def test_one_result_is_shown_at_a_time_unless_more_are_asked_for(cloud):
    def seen():
        return {t[CLOUD_KEY] for t in bpy.data.objects if CLOUD_KEY in t and t.visible_get()}

    bpy.ops.forest.run(sensor="cloud")
    assert seen() == {"cloud"}
    bpy.ops.forest.run(sensor="echo")
    assert seen() == {"echo"}
    bpy.ops.forest.show_result(result="cloud", more=True)
    assert seen() == {"cloud", "echo"}
    bpy.ops.forest.show_result(result="echo")  # it is shown: hidden
    assert seen() == {"cloud"}
    bpy.ops.forest.show_result(result="echo")
    assert seen() == {"echo"}
