"""A recording of the user's own held to a simulation of the trees that were mapped around it.

The map is a CSV with x, y in metres and radius (m) or dbh (cm), a row a tree; two rows more, whose column
``what`` says source and receiver, with z their height. Beyond the map the forest goes on as dense as in it.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.sensing.reverb.metrics import octave_bands
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.sums.fast_scattering import Expansions
from forest_addon.sensing.reverb.trunks.slices import Trunks
from forest_addon.spec import Air, Reverb, SpecError

from ..comparison import Comparison, Interval, Picture
from .decay import Decay, decay_of, read_recording
from .pictures import draw_bands
from .stands import REACH, plausible_stands, settings
from .stands import Path as SoundPath

RATE, SEVERAL = 32e3, 6  # Hz; stands of the same trees with losses drawn from their ranges
T20_SHARE, C50_DB = 0.25, 3.0
LOWEST = 250.0  # Hz


def validate_own(recording: Path, stand: Path | None, out: Path) -> list[Comparison]:
    """T20 and C50 by octave of a recording, beside the mapped trees with plausible losses.

    Raises
    ------
    SpecError : the recording or the map cannot be used; says what to change.
    """
    if stand is None:
        raise SpecError("--stand", "is needed for a recording; give a CSV of the trees around it")
    trunks, source, receiver = read_stand(stand)
    samples = read_recording(recording, RATE)
    bands = np.array([band for band in octave_bands(RATE) if band >= LOWEST])
    measured = decay_of(samples, RATE, bands)
    corner, size = trunks.position.min(axis=0), np.ptp(trunks.position, axis=0)
    path = SoundPath(math.dist(source[:2], receiver[:2]), float(source[2]), RATE, Air())
    every: dict[str, list[Decay]] = {"forest": [], "paper": []}
    for drawn in plausible_stands(SEVERAL, 1):
        for model, some in every.items():
            if model == "paper" and some:
                continue
            placed = {"source": tuple(source), "receiver": tuple(receiver), "continue_to": REACH}
            reverb: Reverb = settings(drawn, path, model=model, tolerance=1e-3, **placed)
            found = impulse_response(
                trunks,
                reverb,
                path.air,
                rng=stream(drawn.number, "validate", "continuation"),
                field=((corner[0], corner[1]), (size[0], size[1])),
                expansions=Expansions(),
                key=(drawn.number, "validate"),
            )
            some.append(decay_of(found.samples, RATE, bands))
    drawn_bands = draw_bands(out / "reverb-own.png", measured, every["forest"], every["paper"])
    words = f"{recording.name} and {len(trunks)} trees of {stand.name}."
    return _rows(measured, every["forest"], every["paper"], Picture(drawn_bands, words))


def read_stand(path: Path) -> tuple[Trunks, np.ndarray, np.ndarray]:
    """Trunks, source (3,) and receiver (3,) of a map.

    Raises
    ------
    SpecError : a column, the source or the receiver is missing; a value is no number.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as text:
            rows = list(csv.DictReader(text))
    except OSError as problem:
        raise SpecError(str(path), f"cannot be read ({problem.strerror})") from None
    ends: dict[str, np.ndarray] = {}
    trees = []
    for number, row in enumerate(rows, start=2):
        try:
            what = (row.get("what") or "tree").strip().lower()
            if what in ("source", "receiver"):
                ends[what] = np.array([float(row[key]) for key in ("x", "y", "z")])
            else:
                radius = float(row["radius"]) if row.get("radius") else float(row["dbh"]) / 200.0
                trees.append((float(row["x"]), float(row["y"]), radius))
        except (KeyError, TypeError, ValueError):
            raise SpecError(
                f"{path.name}, line {number}",
                "needs numbers in x, y and radius (m) or dbh (cm); source and receiver in x, y, z",
            ) from None
    for name in ("source", "receiver"):
        if name not in ends:
            raise SpecError(path.name, f"has no row whose column what says {name}; add it")
    if len(trees) < 3:
        raise SpecError(path.name, "has fewer than three trees; map more of them")
    place = np.array(trees)
    trunks = Trunks(place[:, :2], place[:, 2], np.full(len(place), -1))
    return trunks, ends["source"], ends["receiver"]


def _rows(
    measured: Decay, every: list[Decay], before: list[Decay], picture: Picture
) -> list[Comparison]:
    found = []
    for name, unit, near in (("t20", "s", T20_SHARE), ("c50", "dB", C50_DB)):
        for n, band in enumerate(measured.band):
            true = float(getattr(measured, name)[n])
            now = np.array([getattr(each, name)[n] for each in every])
            old = float(getattr(before[0], name)[n])
            now = now[np.isfinite(now)]
            apart = near * true if name == "t20" else near
            known = math.isfinite(true) and len(now) > 0
            found.append(
                Comparison(
                    f"{name.upper()} at {band:g} Hz",
                    unit,
                    Interval(true, true - apart, true + apart) if math.isfinite(true) else None,
                    Interval.of(now) if len(now) else None,
                    bool(abs(np.median(now) - true) <= apart) if known else None,
                    before=Interval(old) if math.isfinite(old) else None,
                    pictures=(picture,) if not found else (),
                )
            )
    return found
