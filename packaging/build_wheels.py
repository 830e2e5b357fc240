"""Builds the wheels: build/forest_sensing-VERSION-py3-none-PLATFORM.whl, for every Python of a platform.

One for each platform that packaging/build_kernels.py builds the library for (or for those named), by ziglang
from any machine. Exit code 1 with one line on failure.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
from pathlib import Path

from build_kernels import TAGS, BuildError, compiler

ROOT = Path(__file__).resolve().parent.parent


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Build the wheels of every platform.")
    parser.add_argument("platforms", nargs="*", choices=[*TAGS, []], metavar="platform")
    parser.add_argument("--out", type=Path, default=ROOT / "build", help="folder for the wheels")
    options = parser.parse_args(arguments)
    for platform in options.platforms or TAGS:
        command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "--wheel-dir"]
        tag = f"--config-settings=--build-option=--plat-name={TAGS[platform]}"
        try:
            chosen = os.environ | {"CC": shlex.join(compiler(platform, fetch=True))}
        except BuildError as problem:
            print(problem, file=sys.stderr)
            return 1
        pip = subprocess.run([*command, options.out, tag, ROOT], env=chosen)
        if pip.returncode:
            return 1
        (wheel,) = options.out.glob(f"forest_sensing-*-py3-none-{TAGS[platform]}.whl")
        print(f"{wheel} ({wheel.stat().st_size / 1e6:.1f} MB)", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
