"""The evaluated scene as arrays: modifiers, instances, hidden objects, curves, leaf numbers."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.bvh import BvhCaster
from forest_addon.blender.depsgraph import SPECIES_KEY, TREE_KEY, read_scene
from forest_addon.blender.meshes import from_mesh, to_mesh
from forest_addon.formats.species_file import find_species, load_species
from forest_addon.growth.leaves import measure_leaves
from forest_addon.growth.tree import grow
from forest_addon.growth.trimesh import LEAF, OTHER, WOOD, TriMesh, join
from forest_addon.rng import stream
from forest_addon.sensing.returns import label


def quad(x, part, leaf=-1):
    corners = np.array([[x, -1, 0], [x, 1, 0], [x, 1, 2], [x, -1, 2]], float)
    mesh = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), part)
    return TriMesh(
        mesh.vertices, mesh.triangles, mesh.part, np.full(2, leaf, np.int32), mesh.material
    )


def add(mesh, name="thing", **keys):
    thing = bpy.data.objects.new(name, to_mesh(name, mesh))
    bpy.context.scene.collection.objects.link(thing)
    for key, value in keys.items():
        thing[key] = value
    return thing


def read():
    bpy.context.view_layer.update()
    return read_scene(bpy.context.evaluated_depsgraph_get())


def distance_along_x(scene, y=0.3, z=1.0):
    return (
        BvhCaster(scene).cast(np.array([[-5.0, y, z]]), np.array([[1.0, 0, 0]]), np.inf).distance[0]
    )


def test_mesh_round_trip_keeps_everything(empty_blender):
    mesh = join([quad(0, WOOD), quad(1, LEAF, 0), quad(2, LEAF, 1)])
    back = from_mesh(to_mesh("x", mesh))
    assert np.allclose(back.vertices, mesh.vertices, atol=1e-6)
    for name in ("triangles", "part", "leaf", "material"):
        assert (getattr(back, name) == getattr(mesh, name)).all(), name


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


def test_a_moved_object_moves_its_hits(empty_blender):
    thing = add(quad(0, WOOD))
    assert distance_along_x(read()) == pytest.approx(5, abs=1e-6)
    thing.location.x = 2.5
    assert distance_along_x(read()) == pytest.approx(7.5, abs=1e-6)


def test_an_array_modifier_adds_hits_and_leaves(empty_blender):
    thing = add(quad(0, LEAF, 0))
    modifier = thing.modifiers.new("Array", "ARRAY")
    modifier.use_relative_offset, modifier.use_constant_offset = False, True
    modifier.constant_offset_displace, modifier.count = (0, 4, 0), 3
    scene = read()
    assert distance_along_x(scene, y=8.3) == pytest.approx(5, abs=1e-6)
    leaves = measure_leaves(scene.meshes[0])
    assert len(leaves) == 3  # copies are leaves of their own
    assert np.allclose(np.sort(leaves.centre[:, 1]), [0, 4, 8], atol=1e-6)


def test_a_bend_changes_distances_and_leaf_normals(empty_blender):
    thing = add(quad(0, LEAF, 0))
    before = measure_leaves(read().meshes[0])
    modifier = thing.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.deform_axis, modifier.angle = "TWIST", "Z", 1.2
    after = measure_leaves(read().meshes[0])
    assert abs(before.normal[0] @ after.normal[0]) < 0.99
    assert thing.data.vertices[2].co.x == 0  # the original is untouched


def test_instances_share_one_mesh_and_carry_their_tree(empty_blender):
    first = add(quad(0, LEAF, 0), "a", **{TREE_KEY: 4, SPECIES_KEY: 1})
    for number in (5, 6):
        twin = bpy.data.objects.new("b", first.data)
        twin.location.x, twin[TREE_KEY], twin[SPECIES_KEY] = number, number, 0
        bpy.context.scene.collection.objects.link(twin)
    scene = read()
    assert len(scene.meshes) == 1
    assert sorted(scene.tree.tolist()) == [4, 5, 6]
    origins, way = np.array([[-5.0, 0.3, 1]]), np.array([[1.0, 0, 0]])
    seen = label(scene, BvhCaster(scene).cast(origins, way, np.inf), way)
    assert (seen.tree[0], seen.species[0], seen.organ[0], seen.leaf[0]) == (4, 1, LEAF, 0)
    assert seen.cos_incidence[0] == pytest.approx(1)


def test_collection_instances_are_seen_where_they_stand(empty_blender):
    library = bpy.data.collections.new("library")
    library.objects.link(bpy.data.objects.new("leaf", to_mesh("leaf", quad(0, LEAF, 0))))
    for x in (0.0, 3.0):
        holder = bpy.data.objects.new("tree", None)
        holder.instance_type, holder.instance_collection = "COLLECTION", library
        holder.location, holder[TREE_KEY] = (x, 0, 0), int(x)
        bpy.context.scene.collection.objects.link(holder)
    scene = read()
    assert len(scene.meshes) == 1
    assert sorted(scene.tree.tolist()) == [0, 3]
    assert sorted(scene.transform[:, 0, 3].tolist()) == [0, 3]


def test_geometry_nodes_instances_are_seen(empty_blender):
    group = bpy.data.node_groups.new("row", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    line, copy = (
        group.nodes.new("GeometryNodeMeshLine"),
        group.nodes.new("GeometryNodeInstanceOnPoints"),
    )
    line.inputs["Count"].default_value = 4
    line.inputs["Offset"].default_value = (2, 0, 0)
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    group.links.new(line.outputs["Mesh"], copy.inputs["Points"])
    group.links.new(start.outputs["Geometry"], copy.inputs["Instance"])
    group.links.new(copy.outputs["Instances"], end.inputs["Geometry"])
    thing = add(quad(0, WOOD))
    thing.modifiers.new("Row", "NODES").node_group = group
    scene = read()
    assert sorted(np.round(scene.transform[:, 0, 3], 6).tolist()) == [0, 2, 4, 6]


def test_hidden_objects_are_left_out(empty_blender):
    add(quad(0, WOOD)).hide_viewport = True
    add(quad(1, WOOD)).hide_set(True)
    assert len(read()) == 0


def test_curves_and_text_are_seen(empty_blender):
    curve = bpy.data.curves.new("branch", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[0].co, spline.points[1].co = (0, 0.3, 0, 1), (0, 0.3, 2, 1)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("branch", curve))
    bpy.context.scene.collection.objects.link(
        bpy.data.objects.new("word", bpy.data.curves.new("word", "FONT"))
    )
    scene = read()
    assert len(scene) >= 1
    assert distance_along_x(scene) == pytest.approx(4.9, abs=0.02)


def test_a_negative_scale_keeps_distances(empty_blender):
    thing = add(quad(1, WOOD))
    thing.scale = (-2, 1, 1)
    assert distance_along_x(read()) == pytest.approx(3, abs=1e-6)
