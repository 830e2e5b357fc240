"""Ctrl-C at any moment, also while modules are imported: one line, exit code 130."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from forest_addon.spec import SpecError
from headless.interrupt import WATCHED

pytest.importorskip("bpy")
from headless import tiled

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


FOLLOWER = """
import time
from headless.interrupt import follow_starter
follow_starter()
print("here", flush=True)
time.sleep(60)
"""


@pytest.mark.parametrize("watched", [True, False])
def test_a_process_of_a_run_in_tiles_does_not_outlive_its_starter(watched):
    """Our end of its standard input closes however we end; others read theirs, or have none."""
    around = os.environ | ({WATCHED: "1"} if watched else {})
    words = [sys.executable, "-c", FOLLOWER]
    child = subprocess.Popen(words, cwd=ROOT, stdin=-1, stdout=-1, env=around)
    try:
        assert child.stdout.readline() == b"here\n"
        child.stdin.close()
        if watched:
            assert child.wait(timeout=30) == 130
        else:
            time.sleep(0.5)
            assert child.poll() is None
    finally:
        child.kill()
        child.wait()
        child.stdout.close()


@pytest.mark.skipif(os.name == "nt", reason="a shell's own signals")
@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("kill -9 $$", r"process 1 of 2 was ended by signal 9; --resume goes on"),
        (
            "echo one >&2; echo no room >&2; exit 7",
            "process 1 of 2 ended with 7: no room; --resume",
        ),
    ],
)
def test_a_worker_that_dies_is_named_with_its_last_words(tmp_path, monkeypatch, does, said):
    worker = tmp_path / "worker"
    worker.write_text(f"#!/bin/sh\n{does}\n")
    worker.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(worker))
    with pytest.raises(SpecError, match=said):
        tiled.run_by_workers(["run"], 2)
