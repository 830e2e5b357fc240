"""The command ``dataset``, here or in a process of its own, what it wrote, and which processes it started."""

import contextlib
import hashlib
import io
import subprocess
import sys
from pathlib import Path

import pytest

from headless.cli import main
from headless.dataset import engine, estimate

ROOT = Path(__file__).resolve().parents[2]
PLAN = ROOT / "tests/headless/dataset/small.toml"
FIELD = PLAN.with_name("tiles.toml")


def command(*words):
    """The words of the command line, as a user types them; of a field in tiles those that go on with it."""
    kind = ["run", "--resume"] if words[0] == FIELD else ["dataset"]
    return [sys.executable, "-m", "headless", *kind, *map(str, words)]


def run(*words, **more):
    return subprocess.run(command(*words), cwd=ROOT, capture_output=True, text=True, **more)


def here(*words):
    """The command in this process, with workers of its own; a process of its own for it takes seconds."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        code = main(command(*words)[3:])
    return subprocess.CompletedProcess(words, code, "", said.getvalue())


class _Lent:
    """A Blender that does not end with who used it."""

    def __init__(self, worker):
        self.once = worker.once

    def end(self):
        pass


class Warm:
    """A worker whose Blender goes on from one command to the next; ``renew`` gives it a fresh one."""

    def __init__(self):
        self.worker = engine.Worker()

    def make(self, job):
        return self.worker.make(job)

    def stop(self):
        """Of a command that fails: its scene is made."""

    def end(self):
        """Of a command: nothing ends."""

    def renew(self):
        self.worker.end()

    def lend(self, patch):
        """Have commands of this process make their scenes by this worker."""
        patch.setattr(engine, "Worker", lambda: self)
        patch.setattr(estimate, "Worker", lambda: _Lent(self.worker))

    def run(self, *words, ends=0):
        """The command in this process, its scenes made by this worker; ends : the exit code it must have."""
        with pytest.MonkeyPatch.context() as patch:
            self.lend(patch)
            ended = here(*words)
        assert ends in (ended.returncode, None), ended.stderr
        return ended


def bytes_of(out):
    """{name: digest} of all files that are there, of scenes or of a field in tiles."""
    folder = out / "scenes" if (out / "scenes").is_dir() else out
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name[0] != "." and path.name != "run.json"
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
