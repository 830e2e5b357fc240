"""Everything a user can set: each parameter once, with unit, range, default and help.

A scene file, the Python API and Blender's panel are all made from these frozen dataclasses. A field
is declared with ``param``; a value that is out of range never becomes an object, it raises
``SpecError`` with the key, the value and what is allowed. Lengths are metres, times seconds,
frequencies hertz; angles are degrees here (``_deg``), because people type them, and radians everywhere
else.
"""

from .air import Air
from .allometry import Allometry, Law
from .architecture import Architecture, DeadBranches
from .auto import Choice
from .base import (
    AUTO,
    Discrete,
    Normal,
    Param,
    Settings,
    SpecError,
    param,
    param_of,
    refuse_unknown,
    with_files,
    within,
)
from .crown import Crown, Needles, Targets
from .flight import Flight
from .forest import (
    Clearing,
    Clusters,
    Corners,
    Distance,
    Forest,
    Gaussian,
    HandTree,
    Planting,
    Raster,
    Rows,
    Stems,
    Strauss,
    Terrain,
)
from .lidar import (
    Airborne,
    Beam,
    Mobile,
    MovingScanner,
    Noise,
    Pose,
    Receiver,
    Scanner,
    Surfaces,
    Terrestrial,
    Tractor,
)
from .link import LinkBudget
from .looks import Bark, Look
from .polished import POLISHED, USUAL_INDEX, Polished, property_of
from .problem import did_you_mean, quoted_with_hints, refuse_absurd, unknown
from .reverb import Place, Reverb
from .scene import SENSORS, Accuracy, Output, Rays, Scene, Tiles
from .sensor import Sensor
from .sonar import HORSESHOE_BAND, Sonar
from .species import (
    MAX_REACH,
    Detail,
    Grammar,
    Honda,
    Inclination,
    Jitter,
    Leaf,
    Rules,
    Siblings,
    Species,
    Template,
)
from .wind import Wind

__all__ = [
    "AUTO",
    "HORSESHOE_BAND",
    "MAX_REACH",
    "POLISHED",
    "SENSORS",
    "USUAL_INDEX",
    "Accuracy",
    "Air",
    "Airborne",
    "Allometry",
    "Architecture",
    "Bark",
    "Beam",
    "Choice",
    "Clearing",
    "Clusters",
    "Corners",
    "Crown",
    "DeadBranches",
    "Detail",
    "Discrete",
    "Distance",
    "Flight",
    "Forest",
    "Gaussian",
    "Grammar",
    "HandTree",
    "Honda",
    "Inclination",
    "Jitter",
    "Law",
    "Leaf",
    "LinkBudget",
    "Look",
    "Mobile",
    "MovingScanner",
    "Needles",
    "Noise",
    "Normal",
    "Output",
    "Param",
    "Place",
    "Planting",
    "Polished",
    "Pose",
    "Raster",
    "Rays",
    "Receiver",
    "Reverb",
    "Rows",
    "Rules",
    "Scanner",
    "Scene",
    "Sensor",
    "Settings",
    "Siblings",
    "Sonar",
    "SpecError",
    "Species",
    "Stems",
    "Strauss",
    "Surfaces",
    "Targets",
    "Template",
    "Terrain",
    "Terrestrial",
    "Tiles",
    "Tractor",
    "Wind",
    "did_you_mean",
    "param",
    "param_of",
    "property_of",
    "quoted_with_hints",
    "refuse_absurd",
    "refuse_unknown",
    "unknown",
    "with_files",
    "within",
]
