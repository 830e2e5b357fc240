"""What a sensor found, as the one file of data that belongs to it, named after the sensor.

A tractor scan becomes named arrays (.npz), a scan of points a point cloud (.laz), an echo arrays and a sound
(``echo_files``), an impulse response a sound (.wav), a channel for each pair of source and receiver, and
arrays with its parts and measures.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from ..formats.las import write_las
from ..formats.npz import write_npz
from ..formats.wav import write_wav
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.tractor import TractorScan
from ..sensing.reverb.metrics import RoomMetrics, echo_density, energy_decay_db, room_metrics
from ..sensing.reverb.response import ImpulseResponse, channels_of
from ..sensing.sonar.flight import Flight
from ..sensing.sonar.ping import Echo
from ..spec import Sensor, Sonar
from .echo_files import write_echo
from .figures import Finding
from .points import records


def write_finding(
    folder: Path,
    sensor: Sensor,
    found: Finding,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> list[Path]:
    """Write a sensor's result into a folder; returns the files, the one of the data first.

    offset : metres added to the positions of points, the scene's ``offset``.

    Raises
    ------
    OSError : it cannot be written; what had its name before stays as it was.
    """
    name = sensor.name
    if isinstance(found, Echo | Flight):
        return write_echo(folder, name, found, sensor if isinstance(sensor, Sonar) else Sonar())
    if isinstance(found, TractorScan):
        path = folder / f"{name}.npz"
        arrays = {
            "distance": found.matrix,
            "organ": found.organ,
            "tree": found.returns.tree.reshape(found.distance.shape),
            "angle": found.angle,
            "track": found.track,
        }
        write_npz(path, arrays, {"distance": "m", "angle": "rad", "track": "m"})
    elif isinstance(found, Cloud):
        path = folder / f"{name}.laz"
        write_las(path, records(found, offset))
    else:
        path = folder / f"{name}.wav"
        write_wav(path, channels_of(found), found.sample_rate)
        return [path, write_response(folder, name, found)]
    return [path]


def write_response(folder: Path, name: str, found: ImpulseResponse) -> Path:
    """Write the channels of an impulse response with their parts, axes, units and measures as NPZ.

    Arrays of measures are (C, B): by channel and by band, 0 Hz for the whole band.
    """
    channels = found.channels
    measures = [
        room_metrics(channel.samples, found.sample_rate, channel.left_db) for channel in channels
    ]
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
        "left_out": np.array([channel.left_db for channel in channels]),
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
    units |= dict.fromkeys(("energy_decay", "left_out", "c50", "c80"), "dB") | {"echo_density": "1"}
    units |= dict.fromkeys(("samples", "direct", "ground", "trees"), "re source's impulse at 1 m")
    path = folder / f"{name}.npz"
    write_npz(path, arrays, units)
    return path
