"""The command line of the installed extension: its jobs leave the extension and its packages in place."""

import json
import shutil
import sys
from pathlib import Path

from forest_addon.formats.raster_file import read_png

SESSION = Path(__file__).with_name("command_session.py")
SMALL = Path(__file__).parents[1] / "headless" / "small.toml"


def test_jobs_leave_the_extension_as_it_was(session, in_clean_blender, tmp_path):
    """Factory settings in a user's Blender would switch it off and remove scipy and the rest."""
    out = tmp_path / "out"
    out.mkdir()
    scene = tmp_path / "scene.toml"
    text = SMALL.read_text().split("[output]")[0] + "[output]\n"
    scene.write_text(text + "preview_size = [96, 54]\npreview_samples = 1\nleaves = false\n")
    shutil.copytree(session["enabled"], tmp_path / "resources")
    run = in_clean_blender(tmp_path, SESSION, scene, out)
    assert run.returncode == 0, run.stdout + run.stderr
    answer = json.loads((out / "answer.json").read_text())
    assert answer["codes"] == [0, 0, 0], run.stderr
    assert {"report.html", "forest.blend", "own.laz", "points.csv"} <= set(answer["files"])
    # matplotlib is not there: Blender draws, and what it cannot draw is said.
    report = (out / "report.html").read_text(encoding="utf-8")
    assert report.count("<img") == 6, "the preview, the stand and four sensors"
    assert "the curve of L(r) - r is left out" in report
    assert "-m pip install matplotlib" in report
    for name in ("stand", "cloud", "scan", "echo", "reverb", "points"):
        pixels, _ = read_png((out / f"{name}.png").read_bytes())
        assert min(pixels.shape[:2]) > 300
        assert pixels[30:-30].std() > 5, name
    before, *after = answer["seen"]
    assert before["enabled"] == [True, True]
    assert {"scipy", "laspy", "lazrs"} <= set(before["packages"]), sys.version
    assert not {"matplotlib", "pillow"} & set(before["packages"])
    assert after == [before] * 3
