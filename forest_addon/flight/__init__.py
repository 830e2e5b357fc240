"""Flight: a bat or a drone senses, decides and moves.

Importing this where Gymnasium is installed makes ``ForestSensing/Flight-v0`` known to it; nothing else of the
project imports Gymnasium.
"""

from __future__ import annotations

from importlib.util import find_spec

NAME = "ForestSensing/Flight-v0"

if find_spec("gymnasium") is not None:
    import gymnasium

    if NAME not in gymnasium.registry:
        gymnasium.register(
            NAME,
            entry_point=f"{__name__}.environment:FlightEnv",
            vector_entry_point=f"{__name__}.environment:FlightVectorEnv",
        )
