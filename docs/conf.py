"""The documentation site: ``make docs`` builds it from these pages and the code's docstrings.

Sphinx is what numpy and scipy document themselves with; MyST reads the Markdown pages, myst-nb runs the
notebooks, furo is the look. Nothing is fetched from the network.
"""

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from scene_reference import write_reference  # noqa: E402

from forest_addon.base.places import version as version_of  # noqa: E402

project = "Forest Sensing"
author = "The Forest Sensing developers"
release = version = version_of()
# viewcode: a page for each file of the code, which "[source]" beside a name leads to.
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
html_theme = "furo"
html_title = f"Forest Sensing {release}"
html_copy_source = True
html_last_updated_fmt = "%Y-%m-%d"
exclude_patterns = ["_build"]
myst_heading_anchors = 3
# Notebooks are run when the site is built, so that what they show is what the code does.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
suppress_warnings = ["myst.xref_missing"]  # links into the repository, which a site does not hold

write_reference(HERE / "scene-file.md")


def setup(app):
    """Docstrings here name fields as "name : what it is"; each becomes a line of its own."""
    app.connect("autodoc-process-docstring", _fields_as_lines)


def _fields_as_lines(app, what, name, thing, options, lines):
    told, in_field = [], False
    for line in lines:
        if line and not line.strip("-"):  # below a heading such as Raises
            told[-1] = f"**{told[-1]}**"
            line = ""
        pieces = BETWEEN.split(line) if FIELD.match(line) or in_field else [line]
        for number, piece in enumerate(pieces):
            found = FIELD.match(piece)
            if found:
                told += ["", f"- **{found[1]}** : {found[2]}"]
                in_field = True
            elif in_field and piece.strip():
                told.append(f"  {piece.strip()}")
            else:
                told.append(piece)
                in_field = in_field and bool(number)
    lines[:] = [re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in told]


NAMES = r"[A-Za-z_]\w*(?:, [a-z_]\w*)*"
FIELD = re.compile(rf"^\s*({NAMES}) : (.*)")
BETWEEN = re.compile(rf"(?<=[.;]) (?={NAMES} : )")  # two fields on a line
