"""Stands that may be the recorded one, and their reverberation with each term of the model on or off.

Nobody mapped the trees around the recordings: what is known of such forests is a range. Stands are drawn
evenly from it (Latin hypercube: each of N equal parts of each range once), so that a band of simulations
can be held to a recording without tuning one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.directivity import OMNI, Directivity
from forest_addon.sensing.reverb.forest.clutter import BARE, Clutter
from forest_addon.sensing.reverb.response import ImpulseResponse, impulse_response
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions
from forest_addon.sensing.reverb.trunks.slices import Trunks
from forest_addon.spec import Air, Reverb

FIELD = 120.0  # m; trunks go on around it with the same density
REACH = 350.0  # m

# Range of each property of a stand; (low, high).
RANGES = {
    "density": (0.04, 0.15),  # trunks per m²
    "radius": (0.05, 0.15),  # m
    "flow_resistivity": (50.0, 88.0),  # kPa·s/m², Albert et al. 2015, summer
    "leaf_area_density": (0.0, 0.5),  # m²/m³ at the height of the path, below the crowns
    "leaf_absorption": (0.001, 0.002),  # Watanabe & Yamada 1996
    "leaf_radius": (0.002, 0.02),  # m; needles to birch
    "branch_area_density": (0.02, 0.2),  # m²/m³ of bark: dead branches below crowns, undergrowth
    "branch_radius": (0.003, 0.012),  # m
    "bark": (0.02, 0.10),  # Li et al. 2020
    "turbulence": (0.0, 3.0),  # 1e-6; Daigle 1979 has 2 to 10 over open ground
    "trunk_height": (10.0, 22.0),  # m
    "lean_deg": (1.0, 3.0),  # a scanned pine 1.3; of Douglas firs those over 2 count as leaning
    "floor_leaf_area": (0.3, 2.0),  # m²/m² of herbs and dwarf shrubs, bare to lush
    "height": (1.0, 1.6),  # m of loudspeaker and microphone, where nobody says it
}
NOT_SETTINGS = ("density", "radius", "height")

EVEN_BY_LOGARITHM = ("density", "radius", "leaf_radius", "branch_area_density", "branch_radius")
OFF = {
    "branches": False,
    "boundary_loss": False,
    "model": "forest",
    "extinction": "none",
    "tail": "none",
    "path_ground": False,
    "bark": 0.0,
    "foliage": False,
    "turbulence": 0.0,
    "trunk_height": 0.0,
    "lean_deg": 0.0,
    "floor_leaf_area": 0.0,
}
TERMS: dict[str, tuple[str, ...]] = {
    "extinction alone": ("extinction",),
    "extinction and transport": ("extinction", "tail"),
    "ground": ("path_ground",),
    "ground in moving air": ("path_ground", "turbulence"),
    "ground among trunks that lean": ("path_ground", "lean_deg"),
    "ground under herbs": ("path_ground", "branches", "foliage", "floor_leaf_area"),
    "leaves": ("foliage",),
    "branches and leaves": ("branches", "foliage"),
    "branches and leaves, bark and air at branches": (
        "branches",
        "foliage",
        "bark",
        "boundary_loss",
    ),
    "bark": ("bark",),
    "trunks' ends": ("trunk_height",),
}


@dataclass(frozen=True)
class PlausibleStand:
    """One draw; the names are those of ``RANGES``."""

    density: float
    radius: float
    flow_resistivity: float
    leaf_area_density: float
    leaf_absorption: float
    leaf_radius: float
    branch_area_density: float
    branch_radius: float
    bark: float
    turbulence: float
    trunk_height: float
    lean_deg: float
    floor_leaf_area: float
    height: float
    number: int
    clutter: Clutter = BARE


@dataclass(frozen=True)
class Path:
    """Between source and receiver: metres, height (0: the stand's), Hz, air, a source that points up."""

    distance: float
    height: float
    rate: float
    air: Air
    source: Directivity = OMNI


def plausible_stands(count: int, seed: int) -> list[PlausibleStand]:
    """So many stands, those of EVEN_BY_LOGARITHM evenly by that."""
    rng = stream(seed, "validate", "stands")
    columns = {}
    for name, (low, high) in RANGES.items():
        share = (rng.permutation(count) + rng.random(count)) / count
        even = low + (high - low) * share
        columns[name] = low * (high / low) ** share if name in EVEN_BY_LOGARITHM else even
    return [
        PlausibleStand(**{name: float(values[n]) for name, values in columns.items()}, number=n)
        for n in range(count)
    ]


def settings(stand: PlausibleStand, path: Path, **changes: object) -> Reverb:
    """All terms on, but for the changes."""
    half, height = path.distance / 2, path.height or stand.height
    given = {
        "source": (-half, 0.0, height),
        "receiver": (half, 0.0, height),
        "sample_rate": path.rate,
        "model": "forest",
        "surface": "forest floor",
        "continue_to": REACH,
        "facing_elevation_deg": 90.0,
        **{name: getattr(stand, name) for name in RANGES if name not in NOT_SETTINGS},
    }
    return Reverb(**(given | changes))


def variants(stand: PlausibleStand, path: Path) -> dict[str, Reverb]:
    """The ablation: Kaneko & Gamper's model, none of the terms, each, all; all with needles for leaves."""
    every = settings(stand, path)
    found = {
        "Kaneko & Gamper's model": settings(stand, path, model="paper"),
        "none": settings(stand, path, **OFF),
    }
    for name, terms in TERMS.items():
        kept = {key: value for key, value in OFF.items() if key not in terms}
        found[name] = settings(stand, path, **kept)
    needles = {"leaf_area_density": 0.0, "needle_area_density": stand.leaf_area_density}
    return found | {"all": every, "all, leaves as needles": settings(stand, path, **needles)}


def heard(
    stand: PlausibleStand, reverb: Reverb, path: Path, expansions: Expansions | None = None
) -> ImpulseResponse:
    """The response of one stand: trunks evenly at random, all of one radius."""
    rng = stream(stand.number, "validate", "trunks")
    place = rng.uniform(-FIELD / 2, FIELD / 2, (rng.poisson(stand.density * FIELD**2), 2))
    ends = np.array([reverb.source[:2], reverb.receiver[:2]])
    trunks = Trunks(place, np.full(len(place), stand.radius), np.full(len(place), -1))
    return impulse_response(
        trunks.clear_of(ends),
        replace(reverb, tolerance=1e-3),
        path.air,
        directivity=path.source,
        rng=stream(stand.number, "validate", "continuation"),
        field=((-FIELD / 2, -FIELD / 2), (FIELD, FIELD)),
        expansions=expansions,
        key=(stand.number, "validate"),
    )
