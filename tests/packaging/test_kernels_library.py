"""The library is the one of the sources beside it; without it numpy computes, and it is said why."""

import shutil
import subprocess
import sys

import pytest
from references.scripts import ROOT, script

from forest_addon import kernels

builder = script("packaging/build_kernels.py")


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A room of its own, with the sources alone; the library is looked for anew before and after."""
    for source in kernels.ROOM.glob("*.[ch]"):
        shutil.copy(source, tmp_path)
    monkeypatch.setattr(kernels, "ROOM", tmp_path)
    monkeypatch.setattr(builder, "ROOM", tmp_path)
    monkeypatch.delenv(kernels.SWITCH, raising=False)
    kernels._opened.cache_clear()
    yield tmp_path
    kernels._opened.cache_clear()


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("library")
    if builder.main(["--out", str(folder)]):
        pytest.skip("no C compiler is here")
    return folder / kernels.FILE


@pytest.fixture
def built(library, room):
    shutil.copy(library, room)
    return room


def test_the_library_of_these_sources_is_opened(built, monkeypatch):
    assert kernels.engine() == "C"
    assert kernels.library() is not None
    monkeypatch.setenv(kernels.SWITCH, "off")
    assert kernels.library() is None
    assert kernels.engine() == "numpy (FOREST_SENSING_KERNELS=off)"


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda room: (room / kernels.FILE).unlink(), "no library is built"),
        (lambda room: (room / kernels.FILE).write_bytes(b"\x7fELF"), "the library does not load: "),
        (
            lambda room: (room / "kernels.h").write_text("/* later */"),
            "the library is of other sources",
        ),
    ],
)
def test_any_other_library_is_left_alone(built, spoil, why):
    spoil(built)
    assert kernels.engine().startswith(f"numpy ({why}")
    assert kernels.library() is None


def test_without_a_compiler_one_sentence_says_what_to_install(tmp_path):
    """A machine with nothing on its PATH, whose Python has no ziglang."""
    run = subprocess.run(
        [sys._base_executable, "-I", ROOT / "packaging/build_kernels.py", "--out", tmp_path],
        env={"PATH": "/nonexistent"},
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (1, "", 1)
    assert "numpy computes more slowly: install gcc or clang" in run.stderr
    assert not list(tmp_path.iterdir())


def test_sources_that_do_not_compile_leave_the_library_as_it_was(built):
    before = (built / kernels.FILE).read_bytes()
    (built / "broken.c").write_text("int unused(void) { int x; return 0; }")  # warnings are errors
    assert builder.main([]) == 1
    assert (built / kernels.FILE).read_bytes() == before
