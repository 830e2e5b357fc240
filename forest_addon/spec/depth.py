"""Depth of a panel: basic settings or all, and of these the ones that have an effect now.

``ADVANCED`` are the papers' symbols and what only numerical questions need, by the settings that hold them.
``APPLIES`` says of a setting which other one, and which of its values, it needs to have an effect.
"""

from __future__ import annotations

from typing import Any

ADVANCED: dict[str, frozenset[str]] = {
    "tractor": frozenset({"gap", "splits", "escape"}),
    "terrestrial": frozenset({"scanner", "faintest", "line_step_deg"}),
    "mobile": frozenset({"scanner", "faintest", "mount_deg"}),
    "airborne": frozenset({"scanner", "faintest", "mount_deg"}),
    "sonar": frozenset(
        {
            *("doppler", "record", "facets", "leaf_model", "absorption", "near_limit"),
            *("cull", "tolerance", "contributions", "shading_rays"),
        }
    ),
    "reverb": frozenset(
        {
            *("ground", "impedance_model", "flow_resistivity", "strength", "spreading"),
            *("extinction", "multiple_share", "path_ground", "turbulence", "bark", "foliage"),
            *("leaf_area_density", "leaf_absorption", "min_radius", "tolerance", "rescattering"),
            *("array_file", "source_path", "receiver_path", "path_step", "noise_db"),
        }
    ),
    "beam": frozenset({"wavelength_nm", "exit_diameter", "subrays", "pulse_ns", "extinction"}),
    "surfaces": frozenset({"leaf_transmittance", "passing"}),
    "receiver": frozenset({"dead_zone", "dynamic_range", "blanking", "halo", "halo_mrad"}),
    "linkbudget": frozenset({"energy", "aperture", "efficiency", "photons"}),
    "noise": frozenset({"range_ppm", "incidence_sd"}),
    "rays": frozenset({"threads"}),
    "accuracy": frozenset({"audit", "detail"}),
    "forest": frozenset({"spacing_rule"}),
}

MORE_THAN_ONE = ">1"

APPLIES: dict[str, tuple[str, tuple[str, ...]]] = {
    "beam_file": ("beam", ("file",)),
    "beam_width_deg": ("beam", ("gaussian",)),
    "hearing_file": ("hearing", ("file",)),
    "hearing_width_deg": ("hearing", ("gaussian",)),
    "ear_spacing": ("ears", (MORE_THAN_ONE,)),
    "ear_turn_deg": ("ears", (MORE_THAN_ONE,)),
    "call_file": ("call", ("file",)),
    "call_duration": ("call", ("fm", "cf-fm")),
    "shading_rays": ("shading", ("extinction", "trunks+extinction")),
    "directivity_file": ("directivity", ("measured",)),
    "array_spacing": ("array", (MORE_THAN_ONE,)),
    "array_azimuth_deg": ("array", (MORE_THAN_ONE,)),
    "array_elevation_deg": ("array", (MORE_THAN_ONE,)),
    "head_file": ("heard_as", ("binaural",)),
    "head_azimuth_deg": ("heard_as", ("ambisonics", "binaural")),
    "channels": ("pattern", ("spinning",)),
    "fan_deg": ("pattern", ("fans",)),
    "petals": ("pattern", ("rosette",)),
}


def is_advanced(settings: str, name: str) -> bool:
    """Return whether a setting of a class, by its name in lower case, is for those who know the papers."""
    return name in ADVANCED.get(settings, ())


def applies(group: Any, name: str) -> bool:
    """Return whether a setting has an effect beside the others of its group."""
    if name not in APPLIES:
        return True
    other, values = APPLIES[name]
    if not hasattr(group, other):
        return True
    value = getattr(group, other)
    return value > 1 if values == (MORE_THAN_ONE,) else value in values
