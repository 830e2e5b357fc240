"""Species in the panel: chosen by picture, edited, saved, imported from STL, and nothing left behind."""

import builtins
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.model_tree import tree
from references.scenes import reopened

from forest_addon import spec, ui
from forest_addon.base.places import ASSETS
from forest_addon.blender.jobs import CancelledError
from forest_addon.blender.scene.assets import FILE
from forest_addon.formats.raster_file import read_png
from forest_addon.formats.stl import write_stl
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import Brought, load_species, make_library
from forest_addon.spec import SpecError
from forest_addon.ui.settings import preferences
from forest_addon.ui.settings.exchange import to_spec
from forest_addon.ui.shell import views
from forest_addon.ui.species import edit

PRESETS = sorted(path.stem for path in (ASSETS / "species").glob("*.toml"))


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder of one's own species that is only of this test."""
    folder = tmp_path / "own"
    for room in (preferences, edit):
        monkeypatch.setattr(room, "species_folder", lambda: folder)
    edit.refresh()
    yield folder
    edit.refresh()


@pytest.fixture
def planting(props, own):
    """A planting of maples."""
    planting = props.plantings.add()
    planting.species, planting.use_expected, planting.expected = "maple", True, 4
    return planting


@pytest.fixture
def model(tmp_path):
    """STL files of a model tree, in centimetres."""
    folder = tmp_path / "elm"
    folder.mkdir()
    write_stl(folder / "wood.stl", tree().wood() * 100)
    write_stl(folder / "leaves.stl", tree().leaves() * 100)
    return folder


def edited(planting):
    """The species that a planting plants, as it is edited."""
    return edit.edited_species(bpy.context.scene)[planting.species][0]


def files_of(path):
    """The STL files that a species file names, as they are found from it."""
    species = read_settings(path, spec.Species)
    named = [species.leaf.mesh]
    if species.template:
        named += [species.template.wood, species.template.leaves]
    return [(path.parent / name).resolve() for name in named if name]


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_edit_save_and_read_gives_the_preset(planting, tmp_path, name):
    preset = ASSETS / "species" / f"{name}.toml"
    planting.species = name
    assert bpy.ops.forest.edit_species() == {"FINISHED"}
    assert planting.species == f"edited/{name}.toml"
    assert edited(planting) == read_settings(preset, spec.Species)
    saved = tmp_path / "deep" / f"{name}.toml"
    assert bpy.ops.forest.save_species(filepath=str(saved)) == {"FINISHED"}
    assert planting.species == saved.as_posix()
    back, _ = load_species(saved)
    home = ASSETS / "species"
    assert edit.relocated(back, saved.parent, home) == edit.relocated(
        read_settings(preset, spec.Species), home, home
    )
    assert files_of(saved) == files_of(preset)
    assert len(bpy.context.scene.forest_sensing.edited) == 0


@pytest.mark.slow
def test_what_is_changed_is_built(small, own):
    small.plantings[0].species = "hazelnut"
    bpy.ops.forest.build()
    before = trees()
    bpy.ops.forest.edit_species()
    bpy.ops.forest.build()
    np.testing.assert_array_equal(trees(), before)  # taken as it is, it grows the same trees
    small.edited[0].settings.grammar.length *= 1.5
    bpy.ops.forest.build()
    assert trees()[:, 2].max() > 1.1 * before[:, 2].max()
    bpy.ops.forest.discard_species()
    assert small.plantings[0].species == "hazelnut"
    bpy.ops.forest.build()
    np.testing.assert_array_equal(trees(), before)


def trees():
    """(V, 3) vertices of the trees of the forest that was built."""
    meshes = sorted({m.name for m in bpy.data.meshes if m.users and "hazelnut" in m.name})
    found = [np.array([v.co for v in bpy.data.meshes[name].vertices]) for name in meshes]
    assert found
    return np.concatenate(found)


