"""A store of objects, such as s3://, gs:// and memory://, that finished pieces and files are copied to.

An object is there whole or not at all, nothing is renamed or locked, and two commands that copy the same
leave the same bytes. A store that holds anything is used only if ``MARK`` says that such a command began it.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

from forest_addon.formats.atomic import replacing
from forest_addon.spec import SpecError

MARK = ".forest-sensing"
OURS = "Forest Sensing: "  # and what a command makes there
FOLDERS = ("file://", "local://")


def store_of(url: str) -> Path:
    """The place that a URL means, by fsspec, as a path.

    Raises
    ------
    SpecError : it is no URL, or that of a folder; what its kind needs is not installed.
    """
    if "://" not in url or url.startswith(FOLDERS):
        raise SpecError(f"--store {url}", "is no store; write such as s3://bucket/folder")
    try:
        from upath import UPath

        place = UPath(url)
        place.fs  # noqa: B018  asks for s3fs, gcsfs, ...
    except (ImportError, ValueError) as problem:
        why = f"cannot be used ({problem}); install forest-sensing[cloud]"
        raise SpecError(f"--store {url}", why) from None
    return place


def claim_store(store: Path, what: str, goes_on: bool) -> None:
    """Mark a store as that of a command, before anything is copied to it.

    what : the command makes, such as a dataset. goes_on : another process began there.

    Raises
    ------
    SpecError : it holds what is not ours, or results of a run that this one does not go on with.
    OSError : it cannot be read or written.
    """
    try:
        mark = store / MARK
        there = mark.read_text().removeprefix(OURS) if mark.is_file() else "what no run put there"
        holds = store.is_dir() and any(True for _ in store.iterdir())
        if holds and not (there == what and goes_on):
            todo = "--resume goes on with it, or " if there == what else ""
            raise SpecError(f"--store {store}", f"holds {there}; {todo}take an empty place")
        mark.write_text(OURS + what)
    except SpecError:
        raise
    except Exception as problem:  # each kind of store has errors of its own
        raise OSError(f"{store} cannot be used ({problem})") from None


def put(folder: Path, names: Iterable[str], store: Path) -> None:
    """Copy files of a folder to the same names in a store, in this order.

    Raises
    ------
    OSError : one cannot be written.
    """
    for name in names:
        try:
            with (folder / name).open("rb") as source, (store / name).open("wb") as to:
                shutil.copyfileobj(source, to)
        except Exception as problem:  # each kind of store has errors of its own
            raise OSError(
                f"{store}/{name} cannot be written ({problem}); {folder} has it"
            ) from None


def fetch(store: Path, folder: Path, ending: str = "") -> None:
    """Copy the objects of a store whose names end so, not those of folders in it, to a folder that has them
    not yet.

    Raises
    ------
    OSError : one cannot be read.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = list(store.iterdir()) if store.is_dir() else []
        for one in there:
            if one.is_file() and one.name.endswith(ending) and not (folder / one.name).exists():
                with replacing(folder / one.name) as partial:
                    partial.write_bytes(one.read_bytes())
    except Exception as problem:
        raise OSError(f"{store} cannot be read ({problem})") from None
