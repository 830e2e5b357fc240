"""The set-up on machines that lack things: each lack is one line and exit code 1, never a traceback."""

import os
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"
pytestmark = pytest.mark.skipif(os.name == "nt", reason="make and sh are not used on Windows")


def load_setup():
    spec = spec_from_file_location("setup_env", ROOT / "packaging/setup_env.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def find_python(path, *arguments, **variables):
    environment = {"PATH": os.pathsep.join(map(str, path)), "HOME": "/nonexistent", **variables}
    return subprocess.run(
        ["/bin/sh", ROOT / "packaging/find_python.sh", *arguments],
        env=environment,
        capture_output=True,
        text=True,
    )


def script(folder, name, text):
    """An executable shell script."""
    folder.mkdir(exist_ok=True)
    file = folder / name
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    return folder


@pytest.fixture
def failing_shims(tmp_path):
    for name in ("python3.13", "python3.11", "python3", "python"):
        shims = script(tmp_path / "shims", name, f"echo '{name}: command not found' >&2; exit 127")
    return shims


@pytest.fixture
def real(tmp_path):
    return script(tmp_path / "real", "python3", f'exec "{sys._base_executable}" "$@"')


def test_a_shim_that_fails_is_passed_over(failing_shims, real):
    run = find_python([failing_shims, real])
    assert run.returncode == 0, run.stderr
    assert Path(run.stdout.strip()).samefile(sys._base_executable)


def test_version_managers_are_looked_into(failing_shims, real, tmp_path):
    home = tmp_path / "home"
    bin_folder = home / f".pyenv/versions/{VERSION}.99/bin"
    bin_folder.mkdir(parents=True)
    (bin_folder / "python").symlink_to(real / "python3")
    run = find_python([failing_shims], HOME=str(home))
    assert run.returncode == 0, run.stderr
    assert Path(run.stdout.strip()).samefile(sys._base_executable)


def test_nothing_found_says_what_to_install(failing_shims):
    run = find_python([failing_shims])
    assert run.returncode == 1
    assert run.stdout == ""
    assert run.stderr.startswith("No Python 3.13 or 3.11 that runs was found. Install one:")
    assert len(run.stderr.splitlines()) == 1


def test_a_python_without_blender_is_not_taken(tmp_path):
    other = script(tmp_path / "other", "python3", "echo '3.12 /usr/bin/python3.12'")
    run = find_python([other])
    assert run.returncode == 1
    assert "only 3.12, which Blender is not published for" in run.stderr


def test_a_python_without_venv_names_the_package(tmp_path):
    split = script(tmp_path / "split", "python3", "echo '3.13 novenv'")
    run = find_python([split])
    assert run.returncode == 1
    assert run.stderr.splitlines() == [
        "Python 3.13 is here but cannot make virtual environments: apt install python3.13-venv"
    ]


def test_the_python_asked_for_or_none(failing_shims, real):
    run = find_python([failing_shims, real], PYTHON="python3.13")
    assert run.returncode == 1
    assert run.stderr == "PYTHON=python3.13 does not run: it must be a Python 3.13 or 3.11.\n"


LACK_A_LIBRARY = """
import runpy, sys
sys.argv[0] = {script!r}
names = runpy.run_path({script!r})
names["LIBRARIES"].clear()
names["LIBRARIES"]["libmadeup.so.9"] = ("libmadeup9",) * 4
sys.exit(names["main"]([{venv!r}]))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux wheels need libraries")
def test_a_missing_library_is_one_line(tmp_path):
    venv = tmp_path / "venv"
    code = LACK_A_LIBRARY.format(script=str(ROOT / "packaging/setup_env.py"), venv=str(venv))
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 1
    assert run.stdout == ""
    (line,) = run.stderr.splitlines()
    assert "missing" in line
    assert "libmadeup" in line
    assert not venv.exists()


@pytest.mark.parametrize(
    ("os_release", "command"),
    [
        ("ID=debian\n", "apt install libxi6 libgl1"),
        ('ID=linuxmint\nID_LIKE="ubuntu debian"\n', "apt install libxi6 libgl1"),
        ("ID=fedora\n", "dnf install libXi libglvnd-glx"),
        ('ID="rocky"\nID_LIKE="rhel centos fedora"\n', "dnf install libXi libglvnd-glx"),
        ("ID=manjaro\nID_LIKE=arch\n", "pacman -S libxi libglvnd"),
        ('ID="opensuse-tumbleweed"\nID_LIKE="opensuse suse"\n', "zypper install libXi6 libglvnd"),
    ],
)
def test_the_package_is_named_as_the_distribution_does(os_release, command):
    setup = load_setup()
    line = setup.advice(["libXi.so.6", "libGL.so.1"], setup.package_tool(os_release))
    assert line.endswith(command)


def test_an_unknown_distribution_or_library_is_named_by_file():
    setup = load_setup()
    assert setup.advice(["libXi.so.6"], setup.package_tool("ID=nixos\n")).endswith("libXi.so.6")
    assert setup.advice(["libXi.so.6", "libnew.so.1"], "apt").endswith(
        "apt install libxi6 (and what holds libnew.so.1)"
    )


def test_a_folder_that_is_no_environment_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    setup = load_setup()
    with pytest.raises(setup.SetupError, match="not a virtual environment"):
        setup.make_venv(tmp_path)
    assert (tmp_path / "thesis.txt").exists()


def test_pip_that_fails_leaves_no_stamp(tmp_path, monkeypatch):
    setup = load_setup()
    (tmp_path / "ready").touch()
    monkeypatch.setattr(setup, "missing_libraries", list)
    monkeypatch.setattr(setup, "make_venv", lambda folder: tmp_path / "bin/python")
    script(tmp_path / "bin", "python", "echo 'ERROR: No matching distribution for bpy'; exit 1")
    with pytest.raises(setup.SetupError, match="No matching distribution for bpy"):
        setup.set_up(tmp_path)
    assert not (tmp_path / "ready").exists()
    assert "No matching" in (tmp_path / "setup.log").read_text()
