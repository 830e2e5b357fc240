"""Clouds outlive the session: exported from a reopened file in every format; results follow their sensors."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.results.points import ENDINGS, can_write
from forest_addon.ui.results.keep import follow_names

from ..pressing import press, run


def reopened(tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "forest.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "forest.blend"))
    return bpy.context.scene.forest_sensing


@pytest.mark.medium
def test_every_format_is_offered_and_written(built, tmp_path):
    run("cloud")
    reopened(tmp_path)
    for ending in ENDINGS:
        if can_write(ending):
            path = tmp_path / f"again{ending}"
            for labels in ("CLASS", "SPECIES", "MATERIAL"):
                press("export_result", result="cloud", filepath=str(path), labels=labels)
            assert path.stat().st_size > 100


@pytest.mark.medium
def test_points_that_were_deleted_by_hand_are_not_written(built, tmp_path):
    run("cloud")
    props = reopened(tmp_path)
    data = bpy.data.objects[props.results["cloud"].shown].data
    count = len(data.vertices)
    import bmesh

    shape = bmesh.new()
    shape.from_mesh(data)
    bmesh.ops.delete(shape, geom=list(shape.verts)[:10], context="VERTS")
    shape.to_mesh(data)
    press("export_result", result="cloud", filepath=str(tmp_path / "less.ply"))
    assert f"element vertex {count - 10}".encode() in (tmp_path / "less.ply").read_bytes()[:3000]


@pytest.mark.medium
def test_without_points_it_says_to_run_again(built, tmp_path):
    run("cloud")
    props = reopened(tmp_path)
    bpy.data.objects.remove(bpy.data.objects[props.results["cloud"].shown])
    with pytest.raises(RuntimeError, match="Run its sensor again"):
        press("export_result", result="cloud", filepath=str(tmp_path / "no.laz"))


@pytest.mark.medium
def test_a_result_follows_its_sensor(built, tmp_path):
    run("cloud")
    thing, points = bpy.data.objects["cloud"], bpy.data.objects[built.results["cloud"].shown]
    thing.name = "north tripod"
    bpy.context.view_layer.update()
    follow_names(bpy.context.scene)
    result = built.results["north tripod"]
    assert "cloud" not in built.results
    assert (result.title, result.shown, points.name) == (
        "north tripod",
        *["north-tripod points"] * 2,
    )
    press("export_result", result="north tripod", filepath=str(tmp_path / "named.laz"))
    count = len(bpy.data.objects)
    run("north tripod")  # in place of what it found before
    assert len(bpy.data.objects) == count
    assert [r.name for r in built.results if r.kind == "terrestrial"] == ["north tripod"]
