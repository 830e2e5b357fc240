"""Measured sway: frequencies of trees, hour-long records of trunks, and the slope of a record's spectrum."""

from __future__ import annotations

import csv
import lzma
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt, welch

from .grown import MeasuredSway

BAND = (0.05, 2.0)  # Hz, of the slope
NOMINAL = 4.0  # Hz
CUT = 0.0017  # Hz, of the high pass


def measured_trees(folder: Path, clade: str, place: str) -> list[MeasuredSway]:
    """Trees of a clade (Conifer, Broadleaf) and a place (Forest, Open) with all three measures."""
    with (folder / "sway_trees.csv").open(encoding="utf-8") as file:
        rows = [
            r for r in csv.DictReader(file) if r["clade"] == clade and r["environment"] == place
        ]
    return [
        MeasuredSway(
            (row["species"].split() or [""])[0],
            float(row["dbh_m"]),
            float(row["height_m"]),
            float(row["f0_hz"]),
        )
        for row in rows
        if row["dbh_m"] and row["height_m"] and row["f0_hz"]
    ]


@dataclass(frozen=True)
class SwayRecord:
    """A record of trunk motion: two channels or more (T, C) at a rate in Hz, by a kind of sensor of a clade.

    published : slope of its spectrum as its authors give it, NaN where they give none.
    """

    name: str
    clade: str
    sensor: str
    rate: float
    published: float
    motion: np.ndarray


def measured_records(folder: Path) -> list[SwayRecord]:
    """Read the measured records."""
    with (folder / "records" / "records.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = []
    for row in rows:
        name = row["Filename"]
        with lzma.open(folder / "records" / f"{name}.csv.xz", "rt") as text:
            motion = np.genfromtxt(text, delimiter=",")
        published = float(row["sh_s_slope_005_2"])
        rate = float(row["Res_Hz"])
        found.append(SwayRecord(name, row["Clade2"], row["Sensor"], rate, published, motion))
    return found


def slope_of(motion: np.ndarray, rate: float = NOMINAL) -> float:
    """Slope of log power over log frequency, 0.05 to 2 Hz, of motion (T, C), as the records' authors find it.

    High pass of fourth order, the first principal component, Welch's spectrum of eight Hamming windows that
    overlap by half, least squares over its evenly spaced lines (Jackson et al. 2021,
    ``calculate_features_fn7``, ``slope_of_spectrum2``). They take every record for one of 4 Hz, so that
    the bands of faster ones lie 1.25 or 2.5 times higher.
    """
    high = butter(4, CUT / (rate / 2), "high")
    calm = filtfilt(*high, motion - motion.mean(axis=0), axis=0)
    calm -= calm.mean(axis=0)
    main = calm @ np.linalg.svd(calm, full_matrices=False)[2][0]
    frequency, power = spectrum_of(main, rate)
    rows = (frequency >= BAND[0]) & (frequency <= BAND[1]) & (power > 0)
    return float(np.polyfit(np.log(frequency[rows]), np.log(power[rows]), 1)[0])


def spectrum_of(series: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and power density of a series (T,), as Matlab's ``pwelch`` has them unasked."""
    piece = int(len(series) / 4.5)  # of eight that overlap by half
    lines = max(256, 2 ** int(np.ceil(np.log2(piece))))
    return welch(series, rate, "hamming", piece, noverlap=piece // 2, nfft=lines, detrend=False)


def floor_of(record: SwayRecord) -> float:
    """Share of a record's variance that white noise at the level of its highest fifth of frequencies has."""
    motion = record.motion - record.motion.mean(axis=0)
    main = motion @ np.linalg.svd(motion, full_matrices=False)[2][0]
    frequency, power = spectrum_of(main, record.rate)
    level = float(np.median(power[frequency > 0.4 * record.rate]))
    return level * record.rate / 2 / float(np.trapezoid(power, frequency))


def gauged(motion: np.ndarray, floor: float, rng: np.random.Generator) -> np.ndarray:
    """(T, C) motion as a gauge records it whose white noise has a share of the variance of both channels."""
    deviation = np.sqrt(floor * motion.var(axis=0).sum())
    return motion + deviation * rng.normal(size=motion.shape)
