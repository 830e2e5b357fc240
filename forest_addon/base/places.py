"""Folders that come with the add-on: its root and ``assets``."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT / "assets"
