"""Pages print what can be used: commands, tables of scenes and species, Python; links lead somewhere.

The tutorials are played in test_guides.py, the examples of docs/dataset.md in
headless/dataset/test_convert.py.
"""

import importlib.util
import re
import shlex
import tomllib
from pathlib import Path

import pytest

from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene, Species
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


def blocks(page, kind):
    """The blocks of a page of one kind, python or toml."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.M | re.S)


def commands(page):
    """The words of each command of a page, in blocks and in running text."""
    text = re.sub(r"\\\n\s*", " ", page.read_text(encoding="utf-8"))
    found = []
    for block in re.findall(r"^ *```[a-z]*\n(.*?)^ *```", text, re.M | re.S):
        found += re.findall(rf"^\s*{STARTS} +([^\n]*)", block, re.M)
    found += re.findall(rf"(?<!`)`{STARTS} +([^`]+)`(?!`)", text.replace("\n", " "))
    return [shlex.split(line, comments=True) for line in found]


@pytest.mark.medium
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


# What stands before a table that a page shows without its head.
HEADS = {
    "[plantings.": '[[plantings]]\nspecies = "maple"\nexpected = 9\n',
    "[siblings]": 'name = "mine"\ntemplate = { wood = "wood.stl", leaves = "leaves.stl" }\n',
}
SETTINGS = [
    pytest.param(text, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, text in enumerate(blocks(page, "toml"), 1)
]


@pytest.mark.medium
@pytest.mark.parametrize("text", SETTINGS)
def test_its_tables_are_taken(text, tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(next((h for start, h in HEADS.items() if text.startswith(start)), "") + text)
    written = tomllib.loads(path.read_text())
    read = read_settings(path, Species if "name" in written else Scene)
    assert all(getattr(read, table) for table in written.keys() - {"version"})


RUN_ELSEWHERE = {"dataset", "index", "stand", "architecture"}  # test_convert, _guides, _new_sensor
SNIPPETS = [page for page in PAGES if blocks(page, "python") and page.stem not in RUN_ELSEWHERE]
SNIPPETS = [page for page in SNIPPETS if page.parent.name != "guide"]


BIG = """
seed = 1

[forest]
size = [60, 60]

[tiles]
size = 30
buffer = 10

[[plantings]]
species = "abop-monopodial-a"
variants = 1
expected = 12
"""


@pytest.mark.slow
@pytest.mark.parametrize("page", SNIPPETS, ids=lambda page: page.stem)
def test_its_python_runs(page, tmp_path, monkeypatch):
    """As printed, in order, among the shipped assets; their scenes have fewer trees here."""
    pytest.importorskip("bpy")
    lay_out_few_trees(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, text in enumerate(blocks(page, "python"), 1):
        for needed in set(
            re.findall(r"^(?:import|from) (gymnasium|stable_baselines3)", text, re.M)
        ):
            if importlib.util.find_spec(needed) is None:
                break
        else:
            exec(compile(text, f"{page.name}, block {number}", "exec"), names)
    assert names


def lay_out_few_trees(folder):
    """The assets beside a reader; scenes that pages name have three trees of a kind."""
    scenes = folder / "assets" / "scenes"
    scenes.mkdir(parents=True)
    for shipped in [*(ROOT / "assets").iterdir(), *(ROOT / "assets" / "scenes").iterdir()]:
        place = folder / shipped.relative_to(ROOT)
        if not place.exists():
            place.symlink_to(shipped)
    (folder / "big.toml").write_text(BIG, encoding="utf-8")
    for name in ("demo.toml", "flight-poisson.toml"):
        text = (scenes / name).read_text(encoding="utf-8")
        (scenes / name).unlink()
        few = re.sub(r"^expected = \d+", "expected = 3\nexact = true", text, flags=re.M)
        (scenes / name).write_text(few, encoding="utf-8")


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 200
