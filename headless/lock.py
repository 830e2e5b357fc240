"""One command at a time in a folder: a lock of the system, which goes when its holder ends, however that
comes. Whoever holds a folder also clears it of what a killed command left half written.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from forest_addon.formats.atomic import remove_abandoned
from forest_addon.spec import SpecError

from .command import LOCK


@contextmanager
def only_one(root: Path, name: str = LOCK) -> Iterator[None]:
    """Hold the folder, or what in it the lock is named for. A folder that stays empty is removed again.

    Raises
    ------
    SpecError : another command holds it; says which. The folder cannot be made or written to.
    """
    made = [folder for folder in (root, *root.parents) if not folder.is_dir()]
    empty = (root / name).is_file() and not (root / name).stat().st_size  # another's; it stays
    with _opened(root, name) as file:
        try:
            file.truncate(0)
            file.write(json.dumps({"pid": os.getpid(), "host": platform.node()}).encode())
            remove_abandoned(root)
            yield
        finally:
            file.truncate(0)
            with suppress(OSError):  # Windows removes no open file: it stays, and is taken again
                if not empty:
                    (root / name).unlink()
            with suppress(OSError):  # there is something in it
                for folder in made:
                    folder.rmdir()


MOST = 1000  # characters of a lock


def _opened(root: Path, name: str) -> IO[bytes]:
    """The lock's file, held; another that its holder has removed meanwhile does not count."""
    while True:
        try:
            root.mkdir(parents=True, exist_ok=True)
            file = open(root / name, "a+b", buffering=0)  # noqa: SIM115
        except OSError as problem:
            why = problem.strerror or problem
            raise SpecError(
                f"--out {root}", f"cannot be written to ({why}); choose another folder"
            ) from None
        taken = _take(file)
        file.seek(0)
        said = file.read(MOST).decode("utf-8", "replace")
        if not taken or (said and _holder(said) is None):
            file.close()
            holder = f"is in use by {_holder(said) or 'another command'}; wait for it, or end it"
            foreign = f"has a file {name} that is no lock of Forest Sensing; move it away"
            raise SpecError(f"--out {root}", foreign if taken else holder)
        with suppress(OSError):
            if os.path.samestat(os.fstat(file.fileno()), os.stat(root / name)):
                return file
        file.close()


def _take(file: IO[bytes]) -> bool:
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


def _holder(text: str) -> str | None:
    """The process that a lock's text names; None of a file that is no lock."""
    try:
        said = json.loads(text)
        return f"another command (process {int(said['pid'])} on {said['host']})"
    except (ValueError, KeyError, TypeError):
        return None
