"""Commands as a user types them, many in one Blender: a process of its own for each costs seconds."""

from types import SimpleNamespace

import pytest


@pytest.fixture
def headless(capfd):
    """Runs a command in this process: how it ended, and what it said."""
    pytest.importorskip("bpy")
    from headless.cli import main

    def run(*words):
        capfd.readouterr()
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:  # argparse has said what was wrong
            code = end.code
        said = capfd.readouterr()
        assert "Traceback" not in said.err
        return SimpleNamespace(returncode=code, stdout=said.out, stderr=said.err)

    return run
