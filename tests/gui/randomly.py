"""Operators at random: ours and Blender's, with random settings, sixty from each seed; Blender lives on.

``blender -b --python randomly.py -- SEED...`` plays seeds without a window. What an operator refuses is fine;
a traceback, or Blender's end, is not.
"""

import faulthandler
import os
import random
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import bpy

COUNT = 60
SEEDS = range(1, 3)  # in a window, where each takes three minutes and more
FOLDER = Path(tempfile.mkdtemp(prefix="randomly-"))
# Asks or waits for a user, is about all files, or takes minutes.
LEFT_OUT = {
    "clear_cache",
    "make_library",
    "add_library",
    "gallery",
    "cancel",
    "run_large",
    "furnish",
}
BLENDERS = {
    "ed.undo": {},
    "ed.redo": {},
    "ed.undo_push": {"message": ["at random"]},
    "object.select_all": {"action": ["SELECT", "DESELECT", "INVERT"]},
    "object.delete": {"use_global": [False, True]},
    "object.duplicate": {"linked": [False, True]},
    "object.make_single_user": {"object": [True], "obdata": [False, True]},
    "object.hide_view_set": {},
    "object.hide_view_clear": {},
    "object.mode_set": {"mode": ["OBJECT", "EDIT"]},
    "object.modifier_add": {"type": ["SUBSURF", "ARRAY", "NODES"]},
    "object.convert": {"target": ["MESH", "CURVE"]},
    "object.join": {},
    "object.parent_set": {"type": ["OBJECT"]},
    "object.transform_apply": {},
    "mesh.primitive_monkey_add": {"location": [(0, 0, 1), (3, 2, 2)]},
    "scene.new": {"type": ["NEW", "EMPTY", "LINK_COPY", "FULL_COPY"]},
    "scene.delete": {},
    "outliner.orphans_purge": {"do_recursive": [True]},
    "wm.save_as_mainfile": {"filepath": [str(FOLDER / "a.blend"), str(FOLDER / "b.blend")]},
    "wm.open_mainfile": {"filepath": [str(FOLDER / "a.blend"), str(FOLDER / "b.blend")]},
    "screen.frame_offset": {"delta": [1, 5, -3]},
}


def ours():
    """Names of our operators that can be pressed at random."""
    known = (name for name in dir(bpy.ops.forest) if not name.startswith("_"))
    return [f"forest.{name}" for name in known if name not in LEFT_OUT]


def names():
    """Names that a text of an operator may hold: sensors, results, species, files."""
    props = bpy.context.scene.forest_sensing
    things = [obj.name for obj in bpy.context.scene.objects]
    return ["", *things, *props.results.keys(), "demo", "hazelnut", "tripod", "bat", "sonar"]


def settings_of(operator, pick):
    """Random values for some of the properties of one of our operators."""
    found = {}
    for prop in operator.get_rna_type().properties:
        name = prop.identifier
        if name == "rna_type" or prop.is_readonly:
            continue
        if name in ("filepath", "directory"):
            ending = pick.choice([".toml", ".laz", ".npz", ".wav", ".ply", ".blend", ".stl"])
            found[name] = str(FOLDER / f"file{ending}")
        elif name == "sure":
            found[name] = True
        elif pick.random() < 0.5:
            continue
        elif prop.type == "BOOLEAN" and not prop.is_array:
            found[name] = pick.random() < 0.5
        elif prop.type == "ENUM" and not prop.is_enum_flag and len(prop.enum_items):
            found[name] = pick.choice([item.identifier for item in prop.enum_items])
        elif prop.type == "STRING":
            found[name] = pick.choice(names())
        elif prop.type == "INT" and not prop.is_array:
            found[name] = pick.randint(max(prop.soft_min, -9), min(prop.soft_max, 9))
    return found


def begin():
    """An empty file with a small forest's settings and a sensor of each kind."""
    bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=False)
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    props = bpy.context.scene.forest_sensing
    props.forest.size = (6, 6)
    planting = props.plantings.add()
    planting.species, planting.variants = "hazelnut", 1
    planting.use_expected, planting.expected = True, 4
    for kind in ("terrestrial", "tractor", "sonar", "reverb"):
        bpy.ops.forest.add_sensor(kind=kind)
    for obj in bpy.context.scene.objects:
        if hasattr(obj.forest_sensor, "terrestrial"):
            obj.forest_sensor.terrestrial.angle_step_deg = 6
            obj.forest_sensor.sonar.max_range = 4
    bpy.context.scene.frame_end = 2
    bpy.ops.forest.build()


def touch(pick):
    """Change something of the scene as a user's hand does."""
    things = list(bpy.context.view_layer.objects)
    if not things:
        return
    if bpy.context.mode != "OBJECT" and pick.random() < 0.5:
        bpy.ops.object.mode_set(mode="OBJECT")
    obj = pick.choice(things)
    obj.select_set(pick.random() < 0.7)
    bpy.context.view_layer.objects.active = obj
    if pick.random() < 0.3:
        obj.location.x += pick.uniform(-1, 1)
    if pick.random() < 0.1:
        obj.name = pick.choice(["tripod", "one", "two"])


def tried(name, pick, window=False):
    """Run one operator with random settings, and say what it did."""
    room, _, verb = name.partition(".")
    operator = getattr(getattr(bpy.ops, room), verb)
    if name in BLENDERS:
        given = {key: pick.choice(values) for key, values in BLENDERS[name].items()}
    else:
        given = settings_of(operator, pick)
    print(f"  {name} {given}", flush=True)
    how = "INVOKE_DEFAULT" if window and name in ("forest.build", "forest.run") else "EXEC_DEFAULT"
    try:
        if operator.poll():
            print("   ", operator(how, **given), flush=True)
    except (RuntimeError, TypeError) as refusal:
        if "Traceback" in str(refusal):
            raise
        print("    refused:", str(refusal).strip().splitlines()[-1][:150], flush=True)


def chosen(seed):
    """Names of operators in the order of a seed, and what draws their settings."""
    pick = random.Random(seed)
    for _ in range(COUNT):
        touch(pick)
        often = ["forest.build", "forest.run", "ed.undo", "ed.redo", "wm.open_mainfile"]
        yield pick.choice(pick.choice([often, ours(), ours(), list(BLENDERS)])), pick


def scenario(steps):
    """Play seeds in a window that is drawn after each operator."""
    drive = import_module("drive")
    faulthandler.enable()
    for seed in SEEDS:
        steps.step(f"operators of seed {seed}")
        begin()
        yield 1.0  # Blender ends where a region is shown before a window has drawn the new file
        yield from drive.wait_for(drive.has_view, 20, "a view")
        yield from drive.open_tab("Forest")
        for name, pick in chosen(seed):
            window = bpy.context.window_manager.windows[0]
            area = next((area for area in window.screen.areas if area.type == "VIEW_3D"), None)
            if area is None:
                yield from drive.escape((400, 400))
                continue
            main = next(region for region in area.regions if region.type == "WINDOW")
            with bpy.context.temp_override(window=window, area=area, region=main):
                tried(name, pick, window=True)
            yield 0.05
            if pick.random() < 0.7:
                yield from drive.wait_for(drive.idle, 200, "the end of a job")


if __name__ == "__main__":
    faulthandler.enable()
    for seed in map(int, sys.argv[sys.argv.index("--") + 1 :]):
        print("SEED", seed, flush=True)
        begin()
        for name, pick in chosen(seed):
            tried(name, pick)
    print("LIVED", flush=True)
    sys.stdout.flush()
    os._exit(0)
