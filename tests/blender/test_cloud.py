"""Clouds as Blender objects: every attribute is there, and any of them colours the points."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.lidar_scenes import ground, scene_with, wall
from references.rays_brute import BruteCaster

from forest_addon.blender.scene.layout import COLOUR_BY, COLOUR_MAP, SHARE
from forest_addon.blender.scene.nodes import choose_input, drawn_inputs, set_input
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
from forest_addon.sensing.lidar.scan import scan
from forest_addon.spec import Beam, Terrestrial


@pytest.fixture
def cloud():
    scanner = Terrestrial(
        azimuth_deg=(-50.0, 50.0),
        elevation_deg=(-40.0, 20.0),
        angle_step_deg=5.0,
        beam=Beam(subrays=7, divergence_mrad=(30.0, 30.0), max_returns=4),
    )
    return scan(scanner, BruteCaster(scene_with(ground(), wall(9.0, half=3.0))))


def values(owner, name, key, width=1):
    attribute = owner.attributes[name]
    dtype = np.int32 if attribute.data_type == "INT" else np.float32
    out = np.empty(width * len(attribute.data), dtype=dtype)
    attribute.data.foreach_get(key, out)
    return out.reshape(-1, width) if width > 1 else out


def shown(thing):
    """Colours of the evaluated points."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    depsgraph.update()
    geometry = thing.evaluated_get(depsgraph).evaluated_geometry()  # owns the points
    return values(geometry.pointcloud, "colour", "color", 4)


def test_every_value_of_a_return_is_an_attribute(empty_blender, cloud):
    mesh = show_cloud(bpy.context.scene.collection, "a", cloud).data
    assert values(mesh, "position", "vector", 3) == pytest.approx(
        cloud.position, rel=1e-6, abs=1e-6
    )
    assert values(mesh, "surface_normal", "vector", 3) == pytest.approx(cloud.returns.normal)
    assert (values(mesh, "return_number", "value") == cloud.number).all()
    assert (values(mesh, "number_of_returns", "value") == cloud.count).all()
    assert (values(mesh, "tree", "value") == cloud.returns.tree).all()
    assert (values(mesh, "object", "value") == cloud.returns.instance).all()
    assert (values(mesh, "pulse", "value") == cloud.pulse).all()
    assert values(mesh, "true_range", "value") == pytest.approx(cloud.true_range, rel=1e-6)
    assert values(mesh, "intensity", "value") == pytest.approx(cloud.intensity, rel=1e-6)
    assert np.cos(values(mesh, "incidence", "value")) == pytest.approx(
        cloud.returns.cos_incidence, abs=1e-6
    )


@pytest.mark.medium
@pytest.mark.parametrize("choice", ["organ", *NUMBERS, *MEASURES])
def test_any_attribute_colours_the_points(empty_blender, cloud, choice):
    group = show_cloud(bpy.context.scene.collection, "a", cloud).modifiers[0].node_group
    assert all(link.is_valid for link in group.links)
    menu = next(item for item in group.interface.items_tree if item.name == "Colour By")
    assert menu.default_value == "Organ"
    menu.default_value = choice.replace("_", " ").title()
    thing = show_cloud(bpy.context.scene.collection, "b", cloud)  # takes the menu's default
    colour = shown(thing)
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
    colour = shown(show_cloud(bpy.context.scene.collection, "b", cloud))
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
    thing = show_cloud(bpy.context.scene.collection, "a", cloud)
    (modifier,) = thing.modifiers
    choose_input(modifier, COLOUR_BY, "Distance")
    choose_input(modifier, COLOUR_MAP, name)
    share = (cloud.true_range - cloud.true_range.min()) / np.ptp(cloud.true_range)
    expected = np.array([on_map(name, part) for part in share])
    assert np.abs(shown(thing)[:, :3] - expected).max() < 6e-3  # ramps are tables of 257 entries


