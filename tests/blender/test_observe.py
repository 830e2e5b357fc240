"""Every sensor looks at the evaluated scene: a moved tree or a modifier changes what it finds."""

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.read.depsgraph import TREE_KEY
from forest_addon.blender.scene.forest import build
from forest_addon.blender.scene.layout import ROOT, TREES, part, root
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.library import load_species
from forest_addon.sensing.sonar.ping import leaf_discs
from forest_addon.stand.forest import grow_forest, leaf_table

SCENE = spec.Scene(
    seed=11,
    forest=spec.Forest(size=(4.0, 4.0), margin=10.0),
    plantings=(spec.Planting(species="hazelnut", variants=1, expected=2),),
    sensors=(
        spec.Tractor(
            position=(-3.0, 0.0, 1.0), track=4.0, step=0.1, angle_step_deg=1.0, reach=8.0, top=4.0
        ),
        spec.Terrestrial(position=(-3.0, 2.0, 1.2), angle_step_deg=3.0),
        spec.Sonar(position=(-3.0, 2.0, 1.2), beam_width_deg=(70.0, 70.0), cull=0.01),
        spec.Reverb(
            source=(-4.0, 2.0, 0.2), receiver=(8.0, 2.0, 0.2), sample_rate=8000, duration=0.1
        ),
    ),
)


@pytest.fixture(scope="module")
def grown():
    species = load_species(ASSETS / "species" / "hazelnut.toml")
    forest = grow_forest(SCENE, [species])
    assert len(forest.stand) > 0
    return forest


@pytest.fixture
def trees(grown, empty_blender):
    build(bpy.context.scene, SCENE, grown)
    return list(part(bpy.context.scene, TREES).all_objects)


def look():
    """What each sensor of the scene finds, as one array each."""
    bpy.context.view_layer.update()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    tractor, terrestrial, sonar, reverb = (observer.observe(s, SCENE) for s in SCENE.sensors)
    return {
        "tractor": tractor.distance,
        "terrestrial": terrestrial.position,
        "sonar": sonar.impulse_response,
        "reverb": reverb.trees,
    }


def differ(before, after):
    return {
        name
        for name in before
        if before[name].shape != after[name].shape
        or not np.allclose(before[name], after[name], rtol=1e-9, atol=0)
    }


@pytest.mark.slow
def test_nothing_changes_by_itself(trees):
    assert differ(look(), look()) == set()


@pytest.mark.slow
def test_a_moved_tree_is_seen_and_heard(trees):
    before = look()
    trees[0].location.x += 1.0
    assert differ(before, look()) == {"tractor", "terrestrial", "sonar", "reverb"}


