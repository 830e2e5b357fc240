"""The colours of everything that is drawn, each with its meaning."""

from ..base.trimesh import DEAD, GROUND, LEAF, OTHER, WOOD
from ..sensing.lidar.cloud import ESCAPED

INK, FAINT, PAPER, SKY = "#24302a", "#b9c2bb", "#f4f2ec", "#eef3f6"
LEAF_GREEN, BARK, SOIL, RED = "#4c8c3a", "#7a5230", "#cdb892", "#c8442c"
BLUE, VIOLET = "#2b5f8a", "#8a6bb0"
LINES = (BLUE, LEAF_GREEN, BARK, RED, VIOLET, INK)  # curves of one plot

# Class of a return -> its name and colour.
ORGANS = {
    ESCAPED: ("sky", SKY),
    OTHER: ("other", "#8d8d99"),
    WOOD: ("wood", BARK),
    LEAF: ("leaf", LEAF_GREEN),
    GROUND: ("ground", SOIL),
    DEAD: ("dead wood", "#8c8378"),
}

# Species, told apart also by those who see no red or green (Okabe and Ito 2008), in an order that fits trees.
SPECIES = {
    "green": "#00724f",
    "orange": "#d55e00",
    "blue": "#0072b2",
    "pink": "#c4638f",
    "gold": "#b8860b",
    "light blue": "#3b9fd6",
    "violet": "#6b4c9a",
    "grey": "#4a4a4a",
}


def species_colour(number: int) -> str:
    """Colour of the species of this number; they repeat after eight."""
    return list(SPECIES.values())[number % len(SPECIES)]


def rgb(colour: str) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1, of ``#rrggbb``."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
