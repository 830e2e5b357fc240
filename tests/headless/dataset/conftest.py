"""A small dataset that nothing disturbed, made once: a process with Blender takes seconds to start."""

import os

import pytest
from references.dataset_runs import PLAN


@pytest.fixture(scope="session")
def undisturbed(warm, once):
    def make(folder):
        warm.run(PLAN, "--out", folder / "data", "--workers", "1", "--quiet")

    return once("dataset", make) / "data"


@pytest.fixture(autouse=True)
def one_thread(monkeypatch):
    monkeypatch.setitem(os.environ, "OPENBLAS_NUM_THREADS", "1")
