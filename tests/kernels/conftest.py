"""The library under test: the built one, or one that a test of this folder has built in a way of its own."""

import os
import threading
from pathlib import Path

import numpy as np

from forest_addon import kernels

NAMED, TWICE, KEPT = "KERNELS_UNDER_TEST", "KERNELS_TWICE", "KERNELS_KEPT"

if named := os.environ.get(NAMED):
    kernels.FILE = named  # an absolute path: the folders where it is looked for do not matter


def at_once(function):
    """A function that runs a second time beside itself, on copies of its arrays."""

    def both(*arguments):
        copies = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
        beside = threading.Thread(target=function, args=copies)
        beside.start()
        found = function(*arguments)
        beside.join()
        return found

    return both


def kept(function):
    """A function whose first call is kept in a file: its arguments before and after it."""
    file = Path(os.environ[KEPT]) / f"{function.__name__}.npz"

    def noted(*arguments):
        if file.exists():
            return function(*arguments)
        given = {f"given_{k:02d}": np.array(value) for k, value in enumerate(arguments)}
        found = function(*arguments)
        left = {f"left_{k:02d}": np.array(value) for k, value in enumerate(arguments)}
        np.savez(file, **given, **left)
        return found

    return noted


if found := kernels.library():
    for name in kernels.FUNCTIONS:
        for variable, around in ((TWICE, at_once), (KEPT, kept)):
            if os.environ.get(variable):
                setattr(found, name, around(getattr(found, name)))