@pytest.mark.slow
def test_a_bent_tree_is_seen_and_heard(trees):
    before = look()
    modifier = trees[0].modifiers.new("Wind", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.deform_axis, modifier.angle = "BEND", "X", 0.6
    assert differ(before, look()) == {"tractor", "terrestrial", "sonar", "reverb"}


@pytest.mark.medium
def test_a_hidden_forest_is_neither_seen_nor_heard(trees):
    for tree in trees:
        tree.hide_viewport = True
    found = look()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    assert set(observer.observe(SCENE.sensors[2], SCENE).heard.kind) <= {"facet"}  # the ground
    assert not found["reverb"].any()


@pytest.mark.slow
def test_a_wall_of_the_users_own_is_seen_and_blocks_the_direct_sound(trees):
    before = look()
    bpy.ops.mesh.primitive_cube_add(size=2, location=(6.0, 2.0, 0.0), scale=(0.1, 3, 2))
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    reverb = observer.observe(SCENE.sensors[3], SCENE)
    assert not reverb.direct_clear
    assert "tractor" in differ(before, look())


@pytest.mark.medium
def test_truth_and_evaluated_leaves_agree(trees, grown):
    bpy.context.view_layer.update()
    discs = leaf_discs(Observer(bpy.context.evaluated_depsgraph_get()).geometry)
    truth = leaf_table(grown)
    ours = np.lexsort((discs.leaf, discs.tree))
    theirs = np.lexsort((truth["leaf"], truth["tree"]))
    # Blender stores float32: a few micrometres at these coordinates.
    assert np.abs(discs.centre[ours] - truth["centre"][theirs]).max() < 5e-6
    assert discs.radius[ours] == pytest.approx(truth["radius"][theirs], rel=1e-4)
    cosine = np.einsum("li,li->l", discs.normal[ours], truth["normal"][theirs])
    assert np.abs(np.abs(cosine) - 1).max() < 1e-4


def test_building_again_replaces_the_forest_and_leaves_nothing_behind(trees, grown):
    def counts():
        kinds = (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.collections)
        return [len(kind) for kind in kinds]

    before = counts()
    keep = bpy.data.collections.new("Forest of my own")
    bpy.context.scene.collection.children.link(keep)
    for _ in range(2):
        build(bpy.context.scene, SCENE, grown)
    after = counts()
    assert after == [*before[:3], before[3] + 1]
    assert root(bpy.context.scene).name == ROOT
    assert keep.name == "Forest of my own"


def test_objects_say_which_tree_they_are(trees, grown):
    assert sorted(tree[TREE_KEY] for tree in trees) == grown.stand.id.tolist()


@pytest.mark.medium
def test_speakers_empties_and_cameras_are_ends_where_they_are(trees):
    """Also one that follows another object; each channel as if its places were typed."""
    scene = bpy.context.scene
    boat = bpy.data.objects.new("Boat", bpy.data.speakers.new("Boat"))
    ear, eye = (
        bpy.data.objects.new(n, d) for n, d in (("Ear", None), ("Eye", bpy.data.cameras.new("E")))
    )
    for thing in (boat, ear, eye):
        scene.collection.objects.link(thing)
    boat.location, ear.location, eye.location = (-4, 2, 0.25), (8, 2, 0.25), (1, 0, 0.125)
    eye.parent = ear
    bpy.context.view_layer.update()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    typed = replace(SCENE.sensors[3], source=(-4.0, 2.0, 0.25), receiver=(8.0, 2.0, 0.25))
    named = replace(typed, source_objects="Boat", receiver_objects="Ear, Eye")
    found = observer.observe(named, SCENE)
    names = [channel.channel for channel in found.channels]
    assert names == [f"{s} to {r}" for s in ("source", "Boat") for r in ("receiver", "Ear", "Eye")]
    assert np.array_equal(found.channels[4].samples, observer.observe(typed, SCENE).samples)
    assert found.channels[5].direct_delay == pytest.approx(
        np.hypot(13, 0.125) / SCENE.air.speed(), rel=1e-6
    )
    with pytest.raises(spec.SpecError, match='no Speaker, Empty or Camera "Tree"'):
        observer.observe(replace(typed, source_objects="Tree"), SCENE)


@pytest.mark.medium
def test_stems_sound_without_being_there(trees):
    """None of them covers an end, and nothing is added to Blender's scene."""
    before = len(bpy.data.objects)
    reverb = SCENE.sensors[3]
    settings = replace(SCENE, stems=(spec.Stems(count=300, radius=spec.Normal(mean=0.05)),))
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    bare, full = observer.observe(reverb, SCENE), observer.observe(reverb, settings)
    assert (full.trunks, full.clamped) == (bare.trunks + 300, 0)
    assert full.direct_clear
    assert len(bpy.data.objects) == before
    inside = replace(reverb, receiver=(2.0, 2.0, 0.2))
    assert observer.observe(inside, settings).clamped == 0


@pytest.mark.medium
def test_a_measured_directivity_is_found_beside_the_scene_file(trees, tmp_path):
    (tmp_path / "mute.csv").write_text("deg,1000\n0,-inf\n180,-inf\n")
    reverb = replace(SCENE.sensors[3], directivity="measured", directivity_file="mute.csv")
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    assert not observer.observe(reverb, SCENE, folder=tmp_path).samples.any()
