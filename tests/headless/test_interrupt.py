"""Ctrl-C at any moment, also while modules are imported: one line, exit code 130."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]
SCAN = """
[[plantings]]
species = "whorl-8"
variants = 1
expected = 1
exact = true
[[sensors]]
kind = "terrestrial"
angle_step_deg = 10
[output]
pictures = false
"""
WHEN = """
import os, runpy, sys

class Finger:
    def find_spec(self, name, path=None, target=None):
        if name == {moment!r}:
            os.kill(os.getpid(), 2)

sys.meta_path.insert(0, Finger())
sys.argv = ["headless", "run", {scene!r}, "--out", {out!r}]
runpy.run_module("headless", run_name="__main__", alter_sys=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "moment",
    [
        "signal",
        *("headless.cli", "headless.commands", "cattrs", "bpy", "addon_utils"),
        *("numpy._core.multiarray", "laspy"),
    ],
)
def test_ctrl_c_during_an_import(tmp_path, moment):
    text = WHEN.format(moment=moment, scene=str(tmp_path / "s.toml"), out=str(tmp_path / "o"))
    (tmp_path / "s.toml").write_text(SCAN)
    done = subprocess.run(
        [sys.executable, "-c", text],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    lines = (done.stdout + done.stderr).split("\n")
    if moment == "signal":  # the first of all
        assert (done.returncode, lines) == (-signal.SIGINT, [""])
        return
    assert done.returncode == 130, done.stderr
    assert [line for line in lines if line.startswith("interrupted; ")], lines
    assert not [line for line in lines if "Traceback" in line or "Error" in line], lines
    assert not list(tmp_path.glob("o/.*partial*"))
