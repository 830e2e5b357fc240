"""What a sensor found, as the one file of data that belongs to it, named after the sensor.

A tractor scan and an echo become named arrays (.npz), a scan of points a point cloud (.laz), an impulse
response a sound (.wav).
"""

from __future__ import annotations

from pathlib import Path

from ..sensing.cloud import Cloud
from ..sensing.reverb import ImpulseResponse
from ..sensing.sonar import Echo
from ..sensing.tractor import TractorScan
from .las import write_las
from .npz import write_npz
from .points import records
from .wav import write_wav

Finding = TractorScan | Cloud | Echo | ImpulseResponse


def write_finding(
    folder: Path, name: str, found: Finding, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Path:
    """Write a sensor's result into a folder; returns the file.

    offset : metres added to the positions of points, the scene's ``offset``.

    Raises
    ------
    OSError : it cannot be written; what had its name before stays as it was.
    """
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
        write_wav(path, found.samples, found.sample_rate)
    return path
