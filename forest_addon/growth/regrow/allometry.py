"""Allometry of siblings: measured exponents of height and crown over the stem, and the spread within one
stand.

log H = log H' + h·log(D/D') along a tree's life, log W likewise with w for the width of the crown, D the
diameter at breast height. Exponents by ordinary least squares on logarithms within each study and
species of BAAD (Falster et al. 2015, Ecology 96:1445; CC0), trees over 2 m: 5,665 for heights, 1,843 for
crown widths; a genus without at least 50 widths has its group's. ``width_spread`` is what is left of log W.

Trees of one stand: medians over 16 plots of pine, 654 trees (La Rioja, in the R package FORTLS): log D
has a standard deviation of 0.145, and log H = 0.216·log D + 0.088·z. That is 0.43 of the spread of log H
that BAAD's trees of many stands have at one diameter (0.204); crown widths of one stand were not measured,
and are taken to differ by the same share.
"""

from __future__ import annotations

from dataclasses import dataclass

DBH_SPREAD = 0.145
HEIGHT_WITH_DBH, HEIGHT_SPREAD = 0.216, 0.088
WITHIN_STAND = 0.43
BREAST = 1.3  # metres


@dataclass(frozen=True)
class SiblingAllometry:
    """Exponents of height and crown width over diameter, and the spread of log width at one diameter."""

    height: float
    width: float
    width_spread: float


ALLOMETRY = {
    "any": SiblingAllometry(0.666, 0.606, 0.239),
    "broadleaf": SiblingAllometry(0.598, 0.619, 0.241),
    "conifer": SiblingAllometry(0.782, 0.596, 0.237),
    "abies": SiblingAllometry(0.815, 0.494, 0.182),
    "acer": SiblingAllometry(0.561, 0.619, 0.241),
    "betula": SiblingAllometry(0.721, 0.619, 0.241),
    "eucalyptus": SiblingAllometry(0.666, 0.684, 0.214),
    "fagus": SiblingAllometry(0.578, 0.619, 0.241),
    "larix": SiblingAllometry(0.819, 0.596, 0.237),
    "picea": SiblingAllometry(0.844, 0.605, 0.172),
    "pinus": SiblingAllometry(0.743, 0.701, 0.265),
    "populus": SiblingAllometry(0.721, 0.619, 0.241),
    "pseudotsuga": SiblingAllometry(0.790, 0.489, 0.269),
    "quercus": SiblingAllometry(0.531, 0.619, 0.241),
}
NAMES = {
    "abies": ("abies", "fir"),
    "acer": ("acer", "maple", "sycamore"),
    "betula": ("betula", "birch"),
    "eucalyptus": ("eucalyptus", "eucalypt", "gum"),
    "fagus": ("fagus", "beech"),
    "larix": ("larix", "larch"),
    "picea": ("picea", "spruce"),
    "pinus": ("pinus", "pine"),
    "populus": ("populus", "poplar", "aspen"),
    "pseudotsuga": ("pseudotsuga", "douglas"),
    "quercus": ("quercus", "oak"),
}


def allometry_of(name: str) -> str:
    """Return whose measurements to take for a species of this name; "any" where the name does not tell."""
    words = name.lower().replace("_", "-").split("-")
    for genus, names in NAMES.items():
        if any(word in words for word in names):
            return genus
    return "any"
