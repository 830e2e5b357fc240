"""The evaluated scene as arrays: modifiers, instances, hidden objects, curves, leaf numbers."""

import dataclasses
import gc
import weakref
from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.growth.tree import grow
from forest_addon.spec import Grammar, Species

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, keyed, link, reopened

from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.read import depsgraph
from forest_addon.blender.read.depsgraph import (
    IGNORED_KEY,
    REFLECTANCE_KEY,
    SPECIES_KEY,
    TREE_KEY,
    read_scene,
)
from forest_addon.blender.scene.meshes import from_mesh, to_mesh
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.sensing.lidar.cloud import label
from forest_addon.spec import Rays


def quad(x, part, leaf=-1):
    corners = np.array([[x, -1, 0], [x, 1, 0], [x, 1, 2], [x, -1, 2]], float)
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), part)
    return TriMesh(
        mesh.vertices, mesh.triangles, mesh.part, np.full(2, leaf, np.int32), mesh.material
    )


def add(mesh, name="thing", **keys):
    obj = link(name, to_mesh(name, mesh))
    for key, value in keys.items():
        obj[key] = value
    return obj


def read():
    bpy.context.view_layer.update()
    return read_scene(bpy.context.evaluated_depsgraph_get())


def distance_along_x(scene, y=0.3, z=1.0):
    return (
        BvhCaster(scene).cast(np.array([[-5.0, y, z]]), np.array([[1.0, 0, 0]]), np.inf).distance[0]
    )


@pytest.mark.slow
@pytest.mark.parametrize("species", ["maple", "honda-birch"])
def test_edges_that_growth_knows_are_those_that_blender_finds(empty_blender, species):
    kind, template = load_species(find_species(species, Path()))
    mesh = grow(kind, template, stream(1, "edges")).mesh
    assert mesh.edges is not None

    def edges(data):
        pairs = np.empty(2 * len(data.edges), np.int32)
        data.edges.foreach_get("vertices", pairs)
        of_corner = np.empty(len(data.loops), np.int32)
        data.loops.foreach_get("edge_index", of_corner)
        return np.sort(pairs.reshape(-1, 2), axis=1), of_corner

    known, on_corner = edges(to_mesh("known", mesh))
    found, _ = edges(to_mesh("found", dataclasses.replace(mesh, edges=None)))
    assert (np.unique(known, axis=0) == np.unique(found, axis=0)).all()
    assert len(known) == len(found)
    corner = mesh.triangles.ravel()
    following = mesh.triangles[:, [1, 2, 0]].ravel()
    assert (known[on_corner] == np.sort(np.stack([corner, following], 1), axis=1)).all()


def test_an_empty_mesh_is_harmless(empty_blender):
    add(TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), OTHER))
    assert len(read()) == 0


def test_an_array_modifier_adds_hits_and_leaves(empty_blender):
    obj = add(quad(0, LEAF, 0))
    modifier = obj.modifiers.new("Array", "ARRAY")
    modifier.use_relative_offset, modifier.use_constant_offset = False, True
    modifier.constant_offset_displace, modifier.count = (0, 4, 0), 3
    scene = read()
    assert distance_along_x(scene, y=8.3) == pytest.approx(5, abs=1e-6)
    leaves = measure_leaves(scene.meshes[0])
    assert len(leaves) == 3  # copies are leaves of their own
    assert np.allclose(np.sort(leaves.centre[:, 1]), [0, 4, 8], atol=1e-6)


def test_a_bend_changes_distances_and_leaf_normals(empty_blender):
    obj = add(quad(0, LEAF, 0))
    before = measure_leaves(read().meshes[0])
    modifier = obj.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.deform_axis, modifier.angle = "TWIST", "Z", 1.2
    after = measure_leaves(read().meshes[0])
    assert abs(before.normal[0] @ after.normal[0]) < 0.99
    assert obj.data.vertices[2].co.x == 0  # the original is untouched


