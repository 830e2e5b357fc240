"""Nothing of the user's is touched: a scene full of a user's objects before and after every operator.

What is compared is read from Blender's own description of its data: every property of every block that the
user has made, orphans too, of the scenes, of their view layers' collections, and what is selected, active and
in which mode. What an operator is for may differ, and is listed in ``FOR``.
"""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_collection, link
from ui.pressing import add_cube

from forest_addon.blender.scene.layout import RESULTS, SENSORS, find_part, root

from .test_hard_cases import again, arguments, home, operators, press, unclear

__all__ = ["again", "home"]  # fixtures

CHOSEN = {"active", "selected"}  # it adds or selects one object, as Blender's own operators do
FOR = {
    "add_flight": CHOSEN,
    "add_sensor": CHOSEN,
    "add_tree": CHOSEN,
    "load_scene": CHOSEN,
    "paint": CHOSEN | {"mode"},
    "scan_here": CHOSEN,
    "select_result": CHOSEN,
    "start": CHOSEN,
}
OTHER_FILE = {"new"}  # it starts another file, and Blender asks what becomes of this one
FURTHER = {  # operators whose settings decide what they do
    "run frames": ("run", {"sensor": "cloud", "frames": "RANGE", "keep": True}),
    "add_sensor reverb": ("add_sensor", {"kind": "reverb"}),
    "add_sensor mobile": ("add_sensor", {"kind": "mobile"}),
}
PASSING = {
    "objects",
    "users",
    "is_evaluated",
    "preview",
    "tag",
    "session_uid",
    "rna_type",
    "bl_rna",
}


def users_work():
    """Fill the scene with a user's own things, half of them hidden in some way; returns the blocks."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    before = set(blocks())
    top = scene.collection
    for parent in (top, root(scene), find_part(scene, RESULTS), find_part(scene, SENSORS)):
        for state in ("shown", "excluded", "hidden", "off"):
            made = add_collection(f"my {state}", parent)
            add_cube(f"my {state} thing", made)
            (way,) = (
                lc for lc in layer_collections(layer.layer_collection) if lc.collection == made
            )
            way.exclude, way.hide_viewport = state == "excluded", state == "hidden"
            made.hide_viewport = state == "off"
    for state in ("hide_viewport", "hide_render", "hide_select", "hidden", "picked", "active"):
        obj = add_cube(f"my {state}")
        if state.startswith("hide_"):
            setattr(obj, state, True)
    obj.data.materials.append(bpy.data.materials.new("mine"))
    obj.modifiers.new("mine", "SUBSURF")
    obj.location = 30, 30, 0
    obj.keyframe_insert("location", frame=1)
    bpy.data.objects["my picked"].parent = obj
    for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.collections, bpy.data.texts):
        kind.new("my orphan")
    bpy.data.images.new("my orphan", 4, 4).pixels.foreach_set(
        np.linspace(0, 1, 64, dtype=np.float32)
    )
    bpy.data.node_groups.new("my orphan", "GeometryNodeTree")
    bpy.data.objects.new("my orphan", bpy.data.meshes["my orphan"])
    bpy.data.actions.new("my orphan")
    other = bpy.data.scenes.new("my scene")
    other.collection.objects.link(obj)
    scene.camera = link("my camera", bpy.data.cameras.new("my camera"))
    scene.world = bpy.data.worlds.new("my world")
    scene.timeline_markers.new("mine", frame=2)
    scene.cursor.location, scene.cursor.rotation_euler = (3, 2, 0), (0, 0, 1)
    scene.render.filepath, scene.render.resolution_x = "//mine", 321
    scene.frame_end = 2
    scene.frame_set(1, subframe=0.25)
    for one in list(layer.objects.selected):
        one.select_set(False)
    for name in ("my picked", "my active"):
        bpy.data.objects[name].select_set(True)
    layer.objects.active = obj
    bpy.data.objects["my hidden"].hide_set(True)
    layer.update()
    return [block for block in dict.fromkeys(blocks()) if block not in before]


def blocks():
    """Every block of the file."""
    kinds = (
        getattr(bpy.data, p.identifier)
        for p in bpy.data.bl_rna.properties
        if p.type == "COLLECTION"
    )
    return [block for kind in kinds for block in kind if not isinstance(block, WINDOWS)]


WINDOWS = (bpy.types.WindowManager, bpy.types.Screen, bpy.types.WorkSpace, bpy.types.Library)


def layer_collections(top):
    yield top
    for child in top.children:
        yield from layer_collections(child)


def told(value, deep=2):
    """What Blender tells of a block or a group of settings, without what we added to it."""
    if isinstance(value, bpy.types.ID) and deep < 2:
        return value.name_full
    if not isinstance(value, bpy.types.bpy_struct):
        if hasattr(value, "keys") or type(value).__name__ == "bpy_prop_collection":
            return len(value)
        return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
    if not deep:
        return None
    said = {}
    for known in type(value).bl_rna.properties:
        name = known.identifier
        if name in PASSING or known.is_runtime or name.startswith("forest_"):
            continue
        said[name] = told(getattr(value, name), deep - 1)
    return said


def snapshot(mine):
    """Everything of the user's as it is now, by what it is of."""
    context, found = bpy.context, {}
    alive = set(blocks())
    for block, name in mine:
        found[name] = told(block) if block in alive else "gone"
        if block in alive and isinstance(block, bpy.types.Mesh):
            place = np.empty(3 * len(block.vertices), np.float32)
            block.vertices.foreach_get("co", place)
            found[f"{name} places"] = place.tobytes()
    for scene in bpy.data.scenes:
        found[f"scene {scene.name}"] = told(scene)
    scene, layer = context.scene, context.view_layer
    found["frame"] = scene.frame_current, scene.frame_subframe
    found["cursor"] = tuple(scene.cursor.location), tuple(scene.cursor.rotation_euler)
    found["mode"], found["scene"], found["layer"] = context.mode, scene.name, layer.name
    found["active"] = layer.objects.active and layer.objects.active.name
    objects = [b for b, _ in mine if b in alive and isinstance(b, bpy.types.Object)]
    found["selected"] = [t.name for t in objects if t.select_get()]
    found["seen"] = [(t.name, t.hide_get(), t.visible_get()) for t in objects]
    ours = {block for block, _ in mine}
    found["collections"] = [
        (c.collection.name, c.exclude, c.hide_viewport, c.holdout, c.indirect_only)
        for c in layer_collections(layer.layer_collection)
        if c.collection in ours or c.collection == scene.collection
    ]
    return found


