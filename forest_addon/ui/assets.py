"""Where what comes with the add-on is: species, scenes, languages."""

from pathlib import Path

ASSETS = Path(__file__).resolve().parents[2] / "assets"