def test_instances_share_one_mesh_and_carry_their_tree(empty_blender):
    first = add(quad(0, LEAF, 0), "a", **{TREE_KEY: 4, SPECIES_KEY: 1})
    for number in (5, 6):
        twin = link("b", first.data)
        twin.location.x, twin[TREE_KEY], twin[SPECIES_KEY] = number, number, 0
    scene = read()
    assert len(scene.meshes) == 1
    assert sorted(scene.tree.tolist()) == [4, 5, 6]
    origins, way = np.array([[-5.0, 0.3, 1]]), np.array([[1.0, 0, 0]])
    seen = label(scene, BvhCaster(scene).cast(origins, way, np.inf), way)
    assert (seen.tree[0], seen.species[0], seen.organ[0], seen.leaf[0]) == (4, 1, LEAF, 0)
    assert seen.cos_incidence[0] == pytest.approx(1)


def test_collection_instances_are_seen_where_they_stand(empty_blender):
    library = bpy.data.collections.new("library")
    link("leaf", to_mesh("leaf", quad(0, LEAF, 0)), library)
    for x in (0.0, 3.0):
        holder = link("tree")
        holder.instance_type, holder.instance_collection = "COLLECTION", library
        holder.location, holder[TREE_KEY] = (x, 0, 0), int(x)
    scene = read()
    assert len(scene.meshes) == 1
    assert sorted(scene.tree.tolist()) == [0, 3]
    assert sorted(scene.transform[:, 0, 3].tolist()) == [0, 3]


