"""Clouds as Blender objects: every attribute is there, and any of them colours the points."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.io import wavfile

bpy = pytest.importorskip("bpy")

from references.rays import BruteCaster, ground, scene_with, wall
from references.scenes import add_collection, add_mesh, reopened, values

from forest_addon import spec
from forest_addon.base.rng import stream
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.scene import materials
from forest_addon.blender.scene.instances import IGNORED_KEY
from forest_addon.blender.scene.layout import COLOUR_BY, COLOUR_MAP, SHARE
from forest_addon.blender.scene.materials import LOOK_KEY, TEXTURES
from forest_addon.blender.scene.nodes import choose_input, chosen_input, drawn_inputs, set_input
from forest_addon.blender.sensors.observe import Observer
from forest_addon.blender.show import shaded
from forest_addon.blender.show.cloud import show_cloud
from forest_addon.blender.show.cloud_nodes import (
    HIGHEST,
    LOWEST,
    MAPS,
    MATERIAL,
    MEASURES,
    NUMBERS,
    on_map,
)
from forest_addon.blender.show.preview import (
    AHEAD,
    CLEAR,
    EYE,
    HALF_VIEW,
    HORIZON,
    NAME,
    RINGS,
    SHOTS,
    SUN,
    _hang,
    grow_around,
    lay_horizon,
    set_stage,
    stand_walker,
    walkers_view,
)
from forest_addon.blender.show.sound import add_speaker, give_sound
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import Wanted
from forest_addon.growth.tree import grow, without_leaves
from forest_addon.sensing.lidar.scan import scan
from forest_addon.spec import Beam, Grammar, Look, Rays, SpecError, Species, Terrestrial


@pytest.fixture
def cloud():
    scanner = Terrestrial(
        azimuth_deg=(-50.0, 50.0),
        elevation_deg=(-40.0, 20.0),
        angle_step_deg=5.0,
        beam=Beam(subrays=7, divergence_mrad=(30.0, 30.0), max_returns=4),
    )
    return scan(scanner, BruteCaster(scene_with(ground(), wall(9.0, half=3.0))))


def shown(obj):
    """Colours of the evaluated points."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    geometry = obj.evaluated_get(depsgraph).evaluated_geometry()  # owns the points
    return values(geometry.pointcloud, "colour")


def test_every_value_of_a_return_is_an_attribute(empty_blender, cloud):
    mesh = show_cloud(bpy.context.scene.collection, "a", cloud).data
    assert values(mesh, "position") == pytest.approx(cloud.position, rel=1e-6, abs=1e-6)
    assert values(mesh, "surface_normal") == pytest.approx(cloud.returns.normal)
    assert (values(mesh, "return_number") == cloud.number).all()
    assert (values(mesh, "number_of_returns") == cloud.count).all()
    assert (values(mesh, "tree") == cloud.returns.tree).all()
    assert (values(mesh, "object") == cloud.returns.instance).all()
    assert (values(mesh, "pulse") == cloud.pulse).all()
    assert values(mesh, "true_range") == pytest.approx(cloud.true_range, rel=1e-6)
    assert values(mesh, "intensity") == pytest.approx(cloud.intensity, rel=1e-6)
    assert np.cos(values(mesh, "incidence")) == pytest.approx(cloud.returns.cos_incidence, abs=1e-6)


@pytest.mark.medium
@pytest.mark.parametrize("choice", ["organ", *NUMBERS, *MEASURES])
def test_any_attribute_colours_the_points(empty_blender, cloud, choice):
    obj = show_cloud(bpy.context.scene.collection, "a", cloud)
    (modifier,) = obj.modifiers
    assert all(link.is_valid for link in modifier.node_group.links)
    assert chosen_input(modifier, COLOUR_BY) == "Organ"
    choose_input(modifier, COLOUR_BY, choice.replace("_", " ").title())
    colour = shown(obj)
    assert len(colour) == len(cloud)
    assert np.isfinite(colour).all()
    seen = {
        "organ": cloud.returns.organ,
        "object": cloud.returns.instance,
        "return_number": cloud.number,
        "height": cloud.position[:, 2].round(3),
        "distance": cloud.true_range.round(3),
    }.get(choice)
    if seen is not None:  # as many colours as values, up to rounding of the scale
        kinds = len(np.unique(colour.round(4), axis=0))
        assert (kinds > 1) == (len(np.unique(seen)) > 1)


