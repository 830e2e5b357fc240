"""Bad input ends with one clear sentence and exit code 2; trouble while running keeps what is whole."""

import errno
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("bpy")

ROOT = Path(__file__).resolve().parents[2]
SMALL = Path(__file__).with_name("small.toml")


def start(*words, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "headless", *map(str, words)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def ended(process):
    _, said = process.communicate(timeout=900)
    assert "Traceback" not in said
    return process.returncode, said


def one_sentence(code, said, expected=2):
    assert code == expected, said
    lines = [line for line in said.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, said
    return lines[0]


@pytest.fixture
def refused(headless):
    """The one sentence with which a command ends that cannot be done."""

    def run(*words):
        done = headless(*words)
        return one_sentence(done.returncode, done.stderr)

    return run


def scene_with(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[forest]\nsize = [-3, 4]", "forest.size[0]: -3 m is out of range; use larger than 0"),
        ("[forest]\nsise = [3, 4]", 'forest.sise: is not known; did you mean "size"?'),
        ("this is not toml", "is not TOML"),
        ('[[plantings]]\nspecies = "oak"\nexpected = 2', "use one of abop-monopodial-a"),
        ('[[plantings]]\nspecies = "oak.toml"\nexpected = 2', "there is no such file"),
        (
            '[[plantings]]\nspecies = "maple"\nexpected = 3\n'
            "gaussians = [{ centre = [9e6, 0], width = [1, 1] }]",
            "put nothing on the field",
        ),
        ('[[plantings]]\nspecies = "maple"\nexpected = 1e9', "plantings[0].expected"),
    ],
)
def test_scenes_that_cannot_be_used(refused, tmp_path, text, words):
    scene = scene_with(tmp_path, text)
    said = refused("run", scene, "--out", tmp_path / "o")
    assert words in said
    assert not (tmp_path / "o" / "run.json").exists()


@pytest.mark.medium
def test_a_missing_scene_file(tmp_path):
    """In a process of its own: its exit code and its words are what a shell gets."""
    said = one_sentence(*ended(start("run", tmp_path / "none.toml", "--out", tmp_path / "o")))
    assert "none.toml: there is no such file" in said


def test_a_negative_seed(refused):
    assert "--seed: -1 is out of range" in refused("run", SMALL, "--seed", "-1")


@pytest.mark.parametrize("trouble", ["missing", "not an STL", "cut off"])
def test_template_files_that_cannot_be_used(refused, tmp_path, trouble):
    wood = tmp_path / "wood.stl"
    whole = (ROOT / "assets" / "templates" / "maple" / "wood.stl").read_bytes()
    if trouble == "not an STL":
        wood.write_text("<html>not found</html>")
    elif trouble == "cut off":
        wood.write_bytes(whole[: len(whole) // 2])
    (tmp_path / "mine.toml").write_text('name = "mine"\n[template]\nwood = "wood.stl"\n')
    scene = scene_with(tmp_path, '[[plantings]]\nspecies = "mine.toml"\nexpected = 2')
    said = refused("run", scene, "--out", tmp_path / "o")
    assert "mine.toml" in said
    assert "wood.stl" in said


def test_an_output_folder_that_cannot_be_written_to(refused, tmp_path):
    (tmp_path / "file").write_text("x")
    said = refused("run", SMALL, "--out", tmp_path / "file" / "o")
    assert "cannot be written to" in said
    assert "choose another folder" in said


def test_an_unknown_command_shows_those_that_are(headless):
    done = headless("rnu")
    assert done.returncode == 2
    assert "run, demo" in done.stderr


def no_half_written_files(out):
    assert not [p.name for p in out.iterdir() if "partial" in p.name]


def without_sensors(tmp_path, output="preview = false\n"):
    """A forest and its files, without pictures: what matters here is how writing ends."""
    text = SMALL.read_text().split("[[sensors]]")[0]
    off = "pictures = false\ngoodness = false\nreport = false\n"
    return scene_with(tmp_path, text + "[output]\n" + off + output)


@pytest.mark.slow
def test_a_full_disk(tmp_path):
    """A folder of 1 MB: tables fit, what Blender writes does not."""
    scene = without_sensors(tmp_path)
    out = tmp_path / "disk"
    out.mkdir()
    if not shutil.which("unshare"):
        pytest.skip("a small disk needs util-linux' unshare")
    inside = (
        f"mount -t tmpfs -o size=1m tmpfs {out} && {sys.executable} -m headless run {scene} --out {out}"
        f"; code=$?; ls -A {out}; exit $code"
    )
    process = subprocess.run(
        ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", inside],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=900,
    )
    if "mount:" in process.stderr or "unshare:" in process.stderr:
        pytest.skip("this system lets nobody mount a small disk")
    assert process.returncode == 1, process.stderr
    assert "Traceback" not in process.stderr
    lines = [line for line in process.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert "disk" in lines[0]
    files = process.stdout.split()
    assert "trees.csv" in files
    assert "run.json" not in files
    assert not [name for name in files if "partial" in name]


@pytest.mark.slow
def test_a_file_that_may_not_grow(tmp_path):
    """Without mounting: the system refuses files above 400 kB with EFBIG."""

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

    out = tmp_path / "o"
    process = start("run", without_sensors(tmp_path), "--out", out, preexec_fn=limit)
    said = one_sentence(*ended(process), 1)
    assert "disk" in said or os.strerror(errno.EFBIG) in said
    assert (out / "trees.csv").exists()
    no_half_written_files(out)


def interrupt_when(process, ready, patience=900):
    end = time.monotonic() + patience
    while not ready():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    return ended(process)


@pytest.mark.slow
def test_ctrl_c_between_sensors_keeps_finished_files(tmp_path):
    out = tmp_path / "o"
    process = start("run", SMALL, "--out", out)
    code, said = interrupt_when(process, (out / "trees.csv").exists)
    assert code == 130
    assert "interrupted; finished files are kept" in said
    assert (out / "trees.csv").exists()
    assert not (out / "run.json").exists()
    no_half_written_files(out)


@pytest.mark.slow
def test_ctrl_c_ends_a_long_render(tmp_path):
    """The render would take an hour, longer than a test waits; all else is written before."""
    picture = 'preview = "cycles"\npreview_size = [800, 600]\npreview_samples = 65536\n'
    scene = without_sensors(tmp_path, picture)
    out = tmp_path / "o"
    process = start("run", scene, "--out", out)

    def rendering():
        if not (out / "run.json").exists():
            return False
        time.sleep(0.5)
        return True

    code, said = interrupt_when(process, rendering)
    assert code == 130
    assert "interrupted; finished files are kept" in said
    assert all((out / name).exists() for name in ("forest.blend", "run.json"))
    assert not (out / "preview.png").exists()
    no_half_written_files(out)
