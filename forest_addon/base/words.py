"""Texts that are shown in the user's language later: English until then, with what they are made of.

Whatever is not of the panel has no catalogs of translations. ``keep`` marks a text for them and remembers its
pattern and values; the panel looks the pattern up and fills it again.
"""

from __future__ import annotations

import json
from typing import Any


class Kept(str):
    """A text in English; ``pattern`` is what the catalogs know, of ``str.format``, ``values`` fill it."""

    pattern: str
    values: dict[str, Any]

    @property
    def made_of(self) -> str:
        """Pattern and values as JSON, for files."""
        return json.dumps([self.pattern, self.values])


def keep(pattern: str, /, **values: Any) -> Kept:
    """A text that is stored, or said later, in English until then."""
    kept = Kept(pattern.format(**values) if values else pattern)
    kept.pattern, kept.values = pattern, values
    return kept
