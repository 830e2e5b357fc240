"""Names of species: for plantings, and for people."""

from __future__ import annotations

from pathlib import Path

EDITED = "edited/"  # begins the name of a species that is edited


def title_of(species: str) -> str:
    """Return what people read for a preset or a species file: honda-birch is Honda Birch."""
    words = Path(species).stem.replace("-", " ").replace("_", " ").title()
    return words.replace("Abop ", "ABOP ")
