"""Legend of every name within the files of a scene: columns, arrays, fields; ``legend.csv`` of a dataset.

A ``*`` in a name stands for anything; ``NAME_unit`` beside an array is its unit as text.
"""

from __future__ import annotations

from pathlib import Path

from forest_addon.base.trimesh import PART_NAMES
from forest_addon.formats.table import write_csv

from ..for_instance import CLASSES

ORGANS = ", ".join(f"{number} {name}" for number, name in enumerate(PART_NAMES))
_POINT = {
    "tree": "tree of trees.csv; -1 none",
    "species": "planting of scene.toml, from 0, undergrowth after the rest; -1 none",
    "organ": ORGANS,
    "leaf": "leaf of its tree, a row of leaves.npz; -1 none",
    "object": "instance in the scene; -1 none",
    "amplitude": "energy that came back; 1: a white surface that faces at 1 m",
    "width": "standard deviation of the echo, ns",
    "range": "as measured, m",
    "true_range": "without noise, m",
    **{f"n{axis}": f"{axis} of the surface's unit normal" for axis in "xyz"},
    "incidence": "between beam and normal, degrees",
    "bounce": "of scanners that follow bounces: 0 direct, 1 ghost, 2 through glass, 3 refracted",
}
_GRID = {
    "edge": "of a cell, m",
    "origin": "that is added to coordinates, m; cells count from it",
}
_CSV_TREES = {
    "tree": "number of the tree",
    "species": "its species",
    "planting": "label of its planting",
    "variant": "which of the planting's grown trees it is",
    **{f"{axis}_m": f"{axis} of its foot, m" for axis in "xyz"},
    "rotation_rad": "turn about its axis, rad",
    "scale": "its size relative to the grown tree",
    "height_m": "above the ground, m",
    "dbh_m": "diameter 1.3 m above the ground, m; 0: not so high",
    "crown_width_m": "of the crown seen from above, m",
    "crown_base_m": "height below which a fiftieth of the leaf area is, m",
    "foot_radius_m": "of all stems at the foot together, m",
    "leaves": "how many",
    "leaf_area_m2": "one side, m²",
    "wood_volume_m3": "of all its wood, m³",
    "wood_area_m2": "surface of all its wood, m²",
    "projected_wood_m2": "length times diameter of all its wood, m²",
    "target_*": "what it was to measure; empty: nothing was asked",
    "in_band": "1: all of it is as measured trees have it",
    "not_met": "names of targets that it misses",
    "all_branches": "1: cylinders.csv holds all its branches; 0: trunk and first-level branches",
}
_CYLINDERS = {
    "tree": "tree of trees.csv",
    "cyl_ID": "from 1 within the tree",
    "parent_ID": "the cylinder that it stands on; 0 none",
    "extension_ID": "the one that goes on from it; 0 none",
    "axis_ID": "of its axis, from 1",
    "branching_order": "0 the stem, 1 its branches and so on",
    **{f"{end}{axis}": f"{axis} of its {end}, m" for end in ("start", "end") for axis in "XYZ"},
    "radius_cyl": "of the cylinder of equal volume, m",
    "radius_start": "at its start, m",
    "radius_end": "at its end, m",
    "length": "m",
    "volume": "m³",
}
_ECHOES = {
    "time": "of the columns of impulse_response and waveform, s",
    "impulse_response": "by pose, ear and time, re call at 1 m",
    "waveform": "the echo of the call, likewise, re call at 1 m",
    "spectrum": "of one ping, by frequency, re call at 1 m",
    "frequency": "of the spectrum, Hz",
    "position": "of the sonar at each pose, m",
    "axis": "unit vector along which it pings",
    "sound_speed": "m/s",
    "sample_rate": "Hz",
    "wav_gain": "factor from the waveform to NAME.wav",
}
_HEARD = {
    "pose": "number of the pose",
    "kind": "what gave the echo, in words",
    "instance": "instance in the scene; -1 none",
    "tree": "tree of trees.csv; -1 none",
    "number": "of the leaf, or the part, within it",
    "position": "m",
    "distance": "from the sonar, m",
    "delay": "there and back, s",
    "amplitude": "re call at 1 m",
    "velocity": "at the ping's time, m/s; of a scene that moves",
    "rest": "where it is as the scene stands still, m; of a scene that moves",
}
_RESPONSE = {
    "channel": "of the receiver",
    "time": "of the samples, s",
    "samples": "impulse response by channel and time, re source's impulse at 1 m",
    **{part: f"its part by the {part}" for part in ("ground", "trees")},
    "direct": "its direct sound",
    "source": "where it is, m",
    "receiver": "where each channel is, m",
    "moment": "at which it is, of what moves, s",
    "direct_delay": "of the direct sound, s",
    "left_out": "energy after the record's end, dB, by channel and band",
    "energy_decay": "energy still to come, dB, by channel and time",
    "band": "middle of the octave; 0 the whole band, Hz",
    "edt": "time of a fall by 60 dB, from the first 10 dB, s",
    **{
        f"t{fall}": f"the same, from -5 to -{5 + fall} dB; nan: not reached, s"
        for fall in (20, 30, 60)
    },
    **{f"c{early}": f"energy before over after {early} ms, dB" for early in (50, 80)},
    "d50": "share of the energy before 50 ms",
    "centre_time": "mean time of the energy after the onset, s",
    "echo_density_time": "of echo_density, s",
    "echo_density": "by channel; 1: as dense as noise",
}
NAMES: dict[str, dict[str, str]] = {
    "NAME.npz (sonar)": _ECHOES,
    "NAME-heard.npz": _HEARD,
    "NAME.npz (reverb)": _RESPONSE,
    "NAME-route.csv": {
        **{f"{axis}_m": f"{axis} of the pose, m" for axis in "xyz"},
        "azimuth_deg": "from +X towards +Y, degrees",
        "elevation_deg": "from the horizon up, degrees",
        "time_s": "of the ping, s",
    },
    "trees.csv": _CSV_TREES,
    "cylinders.csv": _CYLINDERS,
    "leaf_angles.csv": {
        "from_deg": "lower end of the class of inclinations, degrees",
        "to_deg": "its upper end, degrees",
        "*_per_rad": "density of a planting's leaf area, per radian; empty or 0: no leaf",
    },
    "voxels.npz": {
        **_GRID,
        "cell": "of each row: its numbers along x, y, z",
        "leaf_area_density": "one side, m²/m³",
        "wood_area_density": "m²/m³",
        "tree_cell": "row of cell, beside the tree that is in it",
        "tree": "that is in that cell; tree of trees.csv",
    },
    "NAME-occlusion.npz": {
        **_GRID,
        "low": "numbers of the lowest cell",
        "every": "one of so many pulses was counted",
        "pulses": "how many were counted",
        "pulses_in": "that went into each cell",
        "pulses_hit": "that met something there",
        "pulses_blocked": "that would have gone in, had nothing stood before it",
    },
    "NAME-hidden.npz": {
        "pulse": "number of the pulse",
        "tree": "tree of trees.csv on its line",
        "distance": "to it, m",
        "seen": "whether the pulse met it",
        "every": "one of so many pulses was taken",
    },
    "leaves.npz": {
        "centre": "m",
        "normal": "unit vector",
        "axis": "unit vector along the leaf",
        "length": "m",
        "width": "m",
        "radius": "of the disc of equal area, m",
        "branch": "first-level branch of its tree",
        "leaf": "number within its tree",
        "tree": "tree of trees.csv",
        "species": "planting, from 0",
    },
    "NAME.laz": _POINT,
    "NAME-points.npz": {
        **dict.fromkeys("xyz", "m"),
        "time": "s",
        **_POINT,
        "scan_angle": "degrees",
        "pulse": "number of the pulse",
        "return_number": "from 1",
        "number_of_returns": "of its pulse",
    },
    "NAME-forinstance.laz": {
        "classification": ", ".join(f"{number} {name}" for number, name in enumerate(CLASSES)),
        "treeID": "tree of trees.csv + 1; 0 none",
        "organ": ORGANS,
        "order": "0 the stem, 1 its branches and so on; -1 unknown",
    },
}


def meaning_of(file: str, name: str) -> str:
    """The legend of a name in a kind of file; empty where there is none.

    file : as ``NAMES`` has it. A unit's text is explained by what it is the unit of.
    """
    known = NAMES.get(file, {})
    for key in (name, name.removesuffix("_unit")):
        if key in known:
            return known[key]
    for key, words in known.items():
        if key.endswith("*") and name.startswith(key[:-1]):
            return words
        if key.startswith("*") and name.endswith(key[1:]):
            return words
    return ""


def write_names(path: Path) -> None:
    """Write the legend of all names as CSV."""
    rows = [(file, name, words) for file, known in NAMES.items() for name, words in known.items()]
    file, name, words = zip(*rows, strict=True)
    write_csv(path, {"file": list(file), "name": list(name), "meaning": list(words)})
