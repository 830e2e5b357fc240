"""Record of what a sonar gives: the echo of a ping, or of one from every pose of its route; and its files.

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
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.words import keep
from ..drawing.strips import Plot, sound_plot
from ..formats.table import write_csv, write_npz
from ..formats.wav import write_wav
from ..sensing.kind import Seen
from ..sensing.sonar.echo import Contributions, Echo, PingSeries
from ..spec import Sonar, SonarReceiver
from .coordinates import on_the_map
from .kind import Figure, Finding, ResultKind, Variables, numbers, sound_columns, words

if TYPE_CHECKING:
    from ..sensing.sonar.receiver import Reception

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
    write_wav(files[1], *sound_of(found, sonar.time_expansion))
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


REFERENCE = 20e-6  # Pa, of levels of pressure


def _is_flight(found: Finding) -> bool:
    return hasattr(found, "echoes")


def loudest(flight: PingSeries) -> Echo:
    """The ping of a flight whose echo has the highest peak."""
    return max(flight.echoes, key=lambda echo: float(echo.envelope.max(initial=0.0)))


def strongest(echo: Echo) -> tuple[float, float] | None:
    """Distance of the loudest echo, m, and its level, dB re call at 1 m; None: silence."""
    if not np.any(echo.envelope):
        return None
    peak = int(np.argmax(echo.envelope))
    distance = float(echo.time[peak] * echo.sound_speed / 2)
    return distance, float(20 * np.log10(echo.envelope[peak]))


def _figures(sonar: Sonar, found: Finding, _seen: Seen | None) -> list[Figure]:
    """Return the figures of an echo, of a flight those of its loudest ping."""
    if not _is_flight(found):
        return _of_echo(sonar, found)
    return [numbers("", "Pings", f"{len(found):,}"), *_of_echo(sonar, loudest(found), found.echoes)]


def _of_echo(sonar: Sonar, echo: Echo, echoes: Sequence[Echo] = ()) -> list[Figure]:
    """Figures of an echo; its error is the largest of all ``echoes`` that it stands for."""
    heard = {kind: int(np.count_nonzero(echo.heard.kind == kind)) for kind in ("wood", "facet")}
    figures = [
        numbers("leaves in the scene", "Leaves", f"{echo.leaves:,}"),
        numbers("leaves heard", "Leaves Heard", f"{echo.leaves_heard:,}"),
        numbers("pieces of wood heard", "Wood Heard", f"{heard['wood']:,}"),
        numbers("glints and rims heard", "Glints Heard", f"{heard['facet']:,}"),
        numbers("hidden by wood", "Behind Wood", f"{echo.hidden:,}"),
    ]
    figures += _of_motion(echo)
    peak = strongest(echo)
    if peak is None:
        figures += [words("strongest echo from", "", "nothing"), words("level", "Level", "silence")]
    else:
        figures += [
            numbers("strongest echo from", "Strongest", f"{peak[0]:.2f} m"),
            words("level", "Level", "{level:.1f} dB re call at 1 m", level=peak[1]),
        ]
    some = (
        ("later than the record", "Too Late", echo.late),
        ("leaves nearer than ka²/2", "Near Leaves", echo.close),
        ("discs of ka > 120 beyond 60°", "Doubtful Discs", echo.doubtful),
    )
    figures += [numbers(name, short, f"{count:,}") for name, short, count in some if count]
    figures += _of_receiver(sonar.receiver, echo.received)
    most = max(each.error_bound + each.table_error for each in (echo, *echoes))
    figures += [
        words("error of the sum at most", "", "{share:.1e} of all amplitudes", share=most),
        numbers("", "Error at Most", f"{100 * most:.2g} %"),
    ]
    return figures


def _of_receiver(receiver: SonarReceiver | None, received: Reception | None) -> list[Figure]:
    """Figures of what a receiver made of an echo; none without one."""
    if receiver is None or received is None:
        return []
    figures = []
    if receiver.noisy:
        level = 20 * np.log10(received.noise_level / REFERENCE)
        figures.append(numbers("noise in the band", "Noise", f"{level.max():.1f} dB re 20 µPa"))
        over = float(received.snr_db.max())
        said = f"{over:.1f} dB" if np.isfinite(over) else "no echo"
        figures.append(numbers("peak of the echo over the noise", "Over Noise", said))
        above = received.range[(received.range_snr_db >= 0.0).any(axis=0)]
        if len(above):
            far = f"{above.max():.1f} m"
            figures.append(numbers("echo above the noise up to", "Above Noise", far))
    if receiver.threshold_db is not None:
        figures.append(numbers("detections", "Detections", f"{len(received.detection_ear):,}"))
    if received.clipped:
        figures.append(numbers("samples that were clipped", "Clipped", f"{received.clipped:,}"))
    return figures


def _of_motion(echo: Echo) -> list[Figure]:
    """Figures of a ping in a scene that moves: how much of what is heard does, and how fast; none of a still
    one."""
    velocity = echo.heard.velocity
    if velocity is None or not len(velocity):
        return []
    speed, loud = np.linalg.norm(velocity, axis=1), echo.heard.amplitude
    moving = float(loud[speed > 0].sum() / max(loud.sum(), 1e-300))
    figures = [numbers("of all amplitudes, by what moves", "Heard Moving", f"{moving:.1%}")]
    if not speed.any():
        return figures
    mean = float((loud @ speed) / loud.sum())
    said = f"{mean:.2g} m/s (mean by amplitude), at most {speed.max():.2g} m/s"
    return [*figures, numbers("speed of what is heard", "Speed Heard", said)]


def _sentence(found: Finding) -> str:
    if _is_flight(found):
        return keep(
            "{count:,} pings, the loudest: {found}",
            count=len(found),
            found=_sentence(loudest(found)),
        )
    peak = strongest(found)
    if peak is None:
        return keep("silence: nothing in the beam")
    if not found.leaves_heard:
        return keep("strongest echo from {distance:.2f} m", distance=peak[0])
    return keep("{count:,} leaves heard", count=found.leaves_heard)


def _story(sonar: Sonar, found: Finding) -> str:
    if _is_flight(found):
        return f"{len(found)} pings of {_call_in_words(sonar)}; what follows is of the loudest."
    return f"One ping of {_call_in_words(sonar)}."


def _call_in_words(sonar: Sonar) -> str:
    beam = {"horseshoe": "a horseshoe bat's", "file": "a measured", "omni": "an even"}
    model = {"piston": "hard discs (physical optics)", "paper": "the fit of Tanveer et al. 2020a"}
    return (
        f"{sonar.band[0] / 1e3:g} to {sonar.band[1] / 1e3:g} kHz with "
        f"{beam.get(sonar.beam, f'a {sonar.beam_width_deg[0]:g}°')} beam, at {sonar.ears} "
        f"ear{'s' if sonar.ears > 1 else ''}; leaves scatter as "
        f"{model.get(sonar.leaf_model, 'hard discs (exact)')}"
    )


def _doubts(sonar: Sonar, found: Finding) -> tuple[str, ...]:
    """Return that a tolerance was not reached, and what to do, and that leaves are too dense."""
    return (*_doubts_about_sum(sonar, found), *_doubts_about_density(found))


def _doubts_about_density(found: Finding) -> tuple[str, ...]:
    """Return that leaves near the beam's axis are too dense for echoes of single leaves."""
    from ..sensing.sonar.rescattering import DENSE, LEAVES, density_of, nearest_leaves

    leaves = nearest_leaves((loudest(found) if _is_flight(found) else found).groups)
    if leaves is None or len(leaves) < LEAVES or density_of(leaves) < DENSE:
        return ()
    return (
        f"leaves near the beam's axis are dense, {density_of(leaves):.0f} m² a m³: echoes from leaf to leaf, "
        "which are left out, change the waveform by a third or more, its mean energy by 1 to 2 dB. Trust the "
        "energy and its spread rather than single peaks.",
    )