def test_the_scale_runs_from_the_smallest_to_the_largest(empty_blender, cloud):
    group = show_cloud(bpy.context.scene.collection, "a", cloud).modifiers[0].node_group
    menu = next(item for item in group.interface.items_tree if item.name == "Colour By")
    menu.default_value = "Distance"
    colour = shown(show_cloud(bpy.context.scene.collection, "b", cloud))  # takes the menu's default
    assert colour[np.argmin(cloud.true_range), :3] == pytest.approx([0.09, 0.0, 0.16], abs=1e-3)
    assert colour[np.argmax(cloud.true_range), :3] == pytest.approx([0.98, 0.80, 0.02], abs=1e-3)


def test_a_user_finds_named_inputs(empty_blender, cloud):
    (modifier,) = show_cloud(bpy.context.scene.collection, "a", cloud).modifiers
    group = modifier.node_group
    assert group.name == "Forest Sensing Points"
    sockets = [i for i in group.interface.items_tree if i.in_out == "INPUT"]
    assert [socket.name for socket in sockets] == [
        *("Geometry", "Radius", "Colour By", "Colour Map", "Show Share"),
        *("Lowest", "Highest", "Shown From", "Shown To", "Far Points", "Material"),
    ]
    assert all(socket.description for socket in sockets)
    shown = [n for n in group.nodes if n.type not in ("GROUP_INPUT", "GROUP_OUTPUT")]
    assert all(node.label for node in shown)
    places = [tuple(node.location) for node in group.nodes]
    assert len(set(places)) == len(places)


@pytest.mark.medium
@pytest.mark.parametrize("name", MAPS)
def test_each_scale_of_colours_is_that_of_the_legend(empty_blender, cloud, name):
    obj = show_cloud(bpy.context.scene.collection, "a", cloud)
    (modifier,) = obj.modifiers
    choose_input(modifier, COLOUR_BY, "Distance")
    choose_input(modifier, COLOUR_MAP, name)
    share = (cloud.true_range - cloud.true_range.min()) / np.ptp(cloud.true_range)
    expected = np.array([on_map(name, part) for part in share])
    assert np.abs(shown(obj)[:, :3] - expected).max() < 6e-3  # ramps are tables of 257 entries


def test_fewer_points_are_shown_in_the_colours_they_had(empty_blender, cloud):
    """A share and a range of heights hide points; those that stay, and their colours, are the same."""
    obj = show_cloud(bpy.context.scene.collection, "a", cloud)
    (modifier,) = obj.modifiers
    choose_input(modifier, COLOUR_BY, "Distance")
    every = shown(obj)
    set_input(modifier, SHARE, 0.4)
    some = shown(obj)
    off = 4.5 * np.sqrt(0.24 * len(every))  # standard deviations of a binomial
    assert abs(len(some) - 0.4 * len(every)) < off
    assert {row.tobytes() for row in some} <= {row.tobytes() for row in every}
    assert (shown(show_cloud(bpy.context.scene.collection, "a", cloud)) == some).all()
    set_input(modifier, SHARE, 0.0)
    assert len(shown(obj)) == 0
    set_input(modifier, SHARE, 1.0)
    low, high = np.quantile(cloud.position[:, 2], (0.3, 0.8)) + 1e-4
    set_input(modifier, LOWEST, float(low))
    set_input(modifier, HIGHEST, float(high))
    within = (cloud.position[:, 2] >= low) & (cloud.position[:, 2] <= high)
    assert 0 < np.count_nonzero(within) < len(cloud)
    assert (shown(obj) == every[within]).all()
    assert len(obj.data.vertices) == len(cloud)  # nothing is lost


def test_the_material_shows_that_colour(empty_blender, cloud):
    obj = show_cloud(bpy.context.scene.collection, "a", cloud)
    nodes = bpy.data.materials[MATERIAL].node_tree.nodes
    assert [n.attribute_name for n in nodes if n.type == "ATTRIBUTE"] == ["colour"]
    assert obj.data.materials[0].name == MATERIAL


