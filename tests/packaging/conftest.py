"""The built extension, and one session of a clean Blender with it, for all tests of packaging."""

import json
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SESSION = Path(__file__).with_name("extension_session.py")
SMALL = ROOT / "tests" / "headless" / "small.toml"
OUTPUT = "[output]\npreview_size = [96, 54]\npreview_samples = 1\nleaves = false\n"
NO_NETWORK = 75  # build_extension.py's exit code


@pytest.fixture(scope="session")
def archive(once):
    (file,) = once("extension", build).glob("*.zip")
    return file


def build(out):
    """What `make extension` builds for this platform and the Blender of this Python."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    done = subprocess.run(
        [sys.executable, ROOT / "packaging/build_extension.py", "--out", out, "--python", python],
        capture_output=True,
        text=True,
        timeout=900,
    )
    if done.returncode == NO_NETWORK:
        pytest.skip(
            f"the wheels are not in wheels/ and cannot be downloaded: {done.stderr.strip()}"
        )
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def session(archive, once):
    """What extension_session.py saw."""

    def look(folder):
        """In a Blender that has nothing but what it ships."""
        scene = folder / "scene.toml"
        scene.write_text(SMALL.read_text().split("[output]")[0] + OUTPUT)
        ours = {name: value for name, value in os.environ.items() if "PYTHON" not in name}
        run = subprocess.run(
            [sys._base_executable, "-s", "-S", SESSION, archive, folder, scene],
            env=ours
            | {
                "PYTHONPATH": str(what_blender_ships(folder / "blender")),
                "BLENDER_USER_RESOURCES": str(folder / "resources"),
            },
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=900,  # bpy 4.5 hangs at exit when an operator stays registered
        )
        assert run.returncode == 0, run.stdout + run.stderr

    folder = once("session", look)
    return json.loads((folder / "answer.json").read_text()) | {"folder": folder}


def what_blender_ships(folder: Path) -> Path:
    """A folder with links to bpy and the packages it requires, and nothing else."""
    folder.mkdir()
    pending, seen = ["bpy"], set()
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        package = metadata.distribution(name)
        for top in {file.parts[0] for file in package.files} - {"..", "__pycache__"}:
            link = folder / top
            if not link.exists():
                link.symlink_to(package.locate_file(top))
        for requirement in package.requires or ():
            if "extra ==" not in requirement and "python_version <" not in requirement:
                pending.append(re.match(r"[\w.-]+", requirement)[0])
    return folder