def _doubts_about_sum(sonar: Sonar, found: Finding) -> tuple[str, ...]:
    """Silent where the sum has at most two thirds of all bounds, with what is left out as too weak and the
    tables: then a finer sum makes the result no surer. The notes give all three."""
    echoes = _flight(found).echoes
    error = max(echo.error_bound for echo in echoes)
    others = max(echo.cull_bound + echo.table_error for echo in echoes)
    if not error > max(sonar.tolerance, 2.0 * others) or not sonar.tolerance:
        return ()
    enough = 10.0 ** np.ceil(np.log10(error))
    return (
        f"the sum may be {error:.1e} of all amplitudes off, where {sonar.tolerance:.0e} was asked for: what "
        f"is looked up is not smooth enough. Set tolerance to {enough:.0e}, or to 0 for the direct sum.",
    )


SHADES = {
    "none": "Nothing shades anything, as in the paper.",
    "trunks": "Leaves do not shade each other; wood hides them as straight rays would.",
    "extinction": "Leaves weaken what lies behind them, large ones hide it; wood hides nothing.",
    "trunks+extinction": "Leaves weaken what lies behind them, large ones and wood hide it as straight rays "
    "would.",
}
NOISES = {
    "wind": "wind in vegetation by Boersma 1997, measured over grassland up to 20 kHz",
    "insects": "insects of a tropical night by Schmidt & Römer 2011, up to 80 kHz",
    "rain": "rain at the level that is given, up to 20 kHz",
}


