"""One guard around every reader of files that others wrote.

A reader says in its own words what it knows to be wrong; whatever else a broken file sets off, from numpy's
header to Python's own limits, becomes one sentence with the file's name here. Nothing but what was meant
comes out.
"""

from __future__ import annotations

import functools
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from ..spec import SpecError
from .ownership import reads

P = ParamSpec("P")
Found = TypeVar("Found")
StrPath = str | os.PathLike[str]
LONGEST = 160  # characters of another program's words
MOST = 4_000_000_000  # bytes of a file


def guarded(
    what: str, *, key: str = "", meant: tuple[type[Exception], ...] = (), most: int = MOST
) -> Callable[[Callable[Concatenate[Path, P], Found]], Callable[Concatenate[StrPath, P], Found]]:
    """For a function that reads the file of its first argument: it raises a ``SpecError`` or what is meant.

    what : what the file should be, as in "an npy array". key : the setting that names the file, if the
    sentence should start with that. meant : errors that callers know.
    most : bytes of a file.
    """

    known: tuple[type[Exception], ...] = (SpecError, *meant)

    def around(
        read: Callable[Concatenate[Path, P], Found],
    ) -> Callable[Concatenate[StrPath, P], Found]:
        @functools.wraps(read)
        def guarded_read(path: StrPath, /, *more: P.args, **named: P.kwargs) -> Found:
            place = str(os.fspath(path))
            reads([path])
            try:
                _refuse_endless(path, most)
                return read(Path(path), *more, **named)
            except known:
                raise
            except Exception as problem:
                said = _sentence(problem, what)
                refused = SpecError(key, f"{place} {said}") if key else SpecError(place, said)
                raise refused from None

        return guarded_read

    return around


def _refuse_endless(path: StrPath, most: int) -> None:
    """Refuse what has no end, or more than any reader here should hold; what is missing is told later."""
    try:
        status = os.stat(path)
    except OSError:
        return
    kind = stat.S_IFMT(status.st_mode)
    if kind not in (stat.S_IFREG, stat.S_IFDIR):
        raise SpecError(str(path), "is a device or a pipe; name a file")
    if status.st_size > most:
        raise SpecError(
            str(path),
            f"has {status.st_size / 1e9:.1f} GB, more than the {most / 1e9:g} GB that are read; "
            "give a smaller file",
        )


def _sentence(problem: Exception, what: str) -> str:
    """Return what is wrong and what to do, without the file's name."""
    if isinstance(problem, FileNotFoundError):
        return "there is no such file; check the path"
    if isinstance(problem, IsADirectoryError):
        return f"is a folder; name {what} in it"
    if isinstance(problem, UnicodeDecodeError):
        return f"is not a text file; give {what} in UTF-8"
    if isinstance(problem, RecursionError):
        return f"is nested too deeply; give {what} that a person could read"
    if isinstance(problem, MemoryError):
        return "asks for more memory than there is; give a smaller file"
    if isinstance(problem, OSError) and problem.strerror:
        return f"cannot be read: {problem.strerror}"
    shown = "".join(c if c.isprintable() else " " for c in str(problem))[:LONGEST]
    why = " ".join(shown.split()) or type(problem).__name__
    return f"cannot be read as {what} ({why}); save it again"
