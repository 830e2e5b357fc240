"""What a sensor found, as the one file of data that belongs to it, named after the sensor.

A tractor scan becomes named arrays (.npz), a scan of points a point cloud (.laz), an impulse response a
sound (.wav), an echo arrays and a sound (``echo_files``).
"""

from __future__ import annotations

from pathlib import Path

from ..sensing.cloud import Cloud
from ..sensing.flight import Flight
from ..sensing.reverb import ImpulseResponse
from ..sensing.sonar import Echo
from ..sensing.tractor import TractorScan
from ..spec import Sensor, Sonar
from .echo_files import write_echo
from .las import write_las
from .npz import write_npz
from .points import records
from .wav import write_wav

Finding = TractorScan | Cloud | Echo | Flight | ImpulseResponse


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
        write_wav(path, found.samples, found.sample_rate)
    return [path]
