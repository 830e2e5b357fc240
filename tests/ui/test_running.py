"""When work may begin, where it goes on, and that nothing of it piles up."""

from functools import partial
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import (
    SENSORS,
    add_cube,
    counts,
    press,
)

from forest_addon.blender.jobs import Job
from forest_addon.ui import requirements, running
from forest_addon.ui.forest import build
from forest_addon.ui.sensors.run import FOREST_OT_run


@pytest.mark.parametrize("name", ["build", "run"])
def test_other_modes_are_refused_with_a_reason(built, name):
    bpy.context.view_layer.objects.active = add_cube()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="Object Mode"):
        press(name)
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("name", ["build", "run"])
def test_a_missing_package_is_named(small, name, monkeypatch):
    monkeypatch.setattr(requirements, "missing", lambda: ("scipy",))
    with pytest.raises(RuntimeError, match="scipy is missing"):
        press(name)


def test_a_job_stays_in_the_scene_that_it_was_begun_in(built):
    """Whatever the window shows meanwhile: points, figures and forest belong where the button was pressed."""
    first, second = bpy.context.scene, bpy.data.scenes.new("Second")
    for name, expected in (("build", ["forest"]), ("run", ["cloud", "forest"])):
        begun, kind = bpy.context, {"build": build.FOREST_OT_build, "run": FOREST_OT_run}[name]
        button = SimpleNamespace(sensor="cloud", frames="THIS")
        button._look = partial(FOREST_OT_run._look, button)
        work = kind.work(button, begun)
        modal = SimpleNamespace(
            _job=Job(name, work), _begun_in=(begun.scene, begun.view_layer.name), _shown="",
            _leave=lambda _: None, report=lambda *_: None,
        )  # fmt: skip
        tick, answer = SimpleNamespace(type="TIMER", value="NOTHING"), {"RUNNING_MODAL"}
        while answer == {"RUNNING_MODAL"}:
            answer = running.Working.modal(modal, bpy.context, tick)
            bpy.context.window.scene = second
        assert answer == {"FINISHED"}
        assert sorted(first.forest_sensing.results.keys()) == expected
        assert len(second.forest_sensing.results) == len(second.objects) == 0
        bpy.context.window.scene = first


def test_a_job_whose_scene_is_removed_says_so(built):
    scene, said = bpy.data.scenes.new("Second"), []
    modal = SimpleNamespace(
        _job=Job("Build", (None for _ in ())), _begun_in=(scene, scene.view_layers[0].name),
        _leave=lambda _: None, report=lambda _, words: said.append(words),
    )  # fmt: skip
    bpy.data.scenes.remove(scene)
    tick = SimpleNamespace(type="TIMER", value="NOTHING")
    assert running.Working.modal(modal, bpy.context, tick) == {"CANCELLED"}
    assert said == ["The scene was removed or undone meanwhile; run it again"]


def test_everything_twice_nothing_piles_up(small):
    def everything():
        assert press("build") == {"FINISHED"}
        assert press("run") == {"FINISHED"}

    everything()
    everything()
    before = counts()
    everything()
    assert counts() == before
    assert sorted(result.name for result in small.results) == sorted(["forest", *SENSORS])
