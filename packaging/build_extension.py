"""Builds the Blender extension: build/forest_sensing-VERSION-PLATFORM-BLENDER.zip, for Install from Disk.

blender_manifest.toml says everything: which files go in and which wheels. For one platform
(default: this one) and each Python that a Blender has, as compiled wheels fit one alone, the declared
wheels are downloaded into wheels/ by their exact names; the repository is staged with a manifest that
names that platform and those wheels alone; Blender's own tool, which comes with bpy, builds and
validates the archive. scipy's wheel goes in without the tests that it carries, a seventh of its size:
see ``without_tests``. The kernels in C go in as a wheel of ours, as Blender's rules want compiled files:
built by ziglang for a platform that is named, by this machine's compiler otherwise; without either they
are left out, which is said. Exit code 1 with one line on failure, 75 when the package index cannot be
reached.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

import build_kernels
from write_manual import write_manual

ROOT = Path(__file__).resolve().parent.parent
WHEELS = ROOT / "wheels"
# Blender's name of a platform -> how the platform tags of its wheels look.
PLATFORMS = {
    "linux-x64": "*manylinux*_x86_64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_*_arm64",
}
# The platform tags to ask for where the manifest does not name the wheel.
TAGS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_11_0_arm64"),
}
# The Pythons of Blender: what the archive for each is called.
BLENDERS = {"3.11": "blender4.5-5.0", "3.13": "blender5.1"}
NEWEST = "cp313"  # the Python whose wheels another's stand in for
LEAN = ("scipy",)  # packages that go in without their tests
KERNELS = "forest_sensing_kernels"  # the wheel that is built here
NO_NETWORK = 75  # EX_TEMPFAIL


class BuildError(Exception):
    """Reason in one sentence for which there is no archive."""

    def __init__(self, problem: str, exit_code: int = 1) -> None:
        super().__init__(problem)
        self.exit_code = exit_code


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Build the Blender extension.")
    parser.add_argument("platform", nargs="?", choices=[*PLATFORMS, "all"])
    parser.add_argument("--out", type=Path, default=ROOT / "build", help="folder for the archive")
    parser.add_argument("--python", metavar="3.x", help="for a Blender with this Python alone")
    options = parser.parse_args(arguments)
    try:
        for platform in PLATFORMS if options.platform == "all" else [options.platform]:
            for python in [options.python] if options.python else BLENDERS:
                archive = build(platform, options.out, python)
                print(f"{archive} ({archive.stat().st_size / 1e6:.1f} MB)")
    except BuildError as problem:
        print(problem, file=sys.stderr)
        return problem.exit_code
    print(
        "In Blender: Edit > Preferences > Get Extensions > Install from Disk, or drag it into the window."
    )
    return 0


def build(named: str | None, out: Path, python: str) -> Path:
    platform = named or build_kernels.this_platform()
    if platform not in PLATFORMS:
        raise BuildError(f"no extension is made for {platform}, only for {', '.join(PLATFORMS)}")
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    text = for_python(text, python, platform)
    manifest = tomllib.loads(text)
    wheels = [wheel for wheel in manifest["wheels"] if fits(wheel, platform)]
    ours = next(wheel for wheel in wheels if KERNELS in wheel)
    try:
        wheel_of_kernels(Path(ours).name, named)
    except build_kernels.BuildError as problem:
        print(f"the extension goes without the kernels: {problem}", file=sys.stderr)
        wheels.remove(ours)
    fetch([Path(wheel).name for wheel in wheels])
    out.mkdir(parents=True, exist_ok=True)
    kind = f"{platform}-{BLENDERS.get(python, f'python{python}')}"
    archive = out / f"{manifest['id']}-{manifest['version']}-{kind}.zip"
    with tempfile.TemporaryDirectory(prefix="extension-") as folder:
        stage = Path(folder) / "stage"
        copy_repository(stage)
        write_manual(stage / "manual")
        (stage / "wheels").mkdir()
        for wheel in wheels:
            shutil.copy2(lean(WHEELS / Path(wheel).name), stage / "wheels")
        (stage / "blender_manifest.toml").write_text(
            narrow(text, manifest, platform, wheels), encoding="utf-8"
        )
        blender_tool("build", "--source-dir", stage, "--output-filepath", archive)
    blender_tool("validate", archive)
    return archive


def fits(wheel: str, platform: str) -> bool:
    tag = wheel.removesuffix(".whl").rpartition("-")[2]
    return tag == "any" or fnmatch(tag, PLATFORMS[platform])


def fetch(names: Sequence[str]) -> None:
    """Downloads the wheels of exactly these file names into wheels/, but for those that are there."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for name in names:
        if not (WHEELS / name).exists():
            project, version, *kind = name.removesuffix(".whl").split("-")
            alike.setdefault(tuple(kind), []).append(f"{project}=={version}")
    for (python, abi, tag), releases in alike.items():
        found = download(releases, python, abi, tag.split("."))
        if other := sorted(set(found) - set(names)):
            raise BuildError(
                f"the package index has {other[0]}, which the manifest does not declare"
            )


