"""Table of green wood: density and modulus of elasticity by genus, and what leaves weigh.

Modulus: static bending of green wood (Forest Products Laboratory 2010, Wood handbook, FPL-GTR-190, Tables
5-3 and 5-5), the mean of the species of a genus, with the ten per cent that the handbook adds for the shear
in such tests. Density: specific gravity on green volume (the same tables) times one plus the mean moisture
content of heartwood and sapwood (Table 4-1). Apple: Markwardt & Wilson 1935. Leaves: dry mass by area of
deciduous broadleaves and of conifers (Poorter et al. 2009, New Phytol. 182), of which fresh leaves are 0.4.
Bark weighs as wood and stiffens nothing: diameters inside of it are 0.87 to 0.93 of those over it (Husch,
Beers & Kershaw 2003, Forest Mensuration, ch. 6), of thin-barked genera more.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...spec import Species

SHEAR = 1.1  # by which the handbook corrects moduli of short beams
BROAD_LEAF, NEEDLE = 0.19, 0.55  # kg/m²
INSIDE = 0.92  # diameter without bark over that with it
THIN_BARK = {"fagus": 0.97, "picea": 0.95, "abies": 0.95}
TORSION = 0.065  # shear modulus over modulus of elasticity (Wood handbook, Table 5-1)


@dataclass(frozen=True)
class GreenWood:
    """Wood as it stands: density kg/m³, modulus of elasticity Pa, leaf mass by one-sided area kg/m².

    inside : diameter inside of the bark over that outside.
    """

    density: float
    modulus: float
    leaf_mass: float = BROAD_LEAF
    inside: float = 1.0


# genus: handbook modulus GPa, specific gravity, mean moisture content
CONIFERS = {
    "picea": (8.4, 0.365, 0.95),
    "pinus": (8.2, 0.41, 0.82),
    "pseudotsuga": (10.8, 0.45, 0.76),
    "abies": (8.7, 0.355, 1.12),
    "larix": (10.1, 0.48, 0.865),
}
BROADLEAVES = {
    "fagus": (9.5, 0.56, 0.635),
    "acer": (8.7, 0.49, 0.73),
    "betula": (9.9, 0.543, 0.753),
    "fraxinus": (9.8, 0.54, 0.50),
    "quercus": (9.0, 0.58, 0.73),
    "populus": (6.8, 0.343, 1.29),
    "tilia": (7.2, 0.32, 1.07),
    "malus": (7.2, 0.61, 0.775),
}
ENGLISH = {
    "spruce": "picea",
    "pine": "pinus",
    "douglas": "pseudotsuga",
    "fir": "abies",
    "larch": "larix",
    "beech": "fagus",
    "maple": "acer",
    "birch": "betula",
    "hazel": "betula",
    "corylus": "betula",
    "ash": "fraxinus",
    "oak": "quercus",
    "aspen": "populus",
    "linden": "tilia",
    "apple": "malus",
}


def wood_of_species(species: Species) -> GreenWood:
    """Green wood of a species, by the genus that its allometry or name says, else the mean of its kind."""
    target = species.targets.allometry if species.targets is not None else ""
    words = f"{target} {species.name}".lower().replace("-", " ").replace("_", " ").split()
    for word in words:
        for start, genus in {
            **ENGLISH,
            **{name: name for name in (*CONIFERS, *BROADLEAVES)},
        }.items():
            if word == start or (len(start) > 3 and word.startswith(start)):
                return wood_of_genus(genus)
    return (
        _mean(CONIFERS, NEEDLE) if species.needles is not None else _mean(BROADLEAVES, BROAD_LEAF)
    )


def wood_of_genus(genus: str) -> GreenWood:
    """Green wood of a genus of the table.

    Raises
    ------
    KeyError : it is not in the table.
    """
    modulus, gravity, water = {**CONIFERS, **BROADLEAVES}[genus]
    leaf = NEEDLE if genus in CONIFERS and genus != "larix" else BROAD_LEAF
    inside = THIN_BARK.get(genus, INSIDE)
    return GreenWood(1000 * gravity * (1 + water), SHEAR * 1e9 * modulus, leaf, inside)


def _mean(table: dict[str, tuple[float, float, float]], leaf: float) -> GreenWood:
    woods = [wood_of_genus(genus) for genus in table]
    count = len(woods)
    density = sum(wood.density for wood in woods) / count
    return GreenWood(density, sum(wood.modulus for wood in woods) / count, leaf, INSIDE)
