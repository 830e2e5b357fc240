"""What properties are tried on: the same inputs in every process, whatever it imported before."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
DRAW = """
import conftest
{imported}
from hypothesis import given, strategies as st

@given(number=st.floats(), count=st.integers(), text=st.text(), some=st.sets(st.sampled_from("abc")))
def drawn(number, count, text, some):
    print(ascii((number, count, text, sorted(some))))

drawn()
"""


def inputs(imported, hash_seed):
    """Lines that a fresh process draws after these imports."""
    path = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    drawn = subprocess.run(
        [sys.executable, "-c", DRAW.format(imported=imported)],
        env=os.environ | {"PYTHONPATH": path, "PYTHONHASHSEED": hash_seed},
        check=True,
        capture_output=True,
        text=True,
    )
    return drawn.stdout.splitlines()


@pytest.mark.medium
def test_inputs_depend_on_neither_imports_nor_the_hash_seed():
    alone = inputs("", "0")
    assert len(set(alone)) > 10
    assert inputs("import forest_addon.spec, forest_addon.growth.lsystem.turtle", "1") == alone
