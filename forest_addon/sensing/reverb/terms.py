"""Terms of a reverb's model: what its settings put in and what they leave out, in words."""

from __future__ import annotations

from ...spec import Reverb

NEVER = (
    "diffraction around trunks and edges",
    "refraction by wind and temperature",
)


def terms_of(reverb: Reverb) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what is in the model, with the values that are set, and what is not."""
    forest = reverb.model == "forest"
    ground = forest and reverb.path_ground
    scene = "as in the scene"
    terms = {
        "trunks that scatter once, exactly": (True, ""),
        "absorption of the air": (True, ""),
        "the ground under the direct sound": (True, reverb.ground_kind),
        "the ground under every path by way of trunks": (ground, reverb.ground_kind),
        "what trunks scatter out of a path": (
            forest and reverb.extinction != "none",
            reverb.extinction,
        ),
        "sound scattered more than once, as energy": (forest and reverb.tail == "transport", ""),
        "turbulence": (forest and reverb.turbulence > 0, f"{reverb.turbulence:g}e-6"),
        "trunks that lean": (ground and reverb.lean_deg > 0, f"{reverb.lean_deg:g} degrees"),
        "leaves of plants on the floor": (
            ground and reverb.foliage,
            f"{scene}, and {reverb.floor_leaf_area:g} m²/m²" if reverb.floor_leaf_area else scene,
        ),
        "bark that absorbs": (forest and reverb.bark > 0, f"{100 * reverb.bark:g} %"),
        "leaves that absorb": (
            forest and reverb.foliage and reverb.leaf_absorption > 0,
            f"G = {reverb.leaf_absorption:g}, {_or(reverb.leaf_area_density, 'm²/m³')}",
        ),
        "branches, twigs and leaves that scatter in space": (
            forest and reverb.branches,
            _or(reverb.branch_area_density, "m²/m³ of bark"),
        ),
        "needles as thin cylinders, in phase within a shoot": (
            forest and reverb.branches and reverb.foliage,
            _or(reverb.needle_area_density, "m²/m³"),
        ),
        "bark of branches that absorbs": (
            forest and reverb.branches and reverb.bark > 0,
            f"{100 * reverb.bark:g} %",
        ),
        "viscous, heat-conducting air at branches and needles": (
            forest and reverb.branches and reverb.boundary_loss,
            "",
        ),
        "litter that scatters": (
            forest and reverb.branches and reverb.litter > 0,
            f"{100 * reverb.litter:g} %",
        ),
        "trunks' ends": (forest, _or(reverb.trunk_height, "m")),
    }
    held = tuple(
        f"{name} ({value})" if value else name for name, (is_in, value) in terms.items() if is_in
    )
    return held, tuple(name for name, (is_in, _) in terms.items() if not is_in) + NEVER


def _or(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if value > 0 else "as in the scene"
