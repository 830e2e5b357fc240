"""Trees from an asset library, in a file that knows nothing of us: sensors and tables know what they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Euler, Matrix
from references.scenes import link

from forest_addon import api
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, WOOD
from forest_addon.blender.scene.assets import FILE, add_catalogs, catalog_id
from forest_addon.blender.scene.meshes import to_mesh, write_truth
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import tree_truth
from forest_addon.stand.forest import NONE, placed_leaves, placed_table
from headless.cli import main

SPECIES = "fern", "hazelnut"
POSE = Matrix.LocRotScale((3.0, -2.0, 0.4), Euler((0.2, -0.1, 1.1)), (1.3, 1.3, 1.3))
BENT = Matrix.LocRotScale((-3.0, 1.0, 0.0), Euler((0.0, 0.0, 0.3)), (1.0, 0.8, 1.4))
TRIPOD = api.Terrestrial(position=(0.0, 0.0, 1.0), angle_step_deg=2.0, elevation_deg=(-45.0, 45.0))
BAT = api.Sonar(position=(0.0, 0.0, 1.0), beam="omni", max_range=8.0, cull=0.0)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """A library as the command makes it."""
    out = tmp_path_factory.mktemp("library")
    assert main(["assets", *SPECIES, "--variants", "2", "--out", str(out)]) == 0
    return out


def grown(name, variant):
    species, template = load_species(find_species(name, Path()))
    return grow(species, template, stream(1, "library", name, variant))


def bring(file, kind, name, link):
    """What File > Append or Link does."""
    with bpy.data.libraries.load(str(file), link=link) as (there, here):
        assert name in getattr(there, kind)
        setattr(here, kind, [name])
    return getattr(here, kind)[0]


def stand(block, matrix):
    """Put what was brought into the scene, moved, turned and scaled."""
    if isinstance(block, bpy.types.Collection):
        obj = bpy.data.objects.new("drop", None)
        obj.instance_type, obj.instance_collection = "COLLECTION", block
    elif block.library is None:
        obj = block
    else:  # a linked object is moved by an object of this file that wears its mesh
        obj = bpy.data.objects.new("drop", block.data)
    bpy.context.scene.collection.objects.link(obj)
    obj.matrix_world = matrix
    bpy.context.view_layer.update()
    return obj


def direct(tree, matrix, number):
    """The same tree, built by us."""
    obj = link("ours", to_mesh("ours", tree.mesh))
    obj["forest_tree"], obj["forest_species"] = number, 0
    obj.matrix_world = matrix
    bpy.context.view_layer.update()


@pytest.fixture(scope="module")
def built_here(blender):
    """A tree, and what is seen and heard of it where we built it."""
    blender.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    tree = grown("hazelnut", 1)
    direct(tree, POSE, 0)
    ours = api.current()
    return tree, ours.scan(TRIPOD), ours.ping(BAT).pings[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "link"), [("objects", False), ("objects", True), ("collections", True)]
)
def test_a_tree_of_a_library_is_seen_as_the_tree_that_it_is(
    built_here, empty_blender, library, kind, link
):
    tree, cloud, echo = built_here
    assert len(cloud) > 100
    block = bring(library / "hazelnut.blend", kind, "Hazelnut 2", link)
    assert (block.library is not None) == link
    stand(block, POSE)
    theirs = api.current()
    found = theirs.scan(TRIPOD)
    # An instance's place is composed in float32: rays past edges may differ.
    assert abs(len(found) - len(cloud)) <= 0.01 * len(cloud)
    if len(found) == len(cloud):
        assert np.abs(found.points - cloud.points).max() < 1.0
        assert np.median(np.abs(found.points - cloud.points)) < 1e-6
        same = {
            name: np.mean(found.labels[name] == values) for name, values in cloud.labels.items()
        }
        assert min(same.values()) > 0.99, same
    organs = set(np.unique(found.labels["organ"]).tolist())
    assert organs == {WOOD, LEAF}
    assert set(np.unique(found.labels["tree"]).tolist()) == {0}
    assert set(np.unique(found.labels["species"]).tolist()) == {0}
    heard = theirs.ping(BAT).pings[0]
    assert heard.leaves == echo.leaves == len(tree.leaves)
    loud = np.abs(echo.spectra).max()
    assert np.abs(heard.spectra - echo.spectra).max() < 0.02 * loud

    leaves = theirs.leaves
    m = np.array(POSE)[:3]
    place = tree.leaves.centre @ m[:, :3].T + m[:, 3]
    assert np.abs(leaves["centre"] - place).max() < 5e-6
    assert np.abs(leaves["radius"] / tree.leaves.radius - 1.3).max() < 1e-5
    facing = np.einsum("li,li->l", leaves["normal"], tree.leaves.normal @ m[:, :3].T / 1.3)
    assert facing.min() > 1 - 1e-5
    assert np.array_equal(leaves["branch"], tree.leaves.branch)
    table, truth = theirs.trees, tree_truth(tree)
    assert table["species"].tolist() == ["hazelnut"]
    assert table["leaf_area_m2"][0] == pytest.approx(1.69 * truth["leaf_area_m2"], rel=1e-5)
    assert table["height_m"][0] == pytest.approx(1.3 * truth["height_m"], rel=1e-5)
    assert table["wood_volume_m3"][0] == pytest.approx(1.3**3 * truth["wood_volume_m3"], rel=1e-5)
    wood = theirs.skeleton(0)
    assert np.abs(wood["start"] - (tree.skeleton.start @ m[:, :3].T + m[:, 3])).max() < 5e-6
    assert np.abs(wood["radius"] - 1.3 * tree.skeleton.radius).max() < 1e-7
    assert np.array_equal(wood["parent"], tree.skeleton.parent)
    cylinders = theirs.cylinders
    assert len(cylinders["length"]) == len(tree.skeleton)
    assert cylinders["length"].sum() == pytest.approx(
        1.3 * np.linalg.norm(tree.skeleton.end - tree.skeleton.start, axis=1).sum(), rel=1e-5
    )


def test_each_has_a_number_and_what_a_user_numbers_stays(empty_blender, library):
    fern = bring(library / "fern.blend", "collections", "Fern 1", True)
    hazel = bring(library / "hazelnut.blend", "collections", "Hazelnut 1", True)
    for k in range(3):
        stand(fern, Matrix.Translation((k, 0, 0))).name = f"b {k}"
    first = stand(hazel, Matrix.Translation((9, 0, 0)))
    first.name = "a"
    chosen = stand(hazel, Matrix.Translation((12, 0, 0)))
    chosen["forest_tree"], chosen["forest_species"] = 40, 7
    chosen.update_tag()
    bpy.context.view_layer.update()
    table = api.current().trees
    assert table["tree"].tolist() == [40, 41, 42, 43, 44]
    assert table["x_m"].tolist() == pytest.approx([12, 9, 0, 1, 2])
    assert table["species"].tolist() == ["hazelnut"] * 2 + ["fern"] * 3
    scene = api.current().observer.geometry
    assert dict(zip(scene.tree.tolist(), scene.species.tolist(), strict=True)) == {
        40: 7,
        41: 9,
        **dict.fromkeys((42, 43, 44), 8),
    }
    assert len(scene.meshes) == 2


@pytest.mark.medium
def test_what_the_asset_browser_shows(empty_blender, library):
    listed = (library / FILE).read_text().splitlines()
    with bpy.data.libraries.load(str(library / "hazelnut.blend"), assets_only=True) as (
        there,
        here,
    ):
        here.collections = list(there.collections)
    assert sorted(there.collections) == ["Hazelnut 1", "Hazelnut 2"]
    for home in here.collections:
        about = home.asset_data
        assert f"{about.catalog_id}:Forest Sensing/Shrubs:Forest Sensing-Shrubs" in listed
        assert {"tree", "hazelnut", "shrubs"} == {tag.name for tag in about.tags}
        assert "leaves" in about.description
        assert about.author
        assert tuple(home.preview.image_size) == (256, 256)
        picture = np.array(home.preview.image_pixels_float).reshape(256, 256, 4)
        assert 0.1 < (picture[..., 3] > 0).mean() < 0.8
        rows = np.flatnonzero((picture[..., 3] > 0).any(axis=1))
        assert rows[0] < 16
        assert rows[-1] > 240
        green = picture[picture[..., 3] > 0.5, :3].mean(axis=0)
        assert green[1] > green[2]


def test_catalogs_of_others_stay(tmp_path):
    file = add_catalogs(tmp_path, ["Forest Sensing/Conifers"])
    mine = "11111111-2222-3333-4444-555555555555:Rocks:Rocks"
    file.write_text(file.read_text() + mine + "\n")
    add_catalogs(tmp_path, ["Forest Sensing/Conifers", "Forest Sensing/Shrubs"])
    lines = file.read_text().splitlines()
    assert mine in lines
    assert "VERSION 1" in lines
    assert len([line for line in lines if catalog_id("Forest Sensing/Conifers") in line]) == 1
    assert len([line for line in lines if line.endswith("Sensing-Shrubs")]) == 1


def test_leaves_of_a_stretched_tree_are_those_of_its_triangles(empty_blender):
    """Flat leaves, against measuring the mesh where it stands, also mirrored and sheared."""
    species, _ = load_species(find_species("bilberry", Path()))
    flat = species.changed(leaf=species.leaf.changed(shape="ellipse"))
    tree = grow(flat, None, stream(1, "flat"))
    mesh = to_mesh("bilberry", tree.mesh)
    write_truth(mesh, "bilberry#1", "bilberry", tree)
    shear = Matrix(((1, 0.4, 0, 0), (0, 1, 0, 0), (0, 0.2, -1.5, 0), (0, 0, 0, 1)))
    for matrix in (BENT, shear):
        obj = link("bilberry", mesh)
        obj.matrix_world = matrix
        bpy.context.view_layer.update()
        placed = api.current().observer.placed_trees
        leaves, table = placed_leaves(placed), placed_table(placed)
        world = tree.mesh.vertices @ np.array(obj.matrix_world)[:3, :3].T
        world += np.array(obj.matrix_world)[:3, 3]
        truth = measure_leaves(replace(tree.mesh, vertices=world))
        assert np.abs(leaves["centre"] - truth.centre).max() < 1e-5
        assert np.abs(leaves["radius"] / truth.radius - 1).max() < 1e-3
        facing = np.abs(np.einsum("li,li->l", leaves["normal"], truth.normal))
        assert facing.min() > 1 - 1e-4
        assert table["leaf_area_m2"][0] == pytest.approx(np.pi * (truth.radius**2).sum(), rel=1e-4)
        bpy.data.objects.remove(obj)


def test_a_file_without_such_trees_has_none(empty_blender):
    assert len(api.current().observer.placed_trees) == len(NONE) == 0
    with pytest.raises(api.SpecError, match="was not grown here"):
        _ = api.current().trees
