"""Mirrors, glass and water: custom properties by which an object or a material says that it is one."""

from __future__ import annotations

from .base import AUTO, Settings, param

POLISHED = ("mirror", "glass", "water")  # numbered so where a scene is arrays
USUAL_INDEX = {"mirror": 1.0, "glass": 1.5, "water": 1.33}  # refractive, where "auto"


class Polished(Settings):
    """Mirror, pane of glass or surface of water, where a scanner follows light on (``bounces``)."""

    optics: str = param(
        "mirror",
        help="mirror: both faces send light on; glass: one sheet is a thin pane, light goes straight "
        "through; water: a surface whose normals point out of it, light is refracted",
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


def property_of(field: str) -> str:
    """The name of the custom property that says a field of ``Polished``."""
    return f"forest_{field}"
