"""The Python door: what a script, a notebook or Blender's console calls.

::

    from forest_addon import api as forest

    scene = forest.read("my.toml")                     # or forest.Scene(...), or scene.changed(seed=8)
    world = forest.build(scene)                        # grown, and built in Blender
    world = forest.current()                           # or what stands in Blender now
    cloud = world.scan(forest.Terrestrial(position=(0, 0, 1.6)))
    echo = world.ping(forest.Sonar(position=(3, 0, 1.5)))
    sound = world.impulse_response(forest.Reverb(source=(0, 0, 1.5), receiver=(9, 0, 1.5)))
    cloud.save("cloud.laz")

Settings (``Scene``, ``Terrestrial``, ...) are those of a scene file, each checked when it is made. They
need no Blender; ``build`` and ``current`` do: ``bpy`` from PyPI, or Blender itself. What cannot be used
raises ``SpecError`` with one sentence.

These names stay: a later version may add to them.
"""

from __future__ import annotations

from ..spec import (
    Accuracy,
    Air,
    Airborne,
    Beam,
    Forest,
    Gaussian,
    Mobile,
    Noise,
    Normal,
    Planting,
    Pose,
    Rays,
    Receiver,
    Reverb,
    Rows,
    Scene,
    Sensor,
    Sonar,
    SpecError,
    Stems,
    Surfaces,
    Terrain,
    Terrestrial,
    Tractor,
)
from .results import Echoes, PointCloud, Response, Result, RowScan
from .scanners import instrument, instruments
from .site import Site, build, current, read
from .world import World

__all__ = [
    "Accuracy",
    "Air",
    "Airborne",
    "Beam",
    "Echoes",
    "Forest",
    "Gaussian",
    "Mobile",
    "Noise",
    "Normal",
    "Planting",
    "PointCloud",
    "Pose",
    "Rays",
    "Receiver",
    "Response",
    "Result",
    "Reverb",
    "RowScan",
    "Rows",
    "Scene",
    "Sensor",
    "Site",
    "Sonar",
    "SpecError",
    "Stems",
    "Surfaces",
    "Terrain",
    "Terrestrial",
    "Tractor",
    "World",
    "build",
    "current",
    "instrument",
    "instruments",
    "read",
]
