"""Plantings of a scene of a dataset: which species, how their densities are shared, in which season."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library.species_file import find_species
from forest_addon.spec import Species

from .settings import Mix

SHEDDING = (  # measured kinds (assets/allometry) that lose their leaves in a winter
    *("acer", "betula", "corylus", "deciduous-broadleaf", "deciduous-conifer", "fagus", "larix"),
    *("malus", "populus", "quercus"),
)


def mixed(mix: Mix, species: Sequence[str], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Draw plantings of some of the species, with shares of the mix's density."""
    most = min(mix.kinds[1], len(species))
    kinds = int(rng.integers(min(mix.kinds[0], most), most + 1))
    chosen = sorted(rng.permutation(len(species))[:kinds].tolist())
    shares = rng.dirichlet(np.full(kinds, mix.evenness))
    return [
        {
            "species": species[which],
            "density": float(mix.density * share),
            "variants": mix.variants,
            "scale": list(mix.scale),
        }
        for which, share in zip(chosen, shares, strict=True)
    ]


def redealt(
    plantings: Sequence[Mapping[str, Any]], parameter: float, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Deal the densities of plantings anew: their sum stays, and the mean of every share.

    parameter : of the Dirichlet distribution, times the number of plantings. Plantings without a density
    stay as they are.
    """
    found = [dict(one) for one in plantings]
    mine = [one for one in found if one.get("density")]
    if len(mine) > 1:
        density = np.array([float(one["density"]) for one in mine])
        shares = rng.dirichlet(parameter * len(mine) * density / density.sum())
        for one, value in zip(mine, (shares * density.sum()).tolist(), strict=True):
            one["density"] = value
    return found


def in_season(
    plantings: Sequence[Mapping[str, Any]], season: float, folder: Path
) -> list[dict[str, Any]]:
    """Set the season of the plantings whose species sheds its leaves. folder : of the scene."""
    return [
        {**one, "season": season} if _sheds(str(one["species"]), folder) else dict(one)
        for one in plantings
    ]


@cache
def _sheds(name: str, folder: Path) -> bool:
    """Return whether a species is of a measured kind that loses its leaves."""
    species = read_settings(find_species(name, folder), Species)
    return species.targets is not None and species.targets.allometry in SHEDDING