def test_parts_that_may_be_left_out_are_switched(planting):
    bpy.ops.forest.edit_species()
    settings = bpy.context.scene.forest_sensing.edited[0].settings
    settings.use_honda = True  # a tree grows in one way: the template is switched off
    assert edited(planting).honda == spec.Honda()
    assert edited(planting).template is None
    settings.honda.use_trunk_daughters = True
    settings.honda.levels.values, settings.honda.levels.weights = "2, 3", "[0.5, 1.5]"
    honda = edited(planting).honda
    assert honda.levels == spec.Discrete(values=(2, 3), weights=(0.5, 1.5))
    assert honda.trunk_daughters is not None
    settings.use_rules = True
    assert edited(planting).honda is None
    settings.rules.productions = " A -> F[+A]A : 1/2 ;; A -> FA : 1/2; "
    assert edited(planting).rules.productions == ("A -> F[+A]A : 1/2", "A -> FA : 1/2")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: setattr(s.leaf.length, "mean", -1), "maple.leaf.length: can draw"),
        (lambda s: setattr(s.honda.levels, "values", "2.5"), "must be whole numbers"),
        (lambda s: setattr(s.honda.levels, "values", "two"), "is not a list of numbers"),
        (lambda s: setattr(s.honda.levels, "values", ""), "give at least one number"),
        (lambda s: setattr(s.template, "wood", "gone.stl"), "there is no file"),
        (lambda s: setattr(s.rules, "productions", "A -> F(l"), "rules"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(planting, change, said):
    bpy.ops.forest.edit_species()
    settings = bpy.context.scene.forest_sensing.edited[0].settings
    if "whole" in said or "number" in said:
        settings.use_honda = True
    if said == "rules":
        settings.use_rules = True
    change(settings)
    with pytest.raises(RuntimeError) as problem:
        bpy.ops.forest.build()
    assert said in str(problem.value)
    assert str(problem.value).strip().count("\n") == 0


def test_each_edit_has_a_name_of_its_own(planting):
    props = bpy.context.scene.forest_sensing
    bpy.ops.forest.edit_species()
    planting.species = "maple"
    bpy.ops.forest.edit_species()
    assert [item.name for item in props.edited] == ["edited/maple.toml", "edited/maple-2.toml"]
    with pytest.raises(RuntimeError, match="being edited already"):
        bpy.ops.forest.edit_species()
    bpy.ops.forest.discard_species()
    assert [item.name for item in props.edited] == ["edited/maple.toml"]


def test_a_file_of_ones_own_is_edited_where_its_stl_files_are(planting, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    shutil.copy(ASSETS / "templates" / "hazelnut" / "wood.stl", folder / "w.stl")
    (folder / "oak.toml").write_text('name = "oak"\n[template]\nwood = "w.stl"\n')
    bpy.context.scene.forest_sensing.folder = str(folder)
    planting.species = "oak.toml"
    bpy.ops.forest.edit_species()
    _, home = edit.edited_species(bpy.context.scene)[planting.species]
    assert home == folder
    bpy.ops.forest.save_species(filepath=str(folder / "oak.toml"))
    assert planting.species == "oak.toml"
    assert files_of(folder / "oak.toml") == [folder / "w.stl"]


def test_an_exported_scene_takes_edited_species_along(planting, tmp_path):
    bpy.ops.forest.edit_species()
    scene = bpy.context.scene
    scene.forest_sensing.edited[0].settings.look.leaf = (0.5, 0.25, 0.125)
    wanted, home = edit.edited_species(scene)[planting.species]
    path = tmp_path / "stand.toml"
    bpy.ops.forest.save_scene(filepath=str(path))
    exported = read_settings(path, spec.Scene)
    (species,) = (planted.species for planted in exported.plantings)
    assert species == "stand-species/maple.toml"
    back, _ = load_species(tmp_path / species)
    assert back == edit.relocated(wanted, home, tmp_path / "stand-species")
    assert replace(exported, plantings=()) == replace(to_spec(scene), plantings=())
    bpy.ops.forest.save_scene(filepath=str(path))  # over its own
    (tmp_path / species).write_text("the user's")
    with pytest.raises(RuntimeError, match="is not what Forest Sensing wrote there"):
        bpy.ops.forest.save_scene(filepath=str(path))
    assert (tmp_path / species).read_text() == "the user's"


def test_edited_species_travel_in_the_file(planting, tmp_path):
    bpy.ops.forest.edit_species()
    wanted = edited(planting)
    reopened(tmp_path / "a.blend")
    props = bpy.context.scene.forest_sensing
    assert edited(props.plantings[0]) == wanted


# ------------------------------------------------------------------------------------------ import


@pytest.mark.slow
def test_a_tree_from_stl_is_planted_if_its_siblings_are_like_it_or_that_is_accepted(
    planting, model, own, monkeypatch
):
    for name, few in (("FEWEST", 6), ("MESHED", 2)):
        monkeypatch.setattr(f"forest_addon.growth.likeness.{name}", few)
    bpy.ops.forest.import_tree(
        directory=str(model), files=[{"name": "leaves.stl"}, {"name": "wood.stl"}]
    )
    props = bpy.context.scene.forest_sensing
    assert props.active_plantings == 1
    path = Path(props.plantings[1].species)
    assert path == own / "elm" / "elm.toml"
    _, habit = load_species(path)
    assert (habit.anatomy.order == 1).sum() == 9
    assert len(habit.anatomy.foliage.bearer) == 63
    assert path.as_posix() in [choice[0] for choice in edit.choices(props)]
    monkeypatch.setattr("forest_addon.growth.likeness.MOST_DIFFERENCE", 1e-4)
    wood = {"filepath": str(model / "wood.stl"), "directory": str(model), "height": 8}
    with pytest.raises(RuntimeError, match=r"siblings are not like the tree: .*tick Accept"):
        bpy.ops.forest.import_tree(**wood)
    assert [path.name for path in own.iterdir()] == ["elm"]
    assert len(props.plantings) == 2
    bpy.ops.forest.import_tree(**wood, accept=True)
    assert Path(props.plantings[2].species) == own / "elm-2" / "elm-2.toml"


@pytest.mark.slow
def test_a_template_of_ours_is_imported(planting, own):
    folder = ASSETS / "templates" / "hazelnut"
    wood, leaves = folder / "wood.stl", folder / "leaves.stl"
    bpy.ops.forest.make_species(wood=str(wood), leaves=str(leaves), title="hazel")
    _, ours = load_species(ASSETS / "species" / "hazelnut.toml")
    _, made = load_species(own / "hazel" / "hazel.toml")
    planted = bpy.context.scene.forest_sensing.plantings[-1].species
    drawn, _ = read_png(Path(planted).with_suffix(".png").read_bytes())
    green = (drawn[..., 1] > 1.1 * drawn[..., 2]) & (drawn[..., 1] > 1.1 * drawn[..., 0])
    assert 0.05 < green.mean() < 0.9  # leaves before paper
    assert (drawn[0] == drawn[0, 0]).mean() > 0.9  # nothing above the tree
    plain = int(edit._plain_icons()["OUTLINER_OB_CURVES"].value)
    icons = {choice[0]: choice[3] for choice in edit.choices(bpy.context.scene.forest_sensing)}
    assert icons[planted] != plain
    assert (made.anatomy.order == 1).sum() == len(ours.branches)
    assert len(made.anatomy.foliage.bearer) == sum(len(branch.leaves) for branch in ours.branches)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (["gone.stl"], "there is no file"),
        (["bad.stl"], "bad.stl"),
        (["a.stl", "b.stl"], "do not tell wood from leaves"),
        (["a.stl", "b.stl", "c.stl"], "3 files are chosen"),
    ],
)
def test_bad_files_are_one_sentence(planting, tmp_path, own, files, said):
    (tmp_path / "bad.stl").write_bytes(b"no triangles here")
    with pytest.raises(RuntimeError) as problem:
        bpy.ops.forest.import_tree(
            directory=f"{tmp_path}/",
            filepath=str(tmp_path / files[0]),
            files=[{"name": name} for name in files],
        )
    assert said in str(problem.value)
    assert str(problem.value).strip().count("\n") == 0
    assert not own.exists()
    assert len(bpy.context.scene.forest_sensing.plantings) == 1


