"""Builds the library of forest_addon/kernels: beside its sources for this machine, or for another platform.

Uses $CC where it is set. For this machine otherwise the compiler that is there (cc, gcc, clang, or cl in a
developer's command prompt); without one, and for a platform by name, ziglang: a compiler that comes as a
wheel and builds for every platform, installed with --fetch where it is needed. The library needs no Python:
one file serves all. Exit code 1 with one line where nothing could be built; numpy computes then.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import os
import platform as machine
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOM = Path(__file__).resolve().parent.parent / "forest_addon" / "kernels"
SUFFIXES = {"linux": ".so", "windows": ".dll", "macos": ".dylib"}
# Blender's name of a platform -> zig's, with the oldest system that its library runs on, and a wheel's.
TARGETS = {
    "linux-x64": "x86_64-linux-gnu.2.17",
    "linux-arm64": "aarch64-linux-gnu.2.17",
    "windows-x64": "x86_64-windows-gnu",
    "macos-arm64": "aarch64-macos.11.0",
    "macos-x64": "x86_64-macos.11.0",
}
TAGS = {
    "linux-x64": "manylinux_2_17_x86_64",
    "linux-arm64": "manylinux_2_17_aarch64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_11_0_arm64",
    "macos-x64": "macosx_11_0_x86_64",
}
ZIG = "ziglang==0.17.1"
# The same sums on every machine: no fused multiply-adds, no reordering. The last two change no value; with
# them square roots and comparisons are vectorised.
STRICT = ["-std=c99", "-O3", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off"]
FLAGS = [*STRICT, "-fno-math-errno", "-fno-trapping-math", "-fvisibility=hidden"]
MSVC = ["/nologo", "/std:c11", "/O2", "/W3", "/WX", "/fp:precise", "/LD"]


class BuildError(Exception):
    """Why there is no library, in one sentence."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Build the kernels in C.")
    parser.add_argument("platform", nargs="?", choices=[*TARGETS, "all"], type=name_of)
    parser.add_argument("--out", type=Path, help="folder for the library; default: its sources'")
    parser.add_argument("--fetch", action="store_true", help="install ziglang where it is needed")
    options = parser.parse_args(arguments)
    try:
        if options.platform == "all":
            for platform in TARGETS:
                build((options.out or Path("build/kernels")) / platform, platform, options.fetch)
        else:
            build(options.out or ROOM, options.platform, options.fetch)
    except BuildError as problem:
        print(problem, file=sys.stderr)
        return 1
    return 0


def name_of(platform: str) -> str:
    """Blender's name of a platform that is given by that name or as a wheel's tag."""
    return next((name for name, tag in TAGS.items() if tag == platform), platform)


def build(folder: Path, platform: str | None, fetch: bool) -> Path:
    """Build the library for a platform (None: this machine, by its own compiler) into a folder."""
    file = folder / f"_kernels{SUFFIXES.get((platform or this_platform()).split('-')[0], '.so')}"
    folder.mkdir(parents=True, exist_ok=True)
    command = compiler(platform, fetch)
    with tempfile.TemporaryDirectory(dir=folder, prefix="building-") as scratch:
        made = Path(scratch) / file.name
        run = subprocess.run(
            compilation(command, sorted(ROOM.glob("*.c")), made),
            cwd=scratch,
            capture_output=True,
            text=True,
        )
        if run.returncode:
            said = (run.stderr + run.stdout).strip().splitlines()
            told = next((line for line in said if "error" in line), "it gave no reason")
            raise BuildError(f"the kernels were not built, {shlex.join(command)}: {told}")
        try:
            made.replace(file)
        except PermissionError:
            raise BuildError(
                f"{file} is in use: close Blender and Python, then build again"
            ) from None
    print(f"{file} (by {shlex.join(command)})", flush=True)
    return file


def this_platform() -> str:
    """Blender's name for this machine's platform."""
    system = {"Darwin": "macos"}.get(machine.system(), machine.system().lower())
    kind = machine.machine().lower()
    return f"{system}-{ {'x86_64': 'x64', 'amd64': 'x64', 'aarch64': 'arm64'}.get(kind, kind) }"


def compiler(platform: str | None, fetch: bool) -> list[str]:
    """Command of the compiler for a platform; None stands for this machine."""
    if asked := shlex.split(os.environ.get("CC", "")):
        return asked
    own = [name for name in ("cc", "gcc", "clang", "cl") if shutil.which(name)]
    if platform is None and own:
        return own[:1]
    target = TARGETS.get(platform or this_platform())
    if target and fetch and importlib.util.find_spec("ziglang") is None:
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--retries=1", ZIG]
        subprocess.run([*pip, "--disable-pip-version-check"], capture_output=True)
        importlib.invalidate_caches()
    zig = importlib.util.find_spec("ziglang")
    if target is None or zig is None or zig.origin is None:
        raise BuildError(
            "no C compiler is here, numpy computes more slowly: install gcc or clang, or"
            " `pip install ziglang`, then run packaging/build_kernels.py"
        )
    program = Path(zig.origin).with_name("zig.exe" if os.name == "nt" else "zig")
    return [str(program), "cc", f"--target={target}", "-s"]


def compilation(command: list[str], sources: list[Path], made: Path) -> list[str]:
    """Command that makes a shared library of sources; it carries the hash of all files in C of the room."""
    files = sorted(ROOM.glob("*.[ch]"))
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    named = f'KERNELS_SOURCES="{digest}"'
    inputs = [str(source) for source in sources]
    if Path(command[0]).stem.lower() == "cl":
        return [*command, *MSVC, f"/D{named}", *inputs, f"/Fe:{made}"]
    maths = [] if made.suffix == ".dll" else ["-lm", "-fPIC"]
    return [*command, *FLAGS, f"-D{named}", "-shared", *inputs, "-o", str(made), *maths]


if __name__ == "__main__":
    sys.exit(main())
