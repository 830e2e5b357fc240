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

project = "Forest Sensing"
author = "The Forest Sensing developers"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "Forest Sensing"
exclude_patterns = ["_build"]
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
# Notebooks are run when the site is built, so that what they show is what the code does.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_class_signature = "separated"
napoleon_numpy_docstring = True
suppress_warnings = ["myst.xref_missing"]  # links into the repository, which a site does not hold

write_reference(HERE / "scene-file.md")


def setup(app):
    """Docstrings here name fields as "name : what it is"; each becomes a line of its own."""
    app.connect("autodoc-process-docstring", _fields_as_lines, priority=100)


def _fields_as_lines(app, what, name, thing, options, lines):
    told, inside = [], False
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if set(following.strip()) == {"-"}:  # Raises, Returns: napoleon's
            inside = True
        found = FIELD.match(line)
        if found and not inside:
            told += ["", f"- **{found[1]}** : {found[2]}"]
        elif told and told[-1].startswith(("- **", "  ")) and line.strip() and not inside:
            told.append(f"  {line.strip()}")
        else:
            told.append(line)
    lines[:] = [re.sub(r"\|(\w+)\|", r"\\|\1\\|", line) for line in told]


FIELD = re.compile(r"^([A-Za-z_]\w*(?:, [a-z_]\w*)*) : (.*)")