def test_an_import_that_is_cancelled_leaves_nothing(model, own):
    def stop(done, total):
        if done == total - 1:
            raise CancelledError

    with pytest.raises(CancelledError):
        make_library(Brought(model / "wood.stl", model / "leaves.stl"), "elm", own / "elm", stop)
    assert not own.exists()


def test_names_tell_wood_from_leaves():
    wood, leaves = Path("oak_stem.stl"), Path("oak_Leaves.stl")
    assert edit.parts_of([leaves, wood]) == (wood, leaves)
    assert edit.parts_of([wood]) == (wood, None)
    with pytest.raises(SpecError):
        edit.parts_of([leaves, leaves])
    assert edit.title_from(Path("/trees/old oak/wood.stl")) == "old-oak"
    assert edit.title_from(Path("/trees/elm.stl")) == "elm"


# ---------------------------------------------------------------------------------------- pictures


def test_every_preset_has_a_small_picture():
    pictures = ASSETS / "species" / "pictures"
    assert sorted(path.stem for path in pictures.iterdir()) == PRESETS
    assert sum(path.stat().st_size for path in pictures.iterdir()) < 1e6


def test_a_picture_chooses_what_is_planted(planting):
    props = bpy.context.scene.forest_sensing
    names = [choice[0] for choice in edit.choices(props)]
    assert names == PRESETS
    for name in ("spruce", "maple"):
        props.species_picture = name
        assert planting.species == name
        assert props.species_picture == name
    planting.species = "//mine/oak.toml"
    assert props.species_picture == "//mine/oak.toml"
    planting.species = "maple"
    bpy.ops.forest.edit_species()
    assert props.species_picture == "edited/maple.toml"


