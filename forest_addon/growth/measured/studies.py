"""Leaf areas of measured conifers as half of all their surface, whichever way a study counted them.

The mean shadow of a needle over all directions is a quarter of its surface (Cauchy 1841), so that half of the
surface (Chen & Black 1992) is the one-sided area of a flat leaf that hides as much. BAAD (Falster et al.
2015) keeps what each study gave: all of the surface, or the outline that a scanner saw. Half of the surface
is 1/0.778 outlines of a pine's needle and 1.14 of other conifers' (Barclay & Goodman 2000, as BAAD's authors
convert theirs, github.com/RemkoDuursma/baadanalysis).

Which study counted how is told by BAAD's metadata, but for these. Monserud1999: the table holds all of the
surface by mistake (BAAD's issue 226). Maguire1998: from the same hand and marked as outlines, but 10.4 m²/kg,
where outlines of spruce needles are 3.5 to 6 (Hager & Sterba 1985: 5.0 ± 1.7); taken as all of the surface.
Reid2004: marked as all of the surface, but scanned, and 2.8 m²/kg where all of the same species' surface is
6.1 (Garber2005); taken as outlines. OHara1995: all of the surface by its author's own word in BAAD's review;
its diameters are inches, in which sapwood fits into the stems and in centimetres does not.
"""

from __future__ import annotations

import numpy as np

from ...spec import SpecError

HALF_OVER_OUTLINE = {"Pinus": 1 / 0.778, "": 1.14}
WAYS = ("half", "all", "outline")
# How a study counted, and for genera of which otherwise.
COUNTED: dict[str, str | dict[str, str]] = {
    "Aspinwall2013": "outline",
    "Burger1953": "all",
    "Garber2005": {"Abies": "outline", "Pinus": "all"},
    "Hagihara1993": "outline",
    "Iijima1991": "outline",
    "Maguire1998": "all",
    "Monserud1999": "all",
    "Mori1991": "outline",
    "Nakagaki1983": "outline",
    "Nishioka1982": "outline",
    "OHara1995": "all",
    "OHara2014": "outline",
    "Reid2004": "outline",
    "Roberts2003": "outline",
    "Satoo1974a": "outline",
    "Satoo1974d": "outline",
    "Tanao1982": "outline",
    "Vanninen2005": "all",
    "Yamaji1991": "outline",
    "Yoda1978": "outline",
}
DIAMETER_UNITS = {"OHara1995": 2.54}  # of centimetres, what a study calls one


def half_of_surface(
    area: np.ndarray, species: np.ndarray, pft: np.ndarray, study: np.ndarray, way: np.ndarray
) -> np.ndarray:
    """(N,) leaf areas (N,) as half of the surface.

    pft : (N,) functional types of BAAD; those of broadleaves (ending in A) are left. way : (N,) one of
    ``WAYS`` where the table tells it, or empty: by ``COUNTED``, half of the surface for others.

    Raises
    ------
    SpecError : a way is none of these.
    """
    for row in np.flatnonzero(~np.isin(way, ("", *WAYS))):
        raise SpecError(
            "leaf_area_is", f'row {row + 2}: "{way[row]}" is none of {", ".join(WAYS)}; correct it'
        )
    factor = np.ones(len(area))
    for row in np.flatnonzero(np.char.endswith(pft, "G") | (way != "")):
        genus = str(species[row]).partition(" ")[0]
        counted = COUNTED.get(str(study[row]), "half")
        told = counted if isinstance(counted, str) else counted.get(genus, "half")
        outline = HALF_OVER_OUTLINE.get(genus, HALF_OVER_OUTLINE[""])
        factor[row] = {"half": 1.0, "all": 0.5, "outline": outline}[str(way[row]) or told]
    return area * factor


def diameters(dbh: np.ndarray, study: np.ndarray) -> np.ndarray:
    """(N,) diameters (N,) in the table's unit, those of studies that measured in another put right."""
    return dbh * np.array([DIAMETER_UNITS.get(str(name), 1.0) for name in study])
