"""Materials that look like bark, leaves and forest floor, and the bark of a stem as relief and tone.

Shader nodes are written as formulas (``graph``). Height and tone of bark follow from a few numbers of
``spec.Bark``; nodes and meshes have the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy

from ... import spec
from .layout import is_ours
from .nodes import Colour, Graph, Value, tree_of

MOSS, ALGAE = (0.045, 0.065, 0.012), (0.12, 0.15, 0.07)
SCAR, FURROW = (0.018, 0.015, 0.013), (0.030, 0.024, 0.020)
TWIG_BROWN = (0.055, 0.030, 0.022)
PALE = (0.42, 0.44, 0.38)
INNER_BIRCH, BLIGHT = (0.46, 0.30, 0.20), (0.10, 0.055, 0.02)
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
    eyes = graph.scaled(graph.moved(place, 14.0, 0.03), (0.32, 0.32, 0.16))
    eye = graph.add(
        "TexVoronoi", {"Vector": eyes, "Scale": 1.0}
    ).outputs  # where branches were shed
    lid = graph.math("ABSOLUTE", graph.math("SUBTRACT", eye["Distance"], 0.16))
    scars = graph.step(
        graph.math("ADD", lid, graph.value("SeparateColor", eye["Color"])), 0.36, 0.28
    )
    patches = graph.step(graph.noise(place, 5.5, 8.0, 0.68), 0.54, 0.60)
    crust = graph.math("MULTIPLY", patches, graph.step(fine, 0.30, 0.55))
    height = graph.math("MULTIPLY_ADD", wrinkles, 0.8, graph.math("MULTIPLY", fine, 0.25))
    height = graph.math("MULTIPLY_ADD", marks, -0.5, graph.math("MULTIPLY_ADD", scars, 0.9, height))
    tone = graph.math("MULTIPLY_ADD", clouds, 0.75, graph.math("MULTIPLY", wrinkles, 0.22))
    covers = (
        (graph.math("MULTIPLY", crust, 0.55), PALE),
        (graph.math("MULTIPLY", marks, 0.28), (0.06, 0.052, 0.045)),
        (graph.math("MULTIPLY", scars, 0.32), FURROW),
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
    """White skin with raised lenticels that comes off in level strips; black diamonds of crust, more of them
    further down until they are all of the foot; twigs brown.
    """
    place = graph.place()
    bent = graph.moved(place, 3.0, 0.03)
    z = graph.axis(place, "Z")
    fine = graph.noise(place, 60.0, 4.0, 0.7)
    level = graph.scaled(graph.moved(place, 7.0, 0.006), (0.035, 0.035, 0.0028))
    lenticels = graph.step(graph.noise(level, 1.0, 1.0), 0.63, 0.70)
    strips = graph.noise(graph.scaled(bent, (0.30, 0.30, 0.035)), 1.0, 5.0, 0.62)
    bare = graph.step(strips, 0.62, 0.63)  # where the skin has come off, as far as its curled edge
    edge = graph.step(graph.math("ABSOLUTE", graph.math("SUBTRACT", strips, 0.61)), 0.012, 0.0)
    frayed = graph.moved(bent, 24.0, 0.6 * bark.size)
    crust, _ = graph.cells(graph.scaled(frayed, (bark.size, bark.size, 3.5 * bark.size)))
    torn = graph.scaled(graph.moved(place, 16.0, 0.02), (0.26, 0.26, 0.19))
    cell = graph.add("TexVoronoi", {"Vector": torn, "Scale": 1.0}, distance="MANHATTAN").outputs
    size = graph.math("MULTIPLY_ADD", graph.value("SeparateColor", cell["Color"]), 0.35, 0.08)
    size = graph.math("MULTIPLY_ADD", z, 0.05, size)
    diamonds = graph.step(graph.math("ADD", cell["Distance"], size), 0.68, 0.60)
    tongues = graph.noise(graph.scaled(frayed, (0.07, 0.07, 0.35)), 1.0, 4.0)
    ragged = graph.math("MULTIPLY_ADD", tongues, -1.8, z)
    rough = graph.math("MAXIMUM", diamonds, graph.step(ragged, -0.05, -0.25))
    cracks = graph.math("MULTIPLY", rough, graph.step(crust, 0.16, 0.02))
    twig = graph.step(graph.attribute("order"), SHEDS_FROM, SHEDS_FROM + 0.1)
    height = graph.math("MULTIPLY_ADD", lenticels, 0.22, graph.math("MULTIPLY", fine, 0.10))
    height = graph.math("MULTIPLY_ADD", bare, -0.25, graph.math("MULTIPLY_ADD", edge, 0.4, height))
    crusted = graph.math("MULTIPLY", rough, graph.step(crust, 0.0, 0.3))
    height = graph.math("MULTIPLY_ADD", crusted, 1.6, height)
    clouds = graph.math("MULTIPLY_ADD", graph.noise(place, 2.6, 5.0, 0.6), 0.75, -0.18)
    tone = graph.math("MULTIPLY_ADD", strips, 0.30, graph.math("MULTIPLY_ADD", fine, 0.12, clouds))
    covers = (
        (graph.math("MULTIPLY", bare, 0.55), INNER_BIRCH),
        (graph.math("MULTIPLY", lenticels, 0.75), (0.13, 0.095, 0.075)),
        (graph.math("MULTIPLY", rough, 0.92), (0.07, 0.062, 0.055)),
        (cracks, SCAR),
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


LOOK_KEY, STYLE_KEY = "forest_look", "forest_bark"
PLAIN_BARK = spec.Bark()
HUB, PALM = 0.25, (0.0, 0.65, 1.42)  # of a palmate blade: where its ribs part, and their angles
BARK_TONES, LEAF_TONES = "Bark Tones", "Leaf Tones"  # names of nodes
VIEWPORT = 2.5  # Solid shading has no light between leaves: true colours are too dark to see there


def bark(
    name: str,
    colour: Colour,
    coat: spec.Bark = PLAIN_BARK,
    into: bpy.types.Material | None = None,
) -> bpy.types.Material:
    """Bark of a colour with the texture, the moss and the upper stem of ``coat``.

    into : a bark to make anew in place of another material.
    """
    material, shader = _principled(name, into)
    graph = Graph(material.node_tree)
    surface = TEXTURES[coat.texture](graph, coat)
    tones = graph.ramp(surface.tone, _tones(BARK_TONES, colour), 0.05, 0.75, name=BARK_TONES)
    graph.put(shader.inputs["Base Color"], covered(graph, coat, tones, surface))
    graph.put(shader.inputs["Normal"], graph.bump(surface.height, surface.metres, 0.85))
    _set_gloss(shader, 0.9, 0.2)
    material[STYLE_KEY] = repr(coat)  # what tells barks apart, beside their colour
    _note(material, colour)
    return material


def coats_of(species: spec.Species) -> tuple[bpy.types.Material, bpy.types.Material]:
    """New materials of a species: its bark and its leaves."""
    return (
        bark(f"{species.name} bark", species.look.bark, species.bark),
        leaf(f"{species.name} leaf", species.look.foliage(), veins_of(species)),
    )


def veins_of(species: spec.Species) -> str:
    """Name how the leaves of a species are veined, as ``leaf`` wants it."""
    if species.needles is not None:
        return "none"
    return "palm" if species.leaf.shape == "palmate" else "feather"


def leaf(name: str, colour: Colour, veins: str = "feather") -> bpy.types.Material:
    """Leaves that let light through, with a paler underside. Each has its own shade; those at the top of the
    tree and of some branches are lighter, and some are spotted.

    veins : "feather", a midrib and side veins, as texture coordinates along and across the blade give them;
        "palm", ribs that part at the end of the stalk; "none".
    """
    material, shader = _principled(name)
    graph = Graph(material.node_tree)
    number = graph.attribute("leaf")
    shade = graph.add("TexWhiteNoise", {"W": number}, noise_dimensions="1D").outputs["Value"]
    place = graph.place()
    sunny = graph.math("MULTIPLY_ADD", graph.axis(graph.place("Generated"), "Z"), 0.35, -0.25)
    sunny = graph.math("MULTIPLY_ADD", graph.noise(place, 0.9, 2.0), 0.55, sunny)
    apart = 0.65 if veins != "none" else 0.2  # shoots of one tree are more alike than leaves
    tone = graph.math("MULTIPLY_ADD", shade, apart, sunny)
    above = tones = graph.ramp(tone, _tones(LEAF_TONES, colour), name=LEAF_TONES)
    if veins != "none":
        vein, between = _veins(graph, veins == "palm")
        above = graph.mix(graph.math("MULTIPLY", vein, 0.35), above, (1.5, 1.5, 1.2), "MULTIPLY")
        above = graph.mix(
            graph.math("MULTIPLY", between, 0.18), above, (0.6, 0.62, 0.5), "MULTIPLY"
        )
        lit = graph.mix(graph.math("MULTIPLY", vein, 0.6), tones, (0.45, 0.5, 0.3), "MULTIPLY")
        blotch = graph.math(
            "MULTIPLY", graph.noise(place, 150.0, 2.0), graph.step(shade, 0.45, 0.95)
        )
        spots = graph.math("MULTIPLY", graph.step(blotch, 0.61, 0.67), 0.75)
        above, lit = graph.mix(spots, above, BLIGHT), graph.mix(spots, lit, BLIGHT)
        graph.put(shader.inputs["Normal"], graph.bump(vein, 0.0006, 0.5))
    else:
        lit = above
    below = graph.mix(0.35, above, (0.20, 0.24, 0.15))
    side = graph.add("NewGeometry").outputs["Backfacing"]
    graph.put(shader.inputs["Base Color"], graph.mix(side, above, below))
    through = graph.mix(1.0, lit, (1.35, 1.45, 0.75), "MULTIPLY")
    glow = graph.add("BsdfTranslucent", {"Color": through}).outputs["BSDF"]
    both = graph.add("MixShader", {"Fac": 0.42, 1: shader.outputs["BSDF"], 2: glow})
    output = next(n for n in graph.tree.nodes if n.type == "OUTPUT_MATERIAL")
    graph.put(output.inputs["Surface"], both.outputs["Shader"])
    _set_gloss(shader, 0.55, 0.22)
    _note(material, colour)
    return material


def _veins(graph: Graph, palmate: bool) -> tuple[Value, Value]:
    """Veins, and the blade between them, from 0 to 1."""
    uv = graph.place("UV")
    along = graph.axis(uv, "X")
    aside = graph.math("ABSOLUTE", graph.math("SUBTRACT", graph.axis(uv, "Y"), 0.5))
    if palmate:  # across the side veins, of the fingers of a palm or of a feather
        far = graph.math("SUBTRACT", along, HUB)
        square = graph.math("MULTIPLY_ADD", aside, aside, graph.math("MULTIPLY", far, far))
        slant = graph.math("SQRT", square)
    else:
        slant = graph.math("MULTIPLY_ADD", aside, -0.75, along)
    wave = graph.math("SINE", graph.math("MULTIPLY", slant, 30.0))
    side = graph.step(graph.math("ABSOLUTE", wave), 0.14, 0.03)
    veins = graph.math("MULTIPLY", side, 0.15 if palmate else 0.7)
    for angle in PALM if palmate else (0.0,):
        cos, sin = math.cos(angle), math.sin(angle)
        beyond = graph.math("SUBTRACT", along, HUB if angle else 0.0)
        way = graph.math("MULTIPLY_ADD", aside, sin, graph.math("MULTIPLY", beyond, cos))
        off = graph.math("MULTIPLY_ADD", aside, cos, graph.math("MULTIPLY", beyond, -sin))
        rib = graph.step(graph.math("ABSOLUTE", off), 0.018, 0.006)
        rib = graph.math("MULTIPLY", rib, graph.step(way, -0.01, 0.01))
        veins = graph.math("MAXIMUM", veins, rib)
    return veins, graph.step(graph.math("ABSOLUTE", wave), 0.3, 0.9)


def recolour(material: bpy.types.Material, colour: Colour) -> None:
    """Give bark or leaves another colour, if it is not the one they were made from.

    Whatever else was edited in the material stays.
    """
    if tuple(material.get(LOOK_KEY, ())) == tuple(colour):
        return
    for name in (BARK_TONES, LEAF_TONES):
        ramp = getattr(material.node_tree.nodes.get(name), "color_ramp", None)
        if ramp is not None:
            dark, light = _tones(name, colour)
            ramp.elements[0].color, ramp.elements[-1].color = (*dark, 1.0), (*light, 1.0)
    _note(material, colour)


def ground(name: str) -> bpy.types.Material:
    """Forest floor: litter of leaves and needles, moss in patches, a bump of small things that lie about."""
    material, shader = _principled(name)
    graph = Graph(material.node_tree)
    place = graph.place()
    moss = graph.ramp(graph.noise(place, 0.3, 6.0, 0.72), ((0.0,) * 3, (1.0,) * 3), 0.38, 0.60)
    pieces = graph.add(
        "TexVoronoi", {"Vector": place, "Scale": 38.0}
    )  # needles and leaves crosswise
    colours = (0.030, 0.022, 0.012), (0.140, 0.098, 0.052)
    litter = graph.ramp(pieces.outputs["Color"], colours, 0.05, 0.95)
    colours = (0.030, 0.046, 0.010), (0.105, 0.140, 0.036)
    green = graph.ramp(graph.noise(place, 55.0, 2.0, 0.8), colours, 0.30, 0.72)
    coarse = graph.noise(place, 9.0, 4.0, 0.8)
    shade = graph.mix(0.6, graph.mix(moss, litter, green), coarse, "OVERLAY")
    graph.put(shader.inputs["Base Color"], shade)
    height = graph.math("ADD", coarse, pieces.outputs["Distance"])
    graph.put(shader.inputs["Normal"], graph.bump(height, 0.05, 0.8))
    _set_gloss(shader, 1.0, 0.1)
    material.diffuse_color = (0.22, 0.20, 0.13, 1.0)
    return material


def meadow(name: str) -> bpy.types.Material:
    """Grassland far away: greens and dry tufts in patches."""
    material, shader = _principled(name)
    graph = Graph(material.node_tree)
    place = graph.place()
    broad = graph.step(graph.noise(place, 0.05, 5.0, 0.6), 0.35, 0.65)
    fine = graph.noise(graph.scaled(place, (0.6, 0.6, 0.6)), 1.0, 6.0, 0.75)
    green = graph.mix(broad, (0.075, 0.105, 0.022), (0.135, 0.150, 0.045))
    colour = graph.mix(
        graph.step(fine, 0.3, 0.75), graph.mix(0.5, green, (0.02, 0.03, 0.008)), green
    )
    graph.put(shader.inputs["Base Color"], colour)
    _set_gloss(shader, 1.0, 0.1)
    material.diffuse_color = (0.16, 0.2, 0.08, 1.0)
    return material


def coloured(name: str, attribute: str, glow: float = 0.0) -> bpy.types.Material:
    """A material in the colour that an attribute of the geometry says, which may glow."""
    material, shader = _principled(name)
    graph = Graph(material.node_tree)
    colour = graph.add("Attribute", attribute_name=attribute).outputs["Color"]
    graph.put(shader.inputs["Base Color"], colour)
    if glow:
        graph.put(shader.inputs["Emission Color"], colour)
        shader.inputs["Emission Strength"].default_value = glow
    return material


def _set_gloss(shader: bpy.types.Node, roughness: float, specular: float) -> None:
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Specular IOR Level"].default_value = specular


def _note(material: bpy.types.Material, colour: Colour) -> None:
    material[LOOK_KEY] = colour
    material.diffuse_color = (*_scaled(colour, VIEWPORT), 1.0)


@contextmanager
def in_one_colour() -> Iterator[None]:
    """Give our materials one colour each for an exporter, whose format does not know Blender's nodes."""
    linked = [
        (material, node.inputs["Base Color"], node.inputs["Base Color"].links[0].from_socket)
        for material in filter(is_ours, bpy.data.materials)
        for node in tree_of(material).nodes
        if node.type == "BSDF_PRINCIPLED" and node.inputs["Base Color"].is_linked
    ]
    for material, colour, _ in linked:
        colour.default_value = material.diffuse_color
        material.node_tree.links.remove(colour.links[0])
    try:
        yield
    finally:
        for material, colour, source in linked:
            material.node_tree.links.new(source, colour)


def _tones(name: str, colour: Colour) -> tuple[Colour, Colour]:
    """The dark and the light tone of bark or leaves."""
    if name == BARK_TONES:
        return _scaled(colour, 0.45), _scaled(colour, 1.6)
    a = _scaled(colour, 1.5)
    b = (0.30, 0.30, 0.02)
    r, g, z = (x + 0.25 * (y - x) for x, y in zip(a, b, strict=True))
    return _scaled(colour, 0.55), (r, g, z)


def _principled(
    name: str, into: bpy.types.Material | None = None
) -> tuple[bpy.types.Material, bpy.types.Node]:
    """A material with its shader: a new one, or an old one with nothing else in it."""
    material = into or bpy.data.materials.new(name)
    nodes = tree_of(material).nodes
    for node in list(nodes) if into else ():
        if node.type not in ("BSDF_PRINCIPLED", "OUTPUT_MATERIAL"):
            nodes.remove(node)
    return material, next(n for n in nodes if n.type == "BSDF_PRINCIPLED")


def _scaled(colour: Colour, factor: float) -> Colour:
    r, g, b = (min(1.0, channel * factor) for channel in colour)
    return r, g, b