def test_drawing_touches_no_file_after_the_first_time(planting, monkeypatch):
    props = bpy.context.scene.forest_sensing
    first = edit.choices(props)

    def refuse(*_, **__):
        raise AssertionError("a file was looked at")

    with monkeypatch.context() as watch:
        for owner, name in ((Path, "glob"), (Path, "is_file"), (Path, "open"), (builtins, "open")):
            watch.setattr(owner, name, refuse)
        assert edit.choices(props) == first
        props.species_picture = "spruce"
        edit.number_of(props)


def test_pictures_go_with_the_add_on(planting):
    edit.choices(bpy.context.scene.forest_sensing)
    held = views.icons()
    assert len(held)
    ui.unregister()
    try:
        assert views._icons is None
        assert len(held) == 0
    finally:
        ui.register()


def test_texts_that_buttons_point_to_never_go(props):
    """Blender copies no text of a menu that a function gives: one that went would end Blender."""
    props.plantings.add()
    text = edit.choices(props)[0][2]
    held = sys.getrefcount(text)
    edit.refresh()
    for number in range(40):
        props.plantings[0].species = f"other-{number}"
        edit.choices(props)
    assert sys.getrefcount(text) == held


# ------------------------------------------------------------------------------------------- library
# The buttons of the asset library: trees of the scene's species, and the library among Blender's own.


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A library that is only of this test; preferences as they were afterwards."""
    home = tmp_path / "library"
    for room in (preferences, edit):
        monkeypatch.setattr(room, "library_folder", lambda: home)
    yield home
    known = bpy.context.preferences.filepaths.asset_libraries
    for one in [one for one in known if one.path == str(home)]:
        known.remove(one)


@pytest.mark.slow
def test_trees_of_the_scene_become_a_library_that_blender_is_told_of(props, folder):
    known = bpy.context.preferences.filepaths.asset_libraries
    before = [one.path for one in known]
    props.plantings.add().species = "grass"
    props.plantings.add().species = "bilberry"
    blocks = len(bpy.data.meshes), len(bpy.data.materials), len(bpy.data.collections)
    assert bpy.ops.forest.make_library(variants=1) == {"FINISHED"}
    assert sorted(file.name for file in folder.iterdir()) == ["bilberry.blend", FILE, "grass.blend"]
    assert blocks == (len(bpy.data.meshes), len(bpy.data.materials), len(bpy.data.collections))
    assert [one.path for one in known] == before  # never by itself
    assert bpy.ops.forest.add_library() == {"FINISHED"}
    assert [one.path for one in known if one.name == "Forest Sensing"] == [str(folder)]
    with pytest.raises(RuntimeError, match="already"):
        bpy.ops.forest.add_library()
    with bpy.data.libraries.load(str(folder / "grass.blend"), assets_only=True) as (there, _):
        assert list(there.collections) == ["Grass 1"]


@pytest.mark.medium
def test_one_press_from_a_clean_start_makes_trees_and_adds_them(props, folder, monkeypatch):
    monkeypatch.setattr(edit, "FIRST", ("grass",))
    known = bpy.context.preferences.filepaths.asset_libraries
    assert bpy.ops.forest.add_library() == {"FINISHED"}
    assert sorted(file.name for file in folder.iterdir()) == [FILE, "grass.blend"]
    assert [one.path for one in known if one.name == "Forest Sensing"] == [str(folder)]
