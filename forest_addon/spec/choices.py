"""Words of the panel: the meaning of each choice, and which settings are basic or have an effect now.

Menus and the page of the scene file are made from ``CHOICES``, by the parameter's name; the same word means
the same wherever it stands. ``ADVANCED`` are the papers' symbols and what only numerical questions need, by
the settings that hold them. ``APPLIES`` says of a setting, by its name or by GROUP.NAME, which other one, and
which of its values, it needs to have an effect.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from operator import attrgetter
from typing import Any

from .base import Settings, shown
from .scene import SENSORS, Scene
from .species import Species

OF_THE_FOREST = (
    *(
        "extinction",
        "tail",
        "multiple_share",
        "path_ground",
        "turbulence",
        "lean_deg",
        "bark",
        "foliage",
    ),
    *("leaf_area_density", "leaf_absorption", "branches", "boundary_loss", "branch_area_density"),
    *("floor_leaf_area", "branch_radius", "leaf_radius", "needle_area_density", "needle_radius"),
    *("canopy_return", "litter", "trunk_height"),
)
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
            *OF_THE_FOREST,
            *("min_radius", "continue_to", "tolerance", "rescattering", "head_file", "noise_db"),
            *("array", "array_spacing", "array_azimuth_deg", "array_elevation_deg", "array_file"),
            *("source_path", "receiver_path", "path_step"),
        }
    ),
    "beam": frozenset(
        {
            *("wavelength_nm", "exit_diameter", "subrays", "pulse_ns", "extinction"),
            *("pulse_shape", "shape_step_ns"),
        }
    ),
    "surfaces": frozenset({"leaf_transmittance", "passing"}),
    "receiver": frozenset(
        {
            *("dead_zone", "echoes", "sample_ns", "las_format", "dynamic_range", "blanking"),
            *("halo", "halo_mrad"),
        }
    ),
    "sonarreceiver": frozenset(
        {
            *("transducer_file", "ringing_db", "blanking", "gain", "self_noise_shape", "bits"),
            *("ambient_level_db", "noise_level_db", "noise_from", "overload_db"),
        }
    ),
    "linkbudget": frozenset({"energy", "aperture", "efficiency", "photons"}),
    "noise": frozenset({"range_ppm", "incidence_sd", "registration_s"}),
    "rays": frozenset({"threads"}),
    "accuracy": frozenset({"audit", "detail"}),
    "forest": frozenset({"spacing_rule"}),
}

MORE_THAN_ONE, GIVEN, LEFT_OUT = ">1", "given", "left out"
NATURAL = ("snow", "forest floor", "grass", "soil", "asphalt")

APPLIES: dict[str, tuple[str, tuple[str | bool, ...]]] = {
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
    "poses": ("followed", (GIVEN,)),
    "path_step": ("source_or_receiver_path", (GIVEN,)),
    "facing_azimuth_deg": ("directivity", ("cardioid", "measured")),
    "facing_elevation_deg": ("directivity", ("cardioid", "measured")),
    **dict.fromkeys(("impedance_model", "flow_resistivity"), ("ground_kind", NATURAL)),
    "ground": ("ground_kind", ("constant",)),
    **dict.fromkeys(("strength", "spreading"), ("model", ("paper",))),
    **dict.fromkeys(OF_THE_FOREST, ("model", ("forest",))),
    "rows": ("layout", ("rows",)),
    "clusters": ("layout", ("clusters",)),
    "strauss": ("layout", ("strauss",)),
    "trees": ("layout", ("list",)),
    "collection": ("layout", ("list",)),
    **dict.fromkeys(("expected", "density"), ("layout", ("poisson", "clusters", "strauss"))),
    "exact": ("expected", (GIVEN,)),
    **dict.fromkeys(("unit", "fill_holes", "relief"), ("file", (GIVEN,))),
    **dict.fromkeys(("terrain.size", "terrain.origin"), ("file", (GIVEN,))),
    "holes": ("polygon", (GIVEN,)),
    "painted_value": ("painted", (GIVEN,)),
    **dict.fromkeys(("efficiency", "photons"), ("energy", (GIVEN,))),
    "speed": ("doppler", (True,)),
    **dict.fromkeys(("divergence_mrad", "exit_diameter"), ("subrays", (MORE_THAN_ONE,))),
    "passing": ("leaf_transmittance", (GIVEN,)),
    "shape_step_ns": ("pulse_shape", (GIVEN,)),
    "las_format": ("sample_ns", (GIVEN,)),
    "registration_s": ("registration_sd_or_deg", (GIVEN,)),
    **dict.fromkeys(("inclination.mean_deg", "inclination.sd_deg"), ("shares", (LEFT_OUT,))),
    "mobile.speed": ("follow", (GIVEN,)),
    "airborne.spacing": ("strips", (MORE_THAN_ONE,)),
    **dict.fromkeys(("wind.direction_deg", "wind.turbulence"), ("speed", (GIVEN,))),
    **dict.fromkeys(("tiles.buffer", "tiles.files"), ("size", (GIVEN,))),
    "preview_from": ("preview", (GIVEN,)),
    "preview_size": ("blend_or_preview", (GIVEN,)),
    "preview_samples": ("preview", ("cycles",)),
    "slowest": ("body", ("bat",)),
    "sideways": ("body", ("bird",)),
    **dict.fromkeys(("tilt_deg", "response"), ("body", ("quadrotor",))),
    "climb": ("body", ("bat", "quadrotor")),
    **dict.fromkeys(("turn_rate_deg", "acceleration"), ("body", ("bat", "planar", "quadrotor"))),
    "reached": ("aim", ("goal",)),
    **dict.fromkeys(("start_low", "start_high", "clearance"), ("start", (LEFT_OUT,))),
    "flight.height": ("start", (LEFT_OUT,)),
    "bandwidth": ("resonance", (GIVEN,)),
    "self_noise_shape": ("self_noise_db", (GIVEN,)),
    "ambient_level_db": ("ambient", ("wind", "rain", "insects")),
    "wind_speed": ("ambient", ("wind",)),
    **dict.fromkeys(("noise_level_db", "noise_from"), ("noise_file", (GIVEN,))),
    "bits": ("overload_db", (GIVEN,)),
}

WHOLE = ("rules", "honda", "crown", "grammar")
OF_TANVEER = ("grammar", "template")
OF_SPECIES: dict[str, tuple[str, tuple[str | bool, ...]]] = {  # as APPLIES, asked of the species
    **dict.fromkeys(("grammar", "jitter"), ("grown_by", OF_TANVEER)),
    "grammar.whorls": ("grammar.dialect", ("tanveer-2020b",)),
    "grammar.generations": ("grammar.dialect", ("tanveer-2020a",)),
    "architecture": ("grown_by", ("crown",)),
    **dict.fromkeys(
        [f"architecture.{name}" for name in ("control", "limbs", "growth", "divide", "weak")],
        ("stem_divides", (True,)),
    ),
    "crown.leader": ("stem_divides", (False,)),
    "template.grow_leaves": ("template.leaves", ("",)),
    "leaf": ("leaves_by", ("leaf", "needles")),
    "leaf.shape": ("leaves_by", ("leaf",)),
    **dict.fromkeys(
        ("leaf.nodes", "leaf.per_node", "leaf.fan_deg"), ("grown_by", (*OF_TANVEER, "siblings"))
    ),
    "leaf.angle_deg": ("grown_by", (*OF_TANVEER, "siblings", "crown", "honda")),
    **dict.fromkeys(
        ("leaf.petiole", "leaf.curl_deg"), ("leaf.shape", ("beech", "birch", "oak", "palmate"))
    ),
    **dict.fromkeys(("dead", "detail.tolerance", "detail.limbs"), ("grown_by", WHOLE)),
}


def is_advanced(settings: str, name: str) -> bool:
    """Return whether a setting of a class, by its name in lower case, is for those who know the papers."""
    return name in ADVANCED.get(settings, ())


def need_of(group: Any, name: str) -> tuple[str, tuple[str | bool, ...]] | None:
    """Other setting that one of a group needs for an effect, as ``APPLIES``; None: none."""
    kind = type(group).__name__.removeprefix("FOREST_PG_").lower()
    need = APPLIES.get(f"{kind}.{name}", APPLIES.get(name))
    return need if need and hasattr(group, need[0]) else None


def applies(group: Any, name: str) -> bool:
    """Return whether a setting has an effect beside the others of its group."""
    need = need_of(group, name)
    if need is None:
        return True
    other, values = need
    value = getattr(group, other) if getattr(group, f"use_{other}", True) else None
    given = bool(value) or (value == 0 and getattr(type(group), other, 0) is None)
    if values in ((GIVEN,), (LEFT_OUT,)):  # 0 is given where left out is None
        return given == (values == (GIVEN,))
    if values == (MORE_THAN_ONE,):
        return value is not None and value > 1
    return value in values


def idle(group: Settings, usual: Any = None) -> list[str]:
    """Sentences about settings of a group and of those in it: given, and without effect beside others.

    usual : settings that nobody gave, as an instrument's own, in place of the defaults. What is switched off
    where what it needs is left out is as it was meant.
    """
    said = []
    for field in fields(group):  # type: ignore[arg-type]
        value, own = getattr(group, field.name), getattr(usual, field.name, field.default)
        other, values = need_of(group, field.name) or ("", ())
        off = values in ((GIVEN,), (MORE_THAN_ONE,)) and value in (0, "", (), (0, 0))
        if value != own and not off and not applies(group, field.name):
            said.append(_idle(field.name, other, values, getattr(group, other)))
        elif isinstance(value, Settings):
            inner = idle(value, None if usual is None else own)
            said += [f"{field.name}.{sentence}" for sentence in inner]
    return said


def idle_in_scene(scene: Scene) -> list[str]:
    """Sentences about settings of a scene, but for its plantings and sensors, that have no effect in it."""
    said, field = idle(scene), scene.forest
    apart = field.spacing or field.distances or any(one.crown for one in scene.plantings)
    if field.spacing_rule != type(field).spacing_rule and not apart:
        said.append(
            "forest.spacing_rule has no effect: it needs a spacing, distances, or crowns of plantings"
        )
    kinds = {sensor.kind for sensor in scene.sensors}
    flies = scene.flight != type(scene).flight
    for name, who in (("air", {"sonar", "reverb"}), ("wind", SENSORS.keys() - {"reverb"})):
        given = getattr(scene, name) != getattr(type(scene), name)
        if given and kinds and not kinds & who and not flies:
            said.append(f"{name} has no effect on {' and '.join(sorted(kinds))}")
    return said


def idle_in_species(species: Species) -> list[str]:
    """Sentences about settings of a species that have no effect on trees that grow as its do."""
    said = idle(species)
    for place, (other, values) in OF_SPECIES.items():
        table, _, name = place.rpartition(".")
        group = getattr(species, table) if table else species
        if group is None:
            continue
        value = attrgetter(other)(species)
        (default,) = (field.default for field in fields(group) if field.name == name)
        if getattr(group, name) != default and value not in values:
            said.append(_idle(place, other, values, value))
    return said


def _idle(place: str, other: str, values: Iterable[str | bool], found: Any) -> str:
    wanted = {MORE_THAN_ONE: "above 1", GIVEN: "given", LEFT_OUT: "left out"}
    needed = " or ".join(wanted.get(str(v), shown(v)) for v in values)
    return f"{place} has no effect: it needs {other} to be {needed}, which is {shown(found)}"


_PATTERNS = {
    "gaussian": (
        "Gaussian",
        "As loud as a Gaussian of the width below, in every direction off the axis",
    ),
    "horseshoe": ("Horseshoe Bat", "A horseshoe bat's, 60 to 80 kHz: narrower the higher the tone"),
    "file": ("Measured", "As a CSV file says, by angle and frequency"),
    "omni": ("Everywhere", "The same in all directions"),
}

CHOICES: dict[str, dict[str, tuple[str, str]]] = {
    "use": {
        "add": ("Add", "More trees where the image is bright, on top of hills and base"),
        "multiply": ("Multiply", "Trees become more or fewer by the image's value"),
        "mask": ("Mask", "Trees stand only where the image reaches the threshold"),
    },
    "optics": {
        "mirror": ("Mirror", "Both faces send light on"),
        "glass": ("Glass", "A sheet is a thin pane: light goes straight on, and some is reflected"),
        "water": ("Water", "Light is refracted and some reflected; normals point out of the water"),
        "retro": (
            "Retro-Reflector",
            "Sends light back to where it came from, hundreds of times as bright as white",
        ),
    },
    "layout": {
        "poisson": ("By Chance", "Trees stand at random, denser where the intensity is higher"),
        "clusters": ("In Groups", "Centres by chance, trees around each: Thomas or Matérn"),
        "strauss": ("Apart", "Trees keep apart, the more the stronger they repel (Strauss)"),
        "rows": ("Orchard Rows", "Trees stand in rows, with what spread is set"),
        "list": ("List", "Trees stand where a table or the points of a collection say"),
    },
    "kind": {
        "thomas": ("Thomas", "Trees of a group are dense at its centre: a normal distribution"),
        "matern": ("Matérn", "Trees of a group stand evenly within a disc"),
    },
    "allometry": {
        "any": ("Any", "Proportions of all measured trees"),
        "broadleaf": ("Broadleaves", "Proportions of all measured broadleaves"),
        "conifer": ("Conifers", "Proportions of all measured conifers"),
        "abies": ("Firs", "Proportions of measured firs (Abies)"),
        "acer": ("Maples", "Proportions of measured maples (Acer)"),
        "betula": ("Birches", "Proportions of measured birches (Betula)"),
        "eucalyptus": ("Eucalypts", "Proportions of measured eucalypts (Eucalyptus)"),
        "fagus": ("Beeches", "Proportions of measured beeches (Fagus)"),
        "larix": ("Larches", "Proportions of measured larches (Larix)"),
        "picea": ("Spruces", "Proportions of measured spruces (Picea)"),
        "pinus": ("Pines", "Proportions of measured pines (Pinus)"),
        "populus": ("Poplars", "Proportions of measured poplars and aspens (Populus)"),
        "pseudotsuga": ("Douglas Firs", "Proportions of measured Douglas firs (Pseudotsuga)"),
        "quercus": ("Oaks", "Proportions of measured oaks (Quercus)"),
    },
    "spacing_rule": {
        "matern": (
            "Both May Go",
            "Of two too close the younger goes, even if the older goes too (Matérn II)",
        ),
        "greedy": ("One Goes", "Of two too close the younger goes, if the older stays"),
    },
    "instancing": {
        "auto": ("By Number", "Objects up to 1,000 trees, points from there on"),
        "objects": ("Objects", "Every tree is an object that can be moved and removed"),
        "points": ("Points", "One object with a point a tree: a hundred thousand stay light"),
    },
    "sprouting": {
        "apex": ("At the Tip", "Children fork where their parent ends"),
        "along": ("Along", "Children leave their parent at random places along it"),
    },
    "shape": {
        "ellipse": ("Ellipse", "An oval blade"),
        "oval": ("Egg", "Broad near the stalk, folded along its midrib, of few triangles"),
        "maple": ("Maple", "Five lobes"),
        "needle": ("Needle", "Long and thin"),
        "beech": ("Beech", "An ellipse with a short point and a waved edge"),
        "birch": ("Birch", "A lozenge with a long point and a toothed edge"),
        "oak": ("Oak", "Rounded lobes on both sides of a midrib"),
        "palmate": ("Palmate", "Five pointed lobes with teeth, each folded along its vein"),
    },
    "directivity": {
        "omni": ("Everywhere", "The same in all directions"),
        "cardioid": ("Cardioid", "Loud ahead, silent behind"),
        "measured": ("Measured", "As a CSV file says, by angle and frequency"),
    },
    "surface": {
        "as model": ("As the Model", "Constant for the paper's model, forest floor for a forest"),
        "constant": ("Constant", "Sends back the same share at all frequencies"),
        "snow": ("Snow", "Soft: swallows most of the sound, low tones less"),
        "forest floor": ("Forest Floor", "Litter and moss: swallows high tones"),
        "grass": ("Grass", "A meadow's ground"),
        "soil": ("Soil", "Bare earth: rather hard"),
        "asphalt": ("Asphalt", "Hard: sends nearly all back"),
    },
    "impedance_model": {
        "miki": ("Miki", "Sound at all frequencies; the usual choice"),
        "delany-bazley": ("Delany-Bazley", "The older formula; not for low frequencies"),
    },
    "heard_as": {
        "omni": ("Microphones", "One channel of even pressure at each receiver"),
        "ambisonics": ("Ambisonics", "Four channels of first order (ACN, SN3D) at each receiver"),
        "binaural": ("Two Ears", "Left and right through the head of a SOFA file"),
    },
    "model": {
        "paper": ("As the Paper", "Kaneko's weights, no losses but the air's"),
        "forest": ("Forest", "Cylinders' own scattering, with what ground, bark and leaves take"),
        "Attims": ("Attims", "A leader that grows all the time, branches anywhere on it"),
        "Champagnat": ("Champagnat", "Arching shoots, each from the back of the one before"),
        "Leeuwenberg": ("Leeuwenberg", "Equal shoots, each divided by its flower"),
        "Mangenot": ("Mangenot", "Shoots that rise and then lie down"),
        "Massart": ("Massart", "A leader with whorls of level branches (firs)"),
        "Rauh": (
            "Rauh",
            "A leader with whorls of branches that rise as it does (pines, ashes, oaks)",
        ),
        "Roux": ("Roux", "A leader that grows all the time, with level branches"),
        "Scarrone": ("Scarrone", "A leader with whorls of branches that flowers divide"),
        "Troll": ("Troll", "Level shoots, of which some rise and become stems (beeches, elms)"),
    },
    "extinction": {
        "none": ("None", "Trunks in the way take nothing from a sound"),
        "energy": ("Scattered Energy", "They take what they scatter away from straight on"),
        "coherent": ("Coherent Wave", "They take all that leaves the coherent wave"),
    },
    "tail": {
        "none": ("None", "Only sound that one trunk has scattered, as in the paper"),
        "transport": ("Transport", "Later, noise with the energy that wanders among many trunks"),
    },
    "engine": {
        "auto": ("Automatic", "Embree where it is there, else BVHTree"),
        "bvhtree": ("BVHTree", "Blender's Python rays: slower, on every system"),
        "embree": ("Embree", "The rays of Blender's Cycles: fastest"),
    },
    "detail": {
        "full": ("All", "Branches, leaves and trunks as they are set"),
        "auto": ("What Matters", "Only what the scene's sensors can tell apart"),
    },
    "texture": {
        "cracked": ("Cracked", "Small scales between cracks"),
        "smooth": ("Smooth", "Thin and even, with fine level marks, as of beech"),
        "furrowed": ("Furrowed", "Long ridges that part and meet again, as of oak"),
        "plated": ("Plated", "Broad plates between deep furrows, as of pine"),
        "peeling": ("Peeling", "White with dark level marks, cracked at the foot, as of birch"),
    },
    "unit": {
        "auto": ("As It Says", "As the file or its coordinate system says, else metres"),
        "m": ("Metres", "Heights of the file are metres"),
        "dm": ("Decimetres", "Heights of the file are decimetres"),
        "cm": ("Centimetres", "Heights of the file are centimetres"),
        "mm": ("Millimetres", "Heights of the file are millimetres"),
        "ft": ("Feet", "Heights of the file are international feet, 0.3048 m"),
        "us-ft": ("US Survey Feet", "Heights of the file are feet of 1200/3937 m"),
    },
    "preview": {
        "cycles": ("Cycles", "Rendered, with undergrowth at a walker's feet: minutes, not seconds"),
    },
    "preview_from": {
        "whole": ("All of It", "From the south-west, so far away that every tree is seen"),
        "walker": ("A Walker", "A walker's eye among the trees, undergrowth added for the picture"),
    },
    "files": {
        "merged": ("One File", "All points of a scan in one file, as without tiles"),
        "tiles": ("A File a Tile", "The points over each tile in a file of its own"),
        "both": ("Both", "One file of all points, and one of each tile"),
        "copc": ("COPC", "A COPC file of each tile, with a catalogue by which all open as one"),
    },
    "undergrowth": {
        "auto": ("Automatic", "Sparse where a scanner or a sonar looks at measured trees"),
        "none": ("None", "Trees on bare ground"),
        "sparse": ("Sparse", "Some herbs, shrubs, young trees and deadwood"),
        "dense": ("Dense", "Herbs everywhere, thickets of shrubs and young trees, much deadwood"),
    },
    "limbs": {
        "auto": ("Automatic", "Smooth curves where limbs fill a crown, else straight"),
        "curves": ("Curves", "Smooth curves that leave their parent in a collar"),
        "straight": ("Straight", "Straight from node to node"),
    },
    "side": {
        "left": ("Left", "It looks to the left of where it drives"),
        "right": ("Right", "It looks to the right of where it drives"),
    },
    "echoes": {
        "crests": ("Crests", "Where the waveform is higher than about it"),
        "gaussians": ("Gaussians", "Fitted to samples, one for each crest: neighbours draw none"),
    },
    "las_format": {
        "4": ("4", "Of LAS 1.3, for older programs: seven returns, whole degrees"),
        "9": ("9", "The usual one of LAS 1.4"),
        "10": ("10", "Of LAS 1.4, with colours of parts and the laser's light as near infrared"),
    },
    "keep": {
        "first": ("First", "The nearest of a pulse"),
        "last": ("Last", "The farthest of a pulse"),
        "strongest": ("Strongest", "Those with the most light of a pulse"),
        "strongest+last": ("Strongest and Last", "The farthest, and of the others the strongest"),
    },
    "reading": {
        "received": ("Received Light", "Light that came back; it falls with the square of range"),
        "reflectance": (
            "Reflectance",
            "Of the white surface that would fill the beam at that range and send as much back",
        ),
    },
    "beyond": {
        "resolved": ("Resolved", "They are counted to the pulse that they belong to"),
        "folded": ("Folded", "They are counted to the pulse sent last, and seem near"),
    },
    "passing": {
        "probability": ("All or Nothing", "A ray passes a leaf whole, or not at all, by chance"),
        "share": ("A Share", "A share of a ray's light passes each leaf"),
    },
    "pattern": {
        "lines": ("Lines", "A turning mirror: straight lines, all in one direction"),
        "fans": (
            "Three Fans",
            "A turning mirror: lines downwards, ahead and back, one after the other",
        ),
        "zigzag": ("Zigzag", "A swinging mirror: to and fro"),
        "circles": ("Circles", "A tilted turning mirror: a cone around straight down"),
        "spinning": ("Spinning", "Several beams, one above the other, turn about the upright"),
        "rosette": ("Rosette", "A beam turns about the upright and swings up and down meanwhile"),
    },
    "beam": _PATTERNS,
    "hearing": {"same": ("As the Call", "Ears hear as the mouth sends"), **_PATTERNS},
    "call": {
        "impulse": ("Click", "A pulse that has every frequency of the band at once"),
        "fm": ("Sweep", "Falls through the band, as many bats call"),
        "cf-fm": ("Tone and Sweep", "A long tone at the top of the band that ends in a sweep"),
        "file": ("WAV File", "A call that was recorded"),
    },
    "leaf_model": {
        "exact": ("Exact Disc", "A hard disc at every size and angle, exactly"),
        "piston": (
            "Piston",
            "A disc by physical optics: good where leaves are larger than the wave",
        ),
        "paper": ("As the Paper", "The fit of Tanveer and colleagues"),
    },
    "shading": {
        "none": ("None", "Every leaf is heard as if it stood alone"),
        "trunks": ("By Wood", "What stands behind a trunk or branch is not heard"),
        "extinction": ("By Leaves", "Leaves in the way weaken what is behind them"),
        "trunks+extinction": ("Wood and Leaves", "Both"),
    },
    "ambient": {
        "none": ("None", "Nothing sounds but the echo"),
        "wind": ("Wind", "Wind in vegetation, by its speed (Boersma 1997)"),
        "rain": ("Rain", "Rain on leaves, as loud as is said"),
        "insects": ("Insects", "A tropical night (Schmidt and Römer 2011)"),
    },
    "body": {
        "bat": ("Bat", "A point mass with limits on speed, acceleration and turns"),
        "bird": ("Bird", "Even speed ahead, a little sideways (Karaman and Frazzoli)"),
        "planar": ("Planar", "Even speed in a plane, with limited turns"),
        "quadrotor": ("Quadrotor", "It moves by tilting, which takes a moment"),
    },
    "aim": {
        "goal": ("Goal", "Reach a place at the distance below"),
        "heading": ("Heading", "Get so far in one direction"),
    },
    "dialect": {
        "tanveer-2020a": (
            "Tanveer et al. 2020a",
            "A trunk whose branches branch again, by Tanveer and colleagues",
        ),
        "tanveer-2020b": ("Tanveer et al. 2020b", "Whorls of branches on one trunk"),
        "ABOP": ("ABOP", "The symbols of The Algorithmic Beauty of Plants"),
        "simlidar": ("Méndez et al.", "The symbols of Méndez and colleagues"),
    },
}


def title_of(name: str, choice: str) -> str:
    """Name of a choice in a menu."""
    known = CHOICES.get(name, {}).get(choice)
    return known[0] if known else choice if choice.isupper() else choice.title()


def meaning_of(name: str, choice: str) -> str:
    """Effect of a choice, in words; empty where its name says it."""
    known = CHOICES.get(name, {}).get(choice)
    return known[1] if known else ""