CASES = {name: (name, None) for name in operators() if name not in OTHER_FILE} | FURTHER


def changes(case, folder, mine, before):
    """Press a button; returns whether it did something, and what of the user's is another then."""
    name, settings = CASES[case]
    done, words = press(name, **(arguments(name, folder) if settings is None else settings))
    after = snapshot(mine)
    allowed = FOR.get(name, set()) if done else set()
    changed = {key: difference(before[key], after.get(key)) for key in before
               if before[key] != after.get(key) and key not in allowed}  # fmt: skip
    return done, {words or case: changed} if changed else {}


def begin(again, mode):
    folder = again()
    mine = [(block, f"{type(block).__name__} {block.name_full}") for block in users_work()]
    bpy.ops.object.mode_set(mode=mode)
    return folder, mine, snapshot(mine)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # every property is read, old ones too
@pytest.mark.parametrize("case", CASES)
def test_nothing_of_the_users_is_touched(again, case):
    """Pressed once more, a button works again or says why not."""
    folder, mine, before = begin(again, "OBJECT")
    assert changes(case, folder, mine, before)[1] == {}
    name, settings = CASES[case]
    done, words = press(name, **(arguments(name, folder) if settings is None else settings))
    assert done or not unclear(words), words


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_nothing_of_the_users_is_touched_while_an_object_is_edited(again):
    """Most buttons refuse then: one file serves all of these."""
    done = True
    for case in CASES:
        if done:
            folder, mine, before = begin(again, "EDIT")
        done, changed = changes(case, folder, mine, before)
        assert changed == {}, case


def difference(one, other):
    """What differs between two snapshots of one thing."""
    if not (isinstance(one, dict) and isinstance(other, dict)):
        return one, other
    return {key: difference(one[key], other.get(key)) for key in one if one[key] != other.get(key)}
