"""Flight: a bat or a drone senses, decides and moves.

Importing this where Gymnasium is installed makes the environments of ``ENVIRONMENTS`` known to it, as
``ForestSensing/Flight-v0`` and so on; nothing else of the project imports Gymnasium.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

NAME = "ForestSensing/Flight-v0"
# By id: the environment, that of many flyers, and what is given to both.
ENVIRONMENTS: dict[str, tuple[str, str | None, dict[str, Any]]] = {
    NAME: ("FlightEnv", "FlightVectorEnv", {}),
    "ForestSensing/Poisson-v0": ("PoissonEnv", "PoissonVectorEnv", {}),
    "ForestSensing/Passage-v0": ("ListenEnv", None, {"what": "passage"}),
    "ForestSensing/Pole-v0": ("ListenEnv", None, {"what": "pole"}),
}

if find_spec("gymnasium") is not None:
    import gymnasium

    for name, (one, many, given) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{__name__}.environment:{one}",
                vector_entry_point=many and f"{__name__}.environment:{many}",
                kwargs=given,
            )
