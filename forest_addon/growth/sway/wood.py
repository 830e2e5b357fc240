"""Table of green wood: density and modulus of elasticity by genus, and what leaves weigh.

Where trees of a genus were tested as they grow in Europe: modulus in static bending and density as they
stand (ForestGALES: Locatelli et al. 2022, package fgr, ``species_parameters``; moduli of Lavers 1983, The
strength properties of timber). Of beech and oak that table's density, 1158 kg/m³, is nearly that of wood
full of water, and the handbook's stands here. Other genera: Forest Products Laboratory 2010, Wood handbook,
FPL-GTR-190, modulus of green wood by Table 5-3, the mean of the species of a genus, density by the specific
gravity on green volume there times one plus the mean moisture content of heartwood and sapwood (Table 4-1).
Apple: Markwardt & Wilson 1935. Moduli are those of the tests, of short beams of clear wood: the shear in
them takes a tenth, knots and young wood of whole stems take more (2.0 to 6.4 GPa in standing Sitka spruces,
whose sawn wood has 5.9: Milne & Blackburn 1989, Tree Physiol. 5:195).

Leaves: dry mass over the leaf area (BAAD, Falster et al. 2015: the geometric mean over studies of a genus of
their medians), which is half of the surface of needles whichever way a study counted (``measured/studies``),
as allometry draws it; fresh leaves have 0.4 of their mass dry. Needles weigh 0.22 kg/m² dry by their
one-sided area (Poorter et al. 2009, New Phytol. 182). Bark weighs as wood and stiffens nothing:
diameters inside of it are 0.87 to 0.93 of those over it (Husch, Beers & Kershaw 2003, Forest Mensuration,
ch. 6), of thin-barked genera more.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...spec import Species

DRY = 0.4  # dry mass of leaves over the fresh one
BROAD_LEAF, NEEDLE = 0.053, 0.22  # kg/m² dry, by one-sided area
INSIDE = 0.92  # diameter without bark over that with it
THIN_BARK = {"fagus": 0.97, "picea": 0.95, "abies": 0.95}
TORSION = 0.065  # shear modulus over modulus of elasticity (Wood handbook, Table 5-1)
EVERGREEN = ("picea", "pinus", "pseudotsuga", "abies")


@dataclass(frozen=True)
class GreenWood:
    """Wood as it stands: density kg/m³, modulus of elasticity Pa, fresh leaf mass kg by m² of leaf area.

    inside : diameter inside of the bark over that outside. one_sided : m² of one side of leaves in a m² of
    leaf area.
    """

    density: float
    modulus: float
    leaf_mass: float = BROAD_LEAF / DRY
    inside: float = 1.0
    one_sided: float = 1.0


# genus: modulus GPa, density kg/m³, dry leaf mass kg/m²
CONIFERS = {
    "picea": (6.3, 850.0, 0.173),
    "pinus": (7.3, 850.0, 0.228),
    "pseudotsuga": (8.3, 850.0, 0.202),
    "abies": (5.7, 850.0, 0.133),
    "larix": (7.9, 850.0, BROAD_LEAF),
}
BROADLEAVES = {
    "fagus": (9.8, 916.0, 0.052),
    "acer": (8.7, 848.0, 0.056),
    "betula": (9.9, 900.0, 0.050),
    "fraxinus": (9.8, 810.0, BROAD_LEAF),
    "quercus": (8.3, 1003.0, 0.082),
    "populus": (6.8, 785.0, BROAD_LEAF),
    "tilia": (7.2, 662.0, BROAD_LEAF),
    "malus": (7.2, 1083.0, BROAD_LEAF),
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
    genus = genus_of(species)
    if genus:
        return wood_of_genus(genus)
    return _mean(CONIFERS if species.needles is not None else BROADLEAVES)


def genus_of(species: Species) -> str:
    """Genus of the table that a species' allometry or name says; "": none."""
    target = species.targets.allometry if species.targets is not None else ""
    words = f"{target} {species.name}".lower().replace("-", " ").replace("_", " ").split()
    for word in words:
        for start, genus in {
            **ENGLISH,
            **{name: name for name in (*CONIFERS, *BROADLEAVES)},
        }.items():
            if word == start or (len(start) > 3 and word.startswith(start)):
                return genus
    return ""


def wood_of_genus(genus: str) -> GreenWood:
    """Green wood of a genus of the table.

    Raises
    ------
    KeyError : it is not in the table.
    """
    modulus, density, leaf = {**CONIFERS, **BROADLEAVES}[genus]
    inside = THIN_BARK.get(genus, INSIDE)
    one_sided = min(1.0, leaf / NEEDLE) if genus in EVERGREEN else 1.0
    return GreenWood(density, 1e9 * modulus, leaf / DRY, inside, one_sided)


def _mean(table: dict[str, tuple[float, float, float]]) -> GreenWood:
    woods = [wood_of_genus(genus) for genus in table]
    means = [
        sum(getattr(wood, name) for wood in woods) / len(woods)
        for name in ("density", "modulus", "leaf_mass", "inside", "one_sided")
    ]
    return GreenWood(*means)
