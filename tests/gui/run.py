"""``make test-gui``: the built extension in a real Blender window, driven and photographed.

Builds the zip for that Blender, installs it into an empty user folder, plays the scenarios that are named,
or all, and says how every step went; pictures and steps are kept in out/gui, a folder each. Where there is no
such Blender and none can be made, it says so in one line and that is no failure.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from window import Blender, ImpossibleError, provide

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out" / "gui"
SECONDS = 1800  # for a scenario
SCENARIOS = (
    *("doors", "session", "ten_clicks", "large", "looking", "working", "planting", "road"),
    *("hovering", "randomly"),
)


def main() -> int:
    if wrong := [word for word in sys.argv[1:] if word not in SCENARIOS]:
        print(f"{wrong[0]} is no scenario; name some of {', '.join(SCENARIOS)}, or none for all")
        return 2
    shutil.rmtree(OUT, ignore_errors=True)
    try:
        blender = provide(OUT)
        archive = f"{blender.inside}/{_build(blender).name}"
    except ImpossibleError as reason:
        print(f"skipped: no Blender with a window: {reason}")
        return 0
    for name in ("drive", "install", *SCENARIOS):
        shutil.copy2(ROOT / "tests" / "gui" / f"{name}.py", OUT)
    install = (
        "-b",
        "--python-exit-code",
        "1",
        "--python",
        f"{blender.inside}/install.py",
        "--",
        archive,
    )
    for words, failure in (
        (("--command", "extension", "validate", archive), "Blender does not accept the extension"),
        (install, "the extension could not be installed or translated"),
    ):
        done = blender.run(blender.program, *words)
        if done.returncode:
            print(f"{done.stdout[-3000:]}\nFAILED: {failure}")
            return 1
    named = [name for name in SCENARIOS if name in sys.argv[1:]] or SCENARIOS
    return max([_play(blender, name) for name in named])


def _play(blender: Blender, name: str) -> int:
    """Play a scenario and say how it went; 0 if all is well."""
    try:
        played = blender.run_with_window(f"{blender.inside}/drive.py", name, SECONDS)
        log, ended = played.stdout, played.returncode == 0
    except subprocess.TimeoutExpired as late:
        log, ended = str(late.stdout), False
    left = re.search(r"^LEAVING (\S+)$", log, re.M)
    if left:
        log += f"\nFIGURE quitting meanwhile: gone after {time.time() - float(left[1]):.1f} s"
    (OUT / f"{name}.log").write_text(log, encoding="utf-8")
    return _judge(OUT / name, ended and "Traceback" not in log, log)


def _build(blender: Blender) -> Path:
    """The extension for this Blender, in the shared folder."""
    done = subprocess.run(
        [
            *(sys.executable, ROOT / "packaging" / "build_extension.py"),
            *("--out", OUT, "--python", blender.python_version()),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode:
        raise ImpossibleError(done.stderr.strip())
    return next(OUT.glob("*.zip"))


def _judge(pictures: Path, ended: bool, log: str) -> int:
    """Say how each step went; 0 if all is well."""
    noted = pictures / "steps.jsonl"
    steps = [json.loads(line) for line in noted.read_text().splitlines()] if noted.exists() else []
    for step in steps:
        print(
            f"{'ok    ' if step['passed'] else 'FAILED'} {step['seconds']:6.1f} s  {step['step']}"
        )
        if not step["passed"]:
            print(step["problem"])
    for line in log.splitlines():
        if line.startswith("FIGURE "):
            print(line.removeprefix("FIGURE "))
    passed = sum(step["passed"] for step in steps)
    if ended and steps and passed == len(steps):
        print(f"{passed} steps passed, pictures in {pictures.relative_to(ROOT)}")
        return 0
    if not steps or passed == len(steps):
        print(log[-3000:])
    print(f"FAILED: {passed} of {len(steps)} steps passed, then Blender ended")
    return 1


if __name__ == "__main__":
    sys.exit(main())
