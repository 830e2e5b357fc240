"""Makes forest_addon/acoustics/hard_disc.npz: the exact disc's backscatter, about 10 s.

    python packaging/make_disc_table.py [--out FILE]

For each ka of ``disc_table.tabulated_ka`` the cosine series of k·f/level over the incidence, cut where
it has fallen below 1e-8, as complex64. The solver is good to 1e-11, so that the bytes hardly depend on
the machine.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    root = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(root), str(root / "tests")]

from references.discs import HardDisc

from forest_addon.acoustics.disc_table import FILE, tabulated_ka

SMALLEST = 1e-8


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Tabulate the sound-hard disc's backscatter.")
    parser.add_argument("--out", type=Path, default=FILE, help="file to write")
    out = parser.parse_args(arguments).out
    ka = tabulated_ka()
    rows = [series(float(value)) for value in ka]
    terms = np.array([len(row) for row in rows], dtype=np.int16)
    np.savez_compressed(out, ka=ka, terms=terms, series=np.concatenate(rows).astype(np.complex64))
    print(f"{out}: {len(ka)} sizes, {terms.sum()} terms, {out.stat().st_size / 1e3:.0f} kB")


def series(ka: float) -> np.ndarray:
    """(N,) complex c_n of k·f/level = Σ c_n cos 2nβ at one size, also a negative one."""
    if ka == 0:
        return np.full(2, -2.0 / (3.0 * math.pi) + 0j)  # Rayleigh: k·f = -(2/3π)(ka)³cos²β
    values = HardDisc(abs(ka)).backscatter_series() * math.sqrt(4.0 + ka * ka)
    last = np.flatnonzero(np.abs(values) > SMALLEST)[-1]
    return values[: last + 1] if ka > 0 else values[: last + 1].conj()


if __name__ == "__main__":
    main()
