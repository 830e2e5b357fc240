"""Sound by directions as SOFA files (AES69-2022), by the library sofar: heads in, arrays' responses out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..spec import SpecError
from .atomic import replacing
from .foreign import guarded, library


@dataclass(frozen=True)
class HeadResponses:
    """Impulse responses of a head: (D, 2, K), from unit vectors (D, 3), x ahead and y to the left; Hz."""

    directions: np.ndarray
    responses: np.ndarray
    sample_rate: float


def read_head(path: str | os.PathLike[str]) -> HeadResponses:
    """Read the convention SimpleFreeFieldHRIR: the left ear first, by where the file says that ears are, and
    directions as seen by the head; a delay that the file states is put before its samples.

    Raises
    ------
    SpecError : the file or the library is missing; it is no such file; it holds NaN or infinity.
    """
    sofar = library(path, "sofa", "sofar")
    return _read_head(path, sofar)


@guarded("a SOFA file of a head")
def _read_head(path: Path, sofar: Any) -> HeadResponses:
    if not path.is_file():
        raise FileNotFoundError(path)
    sofa = sofar.read_sofa(str(path), verify=False, verbose=False)
    if sofa.GLOBAL_SOFAConventions != "SimpleFreeFieldHRIR" or sofa.GLOBAL_DataType != "FIR":
        raise SpecError(
            str(path),
            f"holds {sofa.GLOBAL_SOFAConventions}; give one of the convention SimpleFreeFieldHRIR",
        )
    responses = np.asarray(sofa.Data_IR, np.float64)
    place = _cartesian(path, sofa, "SourcePosition") - _cartesian(path, sofa, "ListenerPosition")
    view = _cartesian(path, sofa, "ListenerView")
    up = _cartesian(path, sofa, "ListenerUp", sofa.ListenerView_Type)
    axes = np.stack(np.broadcast_arrays(view, np.cross(up, view), up), axis=1)
    axes = axes / np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), 1e-300)
    if not (np.abs(np.linalg.det(axes) - 1) < 0.01).all():
        raise SpecError(
            str(path), "has a ListenerUp that is not at right angles to its ListenerView"
        )
    place = np.einsum("mij,mj->mi", np.broadcast_to(axes, (len(place), 3, 3)), place)
    size = np.linalg.norm(place, axis=1)
    whole = np.isfinite(responses).all() and np.isfinite(place).all() and (size > 0).all()
    if responses.ndim != 3 or responses.shape[1] != 2 or len(place) != len(responses) or not whole:
        raise SpecError(str(path), "needs finite responses of two ears and a direction for each")
    ears = _cartesian(path, sofa, "ReceiverPosition")[:, 1]
    if ears[0] == ears[1]:
        raise SpecError(str(path), "has both ears on one side by its ReceiverPosition; correct it")
    delay = np.asarray(getattr(sofa, "Data_Delay", 0.0), np.float64)
    delay = np.broadcast_to(np.round(delay).astype(np.int64), responses.shape[:2])
    if delay.min(initial=0) < 0 or delay.max(initial=0) > 100_000:
        raise SpecError(str(path), "has a Data_Delay beyond 0 to 100,000 samples; correct it")
    late = np.zeros((*responses.shape[:2], responses.shape[2] + int(delay.max(initial=0))))
    for row, ear in np.ndindex(*delay.shape):
        first = int(delay[row, ear])
        late[row, ear, first : first + responses.shape[2]] = responses[row, ear]
    rate = float(np.ravel(sofa.Data_SamplingRate)[0])
    if not rate > 0:
        raise SpecError(str(path), "needs a sampling rate above 0 Hz")
    left_first = late if ears[0] > ears[1] else late[:, ::-1]
    return HeadResponses(place / size[:, None], left_first, rate)


def _cartesian(path: Path, found: Any, name: str, kind: str = "") -> np.ndarray:
    """(N, 3) positions or directions of a file in cartesian coordinates; of receivers those of a measurement.

    kind : the type of coordinates, where another attribute says it.

    Raises
    ------
    SpecError : other coordinates than cartesian and spherical, or receivers that move.
    """
    value = np.asarray(getattr(found, name), np.float64)
    kind = kind or str(getattr(found, f"{name}_Type"))
    if value.ndim == 3:
        if value.shape[2] > 1 and not (value == value[..., :1]).all():
            raise SpecError(str(path), f"has a {name} that changes; give one whose ears are fixed")
        value = value[..., 0]
    value = np.atleast_2d(value)
    if kind == "spherical":
        azimuth, elevation = np.radians(value[:, :2]).T
        level = value[:, 2] * np.cos(elevation)
        return np.column_stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), value[:, 2] * np.sin(elevation)]
        )
    if kind != "cartesian":
        raise SpecError(str(path), f"gives its {name} as {kind}; give cartesian or spherical ones")
    return value


def write_responses(
    path: str | os.PathLike[str],
    samples: np.ndarray,
    sample_rate: float,
    sources: np.ndarray,
    receivers: np.ndarray,
    title: str,
    names: Sequence[str],
) -> None:
    """Write the convention SingleRoomSRIR: M measurements by R receivers.

    samples : (M, R, N). sources : (M, 3) and receivers : (M, R, 3) metres in the scene. names : of receivers.

    Raises
    ------
    SpecError : the library is missing.
    """
    sofar = library(path, "sofa", "sofar")
    centre = receivers.mean(axis=1)
    file = sofar.Sofa("SingleRoomSRIR")
    file.GLOBAL_Title = title
    file.GLOBAL_RoomType = "reverberant"
    file.GLOBAL_ApplicationName = "Forest Sensing"
    file.GLOBAL_Comment = "receivers: " + ", ".join(names)
    file.Data_IR = samples
    file.Data_SamplingRate = sample_rate
    file.Data_Delay = np.zeros((1, samples.shape[1]))
    file.SourcePosition, file.SourcePosition_Type = sources, "cartesian"
    file.SourcePosition_Units = "metre"
    file.ListenerPosition = centre
    file.ReceiverPosition = np.moveaxis(receivers - centre[:, None], 0, 2)
    for name in ("ReceiverDescriptions", "ReceiverView", "ReceiverUp", "EmitterDescriptions"):
        file.delete(name)
    file.ReceiverPosition_Type, file.ReceiverPosition_Units = "cartesian", "metre"
    file.MeasurementDate = np.zeros(len(samples))
    with replacing(path) as partial:
        sofar.write_sofa(str(partial), file)
