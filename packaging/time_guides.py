"""Plays the tutorials and writes what they take: ``python packaging/time_guides.py [PAGE ...]``.

A tutorial is a page of docs/guide. Its blocks of Python, and of commands (``sh``), are played in the order
in which they stand, in a folder that holds the shipped ``assets`` and a tree as STL. Each page runs in a
process of its own; its CPU time, memory and files are written below its title, and into the table of
docs/guide/tasks.md. Tests play the pages by ``play``.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GUIDE = ROOT / "docs" / "guide"
TASKS = GUIDE / "tasks.md"
PROGRAM = r"(?:\.venv/bin/python -m headless|python -m headless|forest-sensing)"
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```", re.M | re.S)
COST = re.compile(r"^\*Takes .*?\*\n", re.M | re.S)


def steps(page: Path) -> list[tuple[str, str]]:
    """Return what a page does, in order: ("python", code) and ("command", words) pairs.

    Raises
    ------
    ValueError : a line of an ``sh`` block is no command of ours.
    """
    found = []
    for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "python":
            found.append((kind, text))
            continue
        for line in re.sub(r"\\\n\s*", " ", text).splitlines():
            words = re.sub(rf"^{PROGRAM} ", "", line.strip())
            if words == line.strip():
                raise ValueError(f"{page.name}: {line!r} is not played; use another kind of block")
            found.append(("command", words))
    return found


def play(page: Path) -> None:
    """Run a page's steps in the present folder, as a reader would.

    Raises
    ------
    RuntimeError : a command ended with an error.
    """
    from headless.cli import main

    names: dict[str, object] = {}
    for number, (kind, text) in enumerate(steps(page), 1):
        if kind == "python":
            exec(compile(text, f"{page.name}, step {number}", "exec"), names)
        elif code := main(shlex.split(text, comments=True)):
            raise RuntimeError(f"{page.name}, step {number}: {text} ended with {code}")


def lay_out(folder: Path) -> None:
    """Put beside a reader what the pages name: the assets, a tree of one's own."""
    (folder / "assets").symlink_to(ROOT / "assets")
    for name in ("wood.stl", "leaves.stl"):
        (folder / name).symlink_to(ROOT / "assets" / "templates" / "hazelnut" / name)


def cost(page: Path) -> tuple[float, float, float]:
    """Return what a page takes in a process of its own: CPU seconds, GB of memory, MB of files.

    Raises
    ------
    RuntimeError : it failed.
    """
    with tempfile.TemporaryDirectory() as name:
        lay_out(Path(name))
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        words = [sys.executable, __file__, "--play", str(page)]
        process = subprocess.Popen(words, cwd=name, env=environment, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        if status:
            raise RuntimeError(f"{page.name} failed")
        files = [p for p in Path(name).rglob("*") if p.is_file() and not p.is_symlink()]
        size = sum(p.stat().st_size for p in files if "assets" not in p.relative_to(name).parts)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e6, size / 1e6


def in_words(seconds: float, memory: float, size: float) -> tuple[str, str, str]:
    """Return a cost as it is printed: to two digits, and never as less than it can be told."""
    times = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
    return times, f"{memory:.1f} GB", f"{size:.0f} MB" if size >= 1 else "below 1 MB"


def main(names: list[str]) -> None:
    """Time the pages that are named, or all, and write what they take."""
    tasks = TASKS.read_text(encoding="utf-8")
    for page in sorted(GUIDE.glob("*.md")):
        if not steps(page) or (names and page.stem not in names):
            continue
        told = in_words(*cost(page))
        print(page.stem, *told, sep="\t", flush=True)
        text = COST.sub("", page.read_text(encoding="utf-8"), count=1)
        title, rest = text.split("\n", 1)
        line = f"*Takes {told[0]} of one core, {told[1]} of memory, {told[2]} of files.*"
        page.write_text(f"{title}\n\n{line}\n\n{rest.lstrip()}", encoding="utf-8")
        row = re.compile(rf"(\|[^|\n]*\({page.name}\)[^|\n]*)\|[^\n]*")
        tasks = row.sub(lambda found, told=told: f"{found[1]}| {' | '.join(told)} |", tasks)
        TASKS.write_text(tasks, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--play"]:
        sys.path.insert(0, str(ROOT))
        play(Path(sys.argv[2]))
    else:
        main(sys.argv[1:])
