"""Makes the environment that ``make`` works in: a venv, the dependencies, a Blender that loads.

Runs under the interpreter that ``find_python.sh`` found, with the standard library only. In order:
the system libraries Blender needs, by trying to load each; the venv; uv or pip, with what it is doing on
one line and all of it in ``setup.log``; what else bpy's own file says is missing; ``import bpy``. Only then
are the stamps ``blender`` and ``ready`` written, which the Makefile compares with pyproject.toml. The kernels
in C are built meanwhile, where a compiler is; the stamp ``kernels`` says so, and without it the Makefile
fetches a compiler. Every failure is a line or two and exit code 1.
"""

from __future__ import annotations

import argparse
import ctypes
import ensurepip
import os
import re
import shutil
import subprocess
import sys
import time
import venv
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

ROOT = Path(__file__).resolve().parent.parent
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"

# What bpy links to on Linux beyond the C library -> the package that holds it, by package tool.
TOOLS = ("apt", "dnf", "pacman", "zypper")
LIBRARIES = {
    "libX11.so.6": ("libx11-6", "libX11", "libx11", "libX11-6"),
    "libXext.so.6": ("libxext6", "libXext", "libxext", "libXext6"),
    "libXrender.so.1": ("libxrender1", "libXrender", "libxrender", "libXrender1"),
    "libXfixes.so.3": ("libxfixes3", "libXfixes", "libxfixes", "libXfixes3"),
    "libXi.so.6": ("libxi6", "libXi", "libxi", "libXi6"),
    "libxkbcommon.so.0": ("libxkbcommon0", "libxkbcommon", "libxkbcommon", "libxkbcommon0"),
    "libSM.so.6": ("libsm6", "libSM", "libsm", "libSM6"),
    "libICE.so.6": ("libice6", "libICE", "libice", "libICE6"),
    "libGL.so.1": ("libgl1", "libglvnd-glx", "libglvnd", "libglvnd"),
    "libstdc++.so.6": ("libstdc++6", "libstdc++", "gcc-libs", "libstdc++6"),
}
INSTALL = {
    "apt": "apt install",
    "dnf": "dnf install",
    "pacman": "pacman -S",
    "zypper": "zypper install",
}


# Files whose dates tell make what an environment has.
STAMPS = {"bpy": ("blender",), "dev": ("blender", "ready")}
PURPOSE = {"bpy": "runs forests", "dev": "tests need"}
MEGABYTES = {"bpy": 400, "dev": 250}


class SetupError(Exception):
    """Reason for which there is no environment, in words for the person at the terminal."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Make the project's virtual environment.")
    parser.add_argument("venv", nargs="?", type=Path, default=Path(".venv"))
    parser.add_argument(
        "extra",
        nargs="?",
        choices=("bpy", "dev"),
        default="dev",
        help="bpy: all that runs, dev: and tests",
    )
    parser.add_argument(
        "--missing", action="store_true", help="only print the system packages that are missing"
    )
    options = parser.parse_args(arguments)
    try:
        if options.missing:
            print(*packages(missing_libraries(), package_tool()))
        else:
            set_up(options.venv.absolute(), options.extra)
    except SetupError as problem:
        print(problem, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    return 0


def set_up(folder: Path, extra: str) -> None:
    started = time.monotonic()
    if missing := missing_libraries():
        raise SetupError(advice(missing, package_tool()))
    python = make_venv(folder)
    stamps = [folder / name for name in STAMPS[extra]]
    for stamp in stamps:
        stamp.unlink(missing_ok=True)
    command = [str(python), str(ROOT / "packaging/build_kernels.py")]
    silent = subprocess.DEVNULL
    with subprocess.Popen(command, stdout=silent, stderr=silent) as building:
        install(python, folder / "setup.log", extra)
        load_blender(python)
    if building.returncode == 0:
        stamps.append(folder / "kernels")
    for stamp in stamps:
        stamp.write_text(f"Python {VERSION}\n")
    print(f"environment ready in {time.monotonic() - started:.0f} s")


# -- system libraries --


def missing_libraries() -> list[str]:
    if not sys.platform.startswith("linux"):
        return []  # the wheels for macOS and Windows bring what they need
    return [name for name in LIBRARIES if not loads(name)]


def loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def package_tool(os_release: str | None = None) -> str | None:
    """The package tool of this distribution, by /etc/os-release; None where it is not known."""
    if os_release is None:
        file = Path("/etc/os-release")
        os_release = file.read_text() if file.exists() else ""
    values = dict(re.findall(r'^(ID|ID_LIKE)="?([^"\n]*)', os_release, re.MULTILINE))
    families = {
        "apt": {"debian", "ubuntu"},
        "dnf": {"fedora", "rhel", "centos"},
        "pacman": {"arch"},
        "zypper": {"opensuse", "suse", "opensuse-tumbleweed", "opensuse-leap"},
    }
    names = f"{values.get('ID', '')} {values.get('ID_LIKE', '')}".split()
    return next((tool for name in names for tool in TOOLS if name in families[tool]), None)


def packages(libraries: list[str], tool: str | None) -> list[str]:
    """The packages of those libraries; a library nobody listed stands for itself."""
    if tool is None:
        return libraries
    column = TOOLS.index(tool)
    return [LIBRARIES[name][column] if name in LIBRARIES else name for name in libraries]


def advice(libraries: list[str], tool: str | None) -> str:
    listed = [name for name in libraries if name in LIBRARIES]
    if tool is None or not listed:
        return f"Blender needs system libraries that are missing: {' '.join(libraries)}"
    others = [name for name in libraries if name not in LIBRARIES]
    command = f"{INSTALL[tool]} {' '.join(packages(listed, tool))}"
    rest = f" (and what holds {' '.join(others)})" if others else ""
    return f"Blender needs system libraries that are missing; as root: {command}{rest}"


# -- the environment --


def make_venv(folder: Path) -> Path:
    """Keeps a venv of this Python that works, replaces any other, never touches a folder that is none."""
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if works(python):
        return python
    if folder.exists() and any(folder.iterdir()) and not (folder / "pyvenv.cfg").exists():
        raise SetupError(f"{folder} is not a virtual environment; choose another folder with VENV=")
    print(f"making {folder.name} with Python {VERSION} ({sys.executable})", flush=True)
    try:
        venv.create(folder, clear=True, with_pip=True, symlinks=os.name != "nt")
    except (OSError, subprocess.CalledProcessError) as problem:
        raise SetupError(f"{folder}: no virtual environment could be made: {problem}") from None
    return python


def works(python: Path) -> bool:
    test = "import sys, pip; print('%d.%d' % sys.version_info[:2])"
    try:
        answer = subprocess.run([python, "-c", test], capture_output=True, text=True)
    except OSError:
        return False
    return answer.stdout.strip() == VERSION


def install(python: Path, log: Path, extra: str) -> None:
    """Installs by uv, which takes a third of pip's time, or by pip where uv cannot be had or does not know
    where packages come from (it does not read pip's settings); all that they said is in ``log``."""
    pip = [str(python), "-m", "pip", "install", "--no-input", "--disable-pip-version-check"]
    uv = [str(python), "-m", "uv", "pip", "install", "--python", str(python)]
    if sys.dont_write_bytecode and extra == "dev":  # else what is imported is compiled, and kept
        uv.append("--compile-bytecode")
    elif not sys.dont_write_bytecode:
        pip.append("--no-compile")
    wanted = ["--editable", f"{ROOT}[{extra}]"]
    print(
        f"installing what {PURPOSE[extra]} (the first time some {MEGABYTES[extra]} MB to download)",
        flush=True,
    )
    with log.open("w", encoding="utf-8") as written:
        if follow([*pip, "uv"], written) and follow([*uv, *wanted], written):
            return
        if tuple(map(int, ensurepip.version().split(".")[:2])) >= (24, 1):
            pip.append("--progress-bar=raw")  # byte counts as lines; older pips show none
        if follow([*pip, *wanted], written):
            return
    raise SetupError(why_pip_failed(log))


def follow(command: list[str], written: TextIO) -> bool:
    """Runs an installer, with a line on what it is at; returns whether it did it."""
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        errors="replace",
    ) as installer:
        show_progress(installer.stdout or [], written)
    return installer.returncode == 0


