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


def test_order_and_texture_arrive_in_blender(empty_blender, tree):
    from forest_addon.blender.scene.meshes import to_mesh

    data = to_mesh("tree", tree)
    order = np.empty(len(data.polygons), dtype=np.int8)
    data.attributes["order"].data.foreach_get("value", order)
    assert np.array_equal(order, tree.order)
    uv = np.empty(2 * len(data.loops), dtype=np.float32)
    data.uv_layers["UVMap"].data.foreach_get("uv", uv)
    assert np.array_equal(uv, tree.uv.ravel())
