"""Words in the user's language: texts are English in the code, and Blender's catalogs translate them.

Blender itself looks up the name and help of a class or property, and what a call has as plain text:
``label(text="Images")``. What it cannot look up has values in it, or is on its way to where it is read.
``say`` and ``label`` look up the pattern and fill it then. What a file keeps stays English: ``keep`` notes
what a text is made of, ``label_of_kept`` says it in the language of whoever opens the file; ``say_kept`` and
``label_kept`` say what came from rooms that have no catalogs.

Every assets/languages/LOCALE.po is a language, in the format of GNU gettext. ``make words`` writes the
template, build/forest_sensing.pot. A copy of it with the translations, called as Blender calls the language
(fr_FR.po), is all that a language needs.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable
from itertools import chain, count
from pathlib import Path

import bpy
from bpy.app.translations import contexts, pgettext_iface, pgettext_rpt

from ...base.places import ASSETS
from ...base.words import Kept as Kept, keep as keep


def say(pattern: str, /, **values: object) -> str:
    """A sentence that is reported: a pattern as of ``str.format``, looked up and filled."""
    return _filled(pgettext_rpt(pattern), pattern, values)


def label(pattern: str, /, **values: object) -> str:
    """The same for what stands in a panel or a picture."""
    return _filled(pgettext_iface(pattern), pattern, values)


def title_of_operator(operator: object) -> str:
    """Name of an operator, as its buttons show it."""
    return str(pgettext_iface(operator.bl_label, contexts.operator_default))  # type: ignore[attr-defined]


def say_kept(text: str) -> str:
    """A text that was kept, as a sentence that is reported; any other as it is."""
    return _said(text, say)


def label_of_kept(made_of: str) -> str:
    """Kept values, as they stand in a panel."""
    pattern, values = _read(made_of)
    return label(pattern, **values)


@functools.lru_cache(maxsize=512)
def _read(made_of: str) -> tuple[str, dict[str, object]]:
    """Return the pattern and the values of a text that a file keeps; figures are drawn again and again."""
    pattern, values = json.loads(made_of)
    return pattern, values


def label_kept(text: str) -> str:
    """A text that was kept, as it stands in a panel or a picture; any other as it is."""
    return _said(text, label)


def _said(text: str, how: Callable[..., str]) -> str:
    if not isinstance(text, Kept):
        return text
    return how(text.pattern, **{name: _said(value, how) for name, value in text.values.items()})


def language() -> str:
    """The language that Blender speaks now; what keeps texts that were looked up keeps them by it."""
    return str(bpy.app.translations.locale)


def _filled(found: str, pattern: str, values: dict[str, object]) -> str:
    """A pattern with its values; in English where the translation asks for values that there are not."""
    if not values:
        return found
    try:
        return found.format(**values)
    except (LookupError, ValueError, AttributeError):
        return pattern.format(**values)


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
    """Translations of a .po file; entries without a translation and doubtful (fuzzy) ones stay
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


def free_name(before: str, between: str, after: str, is_taken: Callable[[str], bool]) -> str:
    """A name that is not taken yet: BEFORE AFTER, else with a number from 2 on in between."""
    ends = chain([""], (f"{between}{number}" for number in count(2)))
    names = (f"{before}{end}{after}" for end in ends)
    return next(name for name in names if not is_taken(name))


EDITED = "edited/"  # begins the name of a species that is edited


def title_of(species: str) -> str:
    """Name that people read for a preset or a species file: honda-birch is Honda Birch."""
    return Path(species).stem.replace("-", " ").replace("_", " ").title().replace("Abop ", "ABOP ")
