"""``make test-gui``: the built extension in a real Blender window, driven and photographed.

Builds the zip for that Blender, installs it into an empty user folder, plays ``doors.py``, ``session.py`` and
``ten_clicks.py`` (those that are named, or all) and says how every step went; pictures and steps are kept in
out/gui. Where there is no such Blender and none can be made, it says so in one line and that is no failure.
"""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

from window import Blender, ImpossibleError, provide

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out" / "gui"
SECONDS = 900  # for a scenario
SCENARIOS = {  # and where their pictures are
    "doors": OUT / "doors",
    "session": OUT,
    "ten_clicks": OUT / "ten-clicks",
    "large": OUT / "large",
    "looking": OUT / "looking",
    "working": OUT / "working",
    "planting": OUT / "planting",
    "road": OUT / "road",
    "leave": OUT / "leave",
}
STARTS = 3


def main() -> int:
    shutil.rmtree(OUT, ignore_errors=True)
    try:
        blender = provide(OUT)
        archive = _build(blender)
    except ImpossibleError as reason:
        print(f"skipped: no Blender with a window: {reason}")
        return 0
    checked = blender.run(
        blender.program, "--command", "extension", "validate", f"{blender.inside}/{archive.name}"
    )
    if checked.returncode:
        print(checked.stdout[-3000:])
        print("FAILED: Blender does not accept the extension")
        return 1
    for name in ("drive", "install", "speak", *SCENARIOS):
        shutil.copy2(ROOT / "tests" / "gui" / f"{name}.py", OUT)
    installed = blender.run(
        blender.program, "-b", "--python-exit-code", "1",
        "--python", f"{blender.inside}/install.py", "--", f"{blender.inside}/{archive.name}",
    )  # fmt: skip
    (OUT / "install.log").write_text(installed.stdout, encoding="utf-8")
    if installed.returncode:
        print(installed.stdout[-3000:])
        print("FAILED: the extension could not be installed")
        return 1
    spoken = blender.run(
        blender.program, "-b", "--python-exit-code", "1", "--python", f"{blender.inside}/speak.py"
    )
    if spoken.returncode:
        print(spoken.stdout[-3000:])
        print("FAILED: the panel cannot be translated")
        return 1
    named = [name for name in SCENARIOS if name in sys.argv[1:]]
    if not named:
        print(f"starting Blender takes {_longer(blender):.2f} s longer with the add-on")
        named = [*SCENARIOS]
    return max([_play(blender, name, SCENARIOS[name]) for name in named])


def _longer(blender: Blender) -> float:
    """Seconds by which the installed add-on makes Blender start later: of medians, without a window."""
    taken: dict[str, list[float]] = {"user": [], "empty": []}
    for _ in range(STARTS):
        for folder, seconds in taken.items():
            began = time.perf_counter()
            resources = f"{blender.inside}/{folder}"
            blender.run(
                blender.program, "-b", "--python-expr", "pass", BLENDER_USER_RESOURCES=resources
            )
            seconds.append(time.perf_counter() - began)
    return statistics.median(taken["user"]) - statistics.median(taken["empty"])


def _play(blender: Blender, name: str, pictures: Path) -> int:
    """Play a scenario and say how it went; 0 if all is well."""
    try:
        played = blender.run_with_window(f"{blender.inside}/{name}.py", SECONDS)
        log, ended = played.stdout, played.returncode == 0
    except subprocess.TimeoutExpired as late:
        log, ended = str(late.stdout), False
    left = next((line for line in log.splitlines() if line.startswith("LEAVING ")), "")
    if left:
        log += (
            f"\nFIGURE quitting meanwhile: gone after {time.time() - float(left.split()[1]):.1f} s"
        )
    (OUT / f"{name}.log").write_text(log, encoding="utf-8")
    return _judge(pictures, ended, log)


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
