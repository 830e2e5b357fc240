"""Where measurements lie that are not shipped: what FOREST_MEASURED says, or shared/ above the code."""

import os
from pathlib import Path

import pytest

HERE = Path(__file__).resolve()
FOUND = next(
    (
        place
        for place in (
            *([Path(os.environ["FOREST_MEASURED"])] if "FOREST_MEASURED" in os.environ else []),
            *(folder / "shared" / "data" / "measured" for folder in HERE.parents),
        )
        if place.is_dir()
    ),
    None,
)
needs_measurements = pytest.mark.skipif(FOUND is None, reason="the measurements are not here")
