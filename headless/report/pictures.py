"""Names that the studies draw by."""

from forest_addon.drawing.figures import STYLE, blank_figure, save_figure
from forest_addon.drawing.palette import BARK, FAINT, INK, LEAF_GREEN, RED

__all__ = ["BARK", "FAINT", "INK", "LEAF_GREEN", "RED", "STYLE", "blank_figure", "save_figure"]
