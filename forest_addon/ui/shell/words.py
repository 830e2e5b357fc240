"""Words in the user's language: texts are English in the code, and Blender's catalogs translate them.

Blender itself looks up the name and help of a class or property, and what a call has as plain text:
``label(text="Images")``. What it cannot look up has values in it, or is on its way to where it is read.
``say`` and ``label`` look up the pattern and fill it then. What a file keeps stays English: ``keep`` notes
what a text is made of, ``label_of_kept`` says it in the language of whoever opens the file; ``say_kept`` and
``label_kept`` say what came from rooms that have no catalogs.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable

import bpy
from bpy.app.translations import contexts, pgettext_iface, pgettext_rpt

from ...base.words import Kept as Kept
from ...base.words import keep as keep


def say(pattern: str, /, **values: object) -> str:
    """A sentence that is reported: a pattern as of ``str.format``, looked up and filled."""
    return _filled(pgettext_rpt(pattern), pattern, values)


def label(pattern: str, /, **values: object) -> str:
    """The same for what stands in a panel or a picture."""
    return _filled(pgettext_iface(pattern), pattern, values)


def title_of_operator(operator: object) -> str:
    """Return what an operator is called, as its buttons show it."""
    return str(pgettext_iface(operator.bl_label, contexts.operator_default))  # type: ignore[attr-defined]


def say_kept(text: str) -> str:
    """A text that was kept, as a sentence that is reported; any other as it is."""
    return _said(text, say)


def label_of_kept(made_of: str) -> str:
    """Return what was kept, as it stands in a panel."""
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
