"""What is shown, told, drawn, played and exported is one state: undo, frames and reopening change it all."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.ui.results.keep import points_of
from forest_addon.ui.results.panel import endings_of, heard_of

from ..pressing import add_cube, press, run, settings_of

FINER = {
    "cloud": {"angle_step_deg": 3},
    "echo": {"max_range": 3},
}
CLOCKED = ("Time", "Checked", "Audit")


def result_of(name):
    return bpy.context.scene.forest_sensing.results[name]


def state(name, folder):
    """Everything that a user can have of a result."""
    result = result_of(name)
    assert {".npz", ".csv"} < set(endings_of(result))
    files = []
    for ending in (".npz", ".csv"):
        path = folder / f"mine{ending}"
        assert press("export_result", result=name, filepath=str(path)) == {"FINISHED"}
        files.append(path.read_bytes())
    thing, heard = points_of(result), heard_of(result)
    speaker = bpy.data.objects[name]
    return {
        "shown": None if thing is None else places(thing.data).tobytes(),
        "told": [(f.name, f.value) for f in result.figures if f.name not in CLOCKED],
        "legend": [(e.name, e.choice, tuple(e.colour)) for e in result.legend] or None,
        "drawn": result.picture.packed_file.data,
        "exported": files,
        "played": None if heard is None else (heard[0].tobytes(), heard[1]),
        "speaker": speaker.data.sound.packed_file.data if speaker.type == "SPEAKER" else None,
    }


def places(data):
    place = np.empty(3 * len(data.vertices), np.float32)
    data.attributes["position"].data.foreach_get("vector", place)
    return place


def differing(one, other):
    return [key for key in one if one[key] != other[key]]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cloud", "echo"])
def test_undo_redo_and_reopening_change_all_of_a_result(built, tmp_path, name):
    run(name)
    bpy.ops.ed.undo_push(message="first")
    first = state(name, tmp_path)
    for key, value in FINER[name].items():
        setattr(settings_of(name), key, value)
    run(name)
    bpy.ops.ed.undo_push(message="second")
    second = state(name, tmp_path)
    told = [key for key in first if first[key] is not None and key != "legend"]
    assert set(differing(first, second)) - {"legend"} == set(told)  # a legend may be the same
    bpy.ops.ed.undo()
    assert differing(state(name, tmp_path), first) == []
    bpy.ops.ed.redo()
    assert differing(state(name, tmp_path), second) == []
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "forest.blend"))
    assert differing(state(name, tmp_path), second) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scan", "echo", "reverb"])
def test_each_kept_frame_exports_its_own(built, tmp_path, name):
    """At each frame all of a result is what a run of that frame alone gives."""
    add_cube().name = "wall"
    wall = bpy.data.objects["wall"]
    wall.scale = 2, 2, 2
    for frame in (1, 2):
        wall.location = (1 - 0.5 * frame, 2, 0)
        wall.keyframe_insert("location", frame=frame)
    if name == "reverb":
        thing = bpy.data.objects[name]
        for frame in (1, 2):
            thing.location.x = frame
            thing.keyframe_insert("location", frame=frame)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 2
    alone = {}
    for frame in (1, 2):
        scene.frame_set(frame)
        run(name)
        alone[frame] = state(name, tmp_path)
    assert differing(alone[1], alone[2])
    run(name, frames="RANGE", keep=True)
    for frame in (1, 2, 1):
        scene.frame_set(frame)
        assert differing(state(name, tmp_path), alone[frame]) == []
    bpy.ops.ed.undo_push(message="kept")
    scene.frame_set(2)
    bpy.ops.ed.undo_push(message="another frame")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert differing(state(name, tmp_path), alone[scene.frame_current]) == []
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "forest.blend"))
    for frame in (2, 1):
        bpy.context.scene.frame_set(frame)
        assert differing(state(name, tmp_path), alone[frame]) == []
