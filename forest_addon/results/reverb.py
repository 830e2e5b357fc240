"""Record of what a reverb gives: impulse responses, a channel for each pair of source and receiver.

Dry sounds that a forest is heard with are a hand clap, a bat's call slowed down as echoes are, or a WAV file.
The clap is noise through a resonance of the cupped hands with the envelope t exp(-t/τ); peak and length are
as Repp (1987) found them for a clap with hollow palms. The call is a falling sweep as ``sonar.calls`` makes
it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..base.rng import stream
from ..base.words import keep
from ..drawing.strips import Plot, sound_plot
from ..formats.sofa import write_responses
from ..formats.table import write_csv, write_npz
from ..formats.wav import read_wav, write_wav
from ..sensing.kind import Seen
from ..sensing.reverb.channels import ImpulseResponse, channels_of
from ..sensing.reverb.metrics import RoomMetrics, echo_density, energy_decay_db, room_metrics
from ..spec import Reverb, Sonar
from .coordinates import Offset
from .kind import Figure, ResultKind, Variables, numbers, sound_columns, words

if TYPE_CHECKING:
    from ..sensing.reverb.model_error import ModelError

SHOWN_CHANNELS = 8  # whose names are listed


def _figures(reverb: Reverb, response: ImpulseResponse, seen: Seen | None) -> list[Figure]:
    trunks = None
    if seen is not None:
        from ..sensing.reverb.kind import trunks_of

        trunks = len(trunks_of(seen, reverb).radius)
    from ..sensing.reverb.forest.surroundings import terms_of

    held, missing = terms_of(reverb, response.stand)
    name = {"paper": "single scattering (Kaneko & Gamper 2021)", "forest": "forest"}[reverb.model]
    return [
        *of_response(response, trunks, reverb.duration or np.inf),
        numbers("model", "", name),
        numbers("in the model", "", "; ".join(held)),
        numbers("not in the model", "", "; ".join(missing)),
    ]


def of_response(
    response: ImpulseResponse, trunks: int | None = None, record: float = np.inf
) -> list[Figure]:
    """Measures are those of the first channel; record : s, where sound may come later (``_doubts``)."""
    channels = response.channels
    listed = ", ".join(channel.channel for channel in channels[:SHOWN_CHANNELS])
    if len(channels) > SHOWN_CHANNELS:
        listed += f" and {len(channels) - SHOWN_CHANNELS} more"
    measured = room_metrics(response.samples, response.sample_rate, response.left_db)
    decay, clarity = np.where(measured.t30 <= record, measured.t30, np.nan), measured.c50[0]
    seconds = len(response.samples) / response.sample_rate
    figures = [
        numbers("channels", "", listed),
        numbers("record", "", f"{seconds:.2f} s at {response.sample_rate:g} Hz"),
    ]
    if trunks is not None:
        figures.append(numbers("trunks cut from the scene", "", f"{trunks:,}"))
    return [
        *figures,
        numbers("trunks heard", "Trunks Heard", f"{response.trunks:,}"),
        *(
            [numbers("trees that they are of", "Trees Heard", f"{response.stands:,}")]
            if 0 <= response.stands < response.trunks
            else []
        ),
        numbers("trunks beyond the field", "Beyond Field", f"{response.continued:,}"),
        numbers("trunks after the record's end", "Too Late", f"{response.late:,}"),
        numbers("reverberation time", "Reverb Time", f"{decay[0]:.2f} s")
        if np.isfinite(decay[0])
        else words("reverberation time", "Reverb Time", "not reached"),
        _by_octave("reverberation time by octave", measured.band, decay, "s", 2),
        numbers("C50", "Clarity C50", f"{clarity:.1f} dB")
        if np.isfinite(clarity)
        else words("C50", "Clarity C50", "no late sound"),
        _by_octave("C50 by octave", measured.band, measured.c50, "dB", 1),
        _passing("direct path", "Direct Path", [channel.direct_clear for channel in channels]),
        _passing("ground path", "Ground Path", [channel.ground_clear for channel in channels]),
        *_multiple_scattering(response.model_error),
        *_of_tail(response.tail_error, measured.band),
    ]


def _of_tail(error: np.ndarray | None, band: np.ndarray) -> Iterator[Figure]:
    """Error of the level of noise because its energy is drawn, where there is such."""
    if error is not None and np.isfinite(error).any():
        yield _by_octave(
            "standard error of the tail's level by octave", band, np.append(np.nan, error), "dB", 1
        )
        worst = int(np.nanargmax(error))
        yield numbers("", "Tail Error", f"{error[worst]:.1f} dB at {band[1 + worst]:g} Hz")


def _by_octave(name: str, band: np.ndarray, value: np.ndarray, unit: str, digits: int) -> Figure:
    """Octaves with their values; those without are left out."""
    shown = {
        f"{middle:g} Hz": f"{number:.{digits}f} {unit}"
        for middle, number in zip(band[1:], value[1:], strict=True)
        if np.isfinite(number)
    }
    text = ", ".join(f"{octave} {told}" for octave, told in shown.items()) or "not reached"
    return replace(numbers(name, "", text), by_octave=shown)


def _passing(name: str, short: str, clear: Sequence[bool]) -> Figure:
    """Return whether a path is clear, for one channel or several."""
    free = sum(clear)
    if free == len(clear):
        return words(name, short, "clear")
    if not free:
        return words(name, short, "blocked by wood")
    count = len(clear)
    return words(
        name, short, "blocked by wood in {blocked} of {count}", blocked=count - free, count=count
    )


def _multiple_scattering(found: ModelError | None) -> Iterator[Figure]:
    """Error of single scattering, if it was measured and there was something to measure."""
    if found is not None and len(found.frequency):
        yield numbers(
            "error of single scattering",
            "",
            f"{100 * found.relative:.0f} % (L2), {found.level_db:+.1f} dB against exact multiple "
            f"scattering by the {len(found.trunks)} trunks with the shortest paths, line source in the "
            f"plane, {found.frequency[0]:.0f} to {found.frequency[-1]:.0f} Hz",
        )


def _sentence(response: ImpulseResponse) -> str:
    if not response.trunks:
        return keep("no trunks heard")
    beyond = response.continued  # trunks, each of which counts as a tree
    count, trees = response.trunks - beyond, response.stands - beyond
    if 0 <= trees < count:
        stems = "{count:,} stems of {trees:,} trees heard"
        around = ", and {beyond:,} trunks around the scene" if beyond else ""
        return keep(stems + around, count=count, trees=trees, beyond=beyond)
    if response.trunks == 1:
        return keep("1 trunk heard")
    return keep("{count:,} trunks heard", count=response.trunks)


def _story(reverb: Reverb, response: ImpulseResponse) -> str:
    distance = float(np.linalg.norm(np.subtract(response.source, response.receiver)))
    how = (
        "from single scattering by trunks (Kaneko & Gamper 2021)."
        if reverb.model == "paper"
        else "from scattering by trunks with what a forest takes."
    )
    return f"The impulse response over {distance:.1f} m, {how}"


def _notes(reverb: Reverb, response: ImpulseResponse) -> tuple[str, ...]:
    channels = response.channels
    peak = float(np.abs([channel.samples for channel in channels]).max())
    most = max(channel.clamped for channel in channels)
    summed = f"Sum over trunks to a relative error of {reverb.tolerance:.0e}, in every octave."
    if response.exact:
        summed = "Direct sum over every trunk and frequency in float64."
    if reverb.model == "paper" or reverb.tail == "none":
        summed += (
            " Single scattering itself is the larger error, and grows with the density of the stand"
            " (rescattering = 100 measures it)."
        )
    said = (  # what holds, and what is said then
        (
            np.isfinite(response.joint),
            f"From {response.joint:.2f} s on the trunks' sound is noise with the energy of transport: "
            f"{100 * reverb.multiple_share:.0f} % of it was scattered more than once.",
        ),
        (
            response.late,
            f"The record ends before the sound: {response.late:,} trunks come later, with "
            f"{response.left_db[0]:.0f} dB of the energy. Measures that this would change are left out; "
            "duration = 0 records all.",
        ),
        (
            len(channels) > 1,
            f"Figures are of the first of {len(channels)} channels, {response.channel}; "
            f"{reverb.name}.npz has those of all.",
        ),
        (
            response.sprays,
            f"{', '.join(response.sprays)}: needles that are drawn as flat sprays count as leaves, which "
            "scatter as discs and absorb as leaves do, more than needles; conifers with shoots "
            "(norway-spruce, scots-pine, silver-fir) are heard needle by needle.",
        ),
        (
            response.moves,
            "Source or receiver move: each moment has channels of its own; a dry sound is heard through all "
            "of them, its direct sound and the ground's with their Doppler shift at every sample, what "
            "trunks scatter faded from moment to moment.",
        ),
        (
            reverb.heard_as == "ambisonics",
            "Ambisonics of first order: W, Y, Z, X (ACN), SN3D.",
        ),
        (
            reverb.noise_db,
            "Background noise is added where a dry sound is heard, not to impulse responses.",
        ),
        (
            most,
            f"{most} trunk(s) cover a source or a receiver; their distance is taken as their radius.",
        ),
        (
            peak > 1,
            "The sound exceeds full scale; the WAV is 32-bit float and does not clip.",
        ),
    )
    return (
        summed,
        "Reverberation time is read from -5 to -35 dB of the energy decay; C50 with the onset at "
        "-20 dB.",
        *(sentence for holds, sentence in said if holds),
    )


def _doubts(reverb: Reverb, response: ImpulseResponse) -> tuple[str, ...]:
    """Return that a tolerance was not reached, where, or that a record is too short, and what to do."""
    longest = np.fmax.reduce(
        room_metrics(response.samples, response.sample_rate, response.left_db).t30
    )
    return (
        *(
            f"the record of {record:g} s is shorter than the reverberation time that its decay would give "
            f"({longest:.2f} s at most): what is longer than the record is left out of the figures. "
            "duration = 0 records all."
            for record in [reverb.duration]
            if 0 < record < longest
        ),
        *(
            f"the sum over trunks may be {error:.0e} off from {low:g} to {2 * low:g} Hz, where "
            f"{reverb.tolerance:.0e} was asked for. Set tolerance to 0 for the direct sum."
            for low, error in sorted(response.errors.items())
            if error > reverb.tolerance
        ),
    )


def _write(folder: Path, reverb: Reverb, response: ImpulseResponse, _offset: Offset) -> list[Path]:
    path, arrays = (folder / f"{reverb.name}{ending}" for ending in (".wav", ".npz"))
    _save_sound(path, reverb, response)
    write_response(arrays, response)
    return [path, arrays]


def _save_sofa(path: Path, reverb: Reverb, response: ImpulseResponse, *_: object) -> None:
    """Write measurements source by source and moment by moment, by receivers."""
    rows: dict[tuple, list[ImpulseResponse]] = {}
    for one in response.channels:
        rows.setdefault((one.at if one.moves else None, one.source), []).append(one)
    table = list(rows.values())
    write_responses(
        path,
        np.array([[one.samples for one in row] for row in table]),
        response.sample_rate,
        np.array([row[0].source for row in table]),
        np.array([[one.receiver for one in row] for row in table]),
        reverb.name,
        [one.channel.split(" to ", 1)[1] for one in table[0]],
    )


def _save_table(path: Path, _reverb: Reverb, response: ImpulseResponse, *_: object) -> None:
    samples = np.atleast_2d(channels_of(response).T)
    write_csv(path, sound_columns(samples, response.sample_rate))


def _save_sound(path: Path, _reverb: Reverb, response: ImpulseResponse, *_: object) -> None:
    write_wav(path, channels_of(response), response.sample_rate)


def write_response(path: Path, found: ImpulseResponse) -> None:
    """Write the channels of an impulse response with their parts, axes, units and measures as NPZ.

    Arrays of measures are (C, B): by channel and by band, 0 Hz for the whole band.
    """
    channels = found.channels
    measures = [
        room_metrics(channel.samples, found.sample_rate, channel.left_db) for channel in channels
    ]
    moving = {"moment": np.array([one.at for one in channels])} if found.moves else {}
    drawn = [channel.tail_error for channel in channels if channel.tail_error is not None]
    tails = {"tail_error": np.array(drawn)} if len(drawn) == len(channels) else {}
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
        "source": np.array([channel.source for channel in channels]),
        "receiver": np.array([channel.receiver for channel in channels]),
        **moving,
        **tails,
        "direct_delay": np.array([channel.direct_delay for channel in channels]),
        "left_out": np.array([channel.left_db for channel in channels]),
        "energy_decay": np.array([energy_decay_db(channel.samples) for channel in channels]),
        "band": measures[0].band,
        **{
            field.name: np.array([getattr(measure, field.name) for measure in measures])
            for field in fields(RoomMetrics)
            if field.name != "band"
        },
        "echo_density_time": times[0],
        "echo_density": np.array(densities),
    }
    units = {
        **dict.fromkeys(("time", "direct_delay", "centre_time", "echo_density_time"), "s"),
        **dict.fromkeys(("edt", "t20", "t30", "t60"), "s"),
        "band": "Hz",
        "d50": "1",
        **dict.fromkeys(("energy_decay", "left_out", "c50", "c80"), "dB"),
        "echo_density": "1",
        "source": "m",
        "receiver": "m",
        **dict.fromkeys(moving, "s"),
        **dict.fromkeys(tails, "dB"),
        **dict.fromkeys(("samples", "direct", "ground", "trees"), "re source's impulse at 1 m"),
    }
    write_npz(path, arrays, units)


def _plot(_reverb: Reverb, response: ImpulseResponse) -> Plot:
    return sound_plot(response.samples, response.sample_rate, decay=True)


def wet_sound_of(
    reverb: Reverb, response: ImpulseResponse, dry: np.ndarray, dry_rate: float
) -> tuple[np.ndarray, float]:
    """(N, C) samples of a dry sound (M,) or (M, D) in the forest, and their rate; noise is in them.

    Where source or receiver move, C are the channels of one moment, and the sound begins when the path does.
    """
    from ..sensing.reverb.auralise import auralise, background, resample
    from ..sensing.reverb.moving import heard_moving

    rate = response.sample_rate
    mono = np.asarray(dry, np.float64)
    mono = resample(mono.mean(axis=1) if mono.ndim == 2 else mono, dry_rate, rate)
    if response.moves:
        speed = float(np.linalg.norm(np.subtract(response.source, response.receiver)))
        heard = heard_moving(response, mono, speed / max(response.direct_delay, 1e-9))
    else:
        heard = auralise(channels_of(response), mono, rate, rate)
    if reverb.noise_db:
        aside = np.sqrt(1 / 3) if reverb.heard_as == "ambisonics" else 1.0
        gains = [aside if one.component else 1.0 for one in response.channels][: heard.shape[1]]
        rng = stream(0, "reverb", reverb.name, "background")
        heard = heard + background(reverb.noise_db, mono, rate, len(heard), tuple(gains), rng)
    return heard, rate


def _labelled(response: ImpulseResponse) -> tuple[Variables, Variables]:
    samples = channels_of(response)
    samples = samples[:, None] if samples.ndim == 1 else samples
    names = np.array([channel.channel for channel in response.channels])
    time = np.arange(len(samples)) / response.sample_rate
    return {"sample": (("time", "channel"), samples, "re the source's impulse at 1 m")}, {
        "time": (("time",), time, "s"),
        "channel": (("channel",), names, ""),
    }


REVERB = ResultKind(
    figures=_figures,
    labelled=_labelled,
    sentence=_sentence,
    story=_story,
    notes=_notes,
    doubts=_doubts,
    files=(".wav", ".npz"),
    write=_write,
    saves={
        ".wav": _save_sound,
        ".npz": lambda path, _reverb, response, *_: write_response(path, response),
        ".csv": _save_table,
        ".sofa": _save_sofa,
    },
    plot=_plot,
    sound=lambda _reverb, response: (channels_of(response), response.sample_rate),
    is_response=True,
    wet=wet_sound_of,
)


DRY = ("clap", "call", "file")
PEAK_DB = -1.0  # of the largest sample that is heard
CLAP_RATE = 48_000.0
RISE = 0.0015  # s to the clap's loudest
CLAP_LENGTH = 0.03  # s
RESONANCE, QUALITY = 1300.0, 1.5  # Hz, of the air between the hands
CALL = replace(Sonar(), call="fm", band=(25e3, 80e3), call_duration=0.004)


def dry_sound(dry: str, file: Path | None = None) -> tuple[np.ndarray, float]:
    """(M,) samples, of a file also (M, D), and their rate in Hz.

    Raises
    ------
    SpecError : the file cannot be used.
    """
    if dry == "file":
        return read_wav(file or Path())
    if dry == "call":
        from ..sensing.sonar.calls import synthesise

        call = synthesise(CALL)
        return call.samples, call.sample_rate / CALL.time_expansion
    from scipy.signal import iirpeak, lfilter

    time = np.arange(round(CLAP_LENGTH * CLAP_RATE)) / CLAP_RATE
    noise = stream(0, "clap").standard_normal(len(time))
    burst = lfilter(*iirpeak(RESONANCE, QUALITY, CLAP_RATE), noise)
    clap = burst * (time / RISE) * np.exp(1.0 - time / RISE)
    return np.asarray(clap / np.abs(clap).max()), CLAP_RATE
