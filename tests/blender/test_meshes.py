"""Meshes written to Blender: edges that we know are those that Blender would find."""

from dataclasses import replace

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.growth.tree import grow
from forest_addon.spec import Grammar, Species


@pytest.fixture
def tree():
    species = Species(name="plain", grammar=Grammar(generations=4, radius=0.08))
    return grow(species, None, stream(3, "tree", "plain", 0)).mesh


def edges_of(data):
    ends = np.empty(2 * len(data.edges), dtype=np.int32)
    data.edges.foreach_get("vertices", ends)
    return ends.reshape(-1, 2)


def test_known_edges_are_those_blender_finds(empty_blender, tree):
    from forest_addon.blender.scene.meshes import from_mesh, to_mesh

    ours, theirs = to_mesh("ours", tree), to_mesh("theirs", replace(tree, edges=None))
    assert np.array_equal(
        np.unique(np.sort(edges_of(ours), axis=1), axis=0),
        np.unique(np.sort(edges_of(theirs), axis=1), axis=0),
    )
    assert len(ours.edges) == len(theirs.edges)
    corner_edge = np.empty(len(ours.loops), dtype=np.int32)
    ours.loops.foreach_get("edge_index", corner_edge)
    ends = np.sort(edges_of(ours)[corner_edge], axis=1)
    after = np.stack([tree.triangles, tree.triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2)
    assert np.array_equal(ends, np.sort(after, axis=1))
    assert not ours.validate(verbose=False)  # nothing had to be corrected

    back = from_mesh(ours)
    assert np.array_equal(back.triangles, tree.triangles)
    assert np.array_equal(back.part, tree.part)
    assert np.array_equal(back.leaf, tree.leaf)


@pytest.mark.parametrize("changed", [False, True])
def test_what_is_read_as_it_was_written_is_held_once(empty_blender, tree, changed):
    from forest_addon.blender.scene.meshes import from_mesh, to_mesh

    data = to_mesh("tree", tree)
    if changed:
        for name, value in (("part", 3), ("leaf", 7), ("material_index", 1)):
            data.attributes[name].data[5].value = value
    back = from_mesh(data)
    assert np.shares_memory(back.triangles, tree.triangles)
    for one, other in ((back.part, tree.part), (back.leaf, tree.leaf)):
        assert np.shares_memory(one, other) != changed
    assert back.part[5] == (3 if changed else tree.part[5])
    assert tree.part[5] != 3
    with pytest.raises(ValueError, match="read-only"):
        back.triangles[0] = 0


def test_an_evaluated_mesh_is_read_as_it_is_shown(empty_blender, tree):
    import bpy

    from forest_addon.blender.read.depsgraph import read_scene
    from forest_addon.blender.scene.meshes import to_mesh

    thing = bpy.data.objects.new("tree", to_mesh("tree", tree))
    bpy.context.collection.objects.link(thing)
    plain = read_scene(bpy.context.evaluated_depsgraph_get()).meshes[0]
    assert np.shares_memory(plain.triangles, tree.triangles)
    assert np.array_equal(plain.vertices, tree.vertices.astype(np.float32))
    twice = thing.modifiers.new("twice", "ARRAY")
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
    from forest_addon.blender.scene.meshes import to_mesh

    data = to_mesh("tree", tree)
    order = np.empty(len(data.polygons), dtype=np.int8)
    data.attributes["order"].data.foreach_get("value", order)
    assert np.array_equal(order, tree.order)
    uv = np.empty(2 * len(data.loops), dtype=np.float32)
    data.uv_layers["UVMap"].data.foreach_get("uv", uv)
    assert np.array_equal(uv, tree.uv.ravel())
