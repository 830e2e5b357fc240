"""Tables that take longer to make than to read, kept on the disk for the next process.

A table is a file of its own in the user's cache: where the system has such things, or where the variable
``FOREST_SENSING_CACHE`` says; ``off`` keeps none. Its name holds what it depends on, so that another version
is another file. Any number of processes may read and write at once: a file is written under a name of its
own, then renamed. One that is cut off or has changed is made anew; a cache that cannot be used is not used.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

VARIABLE = "FOREST_SENSING_CACHE"
NONE = {"", "0", "no", "off"}
SUM = 4  # bytes of CRC-32, before the array


def cache_folder() -> Path | None:
    """Folder in which tables are kept, None where none are."""
    said = os.environ.get(VARIABLE)
    if said is not None:
        return None if said.strip().lower() in NONE else Path(said).expanduser().absolute()
    try:
        home = Path.home()
    except RuntimeError:  # a user without one
        return None
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "forest-sensing"


def kept_table(name: str, version: str, make: Callable[[], np.ndarray]) -> np.ndarray:
    """The table that ``make`` makes, from the disk where it is there.

    version : all that the table depends on, in letters that a file's name can have.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    path = folder / f"{name}-{version}.table"
    table = _read(path)
    if table is None:
        table = make()
        _write(path, table)
    return table


def _read(path: Path) -> np.ndarray | None:
    try:
        with open(path, "rb") as file:
            expected, content = file.read(SUM), file.read()
        if zlib.crc32(content).to_bytes(SUM, "little") != expected:
            return None
        return np.asarray(np.load(io.BytesIO(content), allow_pickle=False))
    except (OSError, ValueError, EOFError):
        return None


def _write(path: Path, table: np.ndarray) -> None:
    held = io.BytesIO()
    np.save(held, table, allow_pickle=False)
    content = held.getvalue()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        number, partial = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.parent)
        try:
            with open(number, "wb") as file:
                file.write(zlib.crc32(content).to_bytes(SUM, "little"))
                file.write(content)
            os.replace(partial, path)
        except OSError:
            os.unlink(partial)
            raise
