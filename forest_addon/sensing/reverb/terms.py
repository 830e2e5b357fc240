"""Terms of a reverb's model: what its settings put in and what they leave out, in words."""

from __future__ import annotations

from ...spec import Reverb

NEVER = (
    "diffraction around trunks and edges",
    "refraction by wind and temperature",
)


def terms_of(reverb: Reverb) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what is in the model, and what is not."""
    forest = reverb.model == "forest"
    terms = {
        "trunks that scatter once, exactly": True,
        "absorption of the air": True,
        "the ground under the direct sound": True,
        "the ground under every path by way of trunks": forest and reverb.path_ground,
        "what trunks scatter out of a path": forest and reverb.extinction != "none",
        "sound scattered more than once, as energy": forest and reverb.tail == "transport",
        "turbulence": forest and reverb.turbulence > 0,
        "trunks that lean": forest and reverb.path_ground and reverb.lean_deg > 0,
        "leaves of plants on the floor": forest and reverb.path_ground and reverb.foliage,
        "bark that absorbs": forest and reverb.bark > 0,
        "leaves that absorb": forest and reverb.foliage and reverb.leaf_absorption > 0,
        "branches, twigs and leaves that scatter in space": forest and reverb.branches,
        "bark of branches that absorbs": forest and reverb.branches and reverb.bark > 0,
        "viscous, heat-conducting air at branches": forest
        and reverb.branches
        and reverb.boundary_loss,
        "litter that scatters": forest and reverb.branches and reverb.litter > 0,
        "trunks' ends": forest,
    }
    held = tuple(name for name, is_in in terms.items() if is_in)
    return held, tuple(name for name, is_in in terms.items() if not is_in) + NEVER
