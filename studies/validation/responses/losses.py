"""Losses of level sound in plausible stands, term by term and octave by octave, in dB a metre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from forest_addon.acoustics.air import DB_PER_NEPER
from forest_addon.acoustics.extinction import cross_sections
from forest_addon.sensing.reverb.forest.losses import Losses, TrunkStand
from forest_addon.sensing.reverb.forest.surroundings import FoliageCanopy, clutter_around

from ..comparison import Comparison, Interval
from .stands import Path, PlausibleStand, settings


def losses_of(stand: PlausibleStand, path: Path, bands: np.ndarray) -> dict[str, np.ndarray]:
    """{term: (B,) dB a metre}, taken for good or scattered away; bark of trunks as of trunks that are met."""
    reverb = settings(stand, path)
    canopy = replace(FoliageCanopy(), top=stand.trunk_height, clutter=stand.clutter)
    ends = np.array(reverb.source), np.array(reverb.receiver)

    def along(**changes: object) -> Losses:
        given = replace(reverb, **changes)
        clutter = clutter_around(given, canopy)
        around = TrunkStand(
            stand.density,
            (stand.radius,),
            stand.leaf_area_density if given.foliage else 0.0,
            0.0,
            clutter,
        )
        return Losses.of(given, path.air, around, *ends)

    dry = along(boundary_loss=False, bark=0.0)
    barked, wet = along(boundary_loss=False), along(bark=0.0)
    scattered = dry.of_clutter(bands) - dry.of_leaves(bands)
    size = 2.0 * np.pi * bands / path.air.speed() * stand.radius
    trunks = stand.density * stand.radius
    found = {
        "air": dry.of_air(bands),
        "leaves absorb": dry.of_leaves(bands),
        "bark of trunks": 0.5 * trunks * cross_sections(size, stand.bark).absorption,
        "bark of branches": barked.of_clutter(bands) - dry.of_clutter(bands),
        "air at branches": wet.of_clutter(bands) - dry.of_clutter(bands),
        "branches and leaves scatter": scattered,
        "trunks scatter": 0.5 * dry.removed(bands),
    }
    return {name: DB_PER_NEPER * values for name, values in found.items()}


def judge_losses(
    stands: Sequence[PlausibleStand], path: Path, bands: np.ndarray
) -> list[Comparison]:
    """A row an octave: the sum of what is taken for good, and each term's median."""
    every = [losses_of(stand, path, bands) for stand in stands]
    found = []
    for n, band in enumerate(bands):
        terms = {name: np.array([each[name][n] for each in every]) for name in every[0]}
        for_good = sum(values for name, values in terms.items() if "scatter" not in name)
        words = ", ".join(
            f"{name} {np.median(v):.4f} (at most {v.max():.4f})" for name, v in terms.items()
        )
        found.append(
            Comparison(
                f"Koli, what level sound loses for good at {band:g} Hz",
                "dB/m",
                None,
                Interval.of(np.asarray(for_good)),
                None,
                f"Medians of {len(stands)} stands: {words} dB/m.",
            )
        )
    return found
