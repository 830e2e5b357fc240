"""Looks of a species from close by: colours, and the texture and relief of its bark."""

from __future__ import annotations

from .base import Settings, param


class Look(Settings):
    """Colours of bark and leaves, linear RGB from 0 to 1."""

    bark: tuple[float, float, float] = param((0.09, 0.06, 0.04), help="bark colour", ge=0, le=1)
    leaf: tuple[float, float, float] = param((0.06, 0.15, 0.02), help="leaf colour", ge=0, le=1)
    autumn: float = param(
        0.0, help="how far leaves have turned: 0 summer, 1 autumn (winter: leaves off)", ge=0, le=1
    )
    autumn_leaf: tuple[float, float, float] = param(
        (0.42, 0.19, 0.025), help="colour of leaves that have turned", ge=0, le=1
    )

    def foliage(self) -> tuple[float, float, float]:
        """The colour that leaves have in their season."""
        pairs = zip(self.leaf, self.autumn_leaf, strict=True)
        r, g, b = (summer + self.autumn * (turned - summer) for summer, turned in pairs)
        return r, g, b


class Bark(Settings):
    """Bark: its texture in pictures, and its relief where that is meshed (``detail.relief``).

    Relief and oval shape leave the area of every cross-section as it is, and so volume and DBH (that of the
    circle of the same area).
    """

    texture: str = param(
        "cracked",
        help="what its surface is like",
        choices=("cracked", "smooth", "furrowed", "plated", "peeling"),
    )
    size: float = param(
        0.04, unit="m", help="width of a ridge or plate on a thick stem", ge=0.005, le=0.5
    )
    upper: tuple[float, float, float] = param(
        (0.30, 0.14, 0.06), help="colour of the upper stem and its branches", ge=0, le=1
    )
    upper_from: float = param(
        1.0, help="height from which bark has that colour, of the tree's; 1: nowhere", ge=0, le=1
    )
    moss: float = param(
        0.15, help="how much green there is on the foot of the stem: 0 none, 1 covered", ge=0, le=1
    )
    relief: float = param(
        0.006,
        unit="m",
        help="depth of furrows, from their ground to the ridges, on a stem thicker than 24 cm; in "
        "proportion on a thinner one",
        ge=0,
        le=0.1,
    )
    ovality: float = param(
        0.05,
        help="largest less smallest diameter of a cross-section, over their mean",
        ge=0,
        le=0.4,
    )
