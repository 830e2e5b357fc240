"""A small dataset that nothing disturbed, made once: a process with Blender takes seconds to start."""

import os
from functools import partial
from types import SimpleNamespace

import pytest

from headless.dataset import engine
from tests.references.dataset_runs import PLAN, run


@pytest.fixture(scope="session")
def undisturbed(once):
    pytest.importorskip("bpy")

    def make(folder):
        ended = run(PLAN, "--out", folder / "data", "--workers", "1", "--quiet")
        assert ended.returncode == 0, ended.stderr

    return once("dataset", make) / "data"


@pytest.fixture(autouse=True)
def one_thread(monkeypatch):
    monkeypatch.setitem(os.environ, "OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def kept_worker():
    """A worker whose Blender serves one test after the other."""
    worker = engine.Worker()
    yield worker
    worker.child.end()


@pytest.fixture
def here(headless, kept_worker, monkeypatch):
    """The command in this process, with a Blender that is kept; for what needs no process of its own."""
    lent = SimpleNamespace(make=kept_worker.make, child=SimpleNamespace(end=lambda: None))
    monkeypatch.setattr(engine, "Worker", lambda: lent)
    return partial(headless, "dataset")
