"""Named arrays with units as a compressed NPZ, equal bytes for equal arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from .atomic import replacing


def write_npz(
    path: str | os.PathLike[str], arrays: Mapping[str, np.ndarray], units: Mapping[str, str]
) -> None:
    """Write arrays; ``units`` says what each is measured in and becomes ``<name>_unit`` texts."""
    texts = {f"{name}_unit": np.array(unit) for name, unit in units.items()}
    with replacing(path) as partial, open(partial, "wb") as file:
        np.savez_compressed(file, **dict(arrays), **texts)  # type: ignore[arg-type]
