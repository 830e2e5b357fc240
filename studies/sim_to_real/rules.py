"""TLSeparation (Vicari et al. 2019, Methods Ecol. Evol. 10:680), the rules that tell wood from leaf.

Version 1.3.3 was written for Python 2 and numpy before 1.20. Words that have gone since are replaced as it
is imported (dictionaries' ``iteritems`` and lists of keys, ``numpy.int``); its rules are as published.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import warnings
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec
from types import CodeType

import numpy as np
from scipy.spatial import cKDTree

NAME = "tlseparation"
NOW = (
    (r"\.iteritems\(\)", ".items()"),
    (r"(\w+)\.(keys|values)\(\)", r"list(\1.\2())"),
    (r"np\.(int|float|bool)\b(?!_|\d)", r"\1"),
    (r"np\.in1d\b", "np.isin"),
)


def can_separate() -> bool:
    """Tell whether TLSeparation is installed."""
    return find_spec(NAME) is not None


def wood_by_rules(points: np.ndarray) -> np.ndarray:
    """(P,) whether the points (P, 3), metres, of a tree are wood, by ``large_tree_3`` as it
    comes; ``generic_tree`` fails where a cloud has no points of its class trunk.

    Raises
    ------
    ImportError : it is not installed.
    """
    finder = _SeparationFinder()
    sys.meta_path.insert(0, finder)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            from tlseparation.scripts.automated_separation import large_tree_3

            wood = large_tree_3(np.asarray(points, dtype=np.float64))[0]
    finally:
        sys.meta_path.remove(finder)
    found = np.zeros(len(points), dtype=bool)
    if len(wood):
        found[cKDTree(points).query(wood)[1]] = True
    return found


class _SeparationFinder(PathFinder):
    """Finds the modules of TLSeparation, and has them translated."""

    @classmethod
    def find_spec(cls, fullname: str, path=None, target=None) -> ModuleSpec | None:
        """Return the place of a module; None of other packages."""
        if fullname.split(".")[0] != NAME:
            return None
        spec = super().find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Translated(fullname, spec.origin)
        return spec


class _Translated(SourceFileLoader):
    """Loads a module of Python 2's time in today's words."""

    def get_code(self, fullname: str) -> CodeType:
        """Return the compiled module; never from a cache, which holds it as it was."""
        path = self.get_filename(fullname)
        text = self.get_data(path).decode("utf-8")
        for old, new in NOW:
            text = re.sub(old, new, text)
        return self.source_to_code(text.encode("utf-8"), path)
