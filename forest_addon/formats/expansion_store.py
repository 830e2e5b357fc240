"""Expansions of trunk scattering kept in a folder, so that they are computed once a machine.

One NPZ a key, written under a temporary name and renamed: two processes may write the same one. A file
that cannot be read, or that holds another key, counts as none; the folder can be deleted at any time.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np

from ..sensing.reverb.expansion import Key, Layer, Sector
from .atomic import replacing


class ExpansionStore:
    """A folder of expansions; made when the first one is saved."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)

    def path(self, key: Key) -> Path:
        """Where the expansion of a key lies, whether it is there or not."""
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:24]
        return self.folder / f"trunk-{name}.npz"

    def load(self, key: Key) -> tuple[Layer, ...] | None:
        """The layers of a key, None where there are none to be had."""
        try:
            with np.load(self.path(key), allow_pickle=False) as stored:
                if str(stored["key"]) != repr(key):
                    return None
                return tuple(
                    Layer(
                        int(step),
                        tuple(_sector(stored, f"{layer}_{number}") for number in range(count)),
                    )
                    for layer, (step, count) in enumerate(stored["layers"].tolist())
                )
        except Exception:  # a broken file fails in many ways, and is computed again
            return None

    def save(self, key: Key, layers: tuple[Layer, ...]) -> None:
        """Keep the layers of a key; a folder that cannot be written to keeps nothing."""
        arrays = {
            "key": np.array(repr(key)),
            "layers": np.array([(layer.step, len(layer.sectors)) for layer in layers]),
        }
        for n, layer in enumerate(layers):
            for number, sector in enumerate(layer.sectors):
                ends = np.array([sector.low, sector.high, sector.lead])
                parts = {"ends": ends, "filters": sector.filters, "series": sector.series}
                arrays |= {f"{n}_{number}_{name}": part for name, part in parts.items()}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with replacing(self.path(key)) as partial, open(partial, "wb") as file:
                np.savez(file, **arrays)  # type: ignore[arg-type]
        except OSError:
            return


def _sector(stored: np.lib.npyio.NpzFile, name: str) -> Sector:
    low, high, lead = stored[f"{name}_ends"].tolist()
    filters, series = stored[f"{name}_filters"], stored[f"{name}_series"]
    if filters.ndim != 2 or series.ndim != 4 or len(filters) != series.shape[3]:
        raise ValueError("not an expansion")
    return Sector(low, high, filters, series, int(lead))
