"""Results outlive a new forest: they are marked, and one click runs their sensors again."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.blender.sensors.objects import sensors_of
from forest_addon.ui.sensors.run import chosen_things

from ..pressing import clouds, press, run


@pytest.mark.medium
def test_results_stay_marked_until_they_are_run_again(built, tmp_path):
    run("cloud")
    run("scan")
    (points,) = [thing for thing in clouds() if thing.name == built.results["cloud"].shown]
    count = len(points.data.vertices)
    built.seed += 1
    press("build")
    assert {r.name: r.stale for r in built.results} == {
        "forest": False,
        "cloud": True,
        "scan": True,
    }
    assert len(points.data.vertices) == count  # what was found is still shown
    press("export_result", result="cloud", filepath=str(tmp_path / "before.ply"))  # and exported
    run("cloud")
    assert [r.name for r in built.results if r.stale] == ["scan"]
    assert [t.name for t in chosen_things(bpy.context.scene, "", again=True)] == ["scan"]
    assert press("run", again=True) == {"FINISHED"}
    assert not any(r.stale for r in built.results)
    assert set(built.results.keys()) == {"forest", "cloud", "scan"}  # the others were not run
    with pytest.raises(RuntimeError, match="no result is from before"):
        press("run", again=True)


@pytest.mark.slow
def test_a_click_in_the_gallery_grows_and_clears_nothing(props):
    bpy.ops.mesh.primitive_cube_add()
    mine = bpy.context.object
    press("add_sensor", kind="terrestrial")
    tripod = bpy.context.view_layer.objects.active
    assert press("start", preset="hedge-bat", grow=True) == {"FINISHED"}
    assert props.results["forest"].figures["Trees"].value
    assert mine.name in bpy.context.scene.objects
    assert tripod in sensors_of(bpy.context.scene)
    assert len(sensors_of(bpy.context.scene)) > 1
