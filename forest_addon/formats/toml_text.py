"""The text of a TOML file as plain tables; what is wrong with it in one sentence.

Files of settings may say the version of Forest Sensing that they were written for, ``version`` at the top;
one that says none is read as one of this version. One of a later minor version is read, and what it says
that this version does not know is put down to that; one of a later major version is refused.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.places import version
from ..spec import SpecError
from ..spec.base import shown
from .foreign import guarded

MOST_BYTES = 100_000_000  # minutes of reading
VERSION_KEY = "version"
VERSION = re.compile(r"(\d{1,6})\.(\d{1,6})(?:\.(\d{1,6}))?")
DIGITS = re.compile(r"[0-9](?:_?[0-9]){999,}")


@guarded("a .toml file", most=MOST_BYTES)
def read_tables(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises
    ------
    SpecError : it is missing, or not TOML.
    """
    return parse_tables(path.read_text(encoding="utf-8-sig"), str(path))


def parse_tables(text: str, place: str) -> dict[str, Any]:
    """The tables of a text; ``place`` names it.

    Raises
    ------
    SpecError : it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SpecError(place, "is nested too deeply; no setting needs that") from None
    except tomllib.TOMLDecodeError as problem:
        raise SpecError(place, f"is not TOML: {problem}") from None
    except ValueError as problem:  # Python's own limit of digits; a date that is none
        raise SpecError(place, _long_number(text) or f"is not TOML: {problem}") from None


def without_version(table: Mapping[str, Any], place: str) -> tuple[dict[str, Any], str]:
    """The tables of a file without the version that it was written for, and that ("" where it says none).

    Raises
    ------
    SpecError : that is no version, or a later major one than this; names ``place``.
    """
    rest = {key: value for key, value in table.items() if key != VERSION_KEY}
    if VERSION_KEY not in table:
        return rest, ""
    written = table[VERSION_KEY]
    if not isinstance(written, str) or VERSION.fullmatch(written) is None:
        raise SpecError(place, f'version: {shown(written)} is no version; give one such as "1.0"')
    if _minor(written)[0] > _minor(version())[0]:
        told = f"was written for Forest Sensing {written} and this is {version()}; install {written} or later"
        raise SpecError(place, told)
    return rest, written


def later(written: str) -> str:
    """End of a sentence about what is wrong in a file, where that is of a later version; else nothing."""
    if not written or _minor(written) <= _minor(version()):
        return ""
    return f". The file was written for Forest Sensing {written} and this is {version()}: update it"


def _minor(text: str) -> tuple[int, int]:
    """Major and minor number of a version."""
    major, minor = text.split(".")[:2]
    return int(major), int(minor)


def _long_number(text: str) -> str | None:
    """Return where a number stands that no one can mean."""
    found = DIGITS.search(text)
    if found is None:
        return None
    line = text.count("\n", 0, found.start()) + 1
    begun = text[text.rfind("\n", 0, found.start()) + 1 : found.start()]
    key = begun.partition("=")[0].strip()
    digits = len(found[0].replace("_", ""))
    return f"line {line}: {key or 'a value'} has a number of {digits:,} digits; give a shorter one"
