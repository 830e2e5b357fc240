"""Builds assets/viewer/viewer.min.js, the turning clouds of report.html, from packaging/viewer.

Needs node and npm. three.js (MIT) draws, esbuild makes one file of it without what is not used. The file is
kept in the repository, so that nobody needs node to run the project; build it anew when viewer.js changes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "assets" / "viewer"


def main() -> int:
    if shutil.which("npm") is None:
        print("npm is needed to build the viewer; install node", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder) / "packaging" / "viewer"
        shutil.copytree(ROOT / "packaging" / "viewer", work)
        subprocess.run(["npm", "install", "--silent", "--no-audit"], cwd=work, check=True)
        subprocess.run(["npm", "run", "--silent", "build"], cwd=work, check=True)
        built = Path(folder) / "assets" / "viewer" / "viewer.min.js"
        shutil.copyfile(built, OUT / "viewer.min.js")
        shutil.copyfile(work / "node_modules" / "three" / "LICENSE", OUT / "LICENSE.three.txt")
    print(f"{OUT / 'viewer.min.js'} ({(OUT / 'viewer.min.js').stat().st_size / 1e3:.0f} kB)")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
