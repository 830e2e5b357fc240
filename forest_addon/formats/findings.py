"""What a sensor found, as the one file of data that belongs to it, named after the sensor.

A tractor scan and an echo become named arrays (.npz), a terrestrial scan a point cloud (.laz), an impulse
response a sound (.wav), a channel for each pair of source and receiver; ``write_response`` writes its parts
and measures too.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from ..sensing.lidar import Cloud, TractorScan
from ..sensing.metrics import RoomMetrics, echo_density, energy_decay_db, room_metrics
from ..sensing.reverb import ImpulseResponse
from ..sensing.sonar import Echo
from .las import write_las
from .npz import write_npz
from .wav import write_wav

Finding = TractorScan | Cloud | Echo | ImpulseResponse


def write_finding(folder: Path, name: str, found: Finding) -> Path:
    """Write a sensor's result into a folder; returns the file.

    Raises
    ------
    OSError : it cannot be written; what had its name before stays as it was.
    """
    if isinstance(found, TractorScan):
        path = folder / f"{name}.npz"
        arrays = {
            "distance": found.distance,
            "organ": found.organ,
            "tree": found.returns.tree.reshape(found.distance.shape),
            "angle": found.angle,
            "track": found.track,
        }
        write_npz(path, arrays, {"distance": "m", "angle": "rad", "track": "m"})
    elif isinstance(found, Cloud):
        path = folder / f"{name}.laz"
        write_las(path, found)
    elif isinstance(found, Echo):
        path = folder / f"{name}.npz"
        arrays = {
            "time": found.time,
            "impulse_response": found.impulse_response,
            "frequency": found.frequency,
            "spectrum": found.spectrum,
        }
        units = {"time": "s", "impulse_response": "re call at 1 m", "frequency": "Hz"}
        write_npz(path, arrays, units)
    else:
        path = folder / f"{name}.wav"
        write_wav(path, channels_of(found), found.sample_rate)
    return path


def channels_of(found: ImpulseResponse) -> np.ndarray:
    """(N,) samples of one channel, or (N, C) of several."""
    samples = np.column_stack([channel.samples for channel in found.channels])
    return samples[:, 0] if samples.shape[1] == 1 else samples


def write_response(folder: Path, name: str, found: ImpulseResponse) -> Path:
    """Write the channels of an impulse response with their parts, axes, units and measures as NPZ.

    Arrays of measures are (C, B): by channel and by band, 0 Hz for the whole band.
    """
    channels = found.channels
    measures = [room_metrics(channel.samples, found.sample_rate) for channel in channels]
    times, densities = zip(
        *(echo_density(channel.samples, found.sample_rate) for channel in channels), strict=True
    )
    arrays = {
        "channel": np.array([channel.channel for channel in channels]),
        "time": np.arange(len(found.samples)) / found.sample_rate,
        **{
            part: np.array([getattr(channel, part) for channel in channels])
            for part in ("samples", "direct", "ground", "trees")
        },
        "direct_delay": np.array([channel.direct_delay for channel in channels]),
        "energy_decay": np.array([energy_decay_db(channel.samples) for channel in channels]),
        "band": measures[0].band,
        **{
            field.name: np.array([getattr(measure, field.name) for measure in measures])
            for field in dataclasses.fields(RoomMetrics)
            if field.name != "band"
        },
        "echo_density_time": times[0],
        "echo_density": np.array(densities),
    }
    units = dict.fromkeys(("time", "direct_delay", "centre_time", "echo_density_time"), "s")
    units |= dict.fromkeys(("edt", "t20", "t30", "t60"), "s") | {"band": "Hz", "d50": "1"}
    units |= dict.fromkeys(("energy_decay", "c50", "c80"), "dB") | {"echo_density": "1"}
    units |= dict.fromkeys(("samples", "direct", "ground", "trees"), "re source's impulse at 1 m")
    path = folder / f"{name}.npz"
    write_npz(path, arrays, units)
    return path