def node_group(build):
    """A geometry node group; ``build`` gets the group, its input and its output."""
    group = bpy.data.node_groups.new("nodes", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    build(group, group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput"))
    return group


def with_nodes(obj, build):
    obj.modifiers.new("Nodes", "NODES").node_group = node_group(build)
    return obj


def row(count, offset, what=None, keep=False):
    """Nodes that set ``what`` (an object, a collection, or the geometry itself) in a row."""

    def build(group, start, end):
        line, copy, join = (
            group.nodes.new(f"GeometryNode{name}")
            for name in ("MeshLine", "InstanceOnPoints", "JoinGeometry")
        )
        line.inputs["Count"].default_value = count
        line.inputs["Offset"].default_value = offset
        group.links.new(line.outputs["Mesh"], copy.inputs["Points"])
        source = start.outputs["Geometry"]
        if isinstance(what, bpy.types.Object):
            info = group.nodes.new("GeometryNodeObjectInfo")
            info.inputs["Object"].default_value = what
            info.inputs["As Instance"].default_value = True
            source = info.outputs["Geometry"]
        elif what is not None:
            info = group.nodes.new("GeometryNodeCollectionInfo")
            info.inputs["Collection"].default_value = what
            source = info.outputs[0]
        group.links.new(source, copy.inputs["Instance"])
        group.links.new(copy.outputs["Instances"], join.inputs["Geometry"])
        if keep:
            group.links.new(start.outputs["Geometry"], join.inputs["Geometry"])
        group.links.new(join.outputs["Geometry"], end.inputs["Geometry"])

    return build


def places(scene):
    """Where each triangle of the scene stands: (mesh size, rounded centre), sorted."""
    found = []
    for transform, number in zip(scene.transform, scene.mesh_index, strict=True):
        mesh = scene.meshes[number]
        corners = mesh.vertices[mesh.triangles] @ transform[:, :3].T + transform[:, 3]
        found += [tuple(np.round(c, 4) + 0.0) for c in corners.mean(axis=1)]
    return sorted(found)


def shown_by_iterator():
    """The same of what the depsgraph's own iterator shows, one by one."""
    found = []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "MESH" and instance.show_self:
            mesh = from_mesh(instance.object.data)
            matrix = np.array(instance.matrix_world)
            corners = mesh.vertices[mesh.triangles] @ matrix[:3, :3].T + matrix[:3, 3]
            found += [tuple(np.round(c, 4) + 0.0) for c in corners.mean(axis=1)]
    return sorted(found)


def library_of(*things):
    library = bpy.data.collections.new("library")
    for obj in things:
        library.objects.link(obj)
        bpy.context.scene.collection.objects.unlink(obj)
    return library


def build_nested():
    """Nodes that instance an object whose nodes instance a third."""
    inner = with_nodes(add(quad(0, WOOD)), row(2, (0.5, 0, 0), add(quad(3, LEAF, 0)), keep=True))
    outer = with_nodes(add(quad(0, WOOD)), row(3, (0, 0, 2), inner, keep=True))
    outer.location, outer.scale, outer.rotation_euler = (1, 2, 3), (1, -2, 0.5), (0.3, 0.2, 0.1)
    return outer


def build_collection_within_nodes():
    with_nodes(add(quad(0, WOOD)), row(3, (0, 0, 2), library_of(add(quad(1, LEAF, 0)))))


def build_nodes_within_collection():
    holder = link("holder")
    holder.instance_type = "COLLECTION"
    holder.instance_collection = library_of(with_nodes(add(quad(0, WOOD)), row(2, (1, 0, 0))))
    holder.location.z = 4
    build_nested()


def build_hidden_instancer():
    build_nested().show_instancer_for_viewport = False


def build_duplis_on_faces():
    parent, child = add(quad(2, WOOD)), add(quad(0, LEAF, 0))
    child.parent, parent.instance_type = parent, "FACES"
    build_nested()


def build_curves():
    curve = bpy.data.curves.new("branch", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    curve.splines.new("POLY").points.add(1)
    curve.splines[0].points[1].co = (0, 0, 2, 1)
    branch = link("branch", curve)
    with_nodes(add(quad(0, WOOD)), row(2, (3, 0, 0), branch))


BUILDERS = [
    build_nested,
    build_collection_within_nodes,
    build_nodes_within_collection,
    build_hidden_instancer,
    build_duplis_on_faces,
    build_curves,
]


@pytest.mark.parametrize("build", BUILDERS, ids=lambda b: b.__name__.removeprefix("build_"))
def test_each_instance_is_read_exactly_once(empty_blender, build):
    build()
    scene = read()
    assert len(scene) >= 2
    assert places(scene) == shown_by_iterator()


def test_instances_carry_the_trees_of_their_points(empty_blender):
    trees = [add(quad(0, WOOD), "a", **{SPECIES_KEY: 7}), add(quad(1, WOOD), "b")]
    library = library_of(*trees)
    points = bpy.data.meshes.new("points")
    points.from_pydata([(x, 0, 0) for x in range(4)], [], [])
    for name, values in ((TREE_KEY, [40, 41, 42, 43]), (SPECIES_KEY, [-1, 1, -1, 1])):
        points.attributes.new(name, "INT", "POINT").data.foreach_set("value", values)
    forest = link("forest", points)

    def build(group, start, end):
        copy = group.nodes.new("GeometryNodeInstanceOnPoints")
        info = group.nodes.new("GeometryNodeCollectionInfo")
        info.inputs["Collection"].default_value = library
        info.inputs["Separate Children"].default_value = True
        copy.inputs["Pick Instance"].default_value = True
        group.links.new(start.outputs["Geometry"], copy.inputs["Points"])
        group.links.new(info.outputs[0], copy.inputs["Instance"])
        group.links.new(copy.outputs["Instances"], end.inputs["Geometry"])

    with_nodes(forest, build)
    scene = read()
    order = np.argsort(scene.tree)
    assert scene.tree[order].tolist() == [40, 41, 42, 43]
    assert np.round(scene.transform[order, 0, 3], 6).tolist() == [0, 1, 2, 3]
    # The point knows best, then the object that instances, then the one that stands there.
    assert scene.species[order].tolist() == [7, 1, 7, 1]
    assert scene.object_name == ("forest",)
    assert (scene.object_index == 0).all()


def test_hidden_objects_are_left_out(empty_blender):
    add(quad(0, WOOD)).hide_viewport = True
    add(quad(1, WOOD)).hide_set(True)
    apart = add_collection("apart")
    link("far", to_mesh("far", quad(2, WOOD)), apart)
    assert len(read()) == 1
    bpy.context.view_layer.layer_collection.children["apart"].exclude = True
    assert len(read()) == 0


def test_an_ignored_object_is_not_seen_and_casts_no_instances(empty_blender):
    add(quad(0, WOOD), "a", forest_ignored=True)
    with_nodes(add(quad(1, WOOD), "b", forest_ignored=1), row(3, (1, 0, 0)))
    seen = add(quad(3, WOOD), "c", forest_ignored=False)
    scene = read()
    assert scene.object_name == ("c",)
    seen[IGNORED_KEY] = True
    seen.update_tag()
    assert len(read()) == 0


def test_optics_and_reflectance_of_material_then_object_then_scanner(empty_blender):
    """One face of "m" is of a material that says something; "b" says it itself, "n" nothing."""
    m = add(quad(0, WOOD), "m", forest_optics="mirror", **{REFLECTANCE_KEY: 0.2})
    for name in ("plain", "other"):
        m.data.materials.append(bpy.data.materials.new(name))
    other = m.data.materials[1]
    other["forest_optics"], other["forest_index"], other[REFLECTANCE_KEY] = "glass", 1.6, 0.45
    m.data.polygons[1].material_index = 1
    with_nodes(add(quad(1, WOOD), "b", forest_optics="water"), row(3, (1, 0, 0)))
    add(quad(5, WOOD), "n")
    scene = read()
    name = np.array(scene.object_name)[scene.object_index]
    m, b, n = (np.flatnonzero(name == one)[-1] for one in "mbn")
    hits, faces = np.array([m, m, b, n, -1]), np.array([0, 1, 0, 0, -1])
    nothing = [np.nan, np.nan]
    assert scene.optics_at(hits, faces)[:, :2] == pytest.approx(
        np.array([[0, np.nan], [1, 1.6], [2, np.nan], nothing, nothing]), nan_ok=True
    )
    assert scene.reflectance_at(hits, faces, 0.5).tolist() == [0.2, 0.45, 0.5, 0.5, 0.5]


def changes(obj):
    """Everything a user does to a scene, one at a time."""

    def animate():
        keyed(obj, "location", {1: (7, 0, 0), 10: (9, 0, 0)})
        bpy.context.scene.frame_set(1)

    yield lambda: setattr(obj.location, "x", 1.5)
    yield lambda: setattr(obj.data.vertices[0].co, "x", 0.25)
    yield lambda: setattr(obj.modifiers.new("a", "ARRAY"), "count", 3)
    yield lambda: setattr(obj.modifiers["a"], "count", 2)
    yield lambda: with_nodes(obj, row(2, (0, 0, 5)))
    yield lambda: setattr(
        obj.modifiers["Nodes"].node_group.nodes["Mesh Line"].inputs["Count"], "default_value", 4
    )
    yield lambda: add(quad(4, WOOD))
    yield lambda: setattr(obj, "parent", add(quad(4, WOOD)))
    yield lambda: setattr(obj.parent.location, "y", 3.0)
    yield animate
    yield lambda: bpy.context.scene.frame_set(5)
    yield lambda: obj.hide_set(True)
    yield lambda: obj.hide_set(False)
    yield lambda: bpy.data.objects.remove(obj)


def test_what_is_kept_is_never_stale(empty_blender):
    obj = add(quad(0, WOOD))
    for number, change in enumerate(changes(obj)):
        before = read()
        assert read() is before, "nothing changed"
        change()
        after = read()
        assert after is not before, number
        assert places(after) == shown_by_iterator(), number
        assert places(after) != places(before), number


def test_a_loaded_file_is_read_anew(empty_blender, tmp_path):
    add(quad(0, WOOD))
    before = read()
    reopened(tmp_path / "a.blend")
    assert read() is not before
    assert read() is read()
    depsgraph.unwatch()
    lists = (getattr(bpy.app.handlers, name) for name, _ in depsgraph.WATCHED)
    assert not any(depsgraph.forget in handlers for handlers in lists)


def test_curves_and_text_are_seen(empty_blender):
    curve = bpy.data.curves.new("branch", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[0].co, spline.points[1].co = (0, 0.3, 0, 1), (0, 0.3, 2, 1)
    link("branch", curve)
    link("word", bpy.data.curves.new("word", "FONT"))
    scene = read()
    assert len(scene) == 2  # each once
    assert distance_along_x(scene) == pytest.approx(4.9, abs=0.02)


def test_a_negative_scale_keeps_distances(empty_blender):
    obj = add(quad(1, WOOD))
    obj.scale = (-2, 1, 1)
    assert distance_along_x(read()) == pytest.approx(3, abs=1e-6)


def observe(engine="auto"):
    bpy.context.view_layer.update()
    return Observer.of(bpy.context.evaluated_depsgraph_get(), Rays(engine=engine))


@pytest.mark.parametrize("how", ["deleted", "unlinked", "added", "none that counts"])
def test_what_comes_or_goes_is_set_up_anew_and_an_estimate_knows(empty_blender, how):
    obj, home = add(quad(0, WOOD)), bpy.context.scene.collection
    spare = bpy.data.objects.new("spare", to_mesh("spare", quad(2, WOOD)))
    add(quad(1, WOOD))
    observe().ran.add("terrestrial")
    assert depsgraph.ready() == {"terrestrial"}
    if how == "deleted":
        bpy.data.objects.remove(obj)
    elif how == "unlinked":
        home.objects.unlink(obj)
    else:
        spare[IGNORED_KEY] = how != "added"
        home.objects.link(spare)
    bpy.context.view_layer.update()
    assert depsgraph.ready() == ({"terrestrial"} if how == "none that counts" else set())


def test_a_scene_is_not_set_up_anew_after_what_sensors_do_not_meet(empty_blender):
    add(quad(0, WOOD))
    lamp = link("ear")
    before = observe()
    lamp.location.x = 3
    after = observe()
    assert after is before
    assert after.places["ear"] == (3, 0, 0)
    add(quad(1, WOOD), **{IGNORED_KEY: True})
    assert observe() is before


@pytest.mark.parametrize("engine", ["embree", "bvhtree"])
def test_trees_of_meshes_that_stayed_are_not_built_anew(empty_blender, engine, monkeypatch):
    from forest_addon.blender.rays import bvh, embree

    built = []
    for room, name in ((bvh, "whole_triangles"), (embree, "whole_triangles")):
        before = getattr(room, name)
        told = lambda mesh, before=before: built.append(len(mesh.triangles)) or before(mesh)  # noqa: E731
        monkeypatch.setattr(room, name, told)
    rng = stream(4, engine)
    things = []
    for count in (3, 4, 5, 6):
        corners = rng.uniform(-1, 1, (3 * count, 3))
        triangles = np.arange(3 * count).reshape(-1, 3)
        things.append(add(TriMesh.of_part(corners, triangles, WOOD), str(count)))
    origins, ways = rng.uniform(-2, 2, (2, 400, 3))

    def cast():
        built.clear()
        observer = observe(engine)
        for caster in (observer.caster, observer.wood):
            mine = caster.cast(origins, ways)
            alone = BvhCaster(observer.geometry).cast(origins, ways)
            assert np.array_equal(mine.instance, alone.instance)
            assert np.allclose(mine.distance, alone.distance, rtol=0, atol=1e-12)
        return sorted(set(built) - {48, 600})  # those of the trial of Embree

    assert cast() == [3, 4, 5, 6]
    things[0].location.x += 0.5
    assert cast() == []
    things[1].data.vertices[0].co.z += 0.7
    things[1].data.update()
    assert cast() == [4]
    things.append(add(quad(0, WOOD)))
    bpy.data.objects.remove(things.pop(2))
    assert (
        cast() == [2, 4] if engine == "embree" else [2]
    )  # of the first scene's meshes Embree keeps those


def test_meshes_of_a_closed_file_are_let_go(empty_blender, tmp_path):
    add(quad(0, WOOD))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    observer = observe()
    observer.caster.cast(np.zeros((1, 3)), np.ones((1, 3)))
    left = weakref.ref(observer.geometry.meshes[0])
    del observer
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    gc.collect()
    assert left() is None


@pytest.mark.parametrize("update", [True, False])
def test_a_property_set_by_a_script_counts_in_the_first_run(empty_blender, update):
    obj, other = add(quad(0, WOOD)), add(quad(1, WOOD))
    depsgraph_now = bpy.context.evaluated_depsgraph_get
    assert len(read_scene(depsgraph_now())) == 2
    obj[IGNORED_KEY] = True
    if update:
        bpy.context.view_layer.update()
    assert read_scene(depsgraph_now()).object_name == (other.name,)
    bark = bpy.data.materials.new("bark")
    other.data.materials.append(bark)
    bpy.context.view_layer.update()
    read_scene(depsgraph_now())
    for place, value in ((other, 0.25), (bark, 0.5)):
        place[REFLECTANCE_KEY] = value
        scene = read_scene(depsgraph_now())
        assert scene.reflectance_at(np.zeros(1, int), np.zeros(1, int), 0.9) == [value]


# -------------------------------------------------------------------------------------------- meshes
# Meshes written to Blender: edges that we know are those that Blender would find.


@pytest.fixture
def tree():
    species = Species(name="plain", grammar=Grammar(generations=4, radius=0.08))
    return grow(species, None, stream(3, "tree", "plain", 0)).mesh


def test_places_that_are_read_are_held_as_blender_has_them(empty_blender, tree):
    back = from_mesh(to_mesh("tree", tree))
    assert back.points.dtype == np.float32
    assert back.vertices.dtype == np.float64
    assert np.array_equal(back.vertices, tree.vertices.astype(np.float32))
    some = back.select(back.part == LEAF)
    assert some.points.dtype == np.float32
    assert np.array_equal(
        some.vertices[some.triangles], back.vertices[back.triangles[back.part == LEAF]]
    )


@pytest.mark.parametrize("changed", [False, True])
def test_what_is_read_as_it_was_written_is_held_once(empty_blender, tree, changed):
    data = to_mesh("tree", tree)
    if changed:
        for name, value in (("part", 3), ("leaf", 7), ("material_index", 1)):
            data.attributes[name].data[5].value = value
    back = from_mesh(data)
    assert np.shares_memory(back.triangles, tree.triangles)
    for name in ("part", "leaf", "material"):
        assert np.shares_memory(getattr(back, name), getattr(tree, name)) != changed
    assert back.part[5] == (3 if changed else tree.part[5])
    assert tree.part[5] != 3
    with pytest.raises(ValueError, match="read-only"):
        back.triangles[0] = 0


def test_an_evaluated_mesh_is_read_as_it_is_shown(empty_blender, tree):
    obj = link("tree", to_mesh("tree", tree))
    plain = read_scene(bpy.context.evaluated_depsgraph_get()).meshes[0]
    assert np.shares_memory(plain.triangles, tree.triangles)
    assert np.array_equal(plain.vertices, tree.vertices.astype(np.float32))
    twice = obj.modifiers.new("twice", "ARRAY")
    twice.count = 2
    shown = read_scene(bpy.context.evaluated_depsgraph_get()).meshes[0]
    assert len(shown.triangles) == 2 * len(tree.triangles)
    assert np.array_equal(shown.vertices[: len(plain.vertices)], plain.vertices)
    first, second = shown.leaf.reshape(2, -1)
    assert np.array_equal(first, tree.leaf)
    assert not np.intersect1d(
        first[first >= 0], second
    ).size  # leaves of the copy have numbers of their own


def test_order_and_texture_arrive_in_blender(empty_blender, tree):
    data = to_mesh("tree", tree)
    assert [one.value for one in data.attributes["order"].data] == tree.order.tolist()
    uv = np.empty(2 * len(data.loops), dtype=np.float32)
    data.uv_layers["UVMap"].data.foreach_get("uv", uv)
    assert np.array_equal(uv, tree.uv.ravel())


# ---------------------------------------------------------------------------------------- far places
# Things so far away that Blender's coordinates are coarse: said, with the remedy.


HUT = np.array([[0, -1, 0], [0, 1, 0], [0, 1, 2.0]])


def look_at(place, corners):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2]]), OTHER)
    obj = link("hut", to_mesh("hut", mesh))
    obj.location = place
    return Observer(bpy.context.evaluated_depsgraph_get())


@pytest.mark.parametrize("place", [(0, 0, 0), (1000, -2000, 300), (-8000, 0, 0)])
def test_nothing_is_said_of_what_stands_near(place):
    assert look_at(place, HUT).warning == ""


@pytest.mark.parametrize(
    ("place", "corners", "off"),
    [
        ((500_000.1, 0, 0), HUT, 0.016),
        ((500_000, 5_400_000.2, 0), HUT, 0.25),
        ((0, 0, 0), np.add(HUT, [500_000.0, 5_400_000.0, 0]), 0.25),
    ],
)
def test_what_stands_at_map_coordinates_is_said_to_be_off(place, corners, off):
    seen = look_at(place, corners)
    moved = np.abs(seen.geometry.transform[0, :, 3] - place).max()
    assert (moved > 0) == any(place)
    assert moved <= off * 1.01  # what is said bounds what happened
    assert '"hut"' in seen.warning
    assert f"off by up to {off:g} m" in seen.warning
    assert "offset" in seen.warning


def test_an_empty_scene_has_nothing_to_say():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert Observer(bpy.context.evaluated_depsgraph_get()).warning == ""