def test_fewer_points_are_shown_in_the_colours_they_had(empty_blender, cloud):
    """A share and a range of heights hide points; those that stay, and their colours, are the same."""
    thing = show_cloud(bpy.context.scene.collection, "a", cloud)
    (modifier,) = thing.modifiers
    choose_input(modifier, COLOUR_BY, "Distance")
    every = shown(thing)
    set_input(modifier, SHARE, 0.4)
    some = shown(thing)
    off = 4.5 * np.sqrt(0.24 * len(every))  # standard deviations of a binomial
    assert abs(len(some) - 0.4 * len(every)) < off
    assert {row.tobytes() for row in some} <= {row.tobytes() for row in every}
    assert (shown(show_cloud(bpy.context.scene.collection, "a", cloud)) == some).all()
    set_input(modifier, SHARE, 0.0)
    assert len(shown(thing)) == 0
    set_input(modifier, SHARE, 1.0)
    low, high = np.quantile(cloud.position[:, 2], (0.3, 0.8)) + 1e-4
    set_input(modifier, LOWEST, float(low))
    set_input(modifier, HIGHEST, float(high))
    within = (cloud.position[:, 2] >= low) & (cloud.position[:, 2] <= high)
    assert 0 < np.count_nonzero(within) < len(cloud)
    assert (shown(thing) == every[within]).all()
    assert len(thing.data.vertices) == len(cloud)  # nothing is lost


def test_the_material_shows_that_colour(empty_blender, cloud):
    thing = show_cloud(bpy.context.scene.collection, "a", cloud)
    nodes = bpy.data.materials[MATERIAL].node_tree.nodes
    assert [n.attribute_name for n in nodes if n.type == "ATTRIBUTE"] == ["colour"]
    assert thing.data.materials[0].name == MATERIAL


def test_new_points_come_into_the_object_that_is_there(empty_blender, cloud):
    """Whatever the user has done to it stays: menu, radius, modifiers, material, collection, references."""
    home = bpy.context.scene.collection
    thing = show_cloud(home, "a", cloud)
    modifier, plain = thing.modifiers["Points"], shown(thing)
    holder, key = drawn_inputs(modifier)[COLOUR_BY]
    by_tree = modifier[key[2:-2]] + 1 if holder is modifier else "Tree"
    set_input(modifier, COLOUR_BY, by_tree)
    set_input(modifier, "Radius", 0.07)
    was = shown(thing)
    assert (was != plain).any()
    thing.modifiers.new("mine", "DISPLACE")
    mine = bpy.data.materials.new("mine")
    thing.data.materials[0] = mine
    thing.location.x, thing.hide_render = 3.0, False
    follower = bpy.data.objects.new("follower", thing.data)  # shares the points
    follower.constraints.new("COPY_LOCATION").target = thing
    home.objects.link(follower)
    own = bpy.data.collections.new("mine")
    home.children.link(own)
    own.objects.link(thing)
    home.objects.unlink(thing)

    assert show_cloud(home, "a", cloud) == thing
    assert len(thing.data.vertices) == len(cloud)
    assert [m.name for m in thing.modifiers] == ["Points", "mine"]
    assert (thing.location.x, thing.hide_render) == (3.0, False)
    assert list(thing.data.materials) == [mine]
    assert follower.data == thing.data
    assert follower.constraints[0].target == thing
    assert list(thing.users_collection) == [own]
    thing.modifiers.remove(thing.modifiers["mine"])
    assert (shown(thing) == was).all()
    assert len(bpy.data.meshes) == 1


def test_a_copy_and_one_that_was_renamed_are_the_users(empty_blender, cloud):
    home = bpy.context.scene.collection
    thing = show_cloud(home, "a", cloud)
    copy = thing.copy()
    home.objects.link(copy)
    thing.name = "kept for the paper"
    assert show_cloud(home, "a", cloud) not in (thing, copy)
    assert {thing, copy} < set(home.objects)
