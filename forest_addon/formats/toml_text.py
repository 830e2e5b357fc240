"""The text of a TOML file as plain tables; what is wrong with it in one sentence."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ..spec import SpecError
from .foreign import guarded

MOST_BYTES = 100_000_000  # minutes of reading
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