def show_progress(lines: Iterable[str], written: TextIO) -> None:
    """One line rewritten on a terminal; elsewhere a line for each large download."""
    terminal = sys.stdout.isatty()
    package = re.compile(
        r"\s*(?:Downloading|Using cached) ([\w.]+(?:-[\w.]+?)?)(?:-\S+|\.tar\S+)? \((.*)\)"
    )
    what = ""
    for line in lines:
        if count := re.match(r"Progress (\d+) of (\d+)", line):
            if terminal and int(count[2]) > 5e6:
                status(f"{what}: {int(count[1]) / 1e6:.0f} of {int(count[2]) / 1e6:.0f} MB")
            continue
        written.write(line)
        if found := package.match(line):
            what, size = found.groups()
            if terminal:
                status(f"{what} ({size})")
            elif re.match(r"\d\d+(\.\d)? ?Mi?B", size):
                print(f"  {what} ({size})", flush=True)
        elif terminal and line.startswith("Installing collected packages:"):
            status(f"unpacking {line.count(',') + 1} packages")
    if terminal:
        status("")


def status(text: str) -> None:
    """Writes over the terminal's current line."""
    width = shutil.get_terminal_size().columns - 1
    print(f"\r\033[K{('  ' + text)[:width] if text else ''}", end="", flush=True)


def why_pip_failed(log: Path) -> str:
    text = log.read_text(encoding="utf-8")
    errors = re.findall(r"^(?:ERROR|error): (.+)", text, re.MULTILINE)
    if re.search(r"connection broken|Failed to establish|Name or service not known", text):
        reason = "the package index cannot be reached; is there a network?"
    else:
        reason = errors[-1] if errors else "see the log"
    return f"pip could not install the dependencies: {reason}\n(all of it: {log})"


# -- Blender --


def load_blender(python: Path) -> None:
    """Names libraries bpy misses beyond the list above, then imports it and what is large beside it, which
    keeps both compiled also where Python is told not to."""
    find = "import importlib.util; print(importlib.util.find_spec('bpy').origin)"
    found = subprocess.run([python, "-c", find], capture_output=True, text=True)
    if found.returncode:
        raise SetupError(
            f"bpy is not there after installing it: see {python.parent.parent / 'setup.log'}"
        )
    if missing := unresolved(found.stdout.strip()):
        raise SetupError(advice(missing, package_tool()))
    variables = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    large = "import bpy, laspy, matplotlib.figure, pyproj, scipy.interpolate, scipy.ndimage"
    loaded = subprocess.run([python, "-c", large], capture_output=True, text=True, env=variables)
    if loaded.returncode:
        reason = (loaded.stderr.strip().splitlines() or [f"it ended with {loaded.returncode}"])[-1]
        raise SetupError(f"Blender's module does not load: {reason}")


def unresolved(shared_object: str) -> list[str]:
    if not (sys.platform.startswith("linux") and shutil.which("ldd")):
        return []
    listing = subprocess.run(["ldd", shared_object], capture_output=True, text=True).stdout
    return sorted(set(re.findall(r"^\s*(\S+) => not found", listing, re.MULTILINE)))


if __name__ == "__main__":
    sys.exit(main())
