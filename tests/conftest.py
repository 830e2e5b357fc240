"""Fixtures that several tests share, and how the tests end."""

import os
import sys

import pytest

_outcome = pytest.StashKey()


@pytest.fixture
def empty_blender():
    """Blender with nothing in it."""
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy


def pytest_sessionfinish(session, exitstatus):
    """Keep how the tests went, for the end."""
    session.config.stash[_outcome] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Leave without the clean-up of bpy 4.5: after a sound was loaded it may wait for ever for a thread."""
    bpy = sys.modules.get("bpy")
    if bpy is not None and bpy.app.version < (5, 0) and _outcome in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[_outcome])
