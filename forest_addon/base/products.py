"""Products of matrices of which BLAS makes no threads.

OpenBLAS shares a product out among threads where it is larger than 4 · 65,536 multiplications
(``interface/gemm.c``). They wait for each other by asking again and again: of many products of a millisecond
the threads mostly wait, and a machine with other work to do stands still.
"""

from __future__ import annotations

import numpy as np

ALONE = 4 * 65_536  # multiplications


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, M) of real matrices (N, K) and (K, M), in pieces of rows."""
    rows = max(1, ALONE // max(1, b.size))
    whole = len(a) // rows * rows
    if whole <= rows:
        return np.asarray(a @ b)
    found = np.empty((len(a), b.shape[1]), dtype=np.result_type(a, b))
    pieces = np.ascontiguousarray(a[:whole]).reshape(-1, rows, a.shape[1])
    np.matmul(pieces, b, out=found[:whole].reshape(-1, rows, b.shape[1]))
    found[whole:] = a[whole:] @ b
    return found
