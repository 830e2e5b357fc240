"""The set-up on machines that lack things: each lack is one line and exit code 1, never a traceback."""

import os
import subprocess
import sys

import pytest
from references.scripts import ROOT, script

setup = script("packaging/setup_env.py")
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"
pytestmark = pytest.mark.skipif(os.name == "nt", reason="make and sh are not used on Windows")


def program(folder, name, text):
    """An executable shell script."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{text}\n")
    (folder / name).chmod(0o755)


@pytest.fixture
def machine(tmp_path):
    """Folders of programs: some that fail, a real Python, one of another version, one without venv."""
    for name in ("python3.13", "python3.11", "python3", "python"):
        program(tmp_path / "failing", name, f"echo '{name}: command not found' >&2; exit 127")
    program(tmp_path / "real", "python3", f'exec "{sys._base_executable}" "$@"')
    program(tmp_path / "other", "python3", "echo '3.12 /usr/bin/python3.12'")
    program(tmp_path / "split", "python3", "echo '3.13 novenv'")
    managed = tmp_path / f"home/.pyenv/versions/{VERSION}.99/bin"
    managed.mkdir(parents=True)
    (managed / "python").symlink_to(tmp_path / "real" / "python3")
    return tmp_path


@pytest.mark.parametrize(
    ("path", "variables", "told"),
    [
        ("failing real", {}, ""),
        ("failing", {"HOME": "home"}, ""),
        ("failing", {}, "No Python 3.13 or 3.11 that runs was found. Install one:"),
        ("other", {}, "only 3.12, which Blender is not published for"),
        (
            "split",
            {},
            "Python 3.13 is here but cannot make virtual environments: apt install python3.13-venv",
        ),
        (
            "failing real",
            {"PYTHON": "python3.13"},
            "PYTHON=python3.13 does not run: it must be a Python 3.13 or 3.11.",
        ),
    ],
)
def test_a_python_that_runs_is_found_or_what_to_install(machine, path, variables, told):
    run = subprocess.run(
        ["/bin/sh", ROOT / "packaging/find_python.sh"],
        env={
            "PATH": os.pathsep.join(str(machine / folder) for folder in path.split()),
            "HOME": "/nonexistent",
        }
        | variables,
        cwd=machine,
        capture_output=True,
        text=True,
    )
    assert run.returncode == bool(told), run.stderr
    if told:
        assert (run.stdout, run.stderr.count("\n")) == ("", 1)
        assert told in run.stderr
    else:
        assert (machine / run.stdout.strip()).samefile(sys._base_executable)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux wheels need libraries")
def test_a_missing_library_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(setup, "LIBRARIES", {"libmadeup.so.9": ("libmadeup9",) * 4})
    assert setup.main([str(tmp_path / "venv")]) == 1
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert "missing" in told.err
    assert "libmadeup" in told.err
    assert not (tmp_path / "venv").exists()


@pytest.mark.parametrize(
    ("os_release", "command"),
    [
        ("ID=debian\n", "apt install libxi6 libgl1"),
        ('ID=linuxmint\nID_LIKE="ubuntu debian"\n', "apt install libxi6 libgl1"),
        ("ID=fedora\n", "dnf install libXi libglvnd-glx"),
        ('ID="rocky"\nID_LIKE="rhel centos fedora"\n', "dnf install libXi libglvnd-glx"),
        ("ID=manjaro\nID_LIKE=arch\n", "pacman -S libxi libglvnd"),
        ('ID="opensuse-tumbleweed"\nID_LIKE="opensuse suse"\n', "zypper install libXi6 libglvnd"),
        ("ID=nixos\n", "libXi.so.6 libGL.so.1"),
    ],
)
def test_packages_are_named_as_the_distribution_does(os_release, command):
    tool = setup.package_tool(os_release)
    assert setup.advice(["libXi.so.6", "libGL.so.1"], tool).endswith(command)


def test_an_unknown_library_is_named_by_its_file():
    told = setup.advice(["libXi.so.6", "libnew.so.1"], "apt")
    assert told.endswith("apt install libxi6 (and what holds libnew.so.1)")


def test_a_folder_that_is_no_environment_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(setup.SetupError, match="not a virtual environment"):
        setup.make_venv(tmp_path)
    assert (tmp_path / "thesis.txt").exists()


@pytest.mark.parametrize(("extra", "stamp"), [("bpy", "blender"), ("dev", "ready")])
def test_pip_that_fails_leaves_no_stamp(extra, stamp, tmp_path, monkeypatch):
    (tmp_path / stamp).touch()
    monkeypatch.setattr(setup, "missing_libraries", list)
    monkeypatch.setattr(setup, "make_venv", lambda folder: tmp_path / "bin/python")
    program(tmp_path / "bin", "python", "echo 'ERROR: No matching distribution for bpy'; exit 1")
    with pytest.raises(setup.SetupError, match="No matching distribution for bpy"):
        setup.set_up(tmp_path, extra)
    assert not (tmp_path / stamp).exists()
    assert "No matching" in (tmp_path / "setup.log").read_text()
