"""The languages of the add-on: every assets/languages/LOCALE.po is one, in the format of GNU gettext.

``make words`` writes the template, build/forest_sensing.pot. A copy of it with the translations, called as
Blender calls the language (fr_FR.po), is all that a language needs.
"""

from __future__ import annotations

import json
import re

import bpy

from ...base.places import ASSETS

LANGUAGES = ASSETS / "languages"
ANY = "*"  # Blender's name for no context

Catalog = dict[tuple[str, str], str]  # translations by context and English text


def register() -> None:
    """Give Blender the catalogs."""
    files = sorted(LANGUAGES.glob("*.po"))
    catalogs = {file.stem: read_catalog(file.read_text(encoding="utf-8")) for file in files}
    bpy.app.translations.register(__name__, catalogs)


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(__name__)


def read_catalog(text: str) -> Catalog:
    """Return what a .po file translates; entries without a translation and doubtful (fuzzy) ones stay
    English.

    Raises
    ------
    ValueError : a text is not between quotation marks.
    """
    catalog: Catalog = {}
    for entry in re.split(r"\n\s*\n", text):
        lines = [line.strip() for line in entry.splitlines()]
        if any(line.startswith("#,") and "fuzzy" in line for line in lines):
            continue
        said: dict[str, str] = {}
        field = ""
        for line in lines:
            if line and not line.startswith("#"):
                word, mark, rest = line.partition('"')
                field = word.strip() or field  # a long text goes on in the next line
                said[field] = said.get(field, "") + json.loads(mark + rest)
        if said.get("msgid") and said.get("msgstr"):
            catalog[said.get("msgctxt", ANY), said["msgid"]] = said["msgstr"]
    return catalog
