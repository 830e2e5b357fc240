"""Bark by its texture: what height and tone a place of a stem has, from a few numbers of ``spec.Bark``.

Each texture gives a height from 0 in furrows to 1, how many metres that is, a tone from dark to light, and
what lies over it: lichen, marks, scars. Textures lie in the tree's own coordinates, in metres, drawn out
upwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ... import spec
from .graph import Colour, Graph, Value

MOSS, ALGAE = (0.045, 0.065, 0.012), (0.12, 0.15, 0.07)
SCAR, FURROW = (0.018, 0.015, 0.013), (0.030, 0.024, 0.020)
TWIG_BROWN = (0.055, 0.030, 0.022)
PALE = (0.42, 0.44, 0.38)
SHEDS_FROM = 1.5  # branching order from which a birch's bark is brown and thin


@dataclass(frozen=True)
class Surface:
    """Bark at a place: height from 0 to 1 of ``metres``, tone from 0 dark to 1 light, and what covers it.

    covers : (share, colour), one over the other.
    """

    height: Value
    metres: float
    tone: Value
    covers: tuple[tuple[Value, Value], ...] = ()


def surface_of(graph: Graph, bark: spec.Bark) -> Surface:
    """The surface of a bark, without moss."""
    return TEXTURES[bark.texture](graph, bark)


def covered(graph: Graph, bark: spec.Bark, colour: Value, surface: Surface) -> Value:
    """The colour with all that covers it: marks, another colour further up, algae and moss at the foot."""
    if bark.upper_from < 1:
        share = graph.axis(graph.place("Generated"), "Z")
        patchy = graph.math("MULTIPLY_ADD", graph.noise(graph.place(), 2.5, 3.0), 0.16, share)
        up = graph.step(patchy, bark.upper_from, bark.upper_from + 0.18)
        shade = graph.mix(
            1.0, bark.upper, graph.mix(surface.tone, (0.45,) * 3, (1.35,) * 3), "MULTIPLY"
        )
        colour = graph.mix(up, colour, shade)
    for share, over in surface.covers:
        colour = graph.mix(share, colour, over)
    hollow = graph.step(graph.add("NewGeometry").outputs["Pointiness"], 0.505, 0.45)
    colour = graph.mix(graph.math("MULTIPLY", hollow, 0.85), colour, (0.16, 0.13, 0.12), "MULTIPLY")
    if bark.moss > 0:
        colour = _mossy(graph, bark, colour, surface)
    return colour


def _mossy(graph: Graph, bark: spec.Bark, colour: Value, surface: Surface) -> Value:
    """Green at the foot: algae higher up, moss lowest, most in what is sheltered."""
    place = graph.place()
    z = graph.axis(place, "Z")
    low = graph.step(z, 0.9 * (0.4 + bark.moss), 0.0)
    high = graph.step(z, 3.0 * (0.4 + bark.moss), 0.2)
    spots = graph.noise(place, 7.0, 6.0, 0.65)
    algae = graph.math(
        "MULTIPLY", high, graph.step(spots, 0.72 - 0.35 * bark.moss, 0.95 - 0.2 * bark.moss)
    )
    colour = graph.mix(graph.math("MULTIPLY", algae, 0.6), colour, ALGAE)
    moss = graph.math(
        "MULTIPLY", low, graph.step(spots, 0.62 - 0.4 * bark.moss, 0.75 - 0.3 * bark.moss)
    )
    return graph.mix(graph.math("MULTIPLY", moss, min(1.0, 4 * bark.moss)), colour, MOSS)


def _cracked(graph: Graph, bark: spec.Bark) -> Surface:
    """Long ridges of small scales between cracks that wander and fray."""
    size = bark.size
    place = graph.moved(graph.moved(graph.place(), 5.0, 0.03), 24.0, 0.35 * size)
    edge, own = graph.cells(graph.scaled(place, (size, size, 5.5 * size)))
    small, each = graph.cells(graph.scaled(place, (0.5 * size, 0.5 * size, 1.3 * size)))
    fine = graph.noise(graph.scaled(place, (0.01, 0.01, 0.03)), 1.0, 6.0, 0.65)
    clouds = graph.noise(place, 1.7, 4.0, 0.6)
    scales = graph.math("MULTIPLY_ADD", graph.step(small, 0.0, 0.12), 0.30, 0.70)
    height = graph.math("MULTIPLY", graph.step(edge, 0.0, 0.20), scales)
    height = graph.math("MULTIPLY_ADD", fine, 0.35, graph.math("MULTIPLY", height, 0.8))
    height = graph.math("MULTIPLY_ADD", own, 0.12, height)
    tone = graph.math("MULTIPLY_ADD", height, 0.55, graph.math("MULTIPLY", clouds, 0.18))
    tone = graph.math("MULTIPLY_ADD", each, 0.10, tone)
    furrows = graph.math("MULTIPLY", graph.step(edge, 0.12, 0.0), 0.65)
    return Surface(height, 0.010, tone, ((furrows, FURROW),))


def _smooth(graph: Graph, bark: spec.Bark) -> Surface:
    """Thin grey skin: clouds of tone, pale lichen in patches, fine level marks and wrinkles."""
    place = graph.place()
    clouds = graph.noise(place, 2.2, 5.0, 0.6)
    level = graph.scaled(graph.moved(place, 4.0, 0.02), (0.30, 0.30, 0.014))
    wrinkles = graph.noise(level, 1.0, 3.0, 0.6)
    short = graph.scaled(graph.moved(place, 9.0, 0.01), (0.055, 0.055, 0.010))
    marks = graph.step(graph.noise(short, 1.0, 1.0), 0.66, 0.74)
    fine = graph.noise(place, 90.0, 3.0, 0.7)
    patches = graph.step(graph.noise(place, 5.5, 8.0, 0.68), 0.54, 0.60)
    crust = graph.math("MULTIPLY", patches, graph.step(fine, 0.30, 0.55))
    height = graph.math("MULTIPLY_ADD", wrinkles, 0.8, graph.math("MULTIPLY", fine, 0.25))
    height = graph.math("MULTIPLY_ADD", marks, -0.5, height)
    tone = graph.math("MULTIPLY_ADD", clouds, 0.75, graph.math("MULTIPLY", wrinkles, 0.22))
    covers = (
        (graph.math("MULTIPLY", crust, 0.55), PALE),
        (graph.math("MULTIPLY", marks, 0.28), (0.06, 0.052, 0.045)),
    )
    return Surface(height, 0.0035, tone, covers)


def _furrowed(graph: Graph, bark: spec.Bark) -> Surface:
    """Long ridges that part and meet again, cracked across."""
    place = graph.moved(graph.place(), 5.0, 0.02)
    size = bark.size
    drawn = graph.scaled(graph.moved(place, 14.0, 0.008), (size, size, 7.0 * size))
    edge, own = graph.cells(drawn, 1.0, 0.9)
    ridges = graph.step(edge, 0.0, 0.34)
    across = graph.scaled(place, (1.3 * size, 1.3 * size, 0.9 * size))
    cracks = graph.step(graph.cells(across)[0], 0.0, 0.07)
    fine = graph.noise(graph.scaled(place, (0.006, 0.006, 0.03)), 1.0, 6.0, 0.6)
    height = graph.math("MULTIPLY", ridges, graph.math("MULTIPLY_ADD", cracks, 0.22, 0.78))
    height = graph.math("MULTIPLY_ADD", fine, 0.28, height)
    height = graph.math("MULTIPLY_ADD", own, 0.15, height)
    tone = graph.math("MULTIPLY_ADD", height, 0.62, graph.math("MULTIPLY_ADD", fine, 0.25, -0.12))
    lichen = graph.step(graph.noise(place, 9.0, 7.0, 0.7), 0.60, 0.70)
    grown = graph.math("MULTIPLY", lichen, graph.step(height, 0.6, 0.9))
    return Surface(
        height, max(bark.relief, 0.006), tone, ((graph.math("MULTIPLY", grown, 0.30), PALE),)
    )


def _plated(graph: Graph, bark: spec.Bark) -> Surface:
    """Plates of many thin scales, worn down in steps, between deep dark furrows; further up only scales."""
    size = bark.size
    place = graph.moved(graph.moved(graph.place(), 7.0, 0.018), 26.0, 0.22 * size)
    drawn = graph.scaled(place, (size, size, 2.6 * size))
    edge, own = graph.cells(drawn, 1.0, 0.95)
    plates = graph.step(edge, 0.0, 0.13)
    torn = graph.moved(graph.place(), 22.0, 0.010)
    scales_edge, scales = graph.cells(graph.scaled(torn, (0.42 * size, 0.42 * size, 0.62 * size)))
    thin_edge, thin = graph.cells(graph.scaled(torn, (0.19 * size, 0.19 * size, 0.26 * size)))
    fine = graph.noise(place, 160.0, 4.0, 0.7)
    flakes = graph.math("MULTIPLY_ADD", scales, 0.30, graph.math("MULTIPLY", thin, 0.13))
    rims = graph.math(
        "MULTIPLY", graph.step(scales_edge, 0.0, 0.05), graph.step(thin_edge, 0.0, 0.04)
    )
    height = graph.math("MULTIPLY_ADD", own, 0.14, graph.math("MULTIPLY_ADD", fine, 0.05, flakes))
    height = graph.math("MULTIPLY_ADD", rims, 0.06, height)
    height = graph.math("MULTIPLY", plates, graph.math("ADD", height, 0.38))
    tone = graph.math("MULTIPLY_ADD", fine, 0.30, graph.math("MULTIPLY_ADD", scales, 0.42, -0.10))
    tone = graph.math("MULTIPLY_ADD", thin, 0.28, tone)
    tone = graph.math("MULTIPLY", tone, graph.step(edge, 0.0, 0.22))
    grey = graph.step(
        graph.math("MULTIPLY_ADD", own, 0.5, graph.math("MULTIPLY", thin, 0.5)), 0.45, 0.8
    )
    covers = (
        (graph.math("MULTIPLY", graph.math("MULTIPLY", grey, plates), 0.5), (0.20, 0.17, 0.15)),
    )
    return Surface(height, max(0.8 * bark.relief, 0.006), tone, covers)


def _peeling(graph: Graph, bark: spec.Bark) -> Surface:
    """White skin with dark level marks and scars; at the foot black and cracked; twigs brown."""
    place = graph.place()
    bent = graph.moved(place, 3.0, 0.03)
    level = graph.scaled(bent, (0.11, 0.11, 0.010))
    marks = graph.step(graph.noise(level, 1.0, 1.5), 0.64, 0.70)
    strips = graph.noise(graph.scaled(bent, (0.5, 0.5, 0.05)), 1.0, 4.0, 0.6)
    edge, own = graph.cells(graph.scaled(bent, (0.17, 0.17, 0.24)))
    scars = graph.math("MULTIPLY", graph.step(edge, 0.42, 0.50), graph.step(own, 0.62, 0.66))
    fine = graph.noise(place, 60.0, 4.0, 0.7)
    foot_place = graph.scaled(
        graph.moved(place, 8.0, 0.015), (bark.size, bark.size, 3.0 * bark.size)
    )
    cells, _ = graph.cells(foot_place)
    z = graph.axis(place, "Z")
    ragged = graph.math("MULTIPLY_ADD", graph.noise(bent, 4.0, 3.0), -1.6, z)
    foot = graph.step(ragged, 0.55, -0.65)
    open_cracks = graph.math("MULTIPLY", foot, graph.step(cells, 0.30, 0.10))
    twig = graph.step(graph.attribute("order"), SHEDS_FROM, SHEDS_FROM + 0.1)
    height = graph.math("MULTIPLY_ADD", strips, 0.35, graph.math("MULTIPLY", fine, 0.08))
    height = graph.math(
        "MULTIPLY_ADD", graph.math("MULTIPLY", foot, graph.step(cells, 0.0, 0.3)), 1.6, height
    )
    tone = graph.math("MULTIPLY_ADD", strips, 0.45, graph.math("MULTIPLY_ADD", fine, 0.12, 0.32))
    dark: Colour = SCAR
    covers = (
        (graph.math("MULTIPLY", marks, 0.72), (0.10, 0.075, 0.06)),
        (scars, dark),
        (graph.math("MULTIPLY", foot, 0.55), (0.09, 0.08, 0.07)),
        (open_cracks, dark),
        (twig, TWIG_BROWN),
    )
    return Surface(height, 0.006, tone, covers)


TEXTURES: dict[str, Callable[[Graph, spec.Bark], Surface]] = {
    "cracked": _cracked,
    "smooth": _smooth,
    "furrowed": _furrowed,
    "plated": _plated,
    "peeling": _peeling,
}
