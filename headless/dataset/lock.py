"""One command at a time in a folder: a lock of the system, which goes when its holder ends, however that
comes."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from forest_addon.spec import SpecError

NAME = ".lock"


@contextmanager
def only_one(root: Path) -> Iterator[None]:
    """Hold the folder.

    Raises
    ------
    SpecError : another command holds it; says which.
    OSError : the folder cannot be written to.
    """
    root.mkdir(parents=True, exist_ok=True)
    with open(root / NAME, "a+", encoding="utf-8") as file:
        if not _take(file):
            file.seek(0)
            raise SpecError(
                f"--out {root}", f"is in use by {_holder(file.read())}; wait for it, or end it"
            )
        file.truncate(0)
        file.write(json.dumps({"pid": os.getpid(), "host": platform.node()}))
        file.flush()
        yield


def _take(file: IO[str]) -> bool:
    try:
        import fcntl
    except ImportError:
        import msvcrt

        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _holder(text: str) -> str:
    try:
        said = json.loads(text)
        return f"another command (process {int(said['pid'])} on {said['host']})"
    except (ValueError, KeyError, TypeError):
        return "another command"
