"""The command ``dataset`` in a process of its own, what it wrote, and which processes it started."""

import hashlib
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PLAN = ROOT / "tests/headless/dataset/small.toml"


def command(*words):
    """The words of the command line, as a user types them."""
    return [sys.executable, "-m", "headless", "dataset", *map(str, words)]


def run(*words, **more):
    return subprocess.run(command(*words), cwd=ROOT, capture_output=True, text=True, **more)


def bytes_of(out):
    """{name within scenes/: digest} of all files that are there."""
    return {
        str(path.relative_to(out / "scenes")): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((out / "scenes").rglob("*"))
        if path.is_file()
    }


def children_of(pid):
    """{process: its command line} of all that descend from a process."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except OSError:
                continue
            parents[int(entry.name)] = (int(fields[1]), line)
    found, front = {}, {pid}
    while front:
        front = {child for child, (parent, _) in parents.items() if parent in front}
        found |= {child: parents[child][1] for child in front}
    return found
