"""Chance of a species: without, all its trees are one tree, wherever and in whichever split.

Trees of templates, of crowns and of Honda's branches with a spread of lengths draw numbers that no two share.
Of all others two are grown from streams of their own and compared.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.tree import grow
from forest_addon.spec import SpecError, Species


def refuse_without_chance(species: Iterable[tuple[str, Path, set[str]]]) -> None:
    """Refuse species, each with the folder its file starts from and the splits it stands in.

    Raises
    ------
    SpecError : one of more than one split whose trees are all the same.
    """
    for name, folder, splits in species:
        if len(splits) > 1 and not knows_chance(name, folder):
            raise SpecError(
                "splits",
                f'"{name}" knows no chance, so {" and ".join(sorted(splits))} would share its one tree; '
                'choose another species, splits.by = "species", or splits.share_trees = true',
            )


@cache
def knows_chance(name: str, folder: Path) -> bool:
    """Return whether two trees of a species differ."""
    path = find_species(name, folder)
    species = read_settings(path, Species)
    if species.template is not None or species.crown is not None or species.targets is not None:
        return True
    if species.rules is None and species.honda is not None and species.honda.length.sd > 0:
        return True
    kind = load_species(path)
    one, other = (grow(*kind, stream(0, "chance", number)).mesh.vertices for number in (1, 2))
    return not np.array_equal(one, other)