def test_new_points_come_into_the_object_that_is_there(empty_blender, cloud):
    """Whatever the user has done to it stays: menu, radius, modifiers, material, collection, references."""
    home = bpy.context.scene.collection
    obj = show_cloud(home, "a", cloud)
    modifier, plain = obj.modifiers["Points"], shown(obj)
    holder, key = drawn_inputs(modifier)[COLOUR_BY]
    by_tree = modifier[key[2:-2]] + 1 if holder is modifier else "Tree"
    set_input(modifier, COLOUR_BY, by_tree)
    set_input(modifier, "Radius", 0.07)
    was = shown(obj)
    assert (was != plain).any()
    obj.modifiers.new("mine", "DISPLACE")
    mine = bpy.data.materials.new("mine")
    obj.data.materials[0] = mine
    obj.location.x, obj.hide_render = 3.0, False
    follower = bpy.data.objects.new("follower", obj.data)  # shares the points
    follower.constraints.new("COPY_LOCATION").target = obj
    home.objects.link(follower)
    own = add_collection("mine", home)
    own.objects.link(obj)
    home.objects.unlink(obj)

    assert show_cloud(home, "a", cloud) == obj
    assert len(obj.data.vertices) == len(cloud)
    assert [m.name for m in obj.modifiers] == ["Points", "mine"]
    assert (obj.location.x, obj.hide_render) == (3.0, False)
    assert list(obj.data.materials) == [mine]
    assert follower.data == obj.data
    assert follower.constraints[0].target == obj
    assert list(obj.users_collection) == [own]
    obj.modifiers.remove(obj.modifiers["mine"])
    assert (shown(obj) == was).all()
    assert len(bpy.data.meshes) == 1


def test_a_copy_and_one_that_was_renamed_are_the_users(empty_blender, cloud):
    home = bpy.context.scene.collection
    obj = show_cloud(home, "a", cloud)
    copy = obj.copy()
    home.objects.link(copy)
    obj.name = "kept for the paper"
    assert show_cloud(home, "a", cloud) not in (obj, copy)
    assert {obj, copy} < set(home.objects)


# -------------------------------------------------------------------------------------------- shaded
# The picture that is drawn by rays: what it must show of a scene that can be worked out by hand.

WIDE, TALL = 160, 80
MIDDLE, REACH = np.array([0.0, 0.0]), 20.0


@pytest.fixture
def shaded_wall(empty_blender):
    """A red wall of 4 m by 4 m that faces the camera, on nothing; the sun stands behind the camera."""
    scene = bpy.context.scene
    set_stage(scene, (WIDE, TALL))
    obj = add_mesh("wall", [(-2, 0, 0), (2, 0, 0), (2, 0, 4), (-2, 0, 4)], (0, 1, 2, 3))
    paint = bpy.data.materials.new("red")
    paint.diffuse_color = (0.5, 0.02, 0.02, 1.0)
    obj.data.materials.append(paint)
    camera, sun = scene.camera, scene.objects[SUN]
    camera.location, camera.rotation_euler = (0, -10, 2), (np.pi / 2, 0, 0)
    sun.rotation_euler = (np.pi / 4, 0, 0)  # 45 degrees high, in the south
    bpy.context.view_layer.update()
    return scene


def drawn(scene, path, **eye):
    """The picture, its camera moved at the last moment, as a run moves it to where a walker stands."""
    caster = Observer(bpy.context.evaluated_depsgraph_get(), Rays()).caster
    for name, value in eye.items():
        setattr(scene.camera, name, value)
    shaded.draw_scene(scene, caster, path, MIDDLE, REACH, 0.0, lambda done, total: None)
    return np.asarray(Image.open(path), dtype=float)


