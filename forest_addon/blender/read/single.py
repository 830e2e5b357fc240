"""Numbers as they were typed: Blender keeps them in single precision.

0.002 that was typed, or read from a scene file, comes back from Blender as 0.0020000000949949026;
``shortest`` makes it 0.002 again.
"""

from __future__ import annotations

import struct


def shortest(value: float) -> float:
    """The shortest decimal with the same single-precision number as ``value``."""
    stored = struct.pack("f", value)
    return next(
        (
            decimal
            for digits in range(1, 10)
            if struct.pack("f", decimal := float(f"{value:.{digits}g}")) == stored
        ),
        value,
    )
