"""Files that are whole or not there: written under a temporary name, then renamed.

The temporary name stands beside the final one (a rename within a folder is atomic), starts with a dot,
and keeps the ending, because some writers look at it. Whatever goes wrong while writing, a full disk or
Ctrl-C, the temporary file is removed and what had the final name before stays as it was.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .ownership import claim, writes

NUMBER = re.compile(r"\.(\d+)\.partial")  # of the process that writes

_being_written: set[Path] = set()


@contextmanager
def replacing(path: str | os.PathLike[str], ours: bool = False) -> Iterator[Path]:
    """Give a temporary path to write to; rename it to ``path`` when the block ends well.

    ours : a record of the caller's says that what is there may be replaced (see ``ownership``).

    Raises
    ------
    SpecError : what is there is the user's.
    OSError : the writer left no file, or the rename failed; ``path`` is then untouched. It names ``path``,
    not the temporary file.
    """
    final = Path(path)
    claim(final, ours=ours)
    partial = partial_of(final)
    _being_written.add(partial)
    try:
        yield partial
        if not partial.is_file() or partial.stat().st_size == 0:
            raise OSError(f"{final.name} could not be written; is the disk full?")
        with open(partial, "r+b") as written:
            os.fsync(written.fileno())
        writes(final, partial)
        os.replace(partial, final)
    except OSError as problem:
        if problem.filename is None or Path(problem.filename) != partial:
            raise
        raise type(problem)(problem.errno, problem.strerror, str(final)) from None
    finally:
        partial.unlink(missing_ok=True)
        _being_written.discard(partial)


def write_whole(path: str | os.PathLike[str], content: str | bytes, ours: bool = False) -> None:
    """Write a file, text as UTF-8, as ``replacing`` does: whole or not at all."""
    with replacing(path, ours) as partial:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)


def partial_of(path: Path) -> Path:
    """The name that this process writes a file under until it is whole."""
    # not all letters of a name that may itself be as long as the system allows
    return path.with_name(f".{path.stem[-40:]}.{os.getpid()}.partial{path.suffix}")


def remove_abandoned(folder: Path) -> None:
    """Remove what processes of this machine that are no more left half written in a folder."""
    for partial in folder.glob(".*.partial*"):
        number = NUMBER.search(partial.name)
        if number is not None and not _lives(int(number[1])):
            with suppress(OSError):
                partial.unlink()


def _lives(process: int) -> bool:
    if os.name == "nt":  # there the signal would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's
        return True
    return True


def remove_partial_files() -> None:
    """Remove what is being written at this moment, for a process that is about to end at once."""
    for partial in list(_being_written):
        partial.unlink(missing_ok=True)
