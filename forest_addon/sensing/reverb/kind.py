"""Record of the reverb: impulse responses between sources and receivers among trunks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.progress import Progress
from ...base.rng import stream
from ...base.trimesh import OTHER, is_wood
from ...base.words import keep
from ...spec import AUTO, Choice, Reverb, Scene
from ..audit import AuditPart, figures
from ..kind import SOUND, Observation, Seen, SensorKind, chain, cost_of_work
from ..looks import SensorLook

BEGIN = 0.3  # s, a first guess: leaves and branches are measured
A_TREE = 0.0085  # s, a first guess: its trunk is cut out of the scene, and heard with all others
A_STEM = 0.004  # s a channel, a first guess: it is heard
A_CUT = 0.002  # s, a first guess: it is cut at another height, where ends are of different heights
MANY = 3.0  # s a channel, a first guess: any number of trunks of all radii
FEW = 5000.0  # of them take half as long
CHANNEL = 0.15  # s, a first guess
FINEST = 1e-6  # tolerance that the fast sum keeps
END = 10 ** (-75 / 20)  # a record ends where that is left of it


def cuts_of(seen: Seen, min_radius: float) -> Any:
    """``TrunkCuts`` of a scene, of trunks from that radius on; ask for it by ``seen.once``."""
    from .trunks import TrunkCuts

    return TrunkCuts(seen.geometry, min_radius)


def trunks_of(seen: Seen, reverb: Reverb) -> Any:
    """``Trunks`` of the scene where the sound of the first channel passes them."""
    from .ends import ends_of

    still = reverb.changed(array_file="", source_path="", receiver_path="")
    source, receiver = ends_of(still, seen.places).pairs[0]
    return seen.once(cuts_of, reverb.min_radius).between(source, receiver)


def trunks_between(
    seen: Seen, reverb: Reverb, settings: Scene, ends: Any
) -> Callable[[np.ndarray, np.ndarray], Any]:
    """Trunks of the scene, by source and receiver, and those that are stems only. ends : ``Ends``."""
    from ...stand.layouts import plant_stems
    from .trunks import Trunks

    position, radius = plant_stems(settings.seed, settings.forest, settings.stems)
    stems = Trunks(position, radius, np.full(len(radius), -1)).clear_of(ends.on_ground)
    cuts = seen.once(cuts_of, reverb.min_radius)
    return lambda source, receiver: cuts.between(source, receiver).with_others(stems)


def response_inputs(job: Observation) -> dict[str, Any]:
    """Arguments of ``pairs_of`` that a scene gives."""
    from .directivity import directivity_of
    from .ends import ends_of

    reverb, seen, settings = job.sensor, job.seen, job.settings
    ends = ends_of(reverb, seen.places, job.folder)
    return {
        "trunks": trunks_between(seen, reverb, settings, ends),
        "reverb": reverb,
        "air": settings.air,
        "ends": ends,
        "directivity": directivity_of(reverb, job.folder),
        "wood": seen.wood,
        "rng": stream(settings.seed, "reverb", reverb.name, "continuation"),
        "field": (settings.forest.origin, settings.forest.size),
        "canopy": _canopy(job),
        "key": (settings.seed, "reverb", reverb.name),
    }


def _respond(job: Observation, progress: Progress | None) -> Any:
    """Impulse responses between all ends."""
    from .hearing import hearing_of
    from .response import impulse_response

    response = impulse_response(
        **response_inputs(job),
        hearing=hearing_of(job.sensor, job.folder),
        expansions=job.seen.expansions,
        progress=progress,
        all_trunks=job.settings.accuracy.detail == "full",
    )
    return replace(response, sprays=_sprays(job))


def _sprays(job: Observation) -> tuple[str, ...]:
    """Names of conifers whose needles have no shoots, which a model ``forest`` takes for leaves."""
    from ...growth.library import find_species, load_species
    from ...growth.sway.beams import CONIFERS, genus_of

    if job.sensor.model != "forest" or not (job.sensor.foliage and job.sensor.branches):
        return ()
    if job.sensor.leaf_area_density > 0 or job.sensor.needle_area_density > 0:
        return ()
    names = sorted({planting.species for planting in job.settings.plantings})
    every = {name: load_species(find_species(name, job.folder))[0] for name in names}
    return tuple(
        species.name
        for species in every.values()
        if species.needles is None and genus_of(species) in CONIFERS
    )


def _audit(job: Observation, found: Any) -> list[AuditPart]:
    from .audit import parts_of_response
    from .hearing import hearing_of
    from .response import pairs_of

    reverb = job.sensor
    if reverb.model != "forest":  # whose noise depends on what was asked for
        reverb = reverb.changed(duration=len(found.samples) / found.sample_rate)
    given = response_inputs(replace(job, sensor=reverb))
    pairs = pairs_of(**given, all_trunks=job.settings.accuracy.detail == "full")
    share, hearing = job.settings.accuracy.audit, hearing_of(reverb, job.folder)
    parts = parts_of_response(found, pairs, job.seen.expansions, share, hearing)
    return [*parts, figures(vars(found), {"sprays": _sprays(job)})]


def _canopy(job: Observation) -> Any:
    """Leaves and tops, as a model ``forest`` needs them."""
    from .ends import ends_of
    from .forest.surroundings import BARE

    if job.sensor.model != "forest":
        return BARE
    source, receiver = ends_of(job.sensor, job.seen.places, job.folder).pairs[0]
    area = float(np.prod(job.settings.forest.size))
    heights = float(source[2]), float(receiver[2])
    return job.seen.once(_canopy_between, *heights, area, job.sensor.min_radius)


def _canopy_between(
    seen: Seen, source: float, receiver: float, area: float, min_radius: float
) -> Any:
    from .forest.surroundings import canopy_of

    lower = np.array([0.0, 0.0, min(source, receiver)])
    trunks = seen.once(cuts_of, min_radius).between(lower, lower)
    return canopy_of(seen.geometry, (source, receiver), area, trunks.tree)


def _check(job: Observation) -> None:
    from .directivity import directivity_of
    from .hearing import hearing_of

    _where_ends_are(job)
    directivity_of(job.sensor, job.folder)
    hearing_of(job.sensor, job.folder)


def _where_ends_are(job: Observation) -> np.ndarray:
    from .ends import ends_of

    pairs = np.concatenate(ends_of(job.sensor, job.seen.places, job.folder).pairs)
    return np.unique(pairs, axis=0)


def _channels(reverb: Reverb) -> int:
    """Number of pairs of source and receiver, sums over trunks all of them."""
    pairs = (1 + len(reverb.sources)) * (1 + len(reverb.receivers)) * reverb.array
    return pairs * {"omni": 1, "ambisonics": 3, "binaural": 12}[reverb.heard_as]


def _seconds_among(
    reverb: Reverb, settings: Scene, trees: int, channels: int
) -> tuple[float, float]:
    """Seconds that trees take to be cut at all heights, and that stems and the forest beyond take."""
    from .trunks import heights_between

    sources = [reverb.source[2], *(more.position[2] for more in reverb.sources)]
    receivers = [reverb.receiver[2], *(more.position[2] for more in reverb.receivers)]
    rises = {abs(one - other) for one in sources for other in receivers}
    cuts = sum(heights_between(rise) for rise in rises)
    stems = sum(some.count for some in settings.stems)
    dense = (trees + stems) / float(np.prod(settings.forest.size))
    beyond = max(dense * np.pi * reverb.continue_to**2 - trees - stems, 0.0)
    of_trees = trees * (A_TREE + A_CUT * (cuts - 1))
    alone = stems + beyond
    return of_trees, (MANY * alone / (alone + FEW) + A_STEM * trees) * channels


def sound_outline(reverb: Reverb) -> np.ndarray:
    """The direct path, and the one that the ground z = 0 mirrors."""
    source, receiver = np.asarray(reverb.source), np.asarray(reverb.receiver)
    bounce = source + (source[2] / (source[2] + receiver[2])) * (receiver - source)
    bounce[2] = 0.0
    return np.concatenate(
        [chain(np.array([source, receiver])), chain(np.array([source, bounce, receiver]))]
    )


def _choose(reverb: Reverb) -> tuple[Choice, ...]:
    if reverb.tolerance == AUTO:
        why = "of the whole; the record ends where so much is left of it"
        return (Choice("tolerance", END, END, why),)
    if 0 < reverb.tolerance < FINEST:
        why = f"by the direct sum over every trunk and frequency; the fast one ends at {FINEST:.0e}"
        asked = reverb.tolerance
        return (Choice("tolerance", asked, asked, why, asked),)
    return ()


def _left_out(found: Any) -> tuple[Choice, ...]:
    """Sentence on what a response left out as too weak."""
    if not found.weak:
        return ()
    why = (
        f"of any octave: {found.weak:,} trunks are left out that add less than the end of a record, "
        "75 dB down, were they all in phase"
    )
    return (Choice("weakest trunks", END, found.weak_bound, why),)


def _look(reverb: Reverb) -> SensorLook:
    return SensorLook(name=reverb.name, leaves=reverb.model == "forest")


def _fixed(group: Any) -> str:
    return keep("It sends alike to all sides") if group.directivity == "omni" else ""


def _bare(job: Observation, found: Any) -> str:
    """The words for a response that no trunk is in."""
    if any(one.trunks or one.continued for one in (found, *found.further)):
        return ""
    meshes = job.seen.geometry.meshes
    if any((mesh.part == OTHER).any() for mesh in meshes) and not any(
        is_wood(mesh.part).any() for mesh in meshes
    ):
        return (
            "no trunk is heard: no mesh here says which of its faces are wood; give trees the face attribute "
            '"part", 1 on wood and 2 on leaves, or have their file recognised as a species'
        )
    return (
        "no trunk is heard: what there is comes straight and by the ground; set plantings, stems or "
        "continue_to"
    )


REVERB = SensorKind(
    Reverb,
    run=_respond,
    audit=_audit,
    empty=_bare,
    check=_check,
    positions=_where_ends_are,
    cost=lambda reverb, *_: cost_of_work(
        reverb, "channels", _channels(reverb), CHANNEL, begin=BEGIN
    ),
    seconds_among=_seconds_among,
    outline=sound_outline,
    choose=_choose,
    left_out=_left_out,
    look=_look,
    family="reverb",
    help=keep("A clap among trunks, as it is heard at another place"),
    icon="RNDCURVE",
    colour=SOUND,
    body="speaker",
    posed=("source", "receiver", "facing_azimuth_deg", "facing_elevation_deg"),
    turns=(0, 1, 2),
    fixed=_fixed,
)
