"""Files of a sonar's echoes: arrays with units, a sound slowed down for human ears, the scatterers.

``NAME.npz`` holds axes, impulse responses, spectra and the echoes of the call, with poses; of a flight all
arrays are stacked and padded to one length. ``NAME.wav`` plays the echoes ``time_expansion`` times slower,
one channel an ear, one pose after the other, as loud as the file can hold; ``wav_gain`` in the NPZ takes
that back. Of a sonar with a receiver the NPZ also holds what that recorded, the noise, signal over noise and
detections, and the WAV plays what it recorded. ``NAME-heard.npz`` lists what each leaf, branch and facet
added, in a scene that moves with its velocity at the ping's time and its place at rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..formats.table import write_npz
from ..formats.wav import write_wav
from ..sensing.sonar.echo import Contributions, Echo, PingSeries
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
RECEIVED_UNITS = {
    "call_pressure": "Pa",
    "snr_db": "dB",
    "range": "m",
    "range_snr_db": "dB",
    "detection_time": "s",
    "detection_snr_db": "dB",
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
    folder: Path, sonar: Sonar, found: Echo | PingSeries, offset: Sequence[float] = NONE
) -> list[Path]:
    """Write an echo or a flight; returns the files, the NPZ first.

    offset : (3,) metres, added to positions.

    Raises
    ------
    OSError : a file cannot be written; what had its name before stays as it was.
    """
    files = [folder / f"{sonar.name}.npz", folder / f"{sonar.name}.wav"]
    write_echo_arrays(files[0], found, offset)
    write_echo_sound(files[1], found, sonar.time_expansion)
    if sonar.contributions:
        files.append(folder / f"{sonar.name}-heard.npz")
        write_npz(files[2], on_the_map(heard_columns(found), offset), HEARD_UNITS)
    return files


def write_echo_arrays(path: Path, found: Echo | PingSeries, offset: Sequence[float] = NONE) -> None:
    """Write axes, responses, spectra, echoes and poses as NPZ. offset : (3,) metres, added to positions."""
    flight, single = _flight(found), isinstance(found, Echo)
    arrays, units = _arrays(flight, flight.stacked("waveforms"), single), UNITS
    if received := received_arrays(flight):
        arrays, pascals = arrays | received, recorded_unit(received)
        units = UNITS | RECEIVED_UNITS | dict.fromkeys(("recorded", "noise_level"), pascals)
    arrays["wav_gain"] = np.array(_gain(flight.stacked("heard_waveforms")))
    write_npz(path, on_the_map(arrays, offset), units)


def write_echo_sound(path: Path, found: Echo | PingSeries, time_expansion: float) -> None:
    """Write the echoes as WAV, ``time_expansion`` times slower."""
    write_wav(path, *sound_of(found, time_expansion))


def sound_of(found: Echo | PingSeries, time_expansion: float) -> tuple[np.ndarray, int]:
    """The echoes ``time_expansion`` times slower: (N, E) samples as loud as a file can hold, rate in Hz."""
    flight = _flight(found)
    waveform = flight.stacked("heard_waveforms")
    sound = np.moveaxis(waveform, 1, 2).reshape(-1, waveform.shape[1]) * _gain(waveform)
    return sound, max(1, round(flight.echoes[0].sample_rate / time_expansion))


def _flight(found: Echo | PingSeries) -> PingSeries:
    return found if isinstance(found, PingSeries) else PingSeries((found,))


def _gain(waveform: np.ndarray) -> float:
    """Factor by which the loudest sample of (P, E, N) fills the WAV."""
    peak = float(np.abs(waveform).max(initial=0.0))
    return LOUD / peak if peak > 0 else 1.0


def _arrays(flight: PingSeries, waveform: np.ndarray, single: bool) -> dict[str, np.ndarray]:
    """Contents of the NPZ; of one ping at one ear, records are (N,)."""
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


def received_arrays(flight: PingSeries) -> dict[str, np.ndarray]:
    """Records of P pings by their receiver, padded to one length; nothing where there is none.

    recorded : (P, E, N). noise_level, snr_db : (P, E). range : (R,). range_snr_db : (P, E, R), -inf after
    a record's end. detection_ping, detection_ear, detection_time, detection_snr_db : (D,).
    """
    every = [echo.received for echo in flight.echoes if echo.received is not None]
    if not every:
        return {}
    longest = max((one.range for one in every), key=len)
    within = np.full((len(every), len(every[0].recorded), len(longest)), -np.inf)
    for row, one in zip(within, every, strict=True):
        row[:, : len(one.range)] = one.range_snr_db
    names = ("detection_ear", "detection_time", "detection_snr_db")
    return {
        "recorded": flight.stacked("heard_waveforms") * every[0].pressure,
        "call_pressure": np.array(every[0].pressure),
        "noise_level": np.array([one.noise_level for one in every]),
        "snr_db": np.array([one.snr_db for one in every]),
        "range": longest,
        "range_snr_db": within,
        "detection_ping": np.repeat(
            np.arange(len(every)), [len(one.detection_ear) for one in every]
        ),
        **{name: np.concatenate([getattr(one, name) for one in every]) for name in names},
    }


def recorded_unit(received: Mapping[str, np.ndarray]) -> str:
    """Unit of what is recorded: pascals, where the level of the call is said."""
    return "re call at 1 m" if received["call_pressure"] == 1.0 else "Pa"


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
    column = getattr(heard, name)
    return np.empty((0, 3)) if column is None else column
