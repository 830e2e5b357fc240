"""The process that has Blender loaded and makes one scene after the other: ``python -m
headless.dataset.maker``.

A line of JSON comes in on standard input for each scene, a line of JSON goes out when it is done or has
failed. When the input ends, because whoever started it has ended, however that came, so does this process.
Blender's own chatter goes to standard error.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import json
import os
import queue
import shutil
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Any, TextIO

# What no further scene would survive either; without a number: a writer that left no file.
DISK = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO),
    errno.EFBIG,
    None,
)


def main() -> None:
    """Serve until the input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever prints does not disturb the answers
    asked: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()
    from ..progress import forget_peak, held_memory, peak_memory_mb
    from .scene import Session

    session = Session(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
    _answer(answers, {"ready": os.getpid()})
    while True:
        job = json.loads(asked.get())
        forget_peak()
        answer = _serve(job, session)
        peak = (peak_memory_mb() or 0.0) * 2**20
        _answer(answers, answer | {"memory": held_memory(), "peak": peak})


def _listen(asked: queue.Queue[str]) -> None:
    for line in sys.stdin:
        asked.put(line)
    os._exit(0)


def _answer(answers: TextIO, what: dict[str, Any]) -> None:
    answers.write(json.dumps(what) + "\n")
    answers.flush()


def _serve(job: dict[str, Any], session: Any) -> dict[str, Any]:
    """Make the scene of a job, or say why not."""
    from . import disk
    from .plan import Recipe
    from .scene import make

    recipe, root = Recipe(**job["recipe"]), Path(job["root"])
    if recipe.library:
        recipe = Recipe(**{**job["recipe"], "library": tuple(recipe.library)})
    partial = None
    try:
        partial = disk.begin(root, recipe.number)
        made = make(recipe, partial, session)
        record = {
            "scene": recipe.number,
            "split": recipe.split,
            "seed": recipe.seed,
            "base": recipe.base,
            "settings": recipe.digest,
            "varied": recipe.varied,
            **made["facts"],
        }
        start = time.process_time()
        disk.finish(partial, root, record)
        seconds = made["seconds"] | {"digest": time.process_time() - start}
        return {"kind": "done", "seconds": seconds}
    except BaseException as problem:
        if partial is not None:
            shutil.rmtree(partial, ignore_errors=True)
        return {"kind": _kind(problem), "why": _words(problem)}
    finally:
        session.clear()
        gc.collect()
        if not session.served:  # modules and what they keep: no later scene need look through them
            gc.freeze()
        session.served += 1
        _give_back()


def _kind(problem: BaseException) -> str:
    """``disk``: no scene can be written; ``memory``; ``settings``; else ``fault``."""
    if isinstance(problem, OSError) and problem.errno in DISK:
        return "disk"
    if isinstance(problem, MemoryError):
        return "memory"
    return "settings" if isinstance(problem, ValueError) else "fault"


def _words(problem: BaseException) -> str:
    if isinstance(problem, MemoryError):
        return "needs more memory than there is"
    if isinstance(problem, (ValueError, OSError)):
        return str(problem)
    where = traceback.extract_tb(problem.__traceback__)[-1]
    return f"{type(problem).__name__}: {problem} ({Path(where.filename).name}:{where.lineno})"


def _give_back() -> None:
    """Have glibc return what scenes have left in pieces, so that a process does not grow by them."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).malloc_trim(0)


if __name__ == "__main__":
    main()
