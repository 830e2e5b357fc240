"""What a species is called: by plantings, and by people."""

from __future__ import annotations

from pathlib import Path

EDITED = "edited/"  # begins the name of a species that is edited


def title_of(species: str) -> str:
    """What people read for a preset or a species file: honda-birch is Honda Birch."""
    words = Path(species).stem.replace("-", " ").replace("_", " ").title()
    return words.replace("Abop ", "ABOP ")