def wheel_of_kernels(name: str, named: str | None) -> None:
    """Write the wheel of the library into wheels/, built for a named platform or for this machine."""
    project, version, tag = name.removesuffix(".whl").split("-", 2)
    about = f"{project}-{version}.dist-info"
    WHEELS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=WHEELS) as folder:
        library = build_kernels.build(Path(folder), named, fetch=named is not None)
        files = {
            f"{project}/{library.name}": library.read_bytes(),
            f"{about}/LICENSE": (ROOT / "LICENSE").read_bytes(),
            f"{about}/METADATA": f"Metadata-Version: 2.4\nName: {project}\nVersion: {version}\n"
            "License-Expression: GPL-3.0-or-later\nLicense-File: LICENSE\n".encode(),
            f"{about}/WHEEL": f"Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: {tag}\n".encode(),
        }
    record = f"{about}/RECORD,,\n"
    for path, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
        record = f"{path},sha256={digest},{len(content)}\n{record}"
    with zipfile.ZipFile(WHEELS / name, "w", zipfile.ZIP_DEFLATED) as wheel:
        for path, content in (files | {f"{about}/RECORD": record.encode()}).items():
            wheel.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), content)


def lean(wheel: Path) -> Path:
    """The wheel itself, or for ``LEAN`` packages one of the same name without tests, made once."""
    if wheel.name.split("-")[0] not in LEAN:
        return wheel
    kept = WHEELS / "lean" / wheel.name
    if not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        partial = kept.with_suffix(".partial")
        without_tests(wheel, partial)
        partial.replace(kept)
    return kept


def without_tests(wheel: Path, leaner: Path) -> None:
    """Write a wheel again without the files in folders called ``tests``.

    Blender's extensions share one site-packages, so nothing goes that another could import to compute
    with. RECORD loses the lines of what goes; every other file is the same, byte for byte.
    """
    with (
        zipfile.ZipFile(wheel) as whole,
        zipfile.ZipFile(leaner, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as rest,
    ):
        for entry in whole.infolist():
            content = whole.read(entry)
            if is_test(entry.filename):
                continue
            if entry.filename.endswith(".dist-info/RECORD"):
                rows = content.decode().splitlines(keepends=True)
                content = "".join(row for row in rows if not is_test(row)).encode()
            rest.writestr(entry, content, zipfile.ZIP_DEFLATED, 6)


def is_test(path: str) -> bool:
    """Tell whether a file of a wheel, or a line of its RECORD, is in a folder of tests."""
    return "/tests/" in path


def download(releases: Sequence[str], python: str, abi: str, tags: Sequence[str]) -> list[str]:
    """Downloads the wheels of releases that fit into wheels/; returns their names."""
    wanted = " ".join(releases)
    print(f"downloading {wanted} for {python}", flush=True)
    options = ["--no-deps", "--only-binary=:all:", "--quiet", "--retries=2"]
    options += [f"--platform={tag}" for tag in tags]
    if python.startswith("cp"):
        options += [f"--python-version={python[2:]}", "--implementation=cp", f"--abi={abi}"]
    WHEELS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=WHEELS) as folder:
        pip = subprocess.run(
            [sys.executable, "-m", "pip", "download", *options, "-d", folder, *releases],
            capture_output=True,
            text=True,
        )
        if pip.returncode == 0:
            files = sorted(Path(folder).iterdir())
            return [file.rename(WHEELS / file.name).name for file in files]
    if "connection broken" in pip.stderr:
        raise BuildError(f"{wanted}: the package index cannot be reached", NO_NETWORK)
    reason = (pip.stderr.strip().splitlines() or ["pip gave no reason"])[-1]
    raise BuildError(f"{wanted} cannot be downloaded: {reason}")


