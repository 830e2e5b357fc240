"""Files of a sonar's echoes: arrays with units, a sound slowed down for human ears, the scatterers.

``NAME.npz`` holds axes, impulse responses, spectra and the echoes of the call, with poses; of a flight all
arrays are stacked and padded to one length. ``NAME.wav`` plays the echoes ``time_expansion`` times slower,
one channel an ear, one pose after the other, as loud as the file can hold; ``wav_gain`` in the NPZ takes
that back. ``NAME-heard.npz`` lists what each leaf, branch and facet added, in a scene that moves with its
velocity at the ping's time and its place at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..formats.table import write_npz
from ..formats.wav import write_wav
from ..sensing.sonar.ping import Contributions, Echo, PingSeries
from ..spec import Sonar
from .coordinates import on_the_map

NONE = (0.0, 0.0, 0.0)
LOUD = 0.9  # peak of the WAV
UNITS = {
    "time": "s",
    "impulse_response": "re call at 1 m",
    "waveform": "re call at 1 m",
    "frequency": "Hz",
    "spectrum": "re call at 1 m",
    "position": "m",
    "axis": "1",
    "sound_speed": "m/s",
    "sample_rate": "Hz",
}
HEARD_UNITS = {
    "position": "m",
    "distance": "m",
    "delay": "s",
    "amplitude": "re call at 1 m",
    "velocity": "m/s",
    "rest": "m",
}


def write_echo(
    folder: Path, name: str, found: Echo | PingSeries, sonar: Sonar, offset: Sequence[float] = NONE
) -> list[Path]:
    """Write an echo or a flight; returns the files, the NPZ first.

    offset : (3,) metres, added to positions.

    Raises
    ------
    OSError : a file cannot be written; what had its name before stays as it was.
    """
    files = [folder / f"{name}.npz", folder / f"{name}.wav"]
    write_echo_arrays(files[0], found, offset)
    write_echo_sound(files[1], found, sonar.time_expansion)
    if sonar.contributions:
        files.append(folder / f"{name}-heard.npz")
        write_npz(files[2], on_the_map(heard_columns(found), offset), HEARD_UNITS)
    return files


def write_echo_arrays(path: Path, found: Echo | PingSeries, offset: Sequence[float] = NONE) -> None:
    """Write axes, responses, spectra, echoes and poses as NPZ. offset : (3,) metres, added to positions."""
    flight, single = _flight(found), isinstance(found, Echo)
    waveform = flight.stacked("waveforms")
    arrays = _arrays(flight, waveform, single) | {"wav_gain": np.array(_gain(waveform))}
    write_npz(path, on_the_map(arrays, offset), UNITS)


def write_echo_sound(path: Path, found: Echo | PingSeries, time_expansion: float) -> None:
    """Write the echoes as WAV, ``time_expansion`` times slower."""
    write_wav(path, *sound_of(found, time_expansion))


def sound_of(found: Echo | PingSeries, time_expansion: float) -> tuple[np.ndarray, int]:
    """The echoes ``time_expansion`` times slower: (N, E) samples as loud as a file can hold, rate in Hz."""
    flight = _flight(found)
    waveform = flight.stacked("waveforms")
    sound = np.moveaxis(waveform, 1, 2).reshape(-1, waveform.shape[1]) * _gain(waveform)
    return sound, max(1, round(flight.echoes[0].sample_rate / time_expansion))


def _flight(found: Echo | PingSeries) -> PingSeries:
    return found if isinstance(found, PingSeries) else PingSeries((found,))


def _gain(waveform: np.ndarray) -> float:
    """Return what the loudest sample of (P, E, N) needs to fill the WAV."""
    peak = float(np.abs(waveform).max(initial=0.0))
    return LOUD / peak if peak > 0 else 1.0


def _arrays(flight: PingSeries, waveform: np.ndarray, single: bool) -> dict[str, np.ndarray]:
    """Return what the NPZ holds; of one ping at one ear, records are (N,)."""
    first = flight.echoes[0]
    position, axis = flight.poses()
    stacked = {"impulse_response": flight.stacked("responses"), "waveform": waveform}
    if single:
        stacked["spectrum"] = first.spectra[None]
        position, axis = position[0], axis[0]
    one_ear = waveform.shape[1] == 1
    for key, array in stacked.items():
        array = array[0] if single else array
        stacked[key] = np.squeeze(array, axis=-2) if one_ear else array
    arrays = {"time": flight.time, **stacked, "position": position, "axis": axis}
    if single:
        arrays["frequency"] = first.frequency
    return arrays | {
        "sound_speed": np.array(first.sound_speed),
        "sample_rate": np.array(first.sample_rate),
    }


def heard_columns(found: Echo | PingSeries) -> dict[str, np.ndarray]:
    """Rows of all poses, the loudest of each pose first; ``pose`` (M,) is its number."""
    heard = [echo.heard for echo in _flight(found).echoes]
    names = ["kind", "instance", "tree", "number", "position", "distance", "delay", "amplitude"]
    if any(some.velocity is not None for some in heard):
        names += ["velocity", "rest"]
    columns = {key: np.concatenate([_column(some, key) for some in heard]) for key in names}
    return {"pose": np.repeat(np.arange(len(heard)), [len(some) for some in heard])} | columns


def _column(heard: Contributions, name: str) -> np.ndarray:
    """(M,) or (M, 3) a column; of a ping that hears nothing, none of motion either."""
    found = getattr(heard, name)
    return np.empty((0, 3)) if found is None else found
