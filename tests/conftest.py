"""Fixtures that several tests share, how tests draw their inputs, and how they end."""

import gc
import os
import shutil
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

try:
    import fcntl
except ImportError:  # Windows: each process makes its own
    fcntl = None

# Small matrices need no threads of their own: with several processes on the machine, OpenBLAS spends
# most of its time waiting for its threads (7 times the CPU was measured). Before numpy is loaded; the
# processes that tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

from forest_addon import kernels

# Everybody tries the same few inputs, and no clock decides whether a property holds: a loaded machine or an
# unlucky draw fails nobody's change. `make fuzz` draws new ones, as the profile `fuzz`.
settings.register_profile(
    "same",
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.register_profile("fuzz", settings.get_profile("same"), derandomize=False, max_examples=100)
settings.load_profile("same")
# Hypothesis also tries numbers that it reads in our sources, but only in those imported by then: another
# order of tests, or another share of them in a process, would be other inputs.
providers._get_local_constants = Constants

_outcome = pytest.StashKey()
_cache = pytest.StashKey()

# What takes long to make: a test that asks for it is as slow as one that is marked so.
COSTLY = {"archive", "done"}


@pytest.hookimpl(tryfirst=True)  # before slow tests are left out
def pytest_collection_modifyitems(items):
    """Mark built zips and whole runs, which `make check` leaves out."""
    for item in items:
        if COSTLY & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish():
    """Keep modules and tests out of each later round of the garbage collector."""
    gc.freeze()


@pytest.fixture(scope="session")
def blender():
    """Blender as it comes, whatever this machine's user prefers."""
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy


@pytest.fixture(params=["C", "numpy"])
def computed_by(request, monkeypatch):
    """Run a test with the kernels' library, and without it."""
    if request.param == "numpy":
        monkeypatch.setenv(kernels.SWITCH, "off")
    elif kernels.library() is None:
        pytest.skip(kernels.engine())
    return request.param


# Rooms whose tests look at no volume of wood, and at no fine picture: these are a fifth of a command's time.
UNMEASURED = {"api", "blender", "commands", "docs", "ui"}
UNSEEN = {"api", "docs", "flight", "headless"}


@pytest.fixture(scope="module", autouse=True)
def cheap(request):
    """Volumes of wood by few lines; pictures of few pixels, for which no layout is computed.

    But where bytes are held to those of processes of their own, which measure and draw as a user's.
    """
    rooms = set(request.path.parts)
    with pytest.MonkeyPatch.context() as patch:
        if rooms & UNMEASURED:
            patch.setattr("forest_addon.growth.truth.TESTS", 20_000)
        if rooms & UNSEEN and request.path.stem != "test_faults" and find_spec("matplotlib"):
            from matplotlib.figure import Figure

            save = Figure.savefig

            def save_coarse(figure, file, **how):
                figure.set_layout_engine("none")
                save(figure, file, **how | {"dpi": 30})

            patch.setattr(Figure, "savefig", save_coarse)
        yield


@pytest.fixture
def empty_blender(blender):
    """Blender with nothing in it. Preferences are not read again, which takes four times as long."""
    blender.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return blender


@pytest.fixture
def headless(capfd):
    """Runs a command in this process, as a user types it: its exit code, and what it said.

    ends : the exit code that it must have; None: any.
    Many run in one Blender: a process of its own for each costs seconds.
    """
    pytest.importorskip("bpy")
    from headless.cli import main

    def run(*words, ends=0):
        capfd.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # argparse has said what was wrong
            code = end.code
        said = capfd.readouterr()
        assert "Traceback" not in said.err
        assert ends in (code, None), said.err
        return SimpleNamespace(returncode=code, stdout=said.out, stderr=said.err)

    return run


@pytest.fixture(scope="session")
def warm():
    """A worker of datasets whose process goes on from test to test: to load Blender takes seconds."""
    pytest.importorskip("bpy")
    from references.dataset_runs import Warm

    warm = Warm()
    yield warm
    warm.renew()


@pytest.fixture
def quick(monkeypatch):
    """Tests of stands and sweeps over settings try as little as they may: their figures are not looked at."""
    monkeypatch.setattr("forest_addon.stand.statistics.law.SIMULATIONS", 19)
    for name, few in (("sensors.ENOUGH", 0.0), ("sensors.EXACTLY", 50), ("sensors.MANY", 91)):
        monkeypatch.setattr(f"headless.accuracy.{name}", few)


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """``once(name, make)``: a folder that ``make(folder)`` has filled, in the first process that asks for it.

    Every process of xdist makes its own fixtures; what takes seconds to make they share. Nobody writes to it.
    """
    base = tmp_path_factory.getbasetemp()
    if fcntl and "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent

    def share(name, make):
        folder, made = base / f"once-{name}", base / f"once-{name}.made"
        with open(base / f"once-{name}.lock", "w") as lock:
            if fcntl:
                fcntl.flock(lock, fcntl.LOCK_EX)
            if not made.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                made.touch()
        return folder

    return share


def pytest_configure(config):
    """Caches of this run alone: what another version of the code left in the user's is not ours to read.

    The processes of xdist inherit it. Matplotlib's list of fonts and zig's libraries stay where they are;
    they take seconds and minutes.
    """
    if hasattr(config, "workerinput"):
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    os.environ.setdefault("MPLCONFIGDIR", str(home / "matplotlib"))
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(home / "zig"))
    os.environ["XDG_CACHE_HOME"] = config.stash[_cache] = tempfile.mkdtemp(prefix="cache-")
    os.environ.setdefault("FOREST_SENSING_CACHE", config.stash[_cache])


def pytest_sessionfinish(session, exitstatus):
    """Keep how the tests went, for the end."""
    session.config.stash[_outcome] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Leave without the clean-up of bpy 4.5: after a sound was loaded it may wait for ever for a thread."""
    shutil.rmtree(config.stash.get(_cache, ""), ignore_errors=True)
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.version < (5, 0) and _outcome in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[_outcome])