def for_python(text: str, python: str, platform: str) -> str:
    """The manifest's text with the wheels of one Python; another's (3.14) stand for those of Blender's."""
    own = python in BLENDERS
    python = "cp" + python.replace(".", "")
    lines = []
    for line in text.splitlines():
        wheel = line.strip().startswith('"./wheels/') and line.strip().strip('",')
        if wheel and "-cp3" in wheel and own:
            if f"-{python}-" not in wheel:
                continue
        elif wheel and "-cp3" in wheel:
            if f"-{NEWEST}-" not in wheel or not fits(wheel, platform):
                continue
            release = "==".join(Path(wheel).name.split("-")[:2])
            have = sorted(WHEELS.glob(f"{release.replace('==', '-')}-{python}-*.whl"))
            fitting = [file.name for file in have if fits(file.name, platform)]
            name = (fitting or download([release], python, python, TAGS[platform]))[0]
            line = f'  "./wheels/{name}",'
        lines.append(line)
    return "\n".join(lines) + "\n"


def copy_repository(stage: Path) -> None:
    """All but what is large, hidden or of an installation, which may be under way; the manifest's own list
    then says what goes in."""
    large, ours = {"build", "out", "wheels"}, (".egg-info", "__pycache__")

    def left_out(folder: str, names: list[str]) -> set[str]:
        here = large if Path(folder) == ROOT else set()
        return {
            n for n in names if n.startswith((".", "_kernels.")) or n.endswith(ours) or n in here
        }

    shutil.copytree(ROOT, stage, ignore=left_out)


def narrow(text: str, manifest: dict, platform: str, wheels: list[str]) -> str:
    """The manifest's text for one platform: its `platforms` line and its wheels, one a line, alone."""
    lines = []
    for line in text.splitlines():
        entry = line.strip().rstrip(",").strip('"')
        if line.startswith("platforms = "):
            line = f'platforms = ["{platform}"]'
        if entry not in manifest["wheels"] or entry in wheels:
            lines.append(line)
    narrowed = "\n".join(lines) + "\n"
    if tomllib.loads(narrowed) != manifest | {"platforms": [platform], "wheels": wheels}:
        raise BuildError("blender_manifest.toml: keep `platforms` on one line and one wheel a line")
    return narrowed


def blender_tool(command: str, *arguments: str | Path) -> None:
    """Runs Blender's extension tool from the installed bpy (Blender itself is not loaded)."""
    bpy = importlib.util.find_spec("bpy")
    if bpy is None or bpy.origin is None:
        raise BuildError("bpy is not installed; run this through `make extension`")
    scripts = next(Path(bpy.origin).parent.glob("*/scripts"))
    tool = scripts / "addons_core/bl_pkg/cli/blender_ext.py"
    tags = scripts / "modules/_bpy_internal/extensions/tags.py"
    run = subprocess.run(
        [sys.executable, tool, command, *arguments, f"--valid-tags={tags}"],
        capture_output=True,
        text=True,
    )
    if run.returncode:
        raise BuildError(
            f"Blender's tool refuses to {command}: {(run.stdout + run.stderr).strip()}"
        )


if __name__ == "__main__":
    sys.exit(main())
