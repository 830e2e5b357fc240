"""Measured sway: frequencies of trees, hour-long records of trunks, and the slope of a record's spectrum."""

from __future__ import annotations

import csv
import lzma
from pathlib import Path

import numpy as np
from scipy.signal import welch

from .grown import MeasuredSway

BAND = (0.05, 2.0)  # Hz, of the slope
PIECE = 600.0  # seconds of a spectrum's pieces


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


def record_slopes(folder: Path, clade: str, sensor: str = "Strain gauge") -> np.ndarray:
    """(R,) slopes of the measured records of a clade by one kind of sensor.

    Accelerometers weigh a motion by its frequency squared: their slopes are no slopes of strain.
    """
    with (folder / "records" / "records.csv").open(encoding="utf-8") as file:
        rows = [r for r in csv.DictReader(file) if (r["Clade2"], r["Sensor"]) == (clade, sensor)]
    found = []
    for row in rows:
        with lzma.open(folder / "records" / f"{row['Filename']}.csv.xz", "rt") as text:
            found.append(slope_of(np.genfromtxt(text, delimiter=","), float(row["Res_Hz"])))
    return np.array(found)


def slope_of(record: np.ndarray, rate: float) -> float:
    """Slope of the logarithm of a record's (T, C) power over that of frequency, 0.05 to 2 Hz.

    By least squares over the evenly spaced lines of the spectrum, which weigh the upper end most; so do the
    records' authors, whose own slopes it meets within 0.5.
    """
    frequency, power = welch(
        record - record.mean(axis=0), rate, nperseg=min(len(record), int(PIECE * rate)), axis=0
    )
    power = power.sum(axis=1)
    rows = (frequency >= BAND[0]) & (frequency <= BAND[1]) & (power > 0)
    return float(np.polyfit(np.log(frequency[rows]), np.log(power[rows]), 1)[0])
