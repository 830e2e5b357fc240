"""The rule of what a command may write: what is the user's is neither replaced nor removed.

A file is ours if the record of its folder, ``.forest-sensing.jsonl``, names it with the SHA-256 that it still
has: a line of JSON for every file that a command wrote, and which command. What a command reads it never
writes, by whatever name: links and the case of letters lead to the same file. What is not ours is replaced
only by force, which says so. Without ``keeping`` (a notebook, a file dialog that asks) whoever calls decides.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

RECORD = ".forest-sensing.jsonl"
ADVICE = "choose another --out, or --force to replace it"


class Keeper:
    """Files that one command read and wrote, and the record of those of earlier ones.

    root : the folder of its results, whose record names files below it too; None: each folder has its own.
    command : its name in the record. advice : what to do about a file that is not ours.
    """

    def __init__(
        self,
        root: Path | None,
        command: str,
        *,
        force: bool = False,
        say: Callable[[str], None] = print,
        advice: str = ADVICE,
    ) -> None:
        self._root = None if root is None else root.resolve()
        self.written: set[Path] = set()
        self._command, self._force, self._say, self._advice = command, force, say, advice
        self._read: list[os.stat_result] = []
        self._lines: dict[Path, tuple[int, list[dict[str, str]]]] = {}

    def reads(self, path: str | os.PathLike[str]) -> None:
        """Note a file, or folder, that is read; it need not be there."""
        with suppress(OSError, ValueError):
            self._read.append(os.stat(path))

    def refuse_read(self, path: Path) -> None:
        """Refuse to write to what is read.

        Raises
        ------
        SpecError : it is, perhaps by another name.
        """
        with suppress(OSError):  # it is not there, or is a link to nothing
            status = os.stat(path)
            if any(os.path.samestat(status, read) for read in self._read):
                raise _refusal(str(path), "is read by this command; choose another --out")

    def claim(self, path: Path, ours: bool = False) -> None:
        """Make sure that a file may be replaced or removed. ours : another record says that it may.

        Raises
        ------
        SpecError : it is read, is a folder, or is not ours and there is no force.
        """
        place = _place(path)
        if place in self.written or not os.path.lexists(place):
            return
        self.refuse_read(path)
        if ours or self._is_ours(place):
            return
        if place.is_dir() and not place.is_symlink():
            raise _refusal(str(path), "is a folder; choose another --out, or move it away")
        if not self._force:
            raise _refusal(str(path), f"is not what Forest Sensing wrote there; {self._advice}")
        self._say(f"--force: {path} is replaced")

    def writes(self, path: Path, content: Path) -> None:
        """Record a file that is about to have its name; ``content`` is what it will be."""
        place, said = _place(path), {"sha256": digest_of(content), "command": self._command}
        self.written.add(place)
        record = self._record_of(place)
        line = {"file": place.relative_to(record.parent).as_posix(), **said}
        if line in self._lines_of(record):
            return
        text = f"{json.dumps(line)}\n".encode()
        with open(record, "ab", buffering=0) as file:
            end = file.seek(0, os.SEEK_END)
            if file.write(text) < len(text):  # half a line would be no record
                file.truncate(end)
                raise OSError(f"{record} could not be written; is the disk full?")

    def remove_others(self) -> list[str]:
        """Remove what this command left in its folder before and did not write this time."""
        removed: list[str] = []
        root = self._root
        if root is None:
            return removed
        for line in self._lines_of(root / RECORD):
            place = _place(root / line["file"])
            is_command = line["command"] == self._command and place not in self.written
            if is_command and place.is_relative_to(root) and self._is_ours(place):
                place.unlink()
                removed.append(line["file"])
                if place.parent != root:
                    with suppress(OSError):  # there is something in it
                        place.parent.rmdir()
        return removed

    def _is_ours(self, place: Path) -> bool:
        record = self._record_of(place)
        name = place.relative_to(record.parent).as_posix()
        known = {line["sha256"] for line in self._lines_of(record) if line["file"] == name}
        return (
            bool(known) and place.is_file() and not place.is_symlink() and digest_of(place) in known
        )

    def _record_of(self, place: Path) -> Path:
        root = self._root
        inside = root is not None and place.is_relative_to(root)
        return (root if root is not None and inside else place.parent) / RECORD

    def _lines_of(self, record: Path) -> list[dict[str, str]]:
        """Lines of a record, read again where another process has added some.

        Raises
        ------
        SpecError : it is something else.
        """
        size = record.stat().st_size if record.is_file() else 0
        held = self._lines.get(record, (0, []))
        if held[0] == size:
            return held[1]
        try:
            lines = [json.loads(line) for line in record.read_text(encoding="utf-8").splitlines()]
            if not all(isinstance(line[key], str) for line in lines for key in KEYS):
                raise TypeError
        except (ValueError, KeyError, TypeError):
            raise _refusal(str(record), "is no record of Forest Sensing; move it away") from None
        self._lines[record] = (size, lines)
        return lines


KEYS = ("file", "sha256", "command")
_keeper: Keeper | None = None


@contextmanager
def keeping(keeper: Keeper) -> Iterator[Keeper]:
    """Hold everything that this process writes to the rule."""
    global _keeper
    before, _keeper = _keeper, keeper
    try:
        yield keeper
    finally:
        _keeper = before


def claim(*paths: Path, ours: bool = False) -> None:
    """Make sure that files may be replaced or removed, before hours are spent on them.

    Raises
    ------
    SpecError : one is the user's.
    """
    if _keeper is not None:
        for path in paths:
            _keeper.claim(path, ours)


def writes(path: Path, content: Path) -> None:
    """Record a file that is about to have its name."""
    if _keeper is not None:
        _keeper.writes(path, content)


def reads(paths: Iterable[str | os.PathLike[str]]) -> None:
    """Note files that are read, and so are not written."""
    if _keeper is not None:
        for path in paths:
            _keeper.reads(path)


def remove(path: Path) -> None:
    """Remove a file that is ours, if it is there.

    Raises
    ------
    SpecError : it is the user's.
    """
    claim(path)
    path.unlink(missing_ok=True)


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _refusal(path: str, problem: str) -> ValueError:
    from ..spec import SpecError  # here: Ctrl-C is listened for before what takes long is imported

    return SpecError(path, problem)


def _place(path: Path) -> Path:
    """Place of a name; links on the way to it are followed, it itself is not."""
    return path.parent.resolve() / path.name
