"""Mirrors, glass, water, retro-reflectors: custom properties by which an object or a material is one."""

from __future__ import annotations

from .base import AUTO, Settings, param

POLISHED = ("mirror", "glass", "water", "retro")  # numbered so where a scene is arrays
USUAL_INDEX = {"mirror": 1.0, "glass": 1.5, "water": 1.33, "retro": 1.0}  # refractive, where "auto"


class Polished(Settings):
    """Mirror, pane of glass or surface of water, where a scanner follows light on (``lidar/specular``); or a
    retro-reflector, for all scanners."""

    optics: str = param(
        "mirror",
        help="mirror: both faces send light on; glass: one sheet is a thin pane, light goes straight "
        "through; water: a surface whose normals point out of it, light is refracted; retro: "
        "sends light back to where it came from",
        choices=POLISHED,
    )
    index: float = param(
        AUTO, help="refractive index; auto: 1.5 of glass, 1.33 of water", ge=1, le=5, auto=True
    )
    mirror: float = param(0.9, help="share of the light that a mirror sends on", ge=0, le=1)
    extinction: float = param(
        AUTO,
        unit="1/m",
        help="light that a metre of water takes from a beam; auto: as pure water at its wavelength",
        ge=0,
        le=1e6,
        auto=True,
    )
    gain: float = param(
        785.0,
        help="light that a retro-reflector sends back, of that of a white surface; left out: 785, sheeting "
        "of 250 cd/lx/m² (ASTM D4956, type III, white, 0.2°/-4°)",
        ge=1,
        le=1e6,
    )


def property_of(field: str) -> str:
    """The name of the custom property that says a field of ``Polished``."""
    return f"forest_{field}"