def _notes(sonar: Sonar, found: Finding) -> tuple[str, ...]:
    echoes, noises = _flight(found).echoes, []
    bound, error, table = (
        max(getattr(echo, name) for echo in echoes)
        for name in ("cull_bound", "error_bound", "table_error")
    )
    kind = "Fast sum" if sonar.tolerance else "Direct sum over every scatterer and frequency"
    summed = f"{kind}, error at most {error:.1e} of all amplitudes"
    if error > sonar.tolerance > 0:
        summed += f" ({sonar.tolerance:.0e} was asked for)"
    if table:
        summed += f", and {table:.1e} from the tables of discs and cylinders"
    receiver = sonar.receiver
    if receiver is not None and receiver.ambient != "none":
        noise = NOISES[receiver.ambient]
        noises.append(f"Noise of {noise}; above, 6 dB less an octave is an assumption.")
    weak = f"{summed}; what is left out as too weak adds at most {bound:.1e} of them."
    return *noises, weak, SHADES[sonar.shading]


def _columns(found: Finding) -> dict[str, list[Any]]:
    """Time and channels of a sound; of a flight one ping after the other."""
    flight = _flight(found)
    stacked = flight.stacked("heard_waveforms")
    samples = np.moveaxis(stacked, 1, 0).reshape(stacked.shape[1], -1)
    return sound_columns(samples, float(flight.echoes[0].sample_rate))


def _plot(_sonar: Sonar, found: Finding) -> Plot:
    flight = _flight(found)
    pings = flight.stacked("heard_waveforms")[:, 0].ravel()
    return sound_plot(pings, flight.echoes[0].sample_rate)


def _labelled(found: Finding) -> tuple[Variables, Variables]:
    pings, dims = _flight(found), ("ping", "ear", "time")
    unit = "re the call at 1 m"
    place, _ = pings.poses()
    received: Variables = {}
    if made := received_arrays(pings):
        received = {
            "recorded": (dims, made["recorded"], recorded_unit(made)),
            "noise_level": (dims[:2], made["noise_level"], recorded_unit(made)),
            "snr_db": (dims[:2], made["snr_db"], "dB"),
        }
    return {
        "waveform": (dims, pings.stacked("waveforms"), unit),
        "envelope": (dims, pings.stacked("envelopes"), unit),
        **received,
    }, {
        "time": (("time",), pings.time, "s"),
        **{name: (("ping",), place[:, k], "m") for k, name in enumerate("xyz")},
    }


SONAR = ResultKind(
    figures=_figures,
    labelled=_labelled,
    sentence=_sentence,
    story=_story,
    notes=_notes,
    doubts=_doubts,
    files=(".npz", ".wav", "-heard.npz"),
    write=write_echo,
    saves={
        ".wav": lambda path, sonar, found, *_: write_wav(
            path, *sound_of(found, sonar.time_expansion)
        ),
        ".npz": lambda path, _sonar, found, offset: write_echo_arrays(path, found, offset),
        ".csv": lambda path, _sonar, found, *_: write_csv(path, _columns(found)),
    },
    plot=_plot,
    marks=lambda found: None if _is_flight(found) else found.heard,
    sound=lambda sonar, found: sound_of(found, sonar.time_expansion),
)
