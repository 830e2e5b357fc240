"""Bars of a running job wherever it can be stopped, and views that are drawn once while work goes on."""

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ui.test_panels import Layout, drawn

from forest_addon.blender.jobs import Job
from forest_addon.ui.sensors.panels import FOREST_PT_sensor_data
from forest_addon.ui.shell import running


@pytest.fixture
def job(monkeypatch):
    """A job that runs, half done."""
    job = Job("Run Sensor", (None for _ in ()))
    job.label, job.share = "cloud", 0.5
    monkeypatch.setattr(running, "_current", job)
    return job


class Bars(Layout):
    """Notes progress bars, too."""

    def _inner(self, heading="", **_):
        return type(self)(self.seen)

    row = column = box = split = grid_flow = _inner

    def progress(self, factor, text):
        self.seen.append(f"[{factor:.0%}] {text}")


def test_run_row_grow_row_properties_and_status_bar_show_the_job(built, job, monkeypatch):
    monkeypatch.setattr(Layout, "progress", Bars.progress, raising=False)
    seen = drawn()
    assert seen.count("[50%] cloud 50%") == 2
    assert "All" not in seen
    thing = bpy.data.objects["cloud"]
    place = SimpleNamespace(object=thing, scene=bpy.context.scene)
    seen = []
    FOREST_PT_sensor_data.draw(SimpleNamespace(layout=Bars(seen)), place)
    assert "[50%] cloud 50%" in seen
    shown = []
    workspace = SimpleNamespace(status_text_set=shown.append)
    running.show_job(SimpleNamespace(workspace=workspace), job)
    seen = []
    shown[0](SimpleNamespace(layout=Bars(seen)), bpy.context)
    assert seen == ["Run Sensor", "[50%] cloud 50%", "", "Esc: cancel"]
    job.over = True
    assert running.how_far(job) == "Run Sensor is stopping"
