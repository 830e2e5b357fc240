"""Leading singular vectors of a matrix, the same to the byte on any number of threads."""

from __future__ import annotations

import math

import numpy as np

FAINTEST = 1e-6  # of the largest, that single precision still holds
TURNS = 1  # of the iteration


def leading(values: np.ndarray, count: int) -> np.ndarray:
    """(K, R) orthonormal, nearly the leading left singular vectors of values (K, N): ``count`` or, where that
    leaves nothing but rounding, fewer.

    From the columns that are farthest from what is spanned by those before, by steps of orthogonal
    iteration (Golub & Van Loan 2013, section 8.2.4). Without LAPACK, whose last digits depend on how many
    threads there are.
    """
    rest, found = values.copy(), np.zeros((len(values), count), np.complex128)
    largest = 0.0
    for number in range(count):
        size = np.einsum("kn,kn->n", rest.real, rest.real)
        size += np.einsum("kn,kn->n", rest.imag, rest.imag)
        largest = max(largest, float(size.max()))
        if size.max() <= FAINTEST**2 * largest:
            found = np.ascontiguousarray(found[:, :number])
            break
        found[:, number] = rest[:, int(size.argmax())]
        _orthogonal(found, number)
        rest -= found[:, number, None] * np.einsum("k,kn->n", np.conj(found[:, number]), rest)
    for _ in range(TURNS):
        found = np.einsum("kn,nr->kr", values, np.einsum("kn,kr->nr", np.conj(values), found))
        for number in range(found.shape[1]):
            _orthogonal(found, number)
    return found


def _orthogonal(columns: np.ndarray, number: int) -> None:
    """Make a column orthogonal to those before, and of length 1; twice is enough (Kahan)."""
    one, before = columns[:, number], columns[:, :number]
    for _ in range(2):
        one -= np.einsum("kr,r->k", before, np.einsum("kr,k->r", np.conj(before), one))
    one /= math.sqrt(float(np.sum(one.real**2 + one.imag**2)))
