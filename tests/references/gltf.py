"""Khronos' own glTF validator, fetched once into build/."""

import json
import shutil
import subprocess
from pathlib import Path

HOME = Path(__file__).resolve().parents[2] / "build" / "gltf-validator"
PACKAGE = HOME / "node_modules" / "gltf-validator"
WANTED = "gltf-validator@2.0.0-dev.3.10"


def validate(path: Path) -> dict | None:
    """The issues of a file; None where node or npm are missing or offline."""
    if not shutil.which("node") or not shutil.which("npm"):
        return None
    if not PACKAGE.is_dir():
        HOME.mkdir(parents=True, exist_ok=True)
        words = ["npm", "install", "--silent", "--prefix", str(HOME), WANTED]
        if subprocess.run(words, capture_output=True, timeout=900).returncode:
            return None
    script = (
        f"require({json.dumps(str(PACKAGE))})"
        ".validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[1])))"
        ".then(r => console.log(JSON.stringify(r.issues)))"
    )
    told = subprocess.run(["node", "-e", script, str(path)], capture_output=True, text=True)
    return json.loads(told.stdout)
