"""A run that models no more than its sensors need: the same sound, and what was left out in words."""

import json

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.spec import Accuracy, Forest, Output, Planting, Reverb, Scene
from headless.pipeline import run_scene

QUIET = Output(goodness=False, pictures=False, blend=False, glb=False, preview=False)


@pytest.mark.slow
def test_a_clap_sounds_the_same_without_leaves(tmp_path):
    clap = Reverb(source=(-3, 3, 0.2), receiver=(9, 3, 0.2), sample_rate=8000, duration=0.1)
    bush = Planting(species="hazelnut", variants=1, expected=2, exact=True)
    full = Scene(
        seed=4, forest=Forest(size=(6, 6)), plantings=(bush,), sensors=(clap,), output=QUIET
    )
    for detail in ("full", "auto"):
        asked = full.changed(accuracy=Accuracy(detail=detail))
        run_scene(asked, tmp_path, tmp_path / detail, quiet=True)
    record = {d: json.loads((tmp_path / d / "run.json").read_text()) for d in ("full", "auto")}
    assert "chosen" not in record["full"]
    (chosen,) = record["auto"]["chosen"]
    assert (chosen["key"], chosen["bound"]) == ("detail.leaves", 0.0)
    assert "was left to auto" in (tmp_path / "auto" / "report.html").read_text()
    unique = {d: record[d]["triangles"]["unique"] for d in record}
    assert unique["auto"] < 0.8 * unique["full"]
    left_out = record["auto"]["sensors"]["reverb"].get("chosen", [])
    sounds = [(tmp_path / d / "reverb.wav").read_bytes() for d in ("full", "auto")]
    assert left_out or sounds[0] == sounds[1]
