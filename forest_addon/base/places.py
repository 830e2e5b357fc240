"""Folders that come with the add-on: its root and ``assets``; and names that any folder can hold."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT / "assets"


def file_name(name: str) -> str:
    """A name as that of a file: what a folder or another system reads as more than a name is "_"."""
    return re.sub(r"[^\w .-]", "_", name)