def test_things_are_where_the_camera_sees_them_and_as_bright_as_the_sun_makes_them(
    shaded_wall, tmp_path
):
    picture = drawn(shaded_wall, tmp_path / "p.png")
    assert picture.shape == (TALL, WIDE, 3)
    camera = shaded_wall.camera.data
    half = (
        2 / 10 * camera.lens / camera.sensor_width * WIDE
    )  # pixels from the middle to the wall's edge
    red = (picture[..., 0] > 1.5 * picture[..., 1]) & (picture[..., 0] > 1.5 * picture[..., 2])
    columns, rows = np.flatnonzero(red.any(axis=0)), np.flatnonzero(red.any(axis=1))
    assert columns.min() == pytest.approx(WIDE / 2 - half, abs=1.5)
    assert columns.max() + 1 == pytest.approx(WIDE / 2 + half, abs=1.5)
    assert rows.min() == pytest.approx(TALL / 2 - half, abs=1.5)
    sky = picture[2, 5]
    assert sky[2] > sky[0]
    lit = picture[TALL // 2, WIDE // 2]
    shaded_wall.objects[SUN].rotation_euler = (
        -np.pi / 4,
        0,
        0,
    )  # from behind: only the sky's light is left
    assert lit[0] > 1.5 * drawn(shaded_wall, tmp_path / "q.png")[TALL // 2, WIDE // 2, 0]


def test_what_stands_in_the_sun_casts_a_shadow_on_the_plain(shaded_wall, tmp_path):
    eye = {"location": (12, 6, 12), "rotation_euler": (np.radians(45), 0, np.pi / 2)}
    bright = drawn(shaded_wall, tmp_path / "p.png", **eye).mean(axis=2)
    shaded_wall.objects["wall"].location.z = -50.0
    bare = drawn(shaded_wall, tmp_path / "q.png", **eye).mean(axis=2)
    darker = bright < 0.75 * bare
    assert 20 < darker.sum() < 0.5 * darker.size


def test_a_picture_is_from_where_the_camera_was_moved_last_and_the_same_again(
    shaded_wall, tmp_path
):
    eye = {"location": (6, -8, 3)}
    before, first, again = (
        drawn(shaded_wall, tmp_path / name, **at)
        for name, at in (("a.png", {}), ("b.png", eye), ("c.png", {}))
    )
    assert (first == again).all()
    assert (first != before).any()


# ------------------------------------------------------------------------------------------- closeup
# Pictures from near: a walker stands clear of stems and sees many; close-ups look at what they name.


def stems(count=80, size=30.0):
    return stream(5, "stems").uniform(0, size, (count, 2))


def test_a_walker_stands_clear_of_stems_and_sees_many():
    trees = stems()
    tall = np.full(len(trees), 15.0)
    place, turn = walkers_view(trees, tall, np.array([15.0, 15.0]), 15.0)
    offset = trees - place
    far = np.hypot(*offset.T)
    assert far.min() >= CLEAR
    aside = (np.arctan2(offset[:, 1], offset[:, 0]) - turn + np.pi) % (2 * np.pi) - np.pi
    seen = (np.abs(aside) < HALF_VIEW) & (far < AHEAD)
    assert seen.sum() > 0.3 * len(trees)
    again = walkers_view(trees, tall, np.array([15.0, 15.0]), 15.0)
    assert again[0].tolist() == place.tolist()


def test_a_walker_without_trees_looks_into_the_field():
    place, turn = walkers_view(np.empty((0, 2)), np.empty(0), np.array([5.0, 5.0]), 5.0)
    assert place.tolist() == [5.0, 0.0]
    assert turn == pytest.approx(np.pi / 2)


@pytest.mark.slow
def test_undergrowth_of_a_picture_is_no_part_of_the_scene(empty_blender):
    scene = bpy.context.scene
    set_stage(scene, (64, 32))
    trees = stems()
    sloped = lambda points: 0.1 * points[:, 0]  # noqa: E731
    tall, middle = np.full(len(trees), 9.0), np.array([15.0, 15.0])
    grow_around(scene, *stand_walker(scene, trees, tall, middle, 15.0, sloped), sloped)
    plants = list(bpy.data.collections[NAME].objects)
    assert len(plants) > 100
    assert all(plant[IGNORED_KEY] and plant.hide_viewport for plant in plants)
    assert len({plant.data.name for plant in plants}) < 20  # patches are shared
    for plant in plants:
        assert plant.location.z == pytest.approx(0.1 * plant.location.x, abs=0.02)
    camera = scene.camera.location
    assert camera.z == pytest.approx(0.1 * camera.x + EYE, abs=1e-3)


@pytest.fixture(scope="module")
def birch():
    species, kind = load_species(find_species("silver-birch", Path()))
    return species, grow(species, kind, stream(2, "close"), Wanted(0.2, 14.0, 4.0, 4.0, 20.0))


def test_bark_is_seen_from_a_metre(birch):
    view = SHOTS["bark"](*birch)
    assert np.hypot(*view.eye[:2]) == pytest.approx(1.1, abs=0.15)
    assert np.linalg.norm(view.eye - view.target) == pytest.approx(1.0, abs=0.01)


def test_a_twig_stands_between_the_eye_and_the_sun(birch):
    species, tree = birch
    view = SHOTS["twig"](species, tree)
    ahead = view.target - view.eye
    assert ahead @ view.sun > 0.5 * np.linalg.norm(ahead)
    near = np.linalg.norm(tree.leaves.centre - view.target, axis=1) < 0.3
    assert near.sum() >= 3


def test_a_fork_is_where_a_limb_leaves_the_stem(birch):
    species, tree = birch
    view = SHOTS["fork"](species, tree)
    wood = tree.skeleton
    heads = (wood.order == 1) & (wood.order[np.maximum(wood.parent, 0)] == 0)
    assert np.linalg.norm(wood.start[heads] - view.target, axis=1).min() < 0.5


def test_a_bare_tree_has_no_twig_against_the_light(birch):
    species, tree = birch
    with pytest.raises(SpecError, match="bears no leaves"):
        SHOTS["twig"](species, without_leaves(tree))


# --------------------------------------------------------------------------------------------- sheet
# The contact sheet shows leaves in the colour that their season gives them.


@pytest.mark.medium
@pytest.mark.parametrize("autumn", [0.0, 0.5, 1.0])
def test_leaves_turn(empty_blender, autumn):
    look = Look(leaf=(0.1, 0.2, 0.0), autumn=autumn, autumn_leaf=(0.5, 0.3, 0.1))
    plain = Species(name="plain", grammar=Grammar(generations=2), look=look)
    tree = grow(plain, None, stream(1, "sheet"))
    _hang(bpy.context.scene, plain, tree, 0.0, 0.0, 1.0)
    leaf = bpy.context.scene.objects["plain"].data.materials[1]
    expected = (0.1 + 0.4 * autumn, 0.2 + 0.1 * autumn, 0.1 * autumn)
    assert tuple(leaf[LOOK_KEY]) == pytest.approx(expected)


# --------------------------------------------------------------------------------------------- sound
# What is heard becomes a packed Sound on a Speaker, and survives saving.


def test_a_speaker_plays_what_is_packed(empty_blender, tmp_path):
    samples = np.random.default_rng(0).standard_normal((480, 2)) * 3
    speaker = add_speaker("reverb", (1, 2, 3))
    sound = give_sound(speaker, "reverb", samples, 48_000)
    (track,) = speaker.animation_data.nla_tracks
    assert [strip.type for strip in track.strips] == ["SOUND"]
    assert (speaker.data.sound, sound.name, tuple(speaker.location)) == (sound, "reverb", (1, 2, 3))

    reopened(tmp_path / "heard.blend")
    packed = bpy.data.objects["reverb"].data.sound.packed_file.data
    (tmp_path / "heard.wav").write_bytes(packed)
    rate, heard = wavfile.read(tmp_path / "heard.wav")
    assert rate == 48_000
    assert np.abs(heard).max() == pytest.approx(10 ** (-1 / 20), rel=1e-6)
    expected = samples / np.abs(samples).max() * np.abs(heard).max()
    np.testing.assert_allclose(heard, expected, atol=1e-6)


def test_a_second_run_replaces_the_sound(empty_blender):
    speaker = add_speaker("reverb", (0, 0, 1))
    for level in (1.0, 0.5):
        give_sound(speaker, "reverb", np.full(100, level), 8000)
    assert [sound.name for sound in bpy.data.sounds] == ["reverb"]


# ------------------------------------------------------------------------------------------- horizon
# Hills beyond a forest are seen in pictures, and by no sensor.


def hills():
    return [obj for obj in bpy.context.scene.objects if obj.name.startswith(HORIZON)]


def test_hills_are_rendered_and_met_by_no_sensor(empty_blender):
    scene = bpy.context.scene
    for _ in range(2):  # laid again they stand in place of the first
        lay_horizon(scene, np.array([5.0, 7.0]), 20.0, 3.0)
    assert len(hills()) == len(RINGS) + 1  # and the plain
    for obj in hills():
        obj.hide_viewport = False  # else the depsgraph would not hold them anyway
        assert not obj.hide_render
    bpy.context.view_layer.update()
    assert len(read_scene(bpy.context.evaluated_depsgraph_get())) == 0
    plain, *rings = sorted(hills(), key=lambda obj: len(obj.data.vertices))
    assert max(corner.co.z for corner in plain.data.vertices) < 3.0
    for obj, (beyond, high, _) in zip(rings, RINGS, strict=True):
        place = np.array([corner.co for corner in obj.data.vertices])
        away = np.hypot(*(place[:, :2] - [5.0, 7.0]).T)
        np.testing.assert_allclose(away, 20.0 + beyond, rtol=1e-5)
        assert place[:, 2].min() < 3.0 < place[:, 2].max() < 3.0 + 2 * high


def test_farther_hills_are_paler(empty_blender):
    lay_horizon(bpy.context.scene, np.zeros(2), 10.0, 0.0)
    shades = []
    for obj in hills():
        if obj.name.endswith("plain"):
            continue
        nodes = obj.data.materials[0].node_tree.nodes
        glow = next(node for node in nodes if node.type == "EMISSION")
        shades.append(sum(glow.inputs["Color"].default_value[:3]))
    assert shades == sorted(shades)
    assert shades[0] < 0.8 * shades[-1]


# ---------------------------------------------------------------------------------------- materials
# Bark and leaves as nodes: every texture is whole, small, and made anew when the species' bark changes.

COLOUR = (0.2, 0.15, 0.1)


def reached(material):
    """Nodes that the surface depends on."""
    tree = material.node_tree
    ahead = [n for n in tree.nodes if n.type == "OUTPUT_MATERIAL"]
    seen = set()
    while ahead:
        node = ahead.pop()
        if node.name not in seen:
            seen.add(node.name)
            ahead += [link.from_node for socket in node.inputs for link in socket.links]
    return seen


def test_every_texture_of_the_settings_is_there():
    choices = spec.param_of(spec.Bark.__dataclass_fields__["texture"]).choices
    assert set(choices) == set(TEXTURES)


@pytest.mark.medium
@pytest.mark.parametrize("texture", TEXTURES)
def test_a_bark_is_nodes_alone_and_all_of_them_count(empty_blender, texture):
    coat = spec.Bark(texture=texture, upper_from=0.4, moss=0.3)
    bark = materials.bark("bark", COLOUR, coat)
    shader = bark.node_tree.nodes["Principled BSDF"]
    assert shader.inputs["Base Color"].is_linked
    assert shader.inputs["Normal"].is_linked
    assert not bpy.data.images
    assert all(link.is_valid for link in bark.node_tree.links)
    assert len(reached(bark)) > 0.9 * len(bark.node_tree.nodes)
    assert len(bark.node_tree.nodes) < 120
    ramp = bark.node_tree.nodes[materials.BARK_TONES].color_ramp.elements
    assert ramp[0].color[0] < COLOUR[0] < ramp[-1].color[0]


def test_needles_have_no_veins(empty_blender):
    broad, needle = (materials.leaf(veins, COLOUR, veins) for veins in ("feather", "none"))
    assert any(node.type == "BSDF_TRANSLUCENT" for node in needle.node_tree.nodes)
    assert len(reached(needle)) < len(reached(broad))


def test_a_bark_is_made_anew_in_place(empty_blender):
    bark = materials.bark("bark", COLOUR, spec.Bark(texture="smooth"))
    was = bark[materials.STYLE_KEY]
    again = materials.bark("bark", COLOUR, spec.Bark(texture="plated"), into=bark)
    fresh = materials.bark("fresh", COLOUR, spec.Bark(texture="plated"))
    assert again == bark
    assert bark[materials.STYLE_KEY] != was
    assert len(bark.node_tree.nodes) == len(fresh.node_tree.nodes)
    assert len(bark.node_tree.links) == len(fresh.node_tree.links)
