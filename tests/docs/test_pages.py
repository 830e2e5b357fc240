"""Every command that a page prints is one that the program takes; every link leads somewhere."""

import re
import shlex
from pathlib import Path

import pytest

from headless.cli import _parser, _values_joined

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "assets" / "species" / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "guide").glob("*.md")),
]
STARTS = r"(?:\.venv/bin/python -m headless|python -m headless|forest-sensing)"


def commands(page):
    """The words of each command of a page, in blocks and in running text."""
    text = re.sub(r"\\\n\s*", " ", page.read_text(encoding="utf-8"))
    found = []
    for block in re.findall(r"^ *```[a-z]*\n(.*?)^ *```", text, re.M | re.S):
        found += re.findall(rf"^\s*{STARTS} +([^\n]*)", block, re.M)
    found += re.findall(rf"(?<!`)`{STARTS} +([^`]+)`(?!`)", text.replace("\n", " "))
    return [shlex.split(line, comments=True) for line in found]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_its_commands_are_taken(page, capsys):
    parser = _parser()
    for words in commands(page):
        if "…" in words or "..." in words or len(words) == 1:  # a name, or --help
            continue
        try:
            parser.parse_args(_values_joined(words))
        except SystemExit:
            pytest.fail(f"{' '.join(words)}: {capsys.readouterr().err.splitlines()[-1]}")


def test_there_are_commands_to_take():
    assert sum(len(commands(page)) for page in PAGES) > 40


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_its_links_lead_somewhere(page):
    text = re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target) or target.startswith("#"):
            continue
        path = target.split("#")[0]
        made = (
            Path(path).name == "scene-file.md"
        )  # by docs/scene_reference.py, when the site is built
        assert made or (page.parent / path).exists(), f"{page.name}: {target}"


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 200
