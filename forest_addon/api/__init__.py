"""The Python API: what a script, a notebook or Blender's console calls.

::

    from forest_addon import api as forest

    scene = forest.read("my.toml")                     # or forest.Scene(...), or scene.changed(seed=8)
    world = forest.build(scene)                        # grown, and built in Blender
    world = forest.current()                           # or what stands in Blender now
    cloud = world.scan(forest.Terrestrial(position=(0, 0, 1.6)))
    echo = world.ping(forest.Sonar(position=(3, 0, 1.5)))
    sound = world.impulse_response(forest.Reverb(source=(0, 0, 1.5), receiver=(9, 0, 1.5)))
    cloud.save("cloud.laz")
    table = cloud.to_pandas()                          # or to_xarray()
    world.scan_to("large.laz", forest.Terrestrial())   # of any size, in constant memory
    tiling = forest.Tiling.of(scene)                   # with tiles=forest.Tiles(size=100): any field
    tiling.scan_to("larger.laz", forest.Airborne())

Settings (``Scene``, ``Terrestrial``, ...) are those of a scene file, each checked when it is made. They
need no Blender; ``build`` and ``current`` do: ``bpy`` from PyPI, or Blender itself. What cannot be used
raises ``SpecError`` with one sentence.

These names stay: a later version may add to them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ..base.progress import Progress
from ..spec import (
    Accuracy,
    Air,
    Airborne,
    Allometry,
    Architecture,
    Bark,
    Beam,
    Clearing,
    Clusters,
    Crown,
    DeadBranches,
    Detail,
    Discrete,
    Distance,
    Flight,
    Forest,
    Gaussian,
    Grammar,
    HandTree,
    Honda,
    Inclination,
    Jitter,
    Law,
    Leaf,
    LinkBudget,
    Look,
    Mobile,
    MovingScanner,
    Needles,
    Noise,
    Normal,
    Output,
    Place,
    Planting,
    Pose,
    Raster,
    Rays,
    Receiver,
    Reverb,
    Rows,
    Rules,
    Scanner,
    Scene,
    Sensor,
    Siblings,
    Sonar,
    SonarReceiver,
    SpecError,
    Species,
    Stems,
    Strauss,
    Surfaces,
    Targets,
    Template,
    Terrain,
    Terrestrial,
    Tiles,
    Tractor,
    Wind,
)

if TYPE_CHECKING:
    from .given import instrument, instruments, save_pattern, trajectory
    from .results import Echoes, PointCloud, Response, Result, RowScan, crowns
    from .tiles import Tile, TiledScan, Tiling
    from .world import Site, World, build, current, read

_LATER = {  # all but settings, imported when it is asked for
    **dict.fromkeys(("instrument", "instruments", "save_pattern", "trajectory"), ".given"),
    **dict.fromkeys(
        ("Echoes", "PointCloud", "Response", "Result", "RowScan", "crowns"), ".results"
    ),
    **dict.fromkeys(("Site", "build", "current", "read"), ".world"),
    **dict.fromkeys(("Tile", "TiledScan", "Tiling"), ".tiles"),
    "World": ".world",
    "Audit": "..sensing.audit",
    "Canopy": "..sensing.canopy",
    "Check": "..sensing.audit",
    "Choice": "..spec.scene",
    "Cloud": "..sensing.lidar.cloud",
    "Contributions": "..sensing.sonar.echo",
    "Echo": "..sensing.sonar.echo",
    "GrownForest": "..stand.forest",
    "ImpulseResponse": "..sensing.reverb.channels",
    "Leaves": "..growth.mesh.leaves",
    "Lost": "..sensing.lidar.cloud",
    "ModelError": "..sensing.reverb.model_error",
    "Offset": "..results.coordinates",
    "PingSeries": "..sensing.sonar.echo",
    "Reception": "..sensing.sonar.receiver",
    "Returns": "..sensing.lidar.cloud",
    "RoomMetrics": "..sensing.reverb.metrics",
    "Skeleton": "..growth.skeleton",
    "SonarPose": "..sensing.sonar.station",
    "Stand": "..stand.plan",
    "TractorScan": "..sensing.lidar.tractor",
    "Trajectory": "..sensing.trajectory",
    "Tree": "..growth.tree",
    "TriMesh": "..base.trimesh",
    "Waveforms": "..sensing.lidar.waveform",
    "Written": "..results.scan_file",
}


def __getattr__(name: str) -> Any:
    """Names of ``_LATER``."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LATER[name], __name__), name)


__all__ = [
    "Accuracy",
    "Air",
    "Airborne",
    "Allometry",
    "Architecture",
    "Audit",
    "Bark",
    "Beam",
    "Canopy",
    "Check",
    "Choice",
    "Clearing",
    "Cloud",
    "Clusters",
    "Contributions",
    "Crown",
    "DeadBranches",
    "Detail",
    "Discrete",
    "Distance",
    "Echo",
    "Echoes",
    "Flight",
    "Forest",
    "Gaussian",
    "Grammar",
    "GrownForest",
    "HandTree",
    "Honda",
    "ImpulseResponse",
    "Inclination",
    "Jitter",
    "Law",
    "Leaf",
    "Leaves",
    "LinkBudget",
    "Look",
    "Lost",
    "Mobile",
    "ModelError",
    "MovingScanner",
    "Needles",
    "Noise",
    "Normal",
    "Offset",
    "Output",
    "PingSeries",
    "Place",
    "Planting",
    "PointCloud",
    "Pose",
    "Progress",
    "Raster",
    "Rays",
    "Receiver",
    "Reception",
    "Response",
    "Result",
    "Returns",
    "Reverb",
    "RoomMetrics",
    "RowScan",
    "Rows",
    "Rules",
    "Scanner",
    "Scene",
    "Sensor",
    "Siblings",
    "Site",
    "Skeleton",
    "Sonar",
    "SonarPose",
    "SonarReceiver",
    "SpecError",
    "Species",
    "Stand",
    "Stems",
    "Strauss",
    "Surfaces",
    "Targets",
    "Template",
    "Terrain",
    "Terrestrial",
    "Tile",
    "TiledScan",
    "Tiles",
    "Tiling",
    "Tractor",
    "TractorScan",
    "Trajectory",
    "Tree",
    "TriMesh",
    "Waveforms",
    "Wind",
    "World",
    "Written",
    "build",
    "crowns",
    "current",
    "instrument",
    "instruments",
    "read",
    "save_pattern",
    "trajectory",
]
