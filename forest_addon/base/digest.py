"""Digests, by which what is made of the same is known again."""

from __future__ import annotations

import json
from collections.abc import Iterable
from hashlib import blake2b
from typing import Any

import numpy as np


def digest(parts: Iterable[Any]) -> str:
    """Hexadecimal BLAKE2b of parts, one after the other: bytes and arrays as they are, all else as JSON."""
    total = blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, np.ndarray):
            part = np.ascontiguousarray(part)
        elif not isinstance(part, bytes):
            part = json.dumps(part, sort_keys=True, default=str).encode()
        total.update(part)
    return total.hexdigest()
