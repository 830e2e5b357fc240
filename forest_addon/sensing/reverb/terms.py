"""Terms of a reverb's model: what its settings put in and what they leave out, in words."""

from __future__ import annotations

import math

from ...spec import Reverb
from .forest.clutter import LAYER
from .forest.losses import TrunkStand

NEVER = (
    "diffraction around trunks and edges",
    "refraction by wind and temperature",
)


def terms_of(
    reverb: Reverb, stand: TrunkStand | None = None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what is in the model, with its values, and what is not.

    stand : what the scene or the settings gave; None: values of the scene are not known.
    """
    forest = reverb.model == "forest"
    ground = forest and reverb.path_ground
    there = _there(stand)
    terms = {
        "trunks that scatter once, exactly": (True, ""),
        "absorption of the air": (True, ""),
        "the ground under the direct sound": (True, reverb.ground_kind),
        "the ground under every path by way of trunks": (ground, reverb.ground_kind),
        "what trunks scatter out of a path": (
            forest and reverb.extinction != "none",
            f"{reverb.extinction}{there['trunks']}",
        ),
        "sound scattered more than once, as energy": (forest and reverb.tail == "transport", ""),
        "turbulence": (forest and reverb.turbulence > 0, f"{reverb.turbulence:g}e-6"),
        "trunks that lean": (ground and reverb.lean_deg > 0, f"{reverb.lean_deg:g} degrees"),
        "leaves of plants on the floor": (
            ground and reverb.foliage,
            there["floor"]
            if stand
            else _or(reverb.floor_leaf_area, "m²/m² and those of the scene"),
        ),
        "bark that absorbs": (forest and reverb.bark > 0, f"{100 * reverb.bark:g} %"),
        "leaves that absorb": (
            forest and reverb.foliage and reverb.leaf_absorption > 0,
            f"G = {reverb.leaf_absorption:g}, "
            + (there["leaves"] or _or(reverb.leaf_area_density, "m²/m³")),
        ),
        "branches, twigs and leaves that scatter in space": (
            forest and reverb.branches,
            there["branches"] or _or(reverb.branch_area_density, "m²/m³ of bark"),
        ),
        "needles as thin cylinders, in phase within a shoot": (
            forest and reverb.branches and reverb.foliage,
            there["needles"] or _or(reverb.needle_area_density, "m²/m³"),
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
        "trunks' ends": (forest, there["top"] or _or(reverb.trunk_height, "m")),
    }
    held = tuple(
        f"{name} ({value})" if value else name for name, (is_in, value) in terms.items() if is_in
    )
    return held, tuple(name for name, (is_in, _) in terms.items() if not is_in) + NEVER


def _there(stand: TrunkStand | None) -> dict[str, str]:
    """Words for what stands there, "" where that is not known."""
    if stand is None:
        return dict.fromkeys(("trunks", "floor", "leaves", "branches", "needles", "top"), "")
    clutter = stand.clutter
    bark = sum(
        2.0 * math.pi * radius * metres * LAYER
        for layer in clutter.length
        for radius, metres in zip(clutter.radii, layer, strict=True)
    )
    leaves, needles = LAYER * sum(clutter.leaf_area), LAYER * sum(clutter.needle_area)
    discs = f"{leaves:.2g} m² of leaves as discs of {100.0 * clutter.leaf_radius:.2g} cm"
    return {
        "trunks": f", {1e4 * stand.density:,.0f}/ha" if stand.density else ", none there",
        "floor": _some(stand.floor_leaf_area, "m²/m²"),
        "leaves": _some(stand.leaf_area_density, "m²/m³ at the path"),
        "branches": f"{_some(bark, 'm² of bark')} and {discs if leaves else 'no leaves'} a m² of ground"
        if bark or leaves
        else "none there",
        "needles": _some(needles, "m² of half their surface a m² of ground"),
        "top": f"{stand.trunk_height:.3g} m" if stand.trunk_height else "endless",
    }


def _some(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}" if value > 0 else "none there"


def _or(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if value > 0 else "as in the scene"
