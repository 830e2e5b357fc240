"""The command line itself: a loop over commands, quick to answer, the same words for all."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from forest_addon.base.places import version
from headless import cli
from headless.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"numpy", "scipy", "matplotlib", "bpy", "laspy", "cattrs", "tqdm"}


def test_the_parser_knows_no_command_by_name():
    tree = ast.parse(Path(cli.__file__).read_text(encoding="utf-8"))
    texts = {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)} - {cli.EPILOG}
    assert not texts & {command.name for command in COMMANDS}


def test_every_file_of_commands_is_one_command():
    files = {p.stem for p in (ROOT / "headless" / "commands").glob("[a-z]*.py")}
    assert files == {command.name for command in COMMANDS if not command.by}
    for by in {command.by for command in COMMANDS if command.by}:
        assert "def run(" in (ROOT / "headless" / f"{by.replace('.', '/')}.py").read_text()


@pytest.mark.medium
def test_help_imports_little():
    code = (
        "import sys\nfrom headless.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: print(*sys.modules, file=sys.stderr)"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert "demo" in ended.stdout
    assert not {name.split(".")[0] for name in ended.stderr.split()} & HEAVY


@pytest.mark.parametrize(
    ("words", "joined"),
    [
        (["--at", "-1,2,3"], ["--at=-1,2,3"]),
        (["--azimuth", "-30"], ["--azimuth", "-30"]),  # argparse knows plain numbers
        (["--window", "-1", "-2", "3", "4"], ["--window", "-1", "-2", "3", "4"]),
        (["--at", "1,2,3"], ["--at", "1,2,3"]),
        (["--", "-1,2"], ["--", "-1,2"]),
    ],
)
def test_values_that_begin_with_a_minus(words, joined):
    assert cli._values_joined(words) == joined


@pytest.mark.parametrize(
    ("words", "out"),
    [
        (["run", "a/my.toml"], "out/my"),
        (["demo"], "out/demo"),
        (["template", "w.stl", "--name", "elm"], "out/elm"),
        (["stand", "my.toml"], "out/my/points.csv"),
        (["estimate", "trees.csv"], "out/trees/site.toml"),
        (["lidar", "park.blend", "--scanner", "riegl-vz-400i"], "out/park-riegl-vz-400i.laz"),
        (["lidar", "park.blend", "--out", "a.las", "--format", "ply"], "a.las.ply"),
        (["convolve", "out/ir.wav", "clap.wav"], "out/ir-clap.wav"),
        (["stand", "my.toml", "--out", "b.csv"], "b.csv"),
    ],
)
def test_where_results_go(words, out):
    chosen = cli._parser().parse_args(words)
    assert chosen.command.output(chosen) == Path(out)


@pytest.mark.parametrize("study", cli.STUDIES)
def test_studies_have_moved(study, capsys):
    assert cli.main([study, "--seed", "3"]) == 2
    assert capsys.readouterr().err.endswith(f"python -m studies {study}\n")


def test_too_little_memory_is_one_line(headless, monkeypatch, tmp_path):
    def huge(*_):
        raise MemoryError("Unable to allocate 3 TiB")

    monkeypatch.setattr("headless.commands.run.run", huge)
    done = headless("run", "scene.toml", "--out", tmp_path / "o")
    assert done.returncode == 1
    assert done.stderr.startswith("error: there is not enough memory for 3 TiB more; ")


@pytest.mark.slow
def test_a_species_called_as_no_file_can_be(headless, tmp_path, monkeypatch):
    monkeypatch.setattr("headless.report.trees.ICON", 24)
    (tmp_path / "s.toml").write_text('name = "oak/pine\\\\x"\n[honda]\nlevels.values = [1]\n')
    done = headless("species", tmp_path / "s.toml", "--pictures", tmp_path / "p")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "p").glob("*.jpg")] == ["oak_pine_x.jpg"]


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "code"), [("| true; exit ${PIPESTATUS[0]}", 141), (">&-", 0)])
def test_output_that_nobody_reads_ends_a_command_quietly(ending, code):
    words = f"{sys.executable} -m headless derive maple --generations 12 {ending}"
    ended = subprocess.run(["bash", "-c", words], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == code
    assert ended.stderr == ""


def test_versions_say_what_computes(capsys, monkeypatch):
    monkeypatch.setenv("FOREST_SENSING_KERNELS", "off")
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    said = f"Forest Sensing {version()}, kernels: numpy (FOREST_SENSING_KERNELS=off)\n"
    assert capsys.readouterr().out == said


@pytest.mark.skipif(shutil.which("bash") is None, reason="completion is played by bash")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("dem", {"demo"}),
        ("doc", {"doctor"}),
        ("run my.toml --conv", {"--convolve"}),
        ("run a", {"a tree.toml", "any.toml"}),  # files, also with blanks
        ("run any.toml --out a", {"a tree.toml", "any.toml"}),
        ("lidar any.toml --format double.", {"double.ply"}),
    ],
)
def test_a_shell_completes_commands_options_and_files(typed, offered, tmp_path, capsys):
    shtab = pytest.importorskip("shtab")
    assert cli.FILES.items() <= shtab.FILE.items()
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--completion", "bash"])
    for name in ("a tree.toml", "any.toml"):
        (tmp_path / name).touch()
    words = ["forest-sensing", *typed.split()]
    asked = f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}"
    script = f"{capsys.readouterr().out}\n{asked}\n_shtab_forest_sensing"
    ended = subprocess.run(
        ["bash", "-c", script + '\nprintf "%s\\n" "${COMPREPLY[@]}"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert set(ended.stdout.splitlines()) == offered


def test_completion_without_shtab_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert cli.main(["--completion", "bash"]) == 2
    assert capsys.readouterr().err == "error: this needs shtab: pip install shtab\n"
